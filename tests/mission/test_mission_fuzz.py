"""Whatever a log says, a referee takes it or refuses it by its number; and says the same again."""

from __future__ import annotations

import json
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from scripted import WORLD, corridor, rules, sick

from usarsim_mission.errors import RunLogError
from usarsim_mission.model import Mission, World
from usarsim_mission.records import DERIVED
from usarsim_mission.referee import Referee
from usarsim_mission.scoring import VARIABLES

ROOMS = World(victims=WORLD.victims, zones=WORLD.zones, starts=(sick("R1"),), floor=corridor())
KINDS = (
    *("session", "trial_start", "trial_end", "truth", "command", "mode", "estop", "enable", "link"),
    *("mark_set", "mark_edit", "mark_delete", "map", "bonus", "form", "score", "hand_in"),
)
KEYS = (
    *("robot", "robots", "operators", "limit", "why", "source", "left", "right", "text", "mode"),
    *("on", "state", "signal_dbm", "mark", "place", "status", "note", "points", "victims", "views"),
    *("x", "y", "cell", "rows", "columns", "cells", "name", "class", "number"),
)
PLAIN = st.none() | st.booleans() | st.integers(-5, 30) | st.floats(-1e3, 1e3) | st.text(max_size=4)
ANY = st.recursive(
    PLAIN,
    lambda one: st.lists(one, max_size=3) | st.dictionaries(st.sampled_from(KEYS), one),
    max_leaves=6,
)
PLACE = st.tuples(st.floats(-2.0, 32.0), st.floats(-2.0, 12.0), st.floats(-1.0, 1.0)).map(list)
NAME = st.sampled_from(["R1", "R2"])
VICTIM = st.sampled_from(["Anna", "Ben", "Carl"])
GOOD = st.one_of(
    st.fixed_dictionaries(
        {
            "kind": st.just("truth"),
            "robots": st.lists(
                st.fixed_dictionaries(
                    {
                        "name": NAME,
                        "pos": PLACE,
                        "quat": st.just([1.0, 0.0, 0.0, 0.0]) | st.just([0.7, 0.7, 0.0, 0.0]),
                        "contacts": st.lists(
                            st.fixed_dictionaries({"with": st.just("victim"), "name": VICTIM}),
                            max_size=2,
                        ),
                    }
                ),
                max_size=2,
                unique_by=lambda one: one["name"],
            ),
            "victims": st.just([]),
            "views": st.lists(
                st.fixed_dictionaries(
                    {
                        "robot": NAME,
                        "victim": VICTIM,
                        "angle": st.floats(0.0, 1.0),
                        "clear": st.booleans(),
                    }
                ),
                max_size=3,
            ),
        }
    ),
    st.fixed_dictionaries(
        {
            "kind": st.sampled_from(["mark_set", "mark_edit", "mark_delete"]),
            "mark": st.integers(1, 4),
            "robot": NAME,
            "place": PLACE,
        }
    ),
    st.fixed_dictionaries(
        {
            "kind": st.just("command"),
            "robot": NAME,
            "source": st.sampled_from(["operator", "autonomy", "watchdog"]),
            "left": st.sampled_from([0.0, 0.5]),
        }
    ),
    st.fixed_dictionaries(
        {
            "kind": st.just("hand_in"),
            "victims": st.lists(
                st.fixed_dictionaries({"number": st.integers(1, 4), "place": PLACE}), max_size=3
            ),
        }
    ),
    st.fixed_dictionaries({"kind": st.just("trial_end"), "why": st.just("operator")}),
    st.fixed_dictionaries({"kind": st.just("bonus"), "points": st.floats(-1e12, 1e12)}),
)


def referee(credit: str, sticky: bool) -> Referee:
    pairs = credit == "pairs"
    credit = "proximity" if pairs else credit
    using = rules("VC + FM - C + A + B / N", credit=credit, sticky=sticky, pairs=pairs)
    return Referee(Mission(ends_when_all_credited=True), using, ROOMS)


@given(
    st.sampled_from(KINDS),
    st.dictionaries(st.sampled_from(KEYS), ANY, max_size=6),
    st.floats(-10.0, 1e6) | st.none(),
)
def test_any_record_is_taken_or_refused(kind: str, facts: dict[str, Any], time: float) -> None:
    judge = referee("mark", True)
    judge.feed({"seq": 0, "t_sim": 0.0, "kind": "trial_start", "limit": 60.0})
    if kind == "hand_in":  # which counts afterwards
        judge.feed({"seq": 0, "t_sim": 0.0, "kind": "trial_end", "why": "operator"})
    try:
        judge.feed({**facts, "seq": 1, "t_sim": time, "kind": kind})
    except RunLogError as refusal:
        told = str(refusal)
    else:
        told = ""
    assert told == "" or told.startswith(f"record 1 ({kind}): ")


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.tuples(st.floats(0.0, 3.0), GOOD), max_size=30),
    st.sampled_from(["mark", "proximity", "pairs", "view"]),
    st.booleans(),
)
def test_any_run_adds_up_and_is_judged_alike_again(
    steps: list[tuple[float, dict[str, Any]]], credit: str, sticky: bool
) -> None:
    """O-47, O-55: counts agree with what was told; the same by way of JSON gives the same."""
    records: list[dict[str, Any]] = [{"seq": 0, "t_sim": 1.0, "kind": "trial_start", "limit": 60.0}]
    time = 1.0
    for gap, facts in steps:
        time += gap
        records.append({**facts, "seq": len(records), "t_sim": time})
    one, other = referee(credit, sticky), referee(credit, sticky)
    out = [derived for record in records for derived in one.feed(record)]
    again = [
        derived for record in records for derived in other.feed(json.loads(json.dumps(record)))
    ]
    assert out == again
    assert one.result() == other.result()
    assert {derived["kind"] for derived in out} <= DERIVED
    times = [derived["t_sim"] for derived in out if derived["kind"] == "score" and not one.over]
    assert times == [1.0 + second for second in range(1, len(times) + 1)]
    values = one.result()["values"]
    assert set(values) == set(VARIABLES)
    assert values["VC"] <= values["VF"] <= values["V"] == 3
    assert values["C"] == sum(derived["kind"] == "collision" for derived in out)
    assert values["L"] == sum(derived["kind"] == "lost" for derived in out)
    if sticky:
        assert values["VF"] == sum(derived["kind"] == "found" for derived in out)
