"""Steps by compiled servos and compensation are those of numpy, to the bit."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest
from sim_fakes import engine_with, pose_at, straight, turn

from usarsim_server.simulation import native
from usarsim_server.simulation.engine import Engine

needs_compiler = pytest.mark.skipif(native.library() is None, reason="no C compiler")


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


@pytest.fixture
def without_compiler(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """As on a machine without a C compiler."""
    monkeypatch.setattr(native.shutil, "which", lambda _: None)
    native.library.cache_clear()
    yield
    native.library.cache_clear()


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


@needs_compiler
def test_a_callback_that_was_taken_is_noticed() -> None:
    """Whoever sets MuJoCo's callback does not silently switch servos and compensation off."""
    engine = engine_with((0.0, 0.0))
    callback = mujoco.get_mjcb_control()
    mujoco.set_mjcb_control(None)
    try:
        with pytest.raises(RuntimeError, match="mjcb_control"):
            engine.advance(2)
    finally:
        mujoco.set_mjcb_control(callback)


def test_without_a_compiler_numpy_steps(without_compiler: None) -> None:
    """Nothing is missing where nothing can be compiled."""
    engine = engine_with((0.0, 0.0))
    assert engine.parts.native is None
    assert engine.advance(2) == []


def test_a_folder_that_others_write_to_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No code is loaded that somebody else may have put there."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tmp_path / "usarsim").mkdir()
    (tmp_path / "usarsim").chmod(0o777)
    with pytest.raises(OSError, match="others may write"):
        native._compiled()
