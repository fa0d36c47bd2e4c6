"""Steps by compiled servos and compensation are those of numpy, to the bit."""

from __future__ import annotations

import shutil
import threading
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from limb_fakes import arm_engine, order, push, spin
from sim_fakes import engine_with, pose_at, straight, turn

from usarsim_server.simulation import native
from usarsim_server.simulation.divergence import is_sound
from usarsim_server.simulation.engine import Engine

needs_compiler = pytest.mark.skipif(native.library()[0] is None, reason="no C compiler")


def played(engine: Engine, batch: int) -> np.ndarray:
    """State and servos all along a drive with ramps, a collision, brakes, free wheels, sleep."""
    seen: list[np.ndarray] = []

    def go(seconds: float) -> None:
        for _ in range(round(seconds / engine.timestep / batch)):
            assert engine.advance(batch) == []
            data = engine.data
            servos = [array.astype(float) for array in engine.parts.wheels.state(data)]
            seen.append(np.concatenate([data.qpos, data.qvel, data.qacc_warmstart, *servos]))

    engine.drive(0, turn(3.0))
    engine.drive(1, straight(-4.0))
    go(0.8)
    engine.drive(0, straight(0.0))
    engine.drive(1, np.array([2.0, 2.0, np.nan, np.nan]))
    go(1.0)
    engine.vacate(1)
    engine.occupy(2, 2, pose_at(0.3, 0.3))
    engine.drive(2, turn(-2.0))
    go(0.8)
    assert engine.data.ntree_awake < engine.world.model.ntree
    return np.nan_to_num(np.array(seen), nan=-1.0)


@needs_compiler
@pytest.mark.parametrize("batch", [2, 5])
def test_same_as_numpy(batch: int) -> None:
    """Every number is equal, whatever the batches."""
    runs = []
    for compiled in (True, False):
        engine = engine_with((0.0, 0.0), (1.0, 0.2), spare=1)
        assert engine.parts.native is not None
        if not compiled:
            engine.parts.native = None
        runs.append(played(engine, batch))
    np.testing.assert_array_equal(*runs)


def limbs(engine: Engine, batch: int) -> np.ndarray:
    """State and servos of three arms: ways, stops, pushes, what yields, sleep and waking."""
    seen: list[np.ndarray] = []

    def go(seconds: float) -> None:
        for _ in range(round(seconds / engine.timestep / batch)):
            assert engine.advance(batch) == []
            data, joints = engine.data, engine.parts.joints
            servos = [array.astype(float) for array in joints.state(data)]
            servos += [joints.torques(), np.array(joints.course, float)]
            asleep = data.tree_asleep.astype(float)
            seen.append(np.concatenate([data.qpos, data.qvel, asleep, *servos]))

    order(engine, 0, pan=2.0, lift=3.0, slide=0.2)
    spin(engine, 1, pan=-0.7, slide=9.0)
    push(engine, 2, lift=-2.0)
    go(1.2)
    order(engine, 0, pan=1.0)
    push(engine, 2, lift=0.0)
    go(0.6)
    engine.parts.joints.release(2, engine.data)
    order(engine, 1, pan=0.0, lift=0.0, slide=0.0)
    go(4.0)
    assert (engine.data.tree_asleep >= 0).any()
    order(engine, 0, lift=-0.4)
    go(1.0)
    return np.nan_to_num(np.array(seen), posinf=1e9)


