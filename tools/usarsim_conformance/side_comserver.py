"""A client of the older wireless simulation, ComServer (side channels reference 5)."""

from __future__ import annotations

from usarsim_conformance.case import Case
from usarsim_conformance.side_lines import WITHIN, Guest, LineClient, Peer
from usarsim_conformance.verdicts import Failed, Inconclusive


class MessageClient(LineClient):
    """A control connection, on which messages end with a semicolon."""

    @classmethod
    async def open(cls, case: Case, service: str = "comserver", label: str = "") -> MessageClient:
        """Connect."""
        return cls(await case.open(service, label))

    async def send(self, text: str, end: str = ";") -> None:
        """Send a message."""
        await super().send(text, end)

    async def line(self, within: float | None = None) -> str:
        """The next answer without its semicolon, line ends in it included.

        Raises:
            Failed: if none comes in time.
            Hangup: if the server hung up.
        """
        data = await self.wire.read_until(b";", WITHIN if within is None else within)
        return data[:-1].decode("latin-1")


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
