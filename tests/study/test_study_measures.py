"""Every measure against hand-made logs with values computed by hand (O-48 to O-50, HRI-10)."""

from __future__ import annotations

import math
import tempfile
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from logs import Log, minute, pooled_operators, two_operators, with_latencies

from usarsim_server.base.errors import UsarsimError
from usarsim_study.dataset import collect
from usarsim_study.errors import StudyError
from usarsim_study.measures import MEASURES, Part, compute, markdown, team
from usarsim_study.measures.victims import display_to_mark_times
from usarsim_study.records import read_lines, read_records
from usarsim_study.synthetic import Plan, make_study
from usarsim_study.trial import Trial, without

BY_HAND = {
    # Marks 1 to 3 and one victim by proximity; V2 was in a yellow zone.
    "victims_found": 4.0,
    "victims_credited": 3.0,
    "score": 46.5,
    "marks_valid": 3.0,
    "marks_wrong": 1.0,
    "marks_duplicate": 1.0,
    "marks_deleted": 1.0,
    # V1 14 to 17, V2 40 to 43 (34 to 36 is not more than 2 s), V4 61 to 64; V3 only at 31 degrees
    # and behind a wall.
    "victims_seen": 3.0,
    "display_time": 9.0,
    "seen_not_marked": 1.0,  # V4
    "marked_unseen": 1.0,  # V3
    "display_to_mark": 4.5,  # 18 - 14 and 45 - 40
    "selections": 2.0,
    "dwell": 20.0,  # R1 10 to 30, R2 30 to 50, R1 50 to 70
    "switches": 2.0,
    "neglected_standstill": 60.0,  # R1 30 to 50; R2 10 to 30 and 50 to 70
    "longest_standstill": 20.0,
    "interaction_time": 7.5,  # R1 10 to 25, R2 30 to 39, R1 50 to 54 and 60 to 62
    "neglect_time": 15.5,  # R1 25 to 50 and 54 to 60
    "attention_demand": 7.5 / 23.0,
    "fan_out": 23.0 / 7.5,
    "switch_cost": 2.0,  # 33 - 30 and 51 - 50
    "alarm_reaction": 2.5,  # chosen after 4, acknowledged after 2.5, driven after 2
    "alarms_unanswered": 1.0,
    "trial_time": 60.0,
    "distance": 6.0,  # 8 s at 0.5 m/s and 10 s at 0.2 m/s
    "moving_time": 23.0,  # 8 s; 10 s and 5 s of turning
    "idle_time": 97.0,
    "teleoperation_share": 23.0 / 60.0,  # 8 + 4 + 6 + 3 + 2
    "teleoperations": 5.0,
    "collisions": 3.0,
    "victim_contacts": 1.0,
    "robot_contacts": 2.0,
    "coverage": 0.7,
    "coverage_base": 0.5,
    "map_error": 0.12,
    "walls_mapped": 0.9,
    "command_latency": 0.030,
    "command_latency_p95": 0.060,
    "frame_age": 0.2,
    "frame_age_p95": 0.4,
    "tlx_raw": 45.0,
    "tlx_weighted": 59.0,
    "tlx_mental": 70.0,
    "tlx_physical": 10.0,
    "tlx_temporal": 55.0,
    "tlx_performance": 40.0,
    "tlx_effort": 65.0,
    "tlx_frustration": 30.0,
    "sus": 50.0,
    "sart": 24.0,
    "probes_right": 2.0 / 3.0,
}


SCORE = {"area": {"team": 0.7, "base": 0.5}, "map": {"error": 0.12, "share": 0.9}}
"""What `score.json` says of area and map."""


@pytest.fixture(scope="module")
def one() -> Trial:
    """The scripted minute."""
    return Trial(with_latencies(minute()).records, SCORE)


@pytest.mark.parametrize("name", MEASURES)
def test_value_by_hand(one: Trial, name: str) -> None:
    """Each measure has its hand value (HRI-10; O-48: displays; O-49: seen, marked; O-50: dwell,
    neglect, teleoperation)."""
    everybody = Part(frozenset(one.operators), frozenset(one.robots))
    assert MEASURES[name].function(one, everybody) == pytest.approx(BY_HAND[name], abs=1e-9)


