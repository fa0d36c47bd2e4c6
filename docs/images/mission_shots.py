"""Makes the pictures of reports, shared runs and leagues for docs/missions.md, out of real runs.

Needs the console's extra, playwright, Chromium and Pillow: ``python docs/images/mission_shots.py
[report] [share] [league] [DIR]``. Runs are kept in DIR, so that they need not be run again.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from console_shots import FLAGS, HERE, save
from playwright.sync_api import sync_playwright

SIZES = {"report": (1080, 1575), "share": (1366, 768), "league": (1080, 900)}
TEAMS = {
    "Explorers": 'policy = "explore"\n[synthetic]',
    "Careful eyes": 'policy = "explore"\n[synthetic]\nmiss = 0.0\nerror = 0.05\nreaction = 2.5',
    "Hasty eyes": 'policy = "explore"\n[synthetic]\nmiss = 0.4\nerror = 0.9\ndwell = 2.0',
}
"""Robots that explore by themselves, watched by operators of different skill."""


def usarsim(*words: object) -> None:
    """A command of ours."""
    subprocess.run([sys.executable, "-m", "usarsim_server", *map(str, words)], check=True)


def report(folder: Path) -> Path:
    """The report of a run of arena-zones."""
    out = folder / "report"
    if not (out / "report.html").exists():
        usarsim(
            "mission",
            "run",
            "arena-zones",
            "--demo",
            "--seed=3",
            "--time-limit=300",
            f"--out={out}",
        )
    return out / "report.html"


def share(folder: Path) -> Path:
    """The same run as a file to be passed on."""
    run, file = report(folder).parent, folder / "share.html"
    usarsim("share", run, f"--out={file}")
    return file


def league(folder: Path) -> Path:
    """A league of three teams in five matches."""
    out, teams = folder / "league", []
    for name, text in TEAMS.items():
        path = folder / f"{name}.toml"
        path.write_text(f'name = "{name}"\n{text}\n')
        teams.append(f"--team={path}")
    short = ("--time-limit=60", "--speed=max", "--seeds=1-5", "--jobs=2")
    usarsim("mission", "run", "arena-search", *teams, *short, f"--out={out}")
    return out / "league.html"


SHOTS = {"report": report, "share": share, "league": league}


def main(words: list[str]) -> None:
    """Make the pictures that are named, or all."""
    names = [word for word in words if word in SHOTS] or list(SHOTS)
    places = [Path(word) for word in words if word not in SHOTS]
    with tempfile.TemporaryDirectory() as spare, sync_playwright() as tools:
        folder = places[0] if places else Path(spare)
        folder.mkdir(parents=True, exist_ok=True)
        browser = tools.chromium.launch(executable_path="/usr/bin/chromium", args=FLAGS)
        for name in names:
            wide, tall = SIZES[name]
            scheme = "dark" if name == "share" else "light"
            page = browser.new_page(viewport={"width": wide, "height": tall}, color_scheme=scheme)
            page.goto(SHOTS[name](folder).resolve().as_uri())
            if name == "share":
                page.wait_for_selector("html[data-ready]")
                page.evaluate("share.seek(200)")
                page.wait_for_selector("[data-panel=share3d][data-sharp=true]")
                page.wait_for_timeout(2000)
            save(page.screenshot(), HERE / f"mission-{name}.png")
        browser.close()


if __name__ == "__main__":
    main(sys.argv[1:])