@needs_compiler
@pytest.mark.parametrize("batch", [1, 3, 5])
def test_joints_are_the_same_as_by_numpy(batch: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every number of arms is equal, and nearly all batches are compiled; those are not in which
    one is about to fall asleep."""
    runs: list[np.ndarray] = []
    compiled: list[Any] = []
    step = native.NativeSteps.step

    def noted(self: native.NativeSteps, *arguments: Any) -> bool | None:
        compiled.append(arguments)
        return step(self, *arguments)

    monkeypatch.setattr(native.NativeSteps, "step", noted)
    for native_too in (True, False):
        engine = arm_engine(count=3)
        if not native_too:
            engine.parts.native = None
        runs.append(limbs(engine, batch))
    np.testing.assert_array_equal(*runs)
    assert 0.9 < len(compiled) / len(runs[0]) < 1.0


@needs_compiler
def test_a_callback_of_somebody_else_is_let_be() -> None:
    """Who sets MuJoCo's callback has it; servos and compensation are numpy's then."""
    engine, twin = engine_with((0.0, 0.0)), engine_with((0.0, 0.0))
    twin.parts.native = None
    called: list[object] = []
    mujoco.set_mjcb_control(lambda *_: called.append(None))
    try:
        for one in (engine, twin):
            one.drive(0, straight(4.0))
            assert one.advance(5) == []
    finally:
        mujoco.set_mjcb_control(None)
    assert len(called) == 10
    np.testing.assert_array_equal(engine.data.qvel, twin.data.qvel)
    assert engine.parts.native is not None
    assert engine.parts.native.step(engine.world.model, engine.data, 1)


@needs_compiler
def test_steps_of_others_are_let_be() -> None:
    """Neither plain MuJoCo nor an engine of another thread is helped with what is one engine's."""
    engines = [engine_with((0.0, 0.0), (1.0, 0.2)) for _ in range(3)]
    plain = [mujoco.MjData(engines[0].world.model) for _ in range(2)]
    for number, engine in enumerate(engines):
        engine.drive(0, turn(3.0))
        engine.parts.native = engine.parts.native if number else None

    def go(engine: Engine) -> None:
        for _ in range(40):
            assert engine.advance(5) == []

    go(engines[0])
    mujoco.mj_step(engines[0].world.model, plain[0], 50)
    threads = [threading.Thread(target=go, args=(engine,)) for engine in engines[1:]]
    for thread in threads:
        thread.start()
    mujoco.mj_step(engines[0].world.model, plain[1], 50)
    for thread in threads:
        thread.join()
    for engine in engines[1:]:
        np.testing.assert_array_equal(engine.data.qpos, engines[0].data.qpos)
    np.testing.assert_array_equal(plain[1].qpos, plain[0].qpos)


def test_without_a_compiler_numpy_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is missing where nothing can be compiled."""
    monkeypatch.setattr(shutil, "which", lambda _: None)
    monkeypatch.setattr(native, "library", native.library.__wrapped__)
    assert native.library() == (None, "no C compiler (cc)")
    engine = engine_with((0.0, 0.0))
    assert engine.parts.native is None
    assert engine.advance(2) == []


def test_a_compiler_that_fails_is_one_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever it leaves behind is taken away."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(shutil, "which", lambda _: "/bin/false")
    code, reason = native.library.__wrapped__()
    assert code is None
    assert "/bin/false" in reason
    assert list((tmp_path / "usarsim" / "steps").iterdir()) == []


def test_a_folder_that_others_write_to_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No code is loaded that somebody else may have put there."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(shutil, "which", lambda _: "/bin/false")
    folder = tmp_path / "usarsim" / "steps"
    folder.mkdir(parents=True)
    folder.chmod(0o777)
    _, reason = native.library.__wrapped__()
    assert "others may write" in reason


@needs_compiler
@pytest.mark.parametrize(
    ("value", "sound"), [(999.0, True), (-1001.0, False), (np.nan, False), (np.inf, False)]
)
@pytest.mark.parametrize("field", ["qvel", "qpos"])
def test_soundness_is_that_of_numpy(field: str, value: float, sound: bool) -> None:
    """The compiled check of the state after the steps says what `is_sound` says."""
    engine = engine_with((0.0, 0.0))
    native_steps, data = engine.parts.native, engine.data
    assert native_steps is not None
    assert native_steps.step(engine.world.model, data, 2)
    if field == "qpos":
        sound = bool(np.isfinite(value))
    step = mujoco.mj_step

    def steps(*arguments: object) -> None:
        step(*arguments)
        getattr(data, field)[0] = value

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mujoco, "mj_step", steps)
        assert native_steps.step(engine.world.model, data, 2) == is_sound(data) == sound
