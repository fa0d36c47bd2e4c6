"""JSON that others have written is read in one place, where all that is wrong is one error."""

from __future__ import annotations

from pathlib import Path

import pytest

import usarsim_client
import usarsim_server
from usarsim_server.protocol.json_text import parse_json

HOUSE = Path(usarsim_server.__file__).parent
TOOLS = Path(usarsim_client.__file__).parents[1]
ELSEWHERE = ("peers/", "fbx/library/child.py")
"""Programs that run beside this product, with other packages."""


@pytest.mark.parametrize(
    "text", ["[" * 100_000, '{"a":' * 100_000, "9" * 5000, "", "{", '"\udc80"[', b"\xff\xfe\xfa"]
)
def test_what_is_wrong_is_one_error(text: str | bytes) -> None:
    """Nesting that ends Python's stack, and numbers that it refuses, among it."""
    with pytest.raises(ValueError, match=r"."):
        parse_json(text)


@pytest.mark.parametrize("constant", ["NaN", "Infinity", "-Infinity"])
def test_what_json_has_no_numbers_for(constant: str) -> None:
    """Refused where others may write them; our own logs have them."""
    with pytest.raises(ValueError, match=f"{constant} is no number"):
        parse_json(f"[{constant}]", finite=True)
    assert parse_json(f"[{constant}]") != [0.0]
    assert parse_json(b'{"a": [1, 2.5, "x"]}', finite=True) == {"a": [1, 2.5, "x"]}


def test_it_is_read_in_one_place() -> None:
    """Whoever calls `json.loads` has to think of the stack, and some did not."""
    callers = {
        path.name
        for folder in (HOUSE, *TOOLS.glob("usarsim_*"))
        for path in folder.rglob("*.py")
        if "json.loads(" in path.read_text(encoding="utf-8")
        and not any(part in path.as_posix() for part in ELSEWHERE)
    }
    assert callers == {"json_text.py"}
