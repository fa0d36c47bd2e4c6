"""The gateway itself: robots on one side, pages on the other, and the rules between them.

Everything runs on one event loop. What a page asks for is checked, decided by the rules, and put
where a robot's own task sends it; nothing here waits for a page or for a robot that drives.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import math
from collections.abc import Coroutine, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from usarsim_client import (
    HangupError,
    NameTakenError,
    ProtocolError,
    Robot,
    Server,
    SpawnError,
    readings,
    reports,
)
from usarsim_client.cameras import Tile
from usarsim_client.decoder import Value
from usarsim_client.scene import Poses
from usarsim_operator.alarms import Alarms, StuckWatch
from usarsim_operator.allowance import Allowance
from usarsim_operator.arbiter import Arbiter
from usarsim_operator.autonomy import Autonomy
from usarsim_operator.camera_feeds import CameraFeeds
from usarsim_operator.hearing import Interest
from usarsim_operator.impairment import Plan
from usarsim_operator.injects import Injects
from usarsim_operator.lockstep import Lockstep
from usarsim_operator.marks import Marks
from usarsim_operator.observers import MissionRow, Observers
from usarsim_operator.occupancy import OccupancyMap
from usarsim_operator.pages import Page
from usarsim_operator.pictures import Grid
from usarsim_operator.recorder import Recorder
from usarsim_operator.robot_link import Driven, Send
from usarsim_operator.roles import Role
from usarsim_operator.scene_link import Message, SceneLink
from usarsim_operator.shows import Shows
from usarsim_operator.signals import BASE, Signals
from usarsim_operator.timed_moves import Rotate
from usarsim_operator.truth import Truth, wire_pose
from usarsim_operator.watchdog import Watchdog
from usarsim_operator.world_clock import WorldClock
from usarsim_server.base.logs import Log
from usarsim_server.protocol.values import Vector

MOST_ROBOTS = 250
"""Robots of a session; binary messages have one byte for their index."""

_OF_POINTS = readings.LaserScan | readings.Scan3D | readings.DepthStrip | readings.PointCloud


@dataclass(frozen=True, slots=True)
class Settings:
    """What a gateway is given.

    Attributes:
        host, port: of the server. image_port: of its pictures.
        scene: host and port of its scene port; None: it has none. scene_token: of that port.
        latch: file of the emergency stop; None: it ends with the gateway.
        delay: s by which viewers see everything later.
        impairment: how bad the links to pages are; None: as they are.
        tiles: columns and rows of the image port's picture, for servers that tell no tiles.
        spectator: x, y, width, height of the part of it that shows the world from outside, pixels.
        patience: s of wall time that an answer of the server may take.
        wireless: port of the server's wireless simulation; None: it has none. base: name of the
            operator's base there.
        lockstep: the server is in lockstep; else that is found out by the first robot of ours.
        pace: simulated s per s of wall time in lockstep; infinity for as fast as it goes.
        allowance: what operators may do.
    """

    host: str
    port: int
    image_port: int = 5003
    scene: tuple[str, int] | None = None
    scene_token: str = ""
    latch: Path | None = None
    delay: float = 10.0
    impairment: Plan | None = None
    tiles: Grid | None = None
    spectator: Tile | None = None
    wireless: int | None = None
    base: str = BASE
    lockstep: bool = False
    pace: float = 1.0
    patience: float = 10.0
    allowance: Allowance = field(default_factory=Allowance)


class Station:
    """What is there: robots, pages, locks, alarms, marks, a map.

    Attributes:
        server: the way to the server. robots: all that are known, by name.
        pages: those that have said who they are, by id.
        ready: seats of operators who are ready for a trial to begin, by the ids of their pages.
        waits: a trial waits for them.
        began: simulated s from which the mission counts: 0, or when the world was reset.
        world: its clock, by which reports grow old; it stands while the world is paused.
        recorder: one of them that keeps the session; None if nobody wants that.
        observers: that one, and who else keeps what happens.
        mission: how the mission goes; None without one.
        truth: where robots truly are, if the scene port tells.
        signals: how well the radio reaches our robots; None where that is not asked.
        lockstep: makes the world go on from tick to tick; None where it goes by itself.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.server = Server(
            settings.host,
            settings.port,
            image_port=settings.image_port,
            timeout=settings.patience,
        )
        self.robots: dict[str, Driven] = {}
        self.pages: dict[int, Page] = {}
        self.ready: dict[int, int] = {}
        self.waits = False
        self.began = 0.0
        self.log = Log("console")
        self.arbiter = Arbiter(settings.latch, self._note)
        self.watchdog = Watchdog()
        self.world = WorldClock(lambda: self.now)
        self.alarms = Alarms(self._note)
        self.marks = Marks()
        self.map = OccupancyMap()
        self.autonomy = Autonomy(self)
        self.injects = Injects(self)
        self.scene: SceneLink | None = None
        self.recorder: Recorder | None = None
        self.observers = Observers()
        self.mission: MissionRow | None = None
        self.signals: Signals | None = None
        self.stuck: dict[str, StuckWatch] = {}
        self._shows = Shows(self)
        self.cameras = CameraFeeds(self, self._shows)
        self.asked: dict[tuple[str, int], int | None] = {}
        self._index = itertools.count()
        self._page_ids = itertools.count(1)
        self._tasks: set[asyncio.Task[None]] = set()
        self.truth = Truth()
        self.lockstep = Lockstep(self, settings.pace) if settings.lockstep else None

    # -- beginning and end --------------------------------------------------------------------

    async def open(self) -> None:
        """Connect to the server.

        Raises:
            OSError, ProtocolError: if nobody is there who speaks the protocol.
        """
        await self.server.__aenter__()
        self.cameras.begin()
        if (port := self.settings.wireless) is not None:
            self.signals = Signals(
                self.settings.host,
                port,
                self.settings.base,
                lambda: bool(self.pages),
                lambda: [one.name for one in self.robots.values() if one.own],
            )
            self.background(self.signals.run())
        if self.settings.scene is not None:
            host, port = self.settings.scene
            token = self.settings.scene_token
            self.scene = SceneLink(host, port, token, self._poses, self._told, self._others)

    def record(self, path: Path) -> None:
        """Keep everything from now on in a new file.

        Raises:
            RecordingError: if it cannot be written.
        """
        self.recorder = Recorder(self, path)
        self.pages[self.recorder.id] = self.recorder  # no watchdog: it says nothing
        self.observers.add(self.recorder)
        self.background(self.recorder.run())
        self.look()

    async def close(self) -> None:
        """Let everything go; robots of ours leave the world."""
        for robot in self.robots.values():
            robot.stop()
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        if self.recorder is not None:
            self.recorder.close()
        if self.scene is not None:
            await self.scene.close()
        await self.cameras.close()
        for robot in list(self.robots.values()):
            await robot.close()
        await self.server.close()

    def background(self, work: Coroutine[Any, Any, None]) -> None:
        """Do something that waits, beside everything else."""
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        if self.lockstep is not None:
            self.lockstep.gather(task)

    @property
    def hasty(self) -> bool:
        """Whether simulated time goes as fast as it can: nobody could look at all of it."""
        return self.lockstep is not None and math.isinf(self.lockstep.pace)

    @property
    def now(self) -> float:
        """s of the clock of the rules: the gateway's, in lockstep simulated time."""
        return asyncio.get_running_loop().time() if self.lockstep is None else self.lockstep.time

    @property
    def wall(self) -> float:
        """s of the gateway's clock."""
        return self.now if self.lockstep is None else asyncio.get_running_loop().time()

    @property
    def paused(self) -> bool:
        """Whether the world stands still, as the server told last."""
        return bool(self.scene and self.scene.clock.get("paused"))

    @property
    def time(self) -> float:
        """Newest simulated s that anybody told."""
        if self.lockstep is not None:
            return self.lockstep.time
        return max([self.truth.time, *(one.telemetry.time for one in self.robots.values())])

    def _note(self, what: str, facts: Mapping[str, object]) -> None:
        self.log.bind(**facts).info(what)
        self.observers.note("note", {"what": what, **facts})

    # -- robots -------------------------------------------------------------------------------

    async def spawn(
        self,
        class_name: str,
        name: str | None = None,
        start: str | None = None,
        place: Vector | None = None,
        turn: Vector | None = None,
    ) -> Driven:
        """Bring a robot of our own into the world; turn: roll, pitch, yaw (rad), beside a place.

        Raises:
            SpawnError: if the server refuses, or a robot has that name.
        """
        if name in self.robots:
            raise SpawnError(f"there is a robot {name} already")
        if len(self.robots) >= MOST_ROBOTS:
            raise SpawnError(f"a session has at most {MOST_ROBOTS} robots")
        if start is None and place is None:
            with contextlib.suppress(TimeoutError):
                poses = await self.server.start_poses()
                start = poses[len(self.robots) % len(poses)].tag if poses else None
        while True:
            named = name or f"Console{next(self._page_ids)}"
            try:
                robot = await self.server.spawn(
                    class_name, named, start=start, location=place, rotation=turn
                )
            except NameTakenError:
                if name:
                    raise
                continue  # another console has brought one of this name
            return self.adopt(robot)

    def adopt(self, robot: Robot) -> Driven:
        """Drive a robot that is in the world by a connection of ours."""
        driven = self._add(robot.name, robot.class_name, robot.link.send, own=True)
        driven.listen(robot, self._heard, self._lost)
        if self.lockstep is not None:
            self.lockstep.enrol(driven, robot)
        self.background(self._learn(driven, robot))
        return driven

    async def _learn(self, driven: Driven, robot: Robot) -> None:
        await driven.learn()
        if self.lockstep is None and robot.state.ticks:
            self.lockstep = Lockstep(self, self.settings.pace)
            for one in self.robots.values():
                if one.robot is not None:
                    self.lockstep.enrol(one, one.robot)
        self.look()
        if driven.camera and self.robots.get(driven.name) is driven:
            self.cameras.add(driven, robot)
            self.look()

    def _add(self, name: str, class_name: str, send: Send, *, own: bool) -> Driven:
        if (before := self.robots.get(name)) is not None:  # the scene port told of ours first
            self.background(before.close())
            index = before.index
        else:
            used = {one.index for one in self.robots.values()}
            index = next(one for one in range(256) if one not in used)
        driven = Driven(name, class_name, index, send, own)
        self.robots[name] = driven
        self.stuck[name] = StuckWatch()
        self.event(name, "spawned", class_name)
        return driven

    async def remove(self, name: str) -> None:
        """Let a robot go."""
        driven = self.robots.pop(name, None)
        if driven is None:
            return
        self.watchdog.stopped(name)
        self.stuck.pop(name, None)
        for one in (self.arbiter, self.alarms, self._shows, self.autonomy, self.truth):
            one.forget(name)
        self.event(name, "left", None)
        await self.cameras.forget(name)
        if self.signals is not None:
            await self.signals.forget(name)
        await driven.close()

    def _lost(self, driven: Driven) -> None:
        if self.robots.get(driven.name) is driven:
            self.background(self.remove(driven.name))

    def _others(self) -> None:
        """Robots of others have come or gone."""
        present = None if self.scene is None else self.scene.present
        things = () if present is None else present.things
        there = {one.name: one for one in things if one.what == "robot"}
        for name, thing in there.items():
            if name not in self.robots and len(self.robots) < MOST_ROBOTS:
                self._add(name, thing.class_name, self._instead(name), own=False)
        for name, driven in list(self.robots.items()):
            if not driven.own and name not in there:
                self.background(self.remove(name))

    def _instead(self, name: str) -> Send:
        async def send(data: bytes) -> None:
            if self.scene is not None and self.arbiter.holders.get(name) is not None:
                for line in data.decode("latin-1").splitlines():
                    await self.scene.request("drive", robot=name, line=line)

        return send

    # -- what robots say ----------------------------------------------------------------------

    def _heard(self, driven: Driven, value: Value) -> None:
        if self.lockstep is None:
            self.take(driven, value)
        else:
            self.lockstep.collect(driven, value)

    def take(self, driven: Driven, value: Value) -> None:
        """A robot of ours has said something that counts now."""
        now = self.now
        for change in driven.telemetry.feed(value, self.world.time):
            self.event(driven.name, change.kind, change.value)
            if change.kind == "bumper" and driven.telemetry.bumpers[getattr(value, "name", "")]:
                self.alarms.see(driven.name, "collision", True, "a bumper is pressed", self.time)
        if isinstance(value, reports.MissionState):
            driven.mounts.moved(value)
        if isinstance(value, readings.LaserScan) and not driven.clouds.nods(value.name):
            self.autonomy.scan(driven.name, value)
            self._shows.scan(driven, value, now)
        elif isinstance(value, _OF_POINTS):
            self._shows.points(driven, value)
        moved = isinstance(value, readings.Pose | readings.Odometry)
        if moved and type(value).__name__ == driven.telemetry.source:
            pose = driven.telemetry.pose
            if pose is not None and driven.own:
                self._follow(driven, pose[:3], pose[5], driven.telemetry.pose_time)
                self.autonomy.step(driven)

    def _follow(self, driven: Driven, place: Vector, yaw: float, time: float) -> None:
        """Go on with a timed move, if there is one."""
        if driven.move is None:
            return
        powers = driven.move.report(place, yaw, time)
        if powers.done or powers.failed:
            self.end_move(driven, "done" if powers.done else "aborted", powers.failed)
            return
        turns = isinstance(driven.move, Rotate)
        data = (driven.motion.spin if turns else driven.motion.ahead)(powers.left)
        driven.tell_motion(data, 0.0)
        self.observers.command(driven.name, "timed_move", data)

    def end_move(self, driven: Driven, how: str, why: str = "") -> None:
        """A timed move is over: `done` or `aborted`; the robot stops."""
        if driven.move is None:
            return
        gone, driven.move = driven.move.gone, None
        self.look()
        driven.stop()
        self.observers.command(driven.name, "timed_move", driven.motion.stop)
        self.event(driven.name, "timed_move", how, why=why, gone=gone)

    def stop(self, driven: Driven, why: str) -> None:
        """Stop a robot, whatever it does."""
        driven.stop()
        self.autonomy.stopped(driven.name)
        self.observers.command(driven.name, "watchdog", driven.motion.stop)
        self.watchdog.stopped(driven.name)
        self.end_move(driven, "aborted", why)

    def _poses(self, poses: Poses) -> None:
        self.truth.take(poses, self.world.time)
        self._shows.poses(poses)
        present = None if self.scene is None else self.scene.present
        for driven in self.robots.values():
            if driven.move is not None and not driven.own and present is not None:
                row = poses.of(present.find(driven.name))
                if row is not None:
                    place, turned = wire_pose(row)
                    self._follow(driven, place, turned[2], poses.time)

    def _told(self, message: Message) -> None:
        """Interventions are kept, lines shown; the clock says how fast reports grow old."""
        if message["type"] == "clock":
            speed = message.get("speed")
            slowed = 1.0 if speed is None else min(1.0, float(speed))
            held = self.paused and self.lockstep is None
            self.world.go_at(0.0 if held else slowed if self.lockstep is None else 1.0)
            return
        if message["type"] == "lines":
            self._shows.lines(message)
            return
        facts = {key: message[key] for key in message if key != "type"}
        self.log.bind(**facts).info("intervention")
        self.observers.note("intervention", facts)

    def begin_anew(self, by: str, blocked: Sequence[str] = ()) -> None:
        """The server has put its world back: so begin the mission's clock, marks, alarms and ways.

        Args:
            by: who has asked for it. blocked: what could not be put back, and why.
        """
        self.began = self.time
        self.marks.clear()
        self.alarms.clear()
        for driven in self.robots.values():
            driven.telemetry.forget_way()
            self.stuck[driven.name] = StuckWatch()
        told = f"{by} has reset the world" + "".join(f"; {one}" for one in blocked)
        self._note("reset", {"by": by, "blocked": list(blocked)})
        self.event("", "message", told)

    # -- pages --------------------------------------------------------------------------------

    def join(self, page: Page) -> None:
        """A page has said who it is."""
        self.consider(page)
        if self.lockstep is not None and self.lockstep.defer(page, True):
            return
        self.pages[page.id] = page
        self.watchdog.heard(page.id, self.now)
        facts: dict[str, object] = {"page": page.id, "role": page.role.value, "name": page.name}
        facts["seat"] = page.seat
        if self.settings.impairment is not None:
            facts |= asdict(self.settings.impairment.of(page.name))
        self._note("page comes", facts)
        self.look()

    def consider(self, page: Page) -> None:
        """Note whether an operator is ready for a trial to begin."""
        if page.role is Role.OPERATOR and page.ready:
            self.ready[page.id] = page.seat
        else:
            self.ready.pop(page.id, None)

    def new_id(self) -> int:
        """Of a page."""
        return next(self._page_ids)

    def leave(self, page: Page) -> None:
        """A page has gone: what it moved stops, what it held is free."""
        self.ready.pop(page.id, None)
        if self.lockstep is not None and self.lockstep.defer(page, False):
            return
        if self.pages.pop(page.id, None) is None:
            return
        robots = {*self.watchdog.gone(page.id), *self.arbiter.gone(page.id)}
        robots |= {one.name for one in self.robots.values() if one.move and one.mover == page.id}
        for name in sorted(robots):
            self.release(name, "its page has gone")
        self.asked = {key: id for key, id in self.asked.items() if key[1] != page.id}
        gone: dict[str, object] = {"page": page.id}
        if page.limits.refused:
            gone["refused"] = page.limits.refused
        if page.link is not None:
            gone |= {"frames_sent": page.link.out.sent, "frames_lost": page.link.out.lost}
        self._note("page goes", gone)
        self.look()

    def release(self, name: str, why: str) -> None:
        """Stop a robot that nobody holds any more; a controller of its own drives again."""
        if (driven := self.robots.get(name)) is None:
            return
        self.stop(driven, why)
        self.event(name, "lock", None)
        self.autonomy.tell(driven)
        waits = driven.own or name in self.arbiter.failed
        if not waits and self.scene is not None:
            self.background(self._give_back(self.scene, name))

    async def _give_back(self, scene: SceneLink, name: str) -> None:
        with contextlib.suppress(ProtocolError, HangupError):
            await scene.request("hand_back", robot=name)

    def look(self) -> None:
        """Ask for what somebody looks at, no more."""
        chosen = {page.selected for page in self.pages.values()}
        chosen |= {one.name for one in self.robots.values() if one.move is not None}
        chosen |= {name for name in self.robots if self.autonomy.acts(name)}
        others = Interest.ALL_ROBOTS if self.pages else Interest.NONE
        for driven in self.robots.values():
            driven.care(Interest.CHOSEN if driven.name in chosen else others)
        self.cameras.want()
        if self.scene is not None:
            truth = any(page.role.sees_truth for page in self.pages.values())
            truth = truth or any(one.move and not one.own for one in self.robots.values())
            self.background(self.scene.look(30.0 if truth else 0.1))
            read = any(page.wants_lines for page in self.pages.values())
            self.scene.hear_lines(read or self.recorder is not None)  # that keeps interventions

    def event(self, robot: str, kind: str, value: object, **more: object) -> None:
        """Tell all pages that something happened."""
        told = {"type": "event", "robot": robot, "kind": kind, "value": value, "time": self.time}
        for page in self.pages.values():
            page.tell(told | more)
        self.observers.event(told | more)
