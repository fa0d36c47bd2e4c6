"""Colours after names: what Wood_16 looks like when its picture is not there.

Maps of Unreal name the materials of their surfaces and hold no pictures of them. Where those are
missing a floor of wood and a wall of concrete should still not be one grey: cameras, and who drives
by them, tell rooms apart by that.
"""

from __future__ import annotations

import re

from usarsim_maps.scene import Color

_STUFF: tuple[tuple[str, tuple[float, float, float]], ...] = (
    ("wood plank parquet timber", (0.52, 0.38, 0.25)),
    ("brick", (0.58, 0.36, 0.28)),
    ("conc concrete cement", (0.56, 0.56, 0.54)),
    ("slate", (0.36, 0.39, 0.43)),
    ("marble", (0.80, 0.78, 0.74)),
    ("asphalt tarmac", (0.28, 0.28, 0.29)),
    ("tile tiles", (0.70, 0.66, 0.58)),
    ("gold", (0.68, 0.56, 0.30)),
    ("rust rusty", (0.46, 0.30, 0.21)),
    ("metal steel wire wires chainlink", (0.48, 0.51, 0.55)),
    ("grass turf lawn", (0.28, 0.45, 0.22)),
    ("carpet fabric cloth cubicle", (0.42, 0.46, 0.53)),
    ("sand", (0.74, 0.66, 0.48)),
    ("dirt mud soil", (0.42, 0.33, 0.24)),
    ("rock stone gravel rubble", (0.50, 0.48, 0.45)),
    ("water", (0.25, 0.38, 0.45)),
    ("plaster stucco", (0.76, 0.73, 0.67)),
    ("white", (0.88, 0.88, 0.86)),
    ("black", (0.10, 0.10, 0.10)),
    ("red", (0.66, 0.18, 0.15)),
    ("green", (0.22, 0.50, 0.25)),
    ("blue", (0.18, 0.32, 0.62)),
    ("yellow", (0.82, 0.70, 0.20)),
    ("ceiling roof", (0.80, 0.80, 0.78)),
    ("wall walls", (0.74, 0.70, 0.61)),
    ("floor ground", (0.47, 0.44, 0.40)),
)
"""Words and colours (red, green, blue as on screens); what things are made of comes before where
they are, so that a wall of brick is brick."""

_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+")

LONG = 4
"""Letters from which on a word may be the beginning or end of one in the name (`concwall`)."""


def likely_color(name: str) -> Color | None:
    """The colour that a material probably has.

    Args:
        name: `Package.Group.Name`; only the last part counts.

    Returns:
        None if the name says nothing.
    """
    words = [word.lower() for word in _WORD.findall(name.rpartition(".")[2])]
    for stuff, color in _STUFF:
        if any(_fits(word, key) for key in stuff.split() for word in words):
            return (*color, 1.0)
    return None


def _fits(word: str, key: str) -> bool:
    return word == key or (len(key) >= LONG and (word.startswith(key) or word.endswith(key)))
