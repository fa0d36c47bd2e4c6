"""Small Gazebo worlds and models, for the tests of their reader."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mesh_samples import dae, dae_wedge, read, writer
from numpy.typing import NDArray

from usarsim_maps.findings import Findings
from usarsim_maps.scene import Scene, SceneObject

Array = NDArray[np.float64]

MESH = dae(dae_wedge(), asset="<up_axis>Z_UP</up_axis>")


PLUGIN = (
    '<plugin name="USARGazebo" filename="x.so"><StartPose_1>Gate 1.5,-2,0.3  0,0,3.14'
    "</StartPose_1><StartPose_2>Roof 1,2,3</StartPose_2></plugin>"
)
"""Start poses as the plug-in of the leagues has them."""


def sdf(inner: str, version: str = "1.6") -> str:
    """A file."""
    return f'<?xml version="1.0"?>\n<sdf version="{version}">\n{inner}\n</sdf>\n'


def world(inner: str) -> str:
    """A world."""
    return sdf(f'<world name="default">\n{inner}\n</world>')


def shape(geometry: str, pose: str = "", more: str = "") -> str:
    """A visual and a collision of one shape."""
    place = f"<pose>{pose}</pose>" if pose else ""
    return (
        f'<visual name="v">{place}<geometry>{geometry}</geometry>{more}</visual>'
        f'<collision name="c">{place}<geometry>{geometry}</geometry></collision>'
    )


BOX = shape("<box><size>1 2 3</size></box>")


def model(name: str, inner: str, static: bool = True) -> str:
    """A model of one link."""
    return (
        f'<model name="{name}"><static>{str(static).lower()}</static>'
        f'<link name="link">{inner}</link></model>'
    )


write = writer("map.world")


def write_model(folder: Path, name: str, text: str, config: bool = True) -> Path:
    """A model's folder."""
    if config:
        manifest = f'<model><name>{name}</name><sdf version="1.5">model.sdf</sdf></model>'
        write(folder, manifest, f"{name}/model.config")
    return write(folder, text, f"{name}/model.sdf")


def load(folder: Path, inner: str, findings: Findings | None = None, **options: object) -> Scene:
    """A world of elements."""
    return read(write(folder, world(inner)), findings, **options)


def only(scene: Scene) -> SceneObject:
    """The one object."""
    assert len(scene.objects) == 1
    return scene.objects[0]


def matrix(thing: SceneObject, part: int = 0) -> Array:
    """Where a part is in the world."""
    base = np.eye(4)
    base[:3, :3] = thing.pose.matrix()
    base[:3, 3] = thing.pose.position
    answer: Array = base @ thing.parts[part].matrix
    return answer
