"""Rays by compiled code meet what they meet by numpy, to the bit."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from ray_scenes import Caster, add_shape, arm_robot, narrow_fans, random_fans, random_scene, ray
from sim_fakes import ROBOT, Geom, Scenery, engine_with, pose_at

from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.model import PhysicsOptions
from usarsim_server.simulation.rays import cast as casting
from usarsim_server.simulation.rays import compiled
from usarsim_server.simulation.rays.compiled import ray_code
from usarsim_server.simulation.rays.query import PendingReport, RayFan, RayHits
from usarsim_server.simulation.snapshot import Snapshot

needs_compiler = pytest.mark.skipif(ray_code() is None, reason="no C compiler, or no Embree")
ROBOTS = 5
LOOSE = ("box", "sphere", "ellipsoid", "capsule", "cylinder", "mesh")


def everything(seed: int) -> mujoco.MjSpec:
    """What stands and what is loose, of every shape, with panes of glass; floors, one aslant."""
    dice = np.random.default_rng(seed)
    spec = random_scene(seed)
    spec.mesh("tray").inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    slope = dice.normal(size=4) * 0.1 + np.array([1.0, 0.0, 0.0, 0.0])
    spec.worldbody.add_geom(
        name="slope", type=Geom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0], quat=slope, pos=[0, 0, -0.3]
    )
    for number in range(4):
        add_shape(spec, spec.worldbody, f"glass_{number}", "box", dice)
    for number, shape in enumerate(LOOSE * 2):
        place = dice.uniform((-3, -3, 1), (3, 3, 6))
        body = spec.worldbody.add_body(name=f"loose{number}", pos=place)
        body.add_freejoint()
        add_shape(spec, body, f"shape{number}", shape, dice, spread=0.2).mass = 1.0
        body.add_geom(name=f"glass{number}", type=Geom.mjGEOM_BOX, size=[0.02, 0.8, 0.8], mass=0.1)
    return spec


def crowd(seed: int) -> Engine:
    """Robots with arms of several bodies among all that, in any attitude."""
    dice = np.random.default_rng(seed)
    places = [(2.0 * number - 4.0, 0.0) for number in range(ROBOTS)]
    model = replace(ROBOT, build=arm_robot)
    engine = engine_with(*places, model=model, scenery=lambda: everything(seed), spare=1)
    for layout in engine.snapshot().layouts.values():
        pose = [*dice.uniform((-3, -3, 0.2), (3, 3, 5)), *dice.normal(size=4)]
        engine.data.qpos[layout.qpos : layout.qpos + 7] = pose
        for joint, most in (("shoulder", 3.0), ("elbow", 3.0), ("lift", 0.8)):
            engine.data.qpos[layout.joint_qpos[joint]] = dice.uniform(0.0, most)
    return engine


def questions(dice: np.random.Generator, snapshot: Snapshot) -> list[PendingReport]:
    """Reports of robots and of nobody with fans of every kind, many at things that move."""
    fans: list[RayFan] = [RayFan(np.zeros(3), np.zeros((0, 3)), 5.0, normals=True, identify=True)]
    fans += random_fans(dice, 20, 60) + narrow_fans(dice)
    things = snapshot.xpos[1:]
    for number in range(40):
        origins = dice.uniform((-5, -5, 0.1), (5, 5, 8), (1 + 6 * number, 3))
        aims = things[dice.integers(0, len(things), len(origins))] - origins
        ways = aims + 0.2 * dice.normal(size=aims.shape)
        origin = origins if number % 2 else origins[0]
        ways /= np.linalg.norm(ways, axis=1)[:, None]
        fans.append(RayFan(origin, ways, float(dice.choice([0.7, 4.0, 30.0, np.inf]))))
    for axis in np.vstack([np.eye(3), -np.eye(3)]):  # these ways have zeros
        fans.append(RayFan(things[3], axis[None], 20.0))
    looks = [
        replace(
            fan,
            normals=bool(dice.integers(2)),
            through_glass=bool(dice.integers(2)),
            identify=bool(dice.integers(2)),
        )
        for fan in fans
    ]
    viewers = [None, *range(ROBOTS), 77]
    return [
        PendingReport(snapshot, viewers[number % len(viewers)], looks[number::9])
        for number in range(9)
    ]


def answers(caster: Caster, reports: Sequence[PendingReport]) -> list[RayHits]:
    """Those to all fans, once with what moves, once without."""
    found = casting.cast_all(reports, caster.static, caster.dynamic)
    fans = [fan for report in reports for fan in report.fans]
    alone = [hits for report in found for hits in report]
    return alone + casting.cast_scenery(fans, caster.static)


def by_numpy(patch: pytest.MonkeyPatch) -> None:
    """Cast without compiled code from now on."""
    patch.setattr(casting, "ray_code", lambda: None)


def assert_same(one: RayHits, other: RayHits) -> None:
    """All bits are equal, but for the sign of zeros."""
    np.testing.assert_array_equal(one.distances, other.distances)
    assert one.names == other.names
    assert (one.normals is None) == (other.normals is None)
    if one.normals is not None and other.normals is not None:
        np.testing.assert_array_equal(one.normals, other.normals)
        assert one.normals.shape == (len(one.distances), 3)


@needs_compiler
@pytest.mark.parametrize("seed", range(6))
def test_same_as_numpy(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Distances, normals and names are equal, for all eyes, through glass and without."""
    engine, dice = crowd(seed), np.random.default_rng(seed + 100)
    caster = Caster(engine)
    reports = questions(dice, engine.snapshot())
    found = answers(caster, reports)
    by_numpy(monkeypatch)
    fans = [fan for report in reports for fan in report.fans]
    hits = moved = 0
    for fan, one, other in zip(fans * 2, found, answers(caster, reports), strict=True):
        assert_same(one, other)
        hits += int(np.isfinite(one.distances).sum())
        assert (one.distances[np.isfinite(one.distances)] <= fan.max_range).all()
    for one, other in zip(found[: len(fans)], found[len(fans) :], strict=True):
        moved += int((one.distances < other.distances).sum())
    assert hits > 3000
    assert moved > 500


