"""Sessions with real trials: servers, gateways and sockets; pages are programs."""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import itertools
import json
import os
import re
import signal
import socket
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import psutil
import pytest
from desk_pages import STUDY, Room, Seat, desk, write_study

from usarsim_mission.errors import RunLogError
from usarsim_mission.match.replaying import replay
from usarsim_operator.packets import PICTURE
from usarsim_server.testing import PATIENCE
from usarsim_study.commands.export import export
from usarsim_study.dataset import collect
from usarsim_study.folder import StudyFolder
from usarsim_study.records import read_records
from usarsim_study.session.attempt import Runner
from usarsim_study.session.desk import Run
from usarsim_study.session.staging import Options, panel_port
from usarsim_study.session.web import Web
from usarsim_study.study_file import read_study

PROBES = """
[[probe]]
at = 1
question = "victims_marked"
[[probe]]
at = 2
question = "where_is"
robot = 2
"""


def trials(pages: Web) -> Run:
    """Real trials, as fast as they go."""
    return Runner(Options(speed="max"), lambda: pages.hosts)


class Panel:
    """The gateway's page of an operator. state: the newest one."""

    def __init__(self, ws: Any) -> None:
        self.ws, self.state = ws, dict[str, Any]()
        self.answers: list[dict[str, Any]] = []
        self.pictures = 0
        self._stirred = asyncio.Event()

    async def read(self) -> None:
        with contextlib.suppress(OSError):
            async for message in self.ws:
                if message.type.name == "TEXT":
                    told = message.json()
                    if told["type"] == "state":
                        self.state = told
                    elif told["type"] == "answer":
                        self.answers.append(told)
                elif message.data[0] == PICTURE:
                    self.pictures += 1
                self._stirred.set()

    async def ping(self) -> None:
        """Be there by the wall clock, too."""
        with contextlib.suppress(OSError):
            while True:
                await self.ws.send_json({"type": "ping", "clock": 0.0})
                await asyncio.sleep(1.0)

    async def ask(self, type: str, **fields: Any) -> dict[str, Any]:
        """Say something once the trial has begun; what is answered."""
        await self.until(lambda: self.state.get("time", 0.0) > 0.2)
        await self.ws.send_json({"type": type, "id": 1, **fields})
        await self.until(lambda: self.answers)
        return self.answers.pop()

    async def until(self, done: Callable[[], object]) -> None:
        """Read until something is so."""
        async with asyncio.timeout(PATIENCE):
            while not done():
                self._stirred.clear()
                await self._stirred.wait()


@contextlib.asynccontextmanager
async def panel(room: Room, page: Seat, **hello: object) -> AsyncIterator[Panel]:
    """Open the panel that a page is told to show; hello: what its page says more of itself."""
    step = await page.at("panel")
    base, _, words = step["url"].partition("/#")
    token = words.partition("&")[0]
    async with room.http.ws_connect(f"{base}/socket", headers={"Origin": base}) as ws:
        await ws.send_json({"type": "hello", "token": token, "name": "Page", **hello})
        one = Panel(ws)
        tasks = [asyncio.create_task(work) for work in (one.read(), one.ping())]
        try:
            yield one
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)


def servers() -> list[psutil.Process]:
    """Servers that we have started."""
    return [
        one
        for one in psutil.Process().children(recursive=True)
        if "usarsim_server" in one.cmdline()
    ]


async def begin(page: Seat) -> None:
    """Everything before the first trial."""
    await page.press("Two ways")
    await page.fill_in("experience", games=3)


