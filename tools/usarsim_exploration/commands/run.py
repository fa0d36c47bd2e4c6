"""`usarsim explore run`: one run, with its results in a folder."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from usarsim_server.cli.common import Subparsers, add_command

_EPILOG = (
    "SCENARIO is a TOML file, see docs/exploration.md; options say what it does not say, or say it "
    "otherwise, so a run needs no file at all. The folder gets run.json (scenario, end, measures: "
    "the same bytes for the same scenario), timing.json, steps.csv, agents.csv, map.png, and "
    "scenario.toml, which repeats the run."
)
_OPTIONS = {
    "world": ("environment.name", "NAME", "shipped environment, or a map file"),
    "robots": ("team.robots", "N", "robots beside the base"),
    "strategy": ("strategy.name", "NAME", "strategy, or FILE.py:CLASS"),
    "radio": ("radio.model", "NAME", "radio model"),
    "seed": ("seed", "N", "of all that strategies draw"),
    "steps": ("end.steps", "N", "most steps of the run"),
}
_TOLD = 25
"""Steps between two lines of progress on a terminal."""


def add_parser(subparsers: Subparsers) -> None:
    """Add `run`."""
    text = "explore one environment with one team"
    parser = add_command(subparsers, "run", text, run, epilog=_EPILOG)
    parser.add_argument("scenario", metavar="SCENARIO", nargs="?", type=Path, help="TOML file")
    for name, (_, metavar, help) in _OPTIONS.items():
        parser.add_argument(f"--{name}", metavar=metavar, help=help)
    parser.add_argument(
        "--set",
        metavar="TABLE.KEY=VALUE",
        action="append",
        default=[],
        help="any key of a scenario, such as strategy.replan=20; may be repeated",
    )
    parser.add_argument("--out", metavar="DIR", type=Path, help="folder of the results")


def options_of(arguments: argparse.Namespace) -> list[str]:
    """What the options set, as `TABLE.KEY=VALUE`."""
    given = [
        f"{key}={_quoted(value) if metavar == 'NAME' else value}"
        for name, (key, metavar, _) in _OPTIONS.items()
        if (value := getattr(arguments, name)) is not None
    ]
    return [*given, *arguments.set]


def _quoted(text: str) -> str:
    from usarsim_server.toml import toml_text

    return toml_text({"name": text}).removeprefix("name = ").strip()


def run(arguments: argparse.Namespace) -> int:
    """Run, write the folder, print one line.

    Raises:
        UsarsimError: the scenario cannot be used, or the folder not be written.
    """
    from usarsim_exploration import run_folder
    from usarsim_exploration.running import Run
    from usarsim_exploration.scenario import load, merge, read
    from usarsim_exploration.timing import Watch

    watch = Watch()
    options = options_of(arguments)
    scenario = load(arguments.scenario, options) if arguments.scenario else read(merge({}, options))
    if arguments.out is not None:
        run_folder.prepare(arguments.out)
    one = Run(scenario, watch.begin)
    told = sys.stderr.isatty()
    while one.step():
        if told and one.cycle.step % _TOLD == 0:
            share = 100 * one.recorder.free_team / one.recorder.reachable
            print(f"\rstep {one.cycle.step}, {share:.0f} % known", end="", file=sys.stderr)
    if told:
        print("\r\033[K", end="", file=sys.stderr)
    result = one.result()
    timing = watch.facts(result.history.steps)
    if arguments.out is not None:
        run_folder.write(result, arguments.out, timing)
    print(run_folder.line(result, timing))
    return 0
