"""How fast a whole trial runs, and how long reports take.

A trial is a server, a gateway with its robots' sensors and policies, a referee and the logs, as
`usarsim mission run --demo` has them. They take turns, in lockstep: so the speed that the time of
processors allows is that of a machine on which nothing else runs, and it can be told on a busy one.
"""

from __future__ import annotations

import asyncio
import tempfile
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

import psutil

from benchmarks.plan import Plan
from usarsim_bench.figures import Aim, Figure
from usarsim_mission.match.archive import write_archive
from usarsim_mission.match.conditions import Conditions
from usarsim_mission.match.report import write_report
from usarsim_mission.match.team import DEMO
from usarsim_mission.match.trial import Trial
from usarsim_mission.records import Record
from usarsim_mission.scenario.reader import find_mission, read_scenario
from usarsim_mission.scenario.resolving import stage
from usarsim_study import report, synthetic, tables
from usarsim_study.dataset import collect
from usarsim_study.folder import values_of

MISSION = "arena-search"
PARTICIPANTS = 40
SPEED_AIM = Aim(">=", 5.0)
REPORT_AIM = Aim("<", 20.0)
_SECONDS = 60.0


@dataclass
class _Meter:
    """Reads clocks when the trial begins and whenever a simulated second is over.

    Attributes:
        readings: simulated time, wall time, processor time of this process and of its children, s.
    """

    readings: list[tuple[float, float, float, float]] = field(default_factory=list)

    def __call__(self, record: Record) -> None:
        if record["kind"] not in ("trial_start", "score"):
            return
        spent = 0.0
        for child in psutil.Process().children(recursive=True):
            times = child.cpu_times()
            spent += times.user + times.system
        now = time.monotonic(), time.process_time(), spent
        self.readings.append((record["t_sim"], *now))

    def spent(self) -> tuple[float, float, float]:
        """Wall time, and time of processors here and in children, for a simulated second."""
        first = self.readings[0]
        last = max(one for one in self.readings if one[3] > 0.0)  # while the server was there
        simulated = last[0] - first[0]
        wall, here, there = (b - a for a, b in zip(first[1:], last[1:], strict=True))
        return wall / simulated, here / simulated, there / simulated


def trial_figures(plan: Plan) -> tuple[Figure, ...]:
    """A trial of `arena-search` with its four robots; `plan.seconds` are simulated."""
    seconds = plan.seconds or _SECONDS
    plan.say(f"a trial of {MISSION} of {seconds:g} s of simulated time")
    scenario = read_scenario(find_mission(MISSION))
    content = {**(scenario.content or {}), "time_limit": seconds}
    scenario = replace(scenario, time_limit=seconds, content=content)
    meter = _Meter()
    with tempfile.TemporaryDirectory() as spare:
        folder = Path(spare) / "run"
        conditions = Conditions(folder, "max", watch=meter)
        result = asyncio.run(Trial(stage(scenario, seed=1), DEMO, conditions).run())
        begun = time.process_time()
        write_report(folder, result)
        write_archive(folder)
        told = time.process_time() - begun
        begun = time.process_time()
        values_of(folder)
        measured = time.process_time() - begun
    wall, here, there = meter.spent()
    return (
        Figure("Trial, to real time", 1.0 / wall, "times as fast", 1, SPEED_AIM),
        Figure(
            "The same by time of processors", 1.0 / (here + there), "times as fast", 1, SPEED_AIM
        ),
        Figure("Server", there, "processor s per simulated s", 3),
        Figure("Gateway, referee and logs", here, "processor s per simulated s", 3),
        Figure("Gateway, referee and logs, to the server", here / there, "times", 2),
        Figure("Report and archive of a trial", told / seconds * 1200.0, "s per 20 minutes", 1),
        Figure("Measures of a trial, once", measured / seconds * 1200.0, "s per 20 minutes", 1),
    )


def study_figures(plan: Plan, participants: int = PARTICIPANTS) -> tuple[Figure, ...]:
    """Export and report of a study that is made up; a multiple of four participants."""
    plan.say(f"the report of a study of {participants} participants")
    with tempfile.TemporaryDirectory() as spare:
        people = synthetic.Plan(participants=participants, effect=0.8)
        folder = synthetic.make_study(Path(spare) / "study", people)
        begun = time.process_time()
        tables.write(collect(folder), Path(spare) / "data")
        report.write(tables.read(Path(spare) / "data"), Path(spare))
        took = time.process_time() - begun
    return (Figure(f"Report of {participants} participants", took, "s", 1, REPORT_AIM),)
