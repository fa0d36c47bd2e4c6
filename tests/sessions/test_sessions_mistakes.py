"""The log says once what a client gets wrong, and what was probably meant."""

from __future__ import annotations

import logging

import pytest

from usarsim_server.protocol.grammar import parse_line
from usarsim_server.sessions.tap import Row, Tap
from usarsim_server.testing import Rehearsal, RehearsedClient

MISTAKES = [
    ("DRIV {Left 1}", "there is no command `DRIV`; did you mean `DRIVE`?"),
    ("DRIVE {Lef 1} {Right 1}", "DRIVE has no segment `Lef`; did you mean `left`?"),
    ("DRIVE {Left fast} {Right 1}", "Left: `fast` is not a number, read as 0"),
    ("DRIVE {Name Foo} {Value 1}", "there is no such joint (name Foo)"),
    ("GETCONF {Type Sonarr}", "nothing answers; did you mean `Sonar`? (type Sonarr)"),
    ("GETGEO {Type RangeScanner} {Name Scaner1}", "nothing answers; did you mean `Scanner1`?"),
    ("SET {Type Nope} {Name X} {Opcode Y} {Params 1}", "SET has no addressee (type Nope, name X)"),
    ("MISPKG {Name Armm} {Link 1} {Value 1}", "there is no such actuator (name Armm, known "),
]


def _told(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [one.getMessage() for one in caplog.records if one.levelno == logging.WARNING]


@pytest.fixture
def driver(stage: Rehearsal, connection: RehearsedClient) -> RehearsedClient:
    """A client with a robot, which has made no mistake yet."""
    connection.send("INIT {ClassName USARBot.P2AT} {Location 0,0,-0.3}")
    stage.run(0.4)
    connection.send("DRIVE {Left 1} {Right 1}")
    return connection


@pytest.fixture(autouse=True)
def _quiet(caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    """The log at its level by default, and read by the test."""
    monkeypatch.setattr(logging.getLogger("usarsim"), "propagate", True)
    caplog.set_level(logging.WARNING, "usarsim")


@pytest.mark.parametrize(("line", "told"), MISTAKES)
def test_mistakes_are_logged_once(
    driver: RehearsedClient, caplog: pytest.LogCaptureFixture, line: str, told: str
) -> None:
    """One warning, however often the client repeats it, beside commands that are right."""
    assert _told(caplog) == []
    for _ in range(3):
        driver.send(line, "DRIVE {Left 1} {Right 1}")
    [warning] = _told(caplog)
    assert warning.startswith(f"not as asked: {told}")


def test_client_without_a_robot(
    connection: RehearsedClient, caplog: pytest.LogCaptureFixture
) -> None:
    """A command before INIT does nothing; INIT of an unknown class is not told twice."""
    connection.send("DRIVE {Left 1} {Right 1}")
    assert _told(caplog) == ["not as asked: ignored: no robot yet (request Drive)"]
    caplog.clear()
    connection.send("INIT {ClassName USARBot.P2ATT}")
    assert _told(caplog) == ["INIT failed: unknown class; did you mean `P2AT`?"]


def test_many_mistakes(driver: RehearsedClient, caplog: pytest.LogCaptureFixture) -> None:
    """A client that sends nonsense without end fills no log."""
    driver.send(*(f"NONSENSE{number} {{A 1}}" for number in range(500)))
    assert len(_told(caplog)) == 20


@pytest.mark.parametrize("line", [b"DRIV {Left 1}", b"Trace {On true}"])
def test_onlooker_reads_that_a_command_did_nothing(line: bytes) -> None:
    """A command that does not exist, or that is only accepted, has no effect and one fault."""
    rows: list[Row] = []
    tap = Tap("127.0.0.1:1", rows.append, False, lambda: 0.0)
    [command] = parse_line(line)
    tap.read(command, None)
    tap.obeyed(None, [])
    assert [(row.effect, len(row.faults)) for row in rows] == [("none", 1)]
