"""Serves the page of a study and plays a list of steps to it, as a desk does, without a study.

Run it to work on the page: ``python tests/operator/fake_desk.py``; it prints a URL per seat.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from aiohttp import WSMsgType, web
from fake_gateway import PAGE

from usarsim_report.page_files import page_file, page_headers
from usarsim_study.errors import StudyError
from usarsim_study.forms import Form, FormState, Item
from usarsim_study.instruments import nasa_tlx, nasa_tlx_weighted, sart, sus

TOKEN, EXPERIMENTER = "seat-1", "experimenter"
TEXT = {
    "kind": "text",
    "title": "Welcome",
    "text": "You will drive four robots in an office and look for people.\n\nYour answers are kept "
    "under a random code. You may stop at any time.",
    "button": "I agree",
}
END = {"kind": "end", "title": "Thank you", "text": "That was all."}
QUESTIONS = Form(
    "before",
    "questionnaire",
    "Before we begin",
    "Your answers are kept under a random code.",
    (
        Item("games", "How often do you play video games?", low=1, high=7, left="never",
             right="every day"),
        Item("hand", "Which hand do you write with?", "choice",
             choices=(("left", "Left"), ("right", "Right"), ("both", "Both"))),
        Item("glasses", "Do you wear glasses?", "flag"),
        Item("age", "How old are you?", low=18, high=99, required=False),
        Item("words", "What do you know about rescue robots?", "text", required=False, page=2),
    ),
)  # fmt: skip
PROBE = Form(
    "probe-1",
    "questionnaire",
    "A question",
    "The robots stand still meanwhile.",
    (Item("nearest", "Which robot is nearest to the last mark?", "choice",
          choices=tuple((f"R{n}", f"R{n}") for n in range(1, 5))),),
)  # fmt: skip
OVERVIEW = {
    "type": "overview",
    "participant": "K7QX",
    "number": 3,
    "status": "running",
    "step": {"kind": "panel", "what": "trial 2"},
    "now": "trial 2 of 4",
    "next": "the form workload after trial 2",
    "training": False,
    "trial": 2,
    "attempt": 1,
    "time": 318.4,
    "score": 2.0,
    "panel": "http://127.0.0.1:1/#instructor",
    "seats": [{"seat": 1, "connected": True}, {"seat": 2, "connected": False}],
    "events": ["04:12  R2 enters yellow", "04:40  found MaleVictim_1 by R2", "05:02  mark 3 set"],
    "robots": ["R1", "R2", "R3", "R4"],
    "victims": ["MaleVictim_1"],
}


def form_step(form: Form, **more: Any) -> dict[str, Any]:
    """A step that shows a form."""
    return {"kind": "form", "form": form.description(), "made_of": form, **more}


class FakeDesk:
    """A desk without a study: steps in their order, answers in memory.

    Attributes:
        steps: what is shown, one after the other. place: of the present one.
        texts: what pages said. overview: what the experimenter sees.
    """

    def __init__(self, *steps: dict[str, Any]) -> None:
        self.steps, self.place = list(steps), 0
        self.texts: list[dict[str, Any]] = []
        self.overview: dict[str, Any] = OVERVIEW
        self.states: dict[int, FormState] = {}
        self._sockets: set[web.WebSocketResponse] = set()
        self._runner: web.AppRunner

    @property
    def state(self) -> FormState:
        """The form of the present step."""
        made_of = self.steps[self.place]["made_of"]
        return self.states.setdefault(self.place, FormState(made_of))

    def step(self) -> dict[str, Any]:
        """What a page is told of the present step."""
        told = {key: value for key, value in self.steps[self.place].items() if key != "made_of"}
        if told["kind"] == "form":
            state = self.state
            told = {**told, "answers": dict(state.answers), "page": state.page}
        return {"type": "step", "step": self.place + 1, **told}

    async def go(self, place: int) -> None:
        """Show another step."""
        self.place = place
        for socket in set(self._sockets):
            await socket.send_json(self.step())

    async def _hear(self, socket: web.WebSocketResponse, text: dict[str, Any]) -> None:
        kind, step = text["type"], text.get("step")
        if kind == "ping":
            await socket.send_json({"type": "pong"})
        elif kind == "order":
            await socket.send_json({"type": "done", "do": text["do"]})
        elif step != self.place + 1:
            await socket.send_json({"type": "refused", "step": step, "why": "that was before"})
        elif kind == "next":
            await self.go(self.place + 1)
        elif kind == "answer":
            try:
                self.state.answer(text["item"], text["value"], text["clock"])
            except StudyError as error:
                await socket.send_json({"type": "refused", "step": step, "why": str(error)})
            else:
                await socket.send_json({"type": "saved", "step": step, "item": text["item"]})
        elif kind == "hand_in":
            try:
                self.state.hand_in()
            except StudyError as error:
                missing = list(self.state.missing())
                why = {"why": str(error), "missing": missing}
                await socket.send_json({"type": "refused", "step": step, **why})
            else:
                await self.go(self.place + 1)

    async def _socket(self, request: web.Request) -> web.WebSocketResponse:
        socket = web.WebSocketResponse()
        await socket.prepare(request)
        hello = await socket.receive_json()
        if hello.get("token") not in (TOKEN, EXPERIMENTER):
            await socket.close(code=1008, message=b"the token is wrong")
            return socket
        if hello["token"] == EXPERIMENTER:
            await socket.send_json(self.overview)
        else:
            self._sockets.add(socket)
            await socket.send_json(self.step())
        try:
            async for message in socket:
                if message.type is WSMsgType.TEXT:
                    text = json.loads(message.data)
                    self.texts.append(text)
                    await self._hear(socket, text)
        finally:
            self._sockets.discard(socket)
        return socket

    async def _file(self, request: web.Request) -> web.StreamResponse:
        headers = page_headers(frames="http://127.0.0.1:*")
        return page_file(Path(PAGE), request.match_info["name"], headers, "study.html")

    @contextlib.asynccontextmanager
    async def serve(self, port: int = 0) -> AsyncIterator[int]:
        """Serve until the block ends, or `stop`; gives the port."""
        app = web.Application()
        app.add_routes([web.get("/socket", self._socket), web.get("/{name:[^/]*}", self._file)])
        self._runner = web.AppRunner(app, shutdown_timeout=0.1)
        await self._runner.setup()
        await web.TCPSite(self._runner, "127.0.0.1", port, reuse_address=True).start()
        try:
            yield self._runner.addresses[0][1]
        finally:
            await self.stop()

    async def stop(self) -> None:
        """Be gone, as a desk that was killed."""
        for socket in set(self._sockets):
            await socket.close()
        await self._runner.cleanup()


async def main() -> None:
    forms = (QUESTIONS, nasa_tlx("tlx"), nasa_tlx_weighted("weighted"), sus("sus"), sart("sart"))
    desk = FakeDesk(TEXT, *map(form_step, forms), END)
    async with desk.serve() as port:
        for token in (TOKEN, EXPERIMENTER):
            print(f"http://127.0.0.1:{port}/#{token}", flush=True)
        await asyncio.Event().wait()


if __name__ == "__main__":
    asyncio.run(main())
