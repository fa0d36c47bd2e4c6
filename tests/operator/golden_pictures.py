"""Pictures of the page that were looked at and found good, and how much one differs from another.

``python tests/operator/golden_pictures.py`` makes them anew; look at them before they are kept.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from console_browser import NO_GL
from console_rig import Played, chromium, shown, until
from numpy.typing import NDArray
from PIL import Image

FOLDER = Path(__file__).parent / "golden"
ROLES = ("operator", "instructor", "viewer")
LAYOUTS: dict[str, dict[str, Any]] = {
    "wide": {"viewport": {"width": 1366, "height": 768}, "color_scheme": "dark"},
    "light": {"viewport": {"width": 1366, "height": 768}, "color_scheme": "light"},
    "large": {"viewport": {"width": 1920, "height": 1080}, "color_scheme": "dark"},
    "phone": {"viewport": {"width": 390, "height": 844}, "color_scheme": "dark"},
}
Grey = NDArray[np.float64]

# Fonts differ between machines: no text is drawn, on canvases neither.
_MASK = """
CanvasRenderingContext2D.prototype.fillText = () => {};
addEventListener("DOMContentLoaded", () => {
  const sheet = new CSSStyleSheet();
  sheet.replaceSync("* { color: transparent !important; caret-color: transparent !important; "
    + "transition: none !important; animation: none !important }");
  document.adoptedStyleSheets = [sheet];
});
"""


def picture(browser: Any, played: Played, role: str, layout: str) -> Image.Image:
    """The page of a role in a layout, of a world that stands still, without texts."""

    def before(page: Any) -> None:
        page.add_init_script(_MASK)

    with shown(browser, played.url(role), before, **LAYOUTS[layout]) as page:
        until(lambda: page.locator("[data-tile][data-stale=false]").count() == 4)
        until(lambda: page.evaluate("usarsim.store.slot(0).map && usarsim.store.slot(3).path"))
        until(lambda: page.evaluate("usarsim.store.slot(255).picture?.time > 0"))
        if page.is_visible("[data-panel=map]"):  # a phone shows one panel after another
            drawn = page.evaluate("usarsim.map.drawn")
            page.click("[data-panel=map] [data-do=fit]")
            until(lambda: page.evaluate("usarsim.map.drawn") > drawn + 3)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "page.png"
            page.screenshot(path=file)
            return Image.open(file).convert("RGB")


def played_still() -> Played:
    """A fake gateway whose world stands still at a well-known moment."""
    played = Played(4)
    gateway = played.gateway
    for _ in range(500):
        gateway.step(0.02)
    gateway.paused = True
    gateway.marks.append(
        {"id": 1, "robot": "R1", "place": [4.5, 3.0, 0.0], "status": "alive", "note": "",
         "by": "Ada", "time": 41.0}
    )  # fmt: skip
    return played


def likeness(one: Image.Image, other: Image.Image) -> tuple[float, float, Image.Image]:
    """Structural similarity of two pictures of a size, and where they differ; 1 is the same.

    The first number is that of all, the second that of the worst block of 120 pixels: most of a
    page is level, so that a whole panel hardly counts in the first one.
    """
    values = [np.asarray(image.convert("L"), np.float64) for image in (one, other)]
    a, b = values
    mean_a, mean_b = _smooth(a), _smooth(b)
    spread_a, spread_b = _smooth(a * a) - mean_a**2, _smooth(b * b) - mean_b**2
    both = _smooth(a * b) - mean_a * mean_b
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    alike = ((2 * mean_a * mean_b + c1) * (2 * both + c2)) / (
        (mean_a**2 + mean_b**2 + c1) * (spread_a + spread_b + c2)
    )
    worst = cv2.blur(alike, (120, 120)).min()
    return (
        float(alike.mean()),
        float(worst),
        Image.fromarray(np.uint8(255 * np.clip(1 - alike, 0, 1))),
    )


def _smooth(values: Grey) -> Grey:
    return np.asarray(cv2.GaussianBlur(values, (11, 11), 1.5), np.float64)


def every() -> list[tuple[str, str]]:
    """Role and layout of each picture."""
    return [(role, layout) for role in ROLES for layout in LAYOUTS]


def main() -> None:
    """Make all pictures anew."""
    FOLDER.mkdir(exist_ok=True)
    played = played_still()
    with played, chromium(NO_GL) as browser:
        for role, layout in every():
            file = FOLDER / f"{role}-{layout}.png"
            picture(browser, played, role, layout).quantize(64, dither=0).save(file, optimize=True)
            print(file, file.stat().st_size)


if __name__ == "__main__":
    main()
