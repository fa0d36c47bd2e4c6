"""The work that all simulators get is the same, possible, and done by our own side."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest

from usarsim_bench.figures import Plan
from usarsim_bench.peers import rovers
from usarsim_bench.peers.comparing import compare
from usarsim_bench.peers.own import HUMANOID, OwnSide, joint_targets, joints_told
from usarsim_bench.peers.rovers import Counts
from usarsim_bench.peers.simulators import PEERS, WORKLOADS
from usarsim_bench.peers.work import BEAMS, MOST, ROVER, Box, plan_work, write_robots, write_world
from usarsim_server.robots.catalog import load_catalog
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.scene import build_scene

NETWORK = "USARSIM_TEST_NETWORK"


def distance(box: Box, x: float, y: float) -> float:
    """From a place on the floor to the outline of a box, m; 0 inside."""
    cosine, sine = math.cos(box.yaw), math.sin(box.yaw)
    dx, dy = x - box.center[0], y - box.center[1]
    along = abs(cosine * dx + sine * dy) - box.half[0]
    across = abs(cosine * dy - sine * dx) - box.half[1]
    return math.hypot(max(along, 0.0), max(across, 0.0))


class TestPlan:
    def test_equal_arguments_give_equal_work(self) -> None:
        """Runs can be repeated; another seed gives other work."""
        assert plan_work(4, 5.0, 1.0) == plan_work(4, 5.0, 1.0)
        assert plan_work(4, 5.0, 1.0) != plan_work(4, 5.0, 1.0, seed=1)

    def test_starts_are_free(self) -> None:
        """A robot of 0.45 m around stands clear of every wall and crate, and of every other one."""
        work = plan_work(MOST, 1.0, 1.0)
        for x, y, _ in work.starts:
            assert min(distance(box, x, y) for box in work.boxes) > 0.45
        places = [start[:2] for start in work.starts]
        assert min(math.dist(a, b) for a in places for b in places if a != b) > 0.9

    def test_commands_last(self) -> None:
        """There is a command for each robot and half second, the warm-up included."""
        work = plan_work(3, 2.2, 1.0)
        assert len(work.commands) * work.command_period >= 1.0 + 2.2
        assert {len(row) for row in work.commands} == {3}

    @pytest.mark.parametrize("robots", [0, MOST + 1])
    def test_robots_have_cells(self, robots: int) -> None:
        """There is one cell for each robot."""
        with pytest.raises(ValueError, match=str(MOST)):
            plan_work(robots, 1.0, 1.0)

    def test_programs_find_what_they_ask_for(self) -> None:
        """Every key that a workload reads from the work, its robot or its laser is there."""
        work = json.loads(plan_work(1, 1.0, 1.0).as_json())
        known = {*work, *work["robot"], *work["laser"], *work["boxes"][0]}
        for peer in PEERS.values():
            text = (WORKLOADS / peer.workload).read_text(encoding="utf-8")
            for holder in ("work", "robot", "laser", "box"):
                for part in text.split(f'{holder}["')[1:]:
                    assert part.partition('"')[0] in known


class TestOurFiles:
    def test_the_world_is_that_of_the_others(self, tmp_path: Path) -> None:
        """Our scene has every box of the work, where and as large as it says, and a floor."""
        work = plan_work(3, 1.0, 1.0)
        world = load_world(write_world(tmp_path, work))
        model = build_scene(world).compile()
        assert model.ngeom == len(work.boxes) + 1
        assert np.allclose(model.geom_pos[1:], [box.center for box in work.boxes])
        assert np.allclose(model.geom_size[1:], [box.half for box in work.boxes])
        assert np.allclose(model.geom_quat[1:, 3], [math.sin(box.yaw / 2) for box in work.boxes])
        assert [one.pose.position[:2] for one in world.starts] == [
            pytest.approx(start[:2]) for start in work.starts
        ]

    def test_the_robot_has_a_laser_and_nothing_else(self, tmp_path: Path) -> None:
        """What is not asked of the others is not asked of ours."""
        found = load_catalog((write_robots(tmp_path),)).find(ROVER)
        assert found is not None
        assert [one.name for one in found.items] == ["lms200"]
        assert not found.cameras


class TestCounts:
    def test_scans(self) -> None:
        """Beams are counted, those that hit something, and what they measured; others are not."""
        counts = Counts()
        line = "SEN {Time 1.0} {Type RangeScanner} {Name lms200} {FOV 3.1} {Range 1.5,20.00,2.5}"
        counts.add_scan(line, 20.0)
        counts.add_scan("SEN {Time 1.0} {Type Sonar} {Name F1 Range 2.0}", 20.0)
        assert (counts.scans, counts.beams, counts.hits) == (1, 3, 2)
        assert counts.reach == pytest.approx(24.0)


class TestInProcess:
    def test_the_work_is_done(self) -> None:
        """Every scan that is due is taken, with all its beams, and robots move."""
        work = plan_work(2, 1.0, 60.0)
        with OwnSide() as own:
            outcome = own.in_process(work)
        assert outcome.simulated == pytest.approx(1.0, abs=0.02)
        assert outcome.counts["scans"] == pytest.approx(20, abs=2)
        assert outcome.counts["beams"] == outcome.counts["scans"] * BEAMS
        assert outcome.counts["hits"] > 0.9 * outcome.counts["beams"]
        # At most 0.8 m/s each, but no standing still.
        assert 0.02 < outcome.counts["metres"] < 1.7
        assert outcome.cpu > 0.0

    def test_a_run_that_is_slow_stops_early(self, tmp_path: Path) -> None:
        """The limit of wall time cuts the measurement, and only what was done counts."""
        plan = plan_work(1, 500.0, 0.05)
        work = json.loads(plan.as_json())
        world = write_world(tmp_path, plan)
        result = rovers.drive(work, world, write_robots(tmp_path / "robots"), ROVER)
        assert 0.0 < result["simulated"] < 499.0
        assert result["counts"]["scans"] == pytest.approx(10.0 * result["simulated"], abs=2)

    def test_bare_engine(self) -> None:
        """Its time is that of as many steps as were made."""
        with OwnSide() as own:
            outcome = own.bare(plan_work(1, 0.5, 60.0))
        assert outcome.simulated == pytest.approx(0.5)
        assert outcome.cpu > 0.0


class TestSockets:
    def test_rovers(self) -> None:
        """Clients of a real server hear scans, and simulated time passes; all are counted."""
        with OwnSide() as own:
            outcome = own.over_sockets(plan_work(2, 5.0, 60.0))
        assert outcome.simulated > 4.9
        assert 0 < outcome.counts["scans"] < outcome.counts["messages"]
        assert outcome.cpu > 0.0

    def test_humanoids(self) -> None:
        """Joints are told and commanded; clients that hear nothing would have raised an error."""
        with OwnSide() as own:
            outcome = own.over_sockets(plan_work(1, 2.0, 60.0), HUMANOID)
        assert outcome.simulated > 1.9
        assert outcome.counts["messages"] > 0
        assert outcome.counts["scans"] == 0

    STATUS = (
        "STA {Time 0.4800} {Battery 99999} {Type LeggedVehicle} {HeadYaw 0.0000} "
        "{LShoulderPitch 1.4000} {LShoulderRoll -0.0086} {RHipYawPitch 0.0000} {RKneePitch 0.2}"
    )

    def test_joints_are_read(self) -> None:
        """All but the joint that follows another take commands; the rest of the line is none."""
        assert joints_told(self.STATUS) == {
            "HeadYaw": 0.0,
            "LShoulderPitch": 1.4,
            "LShoulderRoll": -0.0086,
            "RKneePitch": 0.2,
        }

    def test_shoulders_swing_and_the_rest_holds(self) -> None:
        """Targets are the angles at rest, but shoulders move by ten degrees."""
        rest = {"HeadYaw": 0.1, "LShoulderPitch": 1.4}
        quarter = math.pi / 2 / 3.0
        assert joint_targets(rest, 0.0) == "MULTIDRIVE {HeadYaw 0.1000} {LShoulderPitch 1.4000}"
        swung = joint_targets(rest, quarter)
        assert swung == "MULTIDRIVE {HeadYaw 0.1000} {LShoulderPitch 1.5745}"


@pytest.mark.skipif(NETWORK not in os.environ, reason=f"needs the network: set {NETWORK}=1")
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("name", list(PEERS))
def test_each_peer_does_the_work(name: str) -> None:
    """Installed for it, the simulator takes every scan or sends every message that is due."""
    report = compare(Plan(robots=2, seconds=2.0), "test", only=(name,))
    section = report.sections[1]
    assert section.figures, section.setting
    told = {figure.name: figure.value for figure in section.figures}
    if "2 robots: scans / scans due" in told:
        assert told["2 robots: scans / scans due"] == pytest.approx(1.0, abs=0.05)
        assert 0.05 < told["2 robots: way of a robot"] < 0.8
    else:
        assert told["2 robots: messages per simulated s"] == pytest.approx(100.0, rel=0.1)
