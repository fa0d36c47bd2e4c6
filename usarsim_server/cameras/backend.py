"""What renders: the border between render loop and OpenGL or rays, and which of them works here.

Loading a GL library that is missing, half installed or without a device ends in anything from an
`AttributeError` to the end of the process, so nothing here loads one into the server before
another process has drawn a picture with it.
"""

from __future__ import annotations

import functools
import os
import subprocess
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.launch import python
from usarsim_server.base.logs import Log
from usarsim_server.cameras.posed_model import Stage
from usarsim_server.cameras.view import Eye

NEAR = 0.12
"""m: nothing nearer is drawn, as in the original (robots reference 2.7 and 5.4 #102)."""

SKY = 0.6
"""Part of the far plane's distance within which things are seen. MuJoCo draws the sky itself as a
faceted ball of about 0.7, and it covers whatever is beyond."""
_MIN_FAR = 100.0
"""m to the far plane at least."""

PLATFORMS = ("egl", "osmesa")
"""Ways to have OpenGL without a screen, in the order in which they are tried."""

_TIMEOUT = 30.0
"""s of wall time; a cold llvmpipe takes one."""

_TRIAL = """
import sys, mujoco, numpy
from importlib import import_module
context = import_module("mujoco." + sys.argv[1]).GLContext(16, 16)
context.make_current()
xml = '<mujoco><visual><headlight ambient="1 1 1"/></visual><worldbody>'
xml += '<geom type="box" size="1 1 1" rgba="1 0 0 1"/></worldbody></mujoco>'
model = mujoco.MjModel.from_xml_string(xml)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
renderer = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, renderer)
scene = mujoco.MjvScene(model, 10)
camera = mujoco.MjvCamera()
mujoco.mjv_defaultFreeCamera(model, camera)
kinds = mujoco.mjtCatBit.mjCAT_ALL
mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, camera, kinds, scene)
rectangle = mujoco.MjrRect(0, 0, 16, 16)
mujoco.mjr_render(rectangle, scene, renderer)
pixels = numpy.zeros((16, 16, 3), numpy.uint8)
mujoco.mjr_readPixels(pixels, None, rectangle, renderer)
red, green, _ = pixels[8, 8].tolist()
renderer.free()
context.free()
print("drawn" if red > 100 and green < 50 else f"a wrong picture: {pixels[8, 8].tolist()}")
"""
"""Draws a red cube and looks at its middle."""

INSTALL = {
    "egl": "apt-get install libegl1 libgl1-mesa-dri libgl1",
    "osmesa": "apt-get install libosmesa6",
}
"""What a Debian machine lacks where a platform does not work."""

_log = Log("cameras")
_lock = threading.Lock()


def far_plane(model: mujoco.MjModel) -> float:
    """Distance (m) of the far plane in the scene of a model."""
    return max(_MIN_FAR, float(model.vis.map.zfar) * float(model.stat.extent))


@dataclass(frozen=True, slots=True)
class Quality:
    """What pictures may cost."""

    shadows: int = 0  # edge of the shadow map, pixels; 0: no shadows
    multisample: int = 0  # samples per pixel; 0: none


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is wanted of a shot beside its colours."""

    depth: bool = False
    albedo: bool = False
    geoms: bool = False
    exact: bool = False
    """To the pixel the same whatever else is wanted; else edges may move by a part of one."""


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """What one eye sees, top row first; valid until the next shot."""

    colors: NDArray[np.uint8]  # (height, width, 3) uint8, red green blue
    depth: NDArray[np.float32] | None = None
    """(height, width) float32, metres along the viewing axis, infinity for the sky."""
    albedo: NDArray[np.uint8] | None = None
    """(height, width, 3) uint8, colours in plain white light from everywhere."""
    geoms: NDArray[np.int32] | None = None  # (height, width) int32, -1 for the sky


class Backend(Protocol):
    """Renders stages; made, used and closed by one thread."""

    @property
    def name(self) -> str:
        """For the log."""

    def render(self, stage: Stage, eye: Eye, wanted: Wanted) -> Shot:
        """What an eye sees of a stage as it is now.

        Raises:
            RuntimeError: if the machine cannot do it.
        """

    def close(self) -> None:
        """Give everything back."""


def works(platform: str) -> str | None:
    """Whether a platform can draw here, tried once per process; None if so, else why not."""
    with _lock:
        return _verdict(platform)


def usable_platform(wanted: Sequence[str]) -> str | None:
    """The first of some platforms that can draw here; None, and a line in the log, if none can."""
    reasons = {}
    for platform in wanted:
        reason = works(platform)
        if reason is None:
            return platform
        reasons[platform] = reason
    if reasons:
        _tell(tuple(reasons.items()))
    return None


def platforms_to_try(renderer: str) -> tuple[str, ...]:
    """Platforms for a setting: `auto`, one of `PLATFORMS`, or `rays`.

    With `auto`, what `MUJOCO_GL` names goes first. PyOpenGL can serve one platform per process, so
    that once `PYOPENGL_PLATFORM` is set the other one is not tried.
    """
    if renderer in PLATFORMS:
        return (renderer,)
    if renderer != "auto":
        return ()
    chosen = os.environ.get("MUJOCO_GL", "").strip().lower()
    ordered = sorted(PLATFORMS, key=lambda platform: platform != chosen)
    fixed = os.environ.get("PYOPENGL_PLATFORM", "").strip().lower()
    return tuple(platform for platform in ordered if fixed in ("", platform))


@functools.cache
def _verdict(platform: str) -> str | None:
    # MuJoCo itself loads what this names, and its import fails if that cannot be loaded.
    environment = {**os.environ, "MUJOCO_GL": "disable", "PYOPENGL_PLATFORM": platform}
    try:
        answer = subprocess.run(
            python("-c", _TRIAL, platform),
            capture_output=True,
            text=True,
            timeout=_TIMEOUT,
            env=environment,
            stdin=subprocess.DEVNULL,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"the trial did not end: {type(error).__name__}"
    if answer.returncode == 0 and answer.stdout.strip() == "drawn":
        return None
    said = answer.stderr.strip().splitlines() or answer.stdout.strip().splitlines()
    return said[-1] if said else f"the trial ended with status {answer.returncode}"


@functools.cache
def _tell(reasons: tuple[tuple[str, str], ...]) -> None:
    """Say once what was tried and what to install."""
    cures = " or ".join(INSTALL[platform] for platform, _ in reasons)
    tried = "; ".join(f"{platform}: {reason}" for platform, reason in reasons)
    _log.warning(
        f"no OpenGL: pictures are cast with rays, which is slower and flatter (cure: {cures})",
        tried=tried,
    )
