"""Every stream is complete in simulated time, however little the server keeps up."""

from __future__ import annotations

import re
import threading
from collections import Counter

import pytest

from usarsim_server.testing import ScriptedClient, ServerProcess

SECONDS = 6.0
"""Simulated s that are listened to, from the first STA on."""
CLASSES = ("P3AT", "P3AT", "P3AT", "P2AT", "P2AT", "Nao", "Kenaf", "Hummer")
PERIODS = {"Nao": 0.01, "P2AT": 0.2, "Hummer": 0.2}
"""Simulated s between two STA, where it is not the usual 0.1."""
STEP = 0.005
"""s: no step of the physics is longer; a report is due at the first one not before its time."""

_TIME = re.compile(r"\{Time ([\d.]+)\}")
_STREAM = re.compile(r"(?:SEN|MISSTA|ASTA|EFF) (?:\{Type \w+\} ?)?(?:\{Name [^ }]+)?")


def listen(client: ScriptedClient, heard: list[str]) -> None:
    """Keep the lines of the span."""
    end: float | None = None
    while True:
        line = client.read_line()
        if line.startswith("STA"):
            found = _TIME.search(line)
            assert found is not None
            end = float(found[1]) + SECONDS if end is None else end
            if float(found[1]) > end - PERIODS["Nao"] / 2:
                return
        if end is not None:
            heard.append(line)


def team_hears(*options: str) -> list[list[str]]:
    """What each robot of a team tells in a span, on a server with these options."""
    heard: list[list[str]] = [[] for _ in CLASSES]
    with ServerProcess("--world", "arena", *options) as server:
        clients = [server.client() for _ in CLASSES]
        for number, (client, name) in enumerate(zip(clients, CLASSES, strict=True)):
            client.send(f"INIT {{ClassName USARBot.{name}}} {{Start RobotStart{1 + number % 5}}}")
            client.send("SYNC {Ticks 100}")  # means something in lockstep only
        threads = [
            threading.Thread(target=listen, args=(client, lines), daemon=True)
            for client, lines in zip(clients, heard, strict=True)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for client in clients:
            client.close()
    return heard


def streams(lines: list[str]) -> Counter[str]:
    """How many lines of each stream there are, STA aside."""
    bare = (_TIME.sub("", line).replace("  ", " ") for line in lines)
    return Counter(found[0] for line in bare if (found := _STREAM.match(line)))


@pytest.fixture(scope="module")
def complete() -> list[Counter[str]]:
    """The streams of the team where nobody is in a hurry."""
    return [streams(lines) for lines in team_hears("--lockstep")]


@pytest.mark.parametrize("speed", ["1", "50", "max"])
def test_no_report_is_lost(speed: str, complete: list[Counter[str]]) -> None:
    """STA of eight robots comes in its exact period and every sensor as often as it should.

    No machine gets to fifty times real time: there the reports cannot keep up, and the world has
    to wait for them.
    """
    for name, lines, usual in zip(CLASSES, team_hears("--speed", speed), complete, strict=True):
        period = PERIODS.get(name, 0.1)
        told = [_TIME.search(line) for line in lines if line.startswith("STA")]
        times = [float(found[1]) for found in told if found is not None]
        assert len(times) == round(SECONDS / period), name
        for number, moment in enumerate(times):
            assert abs(moment - times[0] - number * period) < STEP, (name, number)
        assert streams(lines) == usual, name
        assert usual, name
