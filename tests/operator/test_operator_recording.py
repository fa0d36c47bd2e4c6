"""`usarsim console --record`: what a station keeps, and that a disk hurts nobody."""

from __future__ import annotations

import asyncio
import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import pytest

pytest.importorskip("aiohttp")

from console_harness import gateway
from virtual_station import VirtualPage, VirtualStation

from usarsim_operator import packets
from usarsim_operator.motion import Motion
from usarsim_operator.pages import Page
from usarsim_operator.recorder import ID
from usarsim_operator.recording import Packet, Recording, Text
from usarsim_operator.roles import LONGEST, Limits, Role
from usarsim_server.testing import running_server


def marked(path: Path) -> bool:
    """Whether a recorded state has marks, and a long input, which is cut, is recorded."""
    texts = [one.fields for one in Recording(path) if isinstance(one, Text)]
    inputs = [one["text"] for one in texts if one["type"] == "input"]
    return any(one.get("marks") for one in texts) and any(isinstance(one, str) for one in inputs)


def test_a_session_is_kept_and_a_full_disk_harms_nobody(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """HRI-08: texts of pages with their clocks, locks, marks, interventions, poses; then the disk
    is full, and the robot drives on."""

    async def play(port: int, scene: int) -> None:
        async with gateway(port, scene=scene) as one:
            station = one.station
            station.record(tmp_path / "a.rec")
            await station.spawn("P3AT", "R1")
            async with one.page(role=Role.INSTRUCTOR) as page:
                assert (await page.ask("take", robot="R1"))["ok"]
                assert (await page.ask("mark", robot="R1", place=[1, 2, 0]))["ok"]
                assert (await page.ask("pace", action="speed", factor=1.0))["ok"]
                await page.ws.send_str('{"type": "mark", "robot": "' + "x" * 5000 + '"}')
                await page.ask("camera", robot="R1", on=True, more="x" * 5000)
                await page.until(lambda: any(one[0] == packets.POSES for one in page.binary))
                assert station.recorder is not None
                writer = station.recorder._writer
                await page.until(lambda: marked(writer.path))

                def full(kind: bytes, clock: float, data: bytes) -> None:
                    raise OSError(28, "No space left on device")

                writer._write = full  # type: ignore[method-assign]
                await page.until(lambda: ID not in station.pages)
                for _ in range(3):
                    assert (await page.ask("drive", robot="R1", left=0.5, right=0.5))["ok"]

    with running_server(world="empty", scene_port=0, supervise="on") as (_, endpoints):
        asyncio.run(play(endpoints["control"].port, endpoints["scene"].port))
    assert "No space left on device; what was recorded before can be used" in caplog.text
    found = list(Recording(tmp_path / "a.rec"))
    texts = [one.fields for one in found if isinstance(one, Text)]
    inputs = [one for one in texts if one["type"] == "input"]
    said = {one["text"]["type"] for one in inputs if isinstance(one["text"], dict)}
    assert {"take", "mark", "pace", "ping"} <= said
    assert [len(one["text"]) for one in inputs if isinstance(one["text"], str)] == [2000]
    clocks = [one["gateway_clock"] for one in inputs]
    assert clocks == sorted(clocks)
    assert {"page", "role", "time"} <= inputs[0].keys()
    whats = {one["what"] for one in texts if one["type"] == "note"}
    assert any("take" in what or "took" in what or "holds" in what for what in whats), whats
    assert any(one["type"] == "state" and one["marks"] for one in texts)
    order = [one.fields["type"] if isinstance(one, Text) else one.kind for one in found]
    assert order.index("scene") < order.index("present") < order.index(packets.POSES)
    generations = {one["generation"] for one in texts if one["type"] == "present"}
    poses = [one for one in found if isinstance(one, Packet) and one.kind == packets.POSES]
    assert {int.from_bytes(one.contents[:4], "little") for one in poses} <= generations
    assert sum(one == "scene" for one in order) == 1


def test_hostile_pages_do_not_end_a_recording(tmp_path: Path) -> None:
    """CON-29: more texts than the disk takes are counted and left out; memory is bounded."""

    async def play(port: int) -> None:
        async with gateway(port) as one:
            station = one.station
            station.record(tmp_path / "a.rec")
            assert station.recorder is not None
            async with one.page() as page:
                other = station.pages[int(page.welcome["page"])]
                for length in (300, 1990):
                    lost = station.recorder.lost
                    for _ in range(5000):  # nothing is written meanwhile
                        said = '{"note": "' + "\u20ac" * length + '"}'
                        station.recorder.input(other, said, 0.0)
                    assert station.recorder.lost - lost > 4000
                    assert station.recorder.waiting < 100_000
                    lost = station.recorder.lost
                    station.recorder.note("note", {"what": "there is room for this"})
                    assert station.recorder.lost == lost
                    await asyncio.sleep(0.1)
                assert ID in station.pages
            assert not station.recorder.overrun

    with running_server(world="empty") as (_, endpoints):
        asyncio.run(play(endpoints["control"].port))


class _Kept:
    """An observer that counts by type what pages say, and keeps commands."""

    def __init__(self) -> None:
        self.inputs: Counter[str] = Counter()
        self.notes: Counter[str] = Counter()
        self.commands: list[Mapping[str, object]] = []

    def input(self, page: Page, text: str, heard: float) -> None:
        """Count it."""
        self.inputs[json.loads(text)["type"]] += 1

    def note(self, kind: str, facts: Mapping[str, object]) -> None:
        """Count it."""
        self.notes[kind] += 1
        if kind == "command":
            self.commands.append(facts)

    def event(self, fields: Mapping[str, object]) -> None:
        """Nothing."""


@pytest.mark.parametrize("kind", ["ground", "car"])
async def test_each_change_of_what_an_operator_drives_is_one_command(kind: str) -> None:
    """HRI-10: keys that are let go are a command too, or a robot would count as driven for as long
    as its operator holds it; what is said again, twenty times a second, is none."""
    station, kept = VirtualStation(None), _Kept()
    driven = station.spawned("R1")
    driven.motion = Motion(kind)
    page = VirtualPage(station, "Ada", Role.OPERATOR)
    assert (await page.ask("take", robot="R1"))["ok"]
    station.observers.add(kept)
    for power in (0.6, 0.6, 0.0, 0.0, 0.0, 0.6, 0.0, 0.0):
        assert (await page.ask("drive", robot="R1", left=power, right=power))["ok"]
    go, stand = (driven.motion.drive(one, one).decode().strip() for one in (0.6, 0.0))
    told = [(one["source"], one["text"]) for one in kept.commands]
    assert told == [("operator", one) for one in (go, stand, go, stand)]
    wheel = [one["value"] for one in page.texts if one.get("kind") == "wheel"]
    assert wheel == [0.6, 0.0, 0.6, 0.0]
    await station.end(page)


async def test_what_is_refused_is_counted_and_not_kept() -> None:
    """Twelve viewers say 200 texts a second for ten seconds: what they may not is kept nowhere,
    what they may at ten a second each; pings of operators are all answered, and kept at four."""
    station, kept = VirtualStation(None), _Kept()
    station.spawned("R1")
    station.observers.add(kept)
    viewers = [VirtualPage(station, f"V{n}", Role.VIEWER) for n in range(12)]
    pinging = [VirtualPage(station, f"O{n}", Role.OPERATOR) for n in range(4)]
    forbidden, nonsense, asking = viewers[:4], viewers[4:8], viewers[8:12]

    def flood() -> None:
        for _ in range(4):  # of 50 rounds a second
            for page in forbidden:
                page.say("drive", robot="R1", left=1.0, right=1.0, note="x" * 900)
            for page in nonsense:
                page.say("camera", robot="R1", on="perhaps")
            for page in asking:
                page.say("select", robot="R1")
            for page in pinging:
                page.say("ping", clock=0.0, ages={"R1": 0.1})

    await station.run(10.0, flood)
    assert set(kept.inputs) == {"select", "ping"}
    assert kept.inputs["select"] <= 4 * (64 + 10 * 10 + 1)
    assert kept.inputs["ping"] == kept.notes["frame_age"] <= 4 * (16 + 4 * 10 + 1)
    assert all(page.page.limits.exhausted for page in (*forbidden, *nonsense, *asking))
    assert not any(page.page.limits.exhausted for page in pinging)
    assert sum(one["type"] == "pong" for one in pinging[0].texts) > 1900
    await station.end(*viewers, *pinging)


def test_a_page_says_so_much_a_second() -> None:
    """Long texts count by their length: 128 Ki characters a second, twice as many at once."""
    limits, length = Limits(0.0), LONGEST
    assert sum(limits.hears(0.0, length) for _ in range(10)) == 4
    assert sum(limits.hears(1.0 + step / 100.0, length) for step in range(1000)) in (21, 22)
