"""`usarsim demo`: a server, a wandering robot and the console, by one command."""

from __future__ import annotations

import argparse
import asyncio

from usarsim_operator.roles import Role
from usarsim_operator.serving import (
    Serving,
    add_page_options,
    has_page,
    need,
    serve,
)
from usarsim_report.serving import until_interrupted
from usarsim_server.base.errors import UsarsimError
from usarsim_server.cli.common import Subparsers, add_command

_EPILOG = (
    "Prints one line CONSOLE http://HOST:PORT/#TOKEN per role when ready. Everything is on this "
    "machine only (127.0.0.1), and a standard port that is taken is replaced by a free one. W "
    "drives. Take the wandering robot over; its controller goes on when you hand it back. Ends "
    "with Ctrl-C."
)
_HOST = "127.0.0.1"


def add_parser(subparsers: Subparsers) -> None:
    """Add `demo`."""
    text = "try it: a server, a wandering robot and the console"
    parser = add_command(subparsers, "demo", text, run, epilog=_EPILOG)
    add_options(parser)
    add_page_options(parser)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add what a demo can be told, to `demo` and to `console`."""
    parser.add_argument(
        "--world", metavar="NAME|PATH", default="arena", help="world of a demo (default arena)"
    )
    parser.add_argument(
        "--robots",
        metavar="N",
        type=_count,
        default=1,
        help="robots of a demo to drive, beside the one that wanders (default 1)",
    )


def run(arguments: argparse.Namespace) -> int:
    """Run everything until interrupted.

    Raises:
        UsarsimError: if something is missing, does not begin, or ends by itself.
    """
    need(arguments)
    if not has_page():
        raise UsarsimError(
            "the console's page was not built (cure: make console, or make page, in the clone of "
            "the repository)"
        )
    asyncio.run(until_interrupted(_run(arguments)))
    return 0


async def _run(arguments: argparse.Namespace) -> None:
    from usarsim_operator.programs import ROBOT, free_port, running
    from usarsim_operator.station import Settings

    most = f"--max-robots={max(16, arguments.robots + 1)}"
    async with running(f"--world={arguments.world}", most) as programs:
        settings = Settings(
            _HOST,
            programs.ports["control"],
            programs.ports["images"],
            (_HOST, programs.ports["scene"]),
            programs.token,
            delay=arguments.viewer_delay,
        )
        port = arguments.console_port
        serving = Serving(
            _HOST,
            free_port(8080) if port is None else port,
            browser=None if arguments.no_browser else Role.INSTRUCTOR,
            robots=[f"{ROBOT}=R{number + 1}" for number in range(arguments.robots)],
            record=arguments.record,
            tokens=arguments.tokens,
            then=programs.wander,  # after them: a page is first about the first robot
        )
        pages = asyncio.create_task(serve(settings, serving))
        failed = asyncio.create_task(programs.failed())
        try:
            await asyncio.wait((pages, failed), return_when=asyncio.FIRST_COMPLETED)
            if not failed.done():  # what pages complain of may be due to a program that has died
                await asyncio.wait((failed,), timeout=0.5)
            if failed.done():
                raise failed.result()
            await pages
        finally:
            for task in (pages, failed):
                task.cancel()
            await asyncio.gather(pages, failed, return_exceptions=True)


def _count(text: str) -> int:
    number = int(text)
    if not 0 <= number <= 64:
        raise argparse.ArgumentTypeError(f"must be from 0 to 64, not {number}")
    return number
