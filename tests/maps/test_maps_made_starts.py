"""Starts that the importer makes face a free way on level ground."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from built_worlds import World, build_world, cuboid_mesh, import_text, mesh_of, scene_of, thing
from t3d_maps import brush, level

from usarsim_maps.build.facts import AHEAD, Probe, free_way
from usarsim_maps.convert import Request, import_map
from usarsim_maps.reader import ImportOptions
from usarsim_maps.scene import Part, Plane, SceneObject
from usarsim_server.simulation.frames import Pose, rpy_from_quaternion
from usarsim_server.worlds.description import StartPose
from usarsim_server.worlds.loader import load_world

GROUND = SceneObject("Ground", (Part(Plane()),))
FLOOR = thing(cuboid_mesh((-8, -8, -0.2), (8, 8, 0)), "Floor")


def facing(world: World) -> tuple[float, float]:
    """Yaw of the first start, degrees, and m of free way ahead of it."""
    pose = world.description.starts[0].pose
    probe = Probe(world.built.folder / "scene.xml", world.scene.source.path)
    yaw = rpy_from_quaternion(pose.quaternion)[2]
    best, way = free_way(probe, pose.position)
    assert math.cos(best - yaw) == pytest.approx(1.0)
    return math.degrees(yaw), way


def test_a_corridor(tmp_path: Path) -> None:
    """In a corridor along y it looks along y, to the left of two equal ways."""
    text = level(brush("Hall", (-200, -2000, 0), (200, 2000, 600), "CSG_Subtract"))
    yaw, way = facing(import_text(tmp_path, text))
    assert yaw == pytest.approx(90.0)
    assert way > 7.0


def test_a_wall_before_the_middle(tmp_path: Path) -> None:
    """It turns away from a wall, and goes where there is no room beside the middle."""
    wall = thing(cuboid_mesh((0.6, -8, 0), (0.8, 8, 2)), "Wall")
    yaw, way = facing(build_world(tmp_path, scene_of(FLOOR, wall)))
    assert abs(yaw) > 90.0
    assert way > 4.0
    closet = [
        thing(cuboid_mesh(low, high), "Closet")
        for low, high in (
            ((-1, -1, 0), (-0.9, 1, 2)), ((0.9, -1, 0), (1, 1, 2)),
            ((-1, -1, 0), (1, -0.9, 2)), ((-1, 0.9, 0), (1, 1, 2)),
        )
    ]  # fmt: skip
    assert facing(build_world(tmp_path, scene_of(FLOOR, *closet)))[1] > AHEAD


@pytest.mark.parametrize("top", [0.15, 0.7, 1.2])
def test_what_is_in_the_way(tmp_path: Path, top: float) -> None:
    """A low sill, a table's edge and a bar at the side all stop a robot; a high lamp does not."""
    bars = [thing(cuboid_mesh((1, 0.2, top - 0.15), (1.2, 9, top)), "Bar")]
    scene = scene_of(GROUND, *bars, starts=[StartPose("Made", Pose((0, 0, 0.25)))])
    yaw, way = facing(build_world(tmp_path, replace(scene, starts_made=True)))
    assert way > AHEAD
    assert (yaw == pytest.approx(0.0)) is (top > 1.0)


def test_the_floor_goes_on(tmp_path: Path) -> None:
    """Where the floor ends, or becomes a steep ramp, there is no way."""
    strip = thing(cuboid_mesh((-1, -6, -0.2), (1, 6, 0)), "Strip")
    assert abs(facing(build_world(tmp_path, scene_of(strip)))[0]) == pytest.approx(90.0)
    ramp = mesh_of([(1, -6, 0), (4, -6, 2), (4, 6, 2), (1, 6, 0)], [(0, 1, 2), (0, 2, 3)])
    yaw, way = facing(build_world(tmp_path, scene_of(FLOOR, thing(ramp, "Ramp"))))
    assert abs(yaw) > 80.0
    assert way > AHEAD


def test_starts_of_the_map_stay(tmp_path: Path) -> None:
    """What a map says is told as it is, whatever is before it."""
    wall = thing(cuboid_mesh((0.6, -8, 0), (0.8, 8, 2)), "Wall")
    said = StartPose("Said", Pose((0.0, 0.0, 0.25)))
    world = build_world(tmp_path, scene_of(GROUND, wall, starts=[said]))
    assert world.description.starts[0].pose == said.pose


def test_starts_of_grids(tmp_path: Path) -> None:
    """Those that occupancy maps make look along the longest way, too."""
    rows = ["1" * 40, *(["1" + "0" * 38 + "1"] * 14), "1" * 40]
    source = tmp_path / "plan.txt"
    source.write_text("\n".join(["16", "40", *rows]) + "\n")
    result = import_map(Request(source, options=ImportOptions(scale=5.0)))
    world = load_world(result.folder)
    assert len(world.starts) == 4
    probe = Probe(result.folder / "scene.xml", source)
    for start in world.starts:
        yaw, way = free_way(probe, start.pose.position)
        assert way > AHEAD
        assert rpy_from_quaternion(start.pose.quaternion)[2] == pytest.approx(yaw)
