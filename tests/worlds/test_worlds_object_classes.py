"""Object classes: the reader of their file, look-up, bodies at any scale."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from usarsim_server.base.errors import WorldError
from usarsim_server.base.files import data_directory
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose, Vector
from usarsim_server.simulation.model import PhysicsOptions
from usarsim_server.simulation.rays.triangles import triangles
from usarsim_server.worlds.objects.bodies import (
    Material,
    ObjectCatalog,
    ObjectClass,
    Part,
    load_objects,
    object_model,
    object_size,
)

SHIPPED = data_directory("worlds") / "objects.toml"


def catalog(folder: Path, *texts: str) -> ObjectCatalog:
    """A catalogue of files with these contents, the first one first."""
    sheets = []
    for number, text in enumerate(texts):
        sheet = folder / f"objects{number}.toml"
        sheet.write_text(text, encoding="utf-8")
        sheets.append(sheet)
    return load_objects(sheets)


BOX = '[[object]]\nname = "Box"\nshape = "box"\nsize = [0.4, 0.2, 0.1]\n'


def test_a_plain_class(tmp_path: Path) -> None:
    """Shape and size are enough; mass follows from the volume, the rest has defaults."""
    box = catalog(tmp_path, BOX).find("box")
    assert box is not None
    assert (box.name, box.size, box.friction, box.rolling) == ("Box", (0.4, 0.2, 0.1), 0.5, 0.0)
    assert box.mass == pytest.approx(0.8)
    assert [part.shape for part in box.parts] == ["box"]


def test_names_count_without_regard_to_case(tmp_path: Path) -> None:
    """A class answers to its name and its aliases, spelled anyhow, and to nothing else."""
    found = catalog(tmp_path, BOX + 'aliases = ["WCBox"]\n')
    assert found.find("BOX") is found.find(" wcbox ") is found.find("Box")
    assert found.find("Boxes") is None
    assert found.find("") is None


def test_parts_make_a_bounding_box(tmp_path: Path) -> None:
    """The origin is the middle of all parts, turned ones included, and size reaches round them."""
    text = """
        [[object]]
        name = "Hook"
        mass = 3
        [[object.part]]
        shape = "box"
        size = [1.0, 0.2, 0.2]
        position = [0.5, 0.0, 0.1]
        [[object.part]]
        shape = "box"
        size = [0.6, 0.2, 0.2]
        position = [0.9, 0.0, 0.5]
        rotation_degrees = [0, 90, 0]
        color = [1, 0, 0]
    """
    hook = catalog(tmp_path, text).find("hook")
    assert hook is not None
    assert hook.size == pytest.approx((1.0, 0.2, 0.8))
    first, second = hook.parts
    assert first.pose.position == pytest.approx((0.0, 0.0, -0.3))
    assert second.pose.position == pytest.approx((0.4, 0.0, 0.1))
    assert (first.color, second.color) == (None, (1.0, 0.0, 0.0))


def test_later_files_replace_classes(tmp_path: Path) -> None:
    """A world's own class of the same name counts; classes it does not name stay."""
    mine = '[[object]]\nname = "BOX"\nshape = "sphere"\nsize = [1, 1, 1]\n'
    other = '[[object]]\nname = "Ball"\nshape = "sphere"\nsize = [1, 1, 1]\n'
    found = catalog(tmp_path, BOX + other.replace("Ball", "Old"), mine, other)
    box = found.find("box")
    assert box is not None
    assert box.parts[0].shape == "sphere"
    assert [one.name for one in found.classes] == ["Ball", "BOX", "Old"]


def test_files_that_are_not_there_are_no_error(tmp_path: Path) -> None:
    """Most worlds have no classes of their own."""
    assert load_objects([tmp_path / "objects.toml"]).classes == ()


def test_materials(tmp_path: Path) -> None:
    """A material has a colour, and an opacity if it is not opaque."""
    text = '[[material]]\nname = "Glass"\ncolor = [0.7, 0.8, 0.9]\nopacity = 0.3\n'
    glass = catalog(tmp_path, text).material("GLASS")
    assert glass is not None
    assert (glass.color, glass.opacity) == ((0.7, 0.8, 0.9), 0.3)
    assert catalog(tmp_path, text).material("wood") is None


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[[object]\n", "not valid TOML"),
        ('[[object]]\nshape = "box"\nsize = [1, 1, 1]\n', "name: is missing"),
        ('[[object]]\nname = "A"\n', "shape: is missing"),
        ('[[object]]\nname = "A"\nshape = "cube"\nsize = [1, 1, 1]\n', "'cube' is not known"),
        ('[[object]]\nname = "A"\nshape = "box"\nsize = [1, 1]\n', "3 numbers"),
        ('[[object]]\nname = "A"\nshape = "box"\nsize = [1, 0, 1]\n', "out of range"),
        (BOX + "mass = 0\n", "mass: 0"),
        (BOX + "colour = [1, 1, 1]\n", "did you mean color?"),
        (BOX + "color = [1, 2, 1]\n", "from 0 to 1"),
        (BOX + 'aliases = ["a box"]\n', "cannot travel on the wire"),
        (BOX + '[[object.part]]\nshape = "box"\nsize = [1, 1, 1]\n', "stands beside"),
        (BOX + BOX, "stands there twice"),
        (BOX + 'aliases = ["BOX"]\n', "stands there twice"),
        (BOX + "[[thing]]\n", "unknown key"),
        ('[[material]]\nname = "X"\ncolor = [1, 1]\n', "3 numbers"),
        ('[[material]]\nname = "X"\ncolor = [1, 1, 1]\nopacity = 2\n', "out of range"),
    ],
)
def test_slips_are_told(tmp_path: Path, text: str, says: str) -> None:
    """Every error names the file and says what is wrong."""
    with pytest.raises(WorldError, match=r"objects0\.toml") as caught:
        catalog(tmp_path, text)
    assert says in str(caught.value)


# ---- shipped ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["Box", "WCCrate", "Crate", "Pallet", "Cylinder", "Ball", "Cone", "KitTray", "partc"]
)
def test_the_usual_classes_are_shipped(name: str) -> None:
    """What legacy scripts create is there, with a sensible weight and size."""
    found = load_objects([SHIPPED]).find(name)
    assert found is not None
    assert 0.1 <= found.mass <= 500.0
    assert all(0.02 <= extent <= 3.0 for extent in found.size)


def test_shipped_names_lead_to_one_class_each() -> None:
    """The shipped file loads, and no alias is shadowed."""
    found = load_objects([SHIPPED])
    assert len(found.classes) >= 25
    for one in found.classes:
        for name in (one.name, *one.aliases):
            assert found.find(name) is one


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
    parts = (Part(shape, size, pose or Pose()),)
    return ObjectClass(parts, size, 10.0, "Thing", (0.5, 0.5, 0.5))


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