def twins() -> mujoco.MjSpec:
    """Four boxes in one place."""
    spec = mujoco.MjSpec()
    for number in range(4):
        body = spec.worldbody.add_body(name=f"twin{number}", pos=[3.0, 0.0, 1.0])
        body.add_freejoint()
        body.add_geom(type=Geom.mjGEOM_BOX, size=[0.5, 0.5, 0.5], mass=1.0)
    return spec


def ball() -> mujoco.MjSpec:
    """A ball that looks out of a large plate by less than its facets lie inside of it."""
    spec = mujoco.MjSpec()
    for name, shape, size, x in (
        ("plate", "BOX", [0.5, 2.0, 2.0], 3.00002),
        ("ball", "SPHERE", [1.0, 0.0, 0.0], 3.5),
    ):
        body = spec.worldbody.add_body(name=name, pos=[x, 0.0, 1.0])
        body.add_freejoint()
        body.add_geom(type=getattr(Geom, f"mjGEOM_{shape}"), size=size, mass=1.0)
    return spec


@needs_compiler
@pytest.mark.parametrize(("scenery", "name"), [(twins, "twin3"), (ball, "ball")])
def test_things_in_one_another(
    scenery: Scenery, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of what is as far away both find the same; a ball is as near as it is, not as its facets."""
    caster = Caster(Engine(scenery, PhysicsOptions()))
    origins = np.random.default_rng(3).uniform((0, -0.002, 0.998), (0, 0.002, 1.002), (60, 3))
    ways = np.tile([1.0, 0.0, 0.0], (60, 1))
    look = RayFan(origins, ways, 20.0, identify=True, normals=True)
    (one,) = caster(look)
    by_numpy(monkeypatch)
    (other,) = caster(look)
    assert_same(one, other)
    assert one.names == (name,) * 60


@needs_compiler
def test_a_robot_that_comes_is_seen() -> None:
    """What the code is told of belongs to the instant, whatever was asked before."""
    engine = engine_with((0.0, 0.0), spare=1)
    caster = Caster(engine)
    look = ray((0.0, 0, 0.15), (1, 0, 0))
    before = caster(look, robot=0)[0].distances[0]
    engine.occupy(1, 1, pose_at(2.0, 0.0))
    after = caster(look, robot=0)[0].distances[0]
    engine.vacate(1)
    gone = caster(look, robot=0)[0].distances[0]
    assert after == pytest.approx(1.8, abs=1e-5)
    assert before == gone == np.inf


def test_without_a_compiler_numpy_casts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is missing where nothing can be compiled, or Embree cannot be asked."""
    monkeypatch.setattr(compiled, "ray_code", compiled.ray_code.__wrapped__)
    with monkeypatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path))
        patch.setattr("shutil.which", lambda _: None)
        assert compiled.ray_code() is None
    with monkeypatch.context() as patch:
        patch.setenv("USARSIM_NATIVE", "0")
        assert compiled.ray_code() is None
    with monkeypatch.context() as patch:
        patch.setattr(compiled, "library", lambda: None)
        assert compiled.ray_code() is None


@needs_compiler
def test_no_room(monkeypatch: pytest.MonkeyPatch) -> None:
    """Code that finds no memory is an error of Python's."""
    code = ray_code()
    assert code is not None
    failing = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p)(lambda _: 1)
    monkeypatch.setattr(code, "_cast", failing)
    with pytest.raises(MemoryError):
        Caster(engine_with((0.0, 0.0)))(ray((0, 0, 1), (1, 0, 0)))
