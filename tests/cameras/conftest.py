"""Fixtures of this room: a yard with carts in it, and every way of drawing that works here."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import mujoco
import pytest
from camera_fakes import MakePainter, Set, Yard

from usarsim_server.cameras import backend as probe
from usarsim_server.cameras.painter import Painter, PainterOptions, nobody_lit
from usarsim_server.worlds.description import Smoke

CLEAR = Smoke()


@pytest.fixture(autouse=True)
def mujoco_warnings() -> Iterator[None]:
    """Warnings of MuJoCo go nowhere instead of into a file in the working directory."""
    mujoco.set_mju_user_warning(lambda text: None)
    yield
    mujoco.set_mju_user_warning(None)


@pytest.fixture(params=["opengl", "rays"])
def renderer(request: pytest.FixtureRequest) -> str:
    """A renderer that works here; the OpenGL one is skipped where there is none."""
    if request.param == "rays":
        return "rays"
    return gl_or_skip()


@pytest.fixture
def gl() -> str:
    """The name of the OpenGL platform that works here."""
    return gl_or_skip()


def gl_or_skip() -> str:
    """The OpenGL platform of this process; skips the test where there is none."""
    platform = probe.usable_platform(probe.platforms_to_try("auto"))
    if platform is None:
        pytest.skip("no OpenGL library on this machine (libosmesa6, or libegl1 with drivers)")
    return platform


@pytest.fixture
def yard() -> Yard:
    """A grey yard with a red box, and no robots as yet."""
    return Yard()


@pytest.fixture
def make_painter(yard: Yard, renderer: str) -> Iterator[MakePainter]:
    """Makes painters of the yard for the renderer at hand; they are closed at the end."""
    painters: list[Painter] = []

    def make(
        smoke: Smoke = CLEAR, lit: Callable[[int], bool] = nobody_lit, of: Yard = yard
    ) -> Painter:
        options = PainterOptions(renderer=renderer, smoke=smoke)
        painters.append(Painter(of.simulation.compiled, options, lit))
        return painters[-1]

    yield make
    for painter in painters:
        painter.close()


@pytest.fixture
def stage() -> Iterator[Set]:
    """A set that is cleared away at the end."""
    one = Set()
    yield one
    one.render_loop.close()
