"""Machines: when they decide, what they see, and that decisions are taken back with a batch."""

from __future__ import annotations

import math
from collections.abc import Callable

import mujoco
import pytest
from sim_fakes import ROBOT, Geom, add_crate, engine_with, floor, pose_at, run

from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy
from usarsim_server.simulation.machines import DECISION_INTERVAL, Machine, Presence, Zone
from usarsim_server.simulation.movers import Mover


def hall() -> mujoco.MjSpec:
    """A floor, a crate at (3, 0), a door on a hinge, and two placed bodies `a` and `b`."""
    spec = floor()()
    add_crate(spec, "crate", (3.0, 0.0, 0.15))
    leaf = spec.worldbody.add_body(name="leaf", pos=(6.0, 0.0, 0.5))
    leaf.add_joint(name="hinge", axis=[0.0, 0.0, 1.0])
    leaf.add_geom(type=Geom.mjGEOM_BOX, size=[0.05, 0.5, 0.4], mass=5.0)
    for name, x in (("a", 9.0), ("b", 12.0)):
        body = spec.worldbody.add_body(name=name, mocap=True, pos=(x, 0.0, 0.5))
        body.add_geom(type=Geom.mjGEOM_BOX, size=[0.2, 0.2, 0.2])
    return spec


class Watcher(Machine):
    """Stands still and asks something at each decision."""

    def __init__(self, body: str, ask: Callable[[Presence], object], building: bool = True) -> None:
        self.movers = (Mover(body, lambda time: Pose((9.0 if body == "a" else 12.0, 0.0, 0.5))),)
        self.building = building
        self.ask = ask
        self._decision: tuple[float, ...] = ()
        self.answers: list[object] = []

    def decide(self, time: float, presence: Presence) -> None:
        """Note when, and what was seen."""
        self._decision = (*self._decision, time)
        self.answers.append(self.ask(presence))

    @property
    def times(self) -> tuple[float, ...]:
        """Of its decisions."""
        return self._decision


def seen(zone: Zone, *robots: tuple[float, float]) -> tuple[bool, bool, bool]:
    """Whether a machine sees anything loose in a zone, anybody who goes, anything wholly in it."""

    def ask(presence: Presence) -> tuple[bool, bool, bool]:
        going = presence.touching(zone, going=True)
        return bool(presence.touching(zone)), bool(going), bool(presence.within(zone))

    watcher = Watcher("a", ask)
    engine = engine_with(*robots, scenery=hall)
    engine.set_movers([], [watcher])
    run(engine, 2 * DECISION_INTERVAL)
    answer = watcher.answers[-1]
    assert isinstance(answer, tuple)
    return answer


def box(x: float, half: float = 0.5, yaw: float = 0.0) -> Zone:
    """A cube about a place on the x axis that begins 5 cm below the floor."""
    turn = quaternion_from_rpy(0.0, 0.0, yaw)
    return Zone(Pose((x, 0.0, half - 0.05), turn), (half, half, half))


class TestTime:
    """When machines decide."""

    @pytest.mark.parametrize("batch", [1, 5, 8])
    def test_decisions_fall_on_fixed_times(self, batch: int) -> None:
        """About every 0.05 s of simulated time, whatever the batches."""
        engine, watcher = engine_with(scenery=hall), Watcher("a", lambda presence: None)
        engine.set_movers([], [watcher])
        for _ in range(120 // batch):
            engine.advance(batch)
        steps = [round(time / engine.timestep) for time in watcher.times]
        assert steps == list(range(0, 120, round(DECISION_INTERVAL / engine.timestep)))

    def test_decisions_of_a_batch_that_failed_are_taken_back(self) -> None:
        """A batch that is tried again decides once, not twice."""
        engine, watcher = engine_with(scenery=hall), Watcher("a", lambda presence: None)
        engine.set_movers([], [watcher])
        run(engine, 0.1)
        engine.data.qvel[0] = math.nan
        engine.advance(50)
        steps = [round(time / engine.timestep) for time in watcher.times]
        assert steps == sorted(set(steps))
        assert engine.steps - steps[-1] <= round(DECISION_INTERVAL / engine.timestep)

    def test_machines_outlive_growth(self) -> None:
        """In a larger model they see robots that were not there before."""
        watcher = Watcher("a", lambda presence: len(presence.touching(box(0.0), going=True)))
        engine = engine_with(scenery=hall)
        engine.set_movers([], [watcher])
        engine.advance(20)
        engine.adopt(engine.grow([ROBOT]))
        engine.occupy(0, 0, pose_at(0.0, 0.0))
        engine.advance(20)
        assert watcher.answers[0] == 0
        assert watcher.answers[-1] == 1


class TestSight:
    """What machines see."""

    def test_robots_go_and_crates_lie(self) -> None:
        """A robot is loose and goes by itself, a crate is only loose, an empty place is empty."""
        assert seen(box(0.0), (0.0, 0.0)) == (True, True, True)
        assert seen(box(3.0)) == (True, False, True)
        assert seen(box(-3.0)) == (False, False, False)

    def test_doors_are_not_seen(self) -> None:
        """What hangs in a joint of the scene is a part of the building."""
        assert seen(box(6.0)) == (False, False, False)

    def test_a_machine_does_not_see_itself(self) -> None:
        """Nor other parts of the building; but a moving thing that belongs to nobody."""
        assert seen(box(9.0, 1.0)) == (False, False, False)
        assert seen(box(12.0, 1.0)) == (True, True, True)
        watcher = Watcher("a", lambda presence: len(presence.touching(box(12.0, 1.0))))
        for building, count in ((True, 0), (False, 1)):
            engine = engine_with(scenery=hall)
            other = Watcher("b", lambda presence: None, building)
            engine.set_movers([], [watcher, other])
            engine.advance(2)
            assert watcher.answers[-1] == count

    def test_partly_inside(self) -> None:
        """What is half in a zone is in it, but not within it."""
        assert seen(box(3.6)) == (True, False, False)
        assert seen(box(3.66)) == (False, False, False)

    def test_turned_zones(self) -> None:
        """A zone is a box in its own axes: turned by 45 degrees its corner reaches farther."""
        assert seen(box(3.8)) == (False, False, False)
        assert seen(box(3.8, yaw=math.pi / 4)) == (True, False, False)

    def test_who_left_is_not_seen(self) -> None:
        """A robot that has been removed is no longer there."""
        watcher = Watcher("a", lambda presence: len(presence.touching(box(0.0))))
        engine: Engine = engine_with((0.0, 0.0), scenery=hall)
        engine.set_movers([], [watcher])
        engine.advance(2)
        engine.vacate(0)
        engine.advance(20)
        assert watcher.answers[0] == 1
        assert watcher.answers[-1] == 0


def test_a_machine_without_a_body_is_refused() -> None:
    """A body that does not exist is an error, and what was there stays."""
    engine, watcher = engine_with(scenery=hall), Watcher("a", lambda presence: None)
    engine.set_movers([], [watcher])
    with pytest.raises(ValueError, match="does not exist"):
        engine.set_movers([], [Watcher("nobody", lambda presence: None)])
    engine.advance(1)
    assert watcher.times == (0.0,)
