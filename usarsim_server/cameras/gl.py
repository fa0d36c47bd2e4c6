"""Rendering with MuJoCo's own OpenGL renderer, without a screen (EGL or OSMesa).

Measured on llvmpipe (two cores, 320x240, 22 000 triangles): MuJoCo's defaults, a shadow map of 4096
and four samples per pixel, 115 ms; without either, 6.7 ms; coarser round shapes halve what is left.
So that is what one gets unless one asks for more, and what `drawing.py` does halves it again.
"""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.cameras.backend import NEAR, SKY, Quality, Shot, Wanted, far_plane
from usarsim_server.cameras.drawing import Drawing, Lists
from usarsim_server.cameras.posed_model import Stage
from usarsim_server.cameras.view import Eye

SIZES_KEPT = 4
"""Sizes of pictures for which arrays are kept."""
SLICES, STACKS, QUADS = 12, 6, 1
"""How finely round shapes are drawn, and flat ones divided."""
_FLAGS = mujoco.mjtRndFlag


class GlBackend:
    """One OpenGL context; made, used and closed by one thread."""

    def __init__(self, platform: str, quality: Quality) -> None:
        """Open a context of `egl` or `osmesa`, known to work (see `backend.works`).

        Raises:
            RuntimeError: if it cannot be opened after all.
        """
        self.name = platform
        self._quality = quality
        try:
            # Not by `mujoco.gl_context`, whose platform is fixed when mujoco is imported.
            module = importlib.import_module(f"mujoco.{platform}")
            self._gl: Any = module.GLContext(16, 16)
            self._gl.make_current()
        except Exception as error:  # PyOpenGL fails in many ways
            raise RuntimeError(f"{platform} cannot be used: {error}") from error
        self._stage: Stage | None = None
        self._renderer: mujoco.MjrContext | None = None
        self._assets: tuple[object, ...] = ()
        self._lists = Lists(SLICES, STACKS)
        self._size = (0, 0)
        self._buffers: dict[tuple[int, int], _Buffers] = {}

    def render(self, stage: Stage, eye: Eye, wanted: Wanted) -> Shot:
        """What an eye sees of a stage as it is now (see `Backend`)."""
        self._gl.make_current()  # another backend of this thread may have been at work
        self._prepare(stage, eye)
        assert self._renderer is not None
        buffers = self._buffers_of(eye)
        self._aim(stage, eye)
        if wanted.exact or wanted.geoms:
            self._drawing.everything(self._scene)
        else:
            self._drawing.seen(self._scene, eye, cull=not self._quality.shadows)
        area = mujoco.MjrRect(0, 0, eye.width, eye.height)
        with self._below_cut(eye):
            mujoco.mjr_render(area, self._scene, self._renderer)
            raw = buffers.raw_depth if wanted.depth else None
            mujoco.mjr_readPixels(buffers.colors, raw, area, self._renderer)
            depth = self._metres(stage, buffers) if wanted.depth else None
            albedo = self._albedo(area, buffers) if wanted.albedo else None
            geoms = self._geoms(area, buffers) if wanted.geoms else None
        return Shot(buffers.colors[::-1], depth, albedo, geoms)

    @property
    def drawn(self) -> int:
        """Geoms and batches of the picture made last, in sight as far as one can tell."""
        return int(self._scene.ngeom)

    def _buffers_of(self, eye: Eye) -> _Buffers:
        size = eye.width, eye.height
        if size not in self._buffers:
            if len(self._buffers) >= SIZES_KEPT:
                self._buffers.clear()
            self._buffers[size] = _Buffers(eye)
        buffers = self._buffers[size]
        buffers.eye = eye
        return buffers

    def close(self) -> None:
        """Free everything; a second call does nothing."""
        if self._gl is None:
            return
        self._gl.make_current()
        if self._renderer is not None:
            self._renderer.free()
            self._renderer = None
        self._gl.free()
        self._gl = None

    @contextlib.contextmanager
    def _below_cut(self, eye: Eye) -> Iterator[None]:
        """Have OpenGL draw nothing above the cut of an eye meanwhile.

        Without shadows: what is cut off would still throw some, and maps of shadows are drawn from
        another eye, for which the plane is a wrong one.
        """
        if not eye.cuts:
            yield
            return
        gl = importlib.import_module("OpenGL.GL")
        ahead, left, up = eye.pose.matrix()[2]
        # In the frame of OpenGL's eye: x to the right, y up, z back.
        plane = (left, -up, ahead, eye.cut - eye.pose.position[2])
        shadows = self._scene.flags[_FLAGS.mjRND_SHADOW]
        self._scene.flags[_FLAGS.mjRND_SHADOW] = 0
        gl.glMatrixMode(gl.GL_MODELVIEW)
        gl.glPushMatrix()
        gl.glLoadIdentity()
        gl.glClipPlane(gl.GL_CLIP_PLANE5, plane)
        gl.glPopMatrix()
        gl.glEnable(gl.GL_CLIP_PLANE5)
        try:
            yield
        finally:
            gl.glDisable(gl.GL_CLIP_PLANE5)
            self._scene.flags[_FLAGS.mjRND_SHADOW] = shadows

    # -- the model ---------------------------------------------------------------------------

    def _prepare(self, stage: Stage, eye: Eye) -> None:
        if stage is not self._stage:
            self._take(stage)
        width, height = (
            max(pair) for pair in zip(self._size, (eye.width, eye.height), strict=True)
        )
        if (width, height) != self._size:
            mujoco.mjr_resizeOffscreen(width, height, self._renderer)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._renderer)
            self._size = (width, height)

    def _take(self, stage: Stage) -> None:
        """Load a model; textures and meshes stay if the new one has the same."""
        model = stage.model
        self._scene = mujoco.MjvScene(model, maxgeom=model.ngeom + 100)
        for flag in (_FLAGS.mjRND_REFLECTION, _FLAGS.mjRND_HAZE, _FLAGS.mjRND_FOG):
            self._scene.flags[flag] = 0
        self._scene.flags[_FLAGS.mjRND_SHADOW] = int(self._quality.shadows > 0)
        drawn = _drawn(model, stage.groups)
        assets = (*_assets(model), drawn.tobytes())
        if self._renderer is None or assets != self._assets:
            self._load(model, drawn)
            self._assets = assets
        assert self._renderer is not None
        self._drawing = Drawing(stage, self._lists, self._renderer.baseHField)
        self._stage = stage

    def _load(self, model: mujoco.MjModel, drawn: NDArray[np.bool_]) -> None:
        self._lists.clear()
        if self._renderer is not None:
            self._renderer.free()
        quality = model.vis.quality
        quality.shadowsize, quality.offsamples = self._quality.shadows, self._quality.multisample
        quality.numslices, quality.numstacks, quality.numquads = SLICES, STACKS, QUADS
        model.vis.global_.offwidth, model.vis.global_.offheight = 16, 16
        self._renderer = _context(model, drawn)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._renderer)
        if self._renderer.currentBuffer != mujoco.mjtFramebuffer.mjFB_OFFSCREEN:
            raise RuntimeError(f"{self.name} has no offscreen buffer")
        self._renderer.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        self._size = (0, 0)

    # -- one picture -------------------------------------------------------------------------

    def _aim(self, stage: Stage, eye: Eye) -> None:
        """Put the camera of the scene at the eye, and the lights into the scene."""
        scene, model = self._scene, stage.model
        turn = eye.pose.matrix()
        half_width = NEAR * eye.slope
        half_height = half_width * eye.height / eye.width
        for camera in scene.camera:  # of the left and of the right eye
            camera.pos, camera.forward, camera.up = eye.pose.position, turn[:, 0], turn[:, 2]
            camera.frustum_center, camera.frustum_width = 0.0, half_width
            camera.frustum_bottom, camera.frustum_top = -half_height, half_height
            camera.frustum_near, camera.frustum_far = NEAR, far_plane(model)
        mujoco.mjv_makeLights(model, stage.data, scene)

    def _metres(self, stage: Stage, buffers: _Buffers) -> NDArray[np.float32]:
        """Metres from the depth buffer, which holds n (f - z) / (z (f - n)), 0 at the far end."""
        near, far = NEAR, far_plane(stage.model)
        depth, raw = buffers.depth, buffers.raw_depth[::-1]
        np.add(raw, np.float32(near / (far - near)), out=depth)
        np.divide(np.float32(near * far / (far - near)), depth, out=depth)
        depth[depth > buffers.sky(far)] = np.inf
        return depth

    def _albedo(self, area: mujoco.MjrRect, buffers: _Buffers) -> NDArray[np.uint8]:
        """The same picture in white light from everywhere."""
        scene = self._scene
        scene.nlight = 1
        light = scene.lights[0]
        light.headlight = 1
        light.ambient, light.diffuse, light.specular = (1.0,) * 3, (0.0,) * 3, (0.0,) * 3
        shadow = scene.flags[_FLAGS.mjRND_SHADOW]
        scene.flags[_FLAGS.mjRND_SHADOW] = 0
        mujoco.mjr_render(area, scene, self._renderer)
        mujoco.mjr_readPixels(buffers.albedo, None, area, self._renderer)
        scene.flags[_FLAGS.mjRND_SHADOW] = shadow
        return buffers.albedo[::-1]

    def _geoms(self, area: mujoco.MjrRect, buffers: _Buffers) -> NDArray[np.int32]:
        """Geoms by pixel, from a picture in which everything has its number for a colour."""
        scene = self._scene
        before = scene.flags.copy()
        scene.flags[_FLAGS.mjRND_SEGMENT] = scene.flags[_FLAGS.mjRND_IDCOLOR] = 1
        colors = np.empty_like(buffers.colors)
        mujoco.mjr_render(area, scene, self._renderer)
        mujoco.mjr_readPixels(colors, None, area, self._renderer)
        scene.flags[:] = before
        numbers = colors[::-1].astype(np.int32) @ np.array([1, 1 << 8, 1 << 16], np.int32)
        geoms = np.full(scene.ngeom + 1, -1, np.int32)
        for one in scene.geoms[: scene.ngeom]:
            if one.segid >= 0 and one.objtype == mujoco.mjtObj.mjOBJ_GEOM:
                geoms[one.segid + 1] = one.objid
        # Where samples of two geoms were mixed after all there may be any number.
        return geoms[np.where(numbers <= scene.ngeom, numbers, 0)]


