"""A page that is a program in this process: what it says counts, and is logged, as a page's."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
from collections.abc import AsyncIterator
from typing import Any

from usarsim_operator.pages import Page
from usarsim_operator.requests import Desk
from usarsim_operator.roles import Role
from usarsim_operator.station import Station
from usarsim_server.protocol.json_text import parse_json


class ProgramPage:
    """Says texts and waits for answers; what else it is told it forgets.

    Attributes:
        page: as the station knows it.
    """

    def __init__(self, station: Station, desk: Desk, name: str, role: Role, seat: int = 1) -> None:
        self._station, self._desk = station, desk
        self._ids = itertools.count(1)
        self._answers: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self.page = Page(station.new_id(), name, role, self, station.now, seat=seat)

    async def ask(self, type: str, **fields: object) -> dict[str, Any]:
        """Say something; its answer, which in lockstep comes at the next tick."""
        number = next(self._ids)
        answer: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
        self._answers[number] = answer
        said = {"type": type, "id": number, **fields, "clock": self._station.time}
        self._desk.hear(self.page, json.dumps(said))
        return await answer

    async def send_str(self, data: str, compress: int | None = None) -> None:
        """Take what the page is told."""
        said = parse_json(data)
        answer = self._answers.pop(said.get("id") or 0, None)
        if said["type"] == "answer" and answer is not None and not answer.done():
            answer.set_result(said)

    async def send_bytes(self, data: bytes, compress: int | None = None) -> None:
        """Nobody sees it."""


@contextlib.asynccontextmanager
async def program_page(
    station: Station, desk: Desk, name: str, role: Role
) -> AsyncIterator[ProgramPage]:
    """A page that is there while inside."""
    found = ProgramPage(station, desk, name, role)
    station.join(found.page)
    sending = asyncio.create_task(found.page.send_all())
    try:
        yield found
    finally:
        station.leave(found.page)
        sending.cancel()
        await asyncio.gather(sending, return_exceptions=True)
