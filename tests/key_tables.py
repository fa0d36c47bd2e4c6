"""The tables of keys in `docs/`, written from the declarations of the fields.

Run `python tests/key_tables.py` after a change of a declaration.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from usarsim_exploration import measures as exploration
from usarsim_server.base.fields import Key, keys, markdown
from usarsim_server.sensors.base import TYPES, Sensor, sensor_types
from usarsim_study import measures

PAGES = sorted((Path(__file__).parents[1] / "docs").glob("*.md"))
MARKED = re.compile(r"(<!-- keys of ([^>]+) -->\n).*?(<!-- end of keys -->\n)", re.DOTALL)
ALL_SENSORS, ALL_MEASURES = "all sensors", "all measures"
EXPLORATION = "all measures of exploration"
"""Stand where the names of classes stand elsewhere."""


def rewritten(text: str) -> str:
    """A page with the tables that follow from the declarations."""

    def table(found: re.Match[str]) -> str:
        if found[2] == ALL_SENSORS:
            return f"{found[1]}\n{sensor_table()}\n{found[3]}"
        if found[2] == ALL_MEASURES:
            return f"{found[1]}\n{measures.markdown()}\n{found[3]}"
        if found[2] == EXPLORATION:
            return f"{found[1]}\n{exploration.markdown()}\n{found[3]}"
        classes = []
        for name in found[2].split(", "):
            module, _, cls = name.rpartition(".")
            classes.append(getattr(importlib.import_module(module), cls))
        return f"{found[1]}\n{markdown(*classes)}\n{found[3]}"

    return MARKED.sub(table, text)


def sensor_table() -> str:
    """The keys of every type, without those that it has from another one."""
    names: dict[type[Sensor], list[str]] = {Sensor: ["every sensor"]}
    for name in sensor_types():
        cls = TYPES.find(name, "")
        if cls.__module__.startswith(Sensor.__module__.rpartition(".")[0]):  # not one of a test's
            for base in reversed(cls.__mro__):
                if issubclass(base, Sensor):
                    names.setdefault(base, [])
            names[cls].append(f"`{name}`")
    labels = {cls: ", ".join(one) or cls.__name__.removeprefix("_") for cls, one in names.items()}
    rows = ["| Type | Key | Value | Default | Meaning |", "|---|---|---|---|---|"]
    for cls, label in labels.items():
        above = (one for one in cls.__mro__[1:] if one in labels and any(own_keys(one)))
        beside = next((labels[one] for one in above if one is not Sensor), "")
        title = f"{label}; also the keys of {beside}" if beside else label
        for key in own_keys(cls):
            rows.append(
                f"| {title} | `{key.key}` | {key.wanted} | {key.default_text} | {key.help} |"
            )
            title = ""
    return "\n".join(rows) + "\n"


def own_keys(cls: type) -> Iterator[Key]:
    """The keys that a class declares, and those whose default it changes."""
    for key in keys(cls) if issubclass(cls, Sensor) else ():
        if key.name in vars(cls):
            value = vars(cls)[key.name]
            yield replace(key, default=lambda value=value: value)
        elif key.name in cls.__annotations__:
            yield key


if __name__ == "__main__":
    for page in PAGES:
        page.write_text(rewritten(page.read_text(encoding="utf-8")), encoding="utf-8")
