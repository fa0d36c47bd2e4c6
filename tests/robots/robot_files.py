"""Small robot files for tests, and what lines say."""

from __future__ import annotations

import copy
import json
import math
import re
from pathlib import Path
from typing import Any

SHAPE: dict[str, Any] = {"kind": "box", "size": [0.4, 0.2, 0.1], "mass": 5.0}
LEFT: dict[str, Any] = {
    "name": "LeftWheel",
    "position": [0.0, -0.15, 0.05],
    "radius": 0.1,
    "width": 0.04,
    "mass": 0.5,
}
RIGHT: dict[str, Any] = {**LEFT, "name": "RightWheel", "position": [0.0, 0.15, 0.05]}
CASTER: dict[str, Any] = {"position": [-0.15, 0.0, 0.12], "radius": 0.03, "mass": 0.2}
SENSOR: dict[str, Any] = {"type": "Sonar", "name": "F1", "position": [0.2, 0.0, -0.1]}
PIECE: dict[str, Any] = {"kind": "box", "size": [0.1, 0.02, 0.02], "mass": 0.2}
LINK: dict[str, Any] = {"shape": [PIECE]}
ARM: dict[str, Any] = {
    "name": "Arm",
    "position": [0.1, 0.0, -0.1],
    "link": [
        {**LINK, "axis": [0, 0, -1], "limits": [-1.0, 2.0]},
        {**LINK, "position": [0.0, 0.0, -0.1], "axis": [0, 2, 0], "home": 0.5},
    ],
}


def table(**changes: Any) -> dict[str, Any]:
    """The table of a small differential robot; a change to None drops the key."""
    robot: dict[str, Any] = {
        "description": "a small test robot",
        "kind": "differential",
        "dialect": "ut2004",
        "shape": [SHAPE],
        "wheel": [LEFT, RIGHT],
        "caster": [CASTER],
        "sensor": [SENSOR],
        "drive": {"max_wheel_speed": 5.0},
    }
    robot.update(changes)
    return copy.deepcopy({key: value for key, value in robot.items() if value is not None})


def write(folder: Path, name: str, robot: dict[str, Any]) -> Path:
    """Write a table as the robot file of a class."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.toml"
    text = "".join(f"{key(name)} = {value(entry)}\n" for name, entry in robot.items())
    path.write_text(text, encoding="utf-8")
    return path


def key(name: str) -> str:
    """A quoted TOML key."""
    return json.dumps(name, ensure_ascii=False)


def value(entry: Any) -> str:
    """A TOML value on one line."""
    match entry:
        case bool():
            return "true" if entry else "false"
        case float() if not math.isfinite(entry):
            return "nan" if math.isnan(entry) else ("inf" if entry > 0 else "-inf")
        case int() | float():
            return repr(entry)
        case str():
            return json.dumps(entry, ensure_ascii=False)
        case list() | tuple():
            return "[" + ", ".join(value(item) for item in entry) + "]"
        case dict():
            pairs = ", ".join(f"{key(name)} = {value(item)}" for name, item in entry.items())
            return "{" + pairs + "}"
    raise TypeError(f"no TOML for {entry!r}")


DIALECTS = ("ut2004", "udk")


def kind(line: str) -> str:
    """Value of the first Type segment, empty if there is none."""
    found = re.search(r"\{Type (\w+)\}", line)
    return found.group(1) if found is not None else ""


def values(line: str, key: str) -> list[str]:
    """Values of a key, of segments of their own or inside a multi-pair segment."""
    return re.findall(rf"[{{ ]{key} ([^{{}} ]*)", line)


def number(line: str, key: str) -> float:
    """A number of a line."""
    found = re.search(rf"\{{{key} ([^}}]*)\}}", line)
    assert found is not None, (key, line)
    return float(found[1])
