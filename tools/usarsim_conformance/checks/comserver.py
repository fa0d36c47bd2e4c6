"""The older wireless simulation, ComServer: its dialogue and its data links (side channels
reference 5)."""

from __future__ import annotations

import contextlib
import re
from collections.abc import AsyncIterator

from usarsim_conformance.case import Case
from usarsim_conformance.lines import number
from usarsim_conformance.registry import Severity, checks_of
from usarsim_conformance.side_lines import LEAVES, Guest, Member, MessageClient

comserver = checks_of("comserver")

_QUIET = 0.5
_FOREIGN = ("192.0.2.1", "192.0.2.2")
"""Addresses of nobody (RFC 5737)."""
_THIRD_PARTY = "Fail: Server does not accept third party requests"
_NO_STRENGTH = "Fail: Could not calculate signal strength"


@comserver("connect.silent", "Says nothing before it is asked", "5.1")
async def silent(case: Case) -> None:
    """The server speaks only in reply."""
    await (await MessageClient.open(case)).silent(1.0, "connecting")


@comserver("register.ok", "REGISTER is answered by OK", "11.79, 5.2")
async def register(case: Case) -> None:
    """`REGISTER n ip;` is answered by the three bytes `OK;`, without a line end."""
    async with await Member.arrive(case, "comserver") as member:
        await member.client.expect(member.registration, "OK")
        await member.client.silent(_QUIET, "OK;")


@comserver("register.again", "Registering again is fine", "5.2")
async def again(case: Case) -> None:
    """The same name with the same address is accepted again."""
    async with await Member.make(case) as member:
        await member.client.expect(member.registration, "OK")


@comserver("register.other-address", "A name has one address", "5.2")
async def other_address(case: Case) -> None:
    """A name that is registered with another address is refused."""
    async with await Member.make(case) as member:
        await member.client.expect(
            f"REGISTER {member.name} {_FOREIGN[0]}",
            f"Fail: Robot with name {member.name} already registered",
        )


@comserver("register.outlives", "Names outlive their connection", "5.1")
async def outlives(case: Case) -> None:
    """Closing a control connection undoes nothing, and any connection may speak for any name."""
    async with await Member.make(case, listen=True) as one, await Member.make(case) as other:
        one.wire.close()
        await case.clock.sleep(0.5)
        await other.link(one)


@comserver("listen.unregistered", "Only who is registered can listen", "11.80, 5.2")
async def unregistered(case: Case) -> None:
    """LISTEN of a name that is not registered is refused."""
    name = case.new_name()
    client = await MessageClient.open(case)
    await client.expect(f"LISTEN {name} 7000", f"Fail: Robot {name} not registered")


@comserver("listen.twice", "A port is listened on once", "5.2")
async def twice(case: Case) -> None:
    """LISTEN on the port that a robot listens on already is refused; on another one it is not."""
    async with await Member.make(case, listen=True) as member:
        await member.client.expect(
            f"LISTEN {member.name} {member.port}",
            f"Fail: Robot with name {member.name} already listening at port {member.port}",
        )
        await member.client.expect(f"LISTEN {member.name} 9", "OK")


@comserver("open.dials", "OPEN dials both robots", "11.81, 5.2")
async def dials(case: Case) -> None:
    """`OPEN me myport other otherport;` is answered by OK, and the simulator connects to the named
    ports of both."""
    async with await Member.make(case) as one, await Member.make(case, listen=True) as other:
        await one.link(other)


@comserver("open.consumed", "OPEN uses LISTEN up", "11.85, 5.2")
async def consumed(case: Case) -> None:
    """After an OPEN the other does not listen any more; after a further LISTEN it does."""
    async with await Member.make(case) as one, await Member.make(case, listen=True) as other:
        await one.link(other)
        await one.client.expect(
            f"OPEN {one.name} {one.port} {other.name} {other.port}",
            f"Fail: {other.name} not listening on port {other.port}",
        )
        await other.listen()
        await one.link(other)


@comserver("open.not-listening", "OPEN needs somebody who listens", "5.2")
async def not_listening(case: Case) -> None:
    """OPEN towards a port that the other has not named is refused, and nobody is dialled."""
    async with await Member.make(case) as one, await Member.make(case) as other:
        await one.client.expect(
            f"OPEN {one.name} {one.port} {other.name} {other.port}",
            f"Fail: {other.name} not listening on port {other.port}",
        )
        await case.clock.sleep(_QUIET)
        dialled = one.guests.qsize() + other.guests.qsize()
        case.expect(not dialled, f"{dialled} robots are dialled after a refused OPEN, not 0")