def test_every_measure_says_what_it_is() -> None:
    """Title, unit, definition, source (HRI-10); and the table of the page has them all."""
    table = markdown()
    for name, measure in MEASURES.items():
        assert measure.title
        assert measure.unit
        assert measure.definition.endswith(".")
        assert measure.source
        assert f"| `{name}` |" in table
    assert set(BY_HAND) == set(MEASURES)


class TestDisplays:
    """O-48."""

    def test_intervals(self, one: Trial) -> None:
        """Robot, victim, begin and end as in the script."""
        found = [(span.robot, span.what, span.begin, span.end) for span in one.displays]
        assert found == [
            ("R1", "V1", 14.0, 17.0),
            ("R2", "V2", 40.0, 43.0),
            ("R1", "V4", 61.0, 64.0),
        ]

    def test_times_to_the_mark(self, one: Trial) -> None:
        """Mark less begin of the last display on that robot."""
        everybody = Part(frozenset(one.operators), frozenset(one.robots))
        assert display_to_mark_times(one, everybody) == [4.0, 5.0]

    def test_the_last_display_before_the_mark_counts(self) -> None:
        """Neither an earlier one nor one of another robot nor one after the mark."""
        log = Log()
        log.say(0.0, "trial_start")

        def views(time: float) -> list[dict[str, object]]:
            seen = {"victim": "V", "angle": 0.0, "distance": 1.0, "clear": True}
            robots = []
            if 1.0 <= time < 4.0 or 6.0 <= time < 9.0 or 14.0 <= time < 19.0:
                robots.append("R1")
            if 8.0 <= time < 11.0:
                robots.append("R2")
            return [{"robot": robot, **seen} for robot in robots]

        log.truth(0, 20, {}, views)
        log.say(12.5, "mark_set", mark=1, robot="R1", page=1)
        log.say(12.5, "found", victim="V", robot="R1", mark=1)
        log.say(20.0, "trial_end", why="operator")
        trial = Trial(log.records)
        assert display_to_mark_times(trial, Part(frozenset(), frozenset({"R1", "R2"}))) == [6.5]


class TestTwoOperators:
    """HRI-19: one log, measures of each operator and of the team."""

    def test_values_of_each(self) -> None:
        """A page that comes again after a reload is the same operator."""
        trial = Trial(two_operators().records)
        assert trial.operators == ("Ada", "Bob")
        values = {(one.measure, one.level, one.who): one.value for one in compute(trial)}
        assert values["victims_found", "operator", "Ada"] == 2.0
        assert values["victims_found", "operator", "Bob"] == 1.0
        assert values["teleoperation_share", "operator", "Ada"] == pytest.approx(16 / 60)
        assert values["teleoperation_share", "operator", "Bob"] == pytest.approx(20 / 60)
        assert values["teleoperation_share", "robot", "R2"] == pytest.approx(6 / 60)
        assert values["selections", "operator", "Ada"] == 2.0
        assert values["switches", "operator", "Ada"] == 1.0
        assert values["switches", "operator", "Bob"] == 0.0
        assert values["collisions", "robot", "R3"] == 1.0
        assert values["switch_cost", "operator", "Ada"] == 1.0
        assert values["switch_cost", "operator", "Bob"] is None

    def test_values_of_those_who_share(self) -> None:
        """Who drove, not whose robot it is, and who set a mark, not who took it back."""
        trial = Trial(pooled_operators().records)
        one, other = trial.operators
        values = {(each.measure, each.level, each.who): each.value for each in compute(trial)}
        expected = {
            "teleoperation_share": (17 / 60, 9 / 60),
            "victims_found": (1.0, 1.0),
            "victims_credited": (1.0, 0.0),
            "marks_wrong": (1.0, 0.0),
            "marks_deleted": (1.0, 0.0),
            "marks_duplicate": (0.0, 1.0),
            "switches": (1.0, 1.0),
        }
        for name, (first, second) in expected.items():
            assert values[name, "operator", one] == pytest.approx(first), name
            assert values[name, "operator", other] == pytest.approx(second), name
        assert values["teleoperation_share", "robot", "R1"] == pytest.approx(14 / 60)

    @pytest.mark.parametrize("log", [minute, two_operators, pooled_operators])
    def test_sums(self, log: object) -> None:
        """What is declared to add up does, over operators and over robots; what no operator did
        is the team's alone (a victim met by a robot)."""
        trial = Trial(log().records)  # type: ignore[operator]
        values = list(compute(trial))
        checked = 0
        for name, measure in MEASURES.items():
            whole = next(one.value for one in values if (one.measure, one.level) == (name, "team"))
            for level in measure.by if measure.adds and whole is not None else ():
                parts = [one.value for one in values if (one.measure, one.level) == (name, level)]
                assert None not in parts
                total = math.fsum(part for part in parts if part is not None)
                alone = log is minute and (name, level) in {
                    ("victims_found", "operator"),
                    ("victims_credited", "operator"),
                }
                assert total == pytest.approx(whole - alone)
                checked += 1
        assert checked >= 20


