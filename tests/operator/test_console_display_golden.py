"""The page looks as it did when it was looked at last."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from lanes import slow_but

pytest.importorskip("aiohttp")

from console_browser import NO_GL
from console_rig import Played, chromium
from golden_pictures import FOLDER, every, likeness, picture, played_still
from PIL import Image

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("page_folder")]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Without WebGL, whose pictures depend on the driver."""
    with chromium(NO_GL) as running:
        yield running


@pytest.fixture(scope="module")
def played() -> Iterator[Played]:
    """Four robots that stand still."""
    one = played_still()
    with one:
        yield one


@pytest.mark.parametrize(
    ("role", "layout"), slow_but({("operator", "wide"), ("viewer", "phone")}.__contains__, every())
)
def test_page_looks_as_before(
    browser: Any, played: Played, tmp_path: Path, role: str, layout: str
) -> None:
    """CON-11: SSIM of .98, texts masked. Where it fails, both pictures and the difference stay."""
    golden = Image.open(FOLDER / f"{role}-{layout}.png").convert("RGB")
    now = picture(browser, played, role, layout)
    assert now.size == golden.size
    alike, worst, difference = likeness(golden, now)
    good = alike >= 0.98 and worst >= WORST
    if not good:
        for name, image in (("golden", golden), ("now", now), ("difference", difference)):
            image.save(tmp_path / f"{name}.png")
    assert good, (
        f"{alike:.3f}, {worst:.3f}: {tmp_path}: golden.png, now.png, difference.png (python {HOW})"
    )


WORST = 0.82
"""Of a block; one without a scan that should be there has 0.7."""
HOW = "tests/operator/golden_pictures.py makes them anew"
