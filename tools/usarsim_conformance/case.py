"""What a check function is given: connections, robots, places, and words for what it finds."""

from __future__ import annotations

import asyncio
import itertools
import secrets
from collections import Counter
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NoReturn, TypeVar

from usarsim_conformance.clock import SimulatedClock
from usarsim_conformance.control import REPLY, ControlClient, Pose, Robot
from usarsim_conformance.lines import Line
from usarsim_conformance.places import Place, Places
from usarsim_conformance.registry import Crowded, Failed, Inconclusive, NotApplicable
from usarsim_conformance.survey import Survey, Target
from usarsim_conformance.wire import Transcript, Wire

ROLES: dict[str, tuple[str, ...]] = {
    "aerial": ("AirRobot", "ARDrone", "quadrotor"),
    "ackerman": ("BasicAckermanRobot", "FrontAckerman", "Sedan", "Hummer"),
    "flippers": ("Kenaf", "TeleMax", "Tarantula"),
    "arm": ("P3AT_arm", "TeleMax", "KR60"),
    "gripper": ("P3AT_arm", "HandBot", "KR60"),
    "post": ("GripperBase",),
    "legged": ("Nao", "ERS", "QRIO"),
    "underwater": ("Submarine", "Passarola"),
}
"""Robot classes that can play a part; all stood in the original's rosters. Small ones come first:
a car or an industrial arm reaches over the start places beside its own, so checks with roles that
only such robots may play are exclusive."""

PATIENCE = 15.0
"""s of simulated time until a robot is given up; a server may build it beside the running world,
and a busy machine must not look like a missing robot."""

Made = TypeVar("Made")


@dataclass
class Run:
    """What the cases of one run have in common."""

    target: Target  # the server, as the user describes it
    survey: Survey  # what is known of it
    clock: SimulatedClock  # simulated time
    places: Places  # where robots can be put
    slots: asyncio.Semaphore | None = None  # how many checks may be at work; None for any number
    is_beside: bool = False  # whether other checks are at work meanwhile
    numbers: itertools.count[int] = field(default_factory=lambda: itertools.count(1))
    lanes: itertools.count[int] = field(default_factory=itertools.count)  # places far away
    tag: str = field(default_factory=lambda: secrets.token_hex(3))
    """Part of every robot's name: ComServer keeps the names of earlier runs for ever."""
    shared: dict[tuple[str, str], asyncio.Task[Any]] = field(default_factory=dict)
    askers: Counter[tuple[str, str]] = field(default_factory=Counter)  # who wait for what is shared


