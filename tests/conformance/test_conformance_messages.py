"""What the messages of failing verdicts say: the cause, what was seen, and what is right."""

from __future__ import annotations

from itertools import product

import pytest

from usarsim_conformance.checks.scene import Arrangement, arrangement

_SIZE = 640, 480
_RED, _BLUE = (429.0, 94.0), (211.0, 214.0)
"""Where the cubes belong in a picture."""


@pytest.mark.parametrize("flags", list(product((False, True), repeat=3)))
def test_the_arrangement_of_a_picture_is_told(flags: tuple[bool, bool, bool]) -> None:
    """Exchanged colours are neither a mirrored picture nor one that is turned by half a turn."""
    exchanged, mirrored, inverted = flags
    red, blue = (
        (640.0 - x if mirrored else x, 480.0 - y if inverted else y) for x, y in (_RED, _BLUE)
    )
    seen = (blue, red) if exchanged else (red, blue)
    assert arrangement(seen, (_RED, _BLUE), _SIZE) == Arrangement(*flags)
