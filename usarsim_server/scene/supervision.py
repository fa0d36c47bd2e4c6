"""Who looks on, and who drives in whose place: the taps of all sessions of a server.

No sockets and no event loop: the scene port calls from its own thread. A robot has one holder at a
time; its controller stays connected, goes on reading, and whatever it asks beside moving its robot
is done as always.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from functools import partial

from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.logs import Log
from usarsim_server.protocol import explanation
from usarsim_server.protocol.grammar import parse_line
from usarsim_server.protocol.requests import Drive
from usarsim_server.protocol.values import name_key, near
from usarsim_server.sessions.schedule import Role
from usarsim_server.sessions.session import Session
from usarsim_server.sessions.tap import Row, Tap

DRIVING = frozenset({"ACT", "DRIVE", "MISPKG", "MULTIDRIVE", "SET"})
"""Words that may be said in a controller's place."""

_log = Log("supervision")


class Supervision:
    """Listens to sessions and holds robots; safe to use from any thread."""

    def __init__(self, sessions: Callable[[], Iterable[Session]], now: Callable[[], float]) -> None:
        """Do nothing yet.

        Args:
            sessions: all that exist.
            now: simulated s; returns at once.
        """
        self._sessions, self._now = sessions, now
        self._lock = threading.Lock()
        self._publish: Callable[[Row], None] | None = None
        self._streams = False

    # -- listening ---------------------------------------------------------------------------

    def listen(self, publish: Callable[[Row], None] | None, streams: bool) -> None:
        """Have every row handed to somebody, from any thread, at once; None: to nobody."""
        with self._lock:
            self._publish, self._streams = publish, streams
            for session in self._sessions():
                self._connect(session)

    def enter(self, session: Session) -> None:
        """A client has connected."""
        with self._lock:
            self._connect(session)

    def _connect(self, session: Session) -> None:
        tap = session.tap
        if tap is not None:
            tap.publish, tap.streams = self._publish, self._streams
            if self._publish is None and tap.holder is None:
                session.tap = None
        elif self._publish is not None:
            session.tap = Tap(session.peer, self._publish, self._streams, self._now)

    # -- driving -----------------------------------------------------------------------------

    def find(self, robot: str | None, peer: str | None) -> Session:
        """The session of a robot by its name in any case, or of a client by `host:port`.

        Raises:
            UsarsimError: if there is none, or it has no robot.
        """
        present = [one for one in self._sessions() if one.robot is not None]
        for session in present:
            name = session.robot or ""
            if peer == session.peer or (peer is None and name_key(name) == name_key(robot or "")):
                return session
        names = sorted(one.robot or "" for one in present)
        hint = near(robot or peer or "", names)
        raise UsarsimError(f"there is no robot {robot or peer!r}{hint}")

    def take(self, session: Session, by: str) -> None:
        """Hold a robot's controller back and stop the robot.

        Raises:
            UsarsimError: if somebody holds it, with the name.
        """
        with self._lock:
            tap = session.tap
            if tap is not None and tap.holder is not None:
                raise UsarsimError(f"{session.robot} is held by {tap.holder}")
            if tap is None:
                tap = Tap(session.peer, self._publish, self._streams, self._now)
            tap.suspended, tap.newest, tap.normalized = 0, None, None
            tap.holder = by
            session.tap = tap
        session.intervene(lambda role: role.halt())
        _log.info("robot taken over", robot=session.robot, connection=session.peer, by=by)

    def drive(self, session: Session, by: str, line: str) -> bool:
        """Have a robot that somebody holds obey a line; whether it leaves the robot at rest.

        Raises:
            UsarsimError: if it does not hold it, or these are no commands that move a robot.
        """
        tap = self._held(session, by)
        commands = parse_line(line.encode("latin-1", "replace"))
        words = {one.word for one in commands}
        if not commands or not words <= DRIVING:
            known = ", ".join(sorted(DRIVING))
            raise UsarsimError(f"only commands that move a robot can be given ({known})")
        session.intervene(lambda role: tap.drive(by, role, commands))
        requests = [explanation.heard(one)[1] for one in commands]
        return all(isinstance(one, Drive) and _at_rest(one) for one in requests)

    def halt(self, session: Session, by: str) -> None:
        """Stop a robot whose holder is silent; nothing if it does not hold it any more."""
        if session.tap is not None and session.tap.holder == by:
            session.intervene(lambda role: role.halt())
            _log.info("robot stopped: no word of its holder", robot=session.robot, by=by)

    def hand_back(self, session: Session, by: str, resume: bool = False) -> int:
        """Stop a robot and let its controller drive again; how many commands were held back.

        Args:
            session: whose robot it is.
            by: who holds it.
            resume: carry out the newest DRIVE among those that were held back.

        Raises:
            UsarsimError: if it does not hold it.
        """
        tap = self._held(session, by)
        session.intervene(lambda role: role.halt())
        newest = tap.newest
        if tap.normalized is not None:  # its controller goes on in the unit that it has chosen
            session.intervene(partial(_obey, Drive(normalized=tap.normalized)))
        if resume and newest is not None:
            session.intervene(partial(_obey, newest))
        with self._lock:
            tap.holder = None
            self._connect(session)
        _log.info(
            "robot handed back",
            robot=session.robot,
            connection=session.peer,
            by=by,
            suspended=tap.suspended,
        )
        return tap.suspended

    def _held(self, session: Session, by: str) -> Tap:
        tap = session.tap
        if tap is None or tap.holder != by:
            who = "nobody" if tap is None or tap.holder is None else tap.holder
            raise UsarsimError(f"{session.robot} is not yours: {who} holds it; take it first")
        return tap


def _obey(request: Drive, role: Role) -> None:
    role.obey(request)


def _at_rest(drive: Drive) -> bool:
    """Whether a DRIVE sets nothing moving; one to a joint may, whatever its value."""
    speeds = (
        *(drive.left, drive.right, drive.speed, drive.propeller),
        *(drive.altitude_velocity, drive.linear_velocity),
        *(drive.lateral_velocity, drive.rotational_velocity),
        *(wheel.speed for wheel in drive.wheels),
    )
    return drive.name is None and not any(speeds)
