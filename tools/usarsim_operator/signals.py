"""How strong the radio carries each robot to the operator's base, asked once a second.

The second is one of the clock, of a world in lockstep one of simulated time.

As controllers of the original do it: every robot of ours registers at the wireless server under
its own name, a base of ours too, and each robot asks how strong the base is heard there. A base of
somebody else is registered by its own program. Whom the server does not answer has no signal.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Collection

from usarsim_client.inbox import ProtocolError
from usarsim_client.link import Address
from usarsim_client.side_channels import Radio, RadioError

BASE = "ComStation"
"""Name of the base, unless it is told otherwise."""
SAFE_DBM = -91.0
"""Weakest signal of a good link; the limit `safe` of MRL-VR/MyVR2014, a station that competed."""
DANGER_DBM = -93.0
"""Weakest signal of any link; the limit `danger` of that station, and the default `cutoff` of the
wireless server of the original, which ends links there."""
PERIOD = 1.0
"""s between two questions for each robot."""

_PATIENCE = 2.0  # s that an answer may take
_RETRY = 5.0  # s until one who was refused, or found nobody, tries again
_PORTS = (9,)  # where others may call our robots: "discard", as nobody listens here


def grade(dbm: float | None) -> str:
    """State of a link by its signal: good, weak or lost; good where no signal is known."""
    if dbm is None or dbm >= SAFE_DBM:
        return "good"
    return "weak" if dbm >= DANGER_DBM else "lost"


class _Member:
    """One robot of ours in the radio."""

    def __init__(self, radio: Radio) -> None:
        self.radio = radio
        self._registered = False
        self._due = -math.inf

    async def register(self) -> None:
        """Make the robot known, if it is not."""
        if self._registered or asyncio.get_running_loop().time() < self._due:
            return
        try:
            await self.radio.register(_PORTS)
            self._registered = True
        except (ProtocolError, OSError, TimeoutError):  # also a name that is taken
            self._due = asyncio.get_running_loop().time() + _RETRY

    async def ask(self, base: str) -> float | None:
        """dBm of the base here; None if it cannot be known. Nothing is asked of a base itself."""
        now = asyncio.get_running_loop().time()
        if not self._registered or now < self._due or self.radio.name == base:
            return None
        try:
            return await self.radio.strength(base)
        except RadioError:
            return None  # a base that is not there yet may come soon
        except (ProtocolError, OSError, TimeoutError):
            self._due = now + _RETRY
        return None


class Signals:
    """Signals of all robots of ours.

    Attributes:
        dbm: signal of the base at each robot that knows it, dBm.
    """

    def __init__(
        self,
        host: str,
        port: int,
        base: str,
        wanted: Callable[[], bool],
        names: Callable[[], Collection[str]],
    ) -> None:
        """Know nothing yet.

        Args:
            host, port: of the wireless server. base: name of the operator's base.
            wanted: whether anybody looks; nothing is asked while nobody does.
            names: tells the robots of ours.
        """
        self.dbm: dict[str, float] = {}
        self._address = Address(host, port, _PATIENCE)
        self._base, self._wanted, self._names = base, wanted, names
        self._members: dict[str, _Member] = {}
        self._paced = False
        self._asked = -math.inf

    async def at(self, time: float) -> None:
        """The world stands still at this simulated time, s; from now on only then is asked."""
        self._paced = True
        if time >= self._asked + PERIOD - 1e-6:
            self._asked = time
            await self.beat()

    async def run(self) -> None:
        """Ask until cancelled, while nobody says what time it is."""
        try:
            while True:
                if not self._paced:
                    await self.beat()
                await asyncio.sleep(PERIOD)
        finally:
            for name in list(self._members):
                await self.forget(name)

    async def beat(self) -> None:
        """Ask for all of them, at the same time."""
        if not self._wanted():
            return
        for name in set(self._names()) - self._members.keys():
            self._members[name] = _Member(Radio(self._address, name))
        members = list(self._members.items())
        # All are there before anybody asks, so that the first answers do not come of a race.
        await asyncio.gather(*(one.register() for _, one in members))
        await asyncio.gather(*(self._ask(name, one) for name, one in members))

    async def _ask(self, name: str, member: _Member) -> None:
        dbm = await member.ask(self._base)
        if self._members.get(name) is not member:  # it has left meanwhile
            await member.radio.close()
        elif dbm is None or not math.isfinite(dbm):
            self.dbm.pop(name, None)
        else:
            self.dbm[name] = round(dbm, 2)

    async def forget(self, name: str) -> None:
        """A robot has left the world: it leaves the radio, too."""
        self.dbm.pop(name, None)
        if (member := self._members.pop(name, None)) is not None:
            await member.radio.close()
