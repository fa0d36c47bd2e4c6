"""Makes the picture of a report for docs/exploration.md, out of real runs.

Needs the extra `exploration`, playwright, Chromium and Pillow:
``python docs/images/explore_report.py [DIR]``. Runs are kept in DIR, so that they need not be run
again; they take two minutes of processor.
"""

import io
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

BATCH = """\
environments = ["office", "maze"]
teams = [4]
strategies = ["frontier", "ratio", "role-based", "market"]
radios = ["path-loss"]
seeds = 6
[team]
base = "drawn"
[end]
steps = 600
"""
WIDTH = 860
FIRST, LAST = "h2:nth-of-type(3)", "h2:nth-of-type(3) ~ figure >> nth=2"
"""Heading of the first setting, and its last picture."""


def usarsim(*words: object) -> None:
    """A command of ours."""
    subprocess.run([sys.executable, "-m", "usarsim_server", *map(str, words)], check=True)


def main(folder: Path) -> None:
    """Run, report, and take the picture."""
    (folder / "batch.toml").write_text(BATCH)
    usarsim("explore", "bench", folder / "batch.toml", f"--out={folder / 'out'}")
    usarsim("explore", "report", folder / "out", f"--out={folder / 'report'}")
    with sync_playwright() as tools:
        browser = tools.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": WIDTH, "height": 900})
        page.goto((folder / "report" / "report.html").resolve().as_uri())
        first, last = (page.locator(one).bounding_box() for one in (FIRST, LAST))
        assert first
        assert last
        tall = last["y"] + last["height"] - first["y"]
        clip = {"x": 0, "y": first["y"], "width": WIDTH, "height": tall + 12}
        data = page.screenshot(full_page=True, clip=clip)
        browser.close()
    picture = Image.open(io.BytesIO(data)).convert("RGB").quantize(48, kmeans=1)
    picture.save(Path(__file__).with_name("explore-report.png"), optimize=True)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as spare:
            main(Path(spare))
