"""From where a film looks. Places are in MuJoCo's frame: x forward, y left, z up; m, s, rad."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from usarsim_client.scene import SceneReader
from usarsim_operator.film.story import Moment, Survey
from usarsim_server.cameras.view import Eye, looking
from usarsim_server.simulation.frames import Pose, pose_of

FOV = math.radians(65.0)
"""Horizontal field of view of all but the views of the scene."""
_TURN = 40.0  # s of film in which an orbit goes round once
_LAG = 0.4  # s of film that a following eye turns later
_BEHIND, _ABOVE = 2.0, 1.1  # m
_WALL = 0.15  # m that it keeps from walls
_AHEAD = Pose((0.25, 0.0, 0.3))  # of robots that do not tell where their lamp is


Free = Callable[[NDArray[np.float64], NDArray[np.float64]], float]
"""m from a place in a direction (unit vector) to the next wall; infinity without one."""


class View(Protocol):
    """Where the eye is, frame by frame."""

    def eye(self, moment: Moment, shown: float, free: Free) -> Eye:
        """The eye at a moment; `shown`: s of film before it."""


class Fixed:
    """From one place to another."""

    def __init__(self, place: Sequence[float], target: Sequence[float], size: tuple[int, int]):
        """Places in m; size: pixels.

        Raises:
            ValueError: if the two places are one.
        """
        pose = looking(_vector(place), _vector(target))
        self._eye = Eye(pose, FOV, *size)

    def eye(self, moment: Moment, shown: float, free: Free) -> Eye:
        """Always the same."""
        return self._eye


class Orbit:
    """Around all places where robots were, once in 40 s."""

    def __init__(self, survey: Survey, size: tuple[int, int]) -> None:
        known = np.isfinite(survey.lower).all()
        self._middle = (survey.lower + survey.upper) / 2.0 if known else np.zeros(3)
        wide = float(np.linalg.norm((survey.upper - survey.lower)[:2])) if known else 4.0
        self._far, self._size = 2.6 + 0.75 * wide, size

    def eye(self, moment: Moment, shown: float, free: Free) -> Eye:
        """Goes round by the time of the film, whatever its speed."""
        angle = math.tau * shown / _TURN - math.pi * 0.75
        aside = (math.cos(angle), math.sin(angle), 0.9)
        place = self._middle + self._far * np.array(aside)
        return Eye(looking(_vector(place), _vector(self._middle)), FOV, *self._size)


class Top:
    """The whole world from above, x up in the picture."""

    def __init__(self, survey: Survey, size: tuple[int, int]) -> None:
        self._eyes = []
        for chapter in survey.chapters:
            views = {view["name"]: view for view in chapter.scene["views"]}
            found = views["top"]
            # Its field of view is that of a picture of 4:3; all of its height has to be seen.
            wide = math.tan(found["fov"] / 2.0) * max(1.0, (size[0] / size[1]) / (4.0 / 3.0))
            pose = Pose(_vector(found["pos"]), tuple(found["quat"]))
            self._eyes.append(Eye(pose, 2.0 * math.atan(wide), *size))

    def eye(self, moment: Moment, shown: float, free: Free) -> Eye:
        """That of the world which there is."""
        return self._eyes[moment.chapter]


class Follow:
    """From behind a robot and above it, turning a little later; held where it is gone."""

    def __init__(self, robot: str, size: tuple[int, int]) -> None:
        self._robot, self._size = robot, size
        self._at: NDArray[np.float64] | None = None
        self._heading = np.array((1.0, 0.0))
        self._shown = 0.0

    def eye(self, moment: Moment, shown: float, free: Free) -> Eye:
        """Goes after it; moments have to come in their order."""
        thing = moment.robot(self._robot)
        if thing is not None:
            pose = pose_of(moment.rows[thing.first, :3], moment.rows[thing.first, 3:])
            place, ahead = np.array(pose.position), np.array(pose.matrix()[:2, 0])
            near = 1.0 - math.exp(-(shown - self._shown) / _LAG)
            if self._at is None or float(np.linalg.norm(place - self._at)) > 3.0:
                near = 1.0
            self._at = place
            self._heading = self._heading + near * (ahead - self._heading)
        self._shown = shown
        at = np.zeros(3) if self._at is None else self._at
        ahead = self._heading / max(1e-6, float(np.linalg.norm(self._heading)))
        over = np.add(at, (0.0, 0.0, 0.4))
        back = np.array((*(-_BEHIND * ahead), _ABOVE - 0.4))
        far = float(np.linalg.norm(back))
        eye = over + back / far * max(0.3, min(far, free(over, back / far) - _WALL))
        target = np.add(at, (*(0.5 * ahead), 0.2))
        return Eye(looking(_vector(eye), _vector(target)), FOV, *self._size)


class First:
    """What a robot would see from its front, level with its lamp; held where it is gone."""

    def __init__(self, robot: str, looks: SceneReader, size: tuple[int, int]) -> None:
        self._robot, self._looks, self._size = robot, looks, size
        self._pose = Pose((0.0, 0.0, 0.5))

    def eye(self, moment: Moment, shown: float, free: Free) -> Eye:
        """Moves and tilts with it."""
        thing = moment.robot(self._robot)
        if thing is not None:
            body = pose_of(moment.rows[thing.first, :3], moment.rows[thing.first, 3:])
            self._pose = body @ lamp_of(self._looks, thing.kind)
        return Eye(self._pose, FOV, *self._size)


def lamp_of(looks: SceneReader, kind: str) -> Pose:
    """Where things of a kind have their lamp, in the frame of their first body."""
    lamp = looks.kinds[kind].get("lamp")
    if lamp is None:
        return _AHEAD
    place = _vector(lamp.get("pos", (0.0, 0.0, 0.0)))
    return Pose(place, tuple(lamp.get("quat", (1.0, 0.0, 0.0, 0.0))))


def _vector(values: Sequence[float] | NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = (float(one) for one in values)
    return x, y, z
