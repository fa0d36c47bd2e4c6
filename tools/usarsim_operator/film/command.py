"""`usarsim film`: an MP4 of a recorded console session, from any viewpoint."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.interrupts import calling
from usarsim_server.cli.common import Subparsers, add_command

if TYPE_CHECKING:
    from usarsim_operator.film.story import Survey
    from usarsim_operator.film.views import View
    from usarsim_operator.recording import Recording
    from usarsim_report.films import Frame

_EPILOG = (
    "Views: orbit, around all robots; top, a map; follow:ROBOT, from behind; first:ROBOT, from its "
    "front; camera:ROBOT, the pictures that its camera took. Or --eye and --at, in the wire frame, "
    "as INIT takes them: x forward, y right, z down, in m; join what begins with a minus sign: "
    "--eye=-3,0,-2. Ctrl-C ends the film with what was drawn so far."
)
_LONGEST = 24 * 3600.0  # s of film
_ABSENT = ("orbit", "top", "follow:ROBOT", "first:ROBOT", "camera:ROBOT")


def add_parser(subparsers: Subparsers) -> None:
    """Add `film`."""
    text = "draw a film of a session that `usarsim console --record` recorded"
    parser = add_command(subparsers, "film", text, run, epilog=_EPILOG)
    parser.add_argument("recording", metavar="RECORDING", type=Path, help="file to read")
    parser.add_argument("--out", metavar="FILE.mp4", type=Path, required=True, help="file to write")
    parser.add_argument("--view", help="from where (default orbit); see below")
    parser.add_argument("--eye", metavar="X,Y,Z", type=_place, help="a place to look from")
    parser.add_argument("--at", metavar="X,Y,Z", type=_place, help="and to look to")
    parser.add_argument(
        "--from", metavar="S", type=float, dest="begin", help="simulated time to begin at"
    )
    parser.add_argument("--to", metavar="S", type=float, dest="end", help="and to end at")
    parser.add_argument(
        "--size", metavar="WxH", type=_size, default=(960, 540), help="pixels (default 960x540)"
    )
    parser.add_argument(
        "--fps",
        metavar="N",
        type=_number(1.0, 120.0),
        default=30.0,
        help="frames a second (default 30)",
    )
    parser.add_argument(
        "--speed",
        metavar="F",
        type=_number(0.01, 1000.0),
        default=1.0,
        help="simulated s in a second of film (default 1)",
    )


def run(arguments: argparse.Namespace) -> int:
    """Draw and write the film.

    Returns:
        The exit code: 130 if it was interrupted.

    Raises:
        UsarsimError: for a recording, an option or a file that cannot be used.
    """
    from usarsim_operator.film.story import survey
    from usarsim_operator.recording import Recording
    from usarsim_report.films import write_film

    out: Path = arguments.out
    if out.suffix.lower() != ".mp4":
        raise UsarsimError(f"--out: {out} is no MP4 (name it FILE.mp4)")
    stopped: list[bool] = []
    with calling(lambda: stopped.append(True)):
        recording = Recording(arguments.recording)
        found = survey(recording)
        kind, robot, view = _view(arguments, found)
        first, last = _span(arguments, found, kind, robot)
        step = arguments.speed / arguments.fps
        count = math.floor((last - first) / step + 1e-6) + 1
        if count / arguments.fps > _LONGEST:
            raise UsarsimError("the film would be longer than a day (choose --from, --to, --speed)")
        times = ((number / arguments.fps, first + number * step) for number in range(count))
        frames = _frames(recording, found, view, robot, arguments.size, times)
        drawn = write_film(out, frames, count, arguments.fps, arguments.size, stopped)
    print(f"{out}: {drawn} frames, {drawn / arguments.fps:.1f} s")
    return 130 if stopped else 0


def _frames(
    recording: Recording,
    found: Survey,
    view: View | None,
    robot: str,
    size: tuple[int, int],
    times: Iterator[tuple[float, float]],
) -> Iterator[Frame]:
    from usarsim_operator.film import drawing

    if view is None:
        return drawing.taken(recording, robot, size, times)
    return drawing.drawn(recording, found, view, times)


def _view(arguments: argparse.Namespace, found: Survey) -> tuple[str, str, View | None]:
    """Kind of the view, its robot, and the view itself; None for recorded pictures."""
    from usarsim_operator.film.views import First, Fixed, Follow, Orbit, Top

    size = arguments.size
    kind, _, name = (arguments.view or "orbit").partition(":")
    if (arguments.eye is None) != (arguments.at is None):
        raise UsarsimError("--eye and --at belong together")
    if arguments.eye is not None and arguments.view is not None:
        raise UsarsimError("--view and --eye exclude each other")
    if kind not in ("orbit", "top", "follow", "first", "camera") or bool(name) != (
        kind in ("follow", "first", "camera")
    ):
        raise UsarsimError(f"--view: {arguments.view!r} is none of {', '.join(_ABSENT)}")
    if kind != "camera" and not math.isfinite(found.first):
        raise UsarsimError(
            f"{arguments.recording}: has no poses, only pictures (record a console that has "
            "--scene-port, or choose --view camera:ROBOT)"
        )
    known = {one.lower(): one for one in (found.cameras if kind == "camera" else found.robots)}
    if name and name.lower() not in known:
        there = ", ".join(known.values()) or "nobody"
        raise UsarsimError(f"--view: {name} is not in the recording ({kind}: {there})")
    robot = known.get(name.lower(), "")
    if arguments.eye is not None:
        try:
            return "eye", "", Fixed(arguments.eye, arguments.at, size)
        except ValueError:
            raise UsarsimError("--eye and --at must be two places") from None
    match kind:
        case "orbit":
            return kind, "", Orbit(found, size)
        case "top":
            return kind, "", Top(found, size)
        case "follow":
            return kind, robot, Follow(robot, size)
        case "first":
            return kind, robot, First(robot, found.reader, size)
        case _:
            return kind, robot, None


def _span(
    arguments: argparse.Namespace, found: Survey, kind: str, robot: str
) -> tuple[float, float]:
    """Simulated times of the first and the last frame; of a robot, when it is there."""
    there = found.first, found.last
    if robot:
        there = (found.cameras if kind == "camera" else found.robots)[robot]
    first = there[0] if arguments.begin is None else max(arguments.begin, there[0])
    last = there[1] if arguments.end is None else min(arguments.end, there[1])
    if not first <= last:
        raise UsarsimError(
            f"there is nothing between --from and --to (the recording has {there[0]:.1f} s to "
            f"{there[1]:.1f} s)"
        )
    return first, last


def _place(text: str) -> tuple[float, float, float]:
    """A place in the wire frame as one of MuJoCo's."""
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError("must be three numbers: x,y,z") from None
    if not all(map(math.isfinite, (x, y, z))):
        raise argparse.ArgumentTypeError("must be three numbers: x,y,z")
    from usarsim_server.simulation.frames import flip_point

    return flip_point((x, y, z))


def _size(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d+)x(\d+)", text)
    width, height = (int(part) for part in found.groups()) if found else (0, 0)
    if not (16 <= width <= 4096 and 16 <= height <= 4096) or width % 2 or height % 2:
        raise argparse.ArgumentTypeError("must be WxH, even numbers from 16 to 4096")
    return width, height


def _number(least: float, most: float):  # type: ignore[no-untyped-def]
    def read(text: str) -> float:
        number = float(text)
        if not least <= number <= most:
            raise argparse.ArgumentTypeError(f"must be from {least:g} to {most:g}")
        return number

    return read
