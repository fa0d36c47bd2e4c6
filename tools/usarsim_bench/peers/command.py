"""`usarsim bench peers`: the same work done by other simulators, beside our own."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

from usarsim_bench.figures import Plan, Report
from usarsim_server import __version__
from usarsim_server.cli.common import Subparsers, add_command
from usarsim_server.errors import UsarsimError

_EPILOG = (
    "Each of them is installed by pip into an environment of its own, which needs the network. "
    "What cannot be installed here is left out, and the report says why."
)


def add_peers(
    kinds: Subparsers,
    add_options: Callable[[argparse.ArgumentParser], None],
    hand_out: Callable[[Report, argparse.Namespace], int],
) -> None:
    """Add `peers` to the measurements.

    Args:
        kinds: the measurements of `usarsim bench`.
        add_options: adds the options that all of them have.
        hand_out: prints a report, writes it to the files asked for, returns the exit code.
    """

    def run(arguments: argparse.Namespace) -> int:
        return hand_out(_compared(arguments), arguments)

    parser = add_command(
        kinds, "peers", "the same work done by other simulators", run, epilog=_EPILOG
    )
    add_options(parser)
    parser.add_argument(
        "--only", metavar="NAME", action="append", help="compare with this one; may be repeated"
    )
    parser.add_argument(
        "--keep",
        metavar="DIR",
        type=Path,
        help="keep their environments there and use them again (default: thrown away)",
    )


def _compared(arguments: argparse.Namespace) -> Report:
    from usarsim_bench.peers.comparing import compare
    from usarsim_bench.server import BenchError

    if hasattr(arguments, "world"):
        raise UsarsimError("--world: all simulators get the same hall (leave the option out)")
    plan = Plan(
        robots=getattr(arguments, "robots", None),
        seconds=getattr(arguments, "seconds", None),
        say=_say,
    )
    try:
        return compare(plan, __version__, tuple(arguments.only or ()), arguments.keep)
    except BenchError as error:
        raise UsarsimError(str(error)) from error


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
