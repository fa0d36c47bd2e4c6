"""Fixtures of this room: the shipped worlds, each built once."""

from __future__ import annotations

import pytest
from shipped_worlds import NAMES, Built, build


@pytest.fixture(params=NAMES)
def shipped(request: pytest.FixtureRequest) -> Built:
    """Each shipped world in turn."""
    return build(request.param)


@pytest.fixture
def arena() -> Built:
    """The arena."""
    return build("arena")


@pytest.fixture
def office() -> Built:
    """The office."""
    return build("office")


@pytest.fixture
def proving_ground() -> Built:
    """The proving ground."""
    return build("proving_ground")
