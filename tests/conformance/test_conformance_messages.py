"""What the messages of failing verdicts say: the cause, what was seen, and what is right."""

from __future__ import annotations

import ast
import asyncio
import math
import random
import re
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import pytest

import usarsim_conformance
from usarsim_conformance.case import Case
from usarsim_conformance.checks import sensors
from usarsim_conformance.checks.rolling import stepped_rate
from usarsim_conformance.checks.scene import Arrangement, arrangement
from usarsim_conformance.control import Pose
from usarsim_conformance.excursions import Track
from usarsim_conformance.lines import Line
from usarsim_conformance.registry import Failed, Inconclusive

_SIZE = 640, 480
_RED, _BLUE = (429.0, 94.0), (211.0, 214.0)
"""Where the cubes belong in a picture."""

_COMPARES = re.compile(
    r"\b(not|no|neither|missing|below|above|at most|at least|instead of|in truth)\b"
)
_PASSED_ON = ("reason", "str(error)")
"""Messages that are made elsewhere."""


def _messages(tree: ast.AST) -> Iterator[ast.expr]:
    """What a module says when a rule is broken."""
    for call in ast.walk(tree):
        match call:
            case ast.Call(
                func=ast.Attribute(value=ast.Name("case"), attr="expect" | "fail")
                | ast.Name("Failed"),
                args=[*_, message],
            ) if ast.unparse(message) not in _PASSED_ON:
                yield message


def test_messages_tell_what_was_seen_and_what_is_right() -> None:
    """Each has a value in it and a word that compares: what is seen is wrong beside what."""
    count, poor = 0, []
    for path in Path(usarsim_conformance.__file__).parent.rglob("*.py"):
        for message in _messages(ast.parse(path.read_text(encoding="utf-8"))):
            count += 1
            parts = list(ast.walk(message))
            texts = [part.value for part in parts if isinstance(part, ast.Constant)]
            compares = any(_COMPARES.search(text) for text in texts if isinstance(text, str))
            if not compares or not any(isinstance(part, ast.FormattedValue) for part in parts):
                poor.append(f"{path.name}:{message.lineno}: {ast.unparse(message)}")
    assert count > 500
    assert not poor, "\n".join(poor)


@pytest.mark.parametrize("flags", list(product((False, True), repeat=3)))
def test_the_arrangement_of_a_picture_is_told(flags: tuple[bool, bool, bool]) -> None:
    """Exchanged colours are neither a mirrored picture nor one that is turned by half a turn."""
    exchanged, mirrored, inverted = flags
    red, blue = (
        (640.0 - x if mirrored else x, 480.0 - y if inverted else y) for x, y in (_RED, _BLUE)
    )
    seen = (blue, red) if exchanged else (red, blue)
    assert arrangement(seen, (_RED, _BLUE), _SIZE) == Arrangement(*flags)


def _flight(late: float, compass_late: float = 0.0) -> Track:
    """What a robot says that turns and climbs now and then, with a late GroundTruth."""

    def yaw(time: float) -> float:
        return math.sin(0.9 * time) * 0.8

    def height(time: float) -> float:
        return math.cos(0.7 * time)

    lines = []
    for number in range(100):
        now = 0.2 * number
        past = now - late
        for text in (
            f"SEN {{Time {now:.4f}}} {{Type GroundTruth}} {{Name Truth}} "
            f"{{Location 0.00,0.00,{-height(past):.2f}}} {{Orientation 0.00,0.00,{yaw(past):.2f}}}",
            "SEN {Type MagneticCompass} {Name C} "
            f"{{MagneticAngle {yaw(now - compass_late):.4f}}}",
            f"SEN {{Type AltitudeSensor}} {{Name A}} {{relativeAltitude {height(now):.4f}}}",
        ):
            lines.append(Line(f"{text}\r\n".encode()))
    return Track(lines)


@pytest.mark.parametrize("late", [0.0, 0.3, -0.3, 0.5])
def test_a_late_ground_truth_is_told(late: float) -> None:
    """Two sensors that agree tell how late it is; one of them alone tells nothing."""
    assert _flight(late).lateness == (
        pytest.approx(late, abs=0.051),
        "AltitudeSensor and MagneticCompass",
    )
    assert math.isnan(_flight(0.0, compass_late=0.5).lateness[0])


def test_steps_tell_the_rate_of_a_count_that_begins_anew() -> None:
    """Whatever it begins anew at."""
    ticks = [(0.1 * number, float(7 * number % 180)) for number in range(100)]
    assert stepped_rate(ticks) == pytest.approx(70.0)


def _stations(noise: float, scale: float) -> list[sensors._Station]:
    """Three robots 100 m apart whose GPS is scaled and noisy, m."""
    rng = random.Random(3)
    found = []
    for x, y in ((0.0, 0.0), (100.0, 0.0), (0.0, 100.0)):
        fixes = [
            (
                (scale * x + rng.gauss(0.0, noise)) / 111_200.0,
                (scale * y + rng.gauss(0.0, noise)) / 71_670.0,
                12,
            )
            for _ in range(30)
        ]
        found.append(sensors._Station(Pose((x, y, 0.0), (0.0, 0.0, 0.0)), fixes))
    return found


@pytest.mark.parametrize(
    ("noise", "scale", "problem", "message"),
    [
        (60.0, 1.0, Inconclusive, r"scatters by \d+\.\d+ m, not by 0\.25 m"),
        (0.25, 0.5, Failed, r"Latitude moved by \d+\.\d+ m .* 0\.50\d times the right way"),
    ],
)
def test_noise_is_no_scale(
    noise: float,
    scale: float,
    problem: type[Exception],
    message: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A GPS with much noise is not said to have another scale, one of another scale is."""

    async def stations(case: Case) -> list[sensors._Station]:
        return _stations(noise, scale)

    monkeypatch.setattr(sensors, "_stations", stations)
    with pytest.raises(problem, match=message):
        asyncio.run(sensors.gps_scale(object.__new__(Case)))
