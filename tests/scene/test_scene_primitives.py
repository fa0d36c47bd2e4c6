"""A model as primitives: what can be seen is described, where MuJoCo has it, once, and is small."""

from __future__ import annotations

import base64
import gzip
import json
import math

import cv2
import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from usarsim_server.base.files import data_directory
from usarsim_server.cameras.posed_model import Stage
from usarsim_server.robots.catalog import load_catalog
from usarsim_server.scene.primitives import Described, Primitives
from usarsim_server.sessions.robots import robot_model
from usarsim_server.simulation.frames import Pose, Vector, pose_of
from usarsim_server.simulation.model import (
    SHELF_NAME,
    CompiledWorld,
    PhysicsOptions,
    RobotModel,
    compile_world,
)
from usarsim_server.simulation.rays.triangles import triangles
from usarsim_server.worlds.description import Smoke, SmokePuff, WorldDescription
from usarsim_server.worlds.loader import find_world, load_world
from usarsim_server.worlds.scene import build_scene
from usarsim_server.worlds.smoke import SmokeField

Array = NDArray[np.float64]


def compiled(name: str, *classes: str) -> tuple[WorldDescription, CompiledWorld]:
    """A shipped world with a slot for each robot class named."""
    world = load_world(find_world(name))
    catalog = load_catalog(())
    slots: list[RobotModel] = []
    for one in classes:
        description = catalog.find(one)
        assert description is not None
        slots.append(robot_model(description))
    return world, compile_world(lambda: build_scene(world), slots, PhysicsOptions(), 0)


def own(spec_xml: str) -> CompiledWorld:
    """A world of a test's own, without robots."""
    return compile_world(lambda: mujoco.MjSpec.from_string(spec_xml), [], PhysicsOptions(), 0)


def placed(geom: dict[str, tuple[float, ...]]) -> Pose:
    """Pose of a geom in its message."""
    x, y, z = geom.get("pos", (0.0, 0.0, 0.0))
    a, b, c, d = geom.get("quat", (1.0, 0.0, 0.0, 0.0))
    return Pose((x, y, z), (a, b, c, d))


def drawn(described: Described, poses: list[Pose | None]) -> list[tuple[str, Vector]]:
    """Shape and place of all geoms of `still` (pose None) and of bodies at poses."""
    message = described.message
    groups = [*message.get("still", []), *message["bodies"]]  # type: ignore[misc]
    assert len(groups) == len(poses)
    found = []
    for group, pose in zip(groups, poses, strict=True):
        for geom in group["geoms"]:
            place = placed(geom) if pose is None else pose @ placed(geom)
            found.append((geom["shape"], place.position))
    return found


@pytest.mark.parametrize("name", ["arena", "plant", "smoke_corridor"])
def test_all_that_can_be_seen_is_there_and_nothing_else(name: str) -> None:
    """CON-04: two robots of each class, one in another pose; free shelves and contact shapes are
    left out, all other geoms are where MuJoCo has them, however the joints stand."""
    world, built = compiled(name, "P3AT", "P3AT", "P3AT_arm", "Nao", "AirRobot")
    model, data = built.model, mujoco.MjData(built.model)
    free = [int(layout.qpos) for layout in built.layouts]
    rng = np.random.default_rng(3)
    for start, layout in zip(free, built.layouts, strict=True):
        data.qpos[start + 3 : start + 7] = rng.standard_normal(4)
        joints = list(layout.joint_qpos.values())
        data.qpos[joints] = rng.uniform(-1.0, 1.0, len(joints))
    mujoco.mj_kinematics(model, data)

    def poses(bodies: list[int]) -> list[Pose | None]:
        return [pose_of(data.xpos[body], data.xquat[body]) for body in bodies]

    primitives = Primitives(built)
    scene = primitives.scene(world)
    still: list[object] = scene.message["still"]  # type: ignore[assignment]
    told = drawn(scene, [*[None] * len(still), *poses(primitives.moving())])
    for slot in range(len(built.slots)):
        told += drawn(primitives.kind(slot), poses(primitives.bodies(slot)))
    visible = Stage(built).visible()
    visible[mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, SHELF_NAME)] = False
    places = data.geom_xpos[visible]
    assert len(told) == len(places)
    names = [mujoco.mjtGeom(int(kind)).name for kind in model.geom_type[visible]]
    for shape in set(names):
        expected = places[[name == shape for name in names]]
        found = np.array([p for kind, p in told if kind == shape.removeprefix("mjGEOM_").lower()])
        assert len(found) == len(expected)
        away = np.linalg.norm(found[:, None] - expected[None], axis=2)
        assert max(away.min(axis=0).max(), away.min(axis=1).max()) < 1e-3, shape


