"""Two robots, one of which a world controller puts behind walls of the stage, and what all services
tell of the way between them then."""

from __future__ import annotations

import asyncio
import math
import re
from dataclasses import dataclass, replace

from usarsim_conformance.case import Case
from usarsim_conformance.control import ControlClient, Robot
from usarsim_conformance.lines import number
from usarsim_conformance.places import Place
from usarsim_conformance.registry import Failed, NotApplicable
from usarsim_conformance.side_lines import LEAVES, Guest, LineClient, MessageClient, Radio
from usarsim_conformance.stage import Point, boxes, need_stage
from usarsim_conformance.walls import controller, put
from usarsim_conformance.wire import Wire

LAW = -49.67
"""dBm at 2 m; 10 dB less with every tenfold distance (side channels reference 4.5)."""
WALL = 6.325
"""dB that a wall takes (ibidem)."""

_ASIDE = math.pi / 2.0
"""rad, yaw of both: a long robot stands along the walls and not across."""
_APART = 2.0
"""m between them at first."""
_UP = 1.0
"""m above the start pose of the line from point to point."""
_NEAR = 0.2
"""dB by which a strength may be off."""
_LOOKS = 24
_CALM = 0.25
"""How often a strength is asked for, and s of wall time before each: the wireless simulation is a
program of its own that looks at the simulator once per second (side channels reference 4.6)."""


@dataclass(frozen=True, slots=True)
class Stop:
    """What is told when the second robot stands somewhere; NaN, None or empty without a port."""

    walls: int  # that stand between
    distance: float  # m between the robots, by their own sensors
    between: float = math.nan  # ObstCount from robot to robot
    points: float = math.nan  # ObstCount from point to point
    strength: float = math.nan  # dBm, by the wireless simulation
    carries: bool | None = None  # whether a new connection on the road between them lives
    lives: bool | None = None  # whether the connection of the first stop lives
    link: str = ""  # ComServer's answer to OPEN
    level: float = math.nan  # dBm, by ComServer

    @property
    def law(self) -> float:
        """dBm that the default parameters give."""
        return LAW - 10.0 * math.log10(self.distance / 2.0) - WALL * self.walls

    def __str__(self) -> str:
        """Where it is, for messages."""
        return f"{self.distance:.1f} m away, walls between: {self.walls}"


async def stops(case: Case) -> dict[str, Stop]:
    """What is told at each stop: `near`, 2 m away; `far`, 20 m, nothing between; `one`, `three` and
    `seven` walls between; `back` at the first one.

    Raises:
        NotApplicable: if the server runs another world than the stage, or has no world controller.
    """
    need_stage(case, "walls that never move")
    return await case.shared("two robots among walls", _travel, dialect="")


async def _travel(case: Case) -> dict[str, Stop]:
    walls = [middle[0] for middle, _ in boxes("wall_")]
    begin = walls[0] - 3.0
    # Walls between, and where the second robot is put.
    goals = {
        "near": (0, begin - _APART, 0.0),
        "far": (0, begin - 10.0 * _APART, 0.0),
        "one": (1, walls[1] - 3.0, 0.0),
        "three": (3, walls[2] + 4.0, 0.0),
        "seven": (7, walls[6] + 4.0, 0.0),
        "back": (0, begin - _APART, 0.0),
    }
    world = await controller(case)
    async with await _Pair.make(case, begin) as pair:
        found: dict[str, Stop] = {}
        for name, (count, x, y) in goals.items():
            if found:
                await pair.put(world, (x, y))
            found[name] = await pair.look(name, count)
    return found


