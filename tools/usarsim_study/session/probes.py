"""Freeze probes: what is asked while the world stands still, and what would have been right.

What is right follows from the truth of that instant and from the marks that stand; nothing here
knows a page or a clock. Places are in MuJoCo's frame (x forward, y left, m); on the map of the
console x points up and y to the left.

Source: M. R. Endsley, "Measurement of situation awareness in dynamic systems", Human Factors 37
(1995) 65-84: freezes, blank displays, and questions that the simulation can answer.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from usarsim_client.scene import TruthRow
from usarsim_study.forms import Form, FormState, Item, Value
from usarsim_study.study_file import Probe
from usarsim_study.trial import MOVING_SPEED, MOVING_TURN, Record

NEAR = 2.0
"""m within which a robot still is where it began."""
MOST_MARKS = 100
"""Largest number that can be answered."""
ITEM = "answer"
"""Name of the one item of a probe's form."""
_SIDES = (
    ("near", "within 2 m of there"),
    ("up", "further up"),
    ("right", "further right"),
    ("down", "further down"),
    ("left", "further left"),
)

Place = tuple[float, float]


@dataclass
class Scene:
    """What probes ask about, kept up to date by the records of a run.

    Attributes:
        robots: names, in the order of the mission. marks: places of those that stand.
        newest: the mark that was set last, if it stands.
        starts: where each robot was in the first row of the trial.
    """

    robots: Sequence[str]
    marks: dict[str, Place] = field(default_factory=dict)
    newest: str | None = None
    starts: dict[str, Place] = field(default_factory=dict)

    def hear(self, record: Mapping[str, Any]) -> None:
        """The next record."""
        match record["kind"]:
            case "mark_set" | "mark_edit":
                name, place = str(record.get("mark")), record.get("place")
                if isinstance(place, list | tuple) and None not in place[:2]:
                    self.marks[name] = float(place[0]), float(place[1])
                if record["kind"] == "mark_set":
                    self.newest = name
            case "mark_delete":
                self.marks.pop(str(record.get("mark")), None)
            case "truth":
                for one in record["robots"]:
                    self.starts.setdefault(one["name"], (one["pos"][0], one["pos"][1]))

    def robot(self, number: int) -> str:
        """The robot of a number from 1; the last one if there are fewer."""
        return self.robots[min(number, len(self.robots)) - 1]


def probe_form(number: int, probe: Probe, scene: Scene) -> Form:
    """What is asked; `number` from 1 is that of the probe in its trial."""
    name = scene.robot(probe.robot)
    match probe.question:
        case "nearest_to_last_mark":
            robots = tuple((one, one) for one in scene.robots)
            item = Item(
                ITEM,
                "Which robot is nearest to the mark that was set last?",
                "choice",
                choices=(*robots, ("none", "no mark stands there")),
            )
        case "where_is":
            text = f"Where on the map is {name} now, seen from where it began?"
            item = Item(ITEM, text, "choice", choices=_SIDES)
        case "victims_marked":
            text = "How many marks of victims stand now?"
            item = Item(ITEM, text, high=MOST_MARKS, left="none", right="")
        case "moving":
            item = Item(ITEM, f"Does {name} move or turn at this moment?", "flag")
    return Form(f"probe-{number}", "probe", "A short question", "The robots wait for you.", (item,))


def right_answer(probe: Probe, scene: Scene, row: TruthRow) -> Value | None:
    """What is true at an instant; None: nobody can know."""
    robots = {one.name: one for one in row.robots}
    robot = robots.get(scene.robot(probe.robot))
    match probe.question:
        case "nearest_to_last_mark":
            place = scene.marks.get(scene.newest or "")
            if place is None:
                return "none"
            return min(
                (one for one in scene.robots if one in robots),
                key=lambda one: math.dist(robots[one].pos[:2], place),
                default=None,
            )
        case "where_is":
            begun = scene.starts.get(scene.robot(probe.robot))
            if robot is None or begun is None:
                return None
            ahead, left = robot.pos[0] - begun[0], robot.pos[1] - begun[1]
            if math.hypot(ahead, left) <= NEAR:
                return "near"
            if abs(ahead) >= abs(left):
                return "up" if ahead > 0 else "down"
            return "left" if left > 0 else "right"
        case "victims_marked":
            return float(len(scene.marks))
        case "moving":
            if robot is None:
                return None
            turns = math.hypot(*robot.angular) >= MOVING_TURN
            return turns or math.hypot(*robot.linear) >= MOVING_SPEED


def probe_record(
    number: int, probe: Probe, scene: Scene, row: TruthRow, state: FormState, seat: int
) -> Record:
    """What the log says of an answer; without one it is neither right nor wrong."""
    right, given = right_answer(probe, scene, row), state.answers.get(ITEM)
    known = right is not None and given is not None
    return {
        "probe": number,
        "question": probe.question,
        "robot": scene.robot(probe.robot),
        "operator": seat,
        "answer": given,
        "right": right,
        "correct": given == right if known else None,
        "seconds": state.times.get(ITEM),
        "at": row.time,
    }
