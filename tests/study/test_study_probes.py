"""Freeze probes: what is right follows from the truth of an instant (HRI-18)."""

from __future__ import annotations

import pytest

from usarsim_client.truth import TruthRow, truth_row
from usarsim_study.forms import FormState
from usarsim_study.session.probes import ITEM, Scene, probe_form, probe_record, right_answer
from usarsim_study.study_file import Probe


def row(speed: float = 0.0, turn: float = 0.0, **places: tuple[float, float]) -> TruthRow:
    """Robots at places; all of them drive and turn as fast."""
    robots = [
        {
            "name": name,
            "pos": [x, y, 0.0],
            "quat": [1.0, 0.0, 0.0, 0.0],
            "linear": [speed, 0.0, 0.0],
            "angular": [0.0, 0.0, turn],
            "battery": None,
            "contacts": [],
        }
        for name, (x, y) in places.items()
    ]
    return truth_row({"time": 7.0, "state": "", "robots": robots, "victims": [], "views": []})


def scene() -> Scene:
    """Two robots that began at the origin and 5 m left of it."""
    found = Scene(["R1", "R2"])
    begun = row(R1=(0.0, 0.0), R2=(0.0, 5.0))
    found.hear({"kind": "truth", **begun.fields})
    return found


@pytest.mark.parametrize(
    ("place", "side"),
    [
        ((1.9, 0.0), "near"),
        ((2.1, 0.0), "up"),
        ((-4.0, 3.0), "down"),
        ((3.0, 4.0), "left"),
        ((1.0, -4.0), "right"),
    ],
)
def test_where_a_robot_is(place: tuple[float, float], side: str) -> None:
    """From where it began, as the map of the console shows it: x up, y to the left."""
    asked = Probe(1.0, "where_is", 1)
    assert right_answer(asked, scene(), row(R1=place, R2=(0.0, 5.0))) == side
    assert right_answer(asked, scene(), row(R2=(0.0, 5.0))) is None


def test_the_robot_nearest_to_the_newest_mark() -> None:
    """One that stands; deleted or none, no robot is."""
    found, asked = scene(), Probe(1.0, "nearest_to_last_mark")
    now = row(R1=(0.0, 0.0), R2=(0.0, 5.0))
    assert right_answer(asked, found, now) == "none"
    found.hear({"kind": "mark_set", "mark": 1, "place": [1.0, 1.0, 0.0]})
    found.hear({"kind": "mark_set", "mark": 2, "place": [1.0, 1.0, 0.0]})
    assert right_answer(asked, found, now) == "R1"
    found.hear({"kind": "mark_edit", "mark": 2, "place": [0.0, 4.0, 0.0]})
    assert right_answer(asked, found, now) == "R2"
    assert right_answer(Probe(1.0, "victims_marked"), found, now) == 2.0
    found.hear({"kind": "mark_delete", "mark": 2})
    assert right_answer(asked, found, now) == "none"
    assert right_answer(Probe(1.0, "victims_marked"), found, now) == 1.0


def test_whether_a_robot_moves() -> None:
    """Below 0.05 m/s and 0.1 rad/s it stands, as the measures say it."""
    asked, places = Probe(1.0, "moving", 9), {"R1": (0.0, 0.0), "R2": (0.0, 5.0)}
    for speed, turn, moves in ((0.04, 0.09, False), (0.06, 0.0, True), (0.0, 0.11, True)):
        assert right_answer(asked, scene(), row(speed, turn, **places)) is moves


def test_what_the_log_says() -> None:
    """An answer is right or wrong; one that was not given is missing (HRI-11)."""
    found, asked = scene(), Probe(1.0, "moving", 2)
    now = row(0.5, R1=(0.0, 0.0), R2=(0.0, 5.0))
    state = FormState(probe_form(3, asked, found))
    assert state.form.name == "probe-3"
    told = probe_record(3, asked, found, now, state, 1)
    assert (told["correct"], told["answer"], told["right"]) == (None, None, True)
    state.answer(ITEM, False, 2.5)
    told = probe_record(3, asked, found, now, state, 1)
    assert (told["correct"], told["seconds"], told["robot"]) == (False, 2.5, "R2")
