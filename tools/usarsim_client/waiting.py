"""The client for programs without an event loop: the same calls, which wait.

Nothing is done twice: each method here names the one that it runs, in an event loop in a thread of
its own, and has its signature and its documentation.

    with connect_blocking() as server:
        robot = server.spawn("P3AT", start="RobotStart1")
        robot.drive(left=1.0, right=1.0)
        for scan in robot.scans():
            ...
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable, Coroutine
from functools import partial, update_wrapper
from typing import Any, Concatenate, Generic, ParamSpec, Self, TypeVar, overload

from usarsim_client.participant import Participant
from usarsim_client.reports import Greeting
from usarsim_client.robot import Robot
from usarsim_client.server import Server
from usarsim_client.side_channels import GroundTruthPort, Radio, TruthPort
from usarsim_client.streams import Stream
from usarsim_client.world import Avatar, WorldController
from usarsim_server.base.closing import Closing
from usarsim_server.protocol.values import Dialect

Inner = TypeVar("Inner")
Inner_co = TypeVar("Inner_co", covariant=True)
Someone_co = TypeVar("Someone_co", bound=Participant, covariant=True)
Result = TypeVar("Result")
Value = TypeVar("Value")
Made = TypeVar("Made")
Params = ParamSpec("Params")


class Loop:
    """An event loop in a thread of its own."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()

    def run(self, work: Coroutine[Any, Any, Result]) -> Result:
        """Wait for something; whoever interrupts the wait (Ctrl-C) ends it, too."""
        if not self._thread.is_alive():
            work.close()
            raise RuntimeError("the client was closed")
        future = asyncio.run_coroutine_threadsafe(work, self._loop)
        try:
            return future.result()
        except BaseException:
            future.cancel()
            raise

    def close(self) -> None:
        """End the thread, and those that looked up addresses."""
        if self._thread.is_alive():
            self.run(self._loop.shutdown_default_executor())
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join()
            self._loop.close()


class Waiting(Closing, Generic[Inner_co]):
    """Something asynchronous whose calls wait here.

    Attributes:
        inner: that; its attributes may be read from here.
        loop: in which it lives.
    """

    def __init__(self, inner: Inner_co, loop: Loop) -> None:
        self.inner = inner
        self.loop = loop

    def close(self) -> None:
        """Hang up."""
        self.loop.run(self.inner.close())  # type: ignore[attr-defined]


class Values(Generic[Value]):
    """Values as they come, for a plain `for`.

    Attributes:
        inner: where they come from.
    """

    def __init__(self, inner: AsyncIterator[Value], loop: Loop) -> None:
        self.inner = inner
        self._loop = loop

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> Value:
        found = self._loop.run(self._next())
        if not found:
            raise StopIteration
        return found[0]

    async def _next(self) -> tuple[Value, ...]:
        try:
            return (await anext(self.inner),)
        except StopAsyncIteration:
            return ()

    @property
    def dropped(self) -> int:
        """How many values came and went before somebody took them."""
        return self.inner.dropped if isinstance(self.inner, Stream) else 0


class Method(Generic[Inner, Params, Result]):
    """A method of an inner object, whose outcome is waited for."""

    def __init__(
        self,
        method: Callable[Concatenate[Inner, Params], Any],
        outcome: Callable[[Callable[[], Any], Loop], Result],
    ) -> None:
        self._method = method
        self._outcome = outcome
        self.__doc__ = method.__doc__

    @overload
    def __get__(self, owner: None, kind: type) -> Self: ...

    @overload
    def __get__(self, owner: Waiting[Inner], kind: type) -> Callable[Params, Result]: ...

    def __get__(self, owner: Waiting[Inner] | None, kind: type) -> Self | Callable[Params, Result]:
        if owner is None:
            return self
        inner, loop, outcome = owner.inner, owner.loop, self._outcome
        method = self._method

        def call(*args: Params.args, **named: Params.kwargs) -> Result:
            return outcome(partial(method, inner, *args, **named), loop)

        return update_wrapper(call, method)


def call(
    method: Callable[Concatenate[Inner, Params], Coroutine[Any, Any, Result]],
) -> Method[Inner, Params, Result]:
    """Waits for a coroutine."""
    return Method(method, lambda begin, loop: loop.run(begin()))


def each(
    method: Callable[Concatenate[Inner, Params], AsyncIterator[Value]],
) -> Method[Inner, Params, Values[Value]]:
    """Gives values as they come."""
    return Method(method, _values)


def _values(begin: Callable[[], AsyncIterator[Value]], loop: Loop) -> Values[Value]:
    """What a method gives that is to be called in the event loop."""

    async def there() -> AsyncIterator[Value]:
        return begin()

    return Values(loop.run(there()), loop)


def made(
    method: Callable[Concatenate[Inner, Params], Coroutine[Any, Any, Result]],
    wrap: Callable[[Result, Loop], Made],
) -> Method[Inner, Params, Made]:
    """Waits for something whose calls shall wait, too."""
    return Method(method, lambda begin, loop: wrap(loop.run(begin()), loop))


