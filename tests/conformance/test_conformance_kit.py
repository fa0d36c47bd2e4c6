"""Checks are found, chosen, run and judged."""

from __future__ import annotations

import asyncio
import re
from collections import Counter
from collections.abc import Awaitable, Callable, Mapping
from types import SimpleNamespace
from typing import Protocol, cast

import pytest

from usarsim_conformance import registry
from usarsim_conformance.case import Case, Run
from usarsim_conformance.checks import comserver
from usarsim_conformance.clock import SimulatedClock
from usarsim_conformance.places import Place, Places
from usarsim_conformance.registry import (
    Check,
    Crowded,
    Failed,
    Severity,
    Verdict,
    all_checks,
    check,
    select,
)
from usarsim_conformance.report import Report
from usarsim_conformance.runner import Progress, judge_all
from usarsim_conformance.survey import Target


@pytest.fixture
def fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    """Checks made meanwhile are forgotten."""
    monkeypatch.setattr(registry, "_CHECKS", dict(registry._CHECKS))


class Judge(Protocol):
    """Judges our own server by some checks."""

    def __call__(
        self, *ids: str, tell: Callable[[Progress], None] = ..., gives_up: float = ...
    ) -> Report: ...


@pytest.fixture
def judged(own_ports: Mapping[str, int]) -> Judge:
    """Judges the control port of our own server."""

    def judge(
        *ids: str, tell: Callable[[Progress], None] = lambda progress: None, gives_up: float = 60.0
    ) -> Report:
        chosen = [one for one in registry._CHECKS.values() if one.id in ids]
        ports = {"control": own_ports["control"]}
        target = Target(ports=ports, robot="P2AT", dialect="ut2004")
        return asyncio.run(judge_all(target, chosen, tell=tell, gives_up=gives_up))

    return judge


