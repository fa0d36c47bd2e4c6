"""Where pictures begin (robots reference 2.7 and 5.4, #102)."""

from __future__ import annotations

import numpy as np
import pytest
from camera_fakes import RED_BOX, MakePainter, Yard, is_red

from usarsim_server.cameras.backend import NEAR
from usarsim_server.cameras.view import View, looking

FACE = RED_BOX[0] - 0.5
"""x (m) of the face of the red box that is seen from the origin."""


def red_part(yard: Yard, make_painter: MakePainter, distance: float) -> float:
    """Part of a picture that shows the box, with the eye so far (m) in front of its face."""
    eye = (FACE - distance, 0.0, RED_BOX[2])
    pose = looking(eye, RED_BOX)
    picture = make_painter().picture(View(pose, width=80, height=60), yard.look())
    return float(is_red(np.asarray(picture, np.uint8)).mean())


@pytest.mark.parametrize(
    ("distance", "seen"), [(0.10, False), (0.11, False), (0.13, True), (2 * NEAR, True)]
)
def test_the_near_plane(yard: Yard, make_painter: MakePainter, distance: float, seen: bool) -> None:
    """Nothing nearer than 0.12 m is drawn: a thing at 0.10 m is not there (#102)."""
    assert red_part(yard, make_painter, distance) == pytest.approx(1.0 if seen else 0.0, abs=0.02)