@pytest.mark.slow
def test_a_session_that_is_cut_off_everywhere(tmp_path: Path) -> None:
    """O-45, HRI-17, HRI-18, HRI-16: the server is killed in one trial, the desk in another; both
    are void with a reason, repeated, and flagged. The experimenter ends the last one (O-44), which
    counts. A probe finds the world standing still."""

    bases: list[str] = []  # of panels, whose keys browsers keep by it

    async def seen(page: Seat) -> None:
        bases.append((await page.at("panel"))["url"].partition("/#")[0])

    async def first(room: Room) -> None:
        async with room.seat() as page, room.experimenter() as leader:
            await begin(page)
            await page.press("Trial 1")
            await seen(page)
            async with panel(room, page):
                await page.at("form", "probe-1")
                os.kill(servers()[0].pid, signal.SIGKILL)
                await page.answer("answer", 0)
                await page.say("hand_in")
                step = await page.at("text", "Trial 1")
            assert "interrupted by a fault" in step["text"]
            await page.press("Trial 1")
            await seen(page)
            async with panel(room, page) as drives:
                step = await page.at("form", "probe-1")
                assert step["freeze"] is True
                asked = "a question in the middle of the trial"
                now = await leader.until(lambda one: one.get("now") == asked)
                assert now["next"] == "trial 1 of 2 goes on"
                mark = {"type": "mark", "robot": "R1", "place": [4.0, 0.0, 0.0]}
                await drives.ws.send_json(mark)  # counts when the world goes on
                told = {"do": "message", "text": "Hurry"}
                await leader.say("order", do="inject", inject=told)
                await page.fill_in("probe-1", answer=0)
                await page.fill_in("probe-2", answer="up")
                await page.at("form", "workload")
            await page.fill_in("workload", mental=35)
            await page.press("Break")
            await page.press("Trial 2")
            await seen(page)
            async with panel(room, page):
                await page.at("form", "probe-1")

    async def second(room: Room) -> None:
        async with room.seat() as page, room.experimenter() as leader:
            step = await page.at("text", "Trial 2")
            assert "interrupted" in step["text"]
            await page.press("Trial 2")
            await seen(page)
            async with panel(room, page):
                await page.fill_in("probe-1", answer=1)
                await page.at("form", "probe-2")
                await leader.ask("order", "done", do="end_trial", reason="fire alarm")
                await page.fill_in("workload", mental=35)
            await page.fill_in("which")
            await page.at("end")

    async def go() -> None:
        study = write_study(tmp_path, STUDY + PROBES)
        port = panel_port("127.0.0.1", 0, 65535)
        one_port = Options("max", panel_port=port)

        def run(pages: Web) -> Run:
            return Runner(one_port, lambda: pages.hosts)

        async with desk(study, run) as room:
            await first(room)
        async with desk(study, run) as room:
            await second(room)
        assert bases == [f"http://127.0.0.1:{port}"] * 4

    asyncio.run(go())
    folder = StudyFolder(tmp_path)
    (who,) = folder.participants()
    assert who.status == "complete"
    attempts = [(one.path.name, one.status) for one in folder.attempts(who.code)]
    assert attempts == [
        ("trial-1", "void"), ("trial-1-2", "complete"),
        ("trial-2", "void"), ("trial-2-2", "complete"),
    ]  # fmt: skip
    reasons = [one.reason for one in folder.attempts(who.code) if one.status == "void"]
    assert reasons[0].startswith("the server has ended (by SIGKILL)")
    assert reasons[1].startswith("cut off: the desk ended")
    cut = read_records(folder.place(who.code) / "trial-2")
    assert next(one for one in cut if one["kind"] == "trial_end")["text"] == reasons[1]
    ended = read_records(folder.place(who.code) / "trial-2-2")
    last = next(one for one in ended if one["kind"] == "trial_end")
    early = "ended by the experimenter: fire alarm"
    assert (last["why"], last["text"]) == ("operator", early)
    records = read_records(folder.place(who.code) / "trial-1-2")
    session = next(one for one in records if one["kind"] == "session")
    assert (session["participant"], session["attempt"]) == (who.code, 2)
    assert session["allocation"] == folder.study.allocation.digest  # HRI-04
    begun = next(one["t_sim"] for one in records if one["kind"] == "trial_start")
    probes = [one for one in records if one["kind"] == "probe"]
    asked = [(round(one["t_sim"] - begun, 6), one["correct"]) for one in probes]
    void = read_records(folder.place(who.code) / "trial-1")
    assert [one["answers"] for one in void if one["kind"] == "form"] == [{"answer": 0}] * 2
    assert asked[0][1] is True  # no mark stood at that instant
    assert asked[1][1] is False  # the second robot is where it began
    assert all(0.0 <= at - due <= 0.1 for (at, _), due in zip(asked, (1.0, 2.0), strict=True))
    (inject,) = [one for one in records if one["kind"] == "inject"]
    assert 1.0 <= inject["t_sim"] - begun <= 1.2
    rows = [one["t_sim"] for one in records if one["kind"] == "truth"]
    assert max(b - a for a, b in itertools.pairwise(rows)) < 0.11
    numbers = [json.loads(line)["seq"] for name in ("events.jsonl", "truth.jsonl")
               for line in (folder.place(who.code) / "trial-1-2" / name).open()]  # fmt: skip
    assert sorted(numbers) == list(range(len(numbers)))  # O-46, with the form after it
    data = collect(folder)
    assert [one.attempt for one in data.trials] == [2, 2]
    assert [(one.status, one.reason) for one in data.trials] == [
        ("complete", ""),
        ("complete", early),
    ]
    assert data.trials[1].values["victims_found"] == 0.0  # it counts
    assert data.trials[0].values["probes_right"] == 0.5
    assert data.trials[0].values["tlx_raw"] == 35 / 6
    export(folder)
    private(tmp_path)


