"""`usarsim mission replay`: a run played again from its log, to the last bit."""

from __future__ import annotations

import argparse
import asyncio
import tempfile
from pathlib import Path

from usarsim_server.cli.common import Subparsers, add_command

_EPILOG = (
    "Starts a server with the world of the run, and lets everything that pages said count at the "
    "same tick as then. Compares what robots were told, the state of the world every 0.1 s, and "
    "all that the referee made of it. Exit code 1 if anything differs. Runs of teams that bring "
    "robots by programs of their own cannot be replayed."
)


def add_parser(subparsers: Subparsers) -> None:
    """Add `replay`."""
    text = "play a run again from its log, and compare"
    parser = add_command(subparsers, "replay", text, run, epilog=_EPILOG)
    parser.add_argument("folder", metavar="DIR", type=Path, help="folder of a run")
    parser.add_argument(
        "--out", metavar="DIR", type=Path, help="keeps the new run (default: it is thrown away)"
    )
    parser.add_argument(
        "--device",
        choices=("any", "keyboard", "gamepad"),
        help="the only one that drove, of a run whose log does not say it (of a blind study)",
    )
    parser.add_argument(
        "--unattended",
        metavar="POLICY",
        help="what robots did that nobody drove, of such a run, if its condition says it: stop, "
        "hold, patrol, explore, search or a policy of a package",
    )
    parser.add_argument(
        "--robots", metavar="DIR", type=Path, action="append", default=[],
        help="folder with further robot files; may be repeated",
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Replay, and say what differs.

    Raises:
        UsarsimError: the run cannot be played.
    """
    with tempfile.TemporaryDirectory(prefix="usarsim-") as folder:
        return _run(arguments, arguments.out or Path(folder) / "again")


def _run(arguments: argparse.Namespace, out: Path) -> int:
    from usarsim_mission.match.replaying import differences, read_logged, replay
    from usarsim_report.serving import until_interrupted

    then, results = read_logged(arguments.folder), []

    async def play() -> None:
        results.append(
            await replay(
                *(arguments.folder, out, tuple(arguments.robots)),
                *(arguments.device, arguments.unattended),
            )
        )

    asyncio.run(until_interrupted(play()))
    if not results:
        return 1
    found = list(differences(arguments.folder, out))
    for line in found:
        print(line)
    verdict = "not the same" if found else "the same"
    said = sum(one.text is not None for one in then.said)
    print(
        f"{then.last:g} s, {said} inputs, {then.rows} states of the world, "
        f"{results[0]['total']:g} points: {verdict}"
    )
    return 1 if found else 0
