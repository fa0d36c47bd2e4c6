"""Measurements of the operator console: arithmetic, arguments, and one that is taken."""

from __future__ import annotations

import json
import math
import struct
from importlib import metadata
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from usarsim_bench.console import ITEMS, arithmetic, lengths
from usarsim_bench.console.arithmetic import Arrival, Legs, Shown, Wired
from usarsim_bench.figures import Plan
from usarsim_server.cli import main

GO = '{"type":"drive","robot":"R1","device":"keyboard","left":0.6,"right":0.6}'
HALT = GO.replace("0.6", "0")


class TestKeys:
    """O-37 and CON-12: which way a key took."""

    SENT = ((10.001, GO), (10.051, GO), (10.101, HALT), (11.002, GO), (11.052, HALT))
    HEARD = (10.002, 10.052, 10.102, 11.004, 11.053)
    WIRED = ((10.003, False), (10.053, False), (10.106, True), (11.009, False), (11.06, True))

    def test_presses(self) -> None:
        """Each press is the first drive after it; its legs end at the first DRIVE after it was
        read."""
        legs = arithmetic.key_legs([10.0, 11.0], self.SENT, self.HEARD, self.WIRED)
        assert [one and round(one.total, 6) for one in legs] == [0.003, 0.009]
        second = legs[1]
        assert second is not None
        parts = [round(part, 6) for part in (second.page, second.transit, second.gateway)]
        assert parts == [0.002, 0.002, 0.005]

    def test_releases(self) -> None:
        """A release is followed by drives until the neutral one; the stop on the wire counts."""
        legs = arithmetic.key_legs([10.1, 11.05], self.SENT, self.HEARD, self.WIRED, stops=True)
        assert [one and round(one.total, 6) for one in legs] == [0.006, 0.01]
        held = arithmetic.key_legs([10.04], self.SENT, self.HEARD, self.WIRED, stops=True)
        assert [one and round(one.page, 6) for one in held] == [0.061]

    def test_lost(self) -> None:
        """A key without a drive before the next one, or without a DRIVE, has no legs."""
        keys = [9.0, 10.0, 11.0]
        wired = self.WIRED[:3]
        legs = arithmetic.key_legs(keys, self.SENT, self.HEARD, wired)
        assert [one is None for one in legs] == [True, False, True]
        with pytest.raises(ValueError, match="5 drives were sent, 4 were read"):
            arithmetic.key_legs(keys, self.SENT, self.HEARD[:4], wired)

    def test_legs_add_up(self) -> None:
        """The total is the sum."""
        assert Legs(1.0, 2.0, 4.0).total == 7.0

    @pytest.mark.parametrize(
        ("drive", "zero"),
        [
            ("DRIVE {Left 0.0} {Right 0.0} {Normalized False}", True),
            ("DRIVE {Left 0} {Right -0.0} {Normalized true}", True),
            ("DRIVE {Left 0.0} {Right 1e-3} {Normalized False}", False),
            ("DRIVE {AltitudeVelocity 0} {LinearVelocity 0.1}", False),
        ],
    )
    def test_zero(self, drive: str, zero: bool) -> None:
        """What stops a robot, in all words of DRIVE."""
        assert arithmetic.is_zero(drive) is zero


def test_emergency_stop_takes_until_the_last_robot() -> None:
    """CON-15: zeros from before the stop and repeated ones do not count; a robot left out is
    never told."""
    wired = [Wired(4.9, "R1", True), Wired(5.01, "R2", False), Wired(5.02, "R1", True)]
    wired += [Wired(5.03, "R2", True), Wired(5.4, "R1", True)]
    assert arithmetic.stopping_time(5.0, 2, wired) == pytest.approx(0.03)
    assert arithmetic.stopping_time(5.0, 3, wired) == math.inf


class TestPictures:
    """O-38: ages, growth, queue."""

    SHOWN = tuple(Shown(0.1 * n, 3, n, 0.1 * n - 0.02) for n in range(1, 101))

    def test_ages_grow(self) -> None:
        """Age counts from the gateway's request; pictures of nobody are passed over."""
        late = [Arrival(s.moment + 0.001 * s.sequence, 3, s.sequence) for s in self.SHOWN]
        ages = arithmetic.picture_ages([*late, Arrival(1.0, 9, 1)], self.SHOWN)
        assert len(ages) == 100
        assert ages[0] == (pytest.approx(0.101), pytest.approx(0.021))
        assert arithmetic.p95([age for _, age in ages]) == pytest.approx(0.115, abs=1e-3)
        assert arithmetic.growth(ages) > 4.0
        even = [(moment, 0.03) for moment, _ in ages]
        assert arithmetic.growth(even) == 1.0
        assert math.isnan(arithmetic.growth([]))

    @pytest.mark.parametrize(("delay", "queue"), [(0.05, 0), (0.15, 1), (0.35, 3)])
    def test_queue(self, delay: float, queue: int) -> None:
        """As many wait behind one as came since; a clock's error counts for the page."""
        arrivals = [Arrival(s.moment + delay, 3, s.sequence) for s in self.SHOWN[:50]]
        assert arithmetic.longest_queue(arrivals, self.SHOWN) == queue
        assert arithmetic.longest_queue(arrivals, self.SHOWN, 0.06) == max(0, queue - 1)

    def test_clock(self) -> None:
        """The shortest round tells what a page's clock has to be added."""
        rounds = [(10.0, 3.0, 11.0), (12.0, 2.501, 12.002), (13.0, 3.4, 13.5)]
        offset, error = arithmetic.clock_offset(rounds)
        assert (offset, error) == (pytest.approx(9.5), pytest.approx(0.001))


