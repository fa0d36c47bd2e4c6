"""What a link does to the traffic it carries: latency, bandwidth, loss. No clock, no socket."""

from __future__ import annotations

import random
from dataclasses import dataclass

__all__ = ["LinkClock", "LinkShape"]

FRAME = 1500
"""Bytes that get lost together: the greatest payload of an IEEE 802.11 or Ethernet frame."""


@dataclass(frozen=True, slots=True)
class LinkShape:
    """Properties of every link in either direction; times are simulated.

    Attributes:
        latency: s from one end to the other.
        bandwidth: bytes/s; 0 for as much as the machine carries.
        loss: probability that a frame gets lost, below 1. Links carry TCP, so nothing is missing
            in the end: a lost frame is sent again, and that takes time.
        retry_delay: s until a lost frame is sent again.
    """

    latency: float = 0.0
    bandwidth: float = 0.0
    loss: float = 0.0
    retry_delay: float = 0.02

    @property
    def plain(self) -> bool:
        """Whether traffic simply passes."""
        return not (self.latency or self.bandwidth or self.loss)


class LinkClock:
    """Tells when each block of one direction of one link arrives; blocks never overtake."""

    def __init__(self, shape: LinkShape, seed: str) -> None:
        """Begin with an idle link; equal seeds lose equal frames."""
        self._shape = shape
        self._random = random.Random(seed)
        self._free = 0.0

    def arrival(self, now: float, size: int) -> float:
        """When a block of so many bytes, handed over now, has arrived whole (simulated s)."""
        shape = self._shape
        frames = -(-size // FRAME)
        again = self._lost(frames) if shape.loss else 0
        airtime = again * shape.retry_delay
        if shape.bandwidth:
            airtime += (size + again * FRAME) / shape.bandwidth
        self._free = max(self._free, now) + airtime
        return self._free + shape.latency

    def _lost(self, frames: int) -> int:
        """How often any of the frames has to be sent again."""
        again = 0
        for _ in range(frames):
            while self._random.random() < self._shape.loss:
                again += 1
        return again