class TestMissing:
    """Missing is missing, never 0 (HRI-11)."""

    @pytest.mark.parametrize("why", ["aborted", "error"])
    def test_aborted_trial(self, why: str) -> None:
        """No measure has a value."""
        assert set(team(Trial(minute(why).records)).values()) == {None}

    def test_trial_without_end(self) -> None:
        """The log of a program that was killed."""
        records = [one for one in minute().records if one["kind"] != "trial_end"]
        assert set(team(Trial(records)).values()) == {None}
        assert set(team(Trial([])).values()) == {None}

    def test_what_nobody_logged(self) -> None:
        """Without truth no ways, without forms no workload; counts of events are counts."""
        kinds = {"trial_start", "trial_end", "connect", "session"}
        values = team(Trial([one for one in minute().records if one["kind"] in kinds]))
        known = {name for name, value in values.items() if value is not None}
        assert values["distance"] is None
        assert values["tlx_raw"] is None
        assert values["victims_seen"] is None
        assert values["switches"] is None
        assert values["alarm_reaction"] is None
        assert values["coverage"] is None
        assert values["victims_found"] is None  # no referee
        assert known == {
            *("trial_time", "selections", "teleoperation_share", "teleoperations"),
            *("marks_deleted", "alarms_unanswered"),
        }

    def test_nothing_found_is_zero(self) -> None:
        """Where a referee has judged, nothing found is 0."""
        kinds = {"trial_start", "trial_end", "connect", "session", "score"}
        values = team(Trial([one for one in minute().records if one["kind"] in kinds]))
        assert (values["victims_found"], values["collisions"]) == (0.0, 0.0)

    def test_skipped_item(self) -> None:
        """A form without an answer has no score."""
        records = minute().records
        for record in records:
            if record["kind"] == "form" and record["form"] == "sus":
                del record["answers"]["sus_4"]
        assert team(Trial(records))["sus"] is None


class TestLettingGo:
    """Logs of earlier versions have no command when an operator lets go."""

    def log(self, *, whole: bool) -> Log:
        """R1 is driven from 1 s to 3 s and from 20 s to 22 s of half a minute."""
        log = Log()
        log.say(0.0, "session", robots=[{"name": "R1", "class": "P3AT"}])
        log.say(0.0, "connect", page=1, role="operator", name="Ada", on=True)
        log.say(0.0, "trial_start", limit=30.0)
        log.say(0.0, "select", page=1, robot="R1")
        for begin, end in ((1.0, 3.0), (20.0, 22.0)):
            for time, power in ((begin, 0.5), (end, 0.0), (end + 0.05, 0.0)):
                said = {"type": "drive", "robot": "R1", "left": power, "right": power}
                log.say(time, "input", page=1, role="operator", text=said)
                told = f"DRIVE {{Left {power}}} {{Right {power}}}"
                if power or (whole and time == end):
                    log.say(time, "command", robot="R1", source="operator", text=told)
        log.say(30.0, "trial_end", why="time")
        return log

    def test_it_is_inferred_from_what_the_page_said(self) -> None:
        """Measures are those of the same trial with the commands; how often is told."""
        old, new = (Trial(self.log(whole=whole).records) for whole in (False, True))
        values = team(old)
        assert values == team(new)
        assert values["teleoperation_share"] == pytest.approx(4.0 / 30.0)
        assert values["teleoperations"] == 2.0
        assert (old.inferred_stops, new.inferred_stops) == (2, 0)

    def test_the_report_says_so(self, tmp_path: Path) -> None:
        """And of tables of an earlier version that nobody knows; not where logs are whole."""
        pytest.importorskip("scipy")
        from usarsim_study import report
        from usarsim_study.analysis import analyse

        folder = make_study(tmp_path, Plan(4))
        assert "let go" not in report.Sections(analyse(collect(folder))).markdown()
        run = folder.attempts(folder.participants()[0].code)[0].path
        self.log(whole=False).write(run)
        (run / "truth.jsonl").write_text("")
        found = collect(folder)
        assert [one.inferred_stops for one in found.trials] == [2, *[0] * 7]
        assert "in 1 of 8 trials the log" in report.Sections(analyse(found)).markdown()
        trials = [replace(one, inferred_stops=None) for one in found.trials]
        text = report.Sections(analyse(replace(found, trials=tuple(trials)))).markdown()
        assert "8 of 8 trials were exported by an earlier version" in text


