"""Glass: what infrared light goes through, judged by names.

The original let infrared sensors look through materials with "Trans" in their names (robots
reference 2.2). Here whole words of a name count, so `WindowTrans_01` and `glass_door` are glass,
`transport_box` and `hourglass` are not; a material may also end with one in one word, as imported
maps have `framelessglass`.
"""

from __future__ import annotations

import re

import mujoco

__all__ = ["is_glass", "words_of"]

WORDS = frozenset({"glass", "trans", "transparent", "translucent"})
ENDS = ("glass", "trans")
OPAQUE = frozenset({"fiberglass", "fibreglass", "hourglass"})

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")


def words_of(name: str) -> list[str]:
    """The words of a name in lower case: parted by capitals, digits and everything else."""
    return [word.lower() for word in _WORD.findall(name)]


def is_glass(model: mujoco.MjModel, geom: int) -> bool:
    """Whether a geom is made of glass by its name or by that of its material."""
    if not WORDS.isdisjoint(words_of(model.geom(geom).name)):
        return True
    material = int(model.geom_matid[geom])
    if material < 0:
        return False
    words = words_of(model.mat(material).name)
    return any(word in WORDS or (word.endswith(ENDS) and word not in OPAQUE) for word in words)
