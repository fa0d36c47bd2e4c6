"""`usarsim watch`: what it prints of the messages of a scene port."""

from __future__ import annotations

import argparse
import json
from typing import Any

import pytest

from usarsim_operator.watch import shown
from usarsim_server.cli import main

ROWS: list[dict[str, Any]] = [
    {
        "time": 3.092,
        "session": "127.0.0.1:50122",
        "robot": "R1",
        "in": "DRIVE {Left abc}",
        "reading": "Drive(left=0.0)",
        "effect": "carried out",
        "faults": ["Left: `abc` is not a number, read as 0"],
    },
    {"time": 3.1, "session": "127.0.0.1:50122", "robot": "R1", "out": "CONF {Type Camera}"},
    {
        "time": 3.2,
        "session": "127.0.0.1:50123",
        "robot": None,
        "in": "GETSTARTPOSES",
        "reading": "GetStartPoses()",
        "effect": "answered by 1 line",
        "faults": [],
    },
]


def printed(news: dict[str, Any], colour: bool = False, **wanted: Any) -> list[str]:
    """What is printed."""
    arguments = argparse.Namespace(**{"robot": None, "faults_only": False, "json": False, **wanted})
    return list(shown(news, arguments, colour))


def test_rows_in_words() -> None:
    """A command, its reading, its faults; what was told; what was lost."""
    lines = printed({"type": "lines", "rows": ROWS, "lost": 3})
    assert lines == [
        "... 3 rows were lost",
        "     3.09 R1 > DRIVE {Left abc}",
        "          Drive(left=0.0): carried out",
        "          ! Left: `abc` is not a number, read as 0",
        "     3.10 R1 < CONF {Type Camera}",
        "     3.20 127.0.0.1:50123 > GETSTARTPOSES",
        "          GetStartPoses(): answered by 1 line",
    ]


def test_what_is_wanted() -> None:
    """One robot, faults only, JSON, and others' messages not at all."""
    news = {"type": "lines", "rows": ROWS}
    assert len(printed(news, robot="r1")) == 4
    assert len(printed(news, faults_only=True)) == 3
    assert [json.loads(line) for line in printed(news, json=True)] == ROWS
    assert printed({"type": "present"}) == []
    taken = {"type": "intervention", "action": "taken", "time": 1.0, "robot": "R1", "by": "Ada"}
    assert printed(taken) == ["     1.00 R1 === taken by Ada"]


def test_a_client_cannot_command_a_terminal() -> None:
    """Control characters are not printed; colours come from us alone."""
    row = {**ROWS[0], "in": "\x1b[2J\r\nevil"}
    for line in printed({"type": "lines", "rows": [row]}):
        assert line.isprintable()
    coloured = printed({"type": "lines", "rows": [row]}, colour=True)
    assert "\x1b[36m" in coloured[0]
    assert "\x1b[2J" not in coloured[0]


def test_nobody_there(capsys: pytest.CaptureFixture[str]) -> None:
    """One error with a cure, exit code 2."""
    assert main(["watch", "127.0.0.1:1"]) == 2
    assert "--scene-port" in capsys.readouterr().err