class _BlockingParticipant(Waiting[Someone_co], Generic[Someone_co]):
    send = call(Participant.send)
    sync = call(Participant.sync)
    lines = each(Participant.lines)

    @property
    def name(self) -> str:
        """As asked for; empty if the server invents one."""
        return self.inner.name

    @property
    def time(self) -> float:
        """Newest simulated s that it was told; NaN before."""
        return self.inner.time

    @property
    def connected(self) -> bool:
        """Whether it is in the world, as far as we know."""
        return self.inner.connected

    def newest(self, kind: type[Value], name: str = "") -> Value | None:
        """As `Participant.newest`."""
        return self.inner.newest(kind, name)

    def stream(self, kind: type[Value], name: str = "", keep: int = 0) -> Values[Value]:
        """As `Participant.stream`."""
        return _values(lambda: self.inner.stream(kind, name, keep), self.loop)


class BlockingRobot(_BlockingParticipant[Robot]):
    """A `Robot` whose calls wait."""

    @property
    def dialect(self) -> Dialect | None:
        """What the server speaks with this robot; None before its first status."""
        return self.inner.dialect

    scans = each(Robot.scans)
    odometry = each(Robot.odometry)
    truth = each(Robot.truth)
    statuses = each(Robot.statuses)
    missions = each(Robot.missions)
    sensors = each(Robot.sensors)
    pictures = each(Robot.pictures)
    configuration = call(Robot.configuration)
    geometry = call(Robot.geometry)
    vehicle = call(Robot.vehicle)
    dimensions = call(Robot.dimensions)
    camera = call(Robot.camera)
    drive = call(Robot.drive)
    stop = call(Robot.stop)
    wheels = call(Robot.wheels)
    fly = call(Robot.fly)
    dive = call(Robot.dive)
    joint = call(Robot.joint)
    joints = call(Robot.joints)
    leg = call(Robot.leg)
    flip = call(Robot.flip)
    light = call(Robot.light)
    actuate = call(Robot.actuate)
    grip = call(Robot.grip)
    zoom = call(Robot.zoom)
    scan = call(Robot.scan)
    reset = call(Robot.reset)
    set = call(Robot.set)
    set_result = call(Robot.set_result)
    trace = call(Robot.trace)


class BlockingAvatar(_BlockingParticipant[Avatar]):
    """An `Avatar` whose calls wait."""

    statuses = each(Avatar.statuses)
    walk = call(Avatar.walk)
    pause = call(Avatar.pause)
    go_to = call(Avatar.go_to)


class BlockingWorldController(_BlockingParticipant[WorldController]):
    """A `WorldController` whose calls wait."""

    create = call(WorldController.create)
    kill = call(WorldController.kill)
    kill_all = call(WorldController.kill_all)
    move = call(WorldController.move)
    rotate = call(WorldController.rotate)
    follow = call(WorldController.follow)
    halt = call(WorldController.halt)
    conveyor = call(WorldController.conveyor)
    objects = call(WorldController.objects)


class BlockingRadio(Waiting[Radio]):
    """A `Radio` whose calls wait; roads are dialled with `socket.create_connection`."""

    strength = call(Radio.strength)
    road = call(Radio.road)
    caller = call(Radio.caller)


class BlockingGroundTruth(Waiting[GroundTruthPort]):
    """A `GroundTruthPort` whose calls wait."""

    positions = call(GroundTruthPort.positions)
    obstacles = call(GroundTruthPort.obstacles)


class BlockingTruth(Waiting[TruthPort]):
    """A `TruthPort` whose calls wait."""

    actors = call(TruthPort.actors)


class BlockingServer(Waiting[Server]):
    """A `Server` whose calls wait; closing it ends its thread."""

    start_poses = call(Server.start_poses)
    path_nodes = call(Server.path_nodes)
    closest_path_node = call(Server.closest_path_node)
    sync = call(Server.sync)
    spawn = made(Server.spawn, BlockingRobot)
    avatar = made(Server.avatar, BlockingAvatar)
    world_controller = made(Server.world_controller, BlockingWorldController)
    radio = made(Server.radio, BlockingRadio)
    ground_truth = Method(Server.ground_truth, lambda at, loop: BlockingGroundTruth(at(), loop))
    truth = Method(Server.truth, lambda at, loop: BlockingTruth(at(), loop))

    @property
    def greeting(self) -> Greeting | None:
        """What the server said first."""
        return self.inner.greeting

    def close(self) -> None:
        """Hang up; all robots leave the world."""
        try:
            super().close()
        finally:
            self.loop.close()


def _waiting(make: Callable[Params, Server]) -> Callable[Params, BlockingServer]:
    """Makes servers whose calls wait, and which are connected at once."""

    def connect(*args: Params.args, **named: Params.kwargs) -> BlockingServer:
        loop = Loop()
        try:
            return BlockingServer(loop.run(make(*args, **named).__aenter__()), loop)
        except BaseException:
            loop.close()
            raise

    return connect


connect_blocking = _waiting(Server)
"""Connect to a server, with `with`; arguments and errors as those of `Server`."""
