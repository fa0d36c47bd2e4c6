"""What checks find out from many samples: the slope of a horizon, how late reports are."""

from __future__ import annotations

import math

import numpy as np
import pytest

from usarsim_conformance.approach import Approach, Way
from usarsim_conformance.checks.cameras import horizon
from usarsim_conformance.excursions import Equipment, Track
from usarsim_conformance.grounds import YAW
from usarsim_conformance.lines import Line
from usarsim_conformance.places import Place


def _picture(slope: float) -> np.ndarray:
    rows, columns = np.mgrid[0:240, 0:320]
    ground = rows > 120 + slope * (columns - 160)
    picture = np.where(ground[..., None], (165, 170, 175), (230, 240, 250)).astype(np.uint8)
    picture[180:, 200:230] = (255, 0, 0)  # a cube, in some columns
    return picture


@pytest.mark.parametrize("slope", [0.0, 0.14, -0.3])
def test_slope_of_a_horizon(slope: float) -> None:
    """Whatever else has edges in some columns."""
    assert horizon(_picture(slope)) == pytest.approx(slope, abs=0.01)


def test_a_picture_without_a_horizon_has_no_slope() -> None:
    """Neither of one colour nor of a gradient."""
    assert math.isnan(horizon(np.full((240, 320, 3), 90, np.uint8)))
    gradient = np.repeat(np.linspace(0, 255, 240), 320).reshape(240, 320, 1)
    assert math.isnan(horizon(np.repeat(gradient, 3, axis=2).astype(np.uint8)))


def _driven(late: float, speed: float) -> Way:
    """A way whose GroundTruth is late by so much, cut off at two digits, and listed exactly."""

    def place(time: float) -> tuple[float, float]:
        way = 1.0 + speed * (time - 10.0)
        return 500.0 + way * math.cos(YAW), 300.0 + way * math.sin(YAW)

    lines = []
    for tick in range(100):
        time = 10.0 + 0.05 * tick
        x, y = (math.floor(100.0 * value) / 100.0 for value in place(time - late))
        lines.append(
            Line(
                f"SEN {{Time {time:.4f}}} {{Type GroundTruth}} {{Name G}}"
                f" {{Location {x:.2f},{y:.2f},-0.20}} {{Orientation 0,0,0.6}}\r\n".encode()
            )
        )
    way = Way(speed, Track(lines))
    base = Approach(Equipment("P2AT"), Place(None, (500.0, 300.0, 0.0)), math.inf)
    way.seen = [(time, base.along(place(time))) for time in np.arange(10.3, 14.5, 0.21)]
    return way


@pytest.mark.parametrize("late", [0.0, 0.02, 0.2, -0.1])
def test_lateness_of_ground_truth(late: float) -> None:
    """Whatever is cut off; both ways together tell it."""
    found = Approach(Equipment("P2AT"), Place(None, (500.0, 300.0, 0.0)), math.inf)
    found.ways = [_driven(late, 0.6), _driven(late, -0.6)]
    seconds, error, looks = found.lateness()
    assert seconds == pytest.approx(late, abs=0.004)
    assert error < 0.002
    assert looks == 40


def test_few_looks_tell_no_time() -> None:
    """Nor does a robot that stands."""
    found = Approach(Equipment("P2AT"), Place(None, (500.0, 300.0, 0.0)), math.inf)
    assert math.isnan(found.lateness()[0])
    found.ways = [_driven(0.0, 0.0)]
    assert math.isnan(found.lateness()[0])
