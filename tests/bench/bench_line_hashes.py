"""Compares the lines of the server with the stored hashes, one group of classes after another."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from usarsim_bench.linehash import Stored, hashes

STORED = Path(__file__).with_name("line_hashes.json")
GROUPS = 6
"""Groups of about equal cost; two files of tests share them, so that two processes can."""


def group(number: int) -> list[str]:
    """Every `GROUPS`-th class or session; none is left out."""
    names = list(json.loads(STORED.read_text(encoding="utf-8"))["hashes"])
    return names[number::GROUPS]


def compare(number: int) -> None:
    """Fail with the names of all classes of a group whose lines are not those of before."""
    stored = Stored.read(STORED)
    if strange := stored.strangeness():
        pytest.skip(f"numbers may differ in the last bit: {strange}")
    names = group(number)
    found = hashes(names)
    differing = [name for name in names if found[name] != stored.hashes[name]]
    assert not differing, (
        f"the lines of {', '.join(differing)} have changed; to see where, dump them before and "
        "after: python -m usarsim_bench.linehash --dump DIR, then --against DIR; if they "
        "should have changed, store them by --write"
    )
