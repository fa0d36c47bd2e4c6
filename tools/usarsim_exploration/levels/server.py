"""The level with physics: robots of a USARSim server, driven by the text protocol in lockstep.

In each step all robots decide, then drive together for some simulated seconds: commands to the
wheels at every tick, scans into maps as they go. Nothing but ports 3000 and 50000 is used.
"""

from __future__ import annotations

import contextlib
import math
import socket
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from usarsim_client import ProtocolError
from usarsim_exploration.environment import Cell
from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.known_map import FREE, KNOWN, SAFE, WALL
from usarsim_exploration.levels.air import Air
from usarsim_exploration.levels.controller import Controller, DeadError
from usarsim_exploration.levels.driver import Driver
from usarsim_exploration.levels.physics import Physics
from usarsim_exploration.levels.route import SNAP, gathering, rest_of, route, unknown_at
from usarsim_exploration.levels.rover import Place, Rover, disc_cells, wire_name
from usarsim_exploration.levels.serving import cutoff
from usarsim_exploration.levels.swerving import Swerve
from usarsim_exploration.levels.wire import decode, encode
from usarsim_exploration.localisation import (
    INERTIAL,
    WHEELS,
    Disc,
    Evidence,
    Localiser,
    Pose,
    rasterise,
)
from usarsim_exploration.localisation.poses import wrap
from usarsim_exploration.localisation.surfaces import beam_ends
from usarsim_exploration.measures.contacts import Contacts
from usarsim_exploration.measures.reality import Ways, of_map
from usarsim_exploration.post import Message
from usarsim_exploration.radio import Links, Radio
from usarsim_exploration.walking import through
from usarsim_exploration.worlds import scale_of

if TYPE_CHECKING:
    from usarsim_exploration.cycle import Cycle, Member

STATION = "ComStation"
"""Class of the base."""
HEIGHT = 0.2, 0.5
"""m above the floor at which robots and the base come into the world."""
_FIRST, _STILL = 5.0, 1.0
"""s of simulated time within which each robot has seen something, and that it stands before."""
_WIDTH = 3.5
"""Cells of 0.1 m from a robot's middle to that of the nearest wall's cell; it is 0.29 m wide."""
_ROBOT = 0.45
"""m around the middle of a robot within which a scan does not see walls but the robot."""
_FORGOTTEN, _FAR = 10, 3.0
"""Steps after which nobody reckons any longer with a robot that is silent, and m that it may have
gone until then."""
_BODY = 0.3
"""m around the middle of a robot that others do not drive over."""
_SEES = 3.0
"""m within which a laser point that is on no map keeps robots away."""
_UNDER = 0.25
"""m around the middle of a robot that are free, since it stands there."""
_TURNED = 0.2
"""rad after which a robot takes in a scan though it has not moved by a cell."""


