"""The soak: what it counts, and a very short one with a real server."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from bench_runs import measured

from usarsim_bench import soak, soak_visitors
from usarsim_bench.soak import Stream, flatness


def status(*times: float) -> bytes:
    """STA lines that tell these times."""
    return b"".join(b"STA {Type GroundVehicle} {Time %.4f} {x y}\r\n" % time for time in times)


class TestStream:
    """Lines are missed by the time that they themselves tell."""

    def test_nothing_is_missing(self) -> None:
        """However the lines are cut into pieces."""
        stream, data = Stream(), status(*(0.1 * n for n in range(60)))
        for begin in range(0, len(data), 7):
            stream.digest(data[begin : begin + 7])
        assert (stream.lines, stream.missing) == (60, 0)

    def test_what_is_missing_is_counted(self) -> None:
        """Two lines that never came."""
        times = [0.1 * n for n in range(60) if n not in (40, 50)]
        stream = Stream()
        stream.digest(status(*times) + b"SEN {Time 9} {Type x}\r\n")
        assert (stream.lines, stream.missing) == (58, 2)


class TestFlatness:
    """Memory at the end by memory after the warming up."""

    def test_growth(self) -> None:
        """What was before the warming up does not count."""
        samples = [(float(t), 100.0 if t < 20 else 200.0 + t) for t in range(120)]
        assert flatness(samples, 20.0) == pytest.approx((200 + 114.5) / (200 + 24.5))

    def test_too_short(self) -> None:
        """No verdict from nothing."""
        assert math.isnan(flatness([(0.0, 1.0)], 0.0))


def test_a_very_short_soak(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Robots come and speak, radio links carry, nothing is missing, everything is given back."""
    monkeypatch.setattr(soak, "SETTLE", 0.2)
    monkeypatch.setattr(soak_visitors, "GUESTS", 3)
    monkeypatch.setattr(soak_visitors, "STAY", 3.0)
    monkeypatch.setattr(soak_visitors, "RADIO_EVERY", 1.0)
    monkeypatch.setattr(soak_visitors, "all_classes", lambda: ["P2AT", "P3AT", "ERS"])
    monkeypatch.setattr(soak, "all_classes", lambda: ["P2AT", "P3AT", "ERS"])
    figures = measured(tmp_path, "soak", 8.0)
    assert figures["Visits of robots"]["value"] >= 3
    assert figures["Classes that were there"]["value"] >= 1
    assert figures["Status lines of those who stay"]["value"] > 0
    assert figures["Memory when everybody has gone"]["value"] > 0
    assert figures["... of them missing in simulated time"]["aim"] == "<= 0"
    assert figures["... by that of the empty server"]["aim"] is None
