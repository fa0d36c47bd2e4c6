"""A picture that is drawn from nothing but the messages of the scene port is that of the server."""

from __future__ import annotations

import base64
from typing import Any

import cv2
import mujoco
import numpy as np
import pytest

from usarsim_client.scene import Message, Poses, SceneReader
from usarsim_server.cameras.backend import Quality, Wanted
from usarsim_server.cameras.gl import GlBackend
from usarsim_server.cameras.posed_model import Stage
from usarsim_server.cameras.view import Eye, looking
from usarsim_server.services.scene_port import ScenePort
from usarsim_server.simulation.snapshot import Snapshot
from usarsim_server.testing import Rehearsal


class Rebuilt:
    """A scene as a client draws it, in a model of MuJoCo's again: a stage without a simulation."""

    generation = 0

    def __init__(self, seen: SceneReader, poses: Poses, extent: float) -> None:
        assert seen.scene is not None
        assert seen.present is not None
        self._seen, self._spec, self._made = seen, mujoco.MjSpec(), set[str]()
        scene, world = seen.scene.message, self._spec.worldbody
        for key, color in scene["headlight"].items():
            setattr(self._spec.visual.headlight, key, color)
        for light in scene["lights"]:
            kind = getattr(mujoco.mjtLightType, f"mjLIGHT_{light['type'].upper()}")
            colors = {key: light[key] for key in ("diffuse", "ambient", "specular")}
            world.add_light(
                type=kind, pos=light["pos"], dir=light["dir"], castshadow=False, **colors
            )
        for group in scene["still"]:
            self._add(world, group["geoms"], scene, "scene")
        bodies = [(body["geoms"], scene, "scene") for body in scene["bodies"]]
        for thing in seen.present.things:
            kind = seen.kinds[thing.kind]
            assert thing.first == len(bodies)
            bodies += [(body["geoms"], kind, thing.kind) for body in kind["bodies"]]
        for row, (geoms, message, name) in zip(poses.rows.astype(float), bodies, strict=True):
            self._add(world.add_body(pos=row[:3], quat=row[3:]), geoms, message, name)
        self.model = self._spec.compile()
        self.model.stat.extent = extent
        self.groups = self.model.geom_group.copy()
        self.data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.data)

    def _add(self, body: Any, geoms: list[Message], message: Message, name: str) -> None:
        for geom in geoms:
            material = message["materials"][geom["material"]]
            about = {
                "pos": geom.get("pos", [0, 0, 0]),
                "quat": geom.get("quat", [1, 0, 0, 0]),
                "material": self._material(material, f"{name}:{geom['material']}"),
            }
            kind = getattr(mujoco.mjtGeom, f"mjGEOM_{geom['shape'].upper()}")
            if geom["shape"] == "mesh":
                body.add_geom(type=kind, meshname=self._mesh(geom["mesh"]), **about)
            else:
                size = [*geom["size"], 1.0, 1.0][:3]
                body.add_geom(type=kind, size=size, **about)

    def _material(self, fields: Message, name: str) -> str:
        if name not in self._made:
            self._made.add(name)
            made = self._spec.add_material(name=name, rgba=fields["rgba"])
            for key, absent in (("emission", 0.0), ("specular", 0.5), ("shininess", 0.5)):
                setattr(made, key, fields.get(key, absent))
            if "texture" in fields:
                made.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = self._texture(
                    fields["texture"]
                )
                made.texrepeat, made.texuniform = fields["repeat"], fields["uniform"]
        return name

    def _texture(self, name: str) -> str:
        if name not in self._made:
            self._made.add(name)
            data = np.frombuffer(base64.b64decode(self._seen.textures[name]["data"]), np.uint8)
            image = cv2.imdecode(data, cv2.IMREAD_COLOR)
            assert image is not None
            made = self._spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D)
            made.height, made.width, made.nchannel = image.shape
            made.data = image[..., ::-1].tobytes()
        return name

    def _mesh(self, name: str) -> str:
        if name not in self._made:
            self._made.add(name)
            fields = self._seen.meshes[name]
            made = self._spec.add_mesh(name=name)
            made.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
            vertices = np.frombuffer(base64.b64decode(fields["vertices"]), "<f4")
            kind = "<u2" if len(vertices) // 3 <= 1 << 16 else "<u4"
            made.uservert = vertices.tolist()
            made.userface = np.frombuffer(base64.b64decode(fields["faces"]), kind).tolist()
            if "uv" in fields:
                uv = np.frombuffer(base64.b64decode(fields["uv"]), "<f4")
                made.usertexcoord = uv.tolist()
        return name


def seen_of(stage: Rehearsal, snapshot: Snapshot) -> tuple[SceneReader, Poses]:
    """What a client of the scene port knows at a snapshot."""
    port = next(one for one in stage.assembly.services if isinstance(one, ScenePort))
    instant = port.feed.instant(snapshot)  # type: ignore[attr-defined]
    reader = SceneReader()
    for part in (instant.scene, *(instant.kinds[kind] for kind in instant.needed)):
        for _, data in part:
            reader.feed(data)
    reader.feed(instant.present)
    (poses,) = reader.feed(instant.poses)
    assert isinstance(poses, Poses)
    return reader, poses


@pytest.mark.parametrize("world", ["arena", "empty"])
def test_a_client_can_draw_what_the_server_draws(world: str, gl: str) -> None:
    """Shapes, meshes, poses, colours, textures and lights (CON-04, CON-06): pictures of robots with
    wheels, arms, legs and rotors differ by less than a thousandth on average."""
    with Rehearsal(world=world, scene_port=0) as stage:
        start = stage.assembly.world.starts[0].pose.position
        for number, kind in enumerate(("P3AT_arm", "Nao", "AirRobot")):
            place = f"{start[0] + 1.2 * number},{-start[1]},{-start[2]}"
            stage.connect().send(f"INIT {{ClassName USARBot.{kind}}} {{Location {place}}}")
        stage.run(0.5)
        snapshot = stage.assembly.simulation.look()
        assert snapshot.world is not None
        server = Stage(snapshot.world)
        server.show(snapshot)
        x, y, z = start
        eye = Eye(looking((x - 0.5, y - 2.6, z + 1.6), (x + 1.2, y, z)), 1.2, 320, 240)
        client = Rebuilt(*seen_of(stage, snapshot), float(server.model.stat.extent))
        backend = GlBackend(gl, Quality())
        try:
            expected = backend.render(server, eye, Wanted()).colors.astype(int)
            drawn = backend.render(client, eye, Wanted()).colors.astype(int)  # type: ignore[arg-type]
        finally:
            backend.close()
        sky = (drawn == 0).all(axis=2)  # which a client makes of nine colours
        assert sky.mean() < 0.5
        assert np.ptp(expected[~sky]) > 100
        assert np.abs(expected - drawn)[~sky].mean() < 0.25
