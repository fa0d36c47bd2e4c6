"""A server put together: its rooms, and how they end."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import dataclass

from usarsim_server.cameras.board import CameraBoard
from usarsim_server.cameras.render_loop import RenderLoop
from usarsim_server.protocol.values import name_key
from usarsim_server.scene.supervision import Supervision
from usarsim_server.services.limits import address_of
from usarsim_server.services.port import Service
from usarsim_server.sessions.dispatcher import Dispatcher
from usarsim_server.sessions.outbox import Outbox
from usarsim_server.sessions.robots import Robots
from usarsim_server.sessions.roles import Roles
from usarsim_server.sessions.session import Session
from usarsim_server.settings import Settings
from usarsim_server.simulation.simulation import Simulation
from usarsim_server.worlds.description import WorldDescription
from usarsim_server.worlds.surroundings import Surroundings

STOP_TIMEOUT = 1.0
"""s that the sessions' threads get to end; the process has three in all."""


@dataclass(frozen=True, slots=True, eq=False)
class Assembly:
    """A server put together but not yet running."""

    settings: Settings  # what it was made from
    world: WorldDescription
    simulation: Simulation  # the physics; its thread is started by `run`, or not at all in tests
    robots: Robots
    surroundings: Surroundings  # people, tags and sounds of the world
    roles: Roles  # makes what INIT asks for
    render_loop: RenderLoop  # renders what somebody looks at; `run` opens it
    dispatcher: Dispatcher  # serves the sessions
    supervision: Supervision  # who looks on what clients say, and who drives in whose place
    sessions: weakref.WeakSet[Session]  # those of all connections so far that still exist
    services: tuple[Service, ...] = ()  # what listens

    @property
    def board(self) -> CameraBoard:
        """All cameras, and the tiles of the full picture that they fill."""
        return self.robots.board

    def owners(self) -> dict[str, str]:
        """The address of the control connection of each robot, by `values.name_key`."""
        robots = [(session.robot, session.peer) for session in tuple(self.sessions)]
        return {name_key(name): address_of(peer).strip("[]") for name, peer in robots if name}

    def make_session(
        self, peer: str, outbox: Outbox, on_backlog_low: Callable[[], None]
    ) -> Session:
        """The session of a new control connection."""
        session = Session(peer, outbox, on_backlog_low, self.roles, self.dispatcher.call)
        self.sessions.add(session)
        self.supervision.enter(session)
        return session

    def stop(self) -> None:
        """Stop rendering and physics, and wait for the threads that serve the sessions.

        They may be inside native code; a process that ended under them would crash.
        """
        self.simulation.stop()  # first: the renderer may be waiting for it
        self.render_loop.close()
        for session in tuple(self.sessions):
            session.close()
        self.dispatcher.stop(STOP_TIMEOUT)
