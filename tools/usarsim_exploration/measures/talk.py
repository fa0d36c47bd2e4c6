"""Who could speak with whom, how old what they heard was, and what it took."""

from __future__ import annotations

import numpy as np

from usarsim_exploration.history import Counts, History
from usarsim_exploration.measures.base import MRESIM, ROBOTS, declare, lasting


def _silence(history: History) -> Counts:
    """Steps since the base was linked with each working robot, one value for each and row."""
    found = lasting(~history.linked_base[:, ROBOTS])
    return found[history.works[:, ROBOTS]]


@declare(
    "max_latency", "Longest latency", "steps",
    "Longest time that a step of the base was old when a robot first heard of it or a later one.",
    MRESIM, "less",
)  # fmt: skip
def _max_latency(history: History) -> int:
    longest, _ = history.message_latencies()
    return int(longest[-1, ROBOTS].max())


@declare(
    "mean_latency", "Mean latency", "steps",
    "Mean over robots of the mean age of the base's steps when a robot first heard of them or "
    "later ones; steps it never heard of do not count.", MRESIM, "less",
)  # fmt: skip
def _mean_latency(history: History) -> float:
    _, total = history.message_latencies()
    heard = history.steps - history.latency[-1] + 1
    return float((total[-1] / heard)[ROBOTS].mean())


@declare(
    "disconnected", "Disconnected", "%",
    "Part of the steps of working robots in which no chain of links led to the base.",
    better="less",
)  # fmt: skip
def _disconnected(history: History) -> float:
    return float(100 * np.mean(_silence(history) > 0))


@declare(
    "mean_silence", "Mean silence", "steps",
    "Mean over steps and working robots of the time since a chain of links led to the base.",
    better="less",
)  # fmt: skip
def _mean_silence(history: History) -> float:
    return float(_silence(history).mean())


@declare(
    "longest_silence", "Longest silence", "steps",
    "Longest time that a working robot was without a chain of links to the base.", better="less",
)  # fmt: skip
def _longest_silence(history: History) -> int:
    return int(_silence(history).max())


@declare("mean_links", "Links", "1", "Mean over steps of pairs that heard each other directly.")
def _mean_links(history: History) -> float:
    return sum(map(len, history.links)) / len(history.links)


@declare("cells_sent", "Cells sent", "cells", "Entries of maps in all messages.", better="less")
def _cells_sent(history: History) -> int:
    return int(history.cells_sent[-1])


@declare("bytes_sent", "Bytes sent", "bytes", "Size of all messages.", better="less")
def _bytes_sent(history: History) -> int:
    return int(history.bytes_sent[-1])
