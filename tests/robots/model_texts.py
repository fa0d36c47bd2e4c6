"""Writes small MJCF and URDF files, and robot files that name them, for tests."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from robot_files import write

from usarsim_server.robots.catalog import load_robot
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.mjcf import build_spec

Array = NDArray[np.float64]

LEG = """
<body name="Thigh" pos="0.1 0 -0.1" euler="0 0.3 0">
  <joint name="Hip" axis="0 1 0" pos="0 0 0.05" range="-1 1.5" damping="0.4"/>
  <geom type="capsule" size="0.03 0.08" mass="0.5"/>
  <body name="Shin" pos="0 0 -0.25">
    <joint name="Knee" axis="0 1 0" range="-2 0.1"/>
    <geom type="box" size="0.02 0.03 0.1" mass="0.3" rgba="1 0 0 1"/>
  </body>
</body>
"""
TORSO = '<geom type="box" size="0.1 0.1 0.1" mass="2"/>'


def mjcf(inside: str = LEG, torso: str = TORSO, before: str = "", world: str = "") -> str:
    """A model of one root body with whatever is put inside it."""
    return f"""<mujoco><compiler angle="radian" autolimits="true"/>{before}<worldbody>{world}
<body name="Torso" pos="3 2 1"><freejoint/>{torso}{inside}</body></worldbody></mujoco>"""


def urdf(links: str, head: str = "") -> str:
    """A URDF file whose root is called trunk."""
    return f"""<?xml version="1.0"?>
<!-- <mujoco> is not meant here -->
<robot name="walker">{head}
<link name="trunk">{inertial(2.0)}
  <visual><geometry><box size="0.2 0.2 0.2"/></geometry></visual>
  <collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision>
</link>{links}</robot>"""


def inertial(mass: float) -> str:
    """The inertial element of a URDF link."""
    return (
        f'<inertial><mass value="{mass}"/><inertia ixx="0.01" iyy="0.01" izz="0.01"'
        ' ixy="0" ixz="0" iyz="0"/></inertial>'
    )


def body(folder: Path, text: str | bytes, name: str = "body.xml", **keys: Any) -> RobotDescription:
    """The robot of a legged class whose body is in a model file."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / name
    file.parent.mkdir(exist_ok=True)
    if isinstance(text, bytes):
        file.write_bytes(text)
    else:
        file.write_text(text, encoding="utf-8")
    robot = {"description": "a test", "kind": "legged", "dialect": "udk", "body": name, **keys}
    return load_robot(write(folder, "Walker", robot))


def write_stl(
    path: Path, vertices: Sequence[Sequence[float]], faces: Sequence[Sequence[int]]
) -> None:
    """Write triangles as a binary STL file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    points = np.array(vertices, dtype=float)
    records = [struct.pack("<12fH", 0, 0, 0, *points[list(face)].ravel(), 0) for face in faces]
    path.write_bytes(b"\0" * 80 + struct.pack("<I", len(faces)) + b"".join(records))


TETRAHEDRON = (
    [(0.0, 0.0, 0.0), (0.2, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.3)],
    [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)],
)


class Twin:
    """MuJoCo's own reading of a model file beside what became of it as a robot."""

    def __init__(self, text: str, robot: RobotDescription, folder: Path | None = None) -> None:
        """Compile both."""
        spec = mujoco.MjSpec.from_string(text)
        if folder is not None:
            spec.modelfiledir = str(folder)
        self.file, self.robot = spec.compile(), build_spec(robot).compile()
        self._data = [mujoco.MjData(model) for model in (self.file, self.robot)]
        self.joints = [
            self.file.joint(n).name for n in range(self.file.njnt) if self.file.jnt_type[n] >= 2
        ]

    def pose(self, positions: Sequence[float]) -> None:
        """Put both at the origin, their joints at these positions."""
        for model, data in zip((self.file, self.robot), self._data, strict=True):
            data.qpos[:7] = (0, 0, 0, 1, 0, 0, 0)
            for name, position in zip(self.joints, positions, strict=True):
                data.qpos[model.joint(name).qposadr[0]] = position
            mujoco.mj_forward(model, data)

    def masses(self) -> tuple[Array, Array]:
        """Both mass matrices, free joint first, then joints as the file has them, no armature."""
        found = []
        for model, data in zip((self.file, self.robot), self._data, strict=True):
            full = np.zeros((model.nv, model.nv))
            mujoco.mj_fullM(model, data, full)
            full -= np.diag(model.dof_armature)
            dofs = [*range(6), *(int(model.joint(name).dofadr[0]) for name in self.joints)]
            found.append(full[np.ix_(dofs, dofs)])
        return found[0], found[1]

    def place(self, name: str) -> tuple[Array, Array]:
        """Origin of a body in both."""
        file, robot = self._data
        return file.body(name).xpos.copy(), robot.body(name).xpos.copy()

    def geoms(self) -> list[Array]:
        """Places of all shapes with a body of their own colour in both, in order of colour."""
        return [
            np.array(
                [
                    np.round(data.geom_xpos[geom], 9)
                    for geom in sorted(
                        range(model.ngeom), key=lambda geom: tuple(model.geom_rgba[geom])
                    )
                    if model.geom_rgba[geom, 3] > 0.0
                ]
            )
            for model, data in zip((self.file, self.robot), self._data, strict=True)
        ]
