"""What a team costs a running server, thread by thread.

The server looks at its own threads (`usarsim_bench.instruments.threads`); the team drives around at
real time with clients in this process.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

from usarsim_bench.camera_client import Viewer, ViewerTrial, summed_up
from usarsim_bench.crowd import Behaviour, Crowd, wander
from usarsim_bench.errors import BenchError
from usarsim_bench.figures import Plan
from usarsim_bench.server import Server
from usarsim_bench.swarm import TOGETHER
from usarsim_bench.team import TeamTrial, gather, try_team

ROLES = ("physics", "reports", "sockets", "drawing", "encoding", "others")

TAIL = 0.6
"""s after the measurement, in which the server looks at its threads once more."""
_INSTRUMENT = "usarsim_bench.instruments.threads"

Look = Mapping[str, object]
"""A moment (`moment`) and the processor seconds spent until then by role (`spent`)."""


@dataclass(frozen=True, slots=True)
class Watching:
    """Cameras that are watched.

    Attributes:
        tiles: x, y, width and height of each, pixels.
        rate: pictures per second that are asked of each.
    """

    tiles: Sequence[tuple[int, int, int, int]] = ()
    rate: float = 1.0


@dataclass(frozen=True, slots=True)
class Team:
    """Who is measured, and where.

    Attributes:
        robots: how many.
        robot_class: of all of them.
        classes: folder of robot files.
        world: name or folder.
        options: further words of the command line.
        watching: cameras that somebody looks at meanwhile.
        behaviour: what the robots do.
        room: robots that the server has room for; None for just so many.
    """

    robots: int
    robot_class: str
    classes: Path
    world: str
    options: tuple[str, ...] = ()
    watching: Watching = field(default_factory=Watching)
    behaviour: Behaviour = wander
    room: int | None = None


@dataclass(frozen=True, slots=True)
class Cost:
    """What it took.

    Attributes:
        spent: processor seconds per simulated second by role: cores at real time.
        factor: real-time factor of the robot that had the lowest.
        lines: received per second by all clients.
        pictures: new pictures per second, of all cameras watched.
        resident: bytes of memory at the end.
        others: processors used by other programs meanwhile; None if the system does not say.
    """

    spent: Mapping[str, float]
    factor: float
    lines: float
    pictures: float
    resident: int
    others: float | None

    @property
    def whole(self) -> float:
        """All threads together."""
        return sum(self.spent.values())

    @property
    def pictured(self) -> float:
        """What goes with the pictures: drawing, encoding, and a renderer's own threads."""
        return self.spent["drawing"] + self.spent["encoding"] + self.spent["others"]


def measure_cost(team: Team, plan: Plan, seconds: float) -> Cost:
    """Let a team drive around for so many s of wall time.

    Raises:
        BenchError: if the server fails a client, or did not look at its threads.
    """
    with tempfile.TemporaryDirectory(prefix="usarsim-bench-") as folder:
        file = Path(folder, "looks.json")
        command = (_INSTRUMENT, str(file), "serve", "--robots", str(team.classes), *team.options)
        with (
            Server(team.world, team.room or team.robots, command) as server,
            Crowd(server.port, plan.seed, team.behaviour) as crowd,
        ):
            gather(crowd, team.robots, (team.robot_class,), TOGETHER)
            trial, seen = _watched(server, crowd, team.watching, seconds)
            crowd.run(TAIL)
        looks: list[Look] = json.loads(file.read_text())
    spent = spent_between(looks, trial.start, trial.stop)
    simulated = (trial.stop - trial.start) * trial.factor
    return Cost(
        spent={role: value / simulated for role, value in spent.items()},
        factor=trial.factor,
        lines=trial.lines,
        pictures=sum(one.news for one in seen),
        resident=trial.resident,
        others=trial.load.others,
    )


def _watched(
    server: Server, crowd: Crowd, watching: Watching, seconds: float
) -> tuple[TeamTrial, list[ViewerTrial]]:
    if not watching.tiles:
        return try_team(server, crowd, 0, seconds), []
    port = server.ports.get("images")
    if port is None:
        raise BenchError("the server has no images")
    with ExitStack() as stack:
        viewers = [
            stack.enter_context(Viewer(port, tile, watching.rate)) for tile in watching.tiles
        ]
        trial = try_team(server, crowd, 0, seconds)
    return trial, [summed_up(one.pictures, trial.start, trial.stop) for one in viewers]


def spent_between(looks: Sequence[Look], start: float, stop: float) -> dict[str, float]:
    """Processor seconds by role that were spent between two moments.

    They are taken from straight lines through the looks around either moment.

    Raises:
        BenchError: if there are no looks before the first and behind the second of them.
    """
    before, after = _at(looks, start), _at(looks, stop)
    return {role: max(0.0, after(role) - before(role)) for role in ROLES}


def _at(looks: Sequence[Look], moment: float) -> Callable[[str], float]:
    for earlier, later in pairwise(looks):
        begin, end = _moment(earlier), _moment(later)
        if begin <= moment <= end and end > begin:
            part = (moment - begin) / (end - begin)
            a, b = _spent(earlier), _spent(later)
            return lambda role: a[role] + part * (b[role] - a[role])
    raise BenchError("the server did not look at its threads all the time")


def _moment(look: Look) -> float:
    value = look["moment"]
    assert isinstance(value, float)
    return value


def _spent(look: Look) -> Mapping[str, float]:
    value = look["spent"]
    assert isinstance(value, Mapping)
    return value