def _drawn(model: mujoco.MjModel, groups: NDArray[np.signedinteger]) -> NDArray[np.bool_]:
    """Which meshes (nmesh,) are those of a geom that is drawn, by the groups (ngeom,) of all."""
    drawn = np.zeros(model.nmesh, bool)
    meshes = model.geom_dataid[(model.geom_type == int(mujoco.mjtGeom.mjGEOM_MESH)) & (groups <= 2)]
    drawn[meshes[meshes >= 0]] = True
    return drawn


def _context(model: mujoco.MjModel, drawn: NDArray[np.bool_]) -> mujoco.MjrContext:
    """MuJoCo's renderer for a model, textures and all; without meshes that are not drawn.

    While it is made nothing else of the process runs, physics neither: 120 ms for the textures of
    `arena`. They are loaded after it, for others run while one is.
    """
    width, height = model.tex_width.copy(), model.tex_height.copy()
    faces, graphs = model.mesh_facenum.copy(), model.mesh_graphadr.copy()
    model.tex_width[:] = model.tex_height[:] = 1
    model.mesh_facenum[~drawn], model.mesh_graphadr[~drawn] = 0, -1
    try:
        made = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50)
    finally:
        model.tex_width[:], model.tex_height[:] = width, height
        model.mesh_facenum[:], model.mesh_graphadr[:] = faces, graphs
    for texture in range(model.ntex):
        mujoco.mjr_uploadTexture(model, made, texture)
    return made


