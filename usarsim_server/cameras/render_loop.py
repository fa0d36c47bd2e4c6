"""The render loop: one thread that renders what somebody looks at, and publishes it as frames.

Nothing here waits for a reader, and no reader for anything here: tiles that somebody watches are
rendered at most so many times a second of simulated time, the one that has waited longest first,
and every new frame is a value of its own. The physics is asked for a snapshot before each round and
goes on meanwhile.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any, Protocol

from numpy.typing import NDArray

from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.logs import Log
from usarsim_server.cameras.board import CameraBoard
from usarsim_server.cameras.painter import Painter, PainterOptions, check_renderer, nobody_lit
from usarsim_server.cameras.view import CameraView, Frame, Grid, Region, View, Watch
from usarsim_server.cameras.watching import Atlas, Watches
from usarsim_server.simulation.frames import IDENTITY
from usarsim_server.simulation.growth import trim
from usarsim_server.simulation.model import CompiledWorld
from usarsim_server.simulation.snapshot import Snapshot

_log = Log("cameras")

ROUND = 0.015
"""s of wall time after which a round is published although other tiles are due, too."""
IDLE_POLL = 0.05
"""s of wall time between two looks at cameras that may have come or gone."""
IDLE_REFRESH = 10.0
"""s of wall time between two looks, while no tile is watched, whether there is another model."""
IDLE_CLOSE = 30.0
"""s of wall time without a watched tile or a wanted picture after which the renderer is closed; the
next picture opens it again. Measured on llvmpipe: closing gives back 95 MiB and a thread, opening
takes 0.2 s of processor time once its libraries are loaded."""
SHORTEST_WAIT = 0.002
PICTURE_TIMEOUT = 60.0
"""s of wall time that a single picture may take, a first one on a cold machine included."""
STOP_TIMEOUT = 3.0


_ANYTHING = View(IDENTITY, width=16, height=16)


class WorldSource(Protocol):
    """What the render loop needs of the simulation."""

    @property
    def speed(self) -> float:
        """Simulated seconds per wall second asked for; infinity in lockstep."""

    def look(self) -> Snapshot:
        """A picture of this very moment."""

    def compiled(self, snapshot: Snapshot) -> CompiledWorld:
        """The model that a snapshot belongs to."""


@dataclass(frozen=True, slots=True)
class RenderOptions:
    """How the render loop works."""

    rate: float = 15.0
    """Pictures per simulated second of each camera that has no rate of its own (15 in the original,
    side channels reference 2.6)."""
    always: bool = False  # render all tiles, also those that nobody watches
    painter: PainterOptions = field(default_factory=PainterOptions)  # how pictures are made


@dataclass(frozen=True, slots=True, eq=False)
class _Job:
    """A single picture that somebody waits for."""

    view: View
    snapshot: Snapshot
    answer: Future[NDArray[Any]]


@dataclass(frozen=True, slots=True)
class _Painted:
    """What is in a tile: the camera as it was, and the simulated time that counts as its turn."""

    view: CameraView
    turn: float


class RenderLoop:
    """A `FrameSource`: renders the cameras of a board, and single pictures from anywhere."""

    def __init__(
        self,
        simulation: WorldSource,
        board: CameraBoard,
        options: RenderOptions,
        lit: Callable[[int], bool] = nobody_lit,
    ) -> None:
        """Describe the render loop; its thread starts when somebody looks.

        That thread asks `lit` whether a robot, by its number, has its headlight on.
        """
        self._simulation = simulation
        self._board = board
        self._options = options
        self._lit = lit
        self._atlas = Atlas(board.grid)
        self._wake = threading.Condition()
        self._watches = Watches(board.grid, self._atlas.frame, self._notify)
        self._jobs: deque[_Job] = deque()
        self._stopping = False
        self._thread: threading.Thread | None = None
        self._painted: dict[int, _Painted] = {}
        self._seen = (-math.inf, 0.0)  # simulated time last seen, and when that was
        self._still = 0
        self._complained = False
        self.pictures = 0
        """Tiles rendered so far; for measurements."""

    # -- everybody's side --------------------------------------------------------------------

    @property
    def grid(self) -> Grid:
        """Geometry of the full frame."""
        return self._board.grid

    def newest(self, region: Region) -> Frame | None:
        """See `FrameSource`."""
        frame = self._watches.newest(region, self._keys())
        if frame is None:
            self._notify()
        return frame

    def watch(self, region: Region, on_frame: Callable[[Frame], None]) -> Watch:
        """See `FrameSource`; `on_frame` is told of frames in which something in the region is new
        and nothing in it is missing."""
        watch = self._watches.watch(region, on_frame)
        self._start()
        return watch

    def picture(self, view: View) -> NDArray[Any]:
        """What is to be seen from anywhere at this moment; blocks until it is rendered.

        Returns:
            An array by the view's mode (see `View`).

        Raises:
            UsarsimError: if the world has ended or the picture cannot be made.
        """
        # Not in the rendering thread: the caller may be the one who answers.
        return self.picture_of(view, self._simulation.look())

    def picture_of(self, view: View, snapshot: Snapshot) -> NDArray[Any]:
        """The same for a snapshot that is at hand; equal snapshots give equal pictures.

        Raises:
            UsarsimError: as for `picture`.
        """
        job = _Job(view, snapshot, Future())
        with self._wake:
            if self._stopping:
                raise UsarsimError("there are no more pictures: the server is ending")
            self._jobs.append(job)
            self._wake.notify_all()
        self._start()
        try:
            return job.answer.result(PICTURE_TIMEOUT)
        except TimeoutError:
            raise UsarsimError("the picture took too long") from None

    def open(self) -> None:
        """Make sure that there can be pictures; they begin when somebody looks.

        Opening the renderer takes a second of processor time and some 90 MiB.

        Raises:
            UsarsimError: if the renderer asked for does not work on this machine.
        """
        check_renderer(self._options.painter.renderer)
        if self._options.always:
            self.watch(self.grid.frame, _nobody)

    def close(self) -> None:
        """Stop rendering and wait for the thread; watchers are not told of anything any more."""
        with self._wake:
            self._stopping = True
            self._wake.notify_all()
            thread = self._thread
        if thread is not None:
            thread.join(STOP_TIMEOUT)

    def _start(self) -> None:
        with self._wake:
            if self._thread is None and not self._stopping:
                self._thread = threading.Thread(target=self._run, name="cameras", daemon=True)
                self._thread.start()

    def _notify(self) -> None:
        with self._wake:
            self._wake.notify_all()

    def _keys(self) -> Mapping[int, int]:
        return {view.tile: view.key for view in self._board.views if view.tile is not None}

    # -- the rendering thread ----------------------------------------------------------------

    def _run(self) -> None:
        try:
            while self._wait_until_wanted():
                # In a call of its own: what it holds is gone before free pages are given back.
                self._render_while_wanted()
                trim()
        except UsarsimError as error:
            _log.debug("cameras end", reason=error)  # the physics has ended
        except Exception as error:
            _log.exception("the camera thread died", error)
        finally:
            self._refuse()

    def _render_while_wanted(self) -> None:
        painter = self._open()
        try:
            self._render(painter)
        finally:
            painter.close()

    def _wait_until_wanted(self) -> bool:
        """Wait without a renderer; returns False when the loop is to end."""
        with self._wake:
            self._wake.wait_for(lambda: self._stopping or self._jobs or self._watches.tiles)
            return not self._stopping

    def _open(self) -> Painter:
        """Open the renderer.

        Raises:
            UsarsimError: it cannot be opened; the reason is in the log.
        """
        try:
            painter = Painter(self._simulation.compiled, self._options.painter, self._lit)
        except Exception as error:
            _log.exception("cameras cannot be rendered", error)
            raise UsarsimError("there is no renderer") from error
        _log.info("cameras are rendered", renderer=painter.renderer)
        return painter

    def _render(self, painter: Painter) -> None:
        """Render what is wanted, until the loop stops or nothing was for `IDLE_CLOSE`."""
        last = time.monotonic()
        while not self._stopping:
            self._take_pictures(painter)
            wait = self._turn(painter)
            with self._wake:
                if self._stopping or self._jobs or wait <= 0.0:
                    last = time.monotonic()
                    continue
                called = self._wake.wait(min(wait, IDLE_REFRESH, IDLE_CLOSE))
            if called or not math.isinf(wait):
                last = time.monotonic()
            elif time.monotonic() - last < IDLE_CLOSE:
                self._refresh(painter)
            else:
                return

    def _refresh(self, painter: Painter) -> None:
        """Let go of a model that is out of use, and be ready for the present one."""
        snapshot = self._simulation.look()
        if painter.generation not in (None, snapshot.generation):
            self._try(painter, lambda: painter.picture(_ANYTHING, snapshot))

    def _refuse(self) -> None:
        """Let nobody wait for pictures any more."""
        with self._wake:
            self._stopping = True
            jobs, self._jobs = self._jobs, deque()
        for job in jobs:
            job.answer.set_exception(UsarsimError("there are no more pictures"))

    def _take_pictures(self, painter: Painter) -> None:
        while self._jobs:
            job = self._jobs.popleft()
            try:
                job.answer.set_result(self._picture(painter, job))
            except Exception as error:
                job.answer.set_exception(UsarsimError(f"the picture cannot be made: {error}"))

    def _picture(self, painter: Painter, job: _Job) -> NDArray[Any]:
        return self._try(painter, lambda: painter.picture(job.view, job.snapshot))

    def _turn(self, painter: Painter) -> float:
        """Render what is due; returns s of wall time until there may be more to do."""
        watched, stale = self._watches.tiles, self._watches.stale
        views = {view.tile: view for view in self._board.views if view.tile is not None}
        self._wipe(views)
        wanted = [view for tile, view in views.items() if tile in watched]
        if not wanted:
            self._publish(views)
            return IDLE_POLL if watched else math.inf
        wait = self._wait_for(wanted)
        if wait > 0.0 and stale.isdisjoint(map(_tile, wanted)):
            self._publish(views)
            return min(wait, IDLE_POLL)
        snapshot = self._look()
        due = self._due(wanted, snapshot.time)
        if due:
            self._round(painter, due, snapshot, views)
            return 0.0
        # Somebody has begun to watch what was painted a moment ago.
        self._publish(views, frozenset(map(_tile, wanted)))
        return self._patience()

    def _wipe(self, views: Mapping[int, CameraView]) -> None:
        """Empty the tiles whose cameras are gone."""
        for tile, key in enumerate(self._atlas.shows):
            if key is not None and (tile not in views or views[tile].key != key):
                self._atlas.wipe(tile)
                self._painted.pop(tile, None)

    def _publish(self, views: Mapping[int, CameraView], kept: frozenset[int] = frozenset()) -> None:
        """Hand out what is new, and older pictures that are still up to date."""
        news = self._atlas.publish()
        if news is None and not (kept or self._watches.waiting):
            return
        frame, changed = news or (self._atlas.frame, frozenset())
        keys = {tile: view.key for tile, view in views.items()}
        self._watches.show(frame, self._atlas.shows, changed, keys, kept)

    # -- when --------------------------------------------------------------------------------

    def _turn_of(self, view: CameraView) -> float:
        """Simulated time of a camera's next picture; the dawn of time if it has none as it is."""
        painted = self._painted.get(_tile(view))
        fits = painted is not None and painted.view == view
        return painted.turn if painted is not None and fits else -math.inf

    def _wait_for(self, wanted: list[CameraView]) -> float:
        """s of wall time until the first turn, as far as one can tell without asking."""
        first = min(map(self._turn_of, wanted))
        seen, when = self._seen
        speed = self._simulation.speed
        if math.isinf(first) or math.isinf(speed):
            return 0.0
        return (first - seen) / speed - (time.perf_counter() - when)

    def _look(self) -> Snapshot:
        snapshot = self._simulation.look()
        self._still = self._still + 1 if snapshot.time == self._seen[0] else 0
        self._seen = snapshot.time, time.perf_counter()
        return snapshot

    def _patience(self) -> float:
        """s of wall time until the next look at a world that is late, longer if it stands still."""
        return min(SHORTEST_WAIT * 2.0 ** min(self._still, 10), IDLE_POLL)

    def _due(self, wanted: list[CameraView], now: float) -> list[CameraView]:
        """Cameras whose turn it is, longest wait first, those of one robot together."""
        due = [view for view in wanted if self._turn_of(view) <= now + 1e-6]
        longest: dict[str, float] = {}
        for view in due:
            turn = self._turn_of(view)
            longest[view.owner] = min(longest.get(view.owner, math.inf), turn)
        return sorted(due, key=lambda view: (longest[view.owner], view.owner, _tile(view)))

    # -- what --------------------------------------------------------------------------------

    def _round(
        self,
        painter: Painter,
        due: list[CameraView],
        snapshot: Snapshot,
        views: Mapping[int, CameraView],
    ) -> None:
        """Paint what is due from one snapshot, until it is time to show something.

        The cameras of one robot are never torn apart: a stereo pair sees one instant.
        """
        started = time.perf_counter()
        owner = due[0].owner
        for view in due:
            late = time.perf_counter() - started > ROUND
            if self._stopping or (late and (view.owner != owner or not view.owner)):
                break
            owner = view.owner
            self._paint(painter, view, snapshot)
        self._publish(views)

    def _paint(self, painter: Painter, view: CameraView, snapshot: Snapshot) -> None:
        tile, grid, now = _tile(view), self.grid, snapshot.time
        period = 1.0 / (view.rate or self._options.rate)
        turn = self._turn_of(view)
        # Turns keep their beat, unless the renderer cannot keep up with it.
        following = turn + period if turn + period > now else now + period
        self._painted[tile] = _Painted(view, following)
        try:
            place = grid.region(tile, view.size)
            eye = painter.place(view, snapshot, place.width, place.height)
            if eye is None:
                self._atlas.wipe(tile, view.key)
                return
            picture = self._try(painter, lambda: painter.tile(eye, snapshot))
        except Exception as error:
            self._complain(error)
            self._atlas.wipe(tile, view.key)
            return
        self._atlas.paint(tile, view.key, picture, now)
        self.pictures += 1

    def _try(self, painter: Painter, render: Callable[[], NDArray[Any]]) -> NDArray[Any]:
        """Render; if the machine's OpenGL gives up, go on with rays."""
        try:
            return render()
        except LookupError:
            raise  # a snapshot of a model that nobody remembers
        except Exception as error:
            painter.fall_back(error)
            return render()

    def _complain(self, error: Exception) -> None:
        if not self._complained:
            _log.exception("a picture cannot be made; its tile stays empty", error)
        self._complained = True


def _tile(view: CameraView) -> int:
    assert view.tile is not None, "only cameras with a tile are rendered for frames"
    return view.tile


def _nobody(frame: Frame) -> None:
    """Renders for nobody in particular."""
