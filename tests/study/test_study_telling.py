"""What participants and the experimenter are told: controls, welcome, what comes next."""

from __future__ import annotations

import asyncio
import re
from pathlib import Path

import pytest
from desk_pages import STUDY, Seat, desk, write_study
from logs import minute

from usarsim_mission.match.conditions import Conditions
from usarsim_operator.alarms import SEVERITY
from usarsim_operator.injects import WHOM
from usarsim_study.assignment import Cell
from usarsim_study.folder import StudyFolder
from usarsim_study.session import happenings, screens
from usarsim_study.session.attempt import Attempt
from usarsim_study.session.desk import Desk, Run
from usarsim_study.session.opening import consent_of
from usarsim_study.session.staging import Options, limit_of, prepare
from usarsim_study.session.steps import Past, Session, Step, Task
from usarsim_study.session.web import Web
from usarsim_study.study_file import SHIPPED, Study, read_study

DEVICES = STUDY.replace('name = "plain"', 'name = "plain"\ndevice = "keyboard"').replace(
    'name = "delayed"', 'name = "delayed"\ndevice = "gamepad"'
)
TRAINED = STUDY.replace("[[form]]", '[training]\nmission = "one.toml"\n[[form]]', 1)
INLINE = STUDY.replace(
    'consent = "consent.txt"', 'welcome = "Hello.\\n\\nSit down."\nconsent = """\nI take part.\n"""'
)


def study_of(folder: Path, text: str) -> Study:
    """A study from its text."""
    return read_study(write_study(folder, text))


class TestControls:
    """Participants are told what their keys or their pad do, before a trial and during it."""

    def told(self, study: Study, condition: str) -> tuple[str, str]:
        """The text before a trial of a condition, and the line above its panel."""
        task = Task("trial", 1, cell=Cell(condition, "A"))
        session = Session(study, (Cell(condition, "A"), Cell(condition, "B")))
        step = Step("ready", task, 1, 1)
        before = screens.message(session, Past(), step, 1, "")["text"]
        return before, screens.panel_line(study, step)

    def test_of_the_condition(self, tmp_path: Path) -> None:
        """Keys with the keyboard, the pad's with a gamepad, and not those of the other one."""
        study = study_of(tmp_path, DEVICES)
        for text in self.told(study, "plain"):
            assert "W, A, S, D or arrows drive" in text
            assert "M and then Enter mark a victim" in text
            assert "Space stops everything" in text
            assert "RB" not in text
        for text in self.told(study, "delayed"):
            assert "hold RB and move the left stick to drive" in text
            assert "both sticks pressed stop everything" in text
            assert "the keys M and then Enter, mark a victim" in text
            assert "Space" not in text

    def test_of_a_blind_study(self, tmp_path: Path) -> None:
        """Both, alike in all conditions."""
        study = study_of(tmp_path, "blind = true\n" + DEVICES)
        assert self.told(study, "plain") == self.told(study, "delayed")
        assert "RB" in self.told(study, "plain")[1]
        assert "W, A, S, D" in self.told(study, "plain")[1]

    def test_as_the_page_of_the_console_says(self) -> None:
        """The same keys and buttons as in its table."""
        text = (Path(__file__).parents[2] / "docs" / "console.md").read_text(encoding="utf-8")
        rows = [re.split(r"\s*\|\s*", row) for row in text.splitlines() if row.startswith("| ")]
        table = {row[1].strip("*"): (row[2].strip("*"), row[3]) for row in rows if len(row) > 4}
        assert table["drive"] == ("W A S D or arrows", "RB held + left stick")
        assert table["slower"] == ("Shift", "LB")
        assert table["choose a robot"] == ("1 to 9, or the list", "A B X Y")
        assert table["stop everything"] == ("Space, or Esc twice", "both sticks pressed")
        assert table["mark a victim"][0] == "M, then Enter"


