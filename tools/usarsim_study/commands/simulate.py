"""`usarsim study simulate`: a study with synthetic participants, before the first real one."""

from __future__ import annotations

import argparse
import os
from statistics import fmean

from usarsim_server.cli.common import Subparsers, add_command, facts, table
from usarsim_server.errors import UsarsimError
from usarsim_server.extras import need
from usarsim_study.study_file import find_study, read_study

_EPILOG = (
    "Participants are those of `run --scripted`, their robots points without mass on the plan of "
    "the building. Exit code 1 where a fault of the protocol is found."
)
MOST_REPEATS = 100_000


def add_parser(subparsers: Subparsers) -> None:
    """Add `simulate`."""
    text = "power and faults of a study by synthetic participants"
    parser = add_command(subparsers, "simulate", text, run, epilog=_EPILOG)
    parser.add_argument("study", metavar="NAME|FILE", help="a shipped study, a file, or a folder")
    parser.add_argument(
        "--participants", metavar="N", type=int, help="of each study (default as planned)"
    )
    parser.add_argument(
        "--repeats", metavar="R", type=int, default=1000, help="studies to judge (default 1000)"
    )
    parser.add_argument(
        "--pool", metavar="N", type=int, help="participants who drive (default as planned)"
    )
    parser.add_argument(
        "--advantage", metavar="A", type=float, help="of the gamepad in speed (default 1.1)"
    )
    parser.add_argument("--null", action="store_true", help="no device has an advantage")
    parser.add_argument("--trial-seconds", metavar="S", type=float, help="no trial is longer")
    parser.add_argument(
        "--jobs", metavar="N", type=int, default=os.cpu_count() or 1, help="processes at a time"
    )


def run(arguments: argparse.Namespace) -> int:
    """Simulate, print, and say whether the protocol holds.

    Raises:
        UsarsimError: the study cannot be run, an option cannot be obeyed, or the extra is missing.
    """
    need("scipy", "matplotlib", extra="study", asker="the simulation")
    from usarsim_study.layouts import look
    from usarsim_study.scripted.simulation import Plan, drive_all, faults, minutes, power
    from usarsim_study.scripted.skill import ADVANTAGE, planted

    path = find_study(arguments.study)
    study = read_study(path)
    look(study, path)
    n = _most(arguments.participants, study.participants, 1000, "--participants")
    pool = _most(arguments.pool, study.participants, 1000, "--pool")
    repeats = _most(arguments.repeats, 1000, MOST_REPEATS, "--repeats")
    jobs = _most(arguments.jobs, 1, 256, "--jobs")
    told = ADVANTAGE if arguments.advantage is None else arguments.advantage
    advantage = 0.0 if arguments.null else told
    if not 0.0 <= advantage <= 1.5:
        raise UsarsimError("--advantage: must be from 0 to 1.5")
    if arguments.trial_seconds is not None and not 0.0 < arguments.trial_seconds <= 1e6:
        raise UsarsimError("--trial-seconds: must be more than 0")
    null, advantage = advantage == 0.0, planted(study, advantage)
    plan = Plan(path, advantage, arguments.trial_seconds)
    driven = drive_all(plan, pool, min(jobs, pool))
    found = power(study, driven, n, repeats, study.seed, exchange=null)
    effect = f"gamepad {advantage:g} faster than the keyboard, of their mean"
    rows: list[tuple[str, object]] = [
        ("participants", f"{n} of a study, {pool} drove"),
        ("planted", effect if advantage else "nothing"),
        ("primary", study.primary),
        ("rejects", f"{100 * found.share:.1f} % of {repeats} studies at {study.alpha:g}"),
    ]
    if found.dz is not None:
        rows.append(("dz", f"{found.dz:.2f}"))
    rows.append(("session", f"{minutes(plan, study, driven):.0f} min without training"))
    print(facts(rows))
    lines = []
    for condition in study.condition:
        mine = [one.values for one in driven if one.condition == condition.name]
        known = [one[study.primary] for one in mine if one.get(study.primary) is not None]
        mean = fmean([one for one in known if one is not None]) if known else float("nan")
        lines.append([condition.name, len(mine), f"{mean:.2f}"])
    print()
    print(table(("condition", "trials", f"mean {study.primary}"), lines))
    wrong = list(dict.fromkeys(faults(plan, study, driven)))
    for one in wrong:
        print(f"FAULT {one}")
    return 1 if wrong else 0


def _most(value: int | None, default: int, most: int, option: str) -> int:
    number = default if value is None else value
    if not 1 <= number <= most:
        raise UsarsimError(f"{option}: must be from 1 to {most}")
    return number