def test_who_is_who() -> None:
    """Doors, lifts, obstacles, victims and crates say what they are."""
    world, built = compiled("plant")
    message = Primitives(built).scene(world).message
    bodies: list[dict[str, str]] = message["bodies"]  # type: ignore[assignment]
    assert {one["what"] for one in bodies} >= {"door", "lift", "obstacle", "body"}
    doors = {one["name"] for one in bodies if one["what"] == "door"}
    assert doors == {door.name for door in world.machinery.doors}
    still: list[dict[str, str]] = message["still"]  # type: ignore[assignment]
    victims = {one["name"] for one in (*still, *bodies) if one["what"] == "victim"}
    assert victims == {victim.name for victim in world.victims}


def test_equal_robots_are_one_kind() -> None:
    """Slots of one class have the same description, so one is enough; it has a headlight."""
    _, built = compiled("empty", "P3AT", "Nao", "P3AT")
    primitives = Primitives(built)
    assert primitives.kind(0) == primitives.kind(2)
    assert primitives.kind(0).message["id"] != primitives.kind(1).message["id"]
    assert primitives.kind(0).message["lamp"]["pos"][0] > 0.2  # type: ignore[index,call-overload]


def arrays(mesh: dict[str, object]) -> tuple[Array, NDArray[np.int64]]:
    """Vertices and faces of a `mesh` message."""
    vertices = np.frombuffer(base64.b64decode(str(mesh["vertices"])), "<f4").reshape(-1, 3)
    kind = "<u2" if len(vertices) <= 1 << 16 else "<u4"
    faces = np.frombuffer(base64.b64decode(str(mesh["faces"])), kind).reshape(-1, 3)
    return vertices.astype(float), faces.astype(np.int64)


MESHES = """
<mujoco><asset>
  <mesh name="wedge" vertex="0 0 0 1 0 0 0 1 0 0 0 1" texcoord="0 0 1 0 0 1 1 1"
        face="0 2 1 0 1 3 1 2 3 0 3 2"/>
  <hfield name="hills" nrow="3" ncol="4" size="4 3 2 0.1"
          elevation="0 0 0 0 0 1 0.5 0 0 0 0 0"/>
  <texture name="flag" type="2d" builtin="checker" width="8" height="4" rgb1="1 0 0" rgb2="0 0 1"/>
  <texture name="big" type="2d" builtin="checker" width="3000" height="1500" rgb1="1 1 1"/>
  <material name="flag" texture="flag" texrepeat="3 2"/><material name="big" texture="big"/>
 </asset><worldbody>
  <geom type="mesh" mesh="wedge" pos="1 2 3" euler="20 30 40" material="flag"/>
  <geom type="mesh" mesh="wedge" pos="4 2 3" rgba="0 1 0 0.5" material="flag"/>
  <geom type="hfield" hfield="hills"/><geom type="plane" size="0 0 1" material="big"/>
  <geom type="box" size="1 1 1" group="3"/><geom type="box" size="1 1 1" rgba="1 1 1 0"/>
</worldbody></mujoco>"""


def test_meshes_are_the_triangles_that_rays_meet() -> None:
    """Each mesh once; its triangles, put where the geom is, are those of the physics; normals have
    length one; heights become a mesh; what is transparent or of a hidden group is left out."""
    built = own(MESHES)
    world, _ = compiled("empty")
    described = Primitives(built).scene(world)
    geoms = described.message["still"][0]["geoms"]  # type: ignore[index]
    assert [one["shape"] for one in geoms] == ["mesh", "mesh", "mesh", "plane"]
    assert geoms[0]["mesh"] == geoms[1]["mesh"] != geoms[2]["mesh"]
    model, data = built.model, mujoco.MjData(built.model)
    mujoco.mj_kinematics(model, data)
    for number, geom in enumerate(geoms[:2]):
        mesh = described.assets[geom["mesh"]]
        vertices, faces = arrays(mesh)
        pose = placed(geom)
        corners = vertices[faces] @ pose.matrix().T + np.array(pose.position)
        turn = data.geom_xmat[number].reshape(3, 3)
        expected = triangles(model, number, data.geom_xpos[number], turn)
        assert corners == pytest.approx(expected, abs=1e-4)
        normals = np.frombuffer(base64.b64decode(str(mesh["normals"])), "i1").reshape(-1, 3) / 127.0
        assert np.linalg.norm(normals, axis=1) == pytest.approx(np.ones(len(vertices)), abs=0.02)
        assert len(base64.b64decode(str(mesh["uv"]))) == 8 * len(vertices)
    heights, _ = arrays(described.assets[geoms[2]["mesh"]])
    assert heights.max(axis=0).tolist() == [4.0, 3.0, 2.0]
    assert heights[5] == pytest.approx([-4.0 + 8.0 / 3.0, 0.0, 2.0], abs=1e-5)