class TestTraining:
    """Participants read what a training is for, and how long it lasts."""

    @pytest.mark.parametrize("name", ["rsarsim", "scaling"])
    def test_of_the_shipped_studies(self, name: str, tmp_path: Path) -> None:
        """Before it and above its panel: the gates, what is behind them, and the time."""
        (tmp_path / "study.toml").write_bytes((SHIPPED / f"{name}.toml").read_bytes())
        study = read_study(tmp_path / "study.toml")
        session = Session(study, study.orders[0])
        task = next(one for one in session.tasks if one.kind == "training")
        step = Step("ready", task, 1, 1)
        lasts = limit_of(study, tmp_path, task, 45.0)
        before = screens.message(session, Past(), step, 1, "", lasts=lasts)["text"]
        for text in (before, screens.panel_line(study, step, lasts)):
            assert "mark 2 victims, and touch at most 2 things" in text
            assert "Two people are behind the fourth gate" in text
            assert "or after 5 minutes." in text

    def test_a_trial_says_its_time(self, tmp_path: Path) -> None:
        """That of its mission, or the one that the desk was told; in the session itself."""
        study = study_of(tmp_path, STUDY)
        task = Task("trial", 1, cell=Cell("plain", "A"))
        assert limit_of(study, tmp_path, task, None) == 4.0
        assert limit_of(study, tmp_path, task, 3.0) == 3.0

        async def go() -> None:
            async with desk(tmp_path / "study.toml") as room, room.seat() as page:
                await page.press("Two ways")
                await page.fill_in("experience", games=3)
                step = await page.at("text", "Trial 1")
                assert "The trial lasts at most 4 seconds." in step["text"]

        asyncio.run(go())
        assert screens.duration(90.0) == "1 minute and 30 seconds"


class TestHappenings:
    """What has happened is told to the experimenter in plain sentences."""

    @pytest.mark.parametrize(
        "record",
        [
            *({"kind": "trial_end", "why": one} for one in happenings.ENDS),
            *({"kind": "alarm", "robot": "R1", "cause": one} for one in SEVERITY),
            *({"kind": "inject", "do": one, WHOM[one]: "R1", "done": True} for one in WHOM),
            *({"kind": "inject", "do": one, "done": False, "why": "no R9"} for one in WHOM),
            *({"kind": "found", "victim": "V1", "how": one} for one in happenings.FOUND),
            *({"kind": "lost", "robot": "R1", "why": one} for one in happenings.LOST),
            *({"kind": "credit", "victim": "V1", "credited": one} for one in (True, False)),
            {"kind": "trial_start"},
            {"kind": "error", "text": "the server died"},
        ],
        ids=str,
    )
    def test_no_word_of_the_log_is_left(self, record: dict[str, object]) -> None:
        """Each kind, cause and end there is has a sentence of its own."""
        told = happenings.sentence(record, 75.2, "trial 1 of 2")
        assert re.fullmatch(r"01:15 [A-Z].* .*\.", told), told
        assert "_" not in told
        assert "None" not in told

    def test_every_cause_has_its_words(self) -> None:
        """All alarms and all that can be made to happen are in the table."""
        assert set(happenings.ALARMS) == set(SEVERITY)
        assert set(happenings.INJECTS) == set(WHOM)

    def test_as_the_experimenter_reads_them(self) -> None:
        """Whole sentences, the end of an attempt too; what is not in the table is not told."""

        def told(record: dict[str, object], elapsed: float) -> str:
            return happenings.sentence(record, elapsed, "trial 1 of 2")

        assert told({"kind": "trial_start"}, 0.0) == "00:00 Trial 1 of 2 begins."
        end = {"kind": "trial_end", "why": "time"}
        assert told(end, 61.0) == "01:01 Trial 1 of 2 ends: the time is over."
        end = {"kind": "trial_end", "why": "operator", "text": "ended by the experimenter: lunch"}
        assert told(end, 3.0) == "00:03 Trial 1 of 2 ends: ended by the experimenter: lunch."
        inject = {"kind": "inject", "do": "robot_fails", "robot": "R4", "lasts": 60.0}
        assert told(inject, 5.0) == "00:05 R4 fails, for 60 s."
        found = {"kind": "found", "victim": "V1", "robot": "R2", "how": "mark"}
        assert told(found, 0.0) == "00:00 R2 has found V1 by a mark."
        assert told({"kind": "truth"}, 0.0) == ""
        ended = happenings.attempt_told("trial 1 of 2", "void", "the server died")
        assert ended == "Trial 1 of 2 is void and will be repeated (the server died)."


