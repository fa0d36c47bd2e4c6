"""`mujoco.Renderer` as anybody would use it, on a scene of the server: what its own is measured by.

Quality, near plane and OpenGL are those of the server's default; nothing else is set.
"""

from __future__ import annotations

import importlib
import math
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.cameras.backend import NEAR
from usarsim_server.cameras.gl import QUADS, SLICES, STACKS
from usarsim_server.cameras.posed_model import Stage
from usarsim_server.cameras.view import Eye
from usarsim_server.simulation.model import CompiledWorld
from usarsim_server.simulation.snapshot import Snapshot
from usarsim_server.testing import Closing


class BareRenderer(Closing):
    """Draws one scene from eyes of one size and field of view, none of them rolled."""

    def __init__(self, platform: str, world: CompiledWorld, snapshot: Snapshot, eye: Eye) -> None:
        """Open a renderer.

        Args:
            platform: of OpenGL, "egl" or "osmesa".
            world: the model of the snapshot.
            snapshot: the scene.
            eye: one of those that it will be drawn from.
        """
        # The platform that mujoco took when it was imported may not be the one that works here.
        renderer = importlib.import_module("mujoco.rendering.classic.renderer")
        context: Any = importlib.import_module(f"mujoco.{platform}").GLContext
        renderer.gl_context.GLContext = context
        stage = Stage(world)
        stage.show(snapshot)
        quality = stage.model.vis.quality
        quality.shadowsize = quality.offsamples = 0
        quality.numslices, quality.numstacks, quality.numquads = SLICES, STACKS, QUADS
        tall = math.atan(eye.slope * eye.height / eye.width)
        stage.model.vis.global_.fovy = math.degrees(2.0 * tall)
        stage.model.vis.map.znear = NEAR / stage.model.stat.extent
        self._camera = mujoco.MjvCamera()
        self._camera.distance = 1.0
        self._data = stage.data
        self._renderer = mujoco.Renderer(stage.model, eye.height, eye.width)
        for flag in ("mjRND_REFLECTION", "mjRND_SHADOW"):
            self._renderer.scene.flags[getattr(mujoco.mjtRndFlag, flag)] = 0

    def draw(self, eye: Eye) -> NDArray[np.uint8]:
        """One picture: (height, width, 3), red green blue."""
        ahead = eye.pose.rotate((1.0, 0.0, 0.0))
        self._camera.lookat = np.add(eye.pose.position, ahead)
        self._camera.azimuth = math.degrees(math.atan2(ahead[1], ahead[0]))
        self._camera.elevation = math.degrees(math.asin(max(-1.0, min(1.0, ahead[2]))))
        self._renderer.update_scene(self._data, self._camera)
        picture: NDArray[np.uint8] = self._renderer.render()
        return picture

    def close(self) -> None:
        """Give everything back."""
        self._renderer.close()
