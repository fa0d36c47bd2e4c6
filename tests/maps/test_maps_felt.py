"""What is felt is what is seen, from above and from the side (worlds reference 9.3 and 9.4)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from built_worlds import (
    AXES,
    blocks,
    build_world,
    cuboid_mesh,
    grid_mesh,
    holed_plate,
    joined,
    mesh_of,
    scene_of,
    thing,
    torus,
)
from lanes import slow_but
from numpy.typing import NDArray

from usarsim_maps.build.mesh_error import model_error
from usarsim_maps.scene import Collision, Heightfield, Mesh, Part, SceneObject
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


def aslant(mesh: Mesh) -> Mesh:
    """Turned by 30 degrees about z."""
    turn = Pose((0.0, 0.0, 0.0), quaternion_from_rpy(0.0, 0.0, np.pi / 6)).matrix()
    return mesh_of(mesh.vertices @ turn.T, mesh.triangles)


def apart(mesh: Mesh) -> Mesh:
    """Each triangle has corners of its own."""
    corners = mesh.vertices[mesh.triangles].reshape(-1, 3)
    return mesh_of(corners, np.arange(len(corners)).reshape(-1, 3))


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


@pytest.mark.parametrize(
    "change", slow_but(lambda one: one is as_it_is, [as_it_is, reversed_, mixed])
)
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


@pytest.mark.slow
@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("change", slow_but(lambda one: one is as_it_is, [as_it_is, reversed_]))
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


@pytest.mark.slow
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
    assert "floor: it is felt 0 mm off what is seen in the median, 100 mm at 95 %" in bad.texts()


def filled(shape: tuple[int, int, int], *empty: tuple[object, ...]) -> NDArray[np.bool_]:
    """Blocks of a grid, but for some."""
    found = np.ones(shape, dtype=bool)
    for place in empty:
        found[place] = False  # type: ignore[index]
    return found


def steps(count: int, width: float) -> Mesh:
    """Solid stairs of one skin, whose sides do not meet edge by edge."""
    grid = np.arange(count)[:, None] >= np.arange(count)[None, :]
    return blocks(
        grid[:, None, :],
        (np.arange(count + 1) * 0.2).tolist(),
        (-width / 2.0, width / 2.0),
        (np.arange(count + 1) * 0.2).tolist(),
    )


def sheet_with_door() -> Mesh:
    """A wall without thickness, seen from both sides, with a door of 0.9 x 2 m."""
    corners = [(x, 0.0, z) for x in (-3.0, -0.45, 0.45, 3.0) for z in (0.0, 2.0, 3.0)]
    quads = [(0, 3, 4, 1), (1, 4, 5, 2), (4, 7, 8, 5), (6, 9, 10, 7), (7, 10, 11, 8)]
    one = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return mesh_of(corners, one + [t[::-1] for t in one])


EVERY, MIDDLE = slice(None), slice(1, 2)
LEGS = [(MIDDLE, EVERY, 0), (EVERY, MIDDLE, 0)]
OPEN: dict[str, tuple[Mesh, int, list[tuple[float, float]]]] = {
    "door": (
        blocks(filled((3, 1, 2), (1, 0, 0)), (-5, -0.45, 0.45, 5), (0, 0.015), (0, 2, 3)),
        3,
        [(0.0, 0.5), (-0.43, 1.98), (0.43, 0.02)],
    ),
    "two sided sheet": (sheet_with_door(), 5, [(0.0, 0.5), (-0.43, 1.9)]),
    "round hole": (holed_plate(64, 0.3, 2.0, 0.015), 40, [(0.0, 1.0), (0.28, 1.0)]),
    "small round hole": (holed_plate(24, 0.13, 1.2, 0.02), 26, [(0.0, 0.6), (0.1, 0.6)]),
    "square hole": (
        blocks(filled((3, 1, 3), (1, 0, 1)), (-2, 0, 0.25, 2), (0, 0.01), (0, 0.8, 1.05, 1.5)),
        4,
        [(0.12, 0.9), (0.02, 1.02)],
    ),
    "picture frame": (
        blocks(
            filled((3, 1, 3), (1, 0, 1)),
            (-0.25, -0.2, 0.2, 0.25),
            (0, 0.02),
            (0, 0.05, 0.45, 0.5),
        ),
        4,
        [(0.0, 0.25)],
    ),
    "gate": (
        blocks(filled((3, 1, 2), (1, 0, 0)), (-1.2, -1.1, 1.1, 1.2), (0, 0.1), (0, 2.2, 2.3)),
        3,
        [(0.0, 0.5), (1.08, 2.18)],
    ),
    "table": (
        blocks(
            filled((3, 3, 2), *LEGS),
            (-0.7, -0.64, 0.64, 0.7),
            (-0.4, -0.34, 0.34, 0.4),
            (0, 0.7, 0.74),
        ),
        8,
        [(0.0, 0.3), (0.6, 0.65)],
    ),
    "chair": (
        blocks(
            filled((3, 3, 3), *LEGS, (slice(1, 3), EVERY, 2)),
            (-0.2, -0.16, 0.16, 0.2),
            (-0.2, -0.16, 0.16, 0.2),
            (0, 0.42, 0.46, 0.9),
        ),
        8,
        [(0.0, 0.2), (0.1, 0.7)],
    ),
    "torus": (torus(32, 16, 0.5, 0.12), 32, []),
}
"""Things with openings, how many pieces are enough, and x and z of places to look through them."""
CHANGES = [as_it_is, reversed_, mixed, apart, aslant]


@pytest.mark.parametrize("change", slow_but(lambda one: one is as_it_is, CHANGES))
@pytest.mark.parametrize("name", OPEN)
def test_openings_are_felt_open(tmp_path: Path, name: str, change: Change) -> None:
    """Doors, holes, frames, tables and gates are open for robots where they are open to the eye,
    whatever the windings are, and whether they can be pushed or not."""
    mesh, most, places = OPEN[name]
    floor = thing(cuboid_mesh((-8, -8, -0.5), (8, 8, -0.001)), "floor")
    ways = np.array([[0.0, 1.0, 0.0]])
    if change is aslant:
        ways = np.array([[-0.5, np.sqrt(0.75), 0.0]])
    if change is aslant:
        mesh = mesh_of(mesh.vertices - [0.0, mesh.vertices[:, 1].mean(), 0.0], mesh.triangles)
    for movable in (False, True):
        one = thing(change(mesh), "it", movable=movable)
        world = build_world(tmp_path, scene_of(floor, one))
        error = model_error(world.model)
        assert (error.sides["it"].blocked, error.sides["it"].passed) == (0, 0)
        assert error.sides["it"].rays > 100
        assert world.built.pieces - 1 <= most
        for x, z in places:
            turn = np.pi / 6 if change is aslant else 0.0
            middle = np.array([x * np.cos(turn), x * np.sin(turn), z])
            start = middle - 3.0 * ways[0]
            assert world.solid_rays(tuple(start.tolist()), ways)[0] == np.inf, (x, z)


@pytest.mark.parametrize("change", slow_but(lambda one: one is as_it_is, CHANGES))
def test_loose_stairs_are_stairs(tmp_path: Path, change: Change) -> None:
    """Each tread of stairs that can be pushed is felt where it is, also after a push."""
    floor = thing(cuboid_mesh((-8, -8, -0.5), (8, 8, 0.0)), "floor")
    loose = thing(change(steps(5, 0.9)), "stairs", movable=True, mass=20.0)
    model = build_world(tmp_path, scene_of(floor, loose)).model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    body = model.body("stairs").id
    turn = np.pi / 6 if change is aslant else 0.0
    for pushed in (False, True):
        if pushed:
            data.xfrc_applied[body] = (0.0, 300.0, 0.0, 0.0, 0.0, 10.0)
            mujoco.mj_step(model, data, 300)
            assert np.linalg.norm(data.xpos[body][:2]) > 0.05
        groups = np.array([0, 0, 0, 1, 0, 0], dtype=np.uint8)
        geom = np.zeros(1, dtype=np.int32)
        matrix = data.xmat[body].reshape(3, 3)
        for number in range(5):
            for across in (-0.43, 0.02, 0.43):
                for along in (0.02, 0.11, 0.18):
                    x = 0.2 * number + along
                    spot = np.array([
                        x * np.cos(turn) - across * np.sin(turn),
                        x * np.sin(turn) + across * np.cos(turn),
                        2.0,
                    ])  # fmt: skip
                    start = data.xpos[body] + matrix @ spot
                    down = -matrix[:, 2]
                    way = mujoco.mj_ray(model, data, start, down, groups, 1, -1, geom, None)
                    assert way == pytest.approx(2.0 - 0.2 * (number + 1), abs=2e-3)


def test_what_cannot_be_cut_is_told(tmp_path: Path) -> None:
    """A loose thing of more than 64 convex pieces becomes a hull, and the report says so."""
    floor = thing(cuboid_mesh((-8, -8, -0.5), (8, 8, 0.0)), "floor")
    comb = blocks(
        filled((141, 1, 2), (slice(1, None, 2), 0, 1)),
        np.linspace(0.0, 1.05, 142).tolist(), (0.0, 0.3), (0.0, 0.1, 0.6),
    )  # fmt: skip
    world = build_world(tmp_path, scene_of(floor, thing(comb, "comb", movable=True)))
    assert world.built.pieces == 2
    assert "comb: it moves, and cannot be cut into 64 convex pieces or fewer; its hull" in (
        world.texts()
    )


def test_the_report_looks_from_the_side(tmp_path: Path) -> None:
    """A door that is felt closed is told, though all that may be driven on is right."""
    floor = thing(cuboid_mesh((-8, -8, -0.5), (8, 8, 0.0)), "floor")
    door = OPEN["door"][0]
    open_ = build_world(tmp_path, scene_of(floor, thing(door, "wall")))
    fact = str(open_.findings.facts["felt - seen, level"])
    assert fact.startswith("something is felt before what is seen on 0.0 %, and seen before what")
    assert "from the side" not in open_.texts()
    fill = cuboid_mesh((-0.45, 0, 0), (0.45, 0.015, 2))
    pane = SceneObject("pane", (Part(fill, visible=False),))
    shut = build_world(tmp_path, scene_of(floor, thing(door, "wall"), pane))
    assert "pane: from the side it is felt before what is seen on" in shut.texts()
    ghost = SceneObject("wall", (Part(door, collision=Collision.NONE),))
    gone = build_world(tmp_path, scene_of(floor, ghost))
    assert "wall: it is seen, and nothing of it is felt" in gone.texts()
    assert model_error(gone.model).sides["wall"].passed > 100
    assert gone.solid_rays((2.0, -1.0, 0.5), AXES[2:3])[0] == np.inf


@pytest.mark.parametrize("sunk", [0.0, 0.05])
@pytest.mark.parametrize("movable", [False, True])
def test_ground_below_solid_things_does_not_count(
    tmp_path: Path, sunk: float, movable: bool
) -> None:
    """Below stairs of several pieces, which stand on a floor or in it, nothing is driven on."""
    floor = thing(cuboid_mesh((-8, -8, -0.5), (8, 8, 0.0)), "floor")
    flight = steps(5, 0.9)
    flight.vertices[:, 2] -= sunk
    world = build_world(tmp_path, scene_of(floor, thing(flight, "stairs", movable=movable)))
    assert world.built.pieces > 5
    assert "is felt" not in world.texts()
    error = model_error(world.model)
    assert error.things["floor"].most < 1e-3
    assert error.things["floor"].places > 800


def test_rough_terrain_is_felt_as_it_is_seen(tmp_path: Path) -> None:
    """Cells of a height field are cut from corner to corner in one way for contacts, lasers, and
    what is drawn."""
    heights = np.random.default_rng(5).uniform(0.0, 1.0, (30, 40))
    field = Heightfield("hills", heights, (0.5, 0.5), Pose((-10, -7, 0.0)))
    world = build_world(tmp_path, scene_of(heightfields=(field,)))
    (error,) = model_error(world.model).things.values()
    assert error.places > 300
    assert error.most < 1e-3
    dice = np.random.default_rng(6)
    for x, y in dice.uniform((-9.5, -6.5), (9.0, 7.0), (50, 2)).tolist():
        down = AXES[5:6]
        seen, felt = world.rays((x, y, 5.0), down)[0], world.solid_rays((x, y, 5.0), down)[0]
        assert seen == pytest.approx(felt, abs=1e-3)
