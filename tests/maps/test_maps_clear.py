"""Clear things: one rule for all formats."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from built_worlds import World, build_world, cuboid_mesh, scene_of, thing

from usarsim_maps.build.clear import FAINTEST
from usarsim_maps.report import Report, make_report
from usarsim_maps.scene import (
    Box,
    Brush,
    Collision,
    Heightfield,
    Material,
    Part,
    Polygon,
    Scene,
    SceneObject,
)
from usarsim_server.simulation.frames import Pose
from usarsim_server.worlds.description import StartPose

FLOOR = thing(cuboid_mesh((-5, -5, -0.2), (5, 5, 0.0)), "floor")
HERE = StartPose("Here", Pose((0.0, 0.0, 0.3)))
EAST = [[1.0, 0.0, 0.0]]


def pane(**more: object) -> SceneObject:
    """A thing of one box, 2.9 m ahead."""
    part = Part(Box((0.2, 2.0, 2.0)), materials={0: "skin"}, **more)  # type: ignore[arg-type]
    return SceneObject("pane", (part,), Pose((3.0, 0.0, 1.0)))


def scene(opacity: float, *objects: SceneObject, meant: bool = False, name: str = "skin") -> Scene:
    """Things whose material has an opacity."""
    material = Material(name, (0.2, 0.4, 0.6, opacity), meant=meant)
    return scene_of(FLOOR, *objects, starts=[HERE], materials={name: material})


def opacity(world: World, name: str) -> float:
    """Of a geom."""
    geom = world.model.geom(name)
    return float(world.model.mat_rgba[geom.matid.item(), 3])


def report_of(world: World) -> Report:
    """What the user is told."""
    return make_report(world.scene, world.built, world.findings, 0.0)


@pytest.mark.parametrize("meant", [True, False])
@pytest.mark.parametrize("part", [0.2, 0.9])
def test_clear_in_part(tmp_path: Path, part: float, meant: bool) -> None:
    """Cameras draw it so, lasers see it, the report names it."""
    world = build_world(tmp_path, scene(part, pane(), meant=meant))
    assert opacity(world, "pane") == pytest.approx(part)
    assert world.rays((0, 0, 1), EAST) == pytest.approx([2.9])  # type: ignore[arg-type]
    report = report_of(world)
    assert report.clear == (("skin", part),)
    assert f"skin ({100 * part:.0f} %) opaque for cameras; lasers see" in report.text()


def test_wholly_clear_materials(tmp_path: Path) -> None:
    """What is solid and to be seen is opaque then, and that is told."""
    world = build_world(tmp_path, scene(0.0, pane()))
    assert opacity(world, "pane") == 1.0
    assert "skin: it is wholly clear" in world.texts()
    assert report_of(world).clear == ()


def test_things_that_are_said_to_be_clear(tmp_path: Path) -> None:
    """Cameras do not see them, lasers do."""
    world = build_world(tmp_path, scene(0.0, pane(), meant=True))
    assert opacity(world, "pane") == pytest.approx(FAINTEST, abs=1e-6)
    assert world.rays((0, 0, 1), EAST) == pytest.approx([2.9])  # type: ignore[arg-type]
    assert "wholly clear" not in world.texts()
    assert "(0 %) opaque for cameras" in report_of(world).text()


@pytest.mark.parametrize("meant", [True, False])
def test_what_is_not_felt_stays_unseen(tmp_path: Path, meant: bool) -> None:
    """Neither seen nor felt, a thing is nothing, even if a solid one has its material."""
    ghost = replace(pane(collision=Collision.NONE), name="ghost", pose=Pose((1.5, 0, 1)))
    world = build_world(tmp_path, scene(0.0, ghost, pane(), meant=meant))
    assert opacity(world, "ghost") == 0.0
    assert world.rays((0, 0, 1), EAST) == pytest.approx([2.9])  # type: ignore[arg-type]


def test_looks_and_hulls_of_one_thing(tmp_path: Path) -> None:
    """A thing whose hull is another part is solid, too."""
    looks, hull = pane(collision=Collision.NONE).parts[0], pane(visible=False).parts[0]
    world = build_world(tmp_path, scene(0.0, replace(pane(), parts=(looks, hull))))
    assert opacity(world, "pane") == 1.0


def test_slots_of_meshes(tmp_path: Path) -> None:
    """Each slot for itself, whoever shares the mesh."""
    mesh = replace(cuboid_mesh((-0.1, -1, -1), (0.1, 1, 1)), materials=("skin",))
    solid = SceneObject("solid", (Part(mesh),), Pose((3.0, 0.0, 1.0)))
    ghost = SceneObject("ghost", (Part(mesh, collision=Collision.NONE),), Pose((1.0, 0.0, 1.0)))
    world = build_world(tmp_path, scene(0.0, ghost, solid))
    assert (opacity(world, "ghost"), opacity(world, "solid")) == (0.0, 1.0)


def test_brushes_and_terrain(tmp_path: Path) -> None:
    """They are solid."""
    ring = [(1, 1), (2, 1), (2, 2), (1, 2)]
    corners = [(x, y, z) for z in (0, 1) for x, y in ring]
    sides = [(3, 2, 1, 0), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    polygons = tuple(Polygon(np.array([corners[n] for n in side], float), "skin") for side in sides)
    terrain = Heightfield("hill", np.zeros((3, 3)), (1.0, 1.0), Pose((-4, -4, 0.1)), "skin")
    found = scene(0.0)
    world = build_world(
        tmp_path, replace(found, brushes=(Brush("block", polygons),), heightfields=(terrain,))
    )
    assert opacity(world, "hill") == 1.0
    assert opacity(world, "level") == 1.0


def test_glass_is_named_as_rays_see_it(tmp_path: Path) -> None:
    """Whole words count: lasers pass glass, not fibreglass or the paint of a transport box."""
    panes = []
    materials = {}
    for number, name in enumerate(("shop_glass", "fiberglass", "TransportBox")):
        part = Part(Box((0.2, 0.5, 2.0)), materials={0: name})
        panes.append(SceneObject(f"p{number}", (part,), Pose((3.0, number - 1.0, 1.0))))
        materials[name] = Material(name, (1, 1, 1, 0.5))
    world = build_world(tmp_path, scene_of(FLOOR, *panes, starts=[HERE], materials=materials))
    report = report_of(world)
    assert report.transparent == ("shop_glass",)
    assert [name for name, _ in report.clear] == ["TransportBox", "fiberglass", "shop_glass"]
    text = report.text()
    assert "lasers pass shop_glass" in text
    assert "lasers see them as they are felt, but for what they pass" in text


def test_things_that_are_called_glass(tmp_path: Path) -> None:
    """Lasers pass a thing by its own name, too, whatever its material is called."""
    world = build_world(tmp_path, scene(0.2, replace(pane(), name="Glass_3")))
    report = report_of(world)
    assert report.transparent == ("Glass_3",)
    assert report.clear == (("skin", 0.2),)