class Case:
    """One check at work, in one dialect.

    Attributes:
        run: what it shares with others.
        dialect: that it asks the server to speak.
        transcript: what goes over its own connections.
    """

    def __init__(self, run: Run, dialect: str, is_shared: bool = False) -> None:
        self.run = run
        self.dialect = dialect
        self.transcript = Transcript()
        self._borrowed: list[Transcript] = []
        self._is_shared = is_shared  # makes something for checks, which may have places meanwhile
        self._slot_left = is_shared  # it never had one
        self._wires: list[Wire] = []
        self._taken: list[Place] = []

    @property
    def target(self) -> Target:
        """The server, as the user describes it."""
        return self.run.target

    @property
    def survey(self) -> Survey:
        """What is known of the server."""
        return self.run.survey

    @property
    def clock(self) -> SimulatedClock:
        """Simulated time; all waiting is measured by it."""
        return self.run.clock

    @property
    def robot_class(self) -> str:
        """Class of the robots of most checks.

        Raises:
            Inconclusive: if no robot could be spawned at all.
        """
        if self.survey.robot is None:
            raise Inconclusive("no robot could be spawned; name a class with --robot")
        return self.survey.robot

    # Words for what was found.

    def fail(self, reason: str) -> NoReturn:
        """The rule is broken."""
        raise Failed(reason)

    def expect(self, condition: object, reason: str) -> None:
        """Fail with the reason unless the condition holds."""
        if not condition:
            raise Failed(reason)

    def expect_names(
        self, line: Line, wanted: Sequence[str], found: Sequence[str] | None = None
    ) -> None:
        """Fail unless segments of a line have these names in this order.

        Args:
            line: that has them.
            wanted: the right names.
            found: those that are judged; all of the line by default.
        """
        found = line.names if found is None else found
        if tuple(found) != tuple(wanted):
            raise Failed(
                f"segments are {' '.join(found) or 'none'}, not {' '.join(wanted)}: {line}"
            )

    def expect_silence(self, lines: Sequence[Line], after: str) -> None:
        """Fail if lines came after something that must have no answer."""
        if lines:
            raise Failed(f"{lines[0]} comes after {after}, not nothing")

    async def expect_alive(self, client: ControlClient, after: str, within: float = REPLY) -> None:
        """Fail unless a connection still answers after something, in so many simulated s."""
        if not await client.is_alive(within):
            raise Failed(f"GETSTARTPOSES has no answer within {within:g} s after {after}")

    def skip(self, reason: str) -> NoReturn:
        """The rule does not apply to this server."""
        raise NotApplicable(reason)

    def give_up(self, reason: str) -> NoReturn:
        """The rule cannot be judged."""
        raise Inconclusive(reason)

    def need(self, condition: object, reason: str) -> None:
        """Give the check up with the reason unless the condition holds."""
        if not condition:
            raise Inconclusive(reason)

    # Connections.

    async def open(self, service: str, label: str = "", tiny: bool = False) -> Wire:
        """Connect to a service; the connection is closed at the end of the check.

        Args:
            service: one of `registry.SERVICES`.
            label: for the transcript.
            tiny: see `Wire.open`.

        Raises:
            NotApplicable: if the user named no port of the service.
            Failed: if nobody accepts the connection.
        """
        port = self.target.ports.get(service)
        if port is None:
            raise NotApplicable(f"no port of {service} was named")
        label = label or f"{service}{len(self._wires) + 1}"
        wire = await Wire.open(
            self.target.host, port, self.transcript, label, self.clock, tiny=tiny
        )
        self._wires.append(wire)
        return wire

    async def connect(self, greet: bool = True, tiny: bool = False) -> ControlClient:
        """A new connection to the control port.

        Args:
            greet: read the first line, if there is one, so that it is not in the way.
            tiny: see `Wire.open`.
        """
        label = f"c{len(self._wires) + 1}"
        client = ControlClient(await self.open("control", label, tiny))
        if greet:
            await client.line(REPLY if self.survey.greeting is not None else 0.3)
        return client

    # Robots.

    async def place(self) -> Place:
        """A free place, until the check ends.

        Raises:
            Inconclusive: if the check wants more places than there are.
        """
        if len(self._taken) >= len(self.run.places.all):
            raise Inconclusive(f"the server has places for {len(self._taken)} robots only")
        place = await self.run.places.take(last=bool(self._taken) or self._is_shared)
        self._taken.append(place)
        return place

    @property
    def has_place(self) -> bool:
        """Whether the check has taken a place."""
        return bool(self._taken)

    def new_name(self) -> str:
        """A robot name that nobody else has, nor had in an earlier run."""
        return f"Kit{self.run.tag}x{next(self.run.numbers)}"

    @property
    def dialect_segment(self) -> str:
        """Segment of INIT that asks for the dialect of this case; empty or with a blank before."""
        return self.survey.dialects.get(self.dialect, "")

    def init(self, place: Place, name: str = "", class_name: str = "", extra: str = "") -> str:
        """An INIT command in the plainest spelling, for the dialect of this case."""
        named = f" {{Name {name}}}" if name else ""
        return (
            f"INIT {{ClassName USARBot.{class_name or self.robot_class}}}{named} {place.segments}"
            f"{extra}{self.dialect_segment}"
        )

    async def spawn(
        self,
        role: str = "",
        *,
        place: Place | None = None,
        init: str | None = None,
        extra: str = "",
        client: ControlClient | None = None,
        class_name: str = "",
    ) -> Robot:
        """A robot that has sent its first STA.

        Args:
            role: key of `ROLES`; empty for the robot of most checks.
            place: where; a free one by default.
            init: the whole command instead of the usual one.
            extra: further segments of INIT, with a blank before.
            client: a connection to use; a new one by default.
            class_name: class, instead of the one that the role names.

        Raises:
            NotApplicable: if the server has no robot for the role.
            Inconclusive: if no STA comes.
        """
        class_name = class_name or (await self.class_for(role) if role else self.robot_class)
        place = place or await self.place()
        client = client or await self.connect()
        name = self.new_name()
        await client.send(init or self.init(place, name, class_name, extra))
        first = await client.maybe(lambda line: line.head == "STA", PATIENCE)
        if first is None:
            raise Inconclusive(f"{class_name} sent no STA within {PATIENCE:g} s of its INIT")
        return Robot(client, name, class_name, place, first)

    async def appears(self, init: str) -> Robot:
        """A robot that must appear after this INIT.

        Raises:
            Failed: if none does.
        """
        client = await self.connect()
        await client.send(init)
        first = await client.maybe(lambda line: line.head == "STA", PATIENCE)
        if first is None:
            raise Failed(f"no robot appeared after {init}")
        return Robot(client, "", "", Place(None), first)

    async def class_for(self, role: str) -> str:
        """Class of the server that can play a part.

        Raises:
            NotApplicable: if there is none.
        """
        found = await self.shared(f"role {role}", lambda case: case._find(ROLES[role]), dialect="")
        if found is None:
            raise NotApplicable(f"none of {', '.join(ROLES[role])} could be spawned")
        return found

    async def _find(self, classes: tuple[str, ...]) -> str | None:
        for class_name in classes:
            client = await self.connect()
            place = await self.place()
            await client.send(self.init(place, self.new_name(), class_name))
            if await client.maybe(lambda line: line.head == "STA", PATIENCE) is not None:
                return class_name
            self.release()
        return None

    async def drive(self, robot: Robot, command: str, seconds: float) -> tuple[Pose, Pose]:
        """Where a robot is before a command and after a simulated time under it."""
        before = await robot.pose()
        await robot.under(command, seconds=seconds)
        return before, await robot.pose()

    async def soon(self, happened: Callable[[], Awaitable[bool]], within: float) -> bool:
        """Whether something happens within a simulated time; looks ten times a second.

        Args:
            happened: looks whether it has.
            within: s of simulated time.
        """
        latest = self.clock.after(within)
        while not (found := await happened()) and self.clock.now < latest:
            await self.clock.sleep(0.1)
        return found

    # Things that several checks use.

    async def shared(
        self, key: str, make: Callable[[Case], Awaitable[Made]], dialect: str | None = None
    ) -> Made:
        """Something made once for all checks: a recording, a list of what a robot has.

        Hold no place while you wait for it. What went over the wire while it was made goes into
        the transcript of every check that uses it.

        Args:
            key: name of it.
            make: makes it, with a case of its own.
            dialect: made once for each; that of this case by default, empty for the native one.

        Raises:
            NotApplicable: if what is wanted does not exist.
            Inconclusive: if it could not be made.
        """
        dialect = self.dialect if dialect is None else dialect
        asked = key, dialect
        task = self.run.shared.get(asked)
        if task is None:
            maker = Case(self.run, dialect or self.survey.native, is_shared=True)
            task = asyncio.create_task(_make(maker, make))
            self.run.shared[asked] = task
        if not task.done() and self.run.is_beside:
            self.leave_slot()
        self.run.askers[asked] += 1
        try:
            made, transcript, error = await asyncio.shield(task)
        finally:
            self.run.askers[asked] -= 1
            if not task.done() and not self.run.askers[asked]:
                # Given up by all: its robots have places and tiles that others want.
                del self.run.shared[asked]
                task.cancel()
        self._borrowed.append(transcript)
        if isinstance(error, NotApplicable):
            raise NotApplicable(str(error))
        if isinstance(error, Crowded):
            self.run.shared.pop(asked, None)  # it is made anew when there is room
            raise Crowded(str(error))
        if error is not None:
            raise Inconclusive(f"{key} could not be had: {error}")
        return made  # type: ignore[no-any-return]

    def leave_slot(self) -> None:
        """Let the next check begin: this one is done, or waits for something shared."""
        if not self._slot_left and self.run.slots is not None:
            self.run.slots.release()
        self._slot_left = True

    def entries(self) -> tuple[str, ...]:
        """What went over the wire, that of shared things first."""
        transcripts = (*self._borrowed, self.transcript)
        return tuple(entry for one in transcripts for entry in one.entries())

    def release(self) -> None:
        """Hang up everywhere and give all places back."""
        for wire in self._wires:
            wire.close()
        for place in self._taken:
            self.run.places.give_back(place)
        self._wires, self._taken = [], []


async def _make(
    case: Case, make: Callable[[Case], Awaitable[Made]]
) -> tuple[Made | None, Transcript, Exception | None]:
    try:
        return await make(case), case.transcript, None
    except (Failed, Inconclusive, NotApplicable) as error:
        return None, case.transcript, error
    finally:
        case.release()
