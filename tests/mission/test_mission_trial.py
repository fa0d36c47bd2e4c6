"""Contacts (O-12), losses, area, and how a trial ends (O-44)."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from scripted import OPEN, WORLD, Script, corridor, rules, sick

from usarsim_mission.errors import RunLogError, ScoringError
from usarsim_mission.grid import Grid
from usarsim_mission.model import Fan, Mission, Start, World
from usarsim_mission.referee import Referee
from usarsim_mission.scoring import find_rules


def touch(what: str, name: str = "", time: float | None = None) -> dict[str, Any]:
    found: dict[str, Any] = {"with": what, "name": name}
    return found if time is None else {**found, "time": time}


class TestContacts:
    def told(self, script: Script) -> tuple[float, float]:
        values = script.values()
        return values["C"], values["K"]

    def test_a_victim_is_touched_once_a_window(self) -> None:
        """O-12: a touch that lasts counts once, and again after a pause of the window, 3 s."""
        script = Script(OPEN).start(R1=(5.0, 4.5))
        touched = {*range(1, 65), 90, 94 + 30}
        for step in range(1, 130):
            contacts = {"R1": [touch("victim", "Anna")]} if step in touched else {}
            script.row(0.1 * step, contacts=contacts, R1=(5.0, 4.5))
        assert self.told(script) == (2, 0)
        assert [round(one["t_sim"], 6) for one in script.of("collision")] == [0.1, 12.4]

    def test_walls_are_collisions_no_contacts_with_victims(self) -> None:
        """O-12: whichever wall it is; sliding along one counts once."""
        script = Script(OPEN).start(R1=(5.0, 4.5))
        contacts = [touch("world", "wall1"), touch("world", "wall2"), touch("victim", "Anna")]
        script.row(0.1, contacts={"R1": contacts}, R1=(5.0, 4.5))
        assert self.told(script) == (1, 1)
        assert script.of("collision") == [
            {"kind": "collision", "t_sim": 0.1, "robot": "R1", "with": "world", "name": "wall1"},
            {"kind": "collision", "t_sim": 0.1, "robot": "R1", "with": "victim", "name": "Anna"},
        ]

    def test_two_victims_and_two_robots_have_windows_of_their_own(self) -> None:
        script = Script(OPEN).start(R1=(5.0, 4.5), R2=(5.5, 4.5))
        both = [touch("victim", "Anna"), touch("victim", "Ben")]
        script.row(0.1, contacts={"R1": both, "R2": both}, R1=(5.0, 4.5), R2=(5.5, 4.5))
        assert self.told(script) == (4, 0)

    def test_robots_that_meet_collide_once(self) -> None:
        script = Script(OPEN).start(R1=(5.0, 4.5), R2=(5.5, 4.5))
        meet = {"R1": [touch("robot", "R2")], "R2": [touch("robot", "R1")]}
        script.row(0.1, contacts=meet, R1=(5.0, 4.5), R2=(5.5, 4.5))
        assert self.told(script) == (0, 1)

    def test_times_of_contacts_count_not_those_of_rows(self) -> None:
        for again, counted in ((3.04, [0.1]), (3.06, [0.1, 3.1])):
            script = Script(OPEN).start(R1=(5.0, 4.5))
            for row, at in ((0.1, 0.05), (3.1, again)):
                script.row(row, contacts={"R1": [touch("victim", "Anna", at)]}, R1=(5.0, 4.5))
            assert [one["t_sim"] for one in script.of("collision")] == counted


class TestLosses:
    SIDE = (math.cos(math.radians(45)), math.sin(math.radians(45)), 0.0, 0.0)

    def lost(self, script: Script) -> list[tuple[str, str, float]]:
        return [(one["robot"], one["why"], round(one["t_sim"], 3)) for one in script.of("lost")]

    def test_one_that_lies_on_its_side_for_long(self) -> None:
        script = Script(OPEN).start(R1=(5.0, 2.0))
        for step in range(1, 300):
            lies = step < 99 or step >= 110
            quats = {"R1": list(self.SIDE)} if lies else {}
            script.row(0.1 * step, quats=quats, R1=(5.0, 2.0))
        assert self.lost(script) == [("R1", "tipped over", 21.0)]
        assert script.values()["L"] == 1

    def test_one_that_falls_out_of_the_world(self) -> None:
        world = dataclasses.replace(OPEN, low=(0.0, 0.0, -1.0), high=(20.0, 10.0, 5.0))
        script = Script(world).start(R1=(5.0, 2.0), R2=(5.0, 3.0))
        script.row(1.0, R1=(5.0, 2.0, -1.9), R2=(-0.5, 3.0))
        script.row(2.0, R1=(5.0, 2.0, -2.1), R2=(-0.5, 3.0))
        assert self.lost(script) == [("R1", "out of bounds", 2.0)]

    def test_one_whose_link_stays_away(self) -> None:
        script = Script(OPEN).start(R1=(5.0, 2.0))
        for step in range(1, 1300):
            if step in (100, 700):
                script.tell("link", robot="R1", state="lost", signal_dbm=-99.0)
            if step in (600,):
                script.tell("link", robot="R1", state="good", signal_dbm=-40.0)
            script.row(0.1 * step, R1=(5.0, 2.0))
        assert self.lost(script) == []
        script.row(130.0, R1=(5.0, 2.0))
        assert self.lost(script) == [("R1", "link lost", 130.0)]

    def test_one_that_leaves_before_the_end(self) -> None:
        script = Script(OPEN).start(R1=(5.0, 2.0), R2=(9.0, 2.0))
        for step in range(1, 30):
            script.row(0.1 * step, R2=(9.0, 2.0))
        assert self.lost(script) == [("R1", "left the world", 1.0)]
        script.tell("trial_end", why="operator")
        script.row(9.0)
        assert script.values()["L"] == 1


class TestArea:
    def test_walls_and_range_bound_what_is_seen(self) -> None:
        """A corridor of 20 by 2 m, a scanner of 5 m in its middle: half of it, in the end all."""
        world = World(floor=corridor(), starts=(sick("R1", 5.0),))
        script = Script(world).start(R1=(10.0, 1.0))
        script.row(1.0, R1=(10.0, 1.0))
        assert script.values()["A"] == pytest.approx(0.495, abs=0.02)
        for step in range(11):
            script.row(2.0 + step, R1=(5.0 + step, 1.0))
        assert script.values()["A"] == pytest.approx(0.99, abs=0.02)

    def test_nothing_is_seen_through_a_wall(self) -> None:
        floor = corridor()
        cells = floor.cells.copy()
        cells[:, 101] = 2
        world = World(floor=dataclasses.replace(floor, cells=cells), starts=(sick("R1"),))
        script = Script(world).start(R1=(2.0, 1.0))
        script.row(1.0, R1=(2.0, 1.0))
        assert script.values()["A"] == pytest.approx(0.5, abs=0.02)

    def test_nothing_is_seen_through_a_slanting_wall_of_single_cells(self) -> None:
        cells = np.full((100, 100), 1, np.uint8)
        np.fill_diagonal(cells, 2)
        floor = Grid(0.0, 0.0, 0.1, cells)
        script = Script(World(floor=floor, starts=(sick("R1"),))).start(R1=(8.0, 2.0))
        script.row(1.0, R1=(8.0, 2.0))
        assert script.values()["A"] == pytest.approx(0.5, abs=0.01)

    def test_a_sector_is_seen_where_it_looks(self) -> None:
        world = World(floor=corridor(), starts=(Start("R1", sensors=(Fan(30.0, 1.0),)),))
        script = Script(world).start(R1=(10.0, 1.0))
        script.row(1.0, R1=(10.0, 1.0))
        ahead = script.values()["A"]
        assert 0.4 < ahead < 0.5
        back = {"R1": [0.0, 0.0, 0.0, 1.0]}
        script.row(2.0, quats=back, R1=(10.0, 1.0))
        assert script.values()["A"] == pytest.approx(2.0 * ahead, abs=0.01)

    def test_the_base_knows_what_got_through(self) -> None:
        world = World(floor=corridor(), starts=(sick("R1", 5.0),))
        script = Script(world).start(R1=(5.0, 1.0))
        script.row(1.0, R1=(5.0, 1.0))
        at_base = script.values()["A"]
        assert at_base == pytest.approx(0.5, abs=0.02)
        script.tell("link", robot="R1", state="lost")
        script.row(2.0, R1=(15.0, 1.0))
        assert script.values()["A"] == at_base
        assert script.referee.area.share("team") > 0.97
        script.row(3.0, R1=(5.0, 1.0))
        assert script.values()["A"] == at_base
        script.tell("link", robot="R1", state="good")
        script.row(4.0, R1=(5.0, 1.0))
        assert script.values()["A"] > 0.97

    def test_robots_of_a_known_class_see_as_it_does(self) -> None:
        script = Script(World(floor=corridor(), starts=(sick("R1"),))).start(Other=(10.0, 1.0))
        script.row(1.0, Other=(10.0, 1.0))
        assert script.values()["A"] > 0.97
        blind = Script(World(floor=corridor(), starts=())).start(Other=(10.0, 1.0))
        blind.row(1.0, Other=(10.0, 1.0))
        assert blind.values()["A"] == 0.0


class TestTheEnd:
    def seconds(self, script: Script) -> list[float]:
        return [one["t_sim"] for one in script.of("score")]

    def test_by_time_at_exactly_the_limit(self) -> None:
        """O-44: whenever the next record comes; one score a second, one at the end."""
        script = Script(OPEN).start(2.55, R1=(5.0, 2.0))
        for step in range(1, 40):
            script.row(round(0.1 * step, 6), R1=(5.0, 2.0))
        assert (script.referee.over, script.referee.over_at) == ("time", 2.55)
        assert self.seconds(script) == [1.0, 2.0, 2.55]
        assert script.out[-1]["values"]["T"] == 0.0

    def test_what_happens_at_the_limit_counts_what_happens_later_does_not(self) -> None:
        """O-44."""
        script = Script(OPEN, rules(credit="proximity")).start(2.0, R1=(5.0, 2.0))
        script.row(2.0, R1=(5.0, 4.0))
        assert script.referee.over == "time"
        script.row(2.1, R1=(15.0, 5.0))
        assert script.mark(1, 15.0, 5.0) == []
        assert script.referee.score["values"]["VF"] == 1
        assert self.seconds(script) == [1.0, 2.0]

    def test_by_the_operator(self) -> None:
        """O-44: what remains of the time is kept."""
        script = Script(OPEN, rules("T")).start(600.0, R1=(5.0, 2.0))
        script.row(149.9, R1=(5.0, 2.0))
        script.tell("trial_end", 150.0, why="operator", text="")
        assert (script.referee.over, script.referee.over_at) == ("operator", 150.0)
        assert script.referee.score["total"] == 0.75
        assert script.tell("trial_end", 160.0, why="error") == []

    @pytest.mark.parametrize(("agreed", "over"), [(True, "all_found"), (False, None)])
    def test_by_all_victims_credited(self, agreed: bool, over: str | None) -> None:
        """O-44: if the mission says so."""
        script = Script(OPEN, mission=Mission(ends_when_all_credited=agreed)).start(R1=(5.0, 2.0))
        script.mark(1, 5.0, 5.0)
        assert script.referee.over is None
        script.row(10.0, R1=(5.0, 2.0))
        script.mark(2, 15.0, 5.0)
        assert script.referee.over == over
        assert (script.out[-1]["kind"] == "score") is agreed

    def test_a_find_without_credit_does_not_end_it(self) -> None:
        """O-44 with O-04."""
        world = dataclasses.replace(WORLD, victims=WORLD.victims[:1])
        script = Script(world, mission=Mission(ends_when_all_credited=True)).start(R1=(5.0, 2.0))
        script.drive("R1")
        script.mark(1, 5.0, 5.0)
        assert script.referee.running

    def test_nothing_counts_before_it_begins(self) -> None:
        script = Script(OPEN, rules(credit="proximity"))
        script.row(1.0, contacts={"R1": [touch("victim", "Anna")]}, R1=(5.0, 4.0))
        assert script.mark(1, 9.0, 9.0) == []
        assert script.out == []
        assert script.values()["FM"] == 0
        script.tell("trial_start", 100.0, limit=60.0)
        script.row(100.1, R1=(5.0, 4.0))
        assert script.values()["VF"] == 1
        assert script.referee.ends_at == 160.0

    def test_the_limit_is_that_of_the_start_or_the_mission_or_the_rules(self) -> None:
        for told, agreed, ends in ((60.0, 90.0, 60.0), (None, 90.0, 90.0), (None, None, 1200.0)):
            script = Script(OPEN, mission=Mission(time_limit=agreed)).start(told, R1=(5.0, 2.0))
            assert script.referee.ends_at == ends

    def test_a_bonus_counts_even_after_the_end(self) -> None:
        script = Script(OPEN, rules("VC + B")).start(60.0, R1=(5.0, 2.0))
        script.tell("bonus", 5.0, points=2.5, by="judge", why="two-way talk")
        script.tell("trial_end", 6.0, why="operator")
        assert script.referee.score["total"] == 2.5
        (again,) = script.tell("bonus", 9.0, points=-1.0, by="judge", why="")
        assert (again["total"], again["t_sim"]) == (1.5, 6.0)

    def test_operators_are_those_of_the_session(self) -> None:
        script = Script(OPEN, find_rules("usarsim-scorekeeper")[1])
        script.tell("session", operators=2, robots=[])
        script.tell("trial_start", limit=100.0)
        script.tell("trial_end", 60.0, why="operator")
        assert script.referee.score["values"]["N"] == 2
        assert script.referee.score["total"] == 50 * 0.4 / 4

    def test_a_world_without_victims_needs_rules_that_allow_it(self) -> None:
        with pytest.raises(ScoringError, match="0 victims"):
            Referee(Mission(), find_rules("usar-mj-1")[1], World())
        Referee(Mission(), rules(), World())


@pytest.mark.parametrize(
    ("record", "problem"),
    [
        ({"kind": "truth", "robots": 3}, "robots: 3 is not a list of objects"),
        ({"kind": "truth", "robots": [{"name": "R1", "pos": [1, 2]}], "t_sim": "x"}, "t_sim"),
        ({"kind": "truth", "robots": [{"name": "R1", "pos": [1]}]}, "pos"),
        ({"kind": "command", "robot": 4}, "robot: 4 is not text"),
        ({"kind": "mark_set", "mark": 1, "place": "here"}, "place"),
        ({"kind": "bonus", "points": None}, "points"),
        ({"kind": "map", "x": 0}, "the grid has no y"),
    ],
)
def test_a_record_that_cannot_be_is_refused_by_its_number(
    record: dict[str, Any], problem: str
) -> None:
    script = Script(World(floor=corridor()), rules("M")).start(R1=(5.0, 2.0))
    with pytest.raises(RunLogError, match="record 3") as refusal:
        script.referee.feed({"t_sim": 1.0, **record, "seq": 3})
    assert problem in str(refusal.value)


def test_unknown_kinds_and_derived_ones_are_ignored() -> None:
    script = Script(OPEN).start(R1=(5.0, 2.0))
    for kind in ("probe", "form", "whatever", "found", "score", "zone"):
        assert script.tell(kind, robot=3) == []
