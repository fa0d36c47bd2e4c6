"""Machines where Embree cannot be called directly do with what `embreex` offers."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator

import mujoco
import numpy as np
import pytest

from usarsim_server.simulation.rays import embree
from usarsim_server.simulation.rays.embree import device, library
from usarsim_server.simulation.rays.triangles import TriangleScene, triangles


@pytest.fixture
def fresh_library() -> Iterator[None]:
    """Embree is looked for anew, now and afterwards."""
    library.cache_clear()
    yield
    library.cache_clear()


@pytest.mark.usefixtures("fresh_library")
class TestWithoutTheLibrary:
    """Machines and versions where Embree cannot be asked."""

    @pytest.mark.parametrize("fails", [OSError, AttributeError])
    def test_symbols_that_are_not_there(
        self, fails: type[Exception], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Shapes are as good as ever."""

        def refuse(_: str) -> ctypes.PyDLL:
            raise fails

        monkeypatch.setattr(ctypes, "PyDLL", refuse)
        assert library() is None
        box = TriangleScene([(0, _box())])
        # In single precision, whose last digit depends on the processor.
        distances = box.cast(np.array([[-3.0, 0, 0]]), np.eye(3)[:1]).distances
        assert distances.tolist() == pytest.approx([2.0], abs=1e-6)

    def test_another_layout(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """An `embreex` whose objects are not as it declares them is not looked into."""

        class Larger(embree.rtcore_scene.EmbreeScene):
            """With a dictionary, so of another size."""

        monkeypatch.setattr(embree.rtcore_scene, "EmbreeScene", Larger)
        assert library() is None
        assert device() is device()


def _box() -> np.ndarray:
    """Triangles (12, 3, 3) of a cube of 2 m about the origin."""
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom type='box' size='1 1 1'/></worldbody></mujoco>"
    )
    return triangles(model, 0, np.zeros(3), np.eye(3))


def test_the_tree_is_built_without_the_interpreter(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever builds a shape does not keep others from the interpreter, and the tree is there when
    the scene is asked first."""
    held: list[bool] = []
    plain = ctypes.CFUNCTYPE(None, ctypes.c_void_p)
    called = embree._commit(library())
    assert isinstance(called, plain)  # `PYFUNCTYPE` would keep it

    def commit(_: object) -> Callable[[int | None], None]:
        return lambda scene: (called(scene), held.append(True))[0]

    monkeypatch.setattr(embree, "_commit", commit)
    TriangleScene([(0, _box())])
    assert held == [True]