@pytest.mark.usefixtures("fresh")
class TestNewCheck:
    def test_one_function_is_enough(self, judged: Judge) -> None:
        """A decorated function is a check: it is found, run, and its docstring is the rule."""

        @check("control.kit.answers", "Answers", source="nowhere", dialects=registry.UT2004)
        async def answers(case: Case) -> None:
            """The server answers
            requests."""
            robot = await case.spawn()
            line = await robot.client.ask("GETCONF {Type Robot}", "CONF {")
            case.expect(line.get("Name") == "P2AT", f"{line}")

        assert "control.kit.answers" in {one.id for one in all_checks()}
        report = judged("control.kit.answers")
        assert report.results[0].verdict is Verdict.PASS
        assert report.rule("control.kit.answers").rule == "The server answers requests."

    @pytest.mark.parametrize(
        ("raise_it", "verdict"),
        [
            (lambda case: case.fail("seen"), Verdict.FAIL),
            (lambda case: case.expect(0, "seen"), Verdict.FAIL),
            (lambda case: case.skip("seen"), Verdict.NOT_APPLICABLE),
            (lambda case: case.need(None, "seen"), Verdict.INCONCLUSIVE),
            (lambda case: dict[str, int]()["seen"], Verdict.INCONCLUSIVE),
        ],
    )
    def test_words_become_verdicts(
        self, judged: Judge, raise_it: Callable[[Case], object], verdict: Verdict
    ) -> None:
        """What a check says, or that it breaks, becomes a verdict with its reason."""

        @check("control.kit.says", "Says", source="nowhere", dialects=registry.ONCE)
        async def says(case: Case) -> None:
            """Says something."""
            raise_it(case)

        result = judged("control.kit.says").results[0]
        assert result.verdict is verdict
        assert "seen" in result.reason

    def test_a_check_that_never_ends(self, judged: Judge) -> None:
        """It is given up after its time, inconclusively."""

        @check("control.kit.ever", "Ever", source="nowhere", dialects=registry.ONCE)
        async def ever(case: Case) -> None:
            """Never ends."""
            await asyncio.sleep(60.0)

        result = judged("control.kit.ever", gives_up=0.2).results[0]
        assert (result.verdict, result.reason) == (Verdict.INCONCLUSIVE, "not judged within 0.2 s")

    def test_exclusive_checks_run_alone(self, judged: Judge) -> None:
        """No other check is at work while an exclusive one is; the others work together."""
        busy: list[str] = []
        seen: dict[str, int] = {}

        def make(name: str, exclusive: bool) -> Callable[[Case], Awaitable[None]]:
            async def work(case: Case) -> None:
                """Works."""
                busy.append(name)
                await asyncio.sleep(0.1)
                seen[name] = len(busy)
                busy.remove(name)

            return check(name, "x", source="x", dialects=registry.ONCE, exclusive=exclusive)(work)

        names = [f"control.kit.n{number}" for number in range(4)]
        for name in names:
            make(name, name.endswith("3"))
        judged(*names)
        assert seen["control.kit.n3"] == 1
        assert max(seen.values()) > 1

    @pytest.mark.parametrize(
        ("room", "verdicts"),
        [(4, (1, Verdict.PASS)), (1, (2, Verdict.PASS)), (0, (2, Verdict.INCONCLUSIVE))],
    )
    @pytest.mark.parametrize("shared", [False, True])
    def test_crowded_checks_run_again_alone(
        self, judged: Judge, room: int, verdicts: tuple[int, Verdict], shared: bool
    ) -> None:
        """A check that finds no room beside others is judged once more without them, and what
        it shares with others is made anew."""
        busy, tries = set[str](), Counter[str]()

        def make(name: str) -> Callable[[Case], Awaitable[None]]:
            async def find_room(case: Case) -> None:
                if len(busy) > room:
                    raise Crowded("no room")

            async def work(case: Case) -> None:
                """Works."""
                busy.add(name)
                tries[name] += 1
                await asyncio.sleep(0.1)
                try:
                    await (case.shared(name, find_room) if shared else find_room(case))
                    await asyncio.sleep(0.1)
                finally:
                    busy.discard(name)

            return check(name, "x", source="x", dialects=registry.ONCE)(work)

        names = [f"control.kit.n{number}" for number in range(3)]
        for name in names:
            make(name)
        told: list[Progress] = []
        report = judged(*names, tell=told.append)
        assert (max(tries.values()), report.results[0].verdict) == verdicts
        assert {result.verdict for result in report.results} == {verdicts[1]}
        assert [progress.done for progress in told] == [1, 2, 3]

    def test_services_without_a_port(self, judged: Judge) -> None:
        """Checks of a service that nobody named do not apply."""

        @check("images.kit.x", "x", source="x", service="images", dialects=registry.ONCE)
        async def looks(case: Case) -> None:
            """Looks."""
            raise AssertionError("must not run")

        assert judged("images.kit.x").results[0].verdict is Verdict.NOT_APPLICABLE

    def test_shared_things_are_made_once(self, judged: Judge) -> None:
        """Checks that ask for the same thing get one; what went over the wire is shown to all."""
        made: list[str] = []

        async def make(case: Case) -> str:
            made.append(case.dialect)
            await (await case.connect()).send("HELLO")
            return "thing"

        async def ask(case: Case) -> None:
            """Asks."""
            case.fail(await case.shared("a thing", make))

        for name in ("control.kit.a", "control.kit.b"):
            check(name, "x", source="x", dialects=registry.UT2004)(ask)
        report = judged("control.kit.a", "control.kit.b")
        assert made == ["ut2004"]
        for result in report.results:
            assert result.reason == "thing"
            assert any("HELLO" in entry for entry in result.transcript)

    def test_progress_is_told(self, judged: Judge) -> None:
        """After every check its result and how many are done."""

        @check("control.kit.p", "x", source="x", dialects=registry.ONCE)
        async def passes(case: Case) -> None:
            """Passes."""

        told: list[Progress] = []
        judged("control.kit.p", tell=told.append)
        assert [(one.done, one.total, one.check.id) for one in told] == [(1, 1, "control.kit.p")]

    @pytest.mark.parametrize(
        ("id", "service", "dialects", "source"),
        [
            ("Control.X", "control", (), "x"),
            ("control", "control", (), "x"),
            ("control.kit.x", "radio", (), "x"),
            ("control.kit.x", "control", ("ut99",), "x"),
            ("control.kit.x", "control", (), ""),
        ],
    )
    def test_mistakes_are_refused(
        self, id: str, service: str, dialects: tuple[str, ...], source: str
    ) -> None:
        """A check with a wrong name, service or dialect, or without source, cannot be made."""

        async def function(case: Case) -> None:
            """A rule."""

        with pytest.raises(ValueError, match=re.escape(id)):
            check(id, "x", source=source, service=service, dialects=dialects)(function)

    def test_a_name_is_taken_once(self) -> None:
        """Two functions of different files cannot be the same check, nor one without a rule."""

        async def function(case: Case) -> None:
            """A rule."""

        with pytest.raises(ValueError, match="two checks"):
            check("control.connection.greeting", "x", source="x")(function)
        function.__doc__ = None
        with pytest.raises(ValueError, match="needs a rule"):
            check("control.kit.x", "x", source="x")(function)


