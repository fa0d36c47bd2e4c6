"""Writes `world.toml`, with names that MuJoCo and the wire can carry, made from those of maps."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence

from usarsim_server.simulation.frames import Pose, rpy_from_quaternion
from usarsim_server.worlds.description import Smoke

Entry = Mapping[str, object]
"""Keys and values of one table; None values are left out."""


_UNSAFE = re.compile(r"[^A-Za-z0-9_.+\-]+")

LONGEST = 120


def write_sheet(
    head: Entry, single: Mapping[str, Entry], lists: Mapping[str, Sequence[Entry]]
) -> str:
    """TOML text: keys at the top, tables `[name]`, lists of tables `[[name]]`."""
    blocks = ["# Made by `usarsim import`; import again rather than edit, or keep a sidecar file."]
    blocks.append("\n".join(_lines(head)))
    for name, entry in single.items():
        blocks.append("\n".join([f"[{name}]", *_lines(entry)]))
    for name, entries in lists.items():
        for entry in entries:
            blocks.append("\n".join([f"[[{name}]]", *_lines(entry)]))
    return "\n\n".join(blocks) + "\n"


def rotation(pose: Pose) -> dict[str, object]:
    """`yaw_degrees`, or `rotation_degrees` where a pose is not upright."""
    roll, pitch, yaw = (math.degrees(angle) for angle in rpy_from_quaternion(pose.quaternion))
    if abs(roll) < 1e-9 and abs(pitch) < 1e-9:
        return {"yaw_degrees": round(yaw, 9) + 0.0}
    return {"rotation_degrees": [round(angle, 9) + 0.0 for angle in (roll, pitch, yaw)]}


def smoke_tables(smoke: Smoke) -> list[Entry]:
    """`[[smoke]]` tables."""
    tables: list[Entry] = []
    for volume in smoke.volumes:
        _, _, yaw = rpy_from_quaternion(volume.pose.quaternion)
        tables.append(
            {
                "name": volume.name,
                "kind": "regional",
                "shape": volume.shape,
                "position": list(volume.pose.position),
                "yaw_degrees": math.degrees(yaw),
                "size": list(volume.size),
                "density": volume.density,
            }
        )
    for puff in smoke.puffs:
        tables.append(
            {
                "name": puff.name,
                "kind": "local",
                "position": list(puff.position),
                "size": list(puff.size),
                "particles": puff.particles,
                "radius": puff.radius,
                "seed": puff.seed,
                "lifetime": puff.lifetime,
            }
        )
    if smoke.haze:
        top = smoke.haze_top if math.isfinite(smoke.haze_top) else None
        tables.append({"name": "haze", "kind": "global", "density": smoke.haze, "top": top})
    return tables


def _lines(entry: Entry) -> Iterable[str]:
    for key, value in entry.items():
        if value is not None:
            yield f"{key} = {_value(value)}"


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # A JSON string is a TOML basic string, but for DEL, which JSON leaves as it is.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007F")
    if isinstance(value, float):
        text = repr(round(value, 9) + 0.0)
        return text if text not in ("inf", "-inf", "nan") else "0.0"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, Mapping):
        inner = ", ".join(
            f"{json.dumps(str(k))} = {_value(v)}" for k, v in value.items() if v is not None
        )
        return "{ " + inner + " }" if inner else "{}"
    if isinstance(value, Sequence):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    raise TypeError(f"{value!r} has no place in a world file")


def safe(name: str) -> str:
    """A name of letters, digits and `_ . + -` only; `unnamed` if nothing is left."""
    return _UNSAFE.sub("_", name.strip()).strip("_")[:LONGEST] or "unnamed"


class NameBook:
    """Hands out names that differ, whatever their capitals (worlds 69)."""

    def __init__(self, *reserved: str) -> None:
        self._taken = {name.lower() for name in reserved}
        self._next: dict[str, int] = {}

    def take(self, name: str) -> str:
        """The safe form of a name, with `-2`, `-3`, ... behind it where it is taken."""
        plain = safe(name)
        answer, number = plain, self._next.get(plain.lower(), 2)
        while answer.lower() in self._taken:
            answer = f"{plain}-{number}"
            number += 1
        self._next[plain.lower()] = number
        self._taken.add(answer.lower())
        return answer
