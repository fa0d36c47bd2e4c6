"""Curves become pictures: well-formed, everything inside its frame, everything labelled."""

from __future__ import annotations

import math
from itertools import pairwise
from xml.etree import ElementTree

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from usarsim_bench.plot import FRAME, HEIGHT, WIDTH, Plot, Series, as_svg, nice_ticks, place

SVG = "{http://www.w3.org/2000/svg}"
LETTER = 0.62 * 12
"""Pixels that a letter of the small type takes, at the most on average."""


def plot(*series: Series, log_x: bool = False) -> Plot:
    """A plot of some series."""
    return Plot("k", "Cost <of> robots & beams", "robots", "cores", series, log_x)


PHYSICS = Series("physics", ((1.0, 0.02), (16.0, 0.2), (64.0, 0.7)))
REPORTS = Series("reports & text", ((1.0, 0.01), (16.0, 0.05), (64.0, 0.21)))


def tree(one: Plot) -> ElementTree.Element:
    """The picture, read by a parser of XML."""
    return ElementTree.fromstring(as_svg(one))


def texts(one: Plot, kind: str) -> list[ElementTree.Element]:
    """Its texts of one kind."""
    return [text for text in tree(one).iter(f"{SVG}text") if text.get("class") == kind]


def curves(one: Plot) -> list[list[tuple[float, float]]]:
    """Pixels of the corners of every curve."""
    found = []
    for line in tree(one).iter(f"{SVG}polyline"):
        corners = (corner.split(",") for corner in line.attrib["points"].split())
        found.append([(float(x), float(y)) for x, y in corners])
    return found


