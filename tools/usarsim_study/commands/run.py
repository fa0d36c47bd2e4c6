"""`usarsim study run`: leads participants through a study, at pages of a desk."""

from __future__ import annotations

import argparse
import asyncio
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from usarsim_server.base.addresses import bare_host
from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.extras import need
from usarsim_server.cli.common import Subparsers, add_command
from usarsim_study.commands.report import write_reports

if TYPE_CHECKING:
    from usarsim_study.folder import StudyFolder
    from usarsim_study.session.staging import Options

PORT = 8090
"""Of the desk, unless another is named."""
BRIEF = 150.0
"""s of the trials of scripted participants, unless another limit is named."""
_GRACE = 60.0  # s of wall time in which an interrupted trial writes its logs
_EPILOG = (
    "Open the printed addresses: one page for each operator and one for the experimenter, for the "
    "whole session. A session that was cut off, however it was, goes on where it was; a trial that "
    "ran then is void and repeated. Ends with Ctrl-C."
)


def add_parser(subparsers: Subparsers) -> None:
    """Add `run`."""
    text = "lead participants through a study"
    parser = add_command(subparsers, "run", text, run, epilog=_EPILOG)
    parser.add_argument("study", metavar="NAME|FILE", help="a shipped study, a file, or a folder")
    parser.add_argument(
        "--out", metavar="DIR", type=Path, help="folder of the study (default that of the file)"
    )
    parser.add_argument("--participant", metavar="CODE", help="go on with this one")
    parser.add_argument(
        "--sessions", metavar="N", type=int, default=0, help="end after so many (default: never)"
    )
    parser.add_argument(
        "--scripted",
        metavar="N",
        type=int,
        help="N participants made by code, at --speed max unless it is given, and the report",
    )
    parser.add_argument(
        "--hands",
        choices=("browser", "gateway"),
        default="browser",
        help="of scripted participants: at real pages in a browser (default), or without one",
    )
    parser.add_argument(
        "--null",
        action="store_true",
        help="scripted participants have no advantage by any device",
    )
    parser.add_argument(
        "--jobs", metavar="N", type=int, default=2,
        help="so many scripted participants at once (default 2)",
    )  # fmt: skip
    parser.add_argument(
        "--host", type=bare_host, default="127.0.0.1", help="address of the pages (127.0.0.1)"
    )
    parser.add_argument(
        "--port", metavar="N", type=int, default=PORT, help=f"of the pages (default {PORT})"
    )
    parser.add_argument(
        "--panel-port", metavar="N", type=int, default=0,
        help="of the panels (default that after --port, or any; the same for all of them)",
    )  # fmt: skip
    parser.add_argument(
        "--speed", metavar="FACTOR", help="simulated seconds per second, or max (default 1)"
    )
    parser.add_argument(
        "--trial-seconds",
        metavar="S",
        type=float,
        help="no trial is longer (default as missions say; scripted: 150)",
    )
    parser.add_argument(
        "--robots", metavar="DIR", type=Path, action="append", default=[],
        help="folder with further robot files; may be repeated",
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Serve the desk until it is interrupted.

    Raises:
        UsarsimError: the study, a file or an option cannot be used.
    """
    from usarsim_report.serving import until_interrupted
    from usarsim_study.session.opening import open_folder

    need("aiohttp", extra="console", asker="the desk")
    if arguments.host in ("0.0.0.0", "::"):
        cure = "name the address by which participants reach this machine"
        raise UsarsimError(f"--host: {arguments.host} leads nowhere in an address ({cure})")
    if arguments.trial_seconds is not None and not 0.0 < arguments.trial_seconds <= 1e6:
        raise UsarsimError("--trial-seconds: must be more than 0")
    scripted = arguments.scripted is not None
    arguments.speed = arguments.speed or ("max" if scripted else "1")
    if scripted and arguments.trial_seconds is None:
        arguments.trial_seconds = BRIEF
    if scripted and arguments.scripted < 1:
        raise UsarsimError("--scripted: must be 1 or more")
    if arguments.jobs < 1:
        raise UsarsimError("--jobs: must be 1 or more")
    if arguments.speed != "max":
        try:
            fits = 0.0 < float(arguments.speed) <= 1000.0
        except ValueError:
            fits = False
        if not fits:
            raise UsarsimError("--speed: must be a number greater than 0, or max")
    if scripted:
        need("scipy", "matplotlib", extra="study", asker="scripted participants")
    folder = open_folder(arguments.study, arguments.out)
    work = _script(arguments, folder) if scripted else _serve(arguments, folder)
    asyncio.run(until_interrupted(work, _GRACE))
    return write_reports(folder.path) if scripted else 0


def _options(arguments: argparse.Namespace) -> Options:
    from usarsim_study.session.staging import Options

    return Options(
        arguments.speed,
        arguments.trial_seconds,
        arguments.host,
        arguments.panel_port,
        tuple(arguments.robots),
    )


async def _script(arguments: argparse.Namespace, folder: StudyFolder) -> None:
    from usarsim_study.scripted.crowd import run_scripted
    from usarsim_study.scripted.skill import ADVANTAGE

    sessions, jobs = arguments.scripted, min(arguments.jobs, arguments.scripted)
    tasks = [
        asyncio.create_task(
            run_scripted(
                folder,
                _options(arguments),
                sessions // jobs + (job < sessions % jobs),
                hands=arguments.hands,
                advantage=0.0 if arguments.null else ADVANTAGE,
                frames=panel_frames(arguments.host),
            )
        )
        for job in range(jobs)
    ]
    try:
        crowds = await asyncio.gather(*tasks)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    faults = [fault for one in crowds for fault in one.faults]
    for fault in faults:
        print(f"FAULT {fault}", flush=True)
    print(f"SCRIPTED {sessions} participants, {len(faults)} faults", flush=True)


async def _serve(arguments: argparse.Namespace, folder: StudyFolder) -> None:
    from usarsim_study.session.attempt import Runner
    from usarsim_study.session.leading import lead_sessions
    from usarsim_study.session.staging import panel_port
    from usarsim_study.session.web import SEATS, TOKENS, Web, kept_tokens, serving

    pages = Web(kept_tokens(folder.path / TOKENS), panel_frames(arguments.host))
    async with serving(pages, arguments.host, arguments.port) as urls:
        desk = urlsplit(next(iter(urls.values()))).port or 0
        port = panel_port(arguments.host, arguments.panel_port, desk)
        options = replace(_options(arguments), panel_port=port)
        runner = Runner(options, lambda: pages.hosts)
        alone = all(one.operators == "one" for one in folder.study.condition)
        for seat, url in urls.items():
            if seat == 2 and alone:
                continue
            print(f"DESK {url} {SEATS[seat]}", flush=True)
        await lead_sessions(
            folder,
            pages,
            runner,
            code=arguments.participant,
            sessions=arguments.sessions,
            seconds=arguments.trial_seconds,
        )


def panel_frames(host: str) -> str:
    """What the desk's pages may show inside themselves: panels at any port of this machine."""
    names = ["localhost", "127.0.0.1"]
    if host not in (*names, "::1"):
        names.append(host)
    return " ".join(f"http://{name}:*" for name in names)
