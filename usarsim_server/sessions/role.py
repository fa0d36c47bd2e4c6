"""What a connection can be: the conductor of a robot, or something else that obeys and reports."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from usarsim_server.logs import Log
from usarsim_server.protocol.requests import Init, Request
from usarsim_server.protocol.values import Dialect
from usarsim_server.sessions.schedule import Schedule
from usarsim_server.simulation.clockwork import Listener
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.rays.cast import RayQuery
from usarsim_server.simulation.rays.fans import RayHits
from usarsim_server.simulation.snapshot import Snapshot

__all__ = ["Casting", "Reading", "Role", "RoleFactory", "robots_only"]


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """A report under way: its rays are still to be cast.

    Attributes:
        query: the rays; none for most that are no robots.
        lines: writes the streamed lines, given the answers to the fans of the query, in order.
    """

    query: RayQuery
    lines: Callable[[Sequence[RayHits]], list[str]]


class Role(Protocol):
    """Deals with the requests of one connection; used by one thread at a time."""

    dialect: Dialect
    """Of everything it writes; may be changed at any time."""
    slow: bool
    """Whether its requests may take long; they are carried out by a thread of their own then."""

    @property
    def schedule(self) -> Schedule | None:
        """When it wants snapshots; None for never.

        The physics takes from it what is due. Setting `dialect` changes it, so that must not happen
        at the same time.
        """

    def obey(self, request: Request) -> list[str]:
        """Carry out a request; returns the reply lines."""

    def read(self, snapshot: Snapshot, due: Sequence[int]) -> Reading | None:
        """Begin the report that is due at a snapshot.

        Args:
            snapshot: the instant; never an earlier one than at the call before.
            due: what its schedule has said is due; nothing at the first snapshot.

        Returns:
            The report; None if there is nothing to tell.
        """

    def take_news(self) -> list[str]:
        """Lines that came up while reporting and must arrive."""


@dataclass(frozen=True, slots=True, eq=False)
class Casting:
    """A role that a connection has been given.

    Attributes:
        role: the role.
        name: names it in the log.
        dialect: of the era that its class comes from.
        leave: takes everything that belongs to it out of the world; called by whoever
            serves the connection.
        attach: has a listener woken with snapshots; None if it wants none.
    """

    role: Role
    name: str
    dialect: Dialect
    leave: Callable[[], None]
    attach: Callable[[Listener], None] | None = None


RoleFactory = Callable[[Init, Pose, Log], Casting | None]
"""Makes the role that INIT asks for, at the pose it means; None if it asks for a robot.

Raises `UsarsimError` if the role cannot be played.
"""


def robots_only(init: Init, pose: Pose, log: Log) -> Casting | None:
    """The factory of a server that knows robots and nothing else."""
    return None
