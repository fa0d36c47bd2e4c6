"""What the scene port tells of lines and of the clock, and what it lets a supervisor do.

Two channels, for everybody who may look: `lines`, what clients say and are told, explained; and
`clock`. Requests that change anything are there only if the server was told so (`--supervise on`):
driving a robot in its controller's place, and the instructor's clock. Everything is used on the
event loop; what may wait for the physics is done by a thread.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import re
from collections import deque
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from usarsim_server.base.errors import UsarsimError
from usarsim_server.protocol.scene import SceneError, message, read_number, read_text
from usarsim_server.scene.channels import Channel, Request, Subscriber

if TYPE_CHECKING:  # which stand on the physics
    from usarsim_server.scene.supervision import Supervision
    from usarsim_server.sessions.session import Session
    from usarsim_server.sessions.tap import Row
    from usarsim_server.simulation.simulation import Simulation

MOST_ROWS = 50
"""Rows of one message."""
KEPT_ROWS = 400
"""Rows that wait for a client; the oldest give way."""
BREATH = 0.05
"""s of wall time between two messages of rows."""
STREAM_PERIOD = 0.5
"""Simulated s between two rows of one stream: what a person can read."""
MOST_STREAMS = 4096
SILENCE = 0.5
"""s of wall time without a word of its holder after which a robot that moves is stopped."""
TICK = 1.0
"""s of wall time between two messages of the clock."""
LOOK = 0.05
"""s of wall time after which a clock that stands is told at the latest, as after a step."""
LONGEST_LINE, LONGEST_NAME = 4096, 64
LONGEST_STEP = 3600.0
"""Simulated s."""
LONGEST_CALL = 86400.0
"""Simulated s."""
SPEEDS = 0.05, 100.0

_STREAM = re.compile(r"(?:\{(?:Type|Name) [^{}]*\}\s*)+")


class Lines:
    """The rows that wait for one client; the newest win, and it is told how many it lost."""

    def __init__(self, hub: _Hub, subscriber: Subscriber) -> None:
        self._hub, self._subscriber = hub, subscriber
        self.streams = subscriber.hello.streams
        self._rows: deque[Row] = deque()
        self._events: deque[bytes] = deque(maxlen=MOST_ROWS)
        self._lost = 0
        self._told: dict[tuple[str, str], float] = {}
        self._loop = asyncio.get_running_loop()
        self._due = 0.0
        self._alarm: asyncio.TimerHandle | None = None
        hub.enter(self)

    def put(self, row: Row) -> None:
        """One more."""
        if row.streamed and not (self.streams and self._shown(row)):
            return
        self._rows.append(row)
        if len(self._rows) > KEPT_ROWS:
            self._rows.popleft()
            self._lost += 1
        if self._alarm is None:
            self._subscriber.wake()

    def event(self, frame: bytes) -> None:
        """Somebody has intervened."""
        self._events.append(frame)
        self._subscriber.wake()

    def _shown(self, row: Row) -> bool:
        """Whether it is time for another row of this stream."""
        found = _STREAM.search(row.text[:200])
        stream = row.session, found[0] if found else row.text[:3]
        before = self._told.get(stream, -math.inf)
        if before <= row.time < before + STREAM_PERIOD - 1e-6:
            return False
        if len(self._told) >= MOST_STREAMS:
            self._told.clear()
        self._told[stream] = row.time
        return True

    def take(self) -> bytes | None:
        """See `Subscription`."""
        if self._events:
            return self._events.popleft()
        now = self._loop.time()
        if not self._rows or self._alarm is not None:
            return None
        if now < self._due:
            self._alarm = self._loop.call_at(self._due, self._wake)
            return None
        self._due = now + BREATH
        rows = [self._rows.popleft() for _ in range(min(MOST_ROWS, len(self._rows)))]
        told: dict[str, object] = {"type": "lines", "rows": [one.message() for one in rows]}
        if self._lost:
            told["lost"], self._lost = self._lost, 0
        return message(told)

    def _wake(self) -> None:
        self._alarm = None
        self._subscriber.wake()

    def close(self) -> None:
        """See `Subscription`."""
        if self._alarm is not None:
            self._alarm.cancel()
        self._hub.leave(self)


class _Hub:
    """Everybody who reads lines. Rows come from any thread, and wait here, bounded, until the event
    loop has a moment for them."""

    def __init__(self, supervision: Supervision) -> None:
        self._supervision = supervision
        self._readers: set[Lines] = set()
        self._rows: deque[Row] = deque(maxlen=KEPT_ROWS)
        self._called = False
        self._loop: asyncio.AbstractEventLoop | None = None

    def enter(self, reader: Lines) -> None:
        self._readers.add(reader)
        self._loop = asyncio.get_running_loop()
        self._listen()

    def leave(self, reader: Lines) -> None:
        self._readers.discard(reader)
        self._listen()

    def tell(self, event: Mapping[str, object]) -> None:
        frame = message(event)
        for reader in self._readers:
            reader.event(frame)

    def _listen(self) -> None:
        streams = any(one.streams for one in self._readers)
        self._supervision.listen(self._publish if self._readers else None, streams)

    def _publish(self, row: Row) -> None:
        """Take a row; any thread."""
        self._rows.append(row)
        if not self._called and self._loop is not None:
            self._called = True
            with contextlib.suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(self._spread)

    def _spread(self) -> None:
        self._called = False
        while self._rows:
            row = self._rows.popleft()
            for reader in self._readers:
                reader.put(row)


class Clock:
    """Tells one client of the clock: when it changes, stops or goes on, and once a second."""

    def __init__(self, supervisor: Supervisor, subscriber: Subscriber) -> None:
        self._supervisor, self._subscriber = supervisor, subscriber
        self._loop = asyncio.get_running_loop()
        self._waiting = True
        self._alarm = self._loop.call_later(LOOK, self._tick)
        self._due, self._stood = self._loop.time() + TICK, False
        self._then = self._loop.time(), supervisor.simulation.now
        supervisor.clocks.add(self)

    def changed(self) -> None:
        """There is something to tell."""
        self._waiting = True
        self._subscriber.wake()

    def _tick(self) -> None:
        self._alarm = self._loop.call_later(LOOK, self._tick)
        now = self._loop.time()
        if now >= self._due or self._supervisor.simulation.paused != self._stood:
            self._due = now + TICK
            self.changed()

    def take(self) -> bytes | None:
        """See `Subscription`."""
        if not self._waiting:
            return None
        self._waiting = False
        simulation, now = self._supervisor.simulation, self._loop.time()
        time, (wall, before) = simulation.now, self._then
        factor = (time - before) / (now - wall) if now - wall > TICK / 2 else None
        if factor is not None:
            self._then = now, time
        speed, self._stood = simulation.speed, simulation.paused
        return message(
            {
                "type": "clock",
                "time": round(time, 3),
                "paused": self._stood,
                "speed": None if math.isinf(speed) else speed,
                "real_time_factor": None if factor is None else round(factor, 3),
            }
        )

    def close(self) -> None:
        """See `Subscription`."""
        self._alarm.cancel()
        self._supervisor.clocks.discard(self)


@dataclass(slots=True, eq=False)
class _Hold:
    """One robot that a client drives."""

    session: Session
    robot: str
    by: str
    owner: Subscriber
    alarm: asyncio.TimerHandle | None = None

    def quiet(self) -> None:
        """It is at rest: silence does no harm."""
        if self.alarm is not None:
            self.alarm.cancel()
            self.alarm = None


class Supervisor:
    """The two channels and the requests of one scene port.

    Attributes:
        simulation: whose clock it is.
        clocks: everybody who is told of it.
    """

    def __init__(
        self,
        supervision: Supervision,
        simulation: Simulation,
        reset: Callable[[], Mapping[str, object]],
        call: Callable[[str, float, float], bool],
    ) -> None:
        """Begin with nobody.

        Args:
            supervision: of the sessions.
            simulation: see the attributes.
            reset: puts everything back to where it was at first, as far as it can, and says what.
            call: lets a victim call from one simulated s to another; False: there is none of that
                name.
        """
        self.simulation = simulation
        self.clocks: set[Clock] = set()
        self._supervision, self._reset, self._call = supervision, reset, call
        self._hub = _Hub(supervision)
        self._pacing = asyncio.Lock()
        self._holds: dict[str, _Hold] = {}  # by `host:port` of the controller

    @property
    def channels(self) -> Mapping[str, Channel]:
        """For the scene port."""
        return {"lines": lambda one: Lines(self._hub, one), "clock": lambda one: Clock(self, one)}

    @property
    def requests(self) -> Mapping[str, Request]:
        """For the scene port, if supervising is allowed."""
        return {
            "take": _telling(self._take),
            "drive": _telling(self._drive),
            "hand_back": _telling(self._hand_back),
            "pace": _telling(self._pace),
            "call": _telling(self._calls),
        }

    # -- driving -----------------------------------------------------------------------------

    def _find(self, fields: Mapping[str, object]) -> Session:
        robot = read_text(fields, "robot", LONGEST_NAME)
        peer = read_text(fields, "session", LONGEST_NAME)
        if robot is None and peer is None:
            raise SceneError('"robot" or "session" has to say whom you mean')
        return self._supervision.find(robot, peer)

    async def _take(self, one: Subscriber, fields: Mapping[str, object]) -> Mapping[str, object]:
        session = self._find(fields)
        by = f"{read_text(fields, 'by', LONGEST_NAME) or 'somebody'} ({one.peer})"
        self._supervision.take(session, by)
        hold = _Hold(session, session.robot or "", by, one)
        self._holds[session.peer] = hold
        one.leaving.callback(self._gone, hold)
        self._tell("taken", hold)
        return {"robot": hold.robot, "session": session.peer, "by": by}

    def _mine(self, one: Subscriber, fields: Mapping[str, object]) -> _Hold:
        session = self._find(fields)
        hold = self._holds.get(session.peer)
        if hold is None:
            raise SceneError(f"{session.robot} is not yours: nobody holds it; take it first")
        if hold.owner is not one:
            raise SceneError(f"{session.robot} is not yours: {hold.by} holds it")
        return hold

    async def _drive(self, one: Subscriber, fields: Mapping[str, object]) -> Mapping[str, object]:
        hold = self._mine(one, fields)
        line = read_text(fields, "line", LONGEST_LINE)
        if line is None:
            raise SceneError('"line" has to be a command, such as "DRIVE {Left 1} {Right 1}"')
        at_rest = self._supervision.drive(hold.session, hold.by, line)
        hold.quiet()
        if not at_rest:
            loop = asyncio.get_running_loop()
            hold.alarm = loop.call_later(SILENCE, self._silent, hold)
        return {"robot": hold.robot}

    async def _hand_back(
        self, one: Subscriber, fields: Mapping[str, object]
    ) -> Mapping[str, object]:
        hold = self._mine(one, fields)
        suspended = self._release(hold, fields.get("resume") is True)
        return {"robot": hold.robot, "suspended": suspended}

    def _silent(self, hold: _Hold) -> None:
        hold.alarm = None
        self._supervision.halt(hold.session, hold.by)
        self._tell("stopped", hold, why="no word for half a second")

    def _gone(self, hold: _Hold) -> None:
        """The client has gone; nothing if it has handed back."""
        if self._holds.get(hold.session.peer) is hold:
            self._release(hold, False)

    def _release(self, hold: _Hold, resume: bool) -> int:
        hold.quiet()
        del self._holds[hold.session.peer]
        suspended = 0
        with contextlib.suppress(UsarsimError):  # its controller has gone, too
            suspended = self._supervision.hand_back(hold.session, hold.by, resume)
        self._tell("handed_back", hold, suspended=suspended)
        return suspended

    def _tell(self, action: str, hold: _Hold, **more: object) -> None:
        about = {"robot": hold.robot, "session": hold.session.peer, "by": hold.by}
        self._announce(action, {**about, **more})

    def _announce(self, action: str, more: Mapping[str, object]) -> None:
        time = round(self.simulation.now, 3)
        self._hub.tell({"type": "intervention", "action": action, "time": time, **more})

    # -- victims -----------------------------------------------------------------------------

    async def _calls(self, one: Subscriber, fields: Mapping[str, object]) -> Mapping[str, object]:
        """A victim calls from the next step on."""
        victim = read_text(fields, "victim", LONGEST_NAME)
        if victim is None:
            raise SceneError('"victim" has to be the name of one')
        seconds = read_number(fields, "seconds", 0.0, LONGEST_CALL) if "seconds" in fields else None
        since = self.simulation.now + self.simulation.timestep
        until = math.inf if seconds is None else since + seconds
        if not self._call(victim, since, until):
            raise SceneError(f"nobody is called {victim}")
        told = {"victim": victim} | ({} if seconds is None else {"seconds": seconds})
        self._announce("calls", {**told, "by": one.peer})
        return told

    # -- the clock ---------------------------------------------------------------------------

    async def _pace(self, one: Subscriber, fields: Mapping[str, object]) -> Mapping[str, object]:
        action, told = fields.get("action"), dict[str, object]()
        change: Callable[[], object]
        if action == "pause":
            change = self.simulation.pause
        elif action == "run":
            change = self.simulation.go_on
        elif action == "step":
            seconds = read_number(fields, "seconds", self.simulation.timestep, LONGEST_STEP)
            told["seconds"] = seconds
            change = lambda: self.simulation.go_on(seconds)  # noqa: E731
        elif action == "speed":
            factor = read_number(fields, "factor", *SPEEDS)
            told["factor"] = factor
            change = lambda: self.simulation.set_speed(factor)  # noqa: E731
        elif action == "reset":
            change = lambda: told.update(self._reset())  # noqa: E731
        else:
            raise SceneError('"action" has to be pause, run, step, speed or reset')
        try:
            async with self._pacing:  # a reset lets time stand still and go on as it went
                await asyncio.to_thread(change)
        except ValueError as error:
            raise SceneError(str(error)) from None
        self._announce(str(action), {**told, "by": one.peer})
        for clock in self.clocks:
            clock.changed()
        return {"paused": self.simulation.paused, "time": round(self.simulation.now, 3), **told}


Handler = Callable[[Subscriber, Mapping[str, object]], Awaitable[Mapping[str, object]]]


def _telling(handler: Handler) -> Request:
    """A request whose errors are told to the client."""

    async def ask(one: Subscriber, fields: Mapping[str, object]) -> Mapping[str, object]:
        try:
            return await handler(one, fields)
        except UsarsimError as error:
            raise SceneError(str(error)) from None

    return ask
