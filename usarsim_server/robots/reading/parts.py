"""Parts of a robot file: each function reads one kind of table into one kind of value.

Files are in the wire frame (x forward, y right, z down); everything returned here is in the
simulation frame. A part that the file leaves out is taken from the robot that it extends.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from usarsim_server.base.files import data_directory
from usarsim_server.base.logs import Log
from usarsim_server.base.tables import Table, suggest
from usarsim_server.protocol.values import Vector
from usarsim_server.robots.description import (
    ANNOUNCED_TORQUE,
    SERVO_DROOP,
    ActuatorDescription,
    BatteryDescription,
    Caster,
    DriveDescription,
    ItemDescription,
    RobotDescription,
    RobotReport,
    Shape,
    Wheel,
    home_pose,
)
from usarsim_server.robots.families.base import Family
from usarsim_server.robots.keys import (
    LIGHTEST,
    LONGEST,
    SHORTEST,
    WORD,
    part_name,
    read_link,
    read_pose,
)
from usarsim_server.simulation.frames import Pose

SHAPE_SIZES = {"box": 3, "cylinder": 2, "sphere": 1, "ellipsoid": 3, "capsule": 2}
"""How many numbers each kind of shape has as its size."""

REST_TOLERANCE = 0.01
"""m between the rest height of a file and the height that follows from its wheels (robots 17)."""

MOST_ITEMS = 256
"""Sensors of a robot; shipped ones have 31 at most."""
LEAST_INTERVAL = 0.0005
"""s between two reports of a sensor: the shortest step that a world can be given."""

GONE = frozenset(
    [
        *("Touch", "INS", "Odometer", "Odometry"),
        *(f"{side}{number}" for side in "FR" for number in range(1, 9)),
    ]
)
"""Sensors that shipped classes had in earlier versions: files that drop them stay good."""

_DERIVED = dict.fromkeys(
    ("wheel_radius", "track_width", "wheel_base", "wheel_separation", "mass"),
    "leave it out: it follows from the wheels and masses, so that GEO and motion agree",
)
_log = Log("robots")

Parent = RobotDescription | None
T = TypeVar("T")


def read_wheels(
    reader: Table,
    needed: bool,
    actuators: Sequence[ActuatorDescription],
    parent: Parent,
) -> tuple[Wheel, ...]:
    """Wheels in part order, the order in which encoders count them.

    Args:
        reader: the file.
        needed: there must be driven wheels on both sides; otherwise there must be none.
        actuators: their links may carry wheels.
        parent: the robot that is extended.
    """
    if not needed:
        for key in ("wheel", "caster", "drive"):
            if reader.has(key):
                raise reader.error(
                    key, "stands on a robot without wheels", "remove it, or change kind"
                )
        return ()
    if parent is not None and not reader.has("wheel"):
        return parent.wheels
    links = [link.body for actuator in actuators for link in actuator.links]
    wheels = tuple(_wheel(table, links) for table in reader.tables("wheel"))
    names = [wheel.name.lower() for wheel in wheels]
    for name in names:
        if names.count(name) > 1:
            raise reader.error(
                "wheel", f"two wheels are called {name!r}", "give every wheel its own name"
            )
    for side in ("left", "right"):
        if not any(wheel.driven and wheel.side == side for wheel in wheels):
            raise reader.error(
                "wheel", f"no driven wheel on the {side}", "add a [[wheel]] table there"
            )
    return wheels


def wheel_place(wheel: Wheel, actuators: Sequence[ActuatorDescription]) -> Vector:
    """Centre of a wheel relative to the reference point when the robot appears, m."""
    return (home_pose(actuators, wheel.link) @ Pose(wheel.position)).position


def _wheel(table: Table, links: Sequence[str]) -> Wheel:
    name = part_name(table)
    link = read_link(table, links)
    y = table.vector("position", low=-LONGEST, high=LONGEST)[1]
    by_position = "right" if y > 0.0 else "left"
    beside = y != 0.0 and link is None
    side = table.choice("side", ("left", "right"), by_position if beside else None)
    if beside and side != by_position:
        raise table.error("side", f"is {side!r} but y is {y:g}", "y is positive to the right")
    wheel = table.read(Wheel, name=name, side=side, link=link)
    table.finish()
    return wheel


def read_casters(reader: Table, parent: Parent) -> tuple[Caster, ...]:
    """Casters; their balls belong to the chassis body."""
    if parent is not None and not reader.has("caster"):
        return parent.casters
    return read_all(reader.tables("caster"), Caster)


def read_all(tables: Iterable[Table], cls: type[T]) -> tuple[T, ...]:
    """Values all of whose fields are declared."""
    values = []
    for table in tables:
        values.append(table.read(cls))
        table.finish()
    return tuple(values)


def read_shapes(
    reader: Table, parent: Parent, imported: tuple[Shape, ...] = ()
) -> tuple[Shape, ...]:
    """Chassis pieces, beside those of a model file; at least one."""
    if parent is not None and not reader.has("shape") and not imported:
        return parent.shapes
    shapes = imported + tuple(read_shape(table) for table in reader.tables("shape"))
    if not shapes:
        raise reader.error("shape", "is missing", "add a [[shape]] table for the chassis")
    return shapes


def read_shape(table: Table) -> Shape:
    """One piece of a body."""
    kind = table.choice("kind", tuple(SHAPE_SIZES))
    size = table.numbers("size", (SHAPE_SIZES[kind],), low=SHORTEST, high=LONGEST)
    shape = table.read(Shape, kind=kind, size=size, pose=read_pose(table))
    table.finish()
    return shape


def check_weight(reader: Table, shapes: Sequence[Shape], casters: Sequence[Caster]) -> None:
    """Refuse a chassis without mass."""
    mass = sum(shape.mass for shape in shapes) + sum(caster.mass for caster in casters)
    if mass < LIGHTEST:
        raise reader.error("shape", "all pieces are weightless", "give a shape its mass")


def read_rest_height(
    reader: Table,
    wheels: Sequence[Wheel],
    actuators: Sequence[ActuatorDescription],
    parent: Parent,
    support: float | None = None,
) -> float:
    """By default, and give or take a little, where what it stands on touches the floor.

    The reference point of a platform is where its file says, by default on the floor.

    Args:
        reader: the file.
        wheels, actuators: the body; driven wheels touch the floor.
        parent: the robot that is extended.
        support: height of the reference point above the floor on what is no wheel, m.
    """
    heights = [
        wheel.radius - wheel_place(wheel, actuators)[2]
        for wheel in wheels
        if wheel.driven and wheel.collides
    ]
    heights += [] if support is None else [support]
    if not heights:
        default = parent.rest_height if parent else 0.0
        return reader.number("rest_height", default, low=-LONGEST, high=LONGEST)
    touching, name = max(heights), "wheels" if support is None else "tracks"
    inherited = parent is not None and parent.wheels == wheels and support is None
    default = parent.rest_height if parent and inherited else round(touching, 9)
    height = reader.number("rest_height", default)
    if abs(height - touching) > REST_TOLERANCE:
        raise reader.error(
            "rest_height",
            f"is {height:g}, but the {name} touch the floor at {touching:g}",
            f"leave it out, or move the {name}",
        )
    return height


def read_drive(reader: Table, wheels: Sequence[Wheel], parent: Parent) -> DriveDescription:
    """Limits of the wheel servos."""
    if not wheels:
        return DriveDescription(max_wheel_speed=0.0)
    table = reader.table("drive")
    base = parent.drive if parent else None
    drive = table.read(DriveDescription, base)
    usual = base or DriveDescription(max_wheel_speed=drive.max_wheel_speed)
    if drive.wheel_torque != usual.wheel_torque and not table.has("servo_gain"):
        drive = replace(drive, servo_gain=drive.wheel_torque / SERVO_DROOP)
    table.finish()
    return drive


def read_battery(reader: Table, parent: Parent) -> BatteryDescription | None:
    """The battery; `battery = false` takes away an inherited one."""
    inherited = parent.battery if parent else None
    if not reader.has("battery"):
        return inherited
    if reader.raw("battery") is False:
        return None
    table = reader.table("battery")
    battery = table.read(BatteryDescription, inherited)
    table.finish()
    return battery


def read_report(
    table: Table,
    wheels: Sequence[Wheel],
    actuators: Sequence[ActuatorDescription],
    mass: float,
    drive: DriveDescription,
    parent: Parent,
    family: Family,
) -> RobotReport:
    """What GEO and CONF announce; all geometry follows from the driven wheels (robots 19).

    Args:
        table: `[report]`.
        wheels, actuators, mass, drive: the body.
        parent: the robot that is extended.
        family: says what is announced unless the file says otherwise.
    """
    driven = [wheel for wheel in wheels if wheel.driven]
    places = [wheel_place(wheel, actuators) for wheel in driven]
    base = _extent([place[0] for place in places])
    # From the left front to the right rear wheel, as in the original (robots reference 1.2).
    sided = list(zip((wheel.side for wheel in driven), places, strict=True))
    left = max(place[:2] for side, place in sided if side == "left")
    right = min(place[:2] for side, place in sided if side == "right")
    track = _extent([left[1], right[1]])
    # Announced figures are inherited only as long as what they describe is.
    same_wheels = parent is not None and parent.wheels == tuple(wheels)
    same_limit = parent is not None and parent.drive.max_wheel_speed == drive.max_wheel_speed
    old = parent.report if parent else None
    usual = RobotReport(
        wheel_radius=driven[0].radius,
        track_width=track,
        wheel_base=base,
        mass=round(mass, 9),
        steering_type=old.steering_type if old else family.steering_type,
        dimensions=old.dimensions if old and same_wheels else (base, track, 0.0),
        center_of_gravity=old.center_of_gravity if old else (0.0, 0.0, 0.0),
        max_speed=old.max_speed if old and same_limit else drive.max_wheel_speed,
        max_torque=old.max_torque if old else ANNOUNCED_TORQUE,
        max_front_steer=old.max_front_steer if old else family.max_steer()[0],
        max_rear_steer=old.max_rear_steer if old else family.max_steer()[1],
    )
    report = table.read(RobotReport, usual)
    table.finish(_DERIVED)
    return report


def read_platform_report(table: Table, mass: float, parent: Parent) -> RobotReport:
    """What GEO and CONF announce of a platform without wheels."""
    nothing = (0.0, 0.0, 0.0)
    inherited = parent.report.dimensions if parent else nothing
    report = RobotReport(
        wheel_radius=0.0,
        track_width=0.0,
        wheel_base=0.0,
        mass=round(mass, 9),
        steering_type="None",
        dimensions=table.vector("dimensions", inherited, low=0.0, high=LONGEST),
        center_of_gravity=nothing,
        max_speed=0.0,
        max_torque=0.0,
    )
    table.finish(_DERIVED)
    return report


def _extent(values: Sequence[float]) -> float:
    # Rounded, because 0.2356 + 0.2356 must not print as 0.4711 when digits are cut off.
    return round(max(values) - min(values), 9)


def read_items(reader: Table, links: Sequence[str], parent: Parent) -> tuple[ItemDescription, ...]:
    """Sensors in mount order; one that an inherited sensor equals in type and name replaces it.

    Args:
        reader: the file.
        links: names of wheels and other links that may carry sensors.
        parent: the robot that is extended.
    """
    items = list(_without(reader, parent.items if parent else ()))
    inherited = len(items)
    for item in items:
        if item.link is not None and item.link not in links:
            raise reader.error(
                "wheel",
                f"the inherited sensor {item.name!r} sits on {item.link!r}, which is gone",
                "keep that name, or drop the sensor with without = [...]",
            )
    _check_without(reader, parent)
    for table in reader.tables("sensor"):
        item = _item(table, links)
        if len(items) == MOST_ITEMS:
            raise table.error("", f"is one more than {MOST_ITEMS}", "mount fewer sensors")
        twins = [i for i, other in enumerate(items) if _same_item(item, other)]
        if twins and twins[0] < inherited:
            items[twins[0]] = item
            continue
        if twins:
            # AirRobot mounts two items called GPS; the original did not mind (robots 16).
            _log.warning("a second item of this type and name", item=item.where)
        items.append(item)
    return tuple(items)


def _same_item(one: ItemDescription, other: ItemDescription) -> bool:
    return (one.type.lower(), one.name.lower()) == (other.type.lower(), other.name.lower())


def _without(reader: Table, items: Sequence[ItemDescription]) -> Sequence[ItemDescription]:
    dropped = reader.texts("without")
    return [item for item in items if item.name not in dropped]


def _check_without(reader: Table, parent: Parent) -> None:
    """Refuse to drop what was not inherited."""
    inherited: list[str] = []
    if parent is not None:
        inherited += [item.name for item in parent.items]
        inherited += [actuator.name for actuator in parent.actuators]
        inherited += [effector.name for effector in parent.effectors]
        inherited += [camera.name for camera in parent.cameras]
    shipped = data_directory("robots")
    if parent is not None and Path(reader.path).parent == shipped != parent.source.parent:
        return  # somebody's own class took the place of the shipped one that was meant
    for name in reader.texts("without"):
        if name in inherited:
            continue
        if parent is not None and name in GONE:
            _log.info("a sensor that is dropped is not inherited any longer", item=name)
        else:
            names = list(dict.fromkeys(inherited))
            raise reader.error("without", f"no inherited sensor {name!r}", suggest(name, names))


def _item(table: Table, links: Sequence[str]) -> ItemDescription:
    link = read_link(table, links)
    type_ = table.text("type")
    name = table.text("name")
    for key, word in (("type", type_), ("name", name)):
        if not WORD.fullmatch(word):
            raise table.error(key, f"is {word!r}", "use one word without blanks and braces")
    interval = table.number("interval", 0.0, low=0.0, high=1e6)
    if 0.0 < interval < LEAST_INTERVAL:
        problem = f"{interval:g} s is shorter than any step of the world"
        cure = f"write at least {LEAST_INTERVAL:g}, or 0 for reports on request only"
        raise table.error("interval", problem, cure)
    return ItemDescription(type_, name, link, read_pose(table), table.rest("interval"), table.place)
