"""Helpers of this room's tests: small world folders on disk."""

from __future__ import annotations

import re
from pathlib import Path

SCENE = """<mujoco model="yard">
  <worldbody>
    <light type="directional" dir="0 0 -1"/>
    <geom name="floor" type="plane" size="0 0 1"/>
    <body name="crate" pos="2 0 0.2">
      <freejoint/>
      <geom type="box" size="0.2 0.2 0.2" mass="2"/>
    </body>
  </worldbody>
</mujoco>
"""

HEAD = 'title = "Yard"\n'
START = '[[start]]\ntag = "A"\nposition = [0.0, 0.0, 0.25]\n'
VICTIM = '[[victim]]\nname = "V"\nposition = [1.0, 2.0, 0.12]\nposture = "lying"\n'


def write_world(
    directory: Path, sheet: str = HEAD + START, scene: str = SCENE, name: str = "yard"
) -> Path:
    """Write a world folder and return it."""
    folder = directory / name
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "world.toml").write_text(sheet, encoding="utf-8")
    (folder / "scene.xml").write_text(scene, encoding="utf-8")
    return folder


def nameless(error: BaseException) -> str:
    """What an error says, without the names that stand beside the numbers of tables."""
    return re.sub(r"(\]\] \d+) \([^)]*\)", r"\1", str(error))
