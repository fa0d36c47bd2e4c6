"""The client of the protocol: the inbox by itself, and both kinds of connections at a server."""

from __future__ import annotations

import asyncio
import math
from dataclasses import replace

import numpy as np
import pytest
from fake_server import FakeServer

from usarsim_client import (
    FULL_FRAME,
    Actor,
    BlockingConnection,
    Connection,
    HangupError,
    Inbox,
    Line,
    Picture,
    ProtocolError,
    Radio,
    RadioError,
    actor,
    command,
    rectangle,
    road,
)
from usarsim_client.link import Address
from usarsim_client.pictures import picture
from usarsim_server.testing import PATIENCE, running_server


def test_lines_are_taken_when_they_are_whole() -> None:
    """What ends with LF is a line, with CR or without; the rest waits."""
    inbox = Inbox()
    inbox.feed(b"STA {Type GroundVehicle} {Time 1.50}\r\nSEN {Ti")
    line = inbox.line()
    assert line is not None
    assert (line.head, line.get("type"), line.time) == ("STA", "GroundVehicle", 1.5)
    assert inbox.line() is None
    assert inbox.rest == b"SEN {Ti"
    inbox.feed(b"me x}\n")
    assert inbox.everything() == b"SEN {Time x}\n"
    assert inbox.everything() is None


def test_segments_and_numbers() -> None:
    """Values keep further pairs; what is no number is NaN."""
    line = Line(b"SEN {Type Sonar} {Name F1 Range 1.25} {Location 1,-2.5,x}\r\n")
    assert line.segments[1] == ("Name", "F1 Range 1.25")
    assert line.numbers("Location")[:2] == (1.0, -2.5)
    assert math.isnan(line.numbers("Location")[2])
    assert math.isnan(line.time)
    assert line.fits("SEN {Type Sonar")
    assert not line.fits(lambda one: one.head == "STA")
    assert command("GETGEO {Type \xe9}") == b"GETGEO {Type \xe9}\r\n"


def test_pictures_are_taken_when_they_are_whole() -> None:
    """Raw rows are filled up to four bytes, blue first; a length that cannot be is an error."""
    inbox = Inbox()
    payload = bytes((0, 1, 0, 2, 30, 20, 10, 0, 3, 2, 1, 0))
    inbox.feed(b"\0\0\0\0\x0c" + payload[:5])
    assert picture(inbox) is None
    inbox.feed(payload[5:] + b"\x03\x0c\0\0\0")
    found = picture(inbox)
    assert found is not None
    assert (found.raw, found.size) == (True, (1, 2))
    assert np.array_equal(found.pixels, [[[10, 20, 30]], [[1, 2, 3]]])
    assert Picture(3, b"").size == (0, 0)
    with pytest.raises(ProtocolError, match="big-endian"):
        picture(_holding(b"\x03\xff\0\0\0"))
    for broken in (
        Picture(3, b"no JPEG"),
        Picture(0, b"\0"),
        Picture(0, bytes((0, 1, 0, 1)) + b"x"),
    ):
        with pytest.raises(ProtocolError):
            _ = broken.pixels


def _holding(data: bytes) -> Inbox:
    """An inbox with something in it."""
    inbox = Inbox()
    inbox.feed(data)
    return inbox


def test_answers_of_side_channels() -> None:
    """Roads and actors; another answer is an error."""
    assert road("DNSREPLY {Robot A} {Port 4711}", "A") == 4711
    with pytest.raises(ProtocolError):
        road("ERROR {Reason Method.Unknown}", "A")
    listed = b"{Name P2AT_0} {Class P2AT} {Time 1.5} {Location 1,2,3} {Rotation 0,0,0.5}\r\n"
    assert actor(Line(listed)) == Actor("P2AT_0", "P2AT", 1.5, (1.0, 2.0, 3.0), (0.0, 0.0, 0.5))
    assert actor(Line(b"{End}\r\n")) is None


def test_both_kinds_of_connections() -> None:
    """A robot by the blocking one, its picture and its truth by the others."""
    with (
        running_server(world="empty", image_port=0, truth_port=0) as (_, ports),
        BlockingConnection(ports["control"].port, patience=PATIENCE) as control,
    ):
        poses = control.ask(command("GETSTARTPOSES"), "NFO {StartPoses")
        init = f"INIT {{ClassName USARBot.P3AT}} {{Start {poses.segments[1][0]}}}"
        assert control.ask(command(init), "STA").get("Type") == "GroundVehicle"
        with BlockingConnection(ports["images"].port, patience=PATIENCE) as images:
            images.send(rectangle(0, 0, 16, 8))
            assert images.picture().size == (16, 8)

        async def look() -> tuple[int, Actor | None]:
            images = await Connection.open("127.0.0.1", ports["images"].port, little=True)
            await images.send(FULL_FRAME)
            width, _ = (await images.picture()).size
            images.half_close()
            with pytest.raises(HangupError):
                await images.line()
            images.close()
            truth = await Connection.open("127.0.0.1", ports["truth"].port)
            found = actor(await truth.ask(b"\r\n"))
            truth.reset()
            return width, found

        width, found = asyncio.run(look())
        assert width > 16
        assert found is not None
        assert found.class_name == "P3AT"


async def test_radio_registers_again_after_a_request_that_failed() -> None:
    """The connection is the registration: lost with a late answer, it is made anew; not after
    `close`, and not when it is refused."""
    replies = ["", "SS {Robot B} {Strength -61.0}", "SS {Robot B} {Strength -62.0}"]
    refusals: list[str] = []

    def answer(line: str) -> list[str]:
        if line.startswith("INIT"):
            return [refusals.pop() if refusals else "INITREPLY {Status OK}"]
        return [reply] if (reply := replies.pop(0)) else []

    async with FakeServer(answer, greeting="") as fake:
        address = Address("127.0.0.1", fake.port, PATIENCE)
        radio = Radio(address, "A")
        await radio.register((3333,))
        radio.address = replace(address, timeout=0.05)
        with pytest.raises(TimeoutError):
            await radio.strength("B")
        radio.address = address
        refusals.append("ERROR {Reason Robot.Alread.Exists}")
        with pytest.raises(RadioError, match="Alread"):
            await radio.strength("B")
        assert await radio.strength("B") == -61.0
        assert fake.heard.count("INIT {Robot A} {Port 3333}") == 3
        await radio.close()
        assert await radio.strength("B") == -62.0
        assert fake.heard.count("INIT {Robot A} {Port 3333}") == 3
