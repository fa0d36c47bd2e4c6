"""A client of the older wireless simulation, ComServer (side channels reference 5)."""

from __future__ import annotations

from usarsim_tools.conformance import side_lines
from usarsim_tools.conformance.case import Case
from usarsim_tools.conformance.side_lines import Guest, Peer
from usarsim_tools.conformance.verdicts import Failed, Inconclusive
from usarsim_tools.conformance.wire import Wire

__all__ = ["Member", "MessageClient"]


class MessageClient:
    """A control connection, on which messages end with a semicolon.

    Attributes:
        wire: the connection.
    """

    def __init__(self, wire: Wire) -> None:
        self.wire = wire

    @classmethod
    async def open(cls, case: Case) -> MessageClient:
        """Connect."""
        return cls(await case.open("comserver"))

    async def reply(self) -> str:
        """The next answer without its semicolon.

        Raises:
            Failed: if none comes in time.
            Hangup: if the server hung up.
        """
        return (await self.wire.read_until(b";", side_lines.WITHIN))[:-1].decode("latin-1")

    async def ask(self, text: str) -> str:
        """Send a message, without its semicolon, and read the answer."""
        await self.wire.send(f"{text};".encode("latin-1"))
        return await self.reply()

    async def expect(self, text: str, wanted: str) -> None:
        """Fail unless a message is answered by exactly another."""
        answer = await self.ask(text)
        if answer != wanted:
            raise Failed(f"{text!r} was answered by {answer!r}, not by {wanted!r}")

    async def silent(self, seconds: float, after: str) -> None:
        """Fail if anything comes within a time."""
        data = await self.wire.silence(seconds)
        if data:
            raise Failed(f"{data[:120]!r} came after {after}")


class Member(Peer):
    """A robot in the simulator that is registered with ComServer.

    Attributes:
        client: its control connection.
    """

    @property
    def client(self) -> MessageClient:
        """Its control connection."""
        return MessageClient(self.wire)

    @classmethod
    async def make(cls, case: Case, *, listen: bool = False) -> Member:
        """Spawn a robot and register it.

        Args:
            case: the check.
            listen: whether it accepts a link.

        Raises:
            Failed: if it is refused.
        """
        member = await cls.arrive(case, "comserver")
        await member.client.expect(member.registration, "OK")
        if listen:
            await member.listen()
        return member

    @property
    def registration(self) -> str:
        """The message that registers it."""
        return f"REGISTER {self.name} {self.wire.local_address}"

    async def listen(self) -> None:
        """Accept a link on its port.

        Raises:
            Failed: if it is refused.
        """
        await self.client.expect(f"LISTEN {self.name} {self.port}", "OK")

    async def link(self, other: Member) -> tuple[Guest, Guest]:
        """A data link with another one that listens: the ends of both.

        Raises:
            Failed: if it is refused, or the server does not dial both.
            Inconclusive: if they are out of reach of each other.
        """
        answer = await self.client.ask(f"OPEN {self.name} {self.port} {other.name} {other.port}")
        if answer.startswith("Fail: Cannot connect"):
            raise Inconclusive(f"the robots are out of reach of each other: {answer!r}")
        if answer != "OK":
            raise Failed(f"OPEN was answered by {answer!r}")
        return await self.guest(), await other.guest()
