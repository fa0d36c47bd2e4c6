"""The ground on which lines are hashed: a small world, and a robot class with every sensor.

Two places, `APART` metres from each other, hold the same things, so that the robots of one class
stand before the same view in both dialects and never meet.
"""

from __future__ import annotations

from pathlib import Path

APART = 60.0
"""m from one place to the other, to the left in the simulation frame."""

EVERY_SENSOR = "EverySensor"
"""Class that has one sensor of each of `SENSOR_TYPES`."""

_WORDS = """
    3DRangeScanner Accel Acceleration Accelerometer Acoustic AcousticArraySensor AltitudeSensor
    Battery BumperArray CO2Sensor Encoder ExampleSonarArray GPS GroundTruth GroundTruthMovable
    Helper Hokuyo HumanMotion IMU INS INU IR IRScanner KinectDepth LineLaser MagneticCompass
    MissionTime ObjectSensor Odometry RangeScanner RangeScanner3D RangeSensor RangeSensorArray
    RFIDReader RFIDReleaser RFIDTag RotatingPointCloudScanner SICK Sonar Sound Tachometer Touch
    VictRFID VictSensor
"""
SENSOR_TYPES = tuple(_WORDS.split())
"""Types that a robot file may name."""
NEEDS = {
    "BumperArray": "position = [0.29, 0, 0.04]",
    "Encoder": 'wheel = "LeftFWheel"',
    "ExampleSonarArray": "position = [0.1, 0, -0.5]",
    "RangeScanner": "fov = 4.7124\nresolution = 0.0175\ninterval = 0.1",
    "Touch": "position = [0.283, 0, 0.0393]",
}
"""What some of them need beside a name and the usual place."""

_PLACE = """
    <geom name="ahead{0}" type="box" pos="8 {1} 1" size="0.1 6 1" material="brick"/>
    <geom name="left{0}" type="box" pos="2 {3} 0.5" size="6 0.1 0.5" material="concrete"/>
    <geom name="glass_pane{0}" type="box" pos="3 {2} 0.6" size="1 0.02 0.6" material="glass"/>
    <geom name="post{0}" type="cylinder" pos="-2 {4} 1" size="0.15 1" material="wood"/>
    <geom name="step{0}" type="box" pos="2.5 {1} 0.02" size="0.3 1.5 0.02" material="concrete"/>
    <body name="crate{0}" pos="4.5 {5} 0.15">
      <freejoint name="crate{0}"/>
      <geom type="box" size="0.15 0.15 0.15" mass="2" material="wood"/>
    </body>"""

_SCENE = """<mujoco model="yard">
  <asset>
    <material name="brick" rgba="0.6 0.3 0.2 1"/>
    <material name="concrete" rgba="0.6 0.6 0.6 1"/>
    <material name="glass" rgba="0.7 0.8 0.9 0.3"/>
    <material name="wood" rgba="0.5 0.4 0.2 1"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" friction="1" material="concrete"/>{places}
  </worldbody>
</mujoco>
"""

_FACTS = """title = "Yard"
level = "yard"
time_limit = 20
north_degrees = 30

[bounds]
lower = [-100.0, -100.0, -2.0]
upper = [100.0, 160.0, 50.0]
"""

_PLACE_FACTS = """
[[start]]
tag = "Place{0}"
position = [0.0, {1}, 0.25]
yaw_degrees = 0.0

[[victim]]
name = "MaleVictim_{0}"
position = [4.0, {2}, 0.93]
yaw_degrees = 150.0
posture = "standing"
properties = {{ figure = "male", co2 = 0.05, sound = true, rfid = true, motion = "wave" }}

[[victim]]
name = "FemaleVictim_{0}"
position = [6.0, {3}, 0.12]
yaw_degrees = 40.0
posture = "lying"
status = "Unconscious"
properties = {{ figure = "female" }}

[[rfid]]
id = 1{0}1
position = [1.0, {4}, 0.01]
memory = "gate"

[[rfid]]
id = 1{0}2
position = [1.5, {5}, 0.01]
single_shot = true

[[sound]]
position = [6.0, {1}, 1.0]
loudness = 62.0
period = 2.0

[[false_alarm]]
part = "Chest"
lower = [2.0, {6}, 0.0]
upper = [2.6, {3}, 1.0]

[[smoke]]
name = "haze{0}"
kind = "regional"
position = [6.0, {7}, 1.0]
size = [2.0, 2.0, 2.0]
density = 0.4

[[smoke]]
name = "fire{0}"
kind = "local"
position = [-3.0, {4}, 1.0]
size = [0.8, 0.8, 2.0]
lifetime = 4.0

[[surface]]
name = "mud{0}"
kind = "mud"
x = [1.0, 2.0]
y = [{8}, {9}]

[[path_node]]
tag = "Near{0}"
position = [1.0, {3}, 0.0]
neighbours = ["Far{0}"]

[[path_node]]
tag = "Far{0}"
position = [5.0, {3}, 0.0]

[[belt]]
name = "belt{0}"
tag = "line"
position = [-4.0, {1}, 0.3]
size = [2.0, 0.6, 0.1]
speed = 0.3

[[obstacle]]
name = "cart{0}"
size = [0.5, 0.4, 0.4]
points = [[-3.0, {3}, 0.0], [-6.0, {3}, 0.0]]
"""


def write_yard(folder: Path) -> Path:
    """Write the world into a new folder `yard` there; returns its path."""
    world = folder / "yard"
    world.mkdir()
    places, facts = "", _FACTS
    for number, middle in enumerate((0.0, APART)):
        places += _PLACE.format(
            number, middle, middle - 1.8, middle + 5.0, middle + 2.0, middle + 0.3
        )
        sides = [middle + side for side in (0.0, 1.6, 3.0, 0.4, -0.6, 2.0, -3.0, -1.5, 1.5)]
        facts += _PLACE_FACTS.format(number, *sides)
    (world / "scene.xml").write_text(_SCENE.format(places=places), encoding="utf-8")
    (world / "world.toml").write_text(facts, encoding="utf-8")
    return world


def write_robots(folder: Path) -> Path:
    """Write the file of the class `EVERY_SENSOR` into a new folder `robots` there."""
    robots = folder / "robots"
    robots.mkdir()
    text = f'name = "{EVERY_SENSOR}"\ndescription = "every sensor"\nextends = "P2AT"\n'
    for kind in SENSOR_TYPES:
        more = NEEDS.get(kind, "")
        place = "" if "position" in more else "position = [0.2, 0, -0.3]\n"
        text += f'\n[[sensor]]\ntype = "{kind}"\nname = "My{kind}"\n{place}{more}\n'
    (robots / f"{EVERY_SENSOR}.toml").write_text(text, encoding="utf-8")
    return robots
