"""Data links of the older wireless simulation, ComServer (side channels reference 5.4)."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator

from usarsim_conformance.case import Case
from usarsim_conformance.side_checks import checks_of
from usarsim_conformance.side_comserver import Member
from usarsim_conformance.side_lines import Guest
from usarsim_conformance.verdicts import Severity

comserver = checks_of("comserver")

_QUIET = 0.5
_EVERY_BYTE = (bytes(range(256)) * 4)[:1000]


@contextlib.asynccontextmanager
async def _link(case: Case) -> AsyncIterator[tuple[Guest, Guest]]:
    """Both ends of a link between two robots while inside."""
    async with await Member.make(case) as one, await Member.make(case, listen=True) as other:
        yield await one.link(other)


async def _send(guest: Guest, *payloads: bytes) -> None:
    messages = (b"SEND %d %b;" % (len(payload), payload) for payload in payloads)
    await guest.wire.send(b"".join(messages))


async def _hears(case: Case, guest: Guest, wanted: bytes) -> None:
    found = await guest.read(len(wanted))
    told = f"{found!r}, not {wanted!r}" if len(wanted) < 50 else f"{len(found)} bytes, or others"
    case.expect(found == wanted, f"the other robot hears {told}")


@comserver("link.payload", "The other hears the payload only", "11.82, 5.4")
async def payload(case: Case) -> None:
    """`SEND 5 hello;` on one end delivers `hello` to the other, without header or semicolon, and
    nothing to who has sent it; in both directions."""
    async with _link(case) as ends:
        for speaker, listener in (ends, ends[::-1]):
            await _send(speaker, b"hello")
            await _hears(case, listener, b"hello")
            for guest, what in ((listener, "hello"), (speaker, "its SEND")):
                data = await guest.wire.silence(0.3)
                case.expect(not data, f"{data!r} came after {what}")


@comserver("link.binary", "Payload is bytes", "11.83, 5.4")
async def binary(case: Case) -> None:
    """A thousand bytes of all values, semicolons and zeros among them, arrive unchanged."""
    async with _link(case) as (one, other):
        await _send(one, _EVERY_BYTE)
        await _hears(case, other, _EVERY_BYTE)


@comserver("link.joined", "Several SEND in a piece", "5.4")
async def joined(case: Case) -> None:
    """Messages that come together are all carried, in order: receivers get one stream."""
    async with _link(case) as (one, other):
        await _send(one, b"one", b"", b"two;", b"three")
        await _hears(case, other, b"onetwo;three")


@comserver("link.pieces", "A SEND in pieces", "5.4")
async def pieces(case: Case) -> None:
    """A message that comes in pieces is carried as a whole one is."""
    async with _link(case) as (one, other):
        for piece in (b"SE", b"ND ", b"1", b"0 01234", b"56789", b";"):
            await one.wire.send(piece)
            await case.clock.sleep(0.0)
        await _hears(case, other, b"0123456789")


@comserver("link.much", "Much data passes", "5.4")
async def much(case: Case) -> None:
    """A hundred messages of a kilobyte arrive whole and in order."""
    async with _link(case) as (one, other):
        await _send(one, *[_EVERY_BYTE] * 100)
        await _hears(case, other, _EVERY_BYTE * 100)


@comserver("link.junk", "Other words are passed over", "5.4", Severity.SHOULD)
async def junk(case: Case) -> None:
    """Words that are neither SEND nor CLOSE are skipped up to their semicolon, without a reply."""
    async with _link(case) as (one, other):
        await one.wire.send(b"HELLO there;send 2 no;")
        await _send(one, b"yes")
        await _hears(case, other, b"yes")
        data = await one.wire.silence(_QUIET)
        case.expect(not data, f"{data!r} came after words that mean nothing")


@comserver("link.close", "CLOSE closes both ends", "11.84, 5.4")
async def close(case: Case) -> None:
    """`CLOSE;` of either robot closes the connections of both."""
    for number in range(2):
        async with _link(case) as ends:
            await ends[number].wire.send(b"CLOSE;")
            for guest, whose in zip(ends, ("caller's", "other's"), strict=True):
                case.expect(await guest.hung_up(), f"the {whose} end stays open after CLOSE")


@comserver("link.hangup", "The end of one side ends the other", "5.4")
async def hangup(case: Case) -> None:
    """If a robot hangs up, what it has sent arrives, and the other end is closed, too."""
    for number in range(2):
        async with _link(case) as ends:
            leaving, staying = ends[number], ends[1 - number]
            await _send(leaving, b"last words")
            leaving.wire.close()
            await _hears(case, staying, b"last words")
            case.expect(await staying.hung_up(), "the other end stays open after a hangup")


@comserver("link.unanswered", "OK does not mean connected", "5.2", Severity.SHOULD)
async def unanswered(case: Case) -> None:
    """OK to OPEN means that both robots are being dialled: if one does not answer, the connection
    of the other ends."""
    async with await Member.make(case) as one, await Member.make(case, listen=True) as other:
        other.deaf()
        answer = await one.client.ask(f"OPEN {one.name} {one.port} {other.name} {other.port}")
        case.expect(answer == "OK", f"OPEN was answered by {answer!r}")
        case.expect(await (await one.guest()).hung_up(), "the robot that answers is left hanging")