class TestAll:
    def test_checks_are_many(self) -> None:
        """The control port alone is judged by more than 120 rules, all services by over 200."""
        checks = all_checks()
        assert sum(one.service == "control" for one in checks) >= 120
        assert len(checks) >= 200
        assert len({one.id for one in checks}) == len(checks)

    @pytest.mark.parametrize("one", all_checks(), ids=lambda one: one.id)
    def test_every_check_is_explained(self, one: Check) -> None:
        """Names begin with the service; rule and title are sentences; a source is named."""
        assert one.id.startswith(f"{one.service}.")
        assert one.rule.endswith(".") or one.rule.endswith(".)")
        assert len(one.title) <= 60
        assert re.search(r"reference|docs/", one.source), one.source

    @pytest.mark.parametrize(
        ("pattern", "wanted"),
        [
            ("control.init.case", {"control.init.case"}),
            ("init.case", {"control.init.case"}),
            ("control.world.f*,*.init.second", {"control.world.form", "control.init.second"}),
            ("nothing-like-it", set()),
        ],
    )
    def test_patterns(self, pattern: str, wanted: set[str]) -> None:
        """A plain word fits anywhere, signs stand for anything, commas part several."""
        assert {one.id for one in select(all_checks(), pattern)} == wanted

    def test_no_pattern_fits_all(self) -> None:
        """Without a pattern all checks are chosen."""
        assert select(all_checks(), None) == all_checks()


def test_an_unreachable_server() -> None:
    """Nobody at the port is told at once, and is no verdict on any rule."""
    target = Target(ports={"control": 1}, robot="P2AT")
    with pytest.raises(Failed, match=re.escape("no connection to 127.0.0.1:1")):
        asyncio.run(judge_all(target, all_checks()[:1]))


def test_severities_are_used() -> None:
    """Rules differ in how bad it is to break them."""
    assert {one.severity for one in all_checks()} == set(Severity)


class _Clock:
    """Time that passes at once."""

    async def sleep(self, seconds: float) -> None:
        await asyncio.sleep(0)


@pytest.mark.parametrize("places", [2, 3])
def test_checks_that_want_two_places_do_not_wait_for_each_other(places: int) -> None:
    """More of them than there are places are done one after the other, while what is made for all
    gets the last place; the only place of a server is for everybody."""

    async def work(among: Places, first_last: bool, count: int) -> None:
        taken = [await among.take(last=first_last)]
        for _ in range(count - 1):
            await asyncio.sleep(0)
            taken.append(await among.take(last=True))
        for place in taken:
            among.give_back(place)

    async def all_work() -> None:
        among = Places([Place(str(n)) for n in range(places)], cast(SimulatedClock, _Clock()))
        only = Places([Place("only")], cast(SimulatedClock, _Clock()))
        async with asyncio.timeout(5.0), asyncio.TaskGroup() as tasks:
            for _ in range(6):
                tasks.create_task(work(among, False, 2))
                tasks.create_task(work(among, True, 1))
                tasks.create_task(work(only, False, 1))

    asyncio.run(all_work())


def test_what_all_have_given_up_is_not_made_any_more() -> None:
    """Something shared goes on while one check waits for it; when the last one gives up it ends, so
    that its robots leave, and who asks later gets a new one."""

    async def ask() -> None:
        run = cast(Run, SimpleNamespace(shared={}, askers=Counter(), slots=None, is_beside=True))
        begun, ended = [], []

        async def make(case: Case) -> str:
            begun.append(case)
            try:
                await asyncio.sleep(60.0)
            finally:
                ended.append(case)
            return "never"

        async def made(case: Case) -> str:
            return "made"

        askers = [asyncio.create_task(Case(run, "udk").shared("a", make)) for _ in range(2)]
        for count, asker in enumerate(askers):
            await asyncio.sleep(0.01)
            assert (len(begun), len(ended)) == (1, 0)
            assert not askers[1].done(), count
            asker.cancel()
            await asyncio.wait({asker})
        await asyncio.sleep(0.01)
        assert ended == begun
        assert await Case(run, "udk").shared("a", made) == "made"

    asyncio.run(ask())


def test_links_one_after_the_other_need_two_places(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two checks that each make two links, on a server with three places, come to an end."""

    class Member:
        @classmethod
        async def make(cls, case: Case, *, listen: bool = False) -> Member:
            await case.place()
            return cls()

        async def link(self, other: Member) -> tuple[str, str]:
            return "one", "other"

        async def __aenter__(self) -> Member:
            return self

        async def __aexit__(self, *ignored: object) -> None:
            pass

    monkeypatch.setattr(comserver, "Member", Member)

    async def make_links(run: Run) -> None:
        case = Case(run, "udk")
        for _ in range(2):
            async with comserver._link(case) as ends:
                assert len(ends) == 2

    async def both() -> None:
        among = Places([Place(str(n)) for n in range(3)], cast(SimulatedClock, _Clock()))
        run = cast(Run, SimpleNamespace(places=among))
        async with asyncio.timeout(5.0):
            await asyncio.gather(make_links(run), make_links(run))

    asyncio.run(both())
