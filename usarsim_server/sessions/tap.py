"""What somebody who looks on learns of one connection, and how its driving is held back.

A tap hangs on a session only while somebody listens or has taken its robot over. Every command goes
through it then: read as always, but by readers that say what they could not read; carried out as
always, but with an ear to what the server has to say about it (`logs.overheard`). Nothing that the
client gets depends on who listens.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable
from dataclasses import dataclass, replace

from usarsim_server.base.logs import overheard
from usarsim_server.protocol import explanation
from usarsim_server.protocol.grammar import Command
from usarsim_server.protocol.requests import Drive, Ignored, Request, Unknown
from usarsim_server.sessions.robot_role import RobotRole
from usarsim_server.sessions.schedule import Role

Clock = Callable[[], float]

MOST_SHOWN = 400
"""Characters of a line of the server that are shown; a scan may have thousands."""
_COMPLAINT = re.compile(
    r"ignored|ignores|refused|failed|unknown|no addressee|no effect|no such|there is no|blocked"
    r"|clamped|nobody|nothing|without",
    re.IGNORECASE,
)
"""What the server says of a command that did not do what was wanted; all else tells what it did."""


@dataclass(frozen=True, slots=True)
class Row:
    """One line of a client, explained, or one line that it was told."""

    time: float  # simulated s
    session: str  # `host:port` of the client
    robot: str | None
    text: str  # the line, shortened
    incoming: bool = True
    streamed: bool = False  # one of the lines that come by themselves, again and again
    reading: str = ""  # how it was read
    effect: str = ""  # what it did
    faults: tuple[str, ...] = ()  # what could not be read or done
    suspended: bool = False  # it was held back: somebody else drives

    def message(self) -> dict[str, object]:
        """As the scene port tells it."""
        head = {"time": round(self.time, 3), "session": self.session, "robot": self.robot}
        if not self.incoming:
            return {**head, "out": self.text}
        told: dict[str, object] = {
            **head,
            "in": self.text,
            "reading": self.reading,
            "effect": self.effect,
            "faults": list(self.faults),
        }
        return {**told, "suspended": True} if self.suspended else told


_Begun = tuple[str, explanation.HeardCommand, Request, list[str]]


class Tap:
    """Hangs on one session; used by whoever serves that, but `holder` by anybody.

    Attributes:
        peer: `host:port` of the client.
        holder: who drives instead of the client; None: the client does.
        suspended: commands that were held back since somebody took over.
        newest: the last DRIVE among them.
        normalized: what the last of them that said it said; None: none did.
    """

    def __init__(
        self,
        peer: str,
        publish: Callable[[Row], None] | None,
        streams: bool,
        now: Clock,
        unwritten: bool = False,
    ) -> None:
        """Listen.

        Args:
            peer: see the attributes.
            publish: takes the rows, at once; None: nobody wants them.
            streams: whether rows of streamed lines are wanted.
            now: simulated s.
            unwritten: rows have only those complaints that the log does not have.
        """
        self.peer = peer
        self.publish, self.streams = publish, streams
        self.holder: str | None = None
        self.suspended = 0
        self.newest: Drive | None = None
        self.normalized: bool | None = None
        self._now, self._unwritten = now, unwritten
        self._open = contextlib.ExitStack()
        self._begun: _Begun | None = None

    def read(self, command: Command, role: Role | None) -> Request:
        """The request that a command is, or one without effect if it is held back; what the server
        says is listened to until `obeyed`."""
        holder = self.holder
        listening, request = explanation.heard(command)
        self._open = contextlib.ExitStack()
        if holder is not None and isinstance(role, RobotRole) and role.moves(request):
            self.suspended += 1
            if isinstance(request, Drive):
                self.newest = request
                if request.normalized is not None:
                    self.normalized = request.normalized
            effect = f"suspended: {holder} drives ({self.suspended} so far)"
            self._say(role, command.text, listening, request, effect, (), True)
            self._begun = None
            return Ignored(command.word)
        self._begun = (
            command.text,
            listening,
            request,
            self._open.enter_context(overheard(unwritten=self._unwritten)),
        )
        return request

    def obeyed(self, role: Role | None, replies: list[str]) -> None:
        """The request that was read last has been carried out, or has failed."""
        self._open.close()
        begun, self._begun = self._begun, None
        if begun is None or self.publish is None:
            return
        text, listening, request, notes = begun
        complaints = tuple(one for one in notes if _COMPLAINT.search(one))
        done = [one for one in notes if one not in complaints]
        if not done and replies:
            done = [f"answered by {len(replies)} line{'s' if len(replies) > 1 else ''}"]
        without = bool(complaints) or isinstance(request, Unknown | Ignored)
        effect = "; ".join(done) or ("none" if without else "carried out")
        self._say(role, text, listening, request, effect, complaints, False)
        for line in replies:
            self._tell(_name(role), line, False)

    def drive(self, by: str, role: Role, commands: list[Command]) -> None:
        """Carry out commands of who holds the robot, by the code that obeys its controller."""
        for command in commands:
            listening, request = explanation.heard(command)
            if self.holder != by:
                return
            with overheard() as notes:
                own = replace(request, passing=True) if isinstance(request, Drive) else request
                role.obey(own)
            self._say(
                role, command.text, listening, request, f"driven by {by}", tuple(notes), False
            )

    def tell(self, robot: str | None, line: bytes, *, streamed: bool) -> None:
        """The client is told something."""
        if self.publish is not None and (self.streams or not streamed):
            self._tell(robot, line.decode("latin-1").rstrip("\r\n"), streamed)

    def _tell(self, robot: str | None, line: str, streamed: bool) -> None:
        if self.publish is not None:
            text = explanation.shorten(line, MOST_SHOWN)
            self.publish(Row(self._now(), self.peer, robot, text, False, streamed))

    def _say(
        self,
        role: Role | None,
        text: str,
        listening: explanation.HeardCommand,
        request: Request,
        effect: str,
        complaints: tuple[str, ...],
        suspended: bool,
    ) -> None:
        if self.publish is None:
            return
        self.publish(
            Row(
                self._now(),
                self.peer,
                _name(role),
                text,
                reading=explanation.reading(request),
                effect=effect,
                faults=(*explanation.faults(listening, request), *complaints),
                suspended=suspended,
            )
        )


def _name(role: Role | None) -> str | None:
    return None if role is None else role.name
