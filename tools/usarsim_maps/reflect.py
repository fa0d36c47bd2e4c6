"""A scene seen in a mirror: y becomes -y. For maps whose handedness was lost on the way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.scene import Brush, Heightfield, Part, Polygon, Scene, SceneObject
from usarsim_maps.units import MIRROR
from usarsim_server.simulation.frames import Pose, Vector

__all__ = ["reflect"]

Array = NDArray[np.float64]

MIRROR4 = np.diag([1.0, -1.0, 1.0, 1.0])


def reflect(scene: Scene) -> Scene:
    """The mirror image of a scene; faces still look outwards, headings turn the other way."""
    smoke = scene.smoke
    return replace(
        scene,
        source=replace(scene.source, mirrored=not scene.source.mirrored),
        objects=tuple(map(_object, scene.objects)),
        brushes=tuple(map(_brush, scene.brushes)),
        heightfields=tuple(map(_heightfield, scene.heightfields)),
        starts=tuple(replace(s, pose=_pose(s.pose), turns=-s.turns) for s in scene.starts),
        path_nodes=tuple(replace(n, position=_point(n.position)) for n in scene.path_nodes),
        victims=tuple(replace(victim, pose=_pose(victim.pose)) for victim in scene.victims),
        lights=tuple(
            replace(light, position=_point(light.position), direction=_point(light.direction))
            for light in scene.lights
        ),
        smoke=replace(
            smoke,
            volumes=tuple(replace(v, pose=_pose(v.pose)) for v in smoke.volumes),
            puffs=tuple(replace(p, position=_point(p.position)) for p in smoke.puffs),
        ),
    )


def _point(point: Vector) -> Vector:
    x, y, z = point
    return x, -y, z


def _pose(pose: Pose) -> Pose:
    """S R S: turns about z and x change their sense."""
    w, i, j, k = pose.quaternion
    return Pose(_point(pose.position), (w, -i, j, -k))


def _object(thing: SceneObject) -> SceneObject:
    parts = tuple(_part(part) for part in thing.parts)
    return replace(thing, pose=_pose(thing.pose), parts=parts)


def _part(part: Part) -> Part:
    # S (pose matrix) = (S pose S) (S matrix); the builder turns faces round where it mirrors.
    return replace(part, matrix=MIRROR4 @ part.matrix)


def _brush(brush: Brush) -> Brush:
    return replace(brush, polygons=tuple(map(_polygon, brush.polygons)))


def _polygon(polygon: Polygon) -> Polygon:
    vertices: Array = (polygon.vertices @ MIRROR)[::-1]
    return replace(
        polygon, vertices=vertices, uvs=None if polygon.uvs is None else polygon.uvs[::-1]
    )


def _heightfield(field: Heightfield) -> Heightfield:
    """Rows run along +y again, from what was the last one."""
    length = (len(field.heights) - 1) * field.spacing[1]
    return replace(
        field,
        heights=field.heights[::-1],
        pose=_pose(field.pose) @ Pose((0.0, -length, 0.0)),
    )
