"""A desk in this process, and pages that are programs: what tests of sessions share."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import aiohttp
from logs import minute

from usarsim_server.testing import PATIENCE
from usarsim_study.folder import StudyFolder
from usarsim_study.session.desk import EXPERIMENTER, Desk, Run
from usarsim_study.session.leading import lead_sessions
from usarsim_study.session.opening import open_folder
from usarsim_study.session.steps import Step
from usarsim_study.session.web import TOKENS, Web, kept_tokens, serving
from usarsim_study.study_file import read_study

Message = dict[str, Any]

STUDY = """\
title = "Two ways to look"
seed = 5
participants = 4
primary = "victims_found"
consent = "consent.txt"
[[condition]]
name = "plain"
[[condition]]
name = "delayed"
[[layout]]
name = "A"
mission = "one.toml"
[[layout]]
name = "B"
mission = "one.toml"
seed = 4
[[form]]
name = "experience"
kind = "questionnaire"
when = "before"
title = "Before we begin"
[[form.item]]
name = "games"
text = "How often do you play?"
[[form.item]]
name = "words"
text = "What else?"
kind = "text"
required = false
page = 2
[[form]]
name = "workload"
kind = "nasa-tlx"
when = "after_trial"
[[form]]
name = "which"
kind = "preference"
when = "after"
"""
MISSION = """\
schema = "usar-mission/1"
title = "One victim ahead"
world = "empty"
time_limit = 4
[[robot]]
name = "R1"
class = "P3AT_real"
position = [0.0, 0.0, 0.25]
[[robot]]
name = "R2"
class = "P3AT_real"
position = [0.0, 3.0, 0.25]
[[victim]]
name = "MaleVictim_0"
position = [4.0, 0.3, 0.12]
"""


def write_study(folder: Path, text: str = STUDY, mission: str = MISSION) -> Path:
    """A study file with all that it names."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "consent.txt").write_text("You may stop at any time.\n")
    (folder / "one.toml").write_text(mission)
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"


async def pretended(desk: Desk, step: Step) -> None:
    """A trial without a server: its log is written at once."""
    assert step.task is not None
    folder = desk.book.begin(step.task)
    minute().write(folder)
    desk.book.close(folder, "complete" if step.task.kind == "trial" else "passed", "")


class Seat:
    """A page of a seat. step: the newest one; said: everything that was told, in order."""

    def __init__(self, ws: aiohttp.ClientWebSocketResponse) -> None:
        self.ws, self.step = ws, Message()
        self.said: list[Message] = []
        self.closed = asyncio.Event()
        self._stirred = asyncio.Event()

    async def read(self) -> None:
        async for message in self.ws:
            told = message.json()
            self.said.append(told)
            if told["type"] == "step":
                self.step = told
            self._stirred.set()
        self.closed.set()

    async def say(self, type: str, **fields: Any) -> None:
        """Say something about the present step."""
        await self.ws.send_json({"type": type, "step": self.step.get("step"), **fields})

    async def ask(self, type: str, *answers: str, **fields: Any) -> Message:
        """Say something; what comes back of these types."""
        count = len(self.said)
        await self.say(type, **fields)
        return await self.until(lambda one: one["type"] in answers, count)

    async def until(self, fits: Callable[[Message], object], since: int = 0) -> Message:
        """The first text that fits, from the n-th one on."""
        async with asyncio.timeout(PATIENCE):
            while True:
                for one in self.said[since:]:
                    if fits(one):
                        return one
                self._stirred.clear()
                await self._stirred.wait()

    async def at(self, kind: str, title: str = "") -> Message:
        """The present step, once it is of a kind."""
        async with asyncio.timeout(PATIENCE):
            while self.step.get("kind") != kind or title not in str(
                self.step.get("title") or self.step.get("form", {}).get("form", "")
            ):
                self._stirred.clear()
                await self._stirred.wait()
        return self.step

    async def past(self, kind: str) -> None:
        """Until the present step is of another kind."""
        async with asyncio.timeout(PATIENCE):
            while self.step.get("kind") == kind:
                self._stirred.clear()
                await self._stirred.wait()

    async def press(self, title: str = "") -> None:
        """Press the button of a text."""
        count, step = len(self.said), await self.at("text", title)
        await self.say("next")
        await self.until(lambda one: one["type"] == "step" and one != step, count)

    async def answer(self, item: str, value: object) -> Message:
        """Give an answer; `saved`, or why not."""
        return await self.ask("answer", "saved", "refused", item=item, value=value, clock=1.5)

    async def fill_in(self, name: str, **given: object) -> None:
        """Answer a form, the least of what is asked if nothing else is given, and hand it in."""
        count, step = len(self.said), await self.at("form", name)
        for page in step["form"]["pages"]:
            for item in page:
                value = given.get(item["name"], least(item))
                if value is not None:
                    assert (await self.answer(item["name"], value))["type"] == "saved"
        await self.say("hand_in")
        await self.until(lambda one: one["type"] == "step" and one["step"] != step["step"], count)


def least(item: Message) -> object:
    """The first answer that an item takes."""
    if item["kind"] == "choice":
        return item["choices"][0]["name"]
    return {"scale": item.get("low"), "flag": False, "text": None}[item["kind"]]


class Room:
    """A desk that is served. desk: of the session that runs. leading: leads one after another."""

    def __init__(self, folder: StudyFolder, urls: dict[int, str], http: aiohttp.ClientSession):
        self.folder, self.urls, self.http = folder, urls, http
        self.desk: Desk
        self.leading: asyncio.Task[None]

    @contextlib.asynccontextmanager
    async def seat(self, seat: int = 1) -> AsyncIterator[Seat]:
        """A page of a seat, that has said its token."""
        base, _, token = self.urls[seat].partition("/#")
        async with self.http.ws_connect(f"{base}/socket", headers={"Origin": base}) as ws:
            page = Seat(ws)
            await ws.send_json({"type": "hello", "token": token})
            reading = asyncio.create_task(page.read())
            try:
                yield page
            finally:
                reading.cancel()
                await asyncio.gather(reading, return_exceptions=True)

    def experimenter(self) -> contextlib.AbstractAsyncContextManager[Seat]:
        """The page of the experimenter."""
        return self.seat(EXPERIMENTER)


@contextlib.asynccontextmanager
async def desk(
    study: Path, run: Run | Callable[[Web], Run] = pretended, sessions: int = 1
) -> AsyncIterator[Room]:
    """Serve the desk of a study file; leaving kills it, whatever it does."""
    read_study(study).allocation.export(study.parent)  # its missions need no look
    folder = open_folder(str(study), None)
    pages = Web(kept_tokens(folder.path / TOKENS), "http://127.0.0.1:*")
    async with (
        aiohttp.ClientSession() as http,
        serving(pages, "127.0.0.1", 0) as urls,
    ):
        room = Room(folder, urls, http)
        runs: Any = run(pages) if run is not pretended else run  # type: ignore[arg-type, call-arg]

        def begins(one: Desk) -> None:
            room.desk = one

        room.leading = leading = asyncio.create_task(
            lead_sessions(folder, pages, runs, sessions=sessions, begins=begins)
        )
        await asyncio.sleep(0.0)
        try:
            yield room
            if leading.done():
                leading.result()
        finally:
            leading.cancel()
            await asyncio.gather(leading, return_exceptions=True)