@comserver("getss.known", "The strength of a signal", "5.2, 5.3")
async def known(case: Case) -> None:
    """Between two robots GETSS tells `OK:` and a number of dBm, not above zero; a server without a
    model says that it could not be calculated."""
    async with await Member.make(case) as one, await Member.make(case) as other:
        answer = await one.client.ask(f"GETSS {one.name} {other.name}")
        if answer != _NO_STRENGTH:
            value = number(answer.removeprefix("OK:"))
            case.expect(
                answer.startswith("OK:") and -400.0 < value <= 0.0,
                f"GETSS is answered by {answer!r}, not by OK: and a number of dBm above -400 and "
                "at most 0",
            )


@comserver("getss.third-party", "Strangers are told nothing", "11.86, 5.2")
async def third_party(case: Case) -> None:
    """GETSS is refused unless it comes from the address of one of the two robots."""
    client = await MessageClient.open(case)
    names = [case.new_name() for _ in _FOREIGN]
    for name, address in zip(names, _FOREIGN, strict=True):
        await client.expect(f"REGISTER {name} {address}", "OK")
    await client.expect(f"GETSS {names[0]} {names[1]}", _THIRD_PARTY)


@comserver("request.word-count", "Words are counted", "11.87, 5.2")
async def word_count(case: Case) -> None:
    """A verb with too few or too many words gets `Fail: Incorrect Message`."""
    client = await MessageClient.open(case)
    for text in ("REGISTER A", "LISTEN A", "OPEN A 1 B", "GETSS A", "GETSS A B C", "REGISTER"):
        await client.expect(text, "Fail: Incorrect Message")


@comserver("request.unknown", "Other verbs are unknown", "11.87, 5.2")
async def unknown(case: Case) -> None:
    """Any other verb, those of data links included, gets `Fail: Unknown Message`."""
    client = await MessageClient.open(case)
    for text in ("HELLO", "SEND 5 hello", "CLOSE"):
        answer = await client.ask(text)
        # One revision of the original writes the second word small.
        good = re.fullmatch(r"Fail: Unknown [Mm]essage", answer)
        case.expect(good, f"{text!r} is answered by {answer!r}, not by 'Fail: Unknown Message'")


@comserver("request.case", "Verbs in any case, names in one", "5.1")
async def any_case(case: Case) -> None:
    """A verb may be in any letter case; a name in another case is another name."""
    async with await Member.make(case) as member:
        await member.client.expect(member.registration.replace("REGISTER", "Register"), "OK")
        name = member.name.swapcase()
        await member.client.expect(f"listen {name} 7000", f"Fail: Robot {name} not registered")


@comserver("request.blanks", "Runs of blanks are one", "5.1")
async def blanks(case: Case) -> None:
    """Words may be parted by several blanks."""
    async with await Member.arrive(case, "comserver") as member:
        await member.client.expect(member.registration.replace(" ", "   "), "OK")


@comserver("request.split", "Messages may come in pieces", "5.1")
async def split(case: Case) -> None:
    """A message that comes in pieces is answered once, when its end is there."""
    client, name = await MessageClient.open(case), case.new_name()
    await client.wire.send(f"LISTEN {name} ".encode())
    await client.silent(_QUIET, "half a message")
    await client.wire.send(b"7000;")
    answer = await client.line()
    case.expect(
        answer == f"Fail: Robot {name} not registered",
        f"LISTEN in two pieces is answered by {answer!r}, not by 'Fail: Robot {name} not "
        "registered'",
    )
    await client.silent(_QUIET, "one answer to one message")


@comserver("request.pipelined", "Every message is answered", "5.1", Severity.SHOULD)
async def pipelined(case: Case) -> None:
    """Messages that come together are answered one by one, in order. (The original looked at the
    first only; its clients wait for every answer.)"""
    client = await MessageClient.open(case)
    await client.wire.send(b"LISTEN NoOne 1;HELLO;LISTEN NoTwo 2;")
    answers = [await client.line() for _ in range(3)]
    words = [answer.split()[2] for answer in answers if answer.count(" ") > 1]
    case.expect(
        words == ["NoOne", "Message", "NoTwo"],
        f"three messages in one packet are answered by {answers}, not by three Fail, which name "
        "NoOne, an unknown Message and NoTwo",
    )
    await client.silent(_QUIET, "three answers to three messages")


