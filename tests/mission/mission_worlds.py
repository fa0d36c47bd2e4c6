"""A small world for scenarios: two rooms of 6 x 6 m with a door of 1.2 m between them."""

from __future__ import annotations

from pathlib import Path

SCENE = """<mujoco>
  <worldbody>
    <geom type="plane" size="0 0 1" rgba="0.5 0.5 0.5 1" friction="1"/>
    <geom type="box" pos="0 1.8 0.5" size="0.05 1.2 0.5" rgba="0.8 0.8 0.8 1"/>
    <geom type="box" pos="0 -1.8 0.5" size="0.05 1.2 0.5" rgba="0.8 0.8 0.8 1"/>
    <geom type="box" pos="0 3.05 0.5" size="6.1 0.05 0.5" rgba="0.8 0.8 0.8 1"/>
    <geom type="box" pos="0 -3.05 0.5" size="6.1 0.05 0.5" rgba="0.8 0.8 0.8 1"/>
    <geom type="box" pos="6.05 0 0.5" size="0.05 3.1 0.5" rgba="0.8 0.8 0.8 1"/>
    <geom type="box" pos="-6.05 0 0.5" size="0.05 3.1 0.5" rgba="0.8 0.8 0.8 1"/>
    <geom type="box" pos="4.5 2.5 0.5" size="0.05 0.5 0.5" rgba="0.8 0.8 0.8 1"/>
    <geom type="box" pos="5.25 2.0 0.5" size="0.8 0.05 0.5" rgba="0.8 0.8 0.8 1"/>
  </worldbody>
</mujoco>
"""
WORLD = """
title = "Two rooms"
[bounds]
lower = [-6, -3, -1]
upper = [6, 3, 3]
[[start]]
tag = "West"
position = [-5, 0, 0.25]
[[start]]
tag = "North"
position = [-5, 1.5, 0.25]
[[start]]
tag = "Hidden"
position = [0, 2, 0.25]
[[victim]]
name = "Old"
position = [-3, -2, 0.12]
posture = "lying"
[[zone]]
name = "all"
kind = "flat"
x = [-6, 6]
y = [-3, 3]
"""
MISSION = """schema = "usar-mission/1"
title = "Two rooms"
world = "./rooms"
scoring = "rsarsim"
"""
ROBOT = '[[robot]]\nname = "R1"\nclass = "P3AT_real"\nstart = "West"\n'
VICTIM = '[[victim]]\nname = "Ann"\nposition = [3.0, -2.0, 0.12]\n'
ZONES = """[[zone]]
name = "west"
colour = "orange"
x = [-6, 0]
y = [-3, 3]
[[zone]]
name = "east"
colour = "yellow"
polygon = [[0, -3], [6, -3], [6, 3], [0, 3]]
"""


def write_mission(folder: Path, *parts: str, head: str = MISSION) -> Path:
    """Write the world and a scenario in it; returns the scenario's file."""
    rooms = folder / "rooms"
    rooms.mkdir(parents=True, exist_ok=True)
    (rooms / "scene.xml").write_text(SCENE)
    (rooms / "world.toml").write_text(WORLD)
    path = folder / "test-mission.toml"
    path.write_text(head + "".join(parts))
    return path
