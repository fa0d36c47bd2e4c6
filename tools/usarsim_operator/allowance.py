"""What the conditions of a study let operators do: by which device, and with which robots.

Instructors may do everything; to stop is allowed to everybody, by any device.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING

from usarsim_operator.roles import Role

if TYPE_CHECKING:
    from usarsim_operator.pages import Page

DEVICES: Mapping[str, str] = MappingProxyType({"any": "", "keyboard": "keyboard", "gamepad": "pad"})
"""Of a condition: what `device` of a text that drives must be; empty: all the same."""


@dataclass(frozen=True, slots=True)
class Allowance:
    """What operators may do.

    Attributes:
        device: of `DEVICES`, the only one that drives.
        split: the seat whose robot it is, from 1 on, by robot; others are everybody's.
        fixed: operators bring no robots and remove none.
    """

    device: str = "any"
    split: Mapping[str, int] = field(default_factory=dict)
    fixed: bool = False

    def __post_init__(self) -> None:
        """Check it.

        Raises:
            ValueError: there is no such device, or no such seat.
        """
        if self.device not in DEVICES:
            known = ", ".join(DEVICES)
            raise ValueError(f"there is no device {self.device} (known: {known})")
        if any(seat < 1 for seat in self.split.values()):
            raise ValueError("seats are counted from 1 on")

    def check_device(self, page: Page, device: str | None) -> None:
        """Whether a device may drive.

        Args:
            page: who drives. device: as its text says it; None: it does not say.

        Raises:
            ValueError: with the reason.
        """
        wanted = DEVICES[self.device]
        if page.role is Role.OPERATOR and wanted and device != wanted:
            raise ValueError(f"only the {self.device} drives here")

    def check_robot(self, page: Page, robot: str) -> None:
        """Whether a robot is a page's to drive.

        Raises:
            ValueError: with the reason, which names the other operator.
        """
        seat = self.split.get(robot)
        if page.role is Role.OPERATOR and seat not in (None, page.seat):
            raise ValueError(f"{robot} is for operator {seat} to drive")

    def check_fleet(self, page: Page) -> None:
        """Whether a page may bring and remove robots.

        Raises:
            ValueError: with the reason.
        """
        if page.role is Role.OPERATOR and self.fixed:
            raise ValueError("the robots of this trial are fixed")


def halves(robots: Sequence[str], seats: int) -> dict[str, int]:
    """The robots, in their order, dealt out evenly to so many seats: the first ones to seat 1."""
    return {name: 1 + place * seats // len(robots) for place, name in enumerate(robots)}
