"""O-38, CON-22: pictures go out as fast as a page draws them, and as small as its link wants."""

from __future__ import annotations

import asyncio
import io
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from virtual_station import VirtualPage, VirtualStation

from usarsim_client import Picture, ProtocolError
from usarsim_operator import packets
from usarsim_operator.impaired_link import ImpairedLink
from usarsim_operator.impairment import Conditions
from usarsim_operator.pictures import CameraFeed, jpeg
from usarsim_operator.roles import Role
from usarsim_operator.uptake import SLOW, Uptake


def _picture(robot: int, number: int) -> bytes:
    return packets.head(packets.PICTURE, robot, number, 0.0) + b"jpeg"


def _seen(page: VirtualPage) -> list[tuple[int, int]]:
    return [packets.read_head(one)[1:4:2] for one in page.frames]


async def test_a_picture_waits_until_the_page_has_drawn_the_one_before() -> None:
    """O-38: one picture of a robot is on its way, the newest waits, others are not held up."""
    station = VirtualStation()
    page = VirtualPage(station, "Ada", Role.OPERATOR)
    page.page.uptake.tells = True
    for number in range(5):
        page.page.show("picture", "R1", _picture(1, number))
        await station.settle()
    page.page.show("picture", "R2", _picture(2, 9))
    await station.settle()
    assert _seen(page) == [(1, 0), (2, 9)]
    page.say("shown", count=1)
    await station.settle()
    assert _seen(page)[2:] == [(1, 4)]
    page.say("shown", count=3)
    await station.settle()
    assert page.page.uptake.under_way == 0
    await station.end(page)


async def test_the_chosen_robot_comes_first_and_nothing_starves() -> None:
    """Its picture goes before those that waited longer; one of the others goes between two."""
    station = VirtualStation()
    page = VirtualPage(station, "Ada", Role.OPERATOR)
    await station.settle()
    page.stalled.clear()
    page.page.tell({"type": "event"})
    await station.settle()  # that is held up by the socket
    page.page.selected = "R4"
    for number in range(1, 6):
        page.page.show("picture", f"R{number}", _picture(number, 0))
    page.page.show("state", "", '{"type": "state"}')
    for _ in range(6):
        page.stalled.set()
        await asyncio.sleep(0)
        page.stalled.clear()
        page.page.show("picture", "R4", _picture(4, 0))
        page.page.show("state", "", '{"type": "state"}')
    page.stalled.set()
    await station.settle()
    seen = [robot for robot, _ in _seen(page)]
    assert seen[0] == 4
    assert sorted(seen[: seen.index(5) + 1])[:3] == [1, 2, 3]
    assert page.texts[1]["type"] == "state"
    await station.end(page)


async def test_a_feed_hurries_when_its_robot_is_chosen() -> None:
    """The chosen one is asked for before the others, and does not wait for its slow rhythm."""
    asked: list[str] = []
    waits = asyncio.Event()

    class Look:
        def __init__(self, name: str) -> None:
            self.name = name

        async def __aenter__(self) -> Look:
            return self

        async def __aexit__(self, *_: object) -> None:
            return

        def __aiter__(self) -> Look:
            return self

        async def __anext__(self) -> Picture:
            asked.append(self.name)
            waits.set()
            return Picture(0, b"")

    station = VirtualStation()
    page = VirtualPage(station, "Ada", Role.OPERATOR)
    for name in ("R1", "R2", "R3"):
        station.spawned(name)
        station.cameras._feeds[name] = CameraFeed(
            lambda name=name: Look(name),  # type: ignore[misc, arg-type]
            lambda data, count: None,
        )
    await station.settle()
    page.page.selected = "R3"
    station.look()
    await station.settle()
    assert asked == ["R3", "R1", "R2"]
    page.say("select", robot="R2")
    await station.settle()
    assert asked == ["R3", "R1", "R2", "R2"]
    await station.cameras.close()
    await station.end(page)


async def test_a_page_that_tells_nothing_gets_every_picture() -> None:
    """O-38: pages of others need not know of `shown`."""
    station = VirtualStation()
    page = VirtualPage(station, "old", Role.OPERATOR)
    for number in range(5):
        page.page.show("picture", "R1", _picture(1, number))
        await station.settle()
    assert _seen(page) == [(1, number) for number in range(5)]
    await station.end(page)


async def test_counts_that_cannot_be_are_refused() -> None:
    """CON-29: more than were sent, or fewer than before."""
    station = VirtualStation()
    page = VirtualPage(station, "Ada", Role.VIEWER)
    page.page.uptake.tells = True
    page.page.show("picture", "R1", _picture(1, 0))
    await station.settle()
    assert not (await page.ask("shown", count=2))["ok"]
    assert (await page.ask("shown", count=1))["ok"]
    assert not (await page.ask("shown", count=0))["ok"]
    await station.end(page)