class TestWelcome:
    """Welcome and consent can be written in the study file."""

    def test_order(self, tmp_path: Path) -> None:
        """First the welcome, then the consent, then the forms."""

        async def go() -> None:
            async with desk(write_study(tmp_path, INLINE)) as room, room.seat() as page:
                step = await page.at("text")
                assert (step["text"], step["button"]) == ("Hello.\n\nSit down.", "Go on")
                await page.press()
                step = await page.at("text")
                assert (step["text"], step["button"]) == ("I take part.", "I agree")
                await page.press()
                await page.at("form", "experience")

        asyncio.run(go())

    def test_the_shipped_study_has_both(self, tmp_path: Path) -> None:
        """rsarsim says what is done, what is stored, and that one may stop."""
        (tmp_path / "study.toml").write_bytes((SHIPPED / "rsarsim.toml").read_bytes())
        folder = StudyFolder(tmp_path)
        assert "four robots" in folder.study.welcome
        assert "stop at any time" in consent_of(folder)
        assert "without your name" in consent_of(folder)

    def test_a_file_still_does(self, tmp_path: Path) -> None:
        """A name of one line is that of a file."""
        write_study(tmp_path)
        assert consent_of(StudyFolder(tmp_path)) == "You may stop at any time."


class TestExperimenter:
    """What the experimenter sees and may do."""

    def test_what_comes_next_in_plain_words(self, tmp_path: Path) -> None:
        """Now and next of the whole session; no condition is told."""

        async def go() -> None:
            study = write_study(tmp_path, "blind = true\n" + TRAINED)
            async with (
                desk(study) as room,
                room.seat() as page,
                room.experimenter() as leader,
            ):
                told = await leader.until(lambda one: one["type"] == "overview")
                assert (told["now"], told["next"]) == ("the consent", "the form Before we begin")
                await page.press("Two ways")
                await leader.until(lambda one: one.get("now") == "the form Before we begin")
                await page.fill_in("experience", games=3)
                before = "before training: waits until the participant begins"
                told = await leader.until(lambda one: one.get("now") == before)
                assert (told["next"], told["training"]) == ("training", True)
                await pass_it(leader)
                before = "before trial 1 of 2: waits until the participant begins"
                told = await leader.until(lambda one: one.get("now") == before)
                assert (told["next"], told["training"]) == ("trial 1 of 2", False)
                texts = [f"{one['now']} {one['next']}" for one in leader.said if "now" in one]
                assert not any("plain" in one or "delayed" in one for one in texts)
                for line in range(60):  # as many as two trials with alarms have
                    room.desk.log(f"Line {line}.")
                told = await leader.until(lambda one: "Line 59." in one.get("events", ()))
                assert "Line 0." in told["events"]

        asyncio.run(go())

    def test_a_training_is_passed(self, tmp_path: Path) -> None:
        """Before it began, with a reason on disk; elsewhere the order is refused."""

        async def go() -> None:
            async with (
                desk(write_study(tmp_path, TRAINED)) as room,
                room.seat() as page,
                room.experimenter() as leader,
            ):
                why = (await leader.ask("order", "refused", do="pass_training"))["why"]
                assert "no training" in why
                await page.press("Two ways")
                await page.fill_in("experience", games=3)
                await page.at("text", "Training")
                assert (await page.ask("order", "refused", do="pass_training"))["why"]
                why = (await leader.ask("order", "refused", do="pass_training", reason="NA"))["why"]
                assert "write the reason in words" in why
                await pass_it(leader)
                await page.at("text", "Trial 1 of 2")

        asyncio.run(go())
        folder = StudyFolder(tmp_path)
        (one,) = folder.attempts(folder.participants()[0].code, "training")
        assert (one.status, one.reason) == ("passed", "pilot")


