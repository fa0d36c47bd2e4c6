"""MRESim's team file: one robot a line, 11 fields, the base first (exploration reference 3.3)."""

from __future__ import annotations

import math
from pathlib import Path

from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.scenario import Content
from usarsim_exploration.teams import MOST, NOBODY
from usarsim_server.base.errors import at
from usarsim_server.base.tables import suggest
from usarsim_server.base.toml import read_text

FIELDS = (
    "number", "name", "x", "y", "heading", "sensing range", "radio range", "battery", "role",
    "parent", "child",
)  # fmt: skip
SPEED, VIEW = 10.0, 180.0
"""Of all robots, cells per step and degrees; the file does not say them."""
_ROLES = {"BaseStation": "base", "Explorer": "explorer", "Relay": "relay"}
_WHOLE = ("number", "x", "y", "sensing range", "radio range", "battery", "parent", "child")


def read_team(path: Path) -> Content:
    """The tables `team` and `robot` of a scenario; batteries are left out, as MRESim uses none.

    Raises:
        ExplorationError: naming the line, what is wrong, and the cure.
    """
    rows = [
        _row(path, line, text.split())
        for line, text in enumerate(read_text(path, ExplorationError).splitlines(), 1)
        if text.strip()
    ]
    if len(rows) < 2:
        raise ExplorationError(at(path, f"{len(rows)} robots are no team", "write one a line"))
    if len(rows) > MOST + 1:
        raise ExplorationError(at(path, f"{len(rows)} robots are too many", f"at most {MOST}"))
    names = ["Base", *(str(row["name"]) for row in rows[1:])]

    def name(number: object, default: int) -> str:
        index = int(str(number))
        return names[index - 1 if 1 <= index <= len(names) else default]

    base = rows[0]
    return {
        "team": {"base": [base["x"], base["y"]], "base_radio": float(str(base["radio range"]))},
        "robot": [
            {
                "name": row["name"],
                "start": [row["x"], row["y"]],
                "heading": _degrees(float(str(row["heading"]))),
                "role": _ROLES[str(row["role"])],
                "parent": name(row["parent"], 0),
                "child": name(row["child"], 0) if int(str(row["child"])) > 1 else NOBODY,
                "speed": SPEED,
                "reach": row["sensing range"],
                "view": VIEW,
                "radio": float(str(row["radio range"])),
            }
            for row in rows[1:]
        ],
    }


def is_team(path: Path) -> bool:
    """Whether a file looks like one."""
    lines = [line.split() for line in read_text(path, ExplorationError).splitlines()]
    first = next((line for line in lines if line), [])
    return bool(first) and first[0].isdigit() and len(first) > 5


def _row(path: Path, line: int, values: list[str]) -> dict[str, object]:
    """The fields of a robot."""

    def wrong(problem: str, cure: str) -> ExplorationError:
        return ExplorationError(at(path, problem, cure, where=f"line {line}"))

    if len(values) != len(FIELDS):
        raise wrong(f"{len(values)} fields", f"write {len(FIELDS)}: {', '.join(FIELDS)}")
    row: dict[str, object] = dict(zip(FIELDS, values, strict=True))
    for key in _WHOLE:
        text = str(row[key])
        if not text.lstrip("-").isdecimal() or len(text) > 9:
            raise wrong(f"{key} {text!r} is no whole number", "write one")
        row[key] = int(text)
    try:
        finite = math.isfinite(float(str(row["heading"])))
    except ValueError:
        finite = False
    if not finite:
        raise wrong(f"heading {row['heading']!r} is no number", "write radians")
    if row["number"] != line:
        raise wrong(f"robot {row['number']} stands at place {line}", "number robots from 1 on")
    if row["role"] not in _ROLES:
        raise wrong(f"role {row['role']!r} is not known", suggest(str(row["role"]), list(_ROLES)))
    if (row["role"] == "BaseStation") is not (line == 1):
        cure = "make robot 1, and no other, the BaseStation"
        raise wrong(f"robot {line} is {row['role']}", cure)
    return row


def _degrees(radians: float) -> float:
    """Within a turn, as scenarios write it."""
    return round(math.degrees(math.remainder(radians, 2 * math.pi)), 9)
