"""Impaired links between pages and gateway: O-39, CON-31."""

from __future__ import annotations

import asyncio
import statistics
import struct
from pathlib import Path

import pytest

from usarsim_operator.impaired_link import ImpairedLink
from usarsim_operator.impairment import Conditions, Plan, Way, read_plan
from usarsim_server.base.errors import UsarsimError

BAD = Conditions(delay=0.5, jitter=0.05, loss=0.1, seed=7)


def _lost(conditions: Conditions, stream: str = "1/0", frames: int = 2000) -> list[int]:
    way = Way(conditions, "Ada/out")
    return [n for n in range(frames) if way.send(9000, n / 10.0, stream) is None]


def test_loss_is_as_configured_and_the_same_for_a_seed() -> None:
    """O-39: 10 % within 5 % of it over many frames; the same seed loses the same frames."""
    lost = _lost(BAD, frames=40_000)
    assert abs(len(lost) / 40_000 - 0.1) < 0.005
    assert lost == _lost(BAD, frames=40_000)
    assert lost != _lost(Conditions(loss=0.1, seed=8), frames=40_000)
    other = _lost(BAD, "1/1")
    assert other != _lost(BAD)


def test_loss_of_a_stream_does_not_depend_on_others() -> None:
    """O-39: what else is sent, and when, changes nothing."""
    way, lost = Way(BAD, "Ada/out"), []
    for n in range(2000):
        way.send(100, n * 0.37, "state")
        way.send(100, n * 0.37)
        if way.send(9000, n * 0.37, "1/0") is None:
            lost.append(n)
    assert lost == _lost(BAD)


def test_delay_and_jitter_are_as_configured() -> None:
    """O-39, CON-31: 500 ms within 5 %, nothing overtakes, texts are never lost."""
    way, late, last = Way(BAD, "Ada/out"), [], 0.0
    for n in range(2000):
        arrival = way.send(100, n / 5.0)
        assert arrival is not None
        assert arrival > last
        last = arrival
        late.append(arrival - n / 5.0)
    assert statistics.mean(late) == pytest.approx(0.5, rel=0.05)
    assert min(late) >= 0.45 - 1e-9
    assert max(late) <= 0.55 + 1e-9


def test_bandwidth_lets_one_after_the_other_through() -> None:
    """CON-31: 20 kB/s."""
    way = Way(Conditions(bandwidth=20_000.0), "Ada/out")
    arrivals = [way.send(5000, 0.0) for _ in range(9)]
    assert arrivals == [pytest.approx(0.25 * (n + 1), abs=1e-4) for n in range(9)]
    assert way.free == pytest.approx(2.25)


def test_file_is_read_strictly(tmp_path: Path) -> None:
    file = tmp_path / "bad.toml"
    file.write_text('[link]\ndelay_ms = 200\nloss_percent = 5\nseed = 3\n[page."Ada"]\nseed = 4\n')
    plan = read_plan(file)
    assert plan.of("Bob") == Conditions(delay=0.2, loss=0.05, seed=3)
    assert plan.of("Ada") == Conditions(delay=0.2, loss=0.05, seed=4)
    assert read_plan(tmp_path / "bad.toml") == Plan(plan.rest, plan.pages)
    for text, problem in (
        ("[link]\ndelay = 1\n", "delay_ms"),
        ("[link]\nloss_percent = 101\n", "loss_percent"),
        ("[link]\ndelay_ms = 1\njitter_ms = 2\n", "jitter_ms"),
        ("[pages]\n", "pages"),
        ("link = 3\n", "link"),
    ):
        file.write_text(text)
        with pytest.raises(UsarsimError, match=problem):
            read_plan(file)


class _Socket:
    """Notes what arrives, and when a text does."""

    def __init__(self) -> None:
        self.got: list[str | bytes] = []
        self.text = asyncio.Event()

    async def send_str(self, data: str, compress: int | None = None) -> None:
        self.got.append(data)
        self.text.set()

    async def send_bytes(self, data: bytes, compress: int | None = None) -> None:
        self.got.append(data)


async def test_page_sees_gaps_where_frames_were_lost() -> None:
    """CON-31: what a page counts by the numbers of frames is what the link lost."""
    socket = _Socket()
    link = ImpairedLink(socket, Conditions(delay=0.02, loss=0.2, seed=1), "Ada")
    task = asyncio.create_task(link.run())
    for _ in range(200):
        await link.send_bytes(struct.pack("<BBHId", 1, 0, 0, 99, 0.0) + b"jpeg")
    await link.send_str('{"type":"event"}')
    await socket.text.wait()
    task.cancel()
    numbers = [struct.unpack_from("<I", one, 4)[0] for one in socket.got[:-1]]
    assert numbers == sorted(numbers)
    assert 200 - len(numbers) == link.out.lost
    assert 20 <= link.out.lost <= 60


async def test_texts_of_a_page_come_late_and_in_order() -> None:
    heard, last = list[str](), asyncio.Event()

    def take(text: str) -> None:
        heard.append(text)
        if text == "29":
            last.set()

    link = ImpairedLink(_Socket(), Conditions(delay=0.03, jitter=0.03, seed=2), "Ada")
    for n in range(30):
        link.hear(str(n), take)
    assert not heard
    await last.wait()
    assert heard == [str(n) for n in range(30)]
