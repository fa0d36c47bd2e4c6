"""Robots in imported worlds: they do not fall through, stick or leave (worlds reference 13)."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from built_worlds import blocks, build_world, cuboid_mesh, grid_mesh, mesh_of, scene_of, thing
from t3d_maps import brush, level, start, two_rooms
from udk_maps import room as udk_room

from usarsim_maps.convert import Request, import_map
from usarsim_maps.scene import Scene, SceneObject
from usarsim_server.simulation.frames import Pose
from usarsim_server.testing import Rehearsal, RehearsedClient
from usarsim_server.worlds.description import StartPose

HERE = StartPose("Here", Pose((0.0, 0.0, 0.3)))


class Ride:
    """One robot in a world, and where it is."""

    def __init__(
        self, rehearsal: Rehearsal, tag: str, yaw: float = 0.0, kind: str = "P2AT"
    ) -> None:
        self._rehearsal = rehearsal
        self._client: RehearsedClient = rehearsal.connect()
        place = f"{{Start {tag}}}"
        if yaw:
            place = f"{{Location 0,0,-0.25}} {{Rotation 0,0,{yaw}}}"
        self._client.send(f"INIT {{ClassName USARBot.{kind}}} {{Name R{tag}{yaw:.1f}}} {place}")
        rehearsal.run(1.0)

    def drive(self, speed: float, seconds: float) -> list[np.ndarray]:
        """Straight on with a wheel speed (rad/s); places every 50 ms."""
        self._client.send(f"DRIVE {{Left {speed}}} {{Right {speed}}}")
        places = []
        for _ in range(round(seconds / 0.05)):
            self._rehearsal.run(0.05)
            places.append(self.place())
        return places

    def place(self) -> np.ndarray:
        """Position now."""
        snapshot = self._rehearsal.assembly.simulation.look()
        layout = max(snapshot.layouts.items())[1]
        return np.array(snapshot.xpos[layout.base])

    def close(self) -> None:
        """Leave."""
        self._client.close()


def folder_of(tmp_path: Path, scene: Scene) -> str:
    """A world folder for a scene."""
    return str(build_world(tmp_path, scene).built.folder)


def test_through_a_doorway(tmp_path: Path) -> None:
    """A robot drives through a doorway of 1 m; beside it the wall stops it (worlds 52)."""
    source = tmp_path / "two.t3d"
    source.write_text(two_rooms())
    folder = str(import_map(Request(source)).folder)
    with Rehearsal(world=folder) as rehearsal:
        through = Ride(rehearsal, "Entry")
        assert through.drive(4.0, 9.0)[-1][0] > 3.0
        beside = Ride(rehearsal, "PlayerStart_1")
        way = beside.drive(4.0, 9.0)
        assert 1.2 < way[-1][0] < 2.0
        assert max(p[0] for p in way) < 2.0


def test_a_map_can_be_served_at_once(tmp_path: Path) -> None:
    """The world of a server may be a map file; clients are told its starts (worlds 25, 27)."""
    source = tmp_path / "two.t3d"
    source.write_text(two_rooms().replace("Yaw=0", "Yaw=81920", 1))
    with Rehearsal(world=str(source)) as rehearsal:
        client = rehearsal.connect()
        client.send("GETSTARTPOSES")
        (line,) = client.take("NFO {StartPoses 2}")
        head, _, rest = line.partition("{Entry 0.0000,0.0000,-0.2400 0.0000,0.0000,")
        assert head
        # The editor's angle is passed on as it is, 5/4 turns (worlds 8).
        assert float(rest.split()[0]) == pytest.approx(7.8540, abs=2e-4)
        assert rest.split()[1] == "PlayerStart_1"
        start = rehearsal.assembly.world.starts[0]
        assert start.pose.rotate((1.0, 0.0, 0.0)) == pytest.approx((0.0, -1.0, 0.0))
        assert rehearsal.assembly.world.name == "two"


def package(folder: Path) -> Path:
    """A room as a UDK map."""
    path = folder / "hall.udk"
    path.write_bytes(udk_room().content())
    return path


def stage(folder: Path) -> Path:
    """A floor with a wall as a stage."""
    made = pytest.importorskip("usd_stages")
    hall = made.stage_at(folder / "hall.usda", unit=0.01)
    made.box(hall, "/World/Floor", (-500, -500, -10), (500, 500, 0))
    made.box(hall, "/World/Wall", (200, -500, 0), (220, 500, 200))
    made.moved(made.UsdGeom.Xform.Define(hall, "/World/PlayerStart_0"), (0, 0, 24))
    hall.GetRootLayer().Save()
    return folder / "hall.usda"


@pytest.mark.parametrize("make", [package, stage])
def test_maps_of_other_formats_can_be_served(tmp_path: Path, make: Callable[[Path], Path]) -> None:
    """A robot drives in a UDK map or a stage until its wall (worlds 19, 27, 38)."""
    with Rehearsal(world=str(make(tmp_path))) as rehearsal:
        client = rehearsal.connect()
        client.send("GETSTARTPOSES")
        (line,) = client.take("NFO {StartPoses 1}")
        assert "PlayerStart_0 0.0000,0.0000,-0.2400" in line
        x, _, z = Ride(rehearsal, "PlayerStart_0").drive(4.0, 8.0)[-1]
        assert 1.2 < x < 2.0
        assert 0.0 < z < 0.4


def triangle_floor() -> SceneObject:
    """A floor of 200 triangles which all lie a hundredth of a millimetre apart in height.

    So near that they count as coplanar or not by chance: the worst case for joints.
    """
    heights = np.random.default_rng(3).uniform(0.0, 1e-5, (11, 11))
    return thing(grid_mesh(10, 10, 12.0, heights), "floor")


def test_a_floor_of_triangles_is_level(tmp_path: Path) -> None:
    """Rolling 3 m over 200 triangles the height changes by less than 1 mm (worlds 53)."""
    with Rehearsal(
        world=folder_of(tmp_path, scene_of(triangle_floor(), starts=[HERE]))
    ) as rehearsal:
        ride = Ride(rehearsal, "Here")
        ride.drive(3.0, 1.0)
        way = ride.drive(3.0, 9.0)
        assert way[-1][0] - way[0][0] > 3.0
        heights = [p[2] for p in way]
        assert max(heights) - min(heights) < 1e-3


@pytest.mark.parametrize("kind", ["brush", "mesh"])
def test_nobody_leaves_a_closed_room(tmp_path: Path, kind: str) -> None:
    """Driven into each wall at full speed for 10 s the robot stays inside (worlds 55)."""
    if kind == "brush":
        source = tmp_path / "room.t3d"
        room = brush("R", (-500, -500, 0), (500, 500, 750), "CSG_Subtract")
        source.write_text(level(room, start("S", (0, 0, 60), "Here")))
        folder = str(import_map(Request(source)).folder)
    else:
        hollow = thing(cuboid_mesh((-2, -2, 0), (2, 2, 3), inward=True), "hollow")
        folder = folder_of(tmp_path, scene_of(hollow, starts=[HERE]))
    with Rehearsal(world=folder) as rehearsal:
        for quarter in range(4):
            ride = Ride(rehearsal, "Here", 1e-6 + quarter * math.pi / 2)
            places = ride.drive(8.0, 10.0)
            assert np.abs(np.array(places)[:, :2]).max() < 2.0
            assert np.array(places)[:, 2].min() > 0.0
            assert np.linalg.norm(places[-1][:2]) > 1.0
            ride.close()
            rehearsal.run(0.1)


def test_a_quad_carries_a_robot(tmp_path: Path) -> None:
    """A floor of a single quad, without thickness in the map, is stood on (worlds 59)."""
    quad = thing(grid_mesh(1, 1, 10.0), "quad")
    with Rehearsal(world=folder_of(tmp_path, scene_of(quad, starts=[HERE]))) as rehearsal:
        ride = Ride(rehearsal, "Here")
        before = ride.place()
        after = ride.drive(2.0, 4.0)[-1]
        assert after[2] == pytest.approx(before[2], abs=2e-3)
        assert after[0] > before[0] + 0.5


def test_robots_may_stand_on_slopes_and_steps(tmp_path: Path) -> None:
    """A ramp mesh is climbed at its surface: the height follows it."""
    ramp = cuboid_mesh((1, -2, 0), (4, 2, 0.6))
    ramp.vertices[(ramp.vertices[:, 0] == 1) & (ramp.vertices[:, 2] > 0), 2] = 0.0
    floor = thing(cuboid_mesh((-5, -5, -0.2), (8, 5, 0)), "floor")
    with Rehearsal(
        world=folder_of(tmp_path, scene_of(floor, thing(ramp, "ramp"), starts=[HERE]))
    ) as rehearsal:
        ride = Ride(rehearsal, "Here")
        flat = ride.place()[2]
        way = np.array(ride.drive(4.0, 6.0))
        on_ramp = way[(way[:, 0] > 1.8) & (way[:, 0] < 3.5)]
        assert len(on_ramp) > 5
        expected = flat + (on_ramp[:, 0] - 1.0) * 0.2
        np.testing.assert_allclose(on_ramp[:, 2], expected, atol=0.02)


def test_a_robot_passes_the_door_of_a_thin_wall(tmp_path: Path) -> None:
    """A P3AT drives through a door of 0.9 m in a wall of 1.5 cm; the wall beside it stops it."""
    door = np.ones((3, 1, 2), dtype=bool)
    door[1, 0, 0] = False
    wall = blocks(door, (-5, -0.45, 0.45, 5), (0.7925, 0.8075), (0, 2, 3))
    across = mesh_of(wall.vertices[:, [1, 0, 2]], wall.triangles[:, ::-1])
    floor = thing(cuboid_mesh((-6, -6, -0.2), (6, 6, 0)), "floor")
    starts = [HERE, StartPose("Beside", Pose((0.0, 2.0, 0.3)))]
    folder = folder_of(tmp_path, scene_of(floor, thing(across, "wall"), starts=starts))
    with Rehearsal(world=folder) as rehearsal:
        through = Ride(rehearsal, "Here", kind="P3AT")
        assert through.drive(4.0, 14.0)[-1][0] > 1.5
        beside = Ride(rehearsal, "Beside", kind="P3AT")
        assert 0.4 < max(place[0] for place in beside.drive(4.0, 10.0)) < 0.7925


def test_a_robot_climbs_loose_stairs(tmp_path: Path) -> None:
    """Onto a step of 4 cm that can be pushed a robot drives and stands on its tread."""
    grid = np.tril(np.ones((2, 2), dtype=bool))
    low = blocks(grid[:, None, :], (0, 1.2, 2.4), (-0.45, 0.45), (0, 0.04, 0.08))
    floor = thing(cuboid_mesh((-6, -6, -0.2), (6, 6, 0)), "floor")
    loose = thing(low, "steps", Pose((0.4, 0.0, 0.0)), movable=True, mass=200.0)
    with Rehearsal(world=folder_of(tmp_path, scene_of(floor, loose, starts=[HERE]))) as rehearsal:
        ride = Ride(rehearsal, "Here", kind="P3AT")
        flat = ride.place()[2]
        way = np.array(ride.drive(4.0, 14.0))
        first = way[(way[:, 0] > 0.8) & (way[:, 0] < 1.2)]
        assert len(first) > 3
        np.testing.assert_allclose(first[:, 2], flat + 0.04, atol=0.01)
