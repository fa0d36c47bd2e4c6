"""The arbiter: who drives, who has asked, robots switched off and failed, the emergency stop."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from usarsim_operator.arbiter import Arbiter, Asking, Decision, Holder, Outcome, Stop

Log = list[tuple[str, dict[str, object]]]


def _arbiter(latch: Path | None = None) -> tuple[Arbiter, Log]:
    log: Log = []
    return Arbiter(latch, lambda what, facts: log.append((what, facts))), log


def _refused(why: str, before: Holder | None) -> Decision:
    return Decision(Outcome.REFUSED, why, before)


def _granted(before: Holder | None) -> Decision:
    return Decision(Outcome.GRANTED, "", before)


def test_races_have_one_winner() -> None:
    """CON-13: of 100 races each has exactly one winner, and the other is told who."""
    arbiter, log = _arbiter()
    dice = random.Random(13)
    for race in range(100):
        pages = [1, 2]
        dice.shuffle(pages)
        first, second = pages
        robot = f"R{race}"
        assert arbiter.take(robot, first, f"P{first}", 0.0).outcome is Outcome.GRANTED
        late = arbiter.take(robot, second, f"P{second}", 0.0)
        assert late.outcome is Outcome.ASKED
        assert late.before is not None
        assert late.before.page == first
        assert arbiter.why_not(robot, second) == f"P{first} holds {robot}"  # CON-14
        assert arbiter.why_not(robot, first) == ""
        forced = arbiter.take(robot, second, f"P{second}", 0.0, force=True)
        assert forced.outcome is Outcome.GRANTED
        assert log[-1] == ("took by force", {"robot": robot, "page": second, "holder": first})


def test_the_holder_answers_who_has_asked_and_nobody_else_does() -> None:
    """Page 2 holds R; pages 1 and 3 stand for numbers on both sides of it."""
    arbiter, log = _arbiter()
    two = Holder(2, "B")
    assert arbiter.reply("R", 1, 3, True) == _refused("you do not hold R", None)
    assert arbiter.take("R", 2, "B", 0.0) == _granted(None)
    assert arbiter.take("R", 2, "B", 0.0) == _granted(two)
    assert log == [("took", {"robot": "R", "page": 2, "holder": "nobody"})]
    for asks, other in ((3, 1), (1, 3)):
        none_asks = _refused("that page does not ask for R", two)
        assert arbiter.reply("R", 2, asks, True) == none_asks
        name = f"P{asks}"
        asked = Decision(Outcome.ASKED, "B holds R and is asked", two)
        assert arbiter.take("R", asks, name, 1.0) == asked
        assert arbiter.take("R", asks, name, 1.0) == asked
        too_late = _refused(f"B holds R, and {name} has asked already", two)
        assert arbiter.take("R", other, f"P{other}", 1.0) == too_late
        assert arbiter.reply("R", asks, asks, True) == _refused("you do not hold R", two)
        assert arbiter.reply("R", other, asks, True) == _refused("you do not hold R", two)
        assert arbiter.reply("R", 2, other, True) == none_asks
        del log[:]
        assert arbiter.reply("R", 2, asks, False) == _refused("B keeps R", two)
        assert log == [("refused", {"robot": "R", "page": asks, "holder": 2})]
    arbiter.take("R", 3, "C", 1.0)
    del log[:]
    assert arbiter.reply("R", 2, 3, True) == _granted(two)
    assert log == [("was granted", {"robot": "R", "page": 3, "holder": 2})]
    assert arbiter.holders == {"R": Holder(3, "C")}


def test_silence_is_a_no() -> None:
    """After ten seconds the question has lapsed, and each who asked is told once."""
    arbiter, log = _arbiter()
    for robot, since in (("R", 1.0), ("S", 2.0), ("T", 60.0)):
        arbiter.take(robot, 1, "A", 0.0)
        arbiter.take(robot, 2, "B", since)
    del log[:]
    assert not arbiter.expired(10.9)
    assert arbiter.expired(11.0) == [Asking("R", 2, "B", 1.0)]
    assert log == [("got no answer", {"robot": "R", "page": 2, "holder": 1})]
    assert arbiter.expired(13.0) == [Asking("S", 2, "B", 2.0)]
    assert not arbiter.expired(13.0)
    assert arbiter.reply("R", 1, 2, True).outcome is Outcome.REFUSED
    assert arbiter.reply("T", 1, 2, True).outcome is Outcome.GRANTED


@pytest.mark.parametrize("leaves", [1, 2, 3])
def test_a_page_that_goes_frees_its_robots_and_asks_no_more(leaves: int) -> None:
    """Those of the pages before and after it stay."""
    arbiter, log = _arbiter()
    for page in (1, 2, 3):
        for robot in ("R", "S"):
            arbiter.take(f"{robot}{page}", page, f"P{page}", 0.0)
    others = [page for page in (1, 2, 3) if page != leaves]
    arbiter.take(f"R{others[0]}", leaves, "leaves", 0.0)  # asks for another's
    arbiter.take(f"R{others[1]}", others[0], "stays", 0.0)
    arbiter.take(f"S{leaves}", others[0], "stays", 0.0)  # is asked for its own
    del log[:]
    assert arbiter.gone(leaves) == [f"R{leaves}", f"S{leaves}"]
    assert [what for what, _ in log] == ["handed back"] * 2
    assert log[0][1] == {"robot": f"R{leaves}", "page": leaves, "holder": leaves}
    assert {one.page for one in arbiter.holders.values()} == set(others)
    assert arbiter.reply(f"R{others[0]}", others[0], leaves, True).outcome is Outcome.REFUSED
    assert arbiter.reply(f"R{others[1]}", others[1], others[0], True).outcome is Outcome.GRANTED
    assert arbiter.take(f"S{leaves}", others[1], "next", 1.0) == _granted(None)
    assert arbiter.reply(f"S{leaves}", others[1], others[0], True).outcome is Outcome.REFUSED


def test_only_its_holder_gives_a_robot_back() -> None:
    arbiter, _ = _arbiter()
    assert not arbiter.hand_back("R", 2)
    arbiter.take("R", 2, "B", 0.0)
    assert not arbiter.hand_back("R", 1)
    assert not arbiter.hand_back("R", 3)
    assert arbiter.hand_back("R", 2)
    assert not arbiter.holders


def test_why_a_robot_may_not_be_driven() -> None:
    """The holder before the stop, the stop before what ails the robot."""
    arbiter, _ = _arbiter()
    assert arbiter.why_not("R", 2) == "nobody holds R: take it first"
    arbiter.take("R", 2, "B", 0.0)
    assert arbiter.why_not("R", 2) == ""
    arbiter.enable("R", False)
    assert arbiter.why_not("R", 2) == "R is switched off: enable it first"
    arbiter.fail("R", True)
    assert arbiter.why_not("R", 2) == "R has failed"
    arbiter.stop_all("A", 1, 3.0)
    assert arbiter.why_not("R", 2) == "emergency stop by A: reset it first"
    assert arbiter.why_not("R", 1) == arbiter.why_not("R", 3) == "B holds R"


def test_what_has_failed_is_not_switched_on() -> None:
    arbiter, _ = _arbiter()
    arbiter.fail("R", True)
    with pytest.raises(ValueError, match="R has failed"):
        arbiter.enable("R", True)
    arbiter.enable("R", False)
    arbiter.enable("S", False)
    arbiter.enable("S", True)
    assert (arbiter.failed, arbiter.disabled) == ({"R"}, {"R"})
    arbiter.fail("R", False)
    assert (arbiter.failed, arbiter.disabled) == (set(), set())


def test_a_robot_that_has_left_is_forgotten() -> None:
    arbiter, _ = _arbiter()
    arbiter.take("R", 1, "A", 0.0)
    arbiter.take("R", 2, "B", 0.0)
    arbiter.fail("R", True)
    arbiter.forget("R")
    arbiter.forget("R")
    assert (arbiter.holders, arbiter.failed, arbiter.disabled) == ({}, set(), set())
    assert not arbiter.expired(99.0)


def test_an_emergency_stop_lasts_and_names_the_first(tmp_path: Path) -> None:
    """O-18: over the end of a gateway, too."""
    latch = tmp_path / "latch"
    arbiter, log = _arbiter(latch)
    assert arbiter.stop is None
    arbiter.stop_all("A", 1, 3.5)
    arbiter.stop_all("B", 2, 4.5)
    assert arbiter.stop == Stop("A", 3.5)
    arbiter.keep()
    assert [path.name for path in tmp_path.iterdir()] == ["latch"]
    assert _arbiter(latch)[0].stop == Stop("A", 3.5)
    arbiter.reset("B", 2)
    arbiter.reset("B", 2)
    assert log == [
        ("emergency stop", {"page": 1, "by": "A"}),
        ("emergency stop", {"page": 2, "by": "B"}),
        ("emergency stop ends", {"page": 2, "by": "B", "stopped_by": "A"}),
    ]
    for _ in range(2):
        arbiter.keep()
        assert not latch.exists()
    alone = _arbiter()[0]
    alone.stop_all("A", 1, 3.5)
    alone.keep()
    assert alone.stop == Stop("A", 3.5)


@pytest.mark.parametrize("text", ["", "[]", "{", '{"by": 1}', "\udcff"])
def test_a_latch_that_cannot_be_read_stops_everything(tmp_path: Path, text: str) -> None:
    """O-18: a file that makes no sense is an emergency stop."""
    latch = tmp_path / "latch"
    latch.write_bytes(text.encode("utf-8", "surrogateescape"))
    arbiter, _ = _arbiter(latch)
    assert arbiter.stop == Stop("an earlier gateway", 0.0)
    arbiter.reset("A", 1)
    arbiter.keep()
    assert _arbiter(latch)[0].stop is None
