"""Makes a model that MuJoCo can draw of the messages of the scene port (docs/scene-port.md)."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from typing import Any

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_client.scene import Message, SceneReader
from usarsim_operator.film.story import Chapter, Moment

_NOWHERE = (0.0, 0.0, -1e4)
"""Where things are that are not there."""
_SCENERY = np.array((1, 0, 0, 0, 0, 0), np.uint8)
"""Groups of geoms that are walls; things are in another one."""
_SKY = 64  # pixels of an edge of the sky's cube


class Posed:
    """A scene and everything that comes into it; bodies are put where a moment says.

    It is what the server's renderers call a stage: `generation`, `model`, `data`, `groups`.
    """

    def __init__(self, number: int, chapter: Chapter, looks: SceneReader) -> None:
        """Compile a chapter.

        Args:
            number: of the chapter. chapter: what is in it. looks: of its things.

        Raises:
            ValueError: if a message makes no sense to MuJoCo.
        """
        self.generation, self._looks = number, looks
        self._spec, self._made = mujoco.MjSpec(), set[str]()
        scene, world = chapter.scene, self._spec.worldbody
        self._light(scene)
        for group in scene["still"]:
            self._add(world, group["geoms"], scene, "scene")
        self._bodies = 0
        for body in scene["bodies"]:
            self._body(body["geoms"], scene, "scene")
        self._scene_bodies = self._bodies
        self._slots: dict[str, list[int]] = {}
        for kind, count in sorted(chapter.most.items()):
            for _ in range(count):
                self._slots.setdefault(kind, []).append(self._bodies)
                for body in looks.kinds[kind]["bodies"]:
                    self._body(body["geoms"], looks.kinds[kind], f"kind {kind}")
        self.model: mujoco.MjModel = self._spec.compile()
        self.groups = self.model.geom_group.copy()
        lower, upper = np.array(scene["lower"]), np.array(scene["upper"])
        self.model.stat.center = (lower + upper) / 2.0
        self.model.stat.extent = max(1.0, float(np.linalg.norm(upper - lower)) / 2.0)
        self.data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.data)

    def show(self, moment: Moment) -> None:
        """Put everything where it was."""
        data, rows = self.data, moment.rows
        data.mocap_pos[:] = _NOWHERE
        own = self._scene_bodies
        data.mocap_pos[:own], data.mocap_quat[:own] = rows[:own, :3], rows[:own, 3:]
        used: dict[str, int] = {}
        for thing in moment.present.things:
            slot = used.get(thing.kind, 0)
            used[thing.kind] = slot + 1
            count = len(self._looks.kinds[thing.kind]["bodies"])
            first = self._slots[thing.kind][slot]
            theirs = rows[thing.first : thing.first + count]
            data.mocap_pos[first : first + count] = theirs[:, :3]
            data.mocap_quat[first : first + count] = theirs[:, 3:]
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_camlight(self.model, data)

    def free(self, place: NDArray[np.float64], towards: NDArray[np.float64]) -> float:
        """m from a place along a unit vector to the next of the scenery."""
        hit = np.full((1, 1), -1, np.int32)
        far = mujoco.mj_ray(self.model, self.data, place, towards, _SCENERY, 1, -1, hit)
        return math.inf if far < 0.0 else float(far)

    def visible(self) -> NDArray[np.bool_]:
        """Which geoms (ngeom,) are drawn at all."""
        return np.ones(self.model.ngeom, np.bool_)

    # -- making it ----------------------------------------------------------------------------

    def _light(self, scene: Message) -> None:
        visual = self._spec.visual
        visual.headlight.active = int("headlight" in scene)
        for key, color in scene.get("headlight", {}).items():
            setattr(visual.headlight, key, color)
        for light in scene.get("lights", ()):
            made = self._spec.worldbody.add_light(pos=light["pos"], dir=light["dir"])
            made.type = getattr(mujoco.mjtLightType, f"mjLIGHT_{light['type'].upper()}")
            made.castshadow = bool(light.get("shadow"))
            for key in ("diffuse", "ambient", "specular", "attenuation", "exponent"):
                if key in light:
                    setattr(made, key, light[key])
            if "cutoff" in light:
                made.cutoff = math.degrees(light["cutoff"])
        if scene.get("sky"):
            made = self._spec.add_texture(name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX)
            _fill(made, _sky(scene["sky"]))

    def _body(self, geoms: Sequence[Message], fields: Message, name: str) -> None:
        body = self._spec.worldbody.add_body(mocap=True, pos=_NOWHERE)
        self._bodies += 1
        self._add(body, geoms, fields, name)

    def _add(self, body: Any, geoms: Sequence[Message], fields: Message, name: str) -> None:
        for geom in geoms:
            number = geom["material"]
            about = {
                "pos": geom.get("pos", (0.0, 0.0, 0.0)),
                "quat": geom.get("quat", (1.0, 0.0, 0.0, 0.0)),
                "material": self._material(fields["materials"][number], f"{name}:{number}"),
                "group": int(name != "scene"),
                "contype": 0,
                "conaffinity": 0,
            }
            kind = getattr(mujoco.mjtGeom, f"mjGEOM_{geom['shape'].upper()}")
            if geom["shape"] == "mesh":
                body.add_geom(type=kind, meshname=self._mesh(geom["mesh"]), **about)
            else:
                body.add_geom(type=kind, size=[*geom["size"], 1.0, 1.0][:3], **about)

    def _material(self, fields: Message, name: str) -> str:
        if name in self._made:
            return name
        self._made.add(name)
        made = self._spec.add_material(name=name, rgba=fields["rgba"])
        for key, absent in (("emission", 0.0), ("specular", 0.5), ("shininess", 0.5)):
            setattr(made, key, fields.get(key, absent))
        texture = None if "texture" not in fields else self._looks.textures[fields["texture"]]
        if texture is not None and "data" in texture:
            made.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = self._texture(texture)
            made.texrepeat = fields.get("repeat", (1.0, 1.0))
            made.texuniform = bool(fields.get("uniform", False))
        elif texture is not None:
            made.rgba[:3] = np.multiply(fields["rgba"][:3], texture["mean"])
        return name

    def _texture(self, fields: Message) -> str:
        name = str(fields["id"])
        if name not in self._made:
            self._made.add(name)
            data = np.frombuffer(base64.b64decode(fields["data"]), np.uint8)
            image = cv2.imdecode(data, cv2.IMREAD_COLOR)
            if image is None:
                raise ValueError(f"the texture {name} is no picture")
            cube = fields["shape"] == "cube"
            kind = mujoco.mjtTexture.mjTEXTURE_CUBE if cube else mujoco.mjtTexture.mjTEXTURE_2D
            _fill(self._spec.add_texture(name=name, type=kind), image[..., ::-1].astype(np.uint8))
        return name

    def _mesh(self, name: str) -> str:
        if name not in self._made:
            self._made.add(name)
            fields = self._looks.meshes[name]
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


def _fill(made: Any, image: NDArray[np.uint8]) -> None:
    made.height, made.width, made.nchannel = image.shape
    made.data = np.ascontiguousarray(image).tobytes()


def _sky(colors: Sequence[Sequence[float]]) -> NDArray[np.uint8]:
    """Six faces of a cube, one below the other, from colours between straight up and down."""
    place = (np.arange(_SKY) + 0.5) / _SKY * 2.0 - 1.0
    across, down = np.meshgrid(place, place)
    side = np.arctan2(-down, np.hypot(1.0, across))
    top = np.arctan2(1.0, np.hypot(across, down))
    heights = np.vstack((side, side, top, -top, side, side))  # right, left, up, down, front, back
    steps = (math.pi / 2.0 - heights) / math.radians(22.5)
    table = np.array(colors)
    channels = [np.interp(steps, np.arange(len(table)), table[:, one]) for one in range(3)]
    sky: NDArray[np.uint8] = (np.stack(channels, axis=2) * 255.0).round().astype(np.uint8)
    return sky
