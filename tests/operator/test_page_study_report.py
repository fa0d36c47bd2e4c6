"""The report of a study in a real Chromium."""

from __future__ import annotations

from pathlib import Path

import pytest
from console_rig import chromium

from usarsim_server import cli
from usarsim_study.synthetic import Plan, make_study

CUT = "[...document.querySelectorAll('div')].filter(d => d.scrollWidth > d.clientWidth).length"


@pytest.mark.parametrize("width", [800, 1366])
def test_no_column_of_a_table_is_cut(width: int, tmp_path: Path) -> None:
    """Tables of numbers fit the page of a tablet and of a laptop (12 participants)."""
    pytest.importorskip("scipy")
    make_study(tmp_path / "made", Plan(12, effect=0.8, seed=3))
    assert cli.main(["study", "report", str(tmp_path / "made")]) == 0
    with chromium(["--no-sandbox", "--disable-gpu"]) as browser:
        page = browser.new_page(viewport={"width": width, "height": 1200})
        page.goto((tmp_path / "made" / "report.html").as_uri())
        assert page.evaluate(CUT) == 0
