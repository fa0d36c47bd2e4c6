"""Who is found: by mark (O-08, O-11), proximity (O-09) and view (O-10)."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import pytest
from scripted import ANNA, OPEN, WORLD, Script, rules

from usarsim_mission.model import Victim, World
from usarsim_mission.scoring import ZoneRule, ZoneRules


def counts(script: Script) -> tuple[float, ...]:
    """VF, VC, LO, FM."""
    values = script.values()
    return values["VF"], values["VC"], values["LO"], values["FM"]


class TestMarks:
    def test_within_the_tolerance_a_mark_is_valid_beyond_it_wrong(self) -> None:
        """O-08: 0.99 m and 1.01 m of 1 m, on the floor whatever the height."""
        script = Script(OPEN).start(R1=(5.0, 3.0))
        assert [one["kind"] for one in script.mark(7, 6.01, 5.0)] == ["wrong"]
        assert counts(script) == (0, 0, 0, 1)
        found = script.tell("mark_set", mark=8, robot="R1", place=[5.0, 4.01, 1.4])
        assert found == [
            {
                "kind": "found",
                "t_sim": 0.0,
                "victim": "Anna",
                "robot": "R1",
                "how": "mark",
                "mark": 8,
            },
            {
                "kind": "credit",
                "t_sim": 0.0,
                "victim": "Anna",
                "robot": "R1",
                "credited": True,
                "why": "outside of all zones",
            },
        ]
        assert counts(script) == (1, 1, 1, 1)

    def test_a_second_mark_is_a_duplicate_and_changes_nothing(self) -> None:
        """O-11: it is logged; no second find, no wrong mark."""
        script = Script(OPEN).start(R1=(5.0, 3.0), R2=(9.0, 9.0))
        script.mark(1, 5.0, 5.5)
        before = script.values()
        assert script.mark(2, 5.0, 5.0, "R2") == [
            {"kind": "duplicate", "t_sim": 0.0, "mark": 2, "victim": "Anna"}
        ]
        assert script.values() == before
        assert len(script.of("found")) == 1

    def test_a_duplicate_in_yellow_does_not_heal_a_find_without_credit(self) -> None:
        """O-11 with O-04."""
        script = Script().start(R1=(5.0, 3.0), R2=(4.0, 4.0))
        script.drive("R1")
        script.mark(1, 5.0, 5.0)
        script.mark(2, 5.0, 5.0, "R2")
        assert counts(script) == (1, 0, 1, 0)

    def test_a_moved_mark_is_judged_anew(self) -> None:
        script = Script(OPEN).start(R1=(5.0, 3.0))
        script.mark(1, 9.0, 9.0)
        script.tell("mark_edit", mark=1, place=[5.0, 5.2, 0.0])
        assert counts(script) == (1, 1, 1, 0)
        script.tell("mark_edit", mark=1, status="conscious")
        assert script.values()["ST"] == 1
        script.tell("mark_edit", mark=1, place=[9.0, 9.0, 0.0])
        assert counts(script) == (1, 1, 0, 1)

    def test_a_deleted_mark_stands_no_more(self) -> None:
        script = Script(OPEN).start(R1=(5.0, 3.0))
        script.mark(1, 9.0, 9.0)
        script.mark(2, 5.0, 5.0)
        script.tell("mark_delete", mark=1, by="A")
        script.tell("mark_delete", mark=2, by="A")
        script.tell("mark_delete", mark=3, by="A")
        assert counts(script) == (1, 1, 0, 0)

    def test_not_sticky_a_victim_is_lost_with_its_last_mark(self) -> None:
        script = Script(OPEN, rules(sticky=False)).start(R1=(5.0, 3.0))
        script.mark(1, 5.0, 5.0)
        script.mark(2, 5.0, 5.1)
        script.tell("mark_delete", mark=1, by="A")
        assert counts(script) == (1, 1, 1, 0)
        script.tell("mark_delete", mark=2, by="A")
        assert counts(script) == (0, 0, 0, 0)
        assert script.out[-1]["credited"] is False
        assert script.out[-1]["why"] == "the mark was taken back"

    def test_between_two_victims_marks_tell_of_both(self) -> None:
        near = Victim("Bea", (5.6, 5.0, 0.2))
        script = Script(World(victims=(ANNA, near))).start(R1=(5.0, 3.0))
        script.mark(1, 5.1, 5.0)
        script.mark(2, 5.2, 5.0)
        assert [one["victim"] for one in script.of("found")] == ["Anna", "Bea"]
        assert [one["kind"] for one in script.mark(3, 5.3, 5.0)] == ["duplicate"]

    def test_names_and_states_of_marks_count(self) -> None:
        """ID: the note names the victim; ST: its status is right; whatever the case."""
        script = Script(OPEN).start(R1=(5.0, 3.0))
        script.mark(1, 5.0, 5.0, note="this is ANNA, I think", status=" Conscious ")
        script.mark(2, 15.0, 5.0, note="Benjamin", status="dead")
        values = script.values()
        assert (values["ID"], values["ST"], values["LO"]) == (1, 1, 2)

    def test_a_victim_that_moves_is_where_it_is_now(self) -> None:
        script = Script(OPEN).start(R1=(5.0, 3.0))
        victims = [{"name": "Anna", "pos": [8.0, 8.0, 0.2]}]
        script.tell("truth", 0.1, robots=[], victims=victims, views=[])
        assert [one["kind"] for one in script.mark(1, 5.0, 5.0)] == ["wrong"]
        assert [one["kind"] for one in script.mark(2, 8.5, 8.0)] == ["found", "credit"]

    def test_a_mark_without_a_robot_is_answered_for_by_the_nearest(self) -> None:
        for source, credited in (("operator", False), ("autonomy", True)):
            script = Script().start(R1=(5.0, 3.0), R2=(25.0, 5.0))
            script.drive("R1", source)
            script.tell("mark_set", mark=1, robot=None, place=[5.0, 5.0])
            assert script.of("credit")[0]["credited"] is credited


class TestProximity:
    def test_sticky_keeps_what_a_robot_was_near_to(self) -> None:
        """O-09: sticky true; 2 m on the floor."""
        script = Script(OPEN, rules(credit="proximity")).start(R1=(5.0, 2.0))
        script.row(1.0, R1=(5.0, 2.99))
        assert counts(script)[:2] == (0, 0)
        script.row(2.0, R1=(5.0, 3.01))
        assert counts(script)[:2] == (1, 1)
        script.row(3.0, R1=(5.0, 0.0))
        assert counts(script)[:2] == (1, 1)
        assert [one["how"] for one in script.of("found")] == ["proximity"]

    def test_not_sticky_the_count_drops_when_the_robot_leaves(self) -> None:
        """O-09: sticky false; also when the robot is gone from the world."""
        script = Script(OPEN, rules(credit="proximity", sticky=False)).start(R1=(5.0, 2.0))
        script.row(1.0, R1=(5.0, 4.0))
        assert counts(script)[:2] == (1, 1)
        script.row(2.0, R1=(5.0, 0.0))
        assert counts(script)[:2] == (0, 0)
        script.row(3.0, R1=(5.0, 4.0))
        script.row(3.1, R2=(15.0, 4.0))
        assert [one["victim"] for one in script.of("found")] == ["Anna", "Anna", "Ben"]
        assert counts(script)[:2] == (1, 1)

    def test_the_height_may_differ_by_so_much(self) -> None:
        """O-09: a robot one floor above is not near."""
        script = Script(OPEN, rules(credit="proximity")).start(R1=(5.0, 0.0))
        script.row(1.0, R1=(5.0, 5.0, 0.71))
        assert counts(script)[0] == 0
        script.row(2.0, R1=(5.0, 5.0, 0.69))
        assert counts(script)[0] == 1

    def test_robots_are_paired_with_victims(self) -> None:
        """O-09, as the score keeper did: one robot counts for one victim, the nearest that is left,
        near or not; when it is gone so is its victim, unless another robot has it."""
        paired = rules(credit="proximity", sticky=False, radius=6.0, pairs=True)
        alone = Script(OPEN, rules(credit="proximity", sticky=False, radius=6.0))
        script = Script(OPEN, paired).start(R1=(0.0, 0.0), R2=(0.0, 0.0))
        both = alone.start(R1=(0.0, 0.0), R2=(0.0, 0.0))
        for one, found in ((both, 2), (script, 1)):
            one.row(1.0, R1=(10.0, 5.0))
            assert counts(one)[0] == found
        script.row(2.0, R1=(10.0, 5.0), R2=(9.5, 5.0))
        assert counts(script)[0] == 2
        script.row(3.0, R1=(5.0, 5.0), R2=(5.0, 5.0))  # Ben is 10 m from R2, who gets him
        assert counts(script)[0] == 1
        script.row(4.0, R1=(0.0, 5.0), R2=(6.0, 5.0))  # R1 comes first, though R2 is nearer
        assert [one["victim"] for one in script.of("found")] == ["Anna", "Ben"]
        assert counts(script)[0] == 1
        script.row(5.0, R2=(6.0, 5.0))
        assert counts(script)[0] == 1
        script.row(6.0, R2=(15.0, 15.0))
        assert counts(script)[0] == 0

    def test_marks_are_judged_beside_it(self) -> None:
        script = Script(OPEN, rules(credit="proximity")).start(R1=(0.0, 0.0))
        script.mark(1, 5.0, 5.0)
        script.mark(2, 9.0, 9.0)
        assert counts(script) == (0, 0, 0, 1)
        script.row(1.0, R1=(5.0, 5.0))
        assert counts(script) == (1, 1, 1, 1)


def view(degrees: float, clear: bool = True, victim: str = "Anna") -> dict[str, Any]:
    angle = math.radians(degrees)
    return {"robot": "R1", "victim": victim, "angle": angle, "distance": 3.0, "clear": clear}


class TestView:
    def look(self, script: Script, degrees: float, seconds: float, clear: bool = True) -> None:
        """So long, and then away."""
        begin = script.time
        for step in range(round(seconds * 10.0) + 1):
            at = round(begin + 0.1 * (step + 1), 6)
            script.row(at, views=[view(degrees, clear)], R1=(5.0, 2.0))
        script.row(round(script.time + 0.1, 6), R1=(5.0, 2.0))

    @pytest.mark.parametrize(
        ("degrees", "seconds", "clear", "found"),
        [
            (29.0, 2.0, True, 1),
            (29.0, 1.9, True, 0),
            (31.0, 2.0, True, 0),
            (29.0, 10.0, False, 0),
        ],
    )
    def test_angle_dwell_and_a_wall_between(
        self, degrees: float, seconds: float, clear: bool, found: int
    ) -> None:
        """O-10."""
        script = Script(OPEN, rules(credit="view")).start(R1=(5.0, 2.0))
        self.look(script, degrees, seconds, clear)
        assert counts(script)[:2] == (found, found)

    def test_two_short_looks_are_not_a_long_one(self) -> None:
        """O-10."""
        script = Script(OPEN, rules(credit="view")).start(R1=(5.0, 2.0))
        self.look(script, 10.0, 1.5)
        self.look(script, 10.0, 1.5)
        assert counts(script)[0] == 0

    def test_without_line_of_sight_walls_do_not_matter(self) -> None:
        """O-10."""
        script = Script(OPEN, rules(credit="view", line_of_sight=False)).start(R1=(5.0, 2.0))
        self.look(script, 10.0, 2.0, clear=False)
        assert counts(script)[0] == 1

    def test_intervals_of_display_are_told(self) -> None:
        script = Script(OPEN).start(R1=(5.0, 2.0))
        self.look(script, 20.0, 2.5)
        assert script.of("victim_visible_begin", "victim_visible_end") == [
            {"kind": "victim_visible_begin", "t_sim": 0.1, "robot": "R1", "victim": "Anna"},
            {
                "kind": "victim_visible_end",
                "t_sim": 2.7,
                "robot": "R1",
                "victim": "Anna",
                "seconds": 2.6,
            },
        ]

    def test_not_sticky_it_lasts_as_long_as_the_look(self) -> None:
        script = Script(OPEN, rules(credit="view", sticky=False)).start(R1=(5.0, 2.0))
        for step in range(1, 31):
            script.row(0.1 * step, views=[view(3.0)], R1=(5.0, 2.0))
        assert counts(script)[0] == 1
        script.row(3.1, R1=(5.0, 2.0))
        assert counts(script)[0] == 0


def test_the_factor_of_a_zone_makes_a_victim_worth_more() -> None:
    using = dataclasses.replace(rules(), zones=ZoneRules(red=ZoneRule(factor=2.5)))
    script = Script(WORLD, using).start(R1=(25.0, 3.0))
    script.mark(1, 25.0, 5.0)
    assert counts(script)[:2] == (1, 2.5)