class TestAroundATrial:
    """What stands where the panel does, before the world runs and after its end."""

    def test_the_experimenter_sees_that_it_waits(self, tmp_path: Path) -> None:
        """And participants see that it has ended, not a console whose link is lost."""
        heard: list[asyncio.Event] = []

        def run(pages: Web) -> Run:
            async def play(desk: Desk, step: Step) -> None:
                assert step.task is not None
                folder = desk.book.begin(step.task)
                desk.refresh()
                attempt = Attempt(desk, step, Options(), None)
                attempt._open({"operator 1": "http://127.0.0.1:1/#a", "instructor": "http://i"})
                for kind in ("trial_start", "trial_end"):
                    heard.append(asyncio.Event())
                    await heard[-1].wait()
                    attempt._hear({"kind": kind, "t_sim": 1.0})
                heard.append(asyncio.Event())
                await heard[-1].wait()
                desk.panels = None
                minute().write(folder)
                desk.book.close(folder, "complete", "")

            return play

        async def go() -> None:
            async with (
                desk(write_study(tmp_path), run) as room,
                room.seat() as page,
                room.experimenter() as leader,
            ):
                await page.press("Two ways")
                await page.fill_in("experience", games=3)
                await page.press("Trial 1")
                await page.at("panel")
                told = "trial 1 of 2: waits for a picture or the gamepad"
                await leader.until(lambda one: one.get("now") == told)
                before = len(leader.said)
                heard[-1].set()
                await leader.until(lambda one: one.get("now") == "trial 1 of 2", before)
                assert page.step["kind"] == "panel"
                heard[-1].set()
                assert (await page.at("wait"))["text"] == "The trial has ended."
                heard[-1].set()
                await page.at("form", "workload")

        asyncio.run(go())

    def test_the_end_tells_the_code(self, tmp_path: Path) -> None:
        """By which alone what is stored is found again, and can be deleted; however it ended."""
        study = study_of(tmp_path, DEVICES)
        session = Session(study, (Cell("plain", "A"), Cell("plain", "B")))
        for status in ("complete", "withdrawn", "excluded"):
            step = Step("end", None, 9, 0)
            text = screens.message(session, Past(status=status), step, 1, "", "K7QX")["text"]
            assert "Your code is K7QX." in text

        async def go() -> None:
            async with (
                desk(write_study(tmp_path / "real")) as room,
                room.seat() as page,
                room.experimenter() as leader,
            ):
                await page.at("text")
                await leader.ask("order", "done", do="end_session", reason="ill")
                step = await page.at("end")
                assert f"Your code is {step['session']}." in step["text"]

        asyncio.run(go())


async def pass_it(leader: Seat) -> None:
    """The experimenter passes the training."""
    await leader.ask("order", "done", do="pass_training", reason="pilot")


def test_a_blind_trial_does_not_show_its_condition(tmp_path: Path) -> None:
    """Its mission.toml says neither what robots do alone nor the title of its own mission."""
    text = STUDY.replace(
        'name = "delayed"', 'name = "delayed"\nunattended = "explore"\nmission = "two.toml"'
    )
    study = write_study(tmp_path, "blind = true\n" + text)
    other = (tmp_path / "one.toml").read_text().replace("One victim ahead", "Robots explore alone")
    (tmp_path / "two.toml").write_text(other)
    read = read_study(study)
    task = Task("trial", 1, cell=Cell("delayed", "A"))
    staged, _ = prepare(read, tmp_path, task, Conditions(tmp_path), Options())
    assert all(one.entry.unattended == "explore" for one in staged.robots)
    written = staged.mission_text()
    assert "explore" not in written
    assert "Two ways to look" in written
    open_study = read_study(write_study(tmp_path, text))
    staged, _ = prepare(open_study, tmp_path, task, Conditions(tmp_path), Options())
    assert "explore" in staged.mission_text()
