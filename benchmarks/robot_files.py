"""Robot classes that the measurements write for themselves: variants of the shipped one, in a
folder that exists only while they are measured."""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from usarsim_bench.crowd import DEFAULT_CLASS

SCOUT, CAMERA_SCOUT, SURVEYOR = "BenchScout", "BenchCameraScout", "BenchSurveyor"
"""Classes: what a lab's robot usually carries; the same with a camera; nothing but four cameras."""

BEAMS = 181
LASER_NAME, LASER_PERIOD = "lms200", 0.1
"""The scanner of a scout; s between its scans."""
CAMERA_RATE = 5.0
"""Pictures per simulated second of the camera of a camera scout."""
SURVEYOR_CAMERAS = 4

SCOUT_SENSORS = (
    f"a SICK of {BEAMS} beams at {1.0 / LASER_PERIOD:g} Hz, 8 sonars, odometry, INS, ground truth"
)

_DROPPED = ("TachTest", "W1", "W2", "battery")
"""What the shipped class carries besides."""
_KEPT = ("GndTruth", "InsTest", LASER_NAME, "Odometer")
_CAMERA = "Camera"
_LASER = (
    f'{{ type = "SICK", name = "{LASER_NAME}", position = [0.2085, 0, -0.2], '
    f"interval = {LASER_PERIOD:g} }}"
)
_PLACE = "position = [0.1005, 0, -0.42]"
_HALF_RING = (
    (0.147, 0.136, 90.0),
    (0.193, 0.119, 50.0),
    (0.227, 0.079, 30.0),
    (0.245, 0.027, 10.0),
)
"""Sonars of one side of the front ring of the real machine: x, |y|, m; |heading|, degrees."""


def sonars() -> list[str]:
    """Tables of the front ring, F1 to F8."""
    left = [(x, -y, -heading) for x, y, heading in _HALF_RING]
    ring = [*left, *((x, -y, -heading) for x, y, heading in reversed(left))]
    return [
        f'{{ type = "Sonar", name = "F{number}", position = [{x}, {y}, -0.06], '
        f"rotation = [0, 0, {math.radians(heading):.6f}] }}"
        for number, (x, y, heading) in enumerate(ring, start=1)
    ]


def write_class(
    folder: Path,
    name: str,
    *,
    without: Sequence[str] = (),
    sensors: Iterable[str] = (),
    cameras: Iterable[str] = (),
) -> None:
    """Write a robot file that extends the shipped class.

    Args:
        folder: where to.
        name: of the class.
        without: names of inherited sensors and cameras that are dropped.
        sensors, cameras: inline tables of TOML; those with inherited names replace them.
    """
    lines = [f'extends = "{DEFAULT_CLASS}"']
    if without:
        lines.append(f"without = {json.dumps(list(without))}")
    for key, tables in (("sensor", sensors), ("camera", cameras)):
        rows = [f"    {one},\n" for one in tables]
        if rows:
            lines.append(f"{key} = [\n{''.join(rows)}]")
    (folder / f"{name}.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_scouts(folder: Path) -> None:
    """Write the files of `SCOUT`, `CAMERA_SCOUT` and `SURVEYOR` into a folder."""
    write_class(folder, SCOUT, without=(*_DROPPED, _CAMERA), sensors=[_LASER, *sonars()])
    camera = f'{{ name = "{_CAMERA}", {_PLACE}, rate = {CAMERA_RATE:g} }}'
    write_class(
        folder, CAMERA_SCOUT, without=_DROPPED, sensors=[_LASER, *sonars()], cameras=[camera]
    )
    around = [
        f'{{ name = "View{number}", {_PLACE}, rotation = [0, 0, {turn:.4f}] }}'
        for number in range(SURVEYOR_CAMERAS)
        for turn in (2.0 * math.pi / SURVEYOR_CAMERAS * number,)
    ]
    write_class(folder, SURVEYOR, without=(*_DROPPED, *_KEPT, _CAMERA), cameras=around)


@contextmanager
def scouts() -> Iterator[tuple[str, str]]:
    """The words of the command line by which a server knows these classes, while inside."""
    with tempfile.TemporaryDirectory(prefix="usarsim-bench-") as name:
        write_scouts(Path(name))
        yield "--robots", name
