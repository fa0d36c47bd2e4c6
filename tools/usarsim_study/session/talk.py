"""What a desk and its pages have of each other: a page to tell, a form in a trial, a panel."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

from usarsim_server.protocol.json_text import parse_json
from usarsim_study.forms import Form, FormState
from usarsim_study.session.screens import Message


class Page(Protocol):
    """One open page of a seat."""

    def tell(self, message: Message) -> None:
        """Send a text; never waits."""

    def end(self) -> None:
        """Shut it out; it comes back, and says again what was not saved."""


class RefusedError(Exception):
    """A text of a page that cannot be obeyed.

    Attributes:
        missing: items that have to be answered first. item: whose value never will be an answer.
    """

    def __init__(self, why: str, missing: tuple[str, ...] = (), item: str | None = None) -> None:
        super().__init__(why)
        self.missing, self.item = missing, item


@dataclass(slots=True)
class Ask:
    """A form in the middle of a trial, while the world stands still.

    Attributes:
        number: of its step. states: as far as each seat has filled it in.
        keep: puts what a seat has answered into the log of the trial.
    """

    number: int
    form: Form
    states: dict[int, FormState]
    keep: Callable[[int, FormState], None]
    done: asyncio.Event = field(default_factory=asyncio.Event)


@dataclass(slots=True)
class Panels:
    """What runs now: who sees which page of the gateway.

    Attributes:
        step: number of the step `panel`. urls: of the gateway's page, by seat.
        line: above it. end: ends it, by what status and why; `complete`: it counts as it is.
        inject: makes something happen; why it did not. begin: lets it wait for nobody any more;
            False where it does not wait. watch: how it goes, for overviews.
        waits: the world stands until pages are ready. over: what pages show from its end on.
    """

    step: int
    urls: dict[int, str]
    line: str
    end: Callable[[str, str], None]
    inject: Callable[[dict[str, Any]], Awaitable[str]]
    begin: Callable[[], bool] = lambda: False
    watch: Message = field(default_factory=dict)
    waits: bool = False
    over: str = ""


def read_object(text: str) -> Message:
    """What a page says, as an object.

    Raises:
        RefusedError: it is none.
    """
    try:
        said = parse_json(text)
    except ValueError:
        said = None
    if not isinstance(said, dict):
        raise RefusedError("this is no JSON object")
    return said
