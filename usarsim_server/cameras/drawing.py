"""What of a stage a picture needs, in few calls of OpenGL: batches, and none that is out of sight.

A batch is a display list. MuJoCo draws it in the place of its leader, which passes for a height
field while the scene is filled: of these MuJoCo calls the list that their number says, and asks for
nothing else.
"""

from __future__ import annotations

import ctypes
import importlib
import math
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.cameras.backend import NEAR
from usarsim_server.cameras.batches import Batch, batches, rgba, roundest, shape
from usarsim_server.cameras.posed_model import HIDDEN_GROUP, Stage
from usarsim_server.cameras.view import Eye
from usarsim_server.simulation.frames import Array

COARSE = (8, 4)
"""Slices and stacks of round shapes far away; stacks are even, for capsules are cut in halves."""
COARSE_PIXELS = 8.0
"""Radius of round shapes, pixels, below which they are drawn like that."""

_NO_HAND = mujoco.MjvPerturb()
"""Nobody drags things about with a mouse."""
_EVERYTHING = int(mujoco.mjtCatBit.mjCAT_ALL)


class Lists:
    """Display lists of batches in one context of OpenGL, made as they are needed."""

    def __init__(self, slices: int, stacks: int) -> None:
        """Start without any; round shapes get so many slices and stacks."""
        self._gl: Any = importlib.import_module("OpenGL.GL")  # its platform is fixed by now
        self._details = ((slices, stacks), COARSE)
        self._made: dict[bytes, _Made] = {}

    def of(self, model: mujoco.MjModel, wanted: tuple[Batch, ...]) -> list[_Made]:
        """The lists of some batches; those of others are dropped."""
        keep = {batch.key for batch in wanted}
        for key in self._made.keys() - keep:
            self._drop(key)
        colors = rgba(model)
        for batch in wanted:
            if batch.key not in self._made:
                self._made[batch.key] = self._make(model, batch, colors)
        return [self._made[batch.key] for batch in wanted]

    def clear(self) -> None:
        """Drop all of them."""
        for key in tuple(self._made):
            self._drop(key)

    def _drop(self, key: bytes) -> None:
        self._gl.glDeleteLists(self._made.pop(key).first, len(self._details))

    def _make(self, model: mujoco.MjModel, batch: Batch, colors: NDArray[np.float32]) -> _Made:
        gl = self._gl
        first = int(gl.glGenLists(len(self._details)))
        for number, detail in enumerate(self._details):
            corners = shape(model, batch.geoms, colors, *detail)
            gl.glNewList(first + number, gl.GL_COMPILE)
            self._draw(corners)
            gl.glEndList()
            if not number:
                places = corners[:, :3].astype(np.float64)
        middle = (places.min(axis=0) + places.max(axis=0)) / 2.0
        radius = float(np.linalg.norm(places - middle, axis=1).max())
        return _Made(first, middle, radius, roundest(model, batch.geoms))

    def _draw(self, corners: NDArray[np.float32]) -> None:
        gl, stride = self._gl, corners.strides[0]
        kinds = (gl.GL_VERTEX_ARRAY, gl.GL_NORMAL_ARRAY, gl.GL_COLOR_ARRAY)
        for kind in kinds:
            gl.glEnableClientState(kind)
        start = corners.ctypes.data
        gl.glVertexPointer(3, gl.GL_FLOAT, stride, ctypes.c_void_p(start))
        gl.glNormalPointer(gl.GL_FLOAT, stride, ctypes.c_void_p(start + 12))
        gl.glColorPointer(4, gl.GL_FLOAT, stride, ctypes.c_void_p(start + 24))
        gl.glDrawArrays(gl.GL_TRIANGLES, 0, len(corners))
        for kind in kinds:
            gl.glDisableClientState(kind)


class _Made:
    """A batch in OpenGL: its first list, the ball around it in its own frame, how round it is."""

    def __init__(self, first: int, middle: Array, radius: float, roundest: float) -> None:
        self.first, self.middle, self.radius, self.roundest = first, middle, radius, roundest