class _Pair:
    """Two robots, and what they are connected to."""

    def __init__(self, case: Case, robots: tuple[Robot, Robot]) -> None:
        self._case = case
        self._robots = robots
        self._start: Point = (0.0, 0.0, 0.0)  # of both, m
        self._here: Point = (0.0, 0.0, 0.0)
        self._radios: tuple[Radio, Radio] | None = None
        self._call: tuple[Wire, Guest] | None = None
        self._members: tuple[MessageClient, MessageClient] | None = None

    @classmethod
    async def make(cls, case: Case, x: float) -> _Pair:
        """Put two robots beside each other, and register them."""
        high = case.survey.places[0].location[2]
        places = [Place(None, (x - away, 0.0, high), (0.0, 0.0, _ASIDE)) for away in (0.0, _APART)]
        for _ in places:
            await case.place()  # so many robots at a time and no more
        ports, radios = case.target.ports, None
        if "wireless" in ports:
            radios = (
                await Radio.make(case, place=places[0]),
                await Radio.make(case, place=places[1]),
            )
            pair = cls(case, (radios[0].robot, radios[1].robot))
        else:
            pair = cls(case, (await case.spawn(place=places[0]), await case.spawn(place=places[1])))
        for robot in pair._robots:
            await robot.run(1.0)
        pair._start, pair._here = [await _place(robot) for robot in pair._robots]
        if radios is not None:
            pair._radios, pair._call = radios, await radios[0].call(radios[1])
        if "comserver" in ports:
            members = (await MessageClient.open(case), await MessageClient.open(case))
            for member, robot in zip(members, pair._robots, strict=True):
                await member.expect(f"REGISTER {robot.name} {member.wire.local_address}", "OK")
            pair._members = members
        return pair

    async def put(self, world: ControlClient, goal: tuple[float, float]) -> None:
        """Put the second robot elsewhere.

        Raises:
            NotApplicable: if it does not come there.
        """
        robot = self._robots[1]
        place = Place(None, (*goal, self._here[2]), (0.0, 0.0, _ASIDE))
        await put(world, robot.name, place)
        for _ in range(10):
            await robot.run(0.4)
            self._here = await _place(robot)
            if math.dist(self._here[:2], goal) < 0.5:
                return
        raise NotApplicable(f"AbsMove leaves a robot at {self._here}, and not at {place.location}")

    async def look(self, name: str, walls: int) -> Stop:
        """What is told of the way between the robots as they stand."""
        stop = Stop(walls, math.dist(self._start, self._here))
        if "groundtruth" in self._case.target.ports:
            stop = await self._obstacles(stop)
        stop = await self._strengths(stop)
        if self._radios is not None and self._call is not None:
            wire, guest = self._call
            if name == "seven":
                ended = await wire.hung_up(LEAVES) and await guest.hung_up()
                stop = replace(stop, lives=not ended, carries=await self._carries())
            elif name == "back":
                stop = replace(stop, carries=await self._carries())
        if self._members is not None and name in ("near", "seven"):
            stop = replace(stop, link=await self._link())
        return stop

    async def _obstacles(self, stop: Stop) -> Stop:
        client = await LineClient.open(self._case, "groundtruth")
        high = self._case.survey.places[0].location[2] - _UP
        one, other = (f"{x:.4f},{y:.4f},{high:.4f}" for x, y, _ in (self._start, self._here))
        told = []
        for asked in (
            f"{{From {self._robots[0].name}}} {{To {self._robots[1].name}}}",
            f"{{Start {one}}} {{End {other}}}",
        ):
            found = re.search(r"\{ObstCount ([^{}]*)\}$", await client.ask(f"GETOBS {asked}"))
            told.append(number(found[1]) if found else math.nan)
        client.wire.close()
        return replace(stop, between=told[0], points=told[1])

    async def _strengths(self, stop: Stop) -> Stop:
        """Asked until both are right, or have had time enough to be."""
        name, me = self._robots[1].name, self._robots[0].name
        for _ in range(_LOOKS):
            if self._radios is not None:
                line = await self._radios[0].client.ask(f"GETSS {{Robot {name}}}")
                found = re.search(r"\{Strength ([^{} ]+)\}", line)
                stop = replace(stop, strength=number(found[1]) if found else math.nan)
            if self._members is not None:
                answer = await self._members[0].ask(f"GETSS {me} {name}")
                stop = replace(stop, level=number(answer.removeprefix("OK:")))
            told = [one for one in (stop.strength, stop.level) if not math.isnan(one)]
            if all(abs(one - stop.law) < _NEAR for one in told):
                break
            await asyncio.sleep(_CALM)
        return stop

    async def _carries(self) -> bool:
        """Whether who connects to the port of the road reaches the other robot, and stays so."""
        assert self._radios is not None
        one, other = self._radios
        try:
            port = await one.road(other)
            wire = await one.dial(port)
        except Failed:
            return False
        return not await wire.hung_up(1.0)

    async def _link(self) -> str:
        """What ComServer answers to OPEN. Both ports are the second robot's own: what is dialled
        there tells nobody anything."""
        assert self._members is not None
        me, other = (robot.name for robot in self._robots)
        port = self._radios[1].port if self._radios is not None else 5
        await self._members[1].ask(f"LISTEN {other} {port}")
        answer = await self._members[0].ask(f"OPEN {me} {port} {other} {port}")
        if answer == "OK" and self._radios is not None:
            for _ in range(2):
                (await self._radios[1].guest()).wire.close()
        return answer

    async def __aenter__(self) -> _Pair:
        """Use as a context manager."""
        return self

    async def __aexit__(self, *ignored: object) -> None:
        for radio in self._radios or ():
            radio.close()


async def _place(robot: Robot) -> Point:
    x, y, z = (await robot.pose()).location
    return x, y, z
