"""Bodies of objects: masses, extents and shapes at any scale."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from usarsim_server.data import data_directory
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose, Vector
from usarsim_server.simulation.model import PhysicsOptions
from usarsim_server.simulation.rays.triangles import triangles
from usarsim_server.worlds.objects.bodies import (
    Material,
    ObjectClass,
    Part,
    load_objects,
    object_model,
    object_size,
)

CATALOG = load_objects([data_directory("worlds") / "objects.toml"])
ONE: Vector = (1.0, 1.0, 1.0)
SCALES = [ONE, (2.0, 2.0, 2.0), (2.0, 1.0, 0.5)]
GEOM = mujoco.mjtGeom


def floor() -> mujoco.MjSpec:
    """An endless floor."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=GEOM.mjGEOM_PLANE, size=[0, 0, 1], friction=[1, 0.005, 0.0001])
    return spec


def single(shape: str, size: Vector = ONE, pose: Pose | None = None) -> ObjectClass:
    """A class of one piece."""
    return ObjectClass("Thing", (Part(shape, size, pose or Pose()),), size, 10.0, (0.5, 0.5, 0.5))


def compiled(kind: ObjectClass, scale: Vector, rigid: bool = True) -> mujoco.MjModel:
    """The body alone."""
    return object_model(kind, scale, rigid).build().compile()


def extents(model: mujoco.MjModel) -> np.ndarray:
    """True extents of all geoms."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    points = [
        triangles(model, g, data.geom_xpos[g], data.geom_xmat[g].reshape(3, 3)).reshape(-1, 3)
        for g in range(model.ngeom)
    ]
    return np.ptp(np.concatenate(points), axis=0)


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("kind", CATALOG.classes, ids=lambda kind: kind.name)
def test_shipped_classes_have_their_mass_and_size(kind: ObjectClass, scale: Vector) -> None:
    """At any scale the mass goes with the volume and the size with the scale."""
    model = compiled(kind, scale)
    assert model.body_mass.sum() == pytest.approx(kind.mass * math.prod(scale), rel=1e-6)
    assert extents(model) == pytest.approx(object_size(kind, scale), rel=0.005, abs=2e-3)


@pytest.mark.parametrize(
    ("shape", "size", "scale", "geom"),
    [
        ("box", (1, 2, 3), (1, 2, 3), GEOM.mjGEOM_BOX),
        ("sphere", (1, 1, 1), (2, 2, 2), GEOM.mjGEOM_SPHERE),
        ("sphere", (1, 1, 1), (2, 1, 1), GEOM.mjGEOM_ELLIPSOID),
        ("cylinder", (1, 1, 2), (2, 2, 1), GEOM.mjGEOM_CYLINDER),
        ("cylinder", (1, 1, 2), (2, 1, 1), GEOM.mjGEOM_MESH),
        ("cone", (1, 1, 2), (1, 1, 1), GEOM.mjGEOM_MESH),
        ("wedge", (1, 1, 2), (1, 1, 1), GEOM.mjGEOM_MESH),
    ],
)
def test_shapes(shape: str, size: Vector, scale: Vector, geom: int) -> None:
    """A shape of MuJoCo's own wherever there is one, a mesh otherwise."""
    assert compiled(single(shape, size), scale).geom_type.tolist() == [geom]


@given(st.sampled_from(["box", "sphere", "cylinder", "cone", "wedge"]), st.floats(0.0, math.pi))
@settings(max_examples=30, derandomize=True, deadline=None)
def test_turned_pieces_are_stretched_along_the_object(shape: str, turn: float) -> None:
    """Stretching a turned piece gives the volume of the stretched object, whatever the turn."""
    pose = Pose((0.3, 0.0, 0.0), (math.cos(turn / 2), 0.0, 0.0, math.sin(turn / 2)))
    kind = single(shape, (1.0, 0.5, 0.4), pose)
    plain, wide = compiled(kind, ONE), compiled(kind, (1.0, 3.0, 1.0))
    assert wide.body_mass[1] == pytest.approx(3.0 * plain.body_mass[1])
    assert wide.body_ipos[1] == pytest.approx(plain.body_ipos[1] * [1, 3, 1], abs=0.01)


def test_placed_things_have_no_joint() -> None:
    """What forces do not move is a mocap body."""
    model = compiled(CATALOG.classes[0], ONE, rigid=False)
    assert (model.nv, model.nmocap) == (0, 1)
    assert compiled(CATALOG.classes[0], ONE).nv == 6


def test_keys_tell_all_differences() -> None:
    """Slots are shared by objects that are alike, and by no others."""
    kind, glass = CATALOG.classes[0], Material("Glass", (1, 1, 1), 0.3)
    variants = [
        object_model(kind, ONE, True),
        object_model(kind, ONE, False),
        object_model(kind, (1.0, 1.0, 1.5), True),
        object_model(kind, ONE, True, glass),
        object_model(CATALOG.classes[1], ONE, True),
    ]
    assert len({model.key for model in variants}) == len(variants)
    assert object_model(kind, ONE, True).key == variants[0].key
    assert not any(model.robot for model in variants)


def test_a_material_is_seen_and_has_its_name() -> None:
    """Sensors that judge by names of materials find it on every geom."""
    glass = Material("Glass", (0.7, 0.8, 0.9), 0.3)
    model = object_model(CATALOG.classes[0], ONE, False, glass).build().compile()
    assert [model.mat(index).name for index in model.geom_matid] == ["Glass"] * model.ngeom
    assert model.mat_rgba[0] == pytest.approx([0.7, 0.8, 0.9, 0.3], abs=1e-6)


@pytest.mark.parametrize("kind", CATALOG.classes, ids=lambda kind: kind.name)
def test_shipped_classes_rest_where_they_are_put(kind: ObjectClass) -> None:
    """Set on the floor they neither sink, hop, roll away nor keep the physics awake."""
    engine = Engine(floor, PhysicsOptions(), [object_model(kind, ONE, True)])
    height = kind.size[2] / 2.0
    engine.occupy(0, 0, Pose((0.0, 0.0, height)))
    for _ in range(150):
        engine.advance(5)
    position = np.array(engine.pose(0).position)
    assert position == pytest.approx([0.0, 0.0, height], abs=0.006)
    assert (engine.data.tree_asleep >= 0).all()


def test_a_ball_that_was_pushed_comes_to_rest() -> None:
    """Rolling resistance stops a ball; it does not roll for ever."""
    ball = CATALOG.find("Ball")
    assert ball is not None
    engine = Engine(floor, PhysicsOptions(), [object_model(ball, ONE, True)])
    engine.occupy(0, 0, Pose((0.0, 0.0, 0.11)))
    engine.data.qvel[0] = 1.0
    engine.data.qvel[4] = 1.0 / 0.11
    for _ in range(1000):
        engine.advance(5)
    x = engine.pose(0).position[0]
    assert 1.0 < x < 10.0
    assert abs(engine.data.qvel[0]) < 1e-2