class ServerLevel:
    """Drives robots of a server.

    Attributes:
        place: where the server is. time: simulated s so far.
        lost: names of robots that have left the world.
    """

    def __init__(
        self,
        physics: Physics,
        team: Sequence[Member],
        shape: tuple[int, int],
        cell: float,
        radio: Radio,
        place: Place,
        *,
        metres: bool = True,
    ) -> None:
        """Bring the team into the world of a server.

        Args:
            physics: see there. team: the base first. shape: rows and columns of the environment.
            cell: width of one, m. radio: of the scenario. place: of the server.
            metres: lengths are as long at any width of a cell.

        Raises:
            ExplorationError: there is no server, or it does not let all in.
        """
        self._physics, self._cell, self._shape = physics, cell, shape
        self._scale, self._metres = scale_of(cell) if metres else 1.0, metres
        host, control = place.host, place.control
        self.place, self._address = place, (host, control)
        self._tall = shape[0] * cell
        self._team = tuple(team)
        self._air: Air | None = None
        self.controllers: list[Controller] = []
        self._rovers: list[Rover] = []
        self.time = self._begun = 0.0
        self.lost: list[str] = []
        self._ways, self._contacts = Ways(), Contacts()
        try:
            for number, member in enumerate(self._team):
                kind = STATION if number == 0 else physics.robot
                one = Controller(host, control, wire_name(member.name), kind, physics.skid)
                self.controllers.append(one)
                x, y = self._middle(member.cell)
                one.enter(x, y - self._tall, -HEIGHT[number == 0], member.heading)
                if number:
                    one.learn()
            names = [one.name for one in self.controllers]
            self._air = Air(host, place.wireless, names, cutoff(radio))
        except OSError as error:
            self.close()
            cure = "start `usarsim serve --lockstep` there, or leave --connect out"
            raise ExplorationError(f"no server at {host}:{control}: {error} ({cure})") from error
        except ExplorationError:
            self.close()
            raise

    # -- what a cycle asks for ------------------------------------------------------------------

    def look(self, cycle: Cycle) -> None:
        """The first scans: the world goes on until all robots have seen something."""
        robots = self.controllers[1:]
        for _ in range(math.ceil(_FIRST / self._physics.control)):
            try:
                for one in self.controllers:
                    one.release(drive=False)
                for one in self.controllers:
                    one.collect()
            except DeadError as error:
                raise self._gone(error) from error
            self.time += self._physics.control
            if self.time >= _STILL and all(len(one.ranges) for one in robots):
                break
        size = self._shape[1] * self._cell, self._tall
        for body, one in zip(cycle.bodies[1:], robots, strict=True):
            if not len(one.ranges):
                cure = f"{self._physics.robot} needs a RangeScanner"
                raise ExplorationError(f"{one.name} has no laser scan ({cure})")
            # a server that finds no room puts a robot beside; its INS begins with the truth
            told = one.inertial() if self._physics.inertial else None
            start = (*self._middle(body.view.cell), body.member.heading)
            if told is not None:
                one.align()
                start = told[0], told[1] + self._tall, told[2]
            top = body.member.speed * self._cell / self._physics.seconds
            driver = Driver(body.view.number, top, self._physics.control)
            if math.isfinite(one.top):
                driver.limit(one.top)
            reach = body.member.reach * self._cell
            evidence = Evidence(self._shape)
            mode, mount = self._physics.localisation, (one.mount, 0.0, 0.0)
            motion = INERTIAL if told is not None else WHEELS
            localiser = Localiser(mode, start, size, reach, mount, motion)
            swerve = Swerve(body.view.number, self._physics.control)
            rover = Rover(body, one, evidence, driver, swerve, localiser, start, start)
            self._rovers.append(rover)
        self._begun = self.time
        for rover in self._rovers:
            rover.others = self._discs(cycle, rover)
            self._locate(rover)
            if rover.body.works:
                self._take_in(cycle, rover)

    def move(self, cycle: Cycle) -> None:
        """All decide, then all drive for a step."""
        acting = set(map(id, cycle.acting()))
        moving = [one for one in self._rovers if id(one.body) in acting]
        for rover in moving:
            if rover.taken is None:  # switched on just now
                self._take_in(cycle, rover)
            cycle.decide(rover.body)
            self._set_out(cycle, rover)
        self._begun = self.time
        for _ in range(self._physics.ticks):
            self._tick(cycle)
        for rover in moving:
            self._settle(cycle, rover)
            rover.body.view.planner.forget()

    def links(self, cycle: Cycle) -> Links:
        """As strong as the wireless server says."""
        assert self._air is not None
        on = [one.works and not one.silent and one.member.radio_range > 0.0 for one in cycle.bodies]
        try:
            return Links(self._air.hears(on))
        except (OSError, ProtocolError) as error:
            raise self._gone(error) from error

    def carry(self, message: Message) -> Message:
        """Over the wireless server."""
        assert self._air is not None
        try:
            data = self._air.carry(message.giver, message.taker, encode(message))
        except ProtocolError as error:
            raise self._gone(error) from error
        return decode(data)

    def reality(self, cycle: Cycle) -> dict[str, float | None]:
        """The measures that only robots of a server have."""
        drivers = [one.driver for one in self._rovers]
        told = {
            "stuck_s": sum(one.stuck for one in drivers),
            "recoveries": float(sum(one.recoveries for one in drivers)),
        }
        found = of_map(cycle.bodies[0].view, cycle.environment)
        return found | self._ways.facts() | self._contacts.facts() | told

    @property
    def roads(self) -> set[int]:
        """Ports of the wireless server that led from one robot to another."""
        return self._air.ports if self._air is not None else set()

    def close(self) -> float:
        """Everybody leaves the world; processor s of the server, if it is our own."""
        if self._air is not None:
            self._air.close()
        for one in self.controllers:
            one.close()
        return self.place.own.close() if self.place.own is not None else 0.0

    # -- a step ---------------------------------------------------------------------------------

    def _set_out(self, cycle: Cycle, rover: Rover) -> None:
        """Make the way for this step out of what is left of the strategy's path."""
        view = rover.body.view
        rover.visited = [view.cell]
        rover.others = self._discs(cycle, rover)
        if not view.path:
            rover.driver.rest()
            return
        one, body = rover.controller, disc_cells(_BODY / self._cell)
        seen = [np.array(self._at(disc)) + body for disc in rover.others[1:]]
        near = one.ranges < _SEES
        ends = beam_ends(one.ranges[near] + 0.03, one.angles[near], rover.scanner)
        seen.append(np.floor(ends / self._cell).astype(np.int64))
        here = self._at(rover.pose)
        snap = SNAP
        if view.path[-1] == view.base:  # all come home, and stand around it
            snap = gathering(len(self._rovers))
        width = _WIDTH * 0.1 / self._cell
        way, whole = route(
            view.known.bits, here, view.path, width, np.concatenate(seen), snap, self._scale
        )
        end = self._middle(view.path[-1])
        back = max(1, round(5 * self._scale))
        last = self._middle(view.path[-1 - back]) if len(view.path) > back else rover.pose[:2]
        far = math.dist(end, last) > self._cell
        facing = math.atan2(end[1] - last[1], end[0] - last[0]) if far else rover.pose[2]
        if self._metres and whole:
            facing = unknown_at(view.known.bits, view.path[-1], self._scale, facing)
        rover.driver.follow([self._middle(one) for one in way], facing, ends=whole)

    def _tick(self, cycle: Cycle, *, drive: bool = True) -> None:
        """One tick of the world: commands, then readings, then scans into maps."""
        present = [one for one in self._rovers if one.controller.name not in self.lost]
        speeds: list[tuple[float, float]] = []
        for rover in present:
            moves = drive and rover.body.works
            speeds.append(rover.steer(self._cell) if moves else (0.0, 0.0))
        try:
            self.controllers[0].release(drive=False)
            for rover, speed in zip(present, speeds, strict=True):
                rover.controller.release(*speed, drive=drive)
            self.controllers[0].collect()
        except DeadError as error:
            raise self._gone(error) from error
        for rover in present:
            try:
                rover.controller.collect()
            except DeadError as error:
                self._bury(rover, error)
                continue
            self._locate(rover)
            if drive and rover.body.works:
                self._watch(cycle, rover)
        self._judge(cycle, [one for one in present if one.controller.name not in self.lost])
        self.time += self._physics.control

    def _locate(self, rover: Rover) -> None:
        """Where the robot believes to be now, and to have been when it scanned."""
        one, localiser = rover.controller, rover.localiser
        if (then := self._told(rover, seen=True)) is not None:
            ranges, angles = (one.ranges, one.angles) if one.fresh else ((), ())
            rover.scanned = localiser.update(then, ranges, angles, self._grown(rover))
        if (now := self._told(rover)) is not None:
            rover.pose = localiser.update(now)

    def _told(self, rover: Rover, *, seen: bool = False) -> Pose | None:
        """What a robot goes by, now or at its newest scan."""
        if self._physics.localisation == "truth":
            return self._true(rover.controller, seen=seen)
        one = rover.controller
        if (wheels := one.odometry(seen=seen)) is None:
            return None
        inertial = one.inertial() if seen and self._physics.inertial else None
        return rover.reckoning.update(wheels, self._physics.skid, inertial, rover.scanned[2])

    def _true(self, one: Controller, *, seen: bool = False) -> Pose | None:
        told = one.truth(seen=seen)
        return told and (told[0], told[1] + self._tall, told[2])

    def _judge(self, cycle: Cycle, present: list[Rover]) -> None:
        """Note where robots truly are, for measures; they do not learn of it."""
        poses = {}
        for rover in present:
            true, wheels = self._true(rover.controller), rover.controller.odometry()
            if true is not None and wheels is not None:
                poses[rover.body.view.number] = true, rover.pose, wheels
        self._ways.note(poses, self._physics.control)
        bodies = {number: pose for number, (pose, _, _) in poses.items()}
        self._contacts.note(bodies, cycle.environment)

    def _watch(self, cycle: Cycle, rover: Rover) -> None:
        """Note where the robot has come, and take in what it sees from there."""
        cell = self._at(rover.pose)
        if cell != rover.visited[-1]:
            rover.visited.append(cell)
        taken = rover.taken
        assert taken is not None
        seen = rover.scanned
        moved, turned = math.dist(seen[:2], taken[:2]), abs(wrap(seen[2] - taken[2]))
        if rover.controller.fresh and (moved >= self._cell or turned >= _TURNED):
            rover.body.distance += moved / self._cell
            self._take_in(cycle, rover)

    def _take_in(self, cycle: Cycle, rover: Rover) -> None:
        body, one, cell = rover.body, rover.controller, self._cell
        wide = np.abs(one.angles) <= body.member.view / 2 + 1e-3
        scans = rasterise(
            rover.scanner, one.ranges[wide], one.angles[wide],
            body.member.reach * cell, cell, self._shape, self._grown(rover),
        )  # fmt: skip
        known = body.view.known
        cycle.count(body, known.take_in(cycle.step, scans, rover.taken is not None))
        rover.taken = rover.scanned
        rover.evidence.correct(known, cycle.step, scans)
        # where it stands there is nothing else
        around = np.array(self._at(rover.pose)) + disc_cells(_UNDER / cell)
        rows, columns = self._shape
        inside = ((around >= 0) & (around < (columns, rows))).all(axis=1)
        under = np.sort(around[inside] @ (1, columns))
        bits = known.news(under)
        under = under[bits & (FREE | WALL) != FREE]
        found = under[known.news(under) & KNOWN == 0]
        known.write(cycle.step, under, np.full(len(under), FREE | SAFE, np.uint8))
        cycle.count(body, found.astype(np.int32))

    def _grown(self, rover: Rover) -> list[Disc]:
        """Where others may be by now, as a scan sees them."""
        since = (self.time - self._begun) * rover.driver.top
        return [rover.others[0], *((x, y, far + since) for x, y, far in rover.others[1:])]

    def _settle(self, cycle: Cycle, rover: Rover) -> None:
        """What the strategy learns of the step: where the robot is, and what is left."""
        body, view, driver = rover.body, rover.body.view, rover.driver
        visited = rover.visited
        moved = len(visited) > 1
        here = visited[-1]
        view.heading = rover.pose[2]
        blocked = driver.blocked and bool(view.path)
        view.blocked = blocked
        if view.path and driver.arrived and not blocked:
            here, view.path = view.path[-1], []
        elif view.path and not blocked:
            view.path = rest_of(view.path, here)
        if blocked:
            self._bump(cycle, rover)
            view.path = []
        driven = through(visited[0], [*visited[1:], here])
        if moved or driver.arrived:
            view.cell = here
        body.moves = driven if driven and view.cell == driven[-1] else []

    def _bump(self, cycle: Cycle, rover: Rover) -> None:
        """Something that is on no map keeps the robot from going on: it takes that for a wall."""
        view = rover.body.view
        here = self._at(rover.pose)
        far = 4.0 * self._scale
        ahead = [one for one in view.path if math.dist(one, here) >= far][:1] or view.path[-1:]
        for cell in ahead:
            x, y = self._middle(cell)
            taken = any(math.dist((x, y), disc[:2]) < 1.0 for disc in rover.others)
            if cell != view.base and not taken and cell != here:
                view.known.bump(cycle.step, cell)

    # -- others ---------------------------------------------------------------------------------

    def _discs(self, cycle: Cycle, rover: Rover) -> list[Disc]:
        """Where this robot thinks that others and the base are, and how far they may have got."""
        view = rover.body.view
        found = [(*self._middle(view.base), 0.3)]
        for one in view.teammates.values():
            if one.number == 0:
                continue
            age = max(cycle.step - one.heard - 1, 0) if one.heard >= 0 else cycle.step
            if age < _FORGOTTEN:
                gone = min(age * one.speed * self._cell, _FAR)
                found.append((*self._middle(one.cell), _ROBOT + gone))
        return found

    def _bury(self, rover: Rover, error: DeadError) -> None:
        """A robot has left the world; if the server is gone as well, that is the end.

        Raises:
            ExplorationError: nobody answers any longer.
        """
        with contextlib.suppress(OSError):
            socket.create_connection(self._address, 5.0).close()
            rover.body.works = False
            self.lost.append(rover.controller.name)
            rover.controller.close()
            return
        raise self._gone(error)

    def _gone(self, error: Exception) -> ExplorationError:
        host, port = self._address
        return ExplorationError(
            f"the server {host}:{port} is gone after {self.time:.1f} s: {error}"
        )

    def _middle(self, cell: Cell) -> tuple[float, float]:
        """m of the middle of a cell."""
        return (cell[0] + 0.5) * self._cell, (cell[1] + 0.5) * self._cell

    def _at(self, pose: Sequence[float]) -> Cell:
        """The cell of a place, m; the nearest one for what is outside."""
        rows, columns = self._shape
        column, row = int(pose[0] / self._cell), int(pose[1] / self._cell)
        return min(max(column, 0), columns - 1), min(max(row, 0), rows - 1)
