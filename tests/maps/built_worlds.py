"""Helpers of this room's tests: scenes built in memory, rays and probes into them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
from mesh_samples import read, write
from numpy.typing import NDArray

from usarsim_maps.build.builder import Built, build
from usarsim_maps.findings import Findings
from usarsim_maps.scene import Mesh, Part, Scene, SceneObject, Source
from usarsim_server.simulation.frames import IDENTITY, Pose, Vector
from usarsim_server.simulation.model import PhysicsOptions
from usarsim_server.simulation.rays.query import RayFan
from usarsim_server.simulation.simulation import Simulation, SimulationOptions
from usarsim_server.worlds.description import StartPose, WorldDescription
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.scene import build_scene

Array = NDArray[np.float64]

AXES = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=float)


WEDGE_FACES = [
    (0, 2, 1), (3, 4, 5), (0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4), (2, 0, 3), (2, 3, 5)
]  # fmt: skip
"""Of a wedge: three corners below, three above."""


class World:
    """A built world folder, compiled."""

    def __init__(self, built: Built, findings: Findings, scene: Scene) -> None:
        self.built = built
        self.findings = findings
        self.scene = scene
        self.description: WorldDescription = load_world(built.folder)
        self.simulation = Simulation(
            lambda: build_scene(self.description),
            SimulationOptions(
                physics=PhysicsOptions(),
                speed=float("inf"),
                lower=self.description.lower,
                upper=self.description.upper,
            ),
        )
        self.model: mujoco.MjModel = build_scene(self.description).compile()

    def rays(self, origin: Vector, directions: Array = AXES) -> Array:
        """Distances that a sensor at a place would measure."""
        fan = RayFan(np.array(origin, dtype=float), np.asarray(directions, dtype=float), 1000.0)
        return self.simulation.cast([fan], self.simulation.look(), None)[0].distances

    def names(self, origin: Vector, direction: Vector) -> str | None:
        """Name of what a ray meets."""
        fan = RayFan(np.array(origin), np.array([direction], dtype=float), 1000.0, identify=True)
        names = self.simulation.cast([fan], self.simulation.look(), None)[0].names
        return names[0]

    def solid_rays(self, origin: Vector, directions: Array = AXES) -> Array:
        """Distances to collision geometry, by MuJoCo's own rays."""
        data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, data)
        groups = np.array([0, 0, 0, 1, 0, 0], dtype=np.uint8)
        geom = np.zeros(1, dtype=np.int32)
        found = [
            mujoco.mj_ray(self.model, data, np.array(origin), way, groups, 1, -1, geom, None)
            for way in np.asarray(directions, dtype=float)
        ]
        return np.array([way if way >= 0.0 else np.inf for way in found])

    def texts(self) -> str:
        """All warnings in one text."""
        return "\n".join(f"{w.subject}: {w.text}" for w in self.findings.warnings())


def import_text(folder: Path, text: str, name: str = "map.t3d", **options: object) -> World:
    """Write a map file, read and build it."""
    findings = Findings()
    return build_world(folder, read(write(folder, text, name), findings, **options), findings)


def build_world(folder: Path, scene: Scene, findings: Findings | None = None) -> World:
    """Build a scene into a fresh folder."""
    findings = findings or Findings()
    number = len(list(folder.glob("built*")))
    place = folder / f"built{number}"
    place.mkdir(parents=True)
    return World(build(scene, place, findings), findings, scene)


def scene_of(*objects: SceneObject, starts: Sequence[StartPose] = (), **more: object) -> Scene:
    """A scene of objects."""
    source = Source(Path("map.test"), "test")
    return Scene(source, objects=objects, starts=tuple(starts), **more)  # type: ignore[arg-type]


def mesh_of(
    vertices: Sequence[Sequence[float]] | Array,
    triangles: Sequence[Sequence[int]] | NDArray[np.int32],
    **more: object,
) -> Mesh:
    """A mesh from lists."""
    corners = np.array(vertices, dtype=float).reshape(-1, 3)
    return Mesh("mesh", corners, np.array(triangles, dtype=np.int32).reshape(-1, 3), **more)  # type: ignore[arg-type]


def joined(*meshes: Mesh) -> Mesh:
    """One mesh of several."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    triangles = [mesh.triangles + start for mesh, start in zip(meshes, starts, strict=False)]
    return mesh_of(np.concatenate([m.vertices for m in meshes]), np.concatenate(triangles))


def polygon_area(points: Array) -> float:
    """Of a flat polygon in space, m^2."""
    crosses = np.cross(points - points[0], np.roll(points, -1, axis=0) - points[0])
    return float(np.linalg.norm(crosses.sum(axis=0)) / 2.0)


def is_convex(points: Array) -> bool:
    """Whether no corner of a flat polygon turns the other way."""
    edges = np.roll(points, -1, axis=0) - points
    turns = np.cross(edges, np.roll(edges, -1, axis=0))
    return bool((turns @ turns.sum(axis=0) > -1e-9).all())


def thing(mesh: Mesh, name: str = "thing", pose: Pose = IDENTITY, **more: object) -> SceneObject:
    """An object of one mesh; keywords go to the object."""
    return SceneObject(name, (Part(mesh),), pose, **more)  # type: ignore[arg-type]


def cuboid_mesh(low: Vector, high: Vector, inward: bool = False) -> Mesh:
    """A closed box of twelve triangles."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    vertices = np.array(low) + corners * (np.array(high) - np.array(low))
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    turned = np.array(triangles, dtype=np.int32)[:, :: -1 if inward else 1]
    return mesh_of(vertices, turned)


