"""Fixtures of the service tests."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

import pytest
from far_machine import FarMachine, lacking
from images_harness import FakeSource, RunningImages
from services_harness import Running
from wireless_harness import Line
from wireless_harness import Running as Radio

from usarsim_server.services.control import ControlLimits


@pytest.fixture
def control() -> Iterator[Callable[..., Running]]:
    """Starts control services: `control(limits, hold=...)`; they end with the test."""
    with contextlib.ExitStack() as stack:

        def start(limits: ControlLimits | None = None, *, hold: bool = False) -> Running:
            return stack.enter_context(Running(limits or ControlLimits(), hold))

        yield start


@pytest.fixture
def images() -> Iterator[type[RunningImages]]:
    """Starts image services, as `RunningImages`; they end with the test."""
    started: list[RunningImages] = []

    class Started(RunningImages):
        def __init__(self, *arguments, **options) -> None:  # type: ignore[no-untyped-def]
            super().__init__(*(arguments or (FakeSource(),)), **options)
            started.append(self)

    yield Started
    for running in started:
        running.stop()


@pytest.fixture
def running() -> Iterator[Radio]:
    """The wireless services, and two stations that hear each other."""
    with Radio(Line(A=0, B=1)) as radio:
        yield radio


@pytest.fixture
def far_machine() -> Iterator[FarMachine]:
    """Another machine, which can be switched off; it is taken away with the test."""
    if reason := lacking():
        pytest.skip(reason)
    try:
        machine = FarMachine()
    except OSError as error:
        pytest.skip(f"a machine that can be switched off needs network namespaces: {error}")
    yield machine
    machine.remove()
