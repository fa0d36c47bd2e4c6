"""Triangles of MuJoCo geometry against the true surfaces."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from ray_scenes import SHAPES, TRAY_FACES, add_meshes
from sim_fakes import Geom

from usarsim_server.simulation.rays.triangles import TOLERANCE, triangles

Array = NDArray[np.float64]
UPRIGHT = (np.zeros(3), np.eye(3))

Distance = Callable[[Array], Array]


def model_with(kind: Geom, size: tuple[float, ...] = (), **extra: str) -> mujoco.MjModel:
    """A world of one geom."""
    spec = mujoco.MjSpec()
    add_meshes(spec)
    geom = spec.worldbody.add_geom(type=kind, **extra)
    if size:
        geom.size = [*size, 0.0, 0.0, 0.0][:3]
    return spec.compile()


def area(faces: Array) -> float:
    """Total area of triangles, m^2."""
    edges = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    return float(np.linalg.norm(edges, axis=1).sum() / 2)


def volume(faces: Array) -> float:
    """Volume inside triangles that are wound outwards, m^3."""
    return float(np.einsum("ij,ij->i", faces[:, 0], np.cross(faces[:, 1], faces[:, 2])).sum() / 6)


def samples(faces: Array, count: int = 3000) -> Array:
    """Points on triangles, on the middles and edges of the facets first of all."""
    dice = np.random.default_rng(1)
    weights = dice.dirichlet((0.7, 0.7, 0.7), count)
    chosen = faces[dice.integers(0, len(faces), count)]
    return np.concatenate([np.einsum("ij,ijk->ik", weights, chosen), faces.mean(axis=1)])


def outside_sphere(radius: float) -> Distance:
    """Signed distance from a sphere."""
    return lambda points: np.linalg.norm(points, axis=1) - radius


def outside_capsule(radius: float, half: float) -> Distance:
    """Signed distance from a capsule along z."""

    def distance(points: Array) -> Array:
        core = np.zeros_like(points)
        core[:, 2] = np.clip(points[:, 2], -half, half)
        return np.asarray(np.linalg.norm(points - core, axis=1) - radius)

    return distance


def outside_cylinder(radius: float, half: float) -> Distance:
    """Signed distance from a cylinder along z."""

    def distance(points: Array) -> Array:
        side = np.linalg.norm(points[:, :2], axis=1) - radius
        cap = np.abs(points[:, 2]) - half
        return np.maximum(side, cap)

    return distance


ROUND_CASES = [
    (Geom.mjGEOM_SPHERE, (r,), outside_sphere(r)) for r in (0.0004, 0.02, 0.11, 0.7, 2.5)
]
ROUND_CASES += [
    (Geom.mjGEOM_CAPSULE, (r, h), outside_capsule(r, h))
    for r, h in ((0.05, 0.3), (0.4, 0.1), (2.0, 1.0))
]
ROUND_CASES += [
    (Geom.mjGEOM_CYLINDER, (r, h), outside_cylinder(r, h))
    for r, h in ((0.05, 0.3), (0.6, 0.02), (5.0, 2.0))
]


class TestRound:
    """Shapes that triangles can only approach."""

    @pytest.mark.parametrize(("kind", "size", "distance"), ROUND_CASES)
    def test_facets_are_close_to_the_surface(
        self, kind: Geom, size: tuple[float, ...], distance: Distance
    ) -> None:
        """No facet lies outside the true surface, nor more than the tolerance inside it."""
        faces = triangles(model_with(kind, size), 0, *UPRIGHT)
        off = distance(samples(faces))
        assert off.max() < 1e-9
        assert off.min() > -1.05 * TOLERANCE

    @pytest.mark.parametrize("axes", [(0.11, 0.04, 0.11), (1.0, 0.2, 0.5), (0.3, 0.3, 0.3)])
    def test_ellipsoids_are_close_to_the_surface(self, axes: tuple[float, ...]) -> None:
        """No facet of an ellipsoid lies outside it, nor more than the tolerance inside."""
        faces = triangles(model_with(Geom.mjGEOM_ELLIPSOID, axes), 0, *UPRIGHT)
        points = samples(faces)
        semi = np.array(axes)
        level = np.linalg.norm(points / semi, axis=1)
        assert level.max() < 1.0 + 1e-9
        gradient = np.linalg.norm(points / semi**2, axis=1) / level
        assert ((1.0 - level) / gradient).max() < 1.05 * TOLERANCE

    @pytest.mark.parametrize(
        ("kind", "size", "expected"),
        [
            (Geom.mjGEOM_SPHERE, (0.5,), 4 * np.pi * 0.125 / 3),
            (Geom.mjGEOM_ELLIPSOID, (0.5, 0.2, 0.3), 4 * np.pi * 0.03 / 3),
            (Geom.mjGEOM_CAPSULE, (0.2, 0.4), np.pi * 0.04 * (0.8 + 4 * 0.2 / 3)),
            (Geom.mjGEOM_CYLINDER, (0.2, 0.4), np.pi * 0.04 * 0.8),
        ],
    )
    def test_surfaces_are_closed(
        self, kind: Geom, size: tuple[float, ...], expected: float
    ) -> None:
        """The facets enclose the shape's volume: none is missing, none is turned around."""
        assert volume(triangles(model_with(kind, size), 0, *UPRIGHT)) == pytest.approx(
            expected, rel=0.02
        )

    @pytest.mark.parametrize(
        "kind",
        [
            Geom.mjGEOM_SPHERE,
            Geom.mjGEOM_ELLIPSOID,
            Geom.mjGEOM_CAPSULE,
            Geom.mjGEOM_CYLINDER,
        ],
    )
    def test_no_corner_lies_on_an_axis(self, kind: Geom) -> None:
        """Where people look from above or along, a ray meets the inside of a facet."""
        faces = triangles(model_with(kind, (0.3, 0.3, 0.3)), 0, *UPRIGHT)
        corners = faces.reshape(-1, 3)
        for axis in range(3):
            across = np.delete(corners, axis, axis=1)
            assert np.linalg.norm(across, axis=1).min() > 1e-4

    def test_no_slivers(self) -> None:
        """No facet of any kind is degenerate, so every facet has a normal."""
        for kind in (Geom.mjGEOM_SPHERE, Geom.mjGEOM_CAPSULE, Geom.mjGEOM_CYLINDER):
            faces = triangles(model_with(kind, (0.3, 0.2)), 0, *UPRIGHT)
            edges = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
            assert np.linalg.norm(edges, axis=1).min() > 1e-9

    def test_large_shapes_stay_affordable(self) -> None:
        """Even a huge sphere has no more than some ten thousand facets."""
        assert len(triangles(model_with(Geom.mjGEOM_SPHERE, (50.0,)), 0, *UPRIGHT)) < 70_000


