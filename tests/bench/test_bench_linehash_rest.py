"""Lines of every class are those of the stored hashes: the other half."""

from __future__ import annotations

import pytest
from bench_line_hashes import GROUPS, compare


@pytest.mark.parametrize("number", range(GROUPS // 2, GROUPS))
def test_lines_are_the_stored_ones(number: int) -> None:
    """No class of the group says anything else than when the hashes were stored."""
    compare(number)