def test_textures_and_colours() -> None:
    """A texture is a picture that a browser can show, large ones made smaller; a geom's own colour
    goes before its material's."""
    described = Primitives(own(MESHES)).scene(compiled("empty")[0])
    geoms = described.message["still"][0]["geoms"]  # type: ignore[index]
    materials = described.message["materials"]
    flag, green, big = (materials[geoms[n]["material"]] for n in (0, 1, 3))  # type: ignore[index]
    assert flag["repeat"] == [3, 2]
    assert green["rgba"] == [0, 1, 0, 0.5]
    asset = described.assets[flag["texture"]]
    data = np.frombuffer(base64.b64decode(str(asset["data"])), np.uint8)
    picture = cv2.imdecode(data, cv2.IMREAD_COLOR)
    assert picture is not None
    assert picture.shape == (4, 8, 3)
    blue_first = {tuple(color) for color in picture.reshape(-1, 3).tolist()}
    assert blue_first == {(0, 0, 255), (255, 0, 0)}
    large = described.assets[big["texture"]]
    assert (large["width"], large["height"]) == (1024, 512)
    assert len(str(large["data"])) < 200_000


def test_smoke_and_light() -> None:
    """Smoke, lights, sky and views are told in plain numbers that JSON can say."""
    world, built = compiled("smoke_corridor")
    message = Primitives(built).scene(world).message
    json.dumps(message, allow_nan=False)
    smoke: dict[str, list[dict[str, object]]] = message["smoke"]  # type: ignore[assignment]
    assert len(smoke["volumes"]) == len(world.smoke.volumes)
    assert len(smoke["clouds"]) == len(world.smoke.puffs)
    assert len(message["sky"]) == 9  # type: ignore[arg-type]
    views: list[dict[str, object]] = message["views"]  # type: ignore[assignment]
    assert {"top", "overview", "start"} <= {view["name"] for view in views}
    assert message["lights"]


def test_a_map_of_100_000_triangles() -> None:
    """CON-04: at most 5 MB compressed, each mesh once, found by its contents."""
    rng = np.random.default_rng(1)
    side, tiles = 113, 4  # 4 meshes of 112 x 112 x 2 triangles
    spec = mujoco.MjSpec()
    x, y = np.meshgrid(np.linspace(0, 30, side), np.linspace(0, 30, side))
    first = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    faces = [[first, first + 1, first + side], [first + 1, first + side + 1, first + side]]
    corners = np.concatenate([np.stack(one, axis=1) for one in faces])
    for tile in range(tiles):
        z = rng.uniform(0.0, 2.0, x.shape)
        mesh = spec.add_mesh(name=f"tile{tile}")
        mesh.uservert = np.stack([x, y, z], axis=2).ravel().tolist()
        mesh.userface = corners.ravel().tolist()
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        kind = mujoco.mjtGeom.mjGEOM_MESH
        spec.worldbody.add_geom(type=kind, meshname=mesh.name, pos=[30.0 * tile, 0, 0])
    built = compile_world(lambda: spec, [], PhysicsOptions(), 0)
    assert int(built.model.mesh_facenum.sum()) > 100_000
    described = Primitives(built).scene(compiled("empty")[0])
    assert len(described.assets) == tiles
    raw = json.dumps([*described.assets.values(), described.message]).encode()
    assert len(gzip.compress(raw)) < 5e6


def test_places_of_rising_smoke_follow_from_the_message() -> None:
    """The formula of the page gives the particles that sensors meet."""
    puff = SmokePuff("fire", (1.0, 2.0, 3.0), (2.0, 3.0, 4.0), particles=7, lifetime=5.0, seed=4)
    field, time = SmokeField(Smoke(puffs=(puff,))), 13.7
    (balls,) = field.balls()
    for number, expected in enumerate(field.particles(time)[0]):
        turns = number / puff.particles + time / puff.lifetime
        round_, age = divmod(turns, 1.0)
        angle = balls["angle"][number] + 2.39996323 * round_
        radius = balls["aside"][number] * (0.25 + 0.75 * age)
        unit = (radius * math.cos(angle), radius * math.sin(angle), 2.0 * age - 1.0)
        place = [p + u * s / 2.0 for p, u, s in zip(puff.position, unit, puff.size, strict=True)]
        assert place == pytest.approx(expected, abs=1e-6)


def test_worlds_are_found() -> None:
    """All shipped worlds can be described."""
    for folder in sorted(data_directory("worlds").iterdir()):
        if folder.is_dir():
            world, built = compiled(folder.name)
            json.dumps(Primitives(built).scene(world).message, allow_nan=False)
