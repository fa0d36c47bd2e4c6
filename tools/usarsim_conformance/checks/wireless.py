"""The dialogue of the wireless simulation (side channels reference 4.1, 4.2)."""

from __future__ import annotations

import asyncio
import re

from usarsim_conformance import side_lines
from usarsim_conformance.case import Case
from usarsim_conformance.lines import number
from usarsim_conformance.side_checks import checks_of
from usarsim_conformance.side_lines import LineClient, Radio
from usarsim_conformance.verdicts import Severity

wireless = checks_of("wireless")

_QUIET = 0.5
_INIT_FIRST = "ERROR {Reason Must.Use.INIT.Method.First}"
_UNKNOWN = "ERROR {Reason Method.Unknown.Or.Can.INIT.only.once}"


async def _client(case: Case) -> LineClient:
    return await LineClient.open(case, "wireless")


@wireless("connect.silent", "Says nothing before it is asked", "4.2")
async def silent(case: Case) -> None:
    """The robot speaks first."""
    await (await _client(case)).silent(1.0, "connecting")


@wireless("init.ok", "INIT registers a robot", "11.68, 4.2")
async def ok(case: Case) -> None:
    """`INIT {Robot n} {Port p}` is answered by `INITREPLY {Status OK}`."""
    async with await Radio.make(case, register=False) as radio:
        await radio.register()
        await radio.client.silent(_QUIET, "one line for one request")


@wireless("init.several-ports", "INIT takes several ports", "4.2")
async def several_ports(case: Case) -> None:
    """Port may list several ports with commas between."""
    async with await Radio.make(case, register=False) as radio:
        await radio.client.expect(
            f"INIT {{Robot {radio.name}}} {{Port {radio.port},2323}}", "INITREPLY {Status OK}"
        )


@wireless("init.first", "INIT must come first", "11.69, 4.2")
async def first(case: Case) -> None:
    """Any other verb before INIT gets `Must.Use.INIT.Method.First`."""
    client = await _client(case)
    for text in ("GETSS {Robot A}", "DNS {Robot A}", "REVERSEDNS {Port 5}", "HELLO {Robot A}"):
        await client.expect(text, _INIT_FIRST)


@wireless("init.once", "INIT can be used once only", "4.2")
async def once(case: Case) -> None:
    """A second INIT after a successful one is refused."""
    async with await Radio.make(case) as radio:
        await radio.client.expect(f"INIT {{Robot {radio.name}x}} {{Port 5}}", _UNKNOWN)


@wireless("init.duplicate", "A name is taken once", "11.70, 4.2")
async def duplicate(case: Case) -> None:
    """A name that is registered gets `Robot.Alread.Exists`, in the original's spelling, and a
    retry with another name on the same connection succeeds."""
    async with await Radio.make(case) as one, await Radio.make(case, register=False) as other:
        await other.client.expect(
            f"INIT {{Robot {one.name}}} {{Port 5}}", "ERROR {Reason Robot.Alread.Exists}"
        )
        await other.register()


@wireless("init.bad-ports", "Ports must be numbers", "4.2")
async def bad_ports(case: Case) -> None:
    """A port that is no integer gets `Ports.List.Must.Be.Integer`; a retry succeeds."""
    async with await Radio.make(case, register=False) as radio:
        for ports in ("http", "5000,x"):
            await radio.client.expect(
                f"INIT {{Robot {radio.name}}} {{Port {ports}}}",
                "ERROR {Reason Ports.List.Must.Be.Integer}",
            )
        await radio.register()


@wireless("init.no-name", "A robot needs a name", "4.2")
async def no_name(case: Case) -> None:
    """INIT without a name gets `Robot.Name.Must.Not.Be.Empty`."""
    client = await _client(case)
    await client.expect("INIT {Port 3333}", "ERROR {Reason Robot.Name.Must.Not.Be.Empty}")


@wireless("init.free-again", "A name is free when its connection ends", "4.2")
async def free_again(case: Case) -> None:
    """Closing the control connection unregisters; another can take the name soon after."""
    async with await Radio.make(case) as radio:
        radio.client.wire.close()

        async def free() -> bool:
            radio.client.wire.close()
            radio.client = await _client(case)
            text = f"INIT {{Robot {radio.name}}} {{Port {radio.port}}}"
            return await radio.client.ask(text) == "INITREPLY {Status OK}"

        case.expect(
            await case.soon(free, 3.0),
            f"the name {radio.name} is not free 3 s after its connection ended",
        )


@wireless("request.unknown", "Unknown verbs are refused", "4.2")
async def unknown(case: Case) -> None:
    """After INIT an unknown verb gets `Method.Unknown.Or.Can.INIT.only.once`."""
    async with await Radio.make(case) as radio:
        await radio.client.expect("CLOSE {Robot A}", _UNKNOWN)


@wireless("request.case", "Verbs are case-sensitive", "4.1", Severity.SHOULD)
async def verb_case(case: Case) -> None:
    """A verb in lower case is unknown."""
    await (await _client(case)).expect("init {Robot A} {Port 5}", _INIT_FIRST)


@wireless("request.pipelined", "Every request gets one reply", "4.1")
async def pipelined(case: Case) -> None:
    """Requests that come together are answered one by one, in order."""
    async with await Radio.make(case) as radio:
        client = radio.client
        await client.wire.send(b"GETSS {Robot A?}\r\nDNS {Robot B?}\r\nREVERSEDNS {Port 5}\r\n")
        heads = [(await client.line()).partition(" ")[0] for _ in range(3)]
        case.expect(heads == ["SS", "DNSREPLY", "REVERSEDNSREPLY"], f"answers in order {heads}")
        await client.silent(_QUIET, "three lines for three requests")


