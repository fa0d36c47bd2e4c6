"""`usarsim console`: the operator console in a browser, for a server that runs."""

from __future__ import annotations

import argparse
import asyncio
import math
import os
import sys
from pathlib import Path

from usarsim_operator import demo
from usarsim_operator.impairment import read_plan
from usarsim_operator.roles import Role
from usarsim_operator.serving import (
    Serving,
    add_page_options,
    has_page,
    need,
    port_number,
    serve,
)
from usarsim_operator.signals import BASE
from usarsim_report.serving import until_interrupted
from usarsim_server.base.addresses import bare_host, split_address
from usarsim_server.base.private import secret
from usarsim_server.cli.common import Subparsers, add_command

_EPILOG = (
    "Prints one line CONSOLE http://HOST:PORT/#TOKEN per role when ready. Works with every server "
    "of the protocol; what a server lacks is off. Robots of this console leave the world when it "
    "ends, however it ends."
)


def add_parser(subparsers: Subparsers) -> None:
    """Add `console`."""
    parser = add_command(
        subparsers, "console", "drive robots of a server from the browser", run, epilog=_EPILOG
    )
    parser.add_argument(
        "--connect",
        metavar="HOST:PORT",
        type=_address,
        default=("127.0.0.1", 3000),
        help="robot control of the server (default 127.0.0.1:3000)",
    )
    parser.add_argument(
        "--image-port",
        metavar="N",
        type=port_number,
        default=5003,
        help="its images (default 5003)",
    )
    parser.add_argument(
        "--scene-port",
        metavar="N",
        type=port_number,
        help="its scene port: the true world for instructors and viewers (default none)",
    )
    parser.add_argument(
        "--scene-token",
        metavar="TEXT|FILE",
        default="",
        help="what its scene port wants to be told; in a file others do not see it in `ps`",
    )
    parser.add_argument(
        "--wireless-port",
        metavar="N",
        type=port_number,
        help="its wireless simulation: robots of this console register there, and pages show "
        "their signal (default none)",
    )
    parser.add_argument(
        "--base",
        metavar="NAME",
        default=BASE,
        help=f"name of the operator's base, whose signal that is (default {BASE})",
    )
    parser.add_argument(
        "--console-host",
        metavar="ADDR",
        type=bare_host,
        default="127.0.0.1",
        help="address to serve pages at (default 127.0.0.1)",
    )
    parser.add_argument(
        "--allow-host",
        metavar="HOST:PORT",
        action="append",
        default=[],
        help="a further name under which browsers reach this console; may be repeated",
    )
    parser.add_argument(
        "--robot",
        metavar="CLASS[=NAME]",
        action="append",
        default=[],
        help="a robot to begin with; may be repeated",
    )
    parser.add_argument(
        "--latch",
        metavar="FILE",
        type=Path,
        help="keeps an emergency stop over a restart (default in the user's state folder)",
    )
    parser.add_argument(
        "--tiles",
        metavar="CxR",
        type=_grid,
        help="columns and rows of the pictures of a server that does not tell where they are",
    )
    parser.add_argument(
        "--spectator",
        metavar="X,Y,W,H",
        type=_tile,
        help="part of the picture of the image port that shows the world from outside, pixels: "
        "for pages of instructors and viewers that have no WebGL",
    )
    parser.add_argument(
        "--impair",
        metavar="FILE",
        type=Path,
        help="make the links to pages as bad as this file says: delay, jitter, loss, bandwidth",
    )
    parser.add_argument(
        "--lockstep",
        action="store_true",
        help="the server is in lockstep: this console lets its time pass (without this option that "
        "is found out by the first robot)",
    )
    parser.add_argument(
        "--pace",
        metavar="N|max",
        type=_pace,
        default=1.0,
        help="simulated s per s in lockstep (default 1, for people)",
    )
    add_page_options(parser)
    parser.add_argument(
        "--demo", action="store_true", help="as `usarsim demo`: with a server of its own"
    )
    demo.add_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Serve pages until interrupted.

    Raises:
        UsarsimError: if the server is not there or the port cannot be had.
    """
    if arguments.demo:
        return demo.run(arguments)
    need(arguments)
    if not has_page():
        print("the page was not built; programs can connect (cure: make page)", file=sys.stderr)
    from usarsim_operator.station import Settings

    host, port = arguments.connect
    settings = Settings(
        host,
        port,
        arguments.image_port,
        None if arguments.scene_port is None else (host, arguments.scene_port),
        secret(arguments.scene_token),
        arguments.latch or _latch(host, port),
        arguments.viewer_delay,
        None if arguments.impair is None else read_plan(arguments.impair),
        arguments.tiles,
        arguments.spectator,
        arguments.wireless_port,
        arguments.base,
        arguments.lockstep,
        arguments.pace,
    )
    serving = Serving(
        arguments.console_host,
        8080 if arguments.console_port is None else arguments.console_port,
        frozenset(arguments.allow_host),
        None if arguments.no_browser else Role.OPERATOR,
        arguments.robot,
        arguments.record,
        arguments.tokens,
    )
    asyncio.run(until_interrupted(serve(settings, serving)))
    return 0


def _latch(host: str, port: int) -> Path | None:
    base = os.environ.get("XDG_STATE_HOME") or os.path.expanduser("~/.local/state")
    folder = Path(base) / "usarsim"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return folder / f"estop-{host.replace(':', '_').replace('/', '_')}-{port}.json"


def _pace(text: str) -> float:
    pace = math.inf if text == "max" else float(text)
    if not pace > 0.0:
        raise argparse.ArgumentTypeError("must be above 0, or max")
    return pace


def _grid(text: str) -> tuple[int, int]:
    columns, x, rows = text.partition("x")
    if not (x and columns.isdecimal() and rows.isdecimal() and int(columns) and int(rows)):
        raise argparse.ArgumentTypeError("must be COLUMNSxROWS, as 2x2")
    return int(columns), int(rows)


def _tile(text: str) -> tuple[int, int, int, int]:
    parts = text.split(",")
    if len(parts) != 4 or not all(part.isdecimal() for part in parts):
        raise argparse.ArgumentTypeError("must be X,Y,WIDTH,HEIGHT in pixels")
    x, y, width, height = map(int, parts)
    return x, y, width, height


def _address(text: str) -> tuple[str, int]:
    host, port = split_address(text)
    if not host:
        raise argparse.ArgumentTypeError("must be HOST:PORT")
    return host, port_number(port)
