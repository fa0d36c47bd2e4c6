"""What only instructors ask for: the world's clock, scenarios, and what is to happen."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping

from usarsim_client import HangupError, ProtocolError
from usarsim_operator import scenarios
from usarsim_operator.injects import WHOM, Inject
from usarsim_operator.messages import LATER, Fields, Request
from usarsim_operator.pages import Page
from usarsim_operator.station import Station

Handler = Callable[[Page, Fields, Request], object]


class Instructing:
    """Handlers of their texts, for a desk."""

    def __init__(self, station: Station) -> None:
        self._station = station

    @property
    def handlers(self) -> Mapping[str, Handler]:
        """By the type of the text."""
        return {
            "pace": self._pace,
            "inject": self._inject,
            "load": self._load,
            "close": self._close,
        }

    def _later(self, page: Page, request: Request, work: Awaitable[object]) -> object:
        """Do something that waits, and answer when it is done."""

        async def answer() -> None:
            try:
                why = await work
                page.answer(request.id, not why, str(why or ""))
            except (ValueError, ProtocolError, HangupError) as error:
                page.answer(request.id, False, str(error))

        self._station.background(answer())
        return LATER

    def _pace(self, page: Page, fields: Fields, request: Request) -> object:
        scene = self._station.scene
        if scene is None or not scene.features["pace"]:
            raise ValueError("this server's clock cannot be changed")

        if fields["action"] == "reset":
            self._free()

        async def pace() -> None:
            assert scene is not None
            reply = await scene.request("pace", **fields)
            if fields["action"] == "reset":
                self._station.begin_anew(page.name, reply.get("blocked", ()))

        return self._later(page, request, pace())

    def _inject(self, page: Page, fields: Fields, request: Request) -> object:
        whom = WHOM[fields["do"]]
        if not fields.get(whom):
            raise ValueError(f"{fields['do']} needs {whom}")
        inject = Inject(**fields, by=page.name)
        return self._later(page, request, self._station.injects.do(inject))

    def _load(self, page: Page, fields: Fields, request: Request) -> object:
        title, members = scenarios.read_fleet(fields["scenario"])
        self._free()

        async def load() -> None:
            await scenarios.load(self._station, members)
            self._station.event("", "message", f"{title}: {len(members)} robots have come")

        return self._later(page, request, load())

    def _close(self, page: Page, fields: Fields, request: Request) -> object:
        self._free()

        async def close() -> None:
            await scenarios.close(self._station)

        return self._later(page, request, close())

    def _free(self) -> None:
        if self._station.mission is not None:
            raise ValueError("a mission is run here: its robots stay as they are")