@wireless("request.split", "Requests may come in pieces", "4.1")
async def split(case: Case) -> None:
    """A request that comes in pieces is answered once, when its end is there."""
    client = await _client(case)
    for part in (b"GETSS {Rob", b"ot A}\r", b"\n"):
        await client.wire.send(part)
        await asyncio.sleep(0.15)
    case.expect(await client.line() == _INIT_FIRST, "another answer to a request in pieces")
    await client.silent(_QUIET, "one line for one request")


@wireless("request.crashers", "Survives what the original did not", "11.77, 4.6")
async def crashers(case: Case) -> None:
    """An empty line, verbs without a blank behind them, and groups that never close do no harm."""
    async with await Radio.make(case, register=False) as radio:
        client = radio.client
        await client.wire.send(b"\r\nGETSS\r\nDNS\r\n{}\r\n}{\r\nINIT\r\nINIT {Robot\r\n\0\xff\r\n")
        await client.wire.silence(_QUIET)
        await radio.register()


@wireless("request.no-arguments", "Missing arguments get one line", "11.77, 4.2")
async def no_arguments(case: Case) -> None:
    """After INIT a verb without its argument gets exactly one line."""
    async with await Radio.make(case) as radio:
        for text in ("GETSS", "DNS", "REVERSEDNS", "GETSS {}", "DNS {Port 5}"):
            await radio.client.ask(text)
            await radio.client.silent(0.2, f"one line for {text!r}")


@wireless("request.long-line", "Survives a line without end", "4.1", Severity.SHOULD)
async def long_line(case: Case) -> None:
    """A megabyte without a line end neither blocks other connections nor ends the server."""
    endless, other = await _client(case), await _client(case)
    await endless.wire.send(b"A" * 1_000_000)
    await other.expect("GETSS {Robot A}", _INIT_FIRST)


@wireless("request.slow-reader", "Who does not read stops nobody", "4.1")
async def slow_reader(case: Case) -> None:
    """While one client asks and never reads, others are answered."""
    stalled, other = await _client(case), await _client(case)
    await stalled.wire.send(b"GETSS {Robot A}\r\n" * 5000)
    for _ in range(3):
        await other.expect("GETSS {Robot A}", _INIT_FIRST)


# Signal strength.


async def _strength(case: Case, one: Radio, other: Radio) -> str:
    line = await one.client.ask(f"GETSS {{Robot {other.name}}}")
    found = re.fullmatch(
        rf"SS \{{Robot {re.escape(other.name)}\}} \{{Strength ([^{{}} ]+)\}}", line
    )
    case.expect(found, f"no plain strength: {line!r}")
    assert found is not None
    return found[1]


@wireless("getss.known", "The strength of another robot", "11.71, 4.2")
async def known(case: Case) -> None:
    """Between robots of the simulator the strength is a number of dBm, not above zero."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        value = number(await _strength(case, one, other))
        case.expect(-400.0 < value <= 0.0, f"the strength is {value}")


@wireless("getss.digits", "Six significant digits", "4.2", Severity.SHOULD)
async def digits(case: Case) -> None:
    """A strength has at most six significant digits and no exponent."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        text = await _strength(case, one, other)
        count = len(re.sub(r"\D", "", text).lstrip("0"))
        case.expect(count <= 6 and "e" not in text.lower(), f"{text!r} has {count} digits")


@wireless("getss.symmetric", "Both hear each other alike", "4.5", Severity.INFORMATIVE)
async def symmetric(case: Case) -> None:
    """In the models of the original the strength is the same in both directions."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        there = number(await _strength(case, one, other))
        back = number(await _strength(case, other, one))
        case.expect(abs(there - back) < 0.5, f"{there} there, {back} back")


@wireless("getss.self", "The strength of oneself", "11.71, 4.2")
async def oneself(case: Case) -> None:
    """Asked about itself a robot hears infinity, and why."""
    async with await Radio.make(case) as radio:
        await radio.client.expect(
            f"GETSS {{Robot {radio.name}}}",
            f"SS {{Robot {radio.name}}} {{Strength INF}} {{Error SS.To.Self}}",
        )


@wireless("getss.stranger", "The strength of nobody", "11.71, 4.2")
async def stranger(case: Case) -> None:
    """A robot that is not registered has the strength NaN, and the reason is named."""
    async with await Radio.make(case) as radio:
        await radio.client.expect(
            "GETSS {Robot Nobody?}",
            "SS {Robot Nobody?} {Strength NaN} {Error Robot.Does.Not.Exist}",
        )


# Who must leave.


@wireless("kick.ghost", "Who is not in the simulator is dropped", "11.76, 4.4")
async def ghost(case: Case) -> None:
    """A registered name that the simulator does not list is dropped: its connection is closed
    within some seconds. Not asked of a model that does not look at the simulator."""
    async with await Radio.make(case) as radio:
        client = await _client(case)
        await client.expect(
            f"INIT {{Robot Ghost{case.new_name()}}} {{Port 5}}", "INITREPLY {Status OK}"
        )
        case.expect(await client.wire.hung_up(side_lines.LEAVES), "a ghost stays registered")
        await radio.client.ask("GETSS {Robot Nobody?}")


@wireless("kick.leaver", "Who leaves the simulator is dropped", "11.76, 4.4")
async def leaver(case: Case) -> None:
    """When the robot of a registered name is removed, its connection is closed within some
    seconds; others stay registered."""
    async with await Radio.make(case) as one, await Radio.make(case) as other:
        other.robot.close()
        case.expect(await other.client.wire.hung_up(side_lines.LEAVES), "it stays registered")
        await one.client.ask("GETSS {Robot Nobody?}")
