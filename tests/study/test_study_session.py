"""Sessions at a desk: forms, resuming, blindness, withdrawal; trials are pretended."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest
from desk_pages import STUDY, Seat, desk, pretended, write_study
from hypothesis import given, settings
from hypothesis import strategies as st

from usarsim_mission.errors import RunLogError
from usarsim_server.testing import PATIENCE
from usarsim_study.assignment import Cell
from usarsim_study.dataset import collect
from usarsim_study.errors import StudyError
from usarsim_study.folder import StudyFolder
from usarsim_study.forms import FormState
from usarsim_study.session.attempt import Runner
from usarsim_study.session.desk import Desk
from usarsim_study.session.notebook import Notebook
from usarsim_study.session.opening import next_participant, open_folder
from usarsim_study.session.staging import Options
from usarsim_study.session.steps import Attempt, Past, Task, next_step
from usarsim_study.study_file import read_study


class TestSteps:
    """What comes next follows from what is on disk alone; no file, clock or socket is needed."""

    def test_order_of_a_session(self, tmp_path: Path) -> None:
        study = read_study(write_study(tmp_path))
        order = (Cell("plain", "A"), Cell("delayed", "B"))
        step = next_step(study, order, Past(), consent=True)
        assert step.kind == "consent"
        past = Past(passed=frozenset({("consent", 1)}))
        step = next_step(study, order, past, consent=True)
        assert step.form is not None
        assert (step.kind, step.form.name) == ("form", "experience")
        state = FormState(step.form, {"games": 3.0})
        past = Past(passed=past.passed, forms={(0, "experience", 1): state})
        assert next_step(study, order, past, consent=True).state is state
        state.hand_in()
        step = next_step(study, order, past, consent=True)
        assert (step.kind, step.attempt) == ("ready", 1)
        ready = frozenset({(step.number, 1)})
        assert next_step(study, order, past, consent=True, ready=ready).kind == "panel"
        void = Past(passed=past.passed, forms=past.forms, trials=(Attempt(1, 1, "void"),))
        step = next_step(study, order, void, consent=True, ready=ready)
        assert (step.kind, step.attempt) == ("ready", 2)  # O-45: it is asked again
        lost = Past(passed=past.passed, forms=past.forms, trials=(Attempt(1, 1, "aborted"),))
        step = next_step(study, order, lost, consent=True)
        assert step.kind == "break"  # no form asks about a trial that was lost (HRI-11)

    def test_two_operators_wait_for_each_other(self, tmp_path: Path) -> None:
        """HRI-19: forms are each one's own, trials are for both, and one drives where one is
        enough."""
        text = STUDY.replace('name = "plain"', 'name = "plain"\noperators = "split"')
        study = read_study(write_study(tmp_path, text))
        order = (Cell("plain", "A"), Cell("delayed", "B"))
        done = FormState(study.forms("before")[0], {"games": 1.0}, done=True)
        past = Past(forms={(0, "experience", 1): done})
        assert next_step(study, order, past, 1).kind == "wait"
        assert next_step(study, order, past, 2).kind == "form"
        past = Past(forms={(0, "experience", 1): done, (0, "experience", 2): done})
        steps = [next_step(study, order, past, seat) for seat in (1, 2)]
        assert [one.kind for one in steps] == ["ready", "ready"]
        ready = frozenset({(steps[0].number, 1)})
        assert next_step(study, order, past, 1, ready=ready).kind == "wait"
        assert next_step(study, order, past, 2, ready=ready).kind == "ready"


class TestDesk:
    """Over sockets, without a browser."""

    def test_a_session_from_consent_to_end(self, tmp_path: Path) -> None:
        """All is answered, stored and exported; a required answer holds up the hand-in (O-42)."""

        async def go() -> None:
            async with desk(write_study(tmp_path)) as room:
                async with room.seat() as page:
                    step = await page.at("text")
                    assert step["text"] == "You may stop at any time."
                    await page.press()
                    await page.at("form", "experience")
                    assert (await page.ask("hand_in", "refused"))["missing"] == ["games"]
                    assert (await page.ask("turn", "refused", page=2))["missing"] == ["games"]
                    for value in (9, "3", None, True, 2.5):
                        told = await page.answer("games", value)
                        assert told["type"] == ("saved" if value is None else "refused")
                    old = page.step["step"]
                    await page.fill_in("experience", games=3, words="secret words")
                    await page.at("text", "Trial 1")
                    await page.ws.send_json({"type": "next", "step": old})
                    told = await page.until(lambda one: one["type"] == "refused", len(page.said))
                    assert (told["step"], told["why"][:12]) == (old, "this is over")
                async with room.seat() as page:
                    await rest_of(page)

        asyncio.run(go())
        folder = StudyFolder(tmp_path)
        data = collect(folder)
        assert [one.status for one in data.participants] == ["complete"]
        answers = {(one.trial, one.form, one.item): one.answer for one in data.answers}
        assert answers[0, "experience", "games"] == "3"
        assert answers[2, "workload", "mental"] == "35"
        assert "secret" not in str(data)
        assert {one.values["tlx_raw"] for one in data.trials} == {35 / 6}

    def test_half_a_form_survives_the_desk(self, tmp_path: Path) -> None:
        """HRI-07: killed in the middle of a form, and in the middle of a line."""

        async def half() -> None:
            async with desk(write_study(tmp_path)) as room, room.seat() as page:
                await page.press("Two ways")
                await page.at("form")
                assert (await page.answer("games", 6))["type"] == "saved"

        async def rest() -> None:
            async with desk(tmp_path / "study.toml") as room:
                async with room.seat() as page:
                    step = await page.at("form")
                    assert step["answers"] == {"games": 6.0}
                    assert step["page"] == 2  # it goes on where it was
                async with room.seat() as page:  # a reload
                    assert (await page.at("form"))["answers"] == {"games": 6.0}
                    assert (await page.answer("games", 5))["type"] == "saved"

        asyncio.run(half())
        (code,) = [one.code for one in StudyFolder(tmp_path).participants()]
        forms = tmp_path / "participants" / code / "forms.jsonl"
        with forms.open("a") as file:
            file.write('{"kind": "form", "form": "exp')
        asyncio.run(rest())
        assert json.loads(forms.read_text().splitlines()[-1])["answers"] == {"games": 5.0}
        assert len(StudyFolder(tmp_path).participants()) == 1  # nobody new came

    def test_blind(self, tmp_path: Path) -> None:
        """HRI-05: neither what pages are told nor participants' files name a condition, and the
        preference is exported under its condition all the same."""
        said: list[object] = []

        async def go() -> None:
            study = write_study(tmp_path, "blind = true\n" + STUDY)
            async with desk(study) as room, room.seat() as page:
                page.said = []
                await whole_of(page, preferred="second")
                said.extend(page.said)

        asyncio.run(go())
        told = json.dumps(said)
        for path in (tmp_path / "participants").rglob("*"):
            told += path.name + (path.read_text() if path.is_file() else "")
        assert "plain" not in told
        assert "delayed" not in told
        folder = StudyFolder(tmp_path)
        (answer,) = [one for one in collect(folder).answers if one.item == "preferred"]
        assert answer.answer == folder.orders[1][1].condition

    def test_withdrawal(self, tmp_path: Path) -> None:
        """The session ends with a reason at once, what was answered stays, and the next
        participant gets the next number."""

        async def go() -> None:
            async with (
                desk(write_study(tmp_path), sessions=0) as room,
                room.seat() as page,
                room.experimenter() as leader,
            ):
                await page.press("Two ways")
                await page.at("form")
                await page.answer("games", 6)
                assert (await page.ask("order", "refused", do="void"))["why"]
                for deed in ("void", "end_trial"):
                    assert "no trial runs" in (await leader.ask("order", "refused", do=deed))["why"]
                await leader.ask("order", "done", do="end_session", reason="felt unwell")
                await page.at("end")
                told = await leader.until(lambda one: one.get("status") == "withdrawn")
                assert (told["number"], told["reason"]) == (1, "felt unwell")
                await leader.say("order", do="next")
                await page.at("text", "Two ways")
                await leader.until(lambda one: one.get("number") == 2)

        asyncio.run(go())
        first, second = StudyFolder(tmp_path).participants()
        assert (first.status, first.reason) == ("withdrawn", "felt unwell")
        assert (second.status, second.number) == ("running", 2)

    def test_a_full_disk_loses_no_answer(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """What cannot be stored is not said to be saved, and is asked for again."""

        async def go() -> None:
            async with desk(write_study(tmp_path)) as room, room.seat() as page:
                await page.press("Two ways")
                await page.at("form")
                with monkeypatch.context() as patched:
                    patched.setattr("os.fsync", _fails)
                    patched.setattr("usarsim_study.session.desk.RETRY", 0.1)
                    told = await page.answer("games", 6)
                    assert told["type"] == "refused"
                    assert "No space left" in told["why"]
                assert "item" not in told  # the page keeps it, and is shut out to say it again
                async with asyncio.timeout(PATIENCE):
                    await page.closed.wait()
                async with room.seat() as again:
                    assert (await again.at("form"))["answers"] == {}
                    await again.fill_in("experience", games=6)

        asyncio.run(go())

    def test_strangers(self, tmp_path: Path) -> None:
        """A wrong token, a foreign origin and nonsense are refused and never fatal."""

        async def go() -> None:
            async with desk(write_study(tmp_path)) as room:
                base = room.urls[1].partition("/#")[0]
                async with room.http.ws_connect(f"{base}/socket", headers={"Origin": base}) as ws:
                    await ws.send_json({"type": "hello", "token": "x" * 24})
                    assert (await ws.receive()).data == 1008
                async with room.http.get(f"{base}/socket", headers={"Origin": "http://a"}) as got:
                    assert got.status == 403
                async with room.http.get(f"{base}/", headers={"Host": "evil"}) as got:
                    assert got.status == 403
                async with room.seat() as page:
                    await page.at("text")
                    for text in ("", "[]", "{", '{"type": 3}', '{"type": "answer", "step": []}'):
                        count = len(page.said)
                        await page.ws.send_str(text)
                        await page.until(lambda one: one["type"] == "refused", count)
                    assert (await page.ask("ping", "pong")) == {"type": "pong"}

        asyncio.run(go())


def _fails(file: int) -> None:
    raise OSError(28, "No space left on device")


async def whole_of(page: Seat, **preferred: object) -> None:
    """A session from its begin."""
    await page.press("Two ways")
    await page.fill_in("experience", games=3)
    await rest_of(page, **preferred)


async def rest_of(page: Seat, **preferred: object) -> None:
    """A session from its first trial on."""
    for trial in (1, 2):
        await page.press(f"Trial {trial}")
        await page.fill_in("workload", mental=35)
        if trial == 1:
            await page.press("Break")
    await page.fill_in("which", **preferred)
    await page.at("end")


class BreakingTrial:
    """A trial whose disk is full, every time but the first: that is a fault of ours."""

    count = 0

    def __init__(self, *_: object) -> None:
        """Nothing is needed."""

    async def run(self) -> object:
        """Break."""
        BreakingTrial.count += 1
        if BreakingTrial.count == 1:
            raise KeyError("nobody thought of that")
        raise RunLogError("/x/events.jsonl: No space left on device (make room)")


def test_a_trial_that_breaks_every_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """O-45, HRI-11: it is repeated twice and then given up, each with its reason; the session goes
    on with what comes after it, and the values of that trial are missing."""
    monkeypatch.setattr(BreakingTrial, "count", 0)
    monkeypatch.setattr("usarsim_study.session.attempt.Trial", BreakingTrial)

    async def go() -> None:
        run = Runner(Options(), frozenset)
        async with desk(write_study(tmp_path), lambda pages: run) as room, room.seat() as page:
            await page.press("Two ways")
            await page.fill_in("experience", games=1)
            for trial in ("Trial 1", "Trial 2"):
                for attempt in range(3):
                    step = await page.at("text", trial)
                    assert ("interrupted" in step["text"]) is (attempt > 0)
                    await page.press(trial)
                    await page.past("wait")
                if trial == "Trial 1":
                    await page.press("Break")
            await page.fill_in("which")
            await page.at("end")

    asyncio.run(go())
    folder = StudyFolder(tmp_path)
    (who,) = folder.participants()
    assert who.status == "complete"
    rows = [one for one in folder.attempts(who.code) if one.trial == 1]
    assert [one.status for one in rows] == ["void", "void", "aborted"]
    assert [one.reason for one in rows] == [
        "a fault: KeyError", *["/x/events.jsonl: No space left on device (make room)"] * 2
    ]  # fmt: skip
    assert {one.values["tlx_raw"] for one in collect(folder).trials} == {None}


def test_two_desks_lead_two_participants(tmp_path: Path) -> None:
    """A participant who sits at one desk is not led by another one (HRI-03)."""

    async def go() -> None:
        study = write_study(tmp_path)
        async with desk(study) as one, desk(study) as other:
            numbers = [room.desk.book.participant.number for room in (one, other)]
            assert numbers == [1, 2]
        async with desk(study) as again:
            assert again.desk.book.participant.number == 1

    asyncio.run(go())


def test_eight_participants_at_a_desk(tmp_path: Path) -> None:
    """O-40, HRI-03: four sequences, each used twice, and no number twice, though every session
    was cut short; a ninth one is not on the list."""

    async def go() -> None:
        async with desk(write_study(tmp_path), sessions=0) as room, room.experimenter() as leader:
            for number in range(1, 9):
                await leader.until(lambda one, number=number: one.get("number") == number)
                await leader.ask("order", "done", do="end_session", reason="enough")
                await leader.say("order", do="next")
            await asyncio.wait([room.leading], timeout=PATIENCE)

    with pytest.raises(StudyError, match="has no participant 9"):
        asyncio.run(go())
    folder = StudyFolder(tmp_path)
    orders = [folder.orders[one.number] for one in folder.participants()]
    assert len(orders) == 8
    assert sorted(orders.count(one) for one in folder.study.orders) == [2, 2, 2, 2]


class Deaf:
    """A page that only keeps what it is told."""

    def __init__(self) -> None:
        self.told: list[dict[str, object]] = []

    def tell(self, message: dict[str, object]) -> None:
        """Keep it."""
        self.told.append(message)

    def end(self) -> None:
        """Nothing ends."""


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=9) | st.sampled_from((1, 3, 2001)),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=4), inner),
    max_leaves=4,
)
TEXTS = st.fixed_dictionaries(
    {"type": st.sampled_from(("answer", "turn", "hand_in", "order", "ping", "x")) | ANYTHING},
    optional={
        "step": st.just(2000) | ANYTHING,
        "item": st.sampled_from(("games", "words")) | ANYTHING,
        "value": ANYTHING,
        "page": ANYTHING,
        "clock": ANYTHING,
        "do": ANYTHING,
    },
)


def test_whatever_a_page_says_is_answered(tmp_path: Path) -> None:
    """CON-29 for the desk: nothing that a page says stops it, and what is on disk stays a form."""
    folder = open_folder(str(write_study(tmp_path)), None)
    with next_participant(folder) as who:
        book = Notebook(folder, who, consent=True)
        book.pass_(Task("consent"), 1)
        desk = Desk(book, "text", pretended)

        @settings(max_examples=60, deadline=None)
        @given(TEXTS | ANYTHING)
        def say(said: object) -> None:
            page = Deaf()
            desk.hear(1, page, json.dumps(said))
            assert page.told
            assert all(one["type"] in ("refused", "saved", "pong", "step") for one in page.told)
            assert desk.step(1).kind in ("form", "ready")

        say()
        assert book.past().status == "running"
