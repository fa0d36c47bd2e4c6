"""A robot that the gateway drives: by a connection of its own, or in place of its controller.

What is to be sent waits in one place for motion, where the newest wins, and in a short queue for
the rest; one task sends. So a server that takes nothing delays nobody, and a stop is never behind
older motion.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import Awaitable, Callable

from usarsim_client import HangupError, ProtocolError, Robot, readings
from usarsim_client.commands import say
from usarsim_client.decoder import Value
from usarsim_client.reports import Death, Report, Tick
from usarsim_client.streams import Stream
from usarsim_operator import clouds
from usarsim_operator.hearing import Ear, Interest
from usarsim_operator.motion import Motion, by_class, by_description
from usarsim_operator.mounts import Mounts
from usarsim_operator.telemetry import Telemetry
from usarsim_operator.timed_moves import Rotate, Travel

_MOST = 64  # commands that may wait beside motion

Send = Callable[[bytes], Awaitable[None]]


class Driven:
    """One robot as the station sees it.

    Attributes:
        name, class_name: of it. index: in `state`, never used again.
        own: whether the gateway brought it into the world.
        motion: how it is told to move. telemetry: what it reported.
        move: the timed move under way. mover: the page that asked for it.
        power: part of full power that it was told last.
        wheels: what a hand told it last. far: greatest range that it reported, m.
        ear: which of its lines are read. mounts: where its sensors are.
        clouds: what those of them saw that see points.
        camera: name of its camera; empty without. learned: it has answered what it is.
        fov: horizontal field of view of that camera, rad; 0 if it tells none.
        cut: nothing gets through, in either direction, as if the radio had failed.
        session: connection of its controller. robot: ours; None if it is somebody else's.
    """

    def __init__(self, name: str, class_name: str, index: int, send: Send, own: bool) -> None:
        self.name, self.class_name, self.index, self.own = name, class_name, index, own
        self.motion: Motion = by_class(class_name)
        self.telemetry = Telemetry()
        self.ear = Ear(self.telemetry, asyncio.get_running_loop().time)
        self.mounts = Mounts()
        self.clouds = clouds.Clouds(self.mounts)
        self.move: Rotate | Travel | None = None
        self.mover = 0
        self.power = 0.0
        self.cut = False
        self.robot: Robot | None = None
        self.camera = ""
        self.fov = 0.0
        self._asking = asyncio.Lock()
        self.wheels = b""
        self.far = 0.0
        self.learned = False
        self.session = ""
        self._send = send
        self._motion: bytes | None = None
        self._others: deque[bytes] = deque(maxlen=_MOST)
        self._stirred = asyncio.Event()
        self._tasks: list[asyncio.Task[None]] = [asyncio.create_task(self._write())]
        self._heard: Callable[[Driven, Value], None] = lambda driven, value: None
        self._lost: Callable[[Driven], None] = lambda driven: None
        self._held = False

    # -- telling it ---------------------------------------------------------------------------

    def tell_motion(self, data: bytes, power: float) -> None:
        """Move; what waited to move it is forgotten. power: 0 to 1."""
        if self.cut:
            return
        self._motion, self.power = data, power
        self._stirred.set()

    def stop(self) -> None:
        """Stand still, or hover, before anything else."""
        self.wheels = self.motion.stop
        self.tell_motion(self.motion.stop, 0.0)

    def look(self) -> None:
        """Have pictures taken by the sensors that take them only when asked."""
        for name in self.clouds.depth:
            self.tell(say("SET", Type="RangeImager", Name=name, Opcode="SCAN"))

    def tell(self, data: bytes) -> None:
        """Say something else; beyond a few that wait, the oldest is forgotten."""
        if not self.cut:
            self._others.append(data)
            self._stirred.set()

    def take(self) -> list[bytes]:
        """All that waits to be sent, in that order; for a robot that is on hold."""
        waiting = [*(() if self._motion is None else (self._motion,)), *self._others]
        self._motion = None
        self._others.clear()
        return waiting

    async def _write(self) -> None:
        while True:
            await self._stirred.wait()
            self._stirred.clear()
            with contextlib.suppress(OSError, ProtocolError, TimeoutError):
                while self._motion is not None or self._others:
                    if (data := self._motion) is not None:
                        self._motion = None
                        await self._send(data)
                    elif self._others:
                        await self._send(self._others.popleft())

    # -- hearing it ---------------------------------------------------------------------------

    async def learn(self) -> None:
        """Ask what it is and where its sensors are; what it does not tell stays a guess."""
        robot = self.robot
        if robot is None:
            return
        with contextlib.suppress(ProtocolError, OSError, TimeoutError):
            self.motion = by_description(self.class_name, await robot.vehicle())
        for kind in (*clouds.KINDS, "Touch"):
            with contextlib.suppress(ProtocolError, OSError, TimeoutError):
                items = (await robot.geometry(kind)).items
                self.mounts.know(items)
                if kind == "Touch":
                    self.telemetry.know_bumpers(items)
                else:
                    self.clouds.know_limits(kind, (await robot.configuration(kind)).items)
        with contextlib.suppress(ProtocolError, OSError, TimeoutError):
            carriers = (await robot.geometry("MisPkg")).items
            self.mounts.know_carriers(carriers, (await robot.configuration("MisPkg")).items)
        with contextlib.suppress(ProtocolError, OSError, TimeoutError):
            told = await robot.camera()
            self.camera, self.fov = told.name, told.fov
            self.mounts.know((await robot.geometry("Camera")).items)
        self.learned = True

    async def look_again(self) -> None:
        """Ask how wide the camera sees now: bearings in its pictures depend on it."""
        if self.robot is None:
            return
        async with self._asking:  # one answer each
            with contextlib.suppress(ProtocolError, OSError, TimeoutError):
                self.fov = (await self.robot.camera(self.camera)).fov

    def listen(
        self, robot: Robot, heard: Callable[[Driven, Value], None], lost: Callable[[Driven], None]
    ) -> None:
        """Hand on what a robot says from now on, and tell when its connection ends."""
        self.robot, self._heard, self._lost = robot, heard, lost
        robot.link.wants = self.ear.wants
        self._tasks.append(asyncio.create_task(self._pump(robot.stream(object))))

    async def _pump(self, values: Stream[object]) -> None:
        with contextlib.suppress(HangupError, OSError, ProtocolError):
            async for value in values:
                if self.cut and not isinstance(value, Tick | Death):  # time goes on all the same
                    continue
                if isinstance(value, readings.Reading | Report):
                    self._heard(self, value)
        self._lost(self)

    def hold(self, robot: Robot, keep: int) -> None:
        """From now on hear everything, however late, and send nothing but what `take` gives."""
        for task in self._tasks:
            task.cancel()
        self._held = True
        robot.link.wants, robot.link.rest, robot.link.deaf = None, 0.0, False
        self._tasks = [asyncio.create_task(self._pump(robot.stream(object, keep=keep)))]

    def care(self, interest: Interest) -> None:
        """Listen as closely as pages want to know; while it is asked what it is, closely."""
        if self.robot is None or self._held:
            return
        if self.ear.interest is Interest.NONE is not interest:
            self.telemetry.wake(asyncio.get_running_loop().time())
        self.ear.interest = interest
        self.robot.link.rest = interest.value if self.learned else 0.0
        self.robot.link.deaf = self.learned and interest is Interest.NONE

    async def close(self) -> None:
        """Let it go; a robot of ours leaves the world."""
        current = asyncio.current_task()
        tasks = [task for task in self._tasks if task is not current]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        if self.robot is not None:
            await self.robot.close()