def grid_mesh(columns: int, rows: int, size: float, heights: Array | None = None) -> Mesh:
    """A floor of columns x rows squares, two triangles each, around the origin."""
    x, y = np.meshgrid(
        np.linspace(-size / 2, size / 2, columns + 1), np.linspace(-size / 2, size / 2, rows + 1)
    )
    z = np.zeros_like(x) if heights is None else heights
    vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    index = np.arange((columns + 1) * (rows + 1)).reshape(rows + 1, columns + 1)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    triangles = np.concatenate(
        [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    )
    return mesh_of(vertices, triangles.astype(np.int32))


def blocks(filled: NDArray[np.bool_], *edges: Sequence[float]) -> Mesh:
    """One skin around blocks of a grid: which are filled (x, y, z), and where planes cut each axis.

    Faces face outside; corners that meet are one.
    """
    padded = np.pad(filled, 1)
    quads: list[Array] = []
    for cell in np.argwhere(filled):
        low = np.array([edges[k][cell[k]] for k in range(3)], dtype=float)
        high = np.array([edges[k][cell[k] + 1] for k in range(3)], dtype=float)
        for axis in range(3):
            for side in (0, 1):
                beyond = cell + 1
                beyond[axis] += 2 * side - 1
                if padded[tuple(beyond)]:
                    continue
                u, v = (axis + 1) % 3, (axis + 2) % 3
                quad = np.tile(low, (4, 1))
                quad[:, axis] = (low, high)[side][axis]
                quad[[1, 2], u], quad[[2, 3], v] = high[u], high[v]
                quads.append(quad if side else quad[::-1])
    corners, index = np.unique(np.concatenate(quads), axis=0, return_inverse=True)
    rings = index.reshape(-1, 4)
    return mesh_of(corners, np.concatenate([rings[:, [0, 1, 2]], rings[:, [0, 2, 3]]]))


def holed_plate(count: int, radius: float, size: float, thick: float) -> Mesh:
    """A square plate that stands across y, with a round hole of some segments in its middle."""
    turn = np.arange(count) * (2.0 * np.pi / count)
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    rim = size / 2.0 * ring / np.abs(ring).max(axis=1)[:, None]
    layers = [(radius * ring, 0.0), (rim, 0.0), (radius * ring, thick), (rim, thick)]
    corners = np.concatenate(
        [
            np.column_stack([flat[:, 0], np.full(count, y), flat[:, 1] + size / 2.0])
            for flat, y in layers
        ]
    )
    a, b = np.arange(count), (np.arange(count) + 1) % count
    quads = []
    for one, other in ((0, 1), (1, 3), (3, 2), (2, 0)):
        p, q = one * count, other * count
        quads.append(np.column_stack([p + a, q + a, q + b, p + b]))
    rings = np.concatenate(quads)
    return mesh_of(corners, np.concatenate([rings[:, [0, 1, 2]], rings[:, [0, 2, 3]]]))


def torus(around: int, across: int, radius: float, thick: float) -> Mesh:
    """A ring that lies on the ground."""
    a, b = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    turn, roll = a * (2.0 * np.pi / around), b * (2.0 * np.pi / across)
    way = radius + thick * np.cos(roll)
    corners = np.stack(
        [way * np.cos(turn), way * np.sin(turn), thick + thick * np.sin(roll)], axis=-1
    ).reshape(-1, 3)
    c, d = (a + 1) % around, (b + 1) % across
    rings = np.stack([a * across + b, c * across + b, c * across + d, a * across + d], axis=-1)
    rings = rings.reshape(-1, 4)
    return mesh_of(corners, np.concatenate([rings[:, [0, 1, 2]], rings[:, [0, 2, 3]]]))


def ramp_mesh(degrees: float, bottom: bool = True) -> Mesh:
    """A wedge 2 m long and 1 m wide that rises along x, with or without its underside."""
    top = 2.0 * np.tan(np.radians(degrees))
    corners = [(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0), (2, 0, top), (2, 1, top)]
    faces = [(0, 4, 5), (0, 5, 3), (1, 2, 5), (1, 5, 4), (0, 1, 4), (3, 5, 2)]
    return mesh_of(corners, faces + ([(0, 3, 2), (0, 2, 1)] if bottom else []))
