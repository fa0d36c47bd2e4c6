"""`usarsim explore run`: one run, with its results in a folder."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from usarsim_exploration.commands.show import can_serve, serve
from usarsim_server.base.errors import UsarsimError
from usarsim_server.cli.common import Subparsers, add_command

if TYPE_CHECKING:
    from usarsim_exploration.running import Run
    from usarsim_exploration.timing import Watch

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
    "backend": (
        "backend",
        "NAME",
        "grid, discs (they take room), or server: physics, driven over its ports",
    ),
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
    parser.add_argument(
        "--connect",
        metavar="HOST[:PORT[:WIRELESS]]",
        default="",
        help="server in lockstep with the same world, of backend server; without: one is started",
    )
    parser.add_argument("--out", metavar="DIR", type=Path, help="folder of the results")
    parser.add_argument(
        "--show",
        action="store_true",
        help="show it in a browser while it runs and until Ctrl-C (extra console; without that: "
        "film.mp4 and pictures in DIR)",
    )


def options_of(arguments: argparse.Namespace) -> list[str]:
    """What the options set, as `TABLE.KEY=VALUE`."""
    given = [
        f"{key}={_quoted(value) if metavar == 'NAME' else value}"
        for name, (key, metavar, _) in _OPTIONS.items()
        if (value := getattr(arguments, name)) is not None
    ]
    return [*given, *arguments.set]


def _quoted(text: str) -> str:
    from usarsim_server.base.toml import toml_text

    return toml_text({"name": text}).removeprefix("name = ").strip()


def run(arguments: argparse.Namespace) -> int:
    """Run, write the folder, print one line.

    Returns:
        The exit code: 130 if somebody who watched did not let it end.

    Raises:
        UsarsimError: the scenario cannot be used, or the folder not be written.
    """
    from usarsim_exploration import run_folder
    from usarsim_exploration.running import Run
    from usarsim_exploration.scenario import load, merge, read
    from usarsim_exploration.timing import Watch

    taken = Watch()
    options = options_of(arguments)
    if arguments.scenario:
        scenario = load(arguments.scenario, options)
    elif any(option.startswith("environment") for option in options):
        scenario = read(merge({}, options))
    else:
        cure = "--world NAME, as `usarsim explore list` names them, or a scenario file"
        raise UsarsimError(f"there is nothing to explore (add {cure})")
    for note in scenario.world.notes:
        print(note, file=sys.stderr)
    if arguments.show and arguments.out is None and not can_serve():
        raise UsarsimError(
            "--show: there is no page here (install the extra console), so give --out"
        )
    if arguments.out is not None:
        run_folder.prepare(arguments.out)
    if arguments.connect and scenario.basics.backend != "server":
        raise UsarsimError("--connect: cells need no server (cure: add --backend server)")
    with Run(scenario, taken.begin, arguments.connect) as one:
        if arguments.show:
            return _show(one, arguments.out, taken)
        try:
            _go(one, one.step)
        except UsarsimError as error:
            one.fail(str(error))
            if arguments.out is not None:
                run_folder.write(one.result(), arguments.out, taken.facts(one.cycle.step))
            raise
        _finish(one, arguments.out, taken)
    return 0


def _go(one: Run, step: Callable[[], bool], goes_on: Callable[[], bool] = lambda: True) -> None:
    """Run to the end, or as long as somebody wants it; tells on a terminal how far it is."""
    told = sys.stderr.isatty()
    while goes_on() and step():
        if told and one.cycle.step % _TOLD == 0:
            share = 100 * one.recorder.known_team / one.recorder.reachable
            print(f"\rstep {one.cycle.step}, {share:.0f} % known", end="", file=sys.stderr)
    if told:
        print("\r\033[K", end="", file=sys.stderr)


def _finish(one: Run, out: Path | None, taken: Watch) -> None:
    """Write the folder, print the line."""
    from usarsim_exploration import run_folder

    result = one.result()
    timing = taken.facts(result.history.steps)
    if result.scenario.basics.backend == "server":
        timing["simulator_processor_s"] = one.close()
    if out is not None:
        run_folder.write(result, out, timing)
    print(run_folder.line(result, timing), flush=True)


def _show(one: Run, out: Path | None, taken: Watch) -> int:
    """Run while a page shows it; without pages, write pictures and a film of it."""
    from usarsim_exploration.showing import films
    from usarsim_exploration.showing.tape import Tape

    tape = Tape(one)

    def work(goes_on: Callable[[], bool]) -> None:
        _go(one, tape.advance, goes_on)
        if one.ended is not None:
            _finish(one, out, taken)

    if can_serve():
        serve(tape, work)
        return 0 if one.ended is not None else 130
    assert out is not None
    work(lambda: True)
    looks = films.Looks()
    return films.write_many(tape, looks, out / "pictures") or films.write_many(
        tape, looks, out / "film.mp4"
    )