@comserver("request.line-ends", "Line ends between messages", "5.1", Severity.SHOULD)
async def line_ends(case: Case) -> None:
    """CR, LF and blanks between messages are passed over."""
    client = await MessageClient.open(case)
    await client.wire.send(b"LISTEN NoOne 1;\r\n LISTEN NoTwo 2;\r\n")
    answers = [await client.line() for _ in range(2)]
    wanted = [f"Fail: Robot {name} not registered" for name in ("NoOne", "NoTwo")]
    case.expect(
        answers == wanted,
        f"two messages with line ends between are answered by {answers}, not by {wanted}",
    )
    await client.silent(_QUIET, "two answers to two messages")


@comserver("request.long-message", "Survives a message without end", "5.1", Severity.SHOULD)
async def long_message(case: Case) -> None:
    """A megabyte without a semicolon neither blocks other connections nor ends the server."""
    endless, other = await MessageClient.open(case), await MessageClient.open(case)
    await endless.wire.send(b"A" * 1_000_000)
    await other.expect("LISTEN NoOne 1", "Fail: Robot NoOne not registered")


@comserver("clients.vanishes", "Survives clients that vanish", "5.1")
async def vanishes(case: Case) -> None:
    """Clients that reset with a message open, or with answers unread, disturb nobody."""
    for data in (b"LISTEN NoOne", b"LISTEN NoOne 1;" * 50):
        client = await MessageClient.open(case)
        await client.wire.send(data)
        client.wire.reset()
    client = await MessageClient.open(case)
    await client.expect("LISTEN NoOne 1", "Fail: Robot NoOne not registered")


_EVERY_BYTE = (bytes(range(256)) * 4)[:1000]


@contextlib.asynccontextmanager
async def _link(case: Case) -> AsyncIterator[tuple[Guest, Guest]]:
    """Both ends of a link between two robots while inside; then they leave, so that the next link
    takes no further places."""
    async with await Member.make(case) as one, await Member.make(case, listen=True) as other:
        yield await one.link(other)
    case.release()


async def _send(guest: Guest, *payloads: bytes) -> None:
    messages = (b"SEND %d %b;" % (len(payload), payload) for payload in payloads)
    await guest.wire.send(b"".join(messages))


async def _hears(case: Case, guest: Guest, wanted: bytes) -> None:
    found = await guest.read(len(wanted))
    case.expect(
        found == wanted,
        f"the other robot hears {len(found)} bytes, {found[:50]!r}, not the {len(wanted)} sent, "
        f"{wanted[:50]!r}",
    )


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
                case.expect(not data, f"{data!r} comes after {what}, not nothing")


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
        case.expect(
            not data, f"{data!r} comes after words that are neither SEND nor CLOSE, not nothing"
        )


@comserver("link.close", "CLOSE closes both ends", "11.84, 5.4")
async def close(case: Case) -> None:
    """`CLOSE;` of either robot closes the connections of both."""
    for side in range(2):
        async with _link(case) as ends:
            await ends[side].wire.send(b"CLOSE;")
            for guest, whose in zip(ends, ("caller's", "other's"), strict=True):
                case.expect(
                    await guest.hung_up(),
                    f"the {whose} connection is not closed within {LEAVES:g} s of CLOSE",
                )


@comserver("link.hangup", "The end of one side ends the other", "5.4")
async def hangup(case: Case) -> None:
    """If a robot hangs up, what it has sent arrives, and the other end is closed, too."""
    for side in range(2):
        async with _link(case) as ends:
            leaving, staying = ends[side], ends[1 - side]
            await _send(leaving, b"last words")
            leaving.wire.close()
            await _hears(case, staying, b"last words")
            case.expect(
                await staying.hung_up(),
                f"the connection of the other robot is not closed within {LEAVES:g} s of a hangup",
            )


@comserver("link.unanswered", "OK does not mean connected", "5.2", Severity.SHOULD)
async def unanswered(case: Case) -> None:
    """OK to OPEN means that both robots are being dialled: if one does not answer, the connection
    of the other ends."""
    async with await Member.make(case) as one, await Member.make(case, listen=True) as other:
        other.deaf()
        answer = await one.client.ask(f"OPEN {one.name} {one.port} {other.name} {other.port}")
        case.expect(answer == "OK", f"OPEN is answered by {answer!r}, not by 'OK'")
        case.expect(
            await (await one.guest()).hung_up(),
            f"the connection to the robot that answers is not closed within {LEAVES:g} s, though "
            "the other one does not answer",
        )
