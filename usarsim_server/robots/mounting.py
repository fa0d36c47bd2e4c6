"""What sensors, effectors and cameras have in common as items of a robot.

Its keys in robot files are fields of its class, it sits on the chassis or on a link, which GEO
tells in the words of the dialect, and it answers a SET with an outcome.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.base.fields import keys
from usarsim_server.base.tables import Table
from usarsim_server.protocol.dialects import FACETS
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription, RobotDescription
from usarsim_server.simulation.frames import Pose

HARD = "HARD"
"""Mount of everything fixed to the body in `ut2004`."""


class DeclaredItem:
    """A sensor or an effector; its keys in robot files are the fields of its class.

    A field made by `fields.field` is read from the item's table when the item is made. A subclass
    changes a default by a plain assignment: `max_range = 20.0`.

    Attributes:
        parameters: the table, for what a declaration cannot say; what is read is known as a key.
    """

    def __init_subclass__(cls, **given: object) -> None:
        super().__init_subclass__(**given)
        dataclass(init=False, repr=False, eq=False, match_args=False)(cls)

    def __init__(self, item: ItemDescription) -> None:
        """Read the declared fields.

        Raises:
            RobotDescriptionError: a key has a value that cannot be used.
        """
        place = item.where or f"{type(self).__name__} {item.name}"
        self.parameters = Table(
            item.parameters, place, RobotDescriptionError, kind=f"a {item.type}"
        )
        cls: type = type(self)
        for key in keys(cls):
            default = getattr(cls, key.name, key.default())
            setattr(self, key.name, key.read(self.parameters, default))


class SetResult(Enum):
    """Outcome of a SET command at one item."""

    OK = "OK"
    FAILED = "Failed"
    UNKNOWN = "unknown opcode"
    SCAN = "measure now"
    """The opcode asks for one immediate report."""


@dataclass(frozen=True, slots=True)
class SetReply:
    """Outcome of a SET command together with segments that RES carries behind the status."""

    result: SetResult
    segments: tuple[Segment, ...] = ()


def carried(
    pose: Pose, link: str | None, robot: RobotDescription, dialect: Dialect
) -> tuple[Pose, str, int | None]:
    """Pose, Mount and MountLink of GEO.

    UDK named the actuator and the number of its link; it knew wheels only as parts of the vehicle,
    so there what sits on a wheel is announced where it is on the body.

    Args:
        pose: relative to the link.
        link: link that carries the item; None for the chassis.
        robot: the class.
        dialect: see above.
    """
    if FACETS[dialect].link_mounts:
        return pose, HARD if link is None else link, None
    if link is None:
        return pose, robot.name, None
    found = robot.find_link(link)
    if found is not None:
        return pose, found[0].name, found[1]
    for wheel in robot.wheels:
        if wheel.name.lower() == link.lower():
            return Pose(wheel.position) @ pose, robot.name, None
    return pose, link, None