class _Buffers:
    """Arrays for pictures of one size, bottom row first where OpenGL fills them."""

    def __init__(self, eye: Eye) -> None:
        shape = (eye.height, eye.width)
        self.eye = eye
        self._sky: tuple[float, float, NDArray[np.float32]] | None = None
        self.colors = np.empty((*shape, 3), np.uint8)
        self.albedo = np.empty((*shape, 3), np.uint8)
        self.raw_depth = np.empty(shape, np.float32)
        self.depth = np.empty(shape, np.float32)

    def sky(self, far: float) -> NDArray[np.float32]:
        """Depths (height, width) from which on there is sky."""
        if self._sky is None or self._sky[:2] != (self.eye.fov, far):
            limits = np.float32(SKY * far) / self.eye.rays().lengths()
            self._sky = self.eye.fov, far, limits
        return self._sky[2]


def _assets(model: mujoco.MjModel) -> tuple[object, ...]:
    """What a context holds of a model; two models with equal assets can share it."""
    arrays = (
        *(model.tex_type, model.tex_height, model.tex_width, model.tex_data),
        *(model.mat_texid, model.mat_texuniform, model.mat_texrepeat),
        *(model.mesh_vertnum, model.mesh_facenum, model.mesh_vert, model.mesh_face),
        *(model.hfield_nrow, model.hfield_ncol, model.hfield_size, model.hfield_data),
    )
    return (model.nskin, *(hash(array.tobytes()) for array in arrays))
