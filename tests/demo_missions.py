"""Judge the demonstrations of the shipped missions over many seeds, and print one table.

`python tests/demo_missions.py --out DIR` plays what is not in DIR yet, two runs at a time. It can
be interrupted, and goes on where it was. `--table` only judges what is there. The exit status is 1
if a run missed an aim: no victim is touched, no robot stands without a reason, and the points at
the end are at least nine tenths of the highest, but for what time alone has taken: some rules pay
for the time that is left, which is gone in the end whatever robots do.
"""

from __future__ import annotations

import argparse
import math
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from usarsim_mission.errors import MissionError
from usarsim_mission.match import standing
from usarsim_mission.match.drawn import Drawn
from usarsim_mission.rescoring import live_result
from usarsim_mission.runlog import SCORE, RunFolder
from usarsim_server.base.launch import python

SEEDS = {
    "arena-search": 10,
    "arena-zones": 10,
    "office-moving": 3,
    "plant-radio": 3,
    "rsarsim": 3,
    "scaling-4": 3,
    "scaling-8": 3,
    "scaling-12": 3,
}
"""Missions with victims and a world, and how many seeds of each."""
KEPT = 0.9
"""Part of the highest points that a run has to end with."""


@dataclass(frozen=True)
class Row:
    """What one run shows.

    Attributes:
        found, victims: victims found, and all. touched: collisions with victims.
        points, highest: at the end, and at any time. kept: the highest, had only so much time been
            left then as at the end.
        stood: s of the longest time for which a robot stood although nothing tells why.
        told: the longest time for which one stood and something tells why, and that, in words.
    """

    mission: str
    seed: int
    found: int
    victims: int
    touched: int
    points: float
    highest: float
    kept: float
    stood: float
    told: str

    @property
    def misses(self) -> list[str]:
        """The aims that it missed."""
        aims = {
            "touched": self.touched == 0,
            "stood": self.stood == 0.0,
            "points": self.points >= KEPT * self.kept,
        }
        return [name for name, met in aims.items() if not met]


def judge(mission: str, folder: Path) -> Row:
    """What a run that is whole shows.

    Raises:
        MissionError: its logs are damaged.
    """
    result, drawn = live_result(folder / SCORE), Drawn()
    if result is None:
        raise MissionError(f"{folder}: has no {SCORE} (play it again)")
    run, values = RunFolder(folder), result["values"]
    rules, kept = run.rules(), -math.inf
    for record in run.records():
        drawn.take(record)
        if record["kind"] == "score":
            kept = max(kept, rules.score({**record["values"], "T": values["T"]}))
    drawn.end()
    ways = drawn.robots.values()
    spans = [span for way in ways for span in way.standing.spans]
    told = [span for span in spans if span.why != standing.UNKNOWN]
    longest = max(told, key=lambda one: one.ends - one.begins, default=None)
    return Row(
        mission,
        int(result["seed"]),
        int(values["VF"]),
        int(values["V"]),
        sum(victim for way in ways for _, victim in way.touches),
        float(result["total"]),
        max((points for _, points in drawn.scores), default=0.0),
        kept,
        max((one.ends - one.begins for one in spans if one.why == standing.UNKNOWN), default=0.0),
        f"{longest.ends - longest.begins:.0f} s: {longest.why}" if longest else "-",
    )


def play(mission: str, seeds: int, out: Path, jobs: int) -> None:
    """Play what is not there yet."""
    words = ["mission", "run", mission, "--demo", f"--seeds=1-{seeds}", f"--jobs={jobs}"]
    subprocess.run(python("-m", "usarsim_server", *words, f"--out={out}"), check=True)


def table(rows: list[Row]) -> str:
    """All runs, in Markdown."""
    heads = ("mission", "seed", "found", "touched", "points", "highest", "but for time")
    heads += ("stood, s", "stood longest and told why", "missed")
    lines = [list(heads), ["---"] * len(heads)]
    for row in rows:
        lines.append(
            [
                row.mission,
                str(row.seed),
                f"{row.found} of {row.victims}",
                str(row.touched),
                f"{row.points:.1f}",
                f"{row.highest:.1f}",
                f"{row.kept:.1f}",
                f"{row.stood:.0f}",
                row.told,
                ", ".join(row.misses) or "-",
            ]
        )
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def main() -> int:
    """Play and judge; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mission", nargs="*", help="only these (default: all)")
    parser.add_argument("--out", type=Path, required=True, help="folder of all runs")
    parser.add_argument("--jobs", type=int, default=2, help="runs at a time (default 2)")
    parser.add_argument("--seeds", type=int, help="of each mission, instead of its own number")
    parser.add_argument("--table", action="store_true", help="play nothing")
    given = parser.parse_args()
    rows = []
    for mission in given.mission or SEEDS:
        if mission not in SEEDS:
            parser.error(f"there is no mission {mission!r} (known: {', '.join(SEEDS)})")
        out = given.out / mission
        if not given.table:
            play(mission, given.seeds or SEEDS[mission], out, given.jobs)
        whole = [path.parent for path in out.glob(f"*/{SCORE}") if ".void-" not in str(path)]
        for folder in whole:
            try:
                rows.append(judge(mission, folder))
            except MissionError as error:
                print(f"WARNING: {error}", file=sys.stderr)
    rows.sort(key=lambda row: (list(SEEDS).index(row.mission), row.seed))
    print(table(rows))
    return int(any(row.misses for row in rows))


if __name__ == "__main__":
    sys.exit(main())
