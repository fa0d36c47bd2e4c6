"""`usarsim explore import`: files of MRESim become scenarios."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from usarsim_server.cli.common import Subparsers, add_command

_EPILOG = (
    "FILE is a team file of MRESim, which needs --map, or a batch file (JSON). Each run becomes a "
    "folder with scenario.toml and its map, ready for `usarsim explore run`; --run runs them at "
    "once. Maps are read by MRESim's rules, and options that ours has not are told. Exit code 1 if "
    "a run failed."
)


def add_parser(subparsers: Subparsers) -> None:
    """Add `import`."""
    text = "turn a team, settings or batch file of MRESim into scenarios"
    parser = add_command(subparsers, "import", text, run, epilog=_EPILOG)
    parser.add_argument("file", metavar="FILE", type=Path, help="team or batch file")
    parser.add_argument("--map", metavar="FILE", type=Path, help="picture or text map, for a team")
    parser.add_argument(
        "--settings", metavar="FILE", type=Path, help="settings of MRESim, 18 or 28 lines"
    )
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="folder to write")
    parser.add_argument("--seed", metavar="N", type=int, default=1, help="of the runs (default 1)")
    parser.add_argument("--run", action="store_true", dest="play", help="run what was imported")


def run(arguments: argparse.Namespace) -> int:
    """Import, and run if wanted; returns the exit code.

    Raises:
        UsarsimError: a file cannot be used; nothing is written then.
    """
    from usarsim_exploration import run_folder, running
    from usarsim_exploration.errors import ExplorationError
    from usarsim_exploration.mresim.batch import is_batch, read_batch
    from usarsim_exploration.mresim.settings import Settings, read_settings
    from usarsim_exploration.mresim.team import read_team
    from usarsim_exploration.scenario import read
    from usarsim_exploration.timing import Watch
    from usarsim_server.base.errors import UsarsimError, at

    file: Path = arguments.file
    frontier = Settings(strategy="FrontierExploration", keep_assigning=True)
    settings = read_settings(arguments.settings) if arguments.settings else frontier
    told: list[str] = []

    def drop(name: str, settings: Settings) -> None:
        told.extend(f"{arguments.out / name}: dropped {one}" for one in settings.dropped)

    if is_batch(file):
        found = read_batch(file, settings, drop)
    elif arguments.map is None:
        raise ExplorationError(at(file, "a team needs a map", "give --map FILE"))
    else:
        drop("", settings)
        place = {"name": str(arguments.map.absolute()), "compat": True}
        found = [("", {"environment": place} | settings.content | read_team(file))]
    scenarios = [(name, read({"seed": arguments.seed} | one, file)) for name, one in found]
    print(*told, sep="\n", end="\n" * bool(told), file=sys.stderr)
    failed = 0
    for name, scenario in scenarios:
        folder = arguments.out / name
        run_folder.write_scenario(scenario, folder)
        print(folder / run_folder.SCENARIO)
        if arguments.play:
            watch = Watch()
            try:
                result = running.run(scenario, watch.begin)
                timing = watch.facts(result.history.steps)
                run_folder.write(result, folder, timing)
                print(run_folder.line(result, timing))
            except UsarsimError as error:
                failed += 1
                print(f"{folder}: {error}", file=sys.stderr)
    return 1 if failed else 0
