"""Logs what a client gets wrong, each mistake once."""

from __future__ import annotations

from usarsim_server.base.logs import Log
from usarsim_server.protocol.explanation import shorten
from usarsim_server.protocol.grammar import Command
from usarsim_server.sessions.tap import Clock, Row, Tap

_MOST_SHAPES = 200
"""Kinds of commands of one client that are looked at."""
_MOST_SEGMENTS = 40
"""Of a command; longer ones are not looked at."""
_MOST_TOLD = 20
"""Lines of the log about one client."""
_LINE = 80
"""Characters of a client's line that are shown."""


class Mistakes:
    """Looks at the first command of each kind that a client sends, and logs what is wrong with it.

    Two commands are of one kind if their words, the names of their segments, and whether the
    values begin with a letter are the same. What a client sends again and again is looked at once,
    so that it costs nothing to speak of.
    """

    def __init__(self, peer: str, now: Clock) -> None:
        """Begin with no command seen.

        Args:
            peer: `host:port` of the client.
            now: simulated s.
        """
        self._tap = Tap(peer, self._tell, False, now, unwritten=True)
        self._log = Log("robot", connection=peer)
        self._shapes: set[int] = set()
        self._told: set[str] = set()

    def tap(self, command: Command) -> Tap | None:
        """The tap to read a command with, or None for a kind that has been looked at before."""
        if len(command.segments) > _MOST_SEGMENTS or len(self._shapes) >= _MOST_SHAPES:
            return None
        # Only a hash is kept: a client chooses how long its words are.
        names = ((name, text[:1].isalpha()) for name, text in command.segments)
        shape = hash((command.word, *names))
        if shape in self._shapes:
            return None
        self._shapes.add(shape)
        return self._tap

    def _tell(self, row: Row) -> None:
        for fault in row.faults:
            if len(self._told) >= _MOST_TOLD:
                return
            if fault not in self._told:
                self._told.add(fault)
                log = self._log if row.robot is None else self._log.bind(robot=row.robot)
                log.warning(f"not as asked: {fault}", line=shorten(row.text, _LINE))
