"""Every seed, and every input that was ever found, through its target, without atheris."""

from __future__ import annotations

import random
import sys

import pytest
from targets import CORPUS, TARGETS

KEPT = sorted(path for path in CORPUS.rglob("*") if path.is_file())
GROWTH = 16


@pytest.mark.parametrize("name", sorted(TARGETS))
def test_seeds(name: str) -> None:
    """What a target begins with, and what a little damage makes of it."""
    chosen = TARGETS[name]
    beginnings = chosen.seeds()
    assert beginnings
    chance = random.Random(name)
    for seed in beginnings:
        chosen.run(seed)
        for _ in range(20):
            damaged = bytearray(seed[: chance.randrange(len(seed) + 1)] or b"x")
            for _ in range(chance.randrange(4)):
                damaged[chance.randrange(len(damaged))] = chance.randrange(256)
            chosen.run(bytes(damaged))


@pytest.mark.parametrize("path", KEPT, ids=lambda path: f"{path.parent.name}-{path.name}")
def test_finds(path: object) -> None:
    """Inputs that a target once could not stand."""
    assert path in KEPT
    TARGETS[path.parent.name].run(path.read_bytes())  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", sorted(name for name, one in TARGETS.items() if one.linear))
def test_work_is_linear(name: str) -> None:
    """Sixteen times as much input makes at most some thirty times as many calls."""
    chosen = TARGETS[name]
    for seed in [*chosen.seeds(), b"{", b"{a ", b"U", b"O", b"SEND ", b"\xff", b"}{", b"1,", b"\r"]:
        once = seed * (1 + 256 // len(seed))
        assert calls(name, once * GROWTH) <= 2 * GROWTH * calls(name, once) + 1000, seed


def calls(name: str, data: bytes) -> int:
    """Calls of functions, those of Python itself included, that a target makes."""
    made = 0

    def count(frame: object, event: str, argument: object) -> None:
        nonlocal made
        made += event in ("call", "c_call")

    sys.setprofile(count)
    try:
        TARGETS[name].run(data)
    finally:
        sys.setprofile(None)
    return made