@pytest.mark.slow
def test_a_trial_waits_until_its_operator_is_ready(tmp_path: Path) -> None:
    """A page that says `ready` sees robots and first pictures of a world that stands, and nothing
    it drives counts; a trial that waits in vain is begun by the experimenter."""

    async def go() -> None:
        async with (
            desk(write_study(tmp_path, STUDY), trials) as room,
            room.seat() as page,
            room.experimenter() as leader,
        ):
            await begin(page)
            await page.press("Trial 1")
            async with panel(room, page, ready=True) as drives:
                await drives.until(lambda: drives.state.get("robots"))
                await drives.ws.send_json({"type": "select", "robot": "R1"})
                await drives.ws.send_json({"type": "take", "robot": "R1"})
                began = drives.state["time"]
                await drives.until(lambda: drives.pictures)
                for _ in range(5):
                    drives.state = {}
                    await drives.until(lambda: drives.state)
                    assert drives.state["waits"]
                    assert drives.state["time"] == began
                    assert drives.state["robots"][0]["holder"] is None
                await drives.ws.send_json({"type": "ready", "on": True})
                await drives.until(lambda: drives.state["time"] > began)
                assert not drives.state["waits"]
                await drives.until(lambda: drives.state["robots"][0]["holder"])
                await leader.ask("order", "done", do="end_trial")
                await page.fill_in("workload", mental=35)
            await page.press("Break")
            await page.press("Trial 2")
            async with panel(room, page, ready=True) as drives:
                await drives.until(lambda: drives.state.get("waits"))
                await leader.ask("order", "done", do="next")
                await drives.until(lambda: drives.state["time"] > began)

    asyncio.run(go())
    folder = StudyFolder(tmp_path)
    (who,) = folder.participants()
    first = folder.attempts(who.code)[0]
    assert first.status == "complete"
    again = asyncio.run(replay(first.path, tmp_path / "again"))  # with what was said before
    assert again["values"]["LO"] == 0.0


