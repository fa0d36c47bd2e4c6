"""The report of a study in a real Chromium."""

from __future__ import annotations

from pathlib import Path

import pytest
from console_rig import chromium
from lanes import slow_but

from usarsim_server import cli
from usarsim_study.synthetic import Plan, make_study

CUT = "[...document.querySelectorAll('div')].filter(d => d.scrollWidth > d.clientWidth).length"


SMALL = Plan(16, effect=8.0, seed=2)
"""Its report has the widest texts: each p is < 0.001."""
PLANS = [SMALL, Plan(12, effect=0.8, seed=3), Plan(4, effect=6.0, seed=1)]


@pytest.mark.parametrize("plan", slow_but(SMALL.__eq__, PLANS))
def test_no_column_of_a_table_is_cut(plan: Plan, tmp_path: Path) -> None:
    """Tables of numbers fit the page of a tablet and of a laptop, whatever is in them."""
    pytest.importorskip("scipy")
    make_study(tmp_path / "made", plan)
    assert cli.main(["study", "report", str(tmp_path / "made")]) == 0
    with chromium(["--no-sandbox", "--disable-gpu"]) as browser:
        page = browser.new_page()
        for width in (800, 1366):
            page.set_viewport_size({"width": width, "height": 1200})
            page.goto((tmp_path / "made" / "report.html").as_uri())
            assert page.evaluate(CUT) == 0, width
