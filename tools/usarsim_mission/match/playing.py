"""What `usarsim mission run` does: one run in this process, or a batch of them."""

from __future__ import annotations

import argparse
import asyncio
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

from usarsim_mission.errors import MissionError
from usarsim_mission.league.gathering import flaw_of
from usarsim_mission.match.archive import write_archive
from usarsim_mission.match.batch import GRACE, Batch, Job, finish
from usarsim_mission.match.conditions import Conditions
from usarsim_mission.match.report import REPORT, write_report
from usarsim_mission.match.team import DEMO, Team, read_team
from usarsim_mission.match.trial import Trial
from usarsim_mission.plan import Plan, PlannedTeam, digest, folder_name, write_plan
from usarsim_mission.records import Record
from usarsim_mission.scenario.check import cautions
from usarsim_mission.scenario.description import Scenario
from usarsim_mission.scenario.reader import find_mission, read_scenario
from usarsim_mission.scenario.resolving import stage
from usarsim_mission.scoring import find_rules
from usarsim_operator.serving import Serving
from usarsim_report.serving import until_interrupted
from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.toml import read_text, toml_text


def play(arguments: argparse.Namespace) -> int:
    """Run one mission, or a batch; returns the exit code.

    Args:
        arguments: of `usarsim mission run`.

    Raises:
        UsarsimError: a file cannot be used, or a run cannot begin.
    """
    teams: list[Team] = [read_team(path) for path in arguments.team]
    if arguments.demo:
        teams.append(DEMO)
    if not teams:
        raise MissionError("nobody drives (name a --team, or say --demo)")
    scenario = read_scenario(find_mission(arguments.mission))
    if arguments.time_limit is not None:
        if not 0.0 < arguments.time_limit <= 1e6:
            raise UsarsimError("--time-limit: must be more than 0")
        content = {**(scenario.content or {}), "time_limit": arguments.time_limit}
        scenario = replace(scenario, time_limit=arguments.time_limit, content=content)
    if any(team.brings_robots for team in teams):
        for caution in cautions(scenario):
            print(f"note: {caution}", file=sys.stderr)
    listed = [*arguments.seed, *(seed for several in arguments.seeds for seed in several)]
    seeds = list(dict.fromkeys(listed)) or [scenario.seed]
    if arguments.seeds or len(teams) * len(seeds) > 1:
        return _run_batch(arguments, scenario, teams, seeds)
    result: dict[str, Any] = {}
    asyncio.run(until_interrupted(_run_one(arguments, scenario, teams[0], seeds[0], result), GRACE))
    return 0 if result and not flaw_of(result) else 1


async def _run_one(
    arguments: argparse.Namespace,
    scenario: Scenario,
    team: Team,
    seed: int,
    result: dict[str, Any],
) -> None:
    staged = stage(scenario, seed=seed, robots=tuple(arguments.robots))
    team.check(staged.robots)
    folder = arguments.out
    print(f"MISSION {scenario.name} team {team.name} seed {seed} in {folder}", flush=True)
    conditions = Conditions(
        folder,
        arguments.speed or ("max" if team is DEMO else "1"),
        Serving("127.0.0.1", arguments.console_port),
        _Progress(),
    )
    trial = Trial(staged, team, conditions)
    try:
        result |= await trial.run()
    finally:
        if trial.result:  # of one that was interrupted, too
            _write(folder, trial.result)


def _write(folder: Path, result: dict[str, Any]) -> None:
    """Report and archive of a run, and a line of how it went."""
    write_report(folder, result)
    archive = write_archive(folder)
    print(f"REPORT {folder / REPORT} ARCHIVE {archive}", flush=True)
    values = result["values"]
    print(
        f"SCORE {result['total']:g}, {values['VF']:g} of {values['V']:g} victims found, "
        f"{values['VC']:g} credited, {flaw_of(result) or 'ended by ' + result['ended']['why']}",
        flush=True,
    )


def _run_batch(
    arguments: argparse.Namespace, scenario: Scenario, teams: list[Team], seeds: list[int]
) -> int:
    """Each team and seed in a process and a folder of its own."""
    names = [folder_name(team.name) for team in teams]
    if twice := [name for name in names if names.count(name) > 1]:
        raise MissionError(f"two teams are called {twice[0]} (give one another name)")
    jobs = arguments.jobs
    if jobs > 1 and any(team.wait for team in teams):
        raise MissionError("--jobs: controllers that you start find one run at a time (say 1)")
    if jobs > 1 and arguments.console_port:
        raise MissionError("--jobs: one port is no port for several consoles (leave it out)")
    if jobs > 1 and any(team.hand_in and "{run}" not in team.hand_in for team in teams):
        raise MissionError('--jobs: runs hand in to one folder (write hand_in = "{run}/results")')
    staged = stage(scenario, seed=seeds[0], robots=tuple(arguments.robots))  # errors come now
    for team in teams:
        team.check(staged.robots)
    path, _ = find_rules(scenario.scoring, scenario.path.parent)
    rules = read_text(path, MissionError)
    told = {key: one for key, one in (scenario.content or {}).items() if key != "seed"}
    members = tuple(PlannedTeam(team.name, _digest(team)) for team in teams)
    plan = Plan(scenario.name, digest(toml_text(told), rules), teams=members, seeds=tuple(seeds))
    write_plan(arguments.out, plan)
    words = [arguments.mission]
    words += [f"--robots={folder}" for folder in arguments.robots]
    for flag in ("speed", "time_limit", "console_port"):
        if value := getattr(arguments, flag):
            words.append(f"--{flag.replace('_', '-')}={value}")
    batch = Batch(
        [
            Job(
                team.name,
                seed,
                arguments.out / plan.folder(team.name, seed),
                (*words, "--demo" if team is DEMO else f"--team={team.path}", f"--seed={seed}"),
            )
            for seed in seeds
            for team in teams
        ],
        jobs,
        _say,
    )
    asyncio.run(until_interrupted(batch.play(), GRACE + 10.0))
    return finish(plan, arguments.out, batch, _say)


def _digest(team: Team) -> str:
    """Of what its file says, whatever its comments."""
    if team is DEMO:
        return digest(repr(team))
    return digest(toml_text(tomllib.loads(read_text(team.path, MissionError))))


def _say(line: str) -> None:
    print(line, flush=True)


class _Progress:
    """Says once a simulated minute how a run goes."""

    def __init__(self) -> None:
        self._due = 0.0

    def __call__(self, record: Record) -> None:
        kind, time = record["kind"], record["t_sim"]
        if kind == "score" and time >= self._due:
            self._due = time + 60.0
            values = record["values"]
            found = f"{values['VF']:g} of {values['V']:g} found"
            print(f"  {time:7.1f} s  score {record['total']:g}, {found}", file=sys.stderr)
        elif kind in ("found", "lost", "error"):
            facts = ", ".join(
                f"{record[key]}" for key in ("victim", "robot", "why", "text") if record.get(key)
            )
            print(f"  {time:7.1f} s  {kind}: {facts}", file=sys.stderr)