@pytest.mark.slow
def test_two_operators_train_and_share(tmp_path: Path) -> None:
    """HRI-19, HRI-05: both train until the criterion, one log has both, what each did adds up to
    what the team did; one alone drives where the condition says so. Nothing names a condition."""
    text = "blind = true\n" + STUDY.replace(
        'name = "delayed"', 'name = "delayed"\ndevice = "keyboard"'
    )
    text = text.replace(
        'name = "plain"', 'name = "plain"\ndevice = "keyboard"\noperators = "split"'
    )
    text += '[training]\nmission = "one.toml"\nvictims = 1\nattempts = 2\n'
    split = read_study(write_study(tmp_path, text)).allocation.order(1)[0].condition == "plain"
    said: list[object] = []

    async def mark(panel: Panel, ahead: float) -> None:
        place = [ahead, -0.3, 0.0]  # as pages say it: y to the right
        told = await panel.ask("mark", robot="R1", place=place)
        assert told["ok"], told

    async def together(pages: list[Seat], title: str, *marks: float) -> None:
        """A training or trial of some operators; each marks a place."""
        await asyncio.gather(*(one.at("text", title) for one in pages))
        for one in pages:
            await one.say("next")
        async with contextlib.AsyncExitStack() as stack:
            panels = [await stack.enter_async_context(panel(room, one)) for one in pages]
            for one, ahead in zip(panels, marks, strict=False):
                await mark(one, ahead)
            for one in pages:
                await one.past("panel")

    async def go() -> None:
        nonlocal room
        async with (
            desk(tmp_path / "study.toml", trials) as room,
            room.seat(1) as one,
            room.seat(2) as two,
        ):
            both = [one, two]
            await asyncio.gather(*(begin(page) for page in both))
            await together(both, "Training")
            assert (
                "You touched 0 things and marked 0 victims rightly. You can try 1 time more."
                in ((await one.at("text", "Training"))["text"])
            )
            await together(both, "Training", 4.0)
            for trial in (1, 2):
                drive = both if (trial == 1) == split else both[:1]
                await together(drive, f"Trial {trial}", 4.0, 9.0)
                for page in drive:
                    await page.fill_in("workload", mental=35 if page is one else 65)
                for page in both if trial == 1 else ():
                    await page.press("Break")
            for page in both:
                await page.fill_in("which", preferred="first")
            for page in both:
                await page.at("end")
            said.extend([*one.said, *two.said])

    room: Any = None
    asyncio.run(go())
    folder = StudyFolder(tmp_path)
    (who,) = folder.participants()
    trainings = [(one.path.name, one.status) for one in folder.attempts(who.code, "training")]
    assert trainings == [("training-1", "failed"), ("training-1-2", "passed")]
    data = collect(folder)
    shared = next(one for one in data.trials if one.condition == "plain")
    assert (shared.values["marks_valid"], shared.values["marks_wrong"]) == (1, 1)
    assert shared.values["tlx_raw"] == (35 + 65) / 2 / 6
    for measure, each in (("marks_valid", [1, 0]), ("marks_wrong", [0, 1])):
        parts = [
            one.value for one in data.parts
            if (one.trial, one.level, one.measure) == (shared.trial, "operator", measure)
        ]  # fmt: skip
        assert parts == each
    told = json.dumps(said)
    for path in folder.place(who.code).rglob("*"):
        told += path.name + (content(path).decode("latin-1") if path.is_file() else "")
    assert "plain" not in told
    assert "delayed" not in told
    sessions = [
        next(one for one in read_records(run.path) if one["kind"] == "session")
        for run in folder.attempts(who.code)
    ]
    assert [one["device"] for one in sessions] == [None, None]
    assert "keyboard" not in told
    with pytest.raises(RunLogError, match="--device"):
        asyncio.run(replay(folder.attempts(who.code)[0].path, tmp_path / "again"))
    private(tmp_path)


def content(path: Path) -> bytes:
    """All that a file says."""
    data = path.read_bytes()
    return gzip.decompress(data) if data[:2] == b"\x1f\x8b" else data


def private(folder: Path) -> None:
    """HRI-16: no address, user agent, host name or time of day stands in any file."""
    name = re.escape(socket.gethostname().encode())
    numbers = rb"(\d{1,3}\.){3}\d{1,3}|\d\d:\d\d:\d\d|aiohttp|Mozilla|"
    wrong = re.compile(rb"\b(" + numbers + name + rb")\b")
    for path in folder.rglob("*"):
        if path.is_file():
            found = wrong.search(content(path))
            assert found is None, f"{path}: {found}"
