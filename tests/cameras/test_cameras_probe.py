"""Which renderer is taken, and what is said where there is none."""

from __future__ import annotations

import logging
import os
import subprocess
import sys

import pytest
from camera_fakes import Yard, is_red

from usarsim_server.base.errors import UsarsimError
from usarsim_server.cameras import backend as probe
from usarsim_server.cameras.painter import Painter, PainterOptions, check_renderer
from usarsim_server.cameras.view import View, looking


@pytest.fixture
def no_gl(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine without OpenGL."""
    monkeypatch.setattr(probe, "_verdict", lambda platform: f"no lib{platform}")
    for name in ("MUJOCO_GL", "PYOPENGL_PLATFORM"):  # set once a platform has been loaded
        monkeypatch.delenv(name, raising=False)
    probe._tell.cache_clear()


@pytest.mark.usefixtures("no_gl")
def test_without_opengl_rays_draw_and_one_line_says_why(caplog: pytest.LogCaptureFixture) -> None:
    """The picture is made; the log names the packages to install, once."""
    yard = Yard()
    view = View(looking((0.0, 0.0, 0.5), (4.0, 0.0, 0.5)), 1.0, 40, 30)
    with caplog.at_level(logging.DEBUG, "usarsim"):
        for _ in range(3):
            painter = Painter(yard.simulation.compiled, PainterOptions())
            assert painter.renderer == "rays"
            assert is_red(painter.picture(view, yard.look()).astype("uint8")).any()
    (record,) = caplog.records
    text = record.getMessage()
    assert "apt-get install libosmesa6" in text
    assert "apt-get install libegl1 libgl1-mesa-dri libgl1" in text


@pytest.mark.usefixtures("no_gl")
def test_a_renderer_asked_for_must_work() -> None:
    """Who names a platform that does not work here gets one error with reason and cure."""
    with pytest.raises(UsarsimError, match=r"--renderer: osmesa .*no libosmesa .*apt-get install"):
        check_renderer("osmesa")
    check_renderer("auto")
    check_renderer("rays")


def test_a_broken_platform_is_found_out_in_another_process() -> None:
    """A platform that does not exist ends the trial, not this process; the reason is kept."""
    reason = probe._verdict("nosuchplatform")
    assert reason is not None
    assert "nosuchplatform" in reason


@pytest.mark.parametrize(
    ("renderer", "mujoco_gl", "pyopengl", "expected"),
    [
        ("auto", "", "", ("egl", "osmesa")),
        ("auto", "osmesa", "", ("osmesa", "egl")),
        ("auto", "glfw", "", ("egl", "osmesa")),
        ("auto", "", "osmesa", ("osmesa",)),
        ("egl", "osmesa", "", ("egl",)),
        ("osmesa", "", "", ("osmesa",)),
        ("rays", "egl", "", ()),
    ],
)
def test_order_of_trials(
    renderer: str,
    mujoco_gl: str,
    pyopengl: str,
    expected: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """`auto` tries EGL, then OSMesa; the environment can change that, a name decides alone."""
    monkeypatch.setenv("MUJOCO_GL", mujoco_gl)
    monkeypatch.setenv("PYOPENGL_PLATFORM", pyopengl)
    assert probe.platforms_to_try(renderer) == expected


def test_importing_loads_no_library_for_pictures() -> None:
    """Whatever the machine lacks, this room can be imported; a server that encodes no picture has
    no OpenCV in its memory."""
    program = (
        "import sys, usarsim_server.app, usarsim_server.cameras.gl\n"
        "print(sorted(one for one in sys.modules if one.split('.')[0] in ('OpenGL', 'cv2')))"
    )
    answer = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=300
    )
    assert answer.stdout.strip() == "[]"


@pytest.mark.parametrize("platform", ["egl", "osmesa"])
def test_a_library_that_is_named_but_missing_stops_nobody(platform: str) -> None:
    """With `MUJOCO_GL` naming what is not installed, mujoco can still be imported."""
    program = (
        "import ctypes.util, sys\n"
        "ctypes.util.find_library = lambda name: None\n"
        "import usarsim_server, mujoco, os\n"
        "print(os.environ['MUJOCO_GL'], any(n.startswith('OpenGL') for n in sys.modules))"
    )
    answer = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
        env={**os.environ, "MUJOCO_GL": platform},
    )
    assert answer.stdout.split() == ["disable", "False"]
