"""What is felt is what is seen, wherever robots may drive (worlds reference 9.3 and 9.4)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from built_worlds import build_world, cuboid_mesh, grid_mesh, joined, mesh_of, scene_of, thing
from numpy.typing import NDArray

from usarsim_maps.build.mesh_error import model_error
from usarsim_maps.scene import Mesh, Part, SceneObject
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy

Array = NDArray[np.float64]
Change = Callable[[Mesh], Mesh]

POST = 0.1
"""m: side of the posts of a step field."""


def posts(heights: Array) -> Mesh:
    """A step field of closed blocks."""
    return joined(
        *(
            cuboid_mesh((x * POST, y * POST, 0.0), ((x + 1) * POST, (y + 1) * POST, float(height)))
            for (y, x), height in np.ndenumerate(heights)
        )
    )


def terraces(heights: Array) -> Mesh:
    """A step field of one skin: tops, and walls between neighbours and around; no bottom."""
    quads: list[Array] = []
    for (y, x), top in np.ndenumerate(heights):
        corners = np.array([[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]]) * POST
        quads.append(np.column_stack([corners, np.full(4, top)]))
        for side, (dx, dy) in enumerate(((0, -1), (1, 0), (0, 1), (-1, 0))):
            inside = 0 <= x + dx < heights.shape[1] and 0 <= y + dy < heights.shape[0]
            foot = heights[y + dy, x + dx] if inside else 0.0
            if foot < top:
                a, b = corners[side], corners[(side + 1) % 4]
                quads.append(np.array([[*a, foot], [*b, foot], [*b, top], [*a, top]]))
    faces = [
        [4 * n + k for k in ring] for n in range(len(quads)) for ring in ((0, 1, 2), (0, 2, 3))
    ]
    return mesh_of(np.concatenate(quads), faces)


def stairs() -> Mesh:
    """Eight steps of closed blocks that share corners, so that edges belong to four triangles."""
    return joined(
        *(cuboid_mesh((0.28 * n, 0, 0), (0.28 * (n + 1), 1, 0.18 * (n + 1))) for n in range(8))
    )


def as_it_is(mesh: Mesh) -> Mesh:
    """Sound windings."""
    return mesh


def reversed_(mesh: Mesh) -> Mesh:
    """All triangles face inwards."""
    return mesh_of(mesh.vertices, mesh.triangles[:, ::-1])


def mixed(mesh: Mesh) -> Mesh:
    """Half of the triangles face inwards."""
    turned = np.random.default_rng(0).random(len(mesh.triangles)) < 0.5
    return mesh_of(
        mesh.vertices, np.where(turned[:, None], mesh.triangles[:, ::-1], mesh.triangles)
    )


def dome(radius: float = 1.0) -> Mesh:
    """The upper half of a ball, open below."""
    around, up = np.meshgrid(np.linspace(0, 2 * np.pi, 33), np.linspace(0, np.pi / 2, 11))
    ball = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], -1)
    flat = grid_mesh(32, 10, 1.0)
    return mesh_of(radius * ball.reshape(-1, 3), flat.triangles)


def arena() -> Mesh:
    """A floor with walls around it, a ramp, and a step field."""
    dice = np.random.default_rng(4)
    floor = grid_mesh(1, 1, 8.0)
    walls = [cuboid_mesh((x, -4, 0), (x + 0.3, 4, 2.5)) for x in (-4.0, 3.7)]
    ramp = cuboid_mesh((-2, -2, 0), (0, -1, 0.5))
    ramp.vertices[(ramp.vertices[:, 0] == -2) & (ramp.vertices[:, 2] > 0), 2] = 0.05
    field = terraces(dice.uniform(0.05, 0.4, (6, 6)))
    moved = mesh_of(field.vertices + np.array([1.0, 1.0, 0.0]), field.triangles)
    return joined(floor, *walls, ramp, moved)


HEIGHTS = np.random.default_rng(1).uniform(0.02, 0.4, (11, 11)).round(3)
CUBIC = 0.1 + 0.05 * np.random.default_rng(2).integers(0, 5, (11, 11))
"""Posts of five heights, of which many neighbours are equal."""

THINGS: dict[str, Mesh] = {
    "posts": posts(HEIGHTS),
    "cubic posts": posts(CUBIC),
    "terraces": terraces(HEIGHTS),
    "cubic terraces": terraces(CUBIC),
    "stairs": stairs(),
    "dome": dome(),
    "arena": arena(),
    "rubble": grid_mesh(16, 16, 2.0, np.random.default_rng(3).uniform(0.0, 0.15, (17, 17))),
    "wide rubble": grid_mesh(50, 50, 10.0, np.random.default_rng(3).uniform(0.0, 0.2, (51, 51))),
}


def worst(folder: Path, *objects: SceneObject) -> tuple[float, float, float]:
    """m in the median and at 95 %, and the part where nothing is felt, of whatever is worst."""
    world = build_world(folder, scene_of(*objects))
    found = model_error(world.model).things.values()
    return tuple(max(getattr(one, key) for one in found) for key in ("median", "most", "lost"))  # type: ignore[return-value]


@pytest.mark.parametrize("change", [as_it_is, reversed_, mixed])
@pytest.mark.parametrize("name", THINGS)
def test_felt_is_seen(tmp_path: Path, name: str, change: Change) -> None:
    """Step fields, stairs, ramps, domes and ground are felt within 1 cm in the median and 2 cm at
    95 % of what may be driven on, whatever the windings are."""
    median, most, lost = worst(tmp_path, thing(change(THINGS[name]), name))
    assert median < 0.01
    assert most < 0.02
    assert lost == 0.0


TURNS = {
    "mirrored": np.diag([1.0, -1.0, 1.0, 1.0]),
    "rolled by pi": np.diag([1.0, -1.0, -1.0, 1.0]),
    "both": np.diag([1.0, 1.0, -1.0, 1.0]),
}


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("change", [as_it_is, reversed_])
@pytest.mark.parametrize("name", ["posts", "terraces", "arena", "wide rubble"])
def test_instances_are_felt_where_they_are_seen(
    tmp_path: Path, name: str, change: Change, turn: str
) -> None:
    """So they are where a part mirrors its mesh, or a map lies on its back and is rolled by pi,
    as long as it shows its upper side."""
    mesh, matrix = change(THINGS[name]), TURNS[turn]
    upright = mesh_of(mesh.vertices @ np.linalg.inv(matrix)[:3, :3].T, mesh.triangles)
    place = Pose((0.4, -0.3, 0.0), quaternion_from_rpy(0.0, 0.0, 0.3))
    one = SceneObject("thing", (Part(upright, matrix),), place)
    median, most, lost = worst(tmp_path, one)
    assert median < 0.01
    assert most < 0.02
    assert lost == 0.0


@pytest.mark.parametrize("name", ["cubic posts", "terraces"])
def test_step_fields_that_are_pushed(tmp_path: Path, name: str) -> None:
    """A step field that the map forgot to fix is felt as it is seen, and lies still."""
    floor = thing(grid_mesh(1, 1, 6.0), "floor")
    field = thing(THINGS[name], "field", movable=True)
    model = build_world(tmp_path, scene_of(floor, field)).model
    error = model_error(model).things["field"]
    assert (error.median, error.most, error.lost) == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 1000)
    assert np.abs(data.body("field").xpos).max() < 5e-3


def test_the_report_says_how_far_off(tmp_path: Path) -> None:
    """The difference stands in the report; things that are far off are named."""
    invisible = SceneObject("plate", (Part(cuboid_mesh((0, 0, 0), (2, 2, 0.1)), visible=False),))
    floor = thing(grid_mesh(1, 1, 6.0), "floor")
    good = build_world(tmp_path, scene_of(floor))
    assert str(good.findings.facts["felt - seen"]).startswith("0.0 mm in the median, 0.0 mm at")
    assert "is felt" not in good.texts()
    bad = build_world(tmp_path, scene_of(floor, invisible))
    assert "floor: is felt 0 mm off what is seen in the median, 100 mm at 95 %" in bad.texts()
