"""`usarsim explore show`: pictures, films and a live page of a run."""

from __future__ import annotations

import argparse
import asyncio
import importlib.util
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from usarsim_exploration.commands import add_run_code
from usarsim_server.base.errors import UsarsimError
from usarsim_server.cli.common import Subparsers, add_command

if TYPE_CHECKING:
    from usarsim_exploration.showing.tape import Tape

_EPILOG = (
    "DIR is the folder of a run, which is run again for this; it has to go as its log says; or the "
    "result.json of a batch, of which --run names one, as in office/4/frontier/path-loss/7. "
    "--from-log lets robots do what the log says, and nobody decides: plans and meeting points are "
    "not shown then. --out FILE.png is one step, FILE.mp4 or FILE.gif a film, any other name a "
    "folder of pictures. Ctrl-C ends a film with what was drawn so far. docs/exploration.md "
    "tells of the overlays; --overlays help names them."
)
_FPS = 20.0
GoesOn = Callable[[], bool]


def add_parser(subparsers: Subparsers) -> None:
    """Add `show`."""
    parser = add_command(subparsers, "show", "pictures and films of a run", run, epilog=_EPILOG)
    parser.add_argument(
        "folder", metavar="DIR", type=Path, help="folder with scenario.toml, or a result.json"
    )
    parser.add_argument("--run", dest="key", metavar="KEY", help="which run of a batch")
    parser.add_argument(
        "--files", metavar="DIR", type=Path, help="where maps and strategy files lie of the batch"
    )
    parser.add_argument("--out", metavar="FILE|DIR", type=Path, help="what to write")
    parser.add_argument(
        "--browser", action="store_true", help="show any step in a browser instead (extra console)"
    )
    parser.add_argument(
        "--port", metavar="N", type=_count(0), default=0, help="of --browser (default any free one)"
    )
    parser.add_argument(
        "--step", metavar="N", type=_count(0), help="the step of a picture (default the last one)"
    )
    parser.add_argument(
        "--every",
        metavar="N",
        type=_count(1),
        default=1,
        help="steps between two pictures of a film or folder (default 1)",
    )
    parser.add_argument(
        "--fps",
        metavar="N",
        type=_fps,
        default=_FPS,
        help=f"pictures a second of a film (default {_FPS:g})",
    )
    parser.add_argument(
        "--overlays",
        metavar="A,B,-C",
        default="",
        help="drawn beside the usual ones, or not; begin with none or all, write --overlays=-C",
    )
    parser.add_argument("--robot", metavar="NAME", help="show the map and plans of one alone")
    parser.add_argument(
        "--from-log", action="store_true", help="do what agents.csv says, do not decide again"
    )
    add_run_code(parser)


def _count(least: int) -> Callable[[str], int]:
    def read(text: str) -> int:
        number = int(text)
        if number < least:
            raise argparse.ArgumentTypeError(f"must be at least {least}, not {number}")
        return number

    return read


def _fps(text: str) -> float:
    number = float(text)
    if not 1.0 <= number <= 120.0:
        raise argparse.ArgumentTypeError("must be from 1 to 120")
    return number


def run(arguments: argparse.Namespace) -> int:
    """Write what is wanted.

    Returns:
        The exit code: 130 if it was interrupted.

    Raises:
        UsarsimError: the run cannot be shown, or the file not be written.
    """
    from usarsim_exploration.showing import films
    from usarsim_exploration.showing.picture import overlays_of
    from usarsim_server.base.extras import need

    if arguments.browser == (arguments.out is not None):
        cure = "FILE.png, FILE.mp4, FILE.gif or a folder"
        raise UsarsimError(f"--out: say what to write, {cure}; or give --browser instead")
    if arguments.browser:
        need("aiohttp", extra="console", asker="--browser")
        tape = _tape(arguments)
        serve(tape, partial(forward, tape, None), arguments.port)
        return 0
    films.prepare(arguments.out)
    overlays = overlays_of(arguments.overlays)
    tape = _tape(arguments)
    looks = films.Looks(overlays, robot_of(tape, arguments.robot))
    if arguments.out.suffix.lower() == ".png":
        forward(tape, arguments.step)
        films.write_picture(tape, looks, arguments.step, arguments.out)
        return 0
    if arguments.step is not None:
        raise UsarsimError("--step: belongs to a picture (name it FILE.png)")
    forward(tape, None)
    return films.write_many(tape, looks, arguments.out, arguments.every, arguments.fps)


def _tape(arguments: argparse.Namespace) -> Tape:
    """That of a run by itself, or of one of a batch, at its start.

    Raises:
        UsarsimError: a file cannot be used, or the batch has no such run.
    """
    from usarsim_exploration.batches.batch_folder import read_result
    from usarsim_exploration.batches.verifying import Verification
    from usarsim_exploration.running import Run
    from usarsim_exploration.showing.tape import Tape, tape_of

    path: Path = arguments.folder
    if arguments.key is None:
        return tape_of(path, from_log=arguments.from_log, code=arguments.run_code)
    if arguments.from_log:
        raise UsarsimError("--from-log: batches keep no logs (leave it out)")
    files, code = arguments.files or path.parent, arguments.run_code
    batch = Verification(read_result(path), path, files, code=code)
    return Tape(Run(batch.named([arguments.key])[0].scenario()))


def robot_of(tape: Tape, name: str | None) -> int | None:
    """The number of a robot, or of the base.

    Raises:
        UsarsimError: there is none of that name.
    """
    if name is None:
        return None
    known = {one.lower(): number for number, one in enumerate(tape.names)}
    if name.lower() not in known:
        raise UsarsimError(f"--robot: {name} is not there (choose among {', '.join(tape.names)})")
    return known[name.lower()]


def can_serve() -> bool:
    """Whether there can be a page."""
    return importlib.util.find_spec("aiohttp") is not None


def serve(tape: Tape, work: Callable[[GoesOn], object], port: int = 0) -> None:
    """Serve the page of a tape until interrupted, while something drives the tape.

    Args:
        work: is given what says whether to go on. port: 0 is any free one.

    Raises:
        UsarsimError: of the work, or the port cannot be had.
    """
    from usarsim_exploration.showing.page import show
    from usarsim_report.serving import until_interrupted

    asyncio.run(until_interrupted(show(tape, work, port)))


def forward(tape: Tape, step: int | None, goes_on: GoesOn = lambda: True) -> None:
    """Run to a step, or to the end; tells on a terminal how far it is.

    Args:
        goes_on: whether somebody still wants it.

    Raises:
        UsarsimError: the run ends before.
    """
    told = sys.stderr.isatty()
    while goes_on() and (step is None or len(tape) <= step) and tape.advance():
        if told and len(tape) % 25 == 0:
            print(f"\rstep {len(tape) - 1}", end="", file=sys.stderr)
    if told:
        print("\r\033[K", end="", file=sys.stderr)
    if step is not None and len(tape) <= step:
        raise UsarsimError(f"--step: {step} does not come (the run ends after {len(tape) - 1})")
