"""Parts of a robot file that move or hold: actuators with their links, effectors with fingers.

As in `parts.py`: the wire frame goes in, the simulation frame comes out, and what the file leaves
out is taken from the robot that it extends.

Cameras of a robot file; as in `parts.py` the wire frame goes in, the simulation frame out.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TypeVar

from usarsim_server.protocol.values import Dialect, Vector
from usarsim_server.robots.description import (
    ActuatorDescription,
    CameraDescription,
    EffectorDescription,
    ItemDescription,
    JointType,
    LinkDescription,
    RobotDescription,
    Shape,
)
from usarsim_server.robots.reading.parts import (
    FASTEST,
    HEAVIEST,
    LIGHTEST,
    LONGEST,
    RESERVED_NAMES,
    WORD,
    read_link,
    read_pose,
    read_shape,
)
from usarsim_server.robots.tables import TableReader, nearest
from usarsim_server.simulation.frames import flip_point

DEFAULT_SPEED = {Dialect.UT2004: 0.1745, Dialect.UDK: 1.571}
"""rad/s: MotorSpeed of mission joints in UT2004 (robots reference 1.6), announced in UDK (1.9)."""
DEFAULT_TORQUE = 20.0
"""N m: MotorTorque of UT2004 (robots reference 1.6)."""

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
"""Of links, joints and packages."""
_TYPES = {"revolute": JointType.REVOLUTE, "prismatic": JointType.PRISMATIC}

Parent = RobotDescription | None
Limb = TypeVar("Limb", ActuatorDescription, EffectorDescription)


def read_actuators(
    reader: TableReader,
    parent: Parent,
    dialect: Dialect,
    imported: tuple[ActuatorDescription, ...] = (),
) -> tuple[ActuatorDescription, ...]:
    """Actuators; one that bears the name of an inherited one replaces it.

    Args:
        reader: the file.
        parent: the robot that is extended.
        dialect: decides the speed of joints that say nothing else.
        imported: those of a model file, which take the place of inherited ones.
    """
    actuators = _inherited(reader, imported or (parent.actuators if parent else ()))
    for table in reader.tables("actuator"):
        links = [link.body for actuator in actuators for link in actuator.links]
        _enter(table, actuators, _actuator(table, links, dialect), "actuator")
    for actuator in actuators:
        _check_mount(reader, actuator.name, actuator.mount, actuators, "actuator")
    _check_leaders(reader, actuators)
    return tuple(actuators)


def read_effectors(
    reader: TableReader,
    parent: Parent,
    actuators: Sequence[ActuatorDescription],
    dialect: Dialect,
) -> tuple[EffectorDescription, ...]:
    """Effectors; one that bears the name of an inherited one replaces it."""
    effectors = _inherited(reader, parent.effectors if parent else ())
    links = [link.body for actuator in actuators for link in actuator.links]
    for table in reader.tables("effector"):
        _enter(table, effectors, _effector(table, links, dialect), "effector")
    for effector in effectors:
        _check_mount(reader, effector.name, effector.item.link, actuators, "effector")
    return tuple(effectors)


def _check_leaders(reader: TableReader, actuators: Sequence[ActuatorDescription]) -> None:
    """Refuse joints that follow what does not exist, or follows itself."""
    links = [link for actuator in actuators for link in actuator.links]
    free = [link.joint for link in links if link.follows is None]
    for link in links:
        if link.follows is not None and link.follows.lower() not in map(str.lower, free):
            problem = f"the joint {link.joint!r} follows {link.follows!r}, which is not free"
            reader.fail(problem, nearest(link.follows, free), "follows")


def check_names(reader: TableReader, bodies: Iterable[str]) -> None:
    """Refuse two bodies, wheels included, of one name."""
    seen: set[str] = set()
    for name in bodies:
        if name.lower() in seen:
            reader.fail(f"two parts are called {name!r}", "give every part its own name")
        seen.add(name.lower())


def _inherited(reader: TableReader, limbs: Sequence[Limb]) -> list[Limb]:
    dropped = {name.lower() for name in reader.texts("without")}
    return [limb for limb in limbs if limb.name.lower() not in dropped]


def _enter(table: TableReader, limbs: list[Limb], limb: Limb, kind: str) -> None:
    for index, other in enumerate(limbs):
        if other.name.lower() == limb.name.lower():
            limbs[index] = limb
            return
    limbs.append(limb)


def _check_mount(
    reader: TableReader,
    name: str,
    mount: str | None,
    actuators: Sequence[ActuatorDescription],
    kind: str,
) -> None:
    """What carries an inherited part may be gone, or come only after it."""
    for actuator in actuators:
        if kind == "actuator" and actuator.name == name:
            break
        if any(link.body == mount for link in actuator.links):
            return
    if mount is not None:
        reader.fail(
            f"the {kind} {name!r} sits on {mount!r}, which is gone",
            "keep the link's name, or drop it with without = [...]",
            kind,
        )


def _actuator(table: TableReader, links: Sequence[str], dialect: Dialect) -> ActuatorDescription:
    name = _name(table, table.text("name"))
    actuator = ActuatorDescription(
        name=name,
        mount=_mount(table, links),
        pose=read_pose(table),
        links=(),
        tip=_point(table, "tip"),
        package=table.boolean("package", True),
    )
    chain: list[LinkDescription] = []
    for number, part in enumerate(table.tables("link"), start=1):
        own = part.text("name", "")
        body, joint = (
            (_name(part, own), own) if own else (f"{name}_Link{number}", f"{name}_Joint{number}")
        )
        above = part.whole("parent", number - 1, low=0, high=number - 1)
        chain.append(_link(part, body, joint, above - 1 if above else None, dialect))
    if not chain:
        table.fail("is missing", "add an [[actuator.link]] table for each joint", "link")
    table.finish()
    return replace(actuator, links=tuple(chain))


def _link(
    table: TableReader, body: str, joint: str, parent: int | None, dialect: Dialect
) -> LinkDescription:
    limits = _limits(table)
    low, high = limits or (-math.inf, math.inf)
    link = LinkDescription(
        body=body,
        joint=joint,
        parent=parent,
        type=_TYPES[table.choice("joint", tuple(_TYPES), "revolute")],
        axis=_axis(table),
        pose=read_pose(table),
        shapes=_shapes(table),
        limits=limits,
        max_speed=table.number("max_speed", DEFAULT_SPEED[dialect], low=1e-3, high=FASTEST),
        max_torque=table.number("max_torque", DEFAULT_TORQUE, low=1e-3, high=1e6),
        damping=table.number("damping", 0.0, low=0.0, high=1e6),
        home=table.number("home", min(max(0.0, low), high), low=low, high=high),
        follows=table.text("follows", "") or None,
    )
    if link.mass < LIGHTEST:
        table.fail("all its pieces are weightless", "give a shape of it its mass", "shape")
    table.finish()
    return link


def _effector(table: TableReader, links: Sequence[str], dialect: Dialect) -> EffectorDescription:
    name = _name(table, table.text("name"))
    mount, pose = _mount(table, links), read_pose(table)
    fingers = []
    for number, part in enumerate(table.tables("finger"), start=1):
        if not part.has("limits"):
            part.fail("is missing", "add limits = [open, closed]", "limits")
        finger = _link(part, f"{name}_Finger{number}", f"{name}_FingerJoint{number}", None, dialect)
        assert finger.limits is not None
        fingers.append(finger if part.has("home") else replace(finger, home=finger.limits[0]))
    tip, shapes = _point(table, "tip"), _shapes(table)
    detached = table.boolean("detached", False)
    type_ = table.text("type")
    effector = EffectorDescription(
        ItemDescription(type_, name, mount, pose, table.rest(), table.place),
        shapes,
        tuple(fingers),
        tip,
        detached,
    )
    if detached and mount is not None:
        table.fail("lies loose, so nothing carries it", "leave out mount or detached", "mount")
    if detached and sum(shape.mass for shape in shapes) < LIGHTEST:
        table.fail("all its pieces are weightless", "give a shape of it its mass", "shape")
    return effector


def _name(table: TableReader, name: str) -> str:
    if not NAME.fullmatch(name) or name.lower() in RESERVED_NAMES:
        table.fail(
            f"is {name!r}", "use letters, digits and _, first a letter, not base or free", "name"
        )
    return name


def _mount(table: TableReader, links: Sequence[str]) -> str | None:
    mount = table.text("mount", "")
    known = {link.lower(): link for link in links}
    if mount and mount.lower() not in known:
        table.fail(f"no link {mount!r} before this", nearest(mount, links), "mount")
    return known[mount.lower()] if mount else None


def _limits(table: TableReader) -> tuple[float, float] | None:
    if not table.has("limits"):
        return None
    low, high = table.numbers("limits", (2,), low=-1e4, high=1e4)
    if low >= high:
        table.fail(f"are {low:g} and {high:g}", "write the lower one first", "limits")
    return low, high


def _axis(table: TableReader) -> Vector:
    axis = flip_point(table.vector("axis", (0.0, 0.0, 1.0), low=-LONGEST, high=LONGEST))
    length = math.hypot(*axis)
    if length < 1e-6:
        table.fail("has no direction", "write a vector such as [0, 0, 1]", "axis")
    x, y, z = (value / length + 0.0 for value in axis)
    return x, y, z


def _point(table: TableReader, key: str) -> Vector:
    return flip_point(table.vector(key, (0.0, 0.0, 0.0), low=-LONGEST, high=LONGEST))


def _shapes(table: TableReader) -> tuple[Shape, ...]:
    shapes = tuple(read_shape(part) for part in table.tables("shape"))
    if sum(shape.mass for shape in shapes) > HEAVIEST:
        table.fail("is too heavy", f"at most {HEAVIEST:g} kg", "shape")
    return shapes


NARROWEST = 0.01  # rad
WIDEST = 3.0  # rad; a flat picture of half a turn would have no end
RATES = (0.1, 60.0)  # Hz, as the server's own
SIZES = (16, 8192)  # pixels a side, as a tile's

_HINTS = {"interval": "write rate = pictures per second", "type": "leave it out"}


def read_cameras(
    reader: TableReader, links: Sequence[str], parent: RobotDescription | None
) -> tuple[CameraDescription, ...]:
    """Cameras in mount order; one that bears the name of an inherited one replaces it.

    Args:
        reader: the file.
        links: names of wheels and other links that may carry cameras.
        parent: the robot that is extended.
    """
    dropped = {name.lower() for name in reader.texts("without")}
    inherited = parent.cameras if parent else ()
    cameras = [camera for camera in inherited if camera.name.lower() not in dropped]
    for camera in cameras:
        if camera.link is not None and camera.link not in links:
            reader.fail(
                f"the inherited camera {camera.name!r} sits on {camera.link!r}, which is gone",
                "keep that name, or drop the camera with without = [...]",
                "camera",
            )
    own: set[str] = set()
    for table in reader.tables("camera"):
        camera = _camera(table, links)
        key = camera.name.lower()
        if key in own:
            table.fail(f"a second camera is called {camera.name!r}", "rename one of them", "name")
        own.add(key)
        for index, other in enumerate(cameras):
            if other.name.lower() == key:
                cameras[index] = camera
                break
        else:
            cameras.append(camera)
    return tuple(cameras)


def _camera(table: TableReader, links: Sequence[str]) -> CameraDescription:
    usual = CameraDescription(name="")
    if table.has("type"):
        table.choice("type", ("Camera",))
    name = table.text("name")
    if not WORD.fullmatch(name):
        table.fail(f"is {name!r}", "use one word without blanks and braces", "name")
    low = table.number("min_fov", usual.min_fov, low=NARROWEST, high=WIDEST)
    high = table.number("max_fov", max(low, usual.max_fov), low=low, high=WIDEST)
    camera = CameraDescription(
        name=name,
        link=read_link(table, links),
        pose=read_pose(table),
        fov=table.number("fov", min(max(usual.fov, low), high), low=low, high=high),
        min_fov=low,
        max_fov=high,
        rate=table.number("rate", low=RATES[0], high=RATES[1]) if table.has("rate") else None,
        where=table.place,
        size=_size(table),
    )
    table.finish(_HINTS)
    return camera


def _size(table: TableReader) -> tuple[int, int] | None:
    if not table.has("size"):
        return None
    width, height = table.numbers("size", (2,), low=SIZES[0], high=SIZES[1])
    if width != int(width) or height != int(height):
        table.fail(f"is {width:g} x {height:g}", "write whole numbers of pixels", "size")
    return int(width), int(height)