class Drawing:
    """Fills the scene of one stage."""

    def __init__(self, stage: Stage, lists: Lists, base: int) -> None:
        """Make batches of a stage; `base` is the first height field's list of the renderer."""
        model = stage.model
        found = batches(model, stage.groups)
        made = lists.of(model, found)
        merged = np.array([geom for batch in found for geom in batch.geoms], np.intp)
        self._leaders = np.array([batch.leader for batch in found], np.intp)
        self._types = model.geom_type.copy()
        self._data = model.geom_dataid.copy()
        self._first = np.array([one.first - base for one in made], np.int32)
        if (self._first < 0).any():
            raise RuntimeError("OpenGL numbers its lists in an unknown way")
        self._round = np.array([one.roundest for one in made])
        # Of every geom that is drawn for itself or for its batch: the ball around it.
        rest = np.setdiff1d(np.arange(model.ngeom), merged)
        self._drawn = np.concatenate([self._leaders, rest])
        middles = [one.middle for one in made]
        self._middles = np.vstack([*middles, np.zeros((len(rest), 3))])
        self._radii = np.append([one.radius for one in made], model.geom_rbound[rest])
        kinds = model.geom_type[self._drawn]
        self._radii[kinds == int(mujoco.mjtGeom.mjGEOM_PLANE)] = np.inf
        self._planes = self._leaders[kinds[: len(found)] == int(mujoco.mjtGeom.mjGEOM_PLANE)]
        self._stage = stage
        self._option = mujoco.MjvOption()

    def everything(self, scene: mujoco.MjvScene) -> None:
        """Fill a scene with geoms, each for itself."""
        scene.ngeom = 0
        stage = self._stage
        mujoco.mjv_addGeoms(stage.model, stage.data, self._option, _NO_HAND, _EVERYTHING, scene)

    def seen(self, scene: mujoco.MjvScene, eye: Eye, *, cull: bool) -> None:
        """Fill a scene with batches and with geoms that are in none.

        cull: leave out what is out of an eye's sight.
        """
        model = self._stage.model
        ahead, sight = self._distances(eye)
        groups = model.geom_group.copy()
        shown = groups[self._drawn] <= 2
        if cull:
            shown &= sight
        number = len(self._leaders)
        pixels = self._round * (eye.width / 2.0 / eye.slope)
        coarse = pixels < COARSE_PIXELS * (ahead - self._radii)[:number]
        model.geom_group[:] = HIDDEN_GROUP
        model.geom_group[self._drawn[shown]] = 0
        model.geom_type[self._leaders] = mujoco.mjtGeom.mjGEOM_HFIELD
        model.geom_dataid[self._leaders] = self._first + coarse
        if self._below(eye):
            model.geom_type[self._planes] = mujoco.mjtGeom.mjGEOM_PLANE
        try:
            self.everything(scene)
        finally:
            model.geom_group[:], model.geom_type[:] = groups, self._types
            model.geom_dataid[:] = self._data

    def _below(self, eye: Eye) -> bool:
        """Whether an eye sees a plane from behind, through which MuJoCo lets it see."""
        data, planes = self._stage.data, self._planes
        away = np.asarray(eye.pose.position) - data.geom_xpos[planes]
        return bool((np.einsum("ij,ij->i", away, data.geom_xmat[planes, 2::3]) < 0.0).any())

    def _distances(self, eye: Eye) -> tuple[Array, NDArray[np.bool_]]:
        """Metres ahead of the eye of all that is drawn, and whether it may be seen."""
        data, chosen = self._stage.data, self._drawn
        turns = data.geom_xmat[chosen].reshape(-1, 3, 3)
        centres = data.geom_xpos[chosen] + np.einsum("nij,nj->ni", turns, self._middles)
        places = (centres - eye.pose.position) @ eye.pose.matrix()
        ahead, radii = places[:, 0], self._radii
        sight = ahead > NEAR - radii
        slope = eye.slope
        for aside, tangent in (
            (places[:, 1], slope),
            (places[:, 2], slope * eye.height / eye.width),
        ):
            sight &= np.abs(aside) - tangent * ahead < math.hypot(1.0, tangent) * radii
        return ahead, sight
