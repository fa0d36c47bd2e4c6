"""`usarsim share`: a run in one HTML file that works without network."""

from __future__ import annotations

import argparse
from pathlib import Path

from usarsim_server.cli.common import Subparsers, add_command

_EPILOG = (
    "The file shows world and robots in 3D, the map, points over time, what operators did and all "
    "events, moved by one time line. It is smaller than 5 MB and asks for nothing from the network;"
    " what did not fit is said in it. A run of a blind study names no condition."
)


def add_parser(subparsers: Subparsers) -> None:
    """Add `share`."""
    text = "make one HTML file of a run, to be passed on and looked at offline"
    parser = add_command(subparsers, "share", text, run, epilog=_EPILOG)
    parser.add_argument("folder", metavar="RUN", type=Path, help="folder of a run")
    parser.add_argument(
        "--out", metavar="FILE", type=Path, help="file to write (default: share.html in the folder)"
    )
    parser.add_argument(
        "--blind", action="store_true", help="leave out mission, team and what names a condition"
    )


def run(arguments: argparse.Namespace) -> int:
    """Write the file."""
    from usarsim_mission.sharing.file import SHARED, share
    from usarsim_report.serving import PAGE

    out = arguments.out or arguments.folder / SHARED
    size, detail = share(arguments.folder, out, PAGE, arguments.blind)
    scenery = "with scenery" if detail.scenery else "without scenery"
    print(f"SHARED {out} {size / 1e6:.2f} MB, {detail.rate:g} poses a second, {scenery}")
    return 0
