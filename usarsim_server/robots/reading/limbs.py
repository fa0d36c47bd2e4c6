"""Parts of a robot file that move, hold or look: actuators with their links, effectors, cameras.

As in `parts.py`: the wire frame goes in, the simulation frame comes out, and what the file leaves
out is taken from the robot that it extends.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TypeVar

from usarsim_server.base.tables import Table, suggest
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import (
    ActuatorDescription,
    CameraDescription,
    EffectorDescription,
    ItemDescription,
    LinkDescription,
    RobotDescription,
    Shape,
)
from usarsim_server.robots.keys import (
    FASTEST,
    HEAVIEST,
    LIGHTEST,
    WORD,
    part_name,
    read_link,
    read_pose,
)
from usarsim_server.robots.reading.parts import read_shape

DEFAULT_SPEED = {Dialect.UT2004: 0.1745, Dialect.UDK: 1.571}
"""rad/s: MotorSpeed of mission joints in UT2004 (robots reference 1.6), announced in UDK
(robots 1.9)."""
Parent = RobotDescription | None
Limb = TypeVar("Limb", ActuatorDescription, EffectorDescription, CameraDescription)


def read_actuators(
    reader: Table,
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
        _enter(actuators, _actuator(table, links, dialect))
    for actuator in actuators:
        _check_mount(reader, actuator.name, actuator.mount, actuators, "actuator")
    _check_leaders(reader, actuators)
    return tuple(actuators)


def read_effectors(
    reader: Table,
    parent: Parent,
    actuators: Sequence[ActuatorDescription],
    dialect: Dialect,
) -> tuple[EffectorDescription, ...]:
    """Effectors; one that bears the name of an inherited one replaces it."""
    effectors = _inherited(reader, parent.effectors if parent else ())
    links = [link.body for actuator in actuators for link in actuator.links]
    for table in reader.tables("effector"):
        _enter(effectors, _effector(table, links, dialect))
    for effector in effectors:
        _check_mount(reader, effector.name, effector.item.link, actuators, "effector")
    return tuple(effectors)


def _check_leaders(reader: Table, actuators: Sequence[ActuatorDescription]) -> None:
    """Refuse joints that follow what does not exist, or follows itself.

    Of those with a coupling, which may be in a chain, the model file has seen to the latter.
    """
    links = [link for actuator in actuators for link in actuator.links]
    free = [link.joint for link in links if link.follows is None]
    known = [link.joint.lower() for link in links]
    for link in links:
        leaders = list(map(str.lower, free)) if link.coupling is None else known
        if link.follows is not None and link.follows.lower() not in leaders:
            problem = f"the joint {link.joint!r} follows {link.follows!r}, which is not free"
            raise reader.error("follows", problem, suggest(link.follows, free))


def check_names(reader: Table, bodies: Iterable[str]) -> None:
    """Refuse two bodies, wheels included, of one name."""
    seen: set[str] = set()
    for name in bodies:
        if name.lower() in seen:
            raise reader.error("", f"two parts are called {name!r}", "give every part its own name")
        seen.add(name.lower())


def _inherited(reader: Table, limbs: Sequence[Limb]) -> list[Limb]:
    dropped = {name.lower() for name in reader.texts("without")}
    return [limb for limb in limbs if limb.name.lower() not in dropped]


def _enter(limbs: list[Limb], limb: Limb) -> None:
    for index, other in enumerate(limbs):
        if other.name.lower() == limb.name.lower():
            limbs[index] = limb
            return
    limbs.append(limb)


def _check_mount(
    reader: Table,
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
        raise reader.error(
            kind,
            f"the {kind} {name!r} sits on {mount!r}, which is gone",
            "keep the link's name, or drop it with without = [...]",
        )


def _actuator(table: Table, links: Sequence[str], dialect: Dialect) -> ActuatorDescription:
    name = part_name(table)
    actuator = table.read(
        ActuatorDescription, name=name, mount=_mount(table, links), pose=read_pose(table), links=()
    )
    chain: list[LinkDescription] = []
    for number, part in enumerate(table.tables("link"), start=1):
        body, joint = f"{name}_Link{number}", f"{name}_Joint{number}"
        if part.text("name", ""):
            body = joint = part_name(part)
        above = part.count("parent", number - 1, low=0, high=number - 1)
        chain.append(_link(part, body, joint, above - 1 if above else None, dialect))
    if not chain:
        raise table.error("link", "is missing", "add an [[actuator.link]] table for each joint")
    table.finish()
    return replace(actuator, links=tuple(chain))


def _link(
    table: Table, body: str, joint: str, parent: int | None, dialect: Dialect
) -> LinkDescription:
    limits = read_limits(table)
    low, high = limits or (-math.inf, math.inf)
    link = table.read(
        LinkDescription,
        body=body,
        joint=joint,
        parent=parent,
        pose=read_pose(table),
        shapes=_shapes(table),
        limits=limits,
        max_speed=table.number("max_speed", DEFAULT_SPEED[dialect], low=1e-3, high=FASTEST),
        home=table.number("home", min(max(0.0, low), high), low=low, high=high),
    )
    if link.mass < LIGHTEST:
        raise table.error("shape", "all its pieces are weightless", "give a shape of it its mass")
    table.finish()
    return link


def _effector(table: Table, links: Sequence[str], dialect: Dialect) -> EffectorDescription:
    name = part_name(table)
    mount, pose = _mount(table, links), read_pose(table)
    fingers = []
    for number, part in enumerate(table.tables("finger"), start=1):
        if not part.has("limits"):
            raise part.error("limits", "is missing", "add limits = [open, closed]")
        finger = _link(part, f"{name}_Finger{number}", f"{name}_FingerJoint{number}", None, dialect)
        assert finger.limits is not None
        fingers.append(finger if part.has("home") else replace(finger, home=finger.limits[0]))
    type_, shapes = table.text("type"), _shapes(table)
    effector = table.read(
        EffectorDescription,
        item=ItemDescription(type_, name, mount, pose),
        shapes=shapes,
        fingers=tuple(fingers),
    )
    # What is left belongs to the type of the effector.
    item = replace(effector.item, parameters=table.rest(), where=table.place)
    effector, detached = replace(effector, item=item), effector.detached
    if detached and mount is not None:
        raise table.error(
            "mount", "lies loose, so nothing carries it", "leave out mount or detached"
        )
    if detached and sum(shape.mass for shape in shapes) < LIGHTEST:
        raise table.error("shape", "all its pieces are weightless", "give a shape of it its mass")
    return effector


def _mount(table: Table, links: Sequence[str]) -> str | None:
    mount = table.text("mount", "")
    known = {link.lower(): link for link in links}
    if mount and mount.lower() not in known:
        raise table.error("mount", f"no link {mount!r} before this", suggest(mount, links))
    return known[mount.lower()] if mount else None


def read_limits(
    table: Table, default: tuple[float, float] | None = None
) -> tuple[float, float] | None:
    """Lowest and highest position of a joint, rad or m."""
    if not table.has("limits"):
        return default
    low, high = table.numbers("limits", (2,), low=-FASTEST, high=FASTEST)
    if low >= high:
        raise table.error("limits", f"are {low:g} and {high:g}", "write the lower one first")
    return low, high


def _shapes(table: Table) -> tuple[Shape, ...]:
    shapes = tuple(read_shape(part) for part in table.tables("shape"))
    if sum(shape.mass for shape in shapes) > HEAVIEST:
        raise table.error("shape", "is too heavy", f"at most {HEAVIEST:g} kg")
    return shapes


NARROWEST = 0.01  # rad
WIDEST = 3.0  # rad; a flat picture of half a turn would have no end
SIZES = (16, 8192)  # pixels a side, as a tile's

MOST_CAMERAS = 32  # of a robot; shipped ones have two at most

_HINTS = {"interval": "write rate = pictures per second", "type": "leave it out"}


def read_cameras(
    reader: Table, links: Sequence[str], parent: RobotDescription | None
) -> tuple[CameraDescription, ...]:
    """Cameras in mount order; one that bears the name of an inherited one replaces it.

    Args:
        reader: the file.
        links: names of wheels and other links that may carry cameras.
        parent: the robot that is extended.
    """
    cameras = _inherited(reader, parent.cameras if parent else ())
    for camera in cameras:
        if camera.link is not None and camera.link not in links:
            raise reader.error(
                "camera",
                f"the inherited camera {camera.name!r} sits on {camera.link!r}, which is gone",
                "keep that name, or drop the camera with without = [...]",
            )
    own: set[str] = set()
    for table in reader.tables("camera"):
        camera = _camera(table, links)
        key = camera.name.lower()
        if key in own:
            raise table.error(
                "name", f"a second camera is called {camera.name!r}", "rename one of them"
            )
        own.add(key)
        _enter(cameras, camera)
        if len(cameras) > MOST_CAMERAS:
            raise table.error("", f"is one more than {MOST_CAMERAS}", "mount fewer cameras")
    return tuple(cameras)


def _camera(table: Table, links: Sequence[str]) -> CameraDescription:
    usual = CameraDescription(name="")
    if table.has("type"):
        table.choice("type", ("Camera",))
    name = table.text("name")
    if not WORD.fullmatch(name):
        raise table.error("name", f"is {name!r}", "use one word without blanks and braces")
    low = table.number("min_fov", usual.min_fov, low=NARROWEST, high=WIDEST)
    high = table.number("max_fov", max(low, usual.max_fov), low=low, high=WIDEST)
    camera = table.read(
        CameraDescription,
        name=name,
        link=read_link(table, links),
        pose=read_pose(table),
        fov=table.number("fov", min(max(usual.fov, low), high), low=low, high=high),
        min_fov=low,
        max_fov=high,
        where=table.place,
        size=_size(table),
    )
    table.finish(_HINTS)
    return camera


def _size(table: Table) -> tuple[int, int] | None:
    if not table.has("size"):
        return None
    width, height = table.numbers("size", (2,), low=SIZES[0], high=SIZES[1])
    if width != int(width) or height != int(height):
        raise table.error("size", f"is {width:g} x {height:g}", "write whole numbers of pixels")
    return int(width), int(height)
