"""Fixed geoms that were compiled once, joined to models: the same as compiled as a whole."""

from __future__ import annotations

import gc

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from usarsim_server.simulation.raw import changeable, copied, fields, rows_of, understood
from usarsim_server.simulation.splice import FixedPart

pytestmark = pytest.mark.skipif(not understood(), reason="another struct of MuJoCo's models")

GROUND = (
    '<geom name="floor" type="plane" size="9 9 1"/><geom name="step" type="box" size="1 1 .1"/>'
)
CRATE = """<body name="crate" pos=".1 .2 2"><freejoint/><geom name="crate" type="mesh" mesh="own"/>
<geom name="ear" size=".1" pos=".3 0 0"/><geom size=".1" pos="0 .3 0"/>
<geom size=".1" pos="0 0 .3"/>
</body>"""
OWN = '<mesh name="own" vertex="0 0 0 .5 0 0 0 .5 0 0 0 .5"/>'
MORE = '<sensor><framepos objtype="geom" objname="ear"/></sensor>'


def stones(count: int, seed: int) -> tuple[str, str]:
    """Meshes, and geoms of the world: hulls, copies of them, boxes and balls."""
    random = np.random.default_rng(seed)
    meshes, geoms = [], []
    for number in range(count):
        points = " ".join(f"{value:.3f}" for value in random.uniform(-0.4, 0.4, 24))
        meshes.append(f'<mesh name="h{seed}-{number}" vertex="{points}"/>')
        for copy in range(2):
            x, y, z = random.uniform(-2.0, 2.0, 3)
            name = f"stone{seed}-{number}-{copy}"
            geoms.append(
                f'<geom name="{name}" type="mesh" mesh="h{seed}-{number}" pos="{x} {y} {z}"/>'
            )
        geoms.append(f'<geom type="box" size=".1 .2 .3" pos="{x} {y} {z - 1.0}"/>')
        geoms.append(f'<geom name="ball{seed}-{number}" size=".2" pos="{y} {x} {z}"/>')
    return "".join(meshes), "".join(geoms)


def compiled(assets: str, world: str, more: str = "") -> mujoco.MjModel:
    text = f"<mujoco><asset>{assets}</asset><worldbody>{world}</worldbody>{more}</mujoco>"
    return mujoco.MjSpec.from_string(text).compile()


def joined(parts: int = 3) -> tuple[mujoco.MjModel, mujoco.MjModel]:
    """The model of a crate above stones: joined, and compiled as a whole."""
    made = [stones(7, seed) for seed in range(parts)]
    fixed = FixedPart([compiled(*one) for one in made])
    rest = compiled(OWN, GROUND + CRATE, MORE)
    fixed.into(rest)  # a second time takes the rows from the first model
    meshes, geoms = ("".join(texts) for texts in zip(*made, strict=True))
    return fixed.into(rest), compiled(OWN + meshes, GROUND + geoms + CRATE, MORE)


def boxes(model: mujoco.MjModel) -> list[bytes]:
    """What stands in the leaves of the tree of the world."""
    span = slice(0, int(model.body_bvhnum[0]))
    leaf = model.bvh_nodeid[span] >= 0
    pairs = zip(model.bvh_nodeid[span][leaf], model.bvh_aabb[span][leaf], strict=True)
    return sorted(int(geom).to_bytes(4, "big") + box.tobytes() for geom, box in pairs)


def test_the_same_model() -> None:
    """All that differs are texts, the tree of the world, and the room for contacts."""
    one, whole = joined()
    others = {"nnames", "narena", "nbuffer", "nbvh", "nbvhstatic"}
    sizes = {name for name in fields()[0] if getattr(one, name) != getattr(whole, name)}
    assert sizes <= others
    assert one.narena >= whole.narena
    free = {"bvh_depth", "bvh_child", "bvh_nodeid", "bvh_aabb", "body_bvhadr", "body_bvhnum"}
    free |= {"mesh_bvhadr", "names", "names_map"}
    free |= {name for name in fields()[1] if name.startswith("name_")}
    arrays = {
        name for name in fields()[1] if not np.array_equal(rows_of(one, name), rows_of(whole, name))
    }
    assert arrays <= free
    assert boxes(one) == boxes(whole)


def test_every_name_is_found() -> None:
    """By MuJoCo's own table, in both directions."""
    one, whole = joined()
    for kind, count in (
        (mujoco.mjtObj.mjOBJ_GEOM, one.ngeom),
        (mujoco.mjtObj.mjOBJ_MESH, one.nmesh),
    ):
        for number in range(count):
            name = mujoco.mj_id2name(whole, kind, number)
            assert mujoco.mj_id2name(one, kind, number) == name
            assert name is None or mujoco.mj_name2id(one, kind, name) == number
    assert mujoco.mj_name2id(one, mujoco.mjtObj.mjOBJ_GEOM, "nobody") == -1


def run(model: mujoco.MjModel) -> NDArray[np.float64]:
    data = mujoco.MjData(model)
    for _ in range(400):
        mujoco.mj_step(model, data)
    return np.concatenate([data.qpos, data.qvel, data.sensordata])


def test_the_same_motion() -> None:
    """The crate falls among the stones as it does in the whole model, to the bit."""
    one, whole = joined()
    assert run(one).tobytes() == run(whole).tobytes()


def test_rays_meet_the_same() -> None:
    """MuJoCo's rays go through the tree of the world, too."""
    models = joined()
    random = np.random.default_rng(1)
    datas = [mujoco.MjData(model) for model in models]
    for model, data in zip(models, datas, strict=True):
        mujoco.mj_forward(model, data)
    for _ in range(200):
        start, way = random.uniform(-3.0, 3.0, 3), random.normal(size=3)
        met = []
        for model, data in zip(models, datas, strict=True):
            geom = np.zeros(1, np.int32)
            met.append(
                (mujoco.mj_ray(model, data, start, way, None, 1, -1, geom, None), int(geom[0]))
            )
        assert met[0] == met[1]


@pytest.mark.parametrize(
    "text",
    [
        '<body><geom size="1"/></body>',
        '<geom type="plane" size="1 1 1"/>',
        '<geom size="1"/><site/>',
        '<geom size="1"/><light/>',
    ],
)
def test_only_fixed_geoms(text: str) -> None:
    """Everything else is refused."""
    with pytest.raises(ValueError, match="there is"):
        FixedPart([compiled("", text)])


def test_copies_live_on_their_own() -> None:
    """A copy outlives its model and does not follow it."""
    texture = '<texture name="t" type="2d" builtin="flat" width="1024" height="1024"/>'
    model = compiled(texture, GROUND)
    copy, part = copied(model), changeable(model, "geom_size")
    part.geom_size[1] = 5.0
    assert model.geom_size[1, 0] == 1.0
    model.geom_rgba[1] = 0.25
    assert part.geom_rgba[1, 0] == 0.25
    assert copy.geom_rgba[1, 0] == 0.5
    del model, part
    gc.collect()
    assert copy.geom("step").size.tolist() == [1.0, 1.0, 0.1]
    mujoco.mj_forward(copy, mujoco.MjData(copy))
