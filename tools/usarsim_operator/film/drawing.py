"""Frames of a film, one after the other: drawn of the world, or as a camera took them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np

from usarsim_operator.film import story
from usarsim_operator.film.model import Posed
from usarsim_operator.film.smoke import air_of
from usarsim_operator.film.story import Moment, Survey
from usarsim_operator.film.views import View, lamp_of
from usarsim_operator.recording import Recording
from usarsim_report.films import Frame
from usarsim_server.cameras.backend import (
    Backend,
    Quality,
    platforms_to_try,
    usable_platform,
)
from usarsim_server.cameras.gl import GlBackend
from usarsim_server.cameras.looks import brightness
from usarsim_server.cameras.painter import finished
from usarsim_server.cameras.raytraced import RayBackend
from usarsim_server.simulation.frames import Pose, pose_of

_SAMPLES = 4


def drawn(
    recording: Recording, survey: Survey, view: View, times: Iterator[tuple[float, float]]
) -> Iterator[Frame]:
    """Pictures of the world.

    Args:
        recording: of what. survey: what is in it. view: from where.
        times: s of film and of simulated time of each, growing.
    """
    artist = Artist(survey)
    try:
        moments = story.moments(recording)
        before = after = next(moments)
        for shown, time in times:
            while after.time <= time:
                before = after
                following = next(moments, None)
                if following is None:
                    break
                after = following
            yield artist.draw(story.between(before, after, time), view, shown)
    finally:
        artist.close()


def taken(
    recording: Recording, robot: str, size: tuple[int, int], times: Iterator[tuple[float, float]]
) -> Iterator[Frame]:
    """Pictures of a robot's camera; before the first there is that one, too."""
    pictures = story.pictures(recording, robot)
    before = after = next(pictures)
    frame: Frame | None = None
    for _, time in times:
        while after[0] <= time:
            before, frame = after, None
            following = next(pictures, None)
            if following is None:
                break
            after = following
        if frame is None:
            frame = _fitted(before[1], size)
        yield frame


def _fitted(jpeg: bytes, size: tuple[int, int]) -> Frame:
    """A picture in the middle of a frame, as large as there is room."""
    frame: Frame = np.zeros((size[1], size[0], 3), np.uint8)
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    if picture is None:
        return frame
    scale = min(size[0] / picture.shape[1], size[1] / picture.shape[0])
    width, height = (max(1, round(scale * one)) for one in picture.shape[1::-1])
    method = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    x, y = (size[0] - width) // 2, (size[1] - height) // 2
    frame[y : y + height, x : x + width] = cv2.resize(picture, (width, height), None, 0, 0, method)
    return frame


class Artist:
    """Draws moments with what draws pictures of the server, too."""

    def __init__(self, survey: Survey) -> None:
        self._survey = survey
        self._backend = _open()
        self._stage: Posed | None = None
        self._air, self._light = air_of({}), 1.0

    def draw(self, moment: Moment, view: View, shown: float) -> Frame:
        """A frame; the caller's own."""
        stage = self._show(moment)
        eye = view.eye(moment, shown, stage.free)
        lamps = self._lamps(moment)
        colors = finished(self._backend, stage, eye, lamps, self._air, moment.time, self._light)
        return np.ascontiguousarray(colors[..., ::-1])

    def _show(self, moment: Moment) -> Any:  # a stage of its own: see `Posed`
        if self._stage is None or self._stage.generation != moment.chapter:
            chapter = self._survey.chapters[moment.chapter]
            self._stage = Posed(moment.chapter, chapter, self._survey.reader)
            self._air = air_of(chapter.scene.get("smoke", {}))
            self._light = brightness(self._stage.model)
        self._stage.show(moment)
        return self._stage

    def _lamps(self, moment: Moment) -> list[Pose]:
        rows = moment.rows
        return [
            pose_of(rows[one.first, :3], rows[one.first, 3:])
            @ lamp_of(self._survey.reader, one.kind)
            for one in moment.present.things
            if one.lit
        ]

    def close(self) -> None:
        """Give back what draws."""
        self._backend.close()


def _open() -> Backend:
    platform = usable_platform(platforms_to_try("auto"))
    if platform is not None:
        try:
            return GlBackend(platform, Quality(multisample=_SAMPLES))
        except RuntimeError:
            pass
    return RayBackend()
