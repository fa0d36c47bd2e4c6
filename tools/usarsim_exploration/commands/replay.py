"""`usarsim explore replay`: a log runs again."""

from __future__ import annotations

import argparse
from pathlib import Path

from usarsim_exploration.commands import add_run_code
from usarsim_server.cli.common import Subparsers, add_command

_EPILOG = (
    "DIR is the folder of a run. Robots drive, scan and speak as its log says, and nobody decides; "
    "the same comes out, and the command says so, or where the first difference is (exit code 1). "
    "With --radio or --set one sees what else the base would have learnt. --log reads an agent log "
    "of MRESim instead, of 6 or 7 values per robot, in the scenario of DIR."
)


def add_parser(subparsers: Subparsers) -> None:
    """Add `replay`."""
    parser = add_command(subparsers, "replay", "run a log again", run, epilog=_EPILOG)
    parser.add_argument("folder", metavar="DIR", type=Path, help="folder with scenario.toml")
    parser.add_argument("--log", metavar="FILE", type=Path, help="agent log of MRESim")
    parser.add_argument("--radio", metavar="NAME", help="another radio model")
    parser.add_argument(
        "--set",
        metavar="TABLE.KEY=VALUE",
        action="append",
        default=[],
        help="another key of the scenario; may be repeated",
    )
    parser.add_argument("--out", metavar="DIR", type=Path, help="folder of the results")
    add_run_code(parser)


def run(arguments: argparse.Namespace) -> int:
    """Replay, write the folder, print one line; returns the exit code.

    Raises:
        UsarsimError: scenario or log cannot be used.
    """
    from usarsim_exploration import run_folder
    from usarsim_exploration.log_files import first_difference, read_history
    from usarsim_exploration.replaying import log_of, read_mresim_log, replay
    from usarsim_exploration.timing import Watch

    watch = Watch()
    options = [f'radio.model="{arguments.radio}"'] if arguments.radio else []
    options += arguments.set
    scenario = run_folder.load_run(arguments.folder, options, code=arguments.run_code)
    before = None
    if arguments.log is not None:
        log = read_mresim_log(arguments.log, scenario.world.environment)
    else:
        before = read_history(arguments.folder, scenario.rules, 0)
        log = log_of(before)
    result = replay(scenario, log, watch.begin)
    timing = watch.facts(result.history.steps)
    if arguments.out is not None:
        run_folder.write(result, arguments.out, timing)
    print(run_folder.line(result, timing))
    if before is None or options:
        return 0
    if (backend := scenario.basics.backend) != "grid":
        print(
            f"{arguments.folder}: numbers are not compared, for robots of {backend} scan elsewhere"
        )
        return 0
    difference = first_difference(before, result.history)
    print(f"{arguments.folder}: {difference or 'the same'}")
    return 1 if difference else 0
