"""Makes finished pictures: geometry from a backend, light and smoke on top; one thread's own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.logs import Log
from usarsim_server.cameras.backend import (
    INSTALL,
    Backend,
    Quality,
    Wanted,
    platforms_to_try,
    usable_platform,
    works,
)
from usarsim_server.cameras.cutaway import CUT_COLOR, Caps
from usarsim_server.cameras.gl import GlBackend
from usarsim_server.cameras.looks import Air, brightness, reaching, shine
from usarsim_server.cameras.posed_model import Stage
from usarsim_server.cameras.raytraced import RayBackend
from usarsim_server.cameras.view import CameraView, Eye, View
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.model import CompiledWorld
from usarsim_server.simulation.snapshot import Snapshot
from usarsim_server.worlds.description import Smoke

RENDERERS = ("auto", "egl", "osmesa", "rays")

_log = Log("cameras")


@dataclass(frozen=True, slots=True)
class PainterOptions:
    """How pictures are made."""

    renderer: str = "auto"  # one of `RENDERERS`
    quality: Quality = field(default_factory=Quality)  # see there
    smoke: Smoke = field(default_factory=Smoke)  # of the world


def nobody_lit(robot: int) -> bool:
    """No robot has its light on."""
    return False


class Painter:
    """Makes pictures of snapshots; must be used and closed by the thread that made it."""

    def __init__(
        self,
        compiled: Callable[[Snapshot], CompiledWorld],
        options: PainterOptions,
        lit: Callable[[int], bool] = nobody_lit,
    ) -> None:
        """Open a backend.

        `compiled` knows the model that a snapshot belongs to, `lit` whether a robot, by its number,
        has its headlight on.
        """
        self._compiled = compiled
        self._options = options
        self._lit = lit
        self._air = Air(options.smoke)
        self._backend = _open(options)
        self._stage: Stage | None = None
        self._light = 1.0

    @property
    def renderer(self) -> str:
        """What draws: `egl`, `osmesa` or `rays`."""
        return self._backend.name

    @property
    def generation(self) -> int | None:
        """Of the model that it holds; None if it has painted nothing so far."""
        return None if self._stage is None else self._stage.generation

    def place(self, view: CameraView, snapshot: Snapshot, width: int, height: int) -> Eye | None:
        """The eye of a camera in a snapshot; None if its robot is not there."""
        pose = self._show(snapshot).place(view)
        return None if pose is None else Eye(pose, view.fov, width, height)

    def tile(self, eye: Eye, snapshot: Snapshot) -> NDArray[np.uint8]:
        """What an eye sees, (height, width, 3), finished; valid until the next picture."""
        stage = self._show(snapshot)
        lamps = stage.lamps(self._lit)
        return finished(self._backend, stage, eye, lamps, self._air, snapshot.time, self._light)

    def picture(self, view: View, snapshot: Snapshot) -> NDArray[np.generic]:
        """A picture in the mode of a view (see `View`); the caller's own."""
        eye = Eye(view.pose, view.fov, view.width, view.height, view.cut)
        if view.mode == "rgb":
            colors = self.tile(eye, snapshot).copy()
            colors[self._cut(eye)[1] >= 0] = np.rint(255.0 * CUT_COLOR).astype(np.uint8)
            return colors
        depth = view.mode == "depth"
        wanted = Wanted(depth=depth, geoms=not depth, exact=True)
        shot = self._backend.render(self._show(snapshot), eye, wanted)
        answer = shot.depth if depth else shot.geoms
        assert answer is not None
        answer = answer.copy()
        ways, geoms = self._cut(eye)
        answer[geoms >= 0] = ways[geoms >= 0] if depth else geoms[geoms >= 0]
        return answer

    def _cut(self, eye: Eye) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        """Depths (height, width), m, and geoms of what an eye's cut goes through, of the stage
        shown last; infinity and -1 elsewhere."""
        shape = (eye.height, eye.width)
        if not eye.cuts:
            return np.full(shape, np.inf), np.full(shape, -1, dtype=np.intp)
        stage = self._stage
        assert stage is not None
        caps = Caps(stage.model, stage.data, eye.cut)
        directions = eye.rays().directions(eye.pose.matrix()).reshape(-1, 3)
        ways, geoms = caps.seen(np.array(eye.pose.position), directions.astype(float))
        return ways.reshape(shape), geoms.reshape(shape)

    def fall_back(self, error: Exception) -> None:
        """Go on with rays after the backend failed.

        Raises:
            Exception: the error itself, if rays are what failed.
        """
        if isinstance(self._backend, RayBackend):
            raise error
        _log.error("the renderer failed, rays take over", renderer=self.renderer, error=error)
        self._backend.close()
        self._backend = RayBackend()

    def close(self) -> None:
        """Give back what the backend holds."""
        self._backend.close()

    def _show(self, snapshot: Snapshot) -> Stage:
        stage = self._stage
        if stage is None or stage.generation != snapshot.generation:
            stage = self._stage = Stage(self._compiled(snapshot))
            self._light = brightness(stage.model)
        stage.show(snapshot)
        return stage


def finished(
    backend: Backend,
    stage: Stage,
    eye: Eye,
    lamps: Sequence[Pose],
    air: Air,
    time: float,
    light: float,
) -> NDArray[np.uint8]:
    """What an eye sees, (height, width, 3), red first; valid until the backend's next picture.

    Args:
        backend: what draws. stage: what is there. eye: from where.
        lamps: headlights that are lit. air: smoke and haze.
        time: simulated s, which moves the smoke. light: `brightness` of the stage.
    """
    near, hazy = reaching(lamps, eye), not air.clear
    shot = backend.render(stage, eye, Wanted(depth=hazy or bool(near), albedo=bool(near)))
    colors = shot.colors
    if near:
        assert shot.depth is not None
        assert shot.albedo is not None
        colors = shine(colors, shot.albedo, shot.depth, eye, near)
    if hazy:
        assert shot.depth is not None
        colors = air.veil(colors, shot.depth, eye, time, light)
    return colors


def check_renderer(renderer: str) -> None:
    """Make sure that a renderer asked for by name works here.

    Raises:
        UsarsimError: if it does not.
    """
    wanted = platforms_to_try(renderer)
    if renderer != "auto" and wanted and usable_platform(wanted) is None:
        raise UsarsimError(
            f"--renderer: {renderer} does not work on this machine: {works(renderer)} "
            f"(cure: {INSTALL[renderer]}, or write auto)"
        )


def _open(options: PainterOptions) -> Backend:
    """The best backend that works here."""
    platform = usable_platform(platforms_to_try(options.renderer))
    if platform is not None:
        try:
            return GlBackend(platform, options.quality)
        except RuntimeError as error:
            _log.warning("OpenGL failed after all, rays take over", error=error)
    return RayBackend()