class TestReading:
    """Logs as files."""

    def test_same_from_disk(self, tmp_path: Path) -> None:
        """Events and truth come together in the order of their numbers."""
        log = with_latencies(minute())
        records = read_records(log.write(tmp_path))
        assert [one["seq"] for one in records] == list(range(len(records)))
        assert team(Trial(records, SCORE)) == team(Trial(log.records, SCORE))

    def test_cut_off_in_the_last_line(self, tmp_path: Path) -> None:
        """Is read up to there; damage before that is named with its line."""
        path = minute().write(tmp_path) / "events.jsonl"
        whole, count = path.read_bytes(), len(read_records(tmp_path))
        path.write_bytes(whole[:-10])
        assert len(read_records(tmp_path)) == count - 1
        path.write_bytes(whole[:40] + b"\n" + whole[40:])
        with pytest.raises(UsarsimError, match=r"events\.jsonl: line 1"):
            read_records(tmp_path)

    def test_a_record_without_time(self, tmp_path: Path) -> None:
        """Has that of the record before."""
        (tmp_path / "events.jsonl").write_text(
            '{"seq": 0, "t_sim": 2.5, "t_wall": 0, "kind": "session"}\n'
            '{"seq": 1, "t_sim": null, "t_wall": 0, "kind": "error"}\n'
        )
        assert [one["t_sim"] for one in read_records(tmp_path)] == [2.5, 2.5]

    @given(st.binary(max_size=60))
    def test_anything_is_one_error(self, content: bytes) -> None:
        """Whatever stands in a file of forms: records, or an error for users."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "forms.jsonl"
            path.write_bytes(content)
            try:
                records = list(read_lines(path))
            except StudyError:
                return
        assert all(isinstance(one, dict) for one in records)


class TestTakenBack:
    """A find that does not stick (O-09)."""

    def test_find_taken_back(self) -> None:
        """Counts no more, unless it comes again."""
        log = Log()
        log.say(0.0, "trial_start")
        for victim in ("A", "B"):
            log.say(1.0, "found", victim=victim, robot="R1", how="proximity", mark=None)
            log.say(1.0, "credit", victim=victim, robot="R1", credited=True, why="")
            log.say(5.0, "credit", victim=victim, robot=None, credited=False, why="gone")
        log.say(8.0, "found", victim="B", robot="R1", how="proximity", mark=None)
        log.say(8.0, "credit", victim="B", robot="R1", credited=False, why="yellow")
        log.say(9.0, "trial_end", why="time")
        values = team(Trial(log.records))
        assert (values["victims_found"], values["victims_credited"]) == (1.0, 0.0)


def test_spans_with_holes() -> None:
    """Spans join where they touch, and lose what others cover."""
    trial = Trial(minute().records)
    holes = [one for one in trial.dwells if one.robot == "R1"]
    assert without([(10.0, 40.0), (40.0, 60.0)], holes) == [(30.0, 50.0)]
    assert without([(0.0, 5.0)], holes) == [(0.0, 5.0)]