class TestFlat:
    """Shapes that triangles give exactly."""

    def test_box(self) -> None:
        """A box has twelve facets with its corners, area and volume."""
        faces = triangles(model_with(Geom.mjGEOM_BOX, (0.1, 0.2, 0.3)), 0, *UPRIGHT)
        assert len(faces) == 12
        assert area(faces) == pytest.approx(8 * (0.02 + 0.03 + 0.06))
        assert volume(faces) == pytest.approx(8 * 0.006)
        np.testing.assert_allclose(np.abs(faces).max(axis=(0, 1)), (0.1, 0.2, 0.3))

    def test_mesh(self) -> None:
        """A mesh keeps each of its triangles, in the world frame of its file."""
        model = model_with(Geom.mjGEOM_MESH, meshname="tray")
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        faces = triangles(model, 0, data.geom_xpos[0], data.geom_xmat[0].reshape(3, 3))
        assert len(faces) == len(TRAY_FACES)
        np.testing.assert_allclose(faces.min(axis=(0, 1)), (-1.3, -0.78, 0.0), atol=1e-5)
        np.testing.assert_allclose(faces.max(axis=(0, 1)), (1.3, 0.78, 0.5), atol=1e-5)

    def test_height_field(self) -> None:
        """A height field is a closed block: hills on top, upright sides, a flat bottom."""
        model = model_with(Geom.mjGEOM_HFIELD, hfieldname="hills")
        faces = triangles(model, 0, *UPRIGHT)
        data = model.hfield_data.reshape(7, 9)
        cells = (2 * (data[:-1, :-1] + data[1:, 1:]) + data[:-1, 1:] + data[1:, :-1]) / 6
        block = 0.6 * float(cells.mean()) * 6.0 + 0.2 * 6.0
        assert volume(faces) == pytest.approx(block, rel=1e-5)
        np.testing.assert_allclose(faces.min(axis=(0, 1)), (-1.5, -1.0, -0.2), atol=1e-6)
        np.testing.assert_allclose(faces.max(axis=(0, 1)), (1.5, 1.0, 0.6 * data.max()), atol=1e-6)

    def test_plane(self) -> None:
        """An endless plane has no triangles."""
        assert triangles(model_with(Geom.mjGEOM_PLANE, (1.0, 1.0, 1.0)), 0, *UPRIGHT).shape == (
            0,
            3,
            3,
        )


def test_every_kind_is_known() -> None:
    """No kind of geom that a world may use is silently invisible."""
    kinds = {name: getattr(Geom, f"mjGEOM_{name.upper()}") for name in SHAPES}
    for name, kind in kinds.items():
        extra = {"mesh": {"meshname": "tray"}, "hfield": {"hfieldname": "hills"}}.get(name, {})
        size = () if extra else (0.2, 0.2, 0.2)
        assert len(triangles(model_with(kind, size, **extra), 0, *UPRIGHT)) > 0


def test_position_and_attitude() -> None:
    """Triangles are in the world frame."""
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    model = model_with(Geom.mjGEOM_BOX, (0.1, 0.2, 0.3))
    faces = triangles(model, 0, np.array([1.0, 2.0, 3.0]), turn)
    np.testing.assert_allclose(faces.min(axis=(0, 1)), (0.8, 1.9, 2.7))
    np.testing.assert_allclose(faces.max(axis=(0, 1)), (1.2, 2.1, 3.3))
