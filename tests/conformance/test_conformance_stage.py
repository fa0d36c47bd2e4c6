"""What the kit knows of its own stage."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import pytest

from usarsim_conformance.case import Case
from usarsim_conformance.lines import Line
from usarsim_conformance.registry import NotApplicable
from usarsim_conformance.stage import boxes, need_stage, one_of, spot


def _case(greeting: str | None) -> Case:
    """A case at a server with this greeting."""
    line = None if greeting is None else Line(greeting.encode() + b"\r\n")
    return cast(Case, SimpleNamespace(survey=SimpleNamespace(greeting=line)))


def test_places_are_in_the_frame_of_the_wire() -> None:
    """y to the right and z down, whether the scene or the world file tells them."""
    assert spot("belt", "KitBelt") == (-400.0, 200.0, -0.3)
    assert boxes("roof") == (((-400.0, -120.0, -3.1), (100.0, 100.0, 0.2)),)
    assert one_of("victim", "Lying")["status"] == "Unconscious"


def test_walls_stand_one_behind_the_other() -> None:
    """Stations stand between them, 3 m and more off each."""
    along = [middle[0] for middle, _ in boxes("wall_")]
    assert along == sorted(along)
    assert len(along) == 7
    assert min(along[3] - along[2], along[2] - along[1], along[1] - along[0]) >= 6.0


@pytest.mark.parametrize("greeting", ["NFO {Gametype X} {Level arena}", "NFO {Gametype X}", None])
def test_other_worlds_are_not_judged(greeting: str | None) -> None:
    """The reason names the level that there is and what is missing."""
    with pytest.raises(NotApplicable, match=r"not judged: the level is .* which has a roof"):
        need_stage(_case(greeting), "a roof")


def test_the_stage_is_known_by_its_level() -> None:
    """The greeting tells it."""
    need_stage(_case("NFO {Gametype X} {Level stage} {TimeLimit 20}"), "a roof")