def test_notes() -> None:
    """What a gateway noted comes back, an unfinished line excepted; nonsense is refused."""
    lines = [
        f"heard\t1.5\t4\t{GO}\n",
        "wired\t1.6\tR1\t1\n",
        "wired\t1.7\tR1\t0\n",
        "shown\t2.0\t0\t17\t1.98\n",
        "waiting\t2.5\t4\t1024\n",
        "wired\t3.",
    ]
    notes = arithmetic.read_notes(lines)
    assert [(one.page, one.text) for one in notes.heard] == [(4, GO)]
    assert notes.wired == [Wired(1.6, "R1", False), Wired(1.7, "R1", True)]
    assert notes.shown == [Shown(2.0, 0, 17, 1.98)]
    assert notes.waiting == [(2.5, 4, 1024)]
    with pytest.raises(ValueError, match="no note"):
        arithmetic.read_notes(["sung\t1.0\n"])


def test_packages_of_an_extra() -> None:
    """CON-02: what the extra brings with all that it needs, not what is needed without it."""
    added = arithmetic.added_packages("console")
    assert {"aiohttp", "multidict", "yarl"} <= set(added)
    assert not {"numpy", "mujoco", "pillow"} & set(added)
    assert added["aiohttp"] > 1_000_000
    with pytest.raises(metadata.PackageNotFoundError):
        arithmetic.added_packages("console", of="no-such-distribution")


SIZES = st.sampled_from((0, 1, 125, 126, 127, 300, 65535, 65536))


@settings(max_examples=40)
@given(st.lists(SIZES, max_size=4), st.lists(st.integers(1, 70_000), max_size=6))
def test_frames_of_a_slow_page(sizes: list[int], cuts: list[int]) -> None:
    """CON-22: whole frames come out in order, however the bytes were cut."""
    programs = pytest.importorskip("usarsim_bench.console.programs")
    stream, payloads = b"", [bytes([place]) * size for place, size in enumerate(sizes)]
    for payload in payloads:
        size = len(payload)
        wide = ("!BQ", 127) if size > 65535 else ("!BH", 126)
        head = bytes([size]) if size < 126 else struct.pack(*wide, size)
        stream += b"\x82" + head + payload
    held, found = bytearray(), list[bytes]()
    for cut in [*cuts, len(stream)]:
        held += stream[:cut]
        stream = stream[cut:]
        found += programs.frames(held)
    assert found == payloads
    assert not held


def test_lengths() -> None:
    """A length that was asked for wins; counts follow from it."""
    assert lengths.seconds(Plan(), 600.0, 60.0) == 600.0
    assert lengths.seconds(Plan(brief=True), 600.0, 60.0) == 60.0
    assert lengths.seconds(Plan(brief=True, seconds=5.0), 600.0, 60.0) == 5.0
    assert lengths.count(Plan(), 1000, 150, 0.25) == 1000
    assert lengths.count(Plan(brief=True), 1000, 150, 0.25) == 150
    assert lengths.count(Plan(seconds=10.0), 1000, 150, 0.25) == 40
    assert lengths.count(Plan(seconds=0.1), 1000, 150, 0.25) == 3


def test_every_item_is_measured() -> None:
    """Each number of the help has its measurement, and the other way round."""
    measuring = pytest.importorskip("usarsim_bench.console.measuring")
    assert {*measuring.BEFORE, *measuring.BESIDE} == set(ITEMS)


def test_unknown_items_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """The error names those that there are; code 2."""
    with pytest.raises(SystemExit) as ended:
        main(["bench", "console", "con-99"])
    assert ended.value.code == 2
    assert "no item con-99 (choose from con-02, con-04" in capsys.readouterr().err


@pytest.mark.slow
def test_it_is_taken(tmp_path: Path) -> None:
    """CON-02, CON-15: a server, a gateway, pages: the figures are there, in one table."""
    pytest.importorskip("aiohttp")
    file = tmp_path / "console.json"
    words = ["--robots", "1", "--seconds", "1", "--world", "empty", "--json", str(file)]
    assert main(["bench", "console", "CON-02", "con-15", *words]) == 0
    (section,) = json.loads(file.read_text())["sections"]
    figures = {one["name"]: one for one in section["figures"]}
    assert all(name.startswith(("CON-02 ", "CON-15 ")) for name in figures)
    assert figures["CON-02 new distributions"]["value"] >= 5
    assert figures["CON-15 stops"]["value"] == 3
    # No robot was left out of a stop, however long it took.
    assert math.isfinite(figures["CON-15 stop to the last zero DRIVE, longest"]["value"])