async def test_state_goes_first_and_starves_nothing() -> None:
    """CON-22: where each state takes as long as the next one needs to come, pictures still come."""
    station = VirtualStation()
    page = VirtualPage(station, "slow", Role.OPERATOR)
    kinds: list[str] = []

    class Slow:
        async def send_str(self, data: str, compress: int | None = None) -> None:
            kinds.append("state")
            if len(kinds) < 8:
                page.page.show("state", "", '{"type":"state"}')

        async def send_bytes(self, data: bytes, compress: int | None = None) -> None:
            kinds.append("picture")

    page.page._socket = Slow()
    for number in range(4):
        page.page.show("picture", f"R{number}", _picture(number, number))
    page.page.show("state", "", '{"type":"state"}')
    await station.settle()
    assert kinds[:7] == ["state", "picture"] * 3 + ["state"]
    await station.end(page)


async def test_pictures_that_a_bad_link_loses_hold_nothing_up() -> None:
    """O-38, O-39: of a robot all of whose pictures are lost none counts as under way."""
    station = VirtualStation()
    page = VirtualPage(station, "Ada", Role.OPERATOR)
    page.page.uptake.tells = True
    page.page.link = ImpairedLink(page, Conditions(loss=1.0), "Ada")
    page.page._socket = page.page.link
    for number in range(5):
        page.page.show("picture", "R1", _picture(1, number))
        await station.settle()
    assert page.page.link.out.lost == 5
    assert page.page.uptake.under_way == 0
    await station.end(page)


def test_a_link_that_takes_time_has_more_on_its_way() -> None:
    """O-38, O-39: over 0.5 s each way a robot's ten pictures a second all come."""
    taken = Uptake()
    taken.tells = True
    sent: list[float] = []
    shown = 0
    for step in range(2000):
        now = step / 100
        due = sum(moment + 1.02 <= now for moment in sent)
        if due > shown:
            shown = due
            taken.shown(shown, now)
        if step % 10 == 0 and taken.may("R1"):
            taken.sent("R1", now)
            sent.append(now)
    assert len([moment for moment in sent if moment >= 10.0]) >= 95
    assert taken.window <= 13


@given(st.lists(st.tuples(st.sampled_from("AB"), st.integers(0, 3)), max_size=60))
def test_never_more_on_the_way_than_the_window(steps: list[tuple[str, int]]) -> None:
    """O-38: whatever a page tells, and when."""
    taken = Uptake()
    taken.tells = True
    shown = 0
    for number, (robot, drawn) in enumerate(steps):
        if taken.may(robot):
            taken.sent(robot, number / 100)
        drawn = min(drawn, taken.under_way)
        shown += drawn
        taken.shown(shown, number / 100 + 0.001)
        assert taken.under_way <= 2 * taken.window


def test_only_a_slow_page_has_little_room() -> None:
    """CON-22: at 20 kB/s a message is to be 3 kB; pages that keep nobody waiting get all."""
    taken = Uptake()
    assert taken.room is None
    for _ in range(50):
        taken.took(14_000, 0.0)
    assert taken.room is None
    for _ in range(50):
        taken.took(14_000, 0.7)
    assert taken.room == pytest.approx(3000, rel=0.02)
    for _ in range(50):
        taken.took(14_000, 14_000 / SLOW / 2)
    assert taken.room is None


def test_pictures_and_points_become_small() -> None:
    """CON-22: a picture of 320 x 240 full of detail, and 8000 points, fit into 3 kB."""
    noise = Image.effect_noise((320, 240), 60.0).convert("RGB")
    out = io.BytesIO()
    noise.save(out, "JPEG", quality=80)
    head = packets.head(packets.PICTURE, 3, 7, 1.5)
    data = packets.slim(head + out.getvalue(), 3000)
    assert data[: packets.HEAD] == head
    assert len(data) <= 3000
    seen = Image.open(io.BytesIO(data[packets.HEAD :]))
    assert seen.width / seen.height == 320 / 240
    rows = b"".join(struct.pack("<3f", n, 0.0, 1.0) for n in range(8000))
    cloud = packets.head(packets.POINTS, 3, 8, 1.5) + struct.pack("<I", 8000) + rows
    thin = packets.slim(cloud, 3000)
    count = struct.unpack_from("<I", thin, packets.HEAD)[0]
    assert len(thin) == packets.HEAD + 4 + 12 * count <= 3000
    assert count > 200
    assert struct.unpack_from("<f", thin, len(thin) - 12)[0] > 7900
    assert packets.slim(head + b"no picture", 20) == head + b"no picture"


def test_huge_pictures_cost_little() -> None:
    """A picture of 16 million pixels is made small by what JPEG gives of it, and one that names
    more than any server draws is neither decoded nor handed on to pages."""
    out = io.BytesIO()
    Image.new("RGB", (4096, 4096), "red").save(out, "JPEG", quality=80)
    seen = Image.open(io.BytesIO(packets.smaller(out.getvalue(), 10_000_000)))
    assert seen.width * seen.height <= 2_000_000
    at = out.getvalue().index(b"\xff\xc0") + 5
    bomb = out.getvalue()[:at] + struct.pack(">HH", 65_500, 65_500) + out.getvalue()[at + 4 :]
    assert packets.smaller(bomb, 100) == bomb
    with pytest.raises(ProtocolError, match="no real one"):
        jpeg(Picture(1, bomb))
    with pytest.raises(ProtocolError, match="no JPEG"):
        jpeg(Picture(1, b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 10 10\n"))
    assert jpeg(Picture(1, out.getvalue())) == out.getvalue()
