"""`usarsim study check`: reads a study file and says who would do what."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from usarsim_server.cli.common import Subparsers, add_command, facts, table
from usarsim_study.misread import CURE, misread
from usarsim_study.study_file import find_study, read_study, words

if TYPE_CHECKING:
    from usarsim_study.layouts import Place


def add_parser(subparsers: Subparsers) -> None:
    """Add `check`."""
    text = "check a study file and show its conditions, orders and forms"
    parser = add_command(subparsers, "check", text, run)
    parser.add_argument("study", metavar="NAME|FILE", help="a shipped study, a file, or a folder")
    parser.add_argument(
        "--without-missions", action="store_true", help="do not look at the missions"
    )


def run(arguments: argparse.Namespace) -> int:
    """Print the plan.

    Raises:
        StudyError: the study cannot be run as it is written.
    """
    path = find_study(arguments.study)
    study = read_study(path)
    places: tuple[Place, ...] = ()
    if not arguments.without_missions:
        from usarsim_study.layouts import look  # worlds are read, robots are looked up

        places = look(study, path)
    trials = len(study.orders[0])
    print(study.title)
    print(
        facts(
            (
                ("conditions", ", ".join(one.name for one in study.condition)),
                ("layouts", ", ".join(one.name for one in study.layout)),
                ("participants", f"{study.participants}, {trials} trials each"),
                (
                    "sequences",
                    f"{len(study.orders)}, for {study.participants // len(study.orders)} each",
                ),
                ("primary", study.primary),
                ("secondary", ", ".join(study.secondary) or "none"),
                ("forms", ", ".join(f"{one.name} ({one.when})" for one in study.form) or "none"),
                ("allocation", study.allocation.digest),
            )
        )
    )
    rows = [
        [number, *(f"{cell.condition} {cell.layout}" for cell in order)]
        for number, order in enumerate(study.orders, start=1)
    ]
    for place, name in words(study):  # of a study that has begun; any other was refused
        if taken := misread(name):
            print(f"WARNING {place}: pandas reads {name!r} as {taken} ({CURE})")
    print()
    print(table(("sequence", *(f"trial {n}" for n in range(1, trials + 1))), rows))
    if places:
        print()
        ways = [[one.layout, one.mission, len(one.ways), f"{one.mean_way:.1f} m"] for one in places]
        print(table(("layout", "mission", "victims", "mean way"), ways))
    return 0