class TestPicture:
    def test_it_is_well_formed_and_complete(self) -> None:
        """A parser of XML reads it; title, both axes and every series are named, as written."""
        said = [text.text for text in tree(plot(PHYSICS, REPORTS)).iter(f"{SVG}text")]
        for name in ("Cost <of> robots & beams", "robots", "cores", "physics", "reports & text"):
            assert said.count(name) == 1

    def test_curves_show_the_values(self) -> None:
        """Corners lie where axis ticks say that they lie, and rise as the values rise."""
        one = plot(PHYSICS, REPORTS)
        first, second = curves(one)
        assert len(first) == len(second) == 3
        ticks = {text.text: float(text.attrib["x"]) for text in texts(one, "tick")}
        left, right = ticks["0"], ticks["60"]
        # The 0 of the y axis has the same text; it stands left of the frame.
        assert left < FRAME[0]
        assert first[1][0] == pytest.approx(FRAME[0] + (right - FRAME[0]) * 16 / 60, abs=0.2)
        assert first[0][1] > first[1][1] > first[2][1]
        assert first[2][1] < second[2][1]
        bottom, top = FRAME[3], FRAME[1]
        greatest = one.limits[3]
        assert first[2][1] == pytest.approx(bottom - (bottom - top) * 0.7 / greatest, abs=0.1)

    def test_a_logarithmic_axis(self) -> None:
        """Equal factors lie equally far apart, and the measured sizes are the ticks."""
        one = plot(Series("a", ((10.0, 1.0), (100.0, 2.0), (1000.0, 3.0))), log_x=True)
        ((a, _), (b, _), (c, _)) = curves(one)[0]
        assert b - a == pytest.approx(c - b, abs=0.2)
        assert [t.text for t in texts(one, "tick")][:3] == ["10", "100", "1000"]

    def test_labels_do_not_overlap(self) -> None:
        """Neither ticks of an axis nor names of series stand on each other or leave the picture."""
        sizes = (1.0, 2.0, 3.0, 1000.0, 1010.0, 3000.0)
        names = ("physics", "reports", "sockets", "whole server", "drawing and encoding", "others")
        one = plot(*(Series(n, tuple((x, x) for x in sizes)) for n in names), log_x=True)
        below = [t for t in texts(one, "tick") if t.get("text-anchor") == "middle"]
        spans = [(float(t.attrib["x"]), LETTER * len(t.text or "") / 2) for t in below]
        for (x, half), (next_x, next_half) in pairwise(spans):
            assert x + half < next_x - next_half
        beside = [t for t in texts(one, "tick") if t.get("text-anchor") == "end"]
        rows = sorted(float(t.attrib["y"]) for t in beside)
        assert len(below) >= 4
        assert len(rows) >= 3
        assert all(b - a > 12.0 for a, b in pairwise(rows))
        legend = [
            (float(t.attrib["y"]), float(t.attrib["x"]), LETTER * len(t.text or ""))
            for t in texts(one, "series")
        ]
        assert len(legend) == len(names)
        for (row, x, wide), (next_row, next_x, _) in pairwise(legend):
            assert x + wide <= WIDTH
            assert next_row - row > 12.0 if next_row != row else x + wide < next_x
        assert max(row for row, _, _ in legend) < FRAME[1]

    @given(
        values=st.lists(
            st.tuples(st.floats(1e-3, 1e6), st.floats(0.0, 1e6)), min_size=1, max_size=12
        ),
        log_x=st.booleans(),
    )
    @settings(max_examples=60, deadline=None)
    def test_every_point_lies_inside_the_frame(
        self, values: list[tuple[float, float]], log_x: bool
    ) -> None:
        """Whatever is measured, no curve leaves the frame."""
        left, upper, right, lower = FRAME
        one = plot(Series("a", tuple(sorted(values))), log_x=log_x)
        for x, y in curves(one)[0]:
            assert left - 0.1 <= x <= right + 0.1
            assert upper - 0.1 <= y <= lower + 0.1
        assert 0 < left < right < WIDTH
        assert 0 < upper < lower < HEIGHT

    @pytest.mark.parametrize(
        ("series", "log_x", "told"),
        [
            ((), False, "nothing to plot"),
            ((Series("a", ()),), False, "nothing to plot"),
            ((Series("a", ((1.0, math.nan),)),), False, "finite"),
            ((Series("a", ((1.0, -0.1),)),), False, "negative"),
            ((Series("a", ((0.0, 1.0),)),), True, "logarithmic"),
        ],
    )
    def test_what_has_no_place_is_refused(
        self, series: tuple[Series, ...], log_x: bool, told: str
    ) -> None:
        """Nothing at all, and values that have no place on their scale, are errors."""
        with pytest.raises(ValueError, match=told):
            as_svg(plot(*series, log_x=log_x))


class TestTicks:
    @given(low=st.floats(0.0, 1e4), length=st.floats(1e-6, 1e6))
    @settings(deadline=None)
    def test_they_are_few_and_cover_the_range(self, low: float, length: float) -> None:
        """Between three and nine, equally far apart, the range between the first and the last."""
        high = low + length
        if not high > low or length < 1e-6 * high:
            return
        ticks = nice_ticks(low, high)
        assert 3 <= len(ticks) <= 9
        slack = 1e-6 * length
        assert ticks[0] <= low + slack
        assert ticks[-1] >= high - slack

    def test_they_are_round(self) -> None:
        """People can read them."""
        assert nice_ticks(0.0, 64.0) == [0.0, 20.0, 40.0, 60.0, 80.0]
        assert nice_ticks(0.0, 1.1) == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.2])

    def test_a_point_has_no_ticks(self) -> None:
        """A range without length is an error."""
        with pytest.raises(ValueError, match="range"):
            nice_ticks(1.0, 1.0)


def test_a_single_point_has_a_place() -> None:
    """One measured size makes a picture, too, on either scale."""
    for log_x in (False, True):
        one = plot(Series("a", ((8.0, 0.5),)), log_x=log_x)
        x, y = place(one, 8.0, 0.5)
        assert FRAME[0] <= x <= FRAME[2]
        assert FRAME[1] <= y <= FRAME[3]
