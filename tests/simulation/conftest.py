"""Fixtures of this room."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import pytest
from hypothesis import settings
from sim_fakes import (
    Start,
    simulation,
)

from usarsim_server.simulation.simulation import Simulation

# The same examples in every run, and no complaints about a busy machine.
settings.register_profile("deterministic", derandomize=True, deadline=None)
settings.load_profile("deterministic")


@pytest.fixture(autouse=True)
def mujoco_warnings() -> Iterator[list[str]]:
    """Warnings of MuJoCo, collected instead of written to a file in the working directory."""
    warnings: list[str] = []
    mujoco.set_mju_user_warning(warnings.append)
    yield warnings
    mujoco.set_mju_user_warning(None)


@pytest.fixture
def start() -> Iterator[Start]:
    """Starts simulations with a physics thread and stops them in the end."""
    running: list[Simulation] = []

    def begin(**options: object) -> Simulation:
        running.append(simulation(**options))  # type: ignore[arg-type]
        running[-1].start()
        return running[-1]

    yield begin
    for one in running:
        one.stop()
