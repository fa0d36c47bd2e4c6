"""Rates that clients have to keep, by token buckets in wall time.

A bucket fills at its rate up to its burst. Some limits make a client wait until it has paid what it
took on credit, so that nothing is lost; others refuse what there are no tokens for.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence

from usarsim_server.base.errors import SpawnError
from usarsim_server.base.token_bucket import Clock, TokenBucket

COMMAND_WORK = 100e-6
"""Processor time that a command may take, s; one that takes more counts as several. A DRIVE takes a
quarter of it (AMD EPYC)."""
MOST_WORK = 0.1
"""Processor time that commands of one chunk are charged for at most, s: an INIT for which the world
has to grow takes seconds."""
LONG_PART = 256
"""Bytes of a line that cost as much as a command: parsing them takes as long. Commands of known
clients are shorter, but for way points."""
REPLY_PART = 1024
"""Bytes of replies that cost as much as a command."""
READ_COST = 0.25
"""Cost of a read call, in commands, so that endless lines and single bytes are not for nothing."""
COMMAND_BURST = 2.0
"""Seconds' worth of commands that a client saves up while it sends fewer."""
OWN_BURST = 0.25
"""Seconds' worth of commands, at the full rate, that a client may send at once of its own."""
FIRST_CREDIT = 1.0
"""Seconds' worth of commands that a new client may send at once."""
SHARED_CREDIT = 64.0
"""Grants that can be given at the same time; then one a second. Without a common purse a client
that comes again and again would get new ones for ever."""
OWN_SHARE = 0.2
"""Part of its rate that a client has in any case: 200 commands a second, where the busiest client
of the field sends 180 (protocol reference, addendum). More than that comes out of what all clients
of a port share."""
_MOST_ADDRESSES = 1024


class AddressBuckets:
    """A bucket for each address that came lately. For one thread."""

    def __init__(self, make: Callable[[], TokenBucket]) -> None:
        """Make one bucket after the other when addresses turn up."""
        self._make = make
        self._buckets: dict[str, TokenBucket] = {}

    def __getitem__(self, address: str) -> TokenBucket:
        """The bucket of an address."""
        bucket = self._buckets.get(address)
        if bucket is None:
            if len(self._buckets) >= _MOST_ADDRESSES:
                self._forget()
            bucket = self._buckets[address] = self._make()
        return bucket

    def __len__(self) -> int:
        """Number of addresses remembered."""
        return len(self._buckets)

    def _forget(self) -> None:
        """Full buckets are like new ones; if all are in use, everybody starts anew."""
        self._buckets = {
            address: bucket
            for address, bucket in self._buckets.items()
            if bucket.tokens < bucket.burst
        }
        if len(self._buckets) >= _MOST_ADDRESSES:
            self._buckets.clear()


class SpawnGate:
    """Lets the clients of an address put so many robots into the world per second. Thread-safe."""

    def __init__(self, rate: float, burst: float, clock: Clock = time.monotonic) -> None:
        """Make a gate.

        Args:
            rate: robots per s of wall time and address; infinity for any number.
            burst: robots that may come at the same moment.
            clock: see `Clock`.
        """
        self._rate = rate
        self._lock = threading.Lock()
        self._buckets = AddressBuckets(lambda: TokenBucket(rate, burst, clock=clock))

    def admit(self, peer: str) -> None:
        """Let one more in.

        Args:
            peer: `host:port` of the client.

        Raises:
            SpawnError: if too many came lately.
        """
        if math.isinf(self._rate):
            return
        with self._lock:
            admitted = self._buckets[address_of(peer)].take()
        if not admitted:
            raise SpawnError(
                f"too many robots at once from this address (spawn_rate is {self._rate:g} a second)"
            )

    def forget(self, peer: str) -> None:
        """One that was let in did not come after all."""
        if math.isfinite(self._rate):
            with self._lock:
                self._buckets[address_of(peer)].give()


class InputRates:
    """How many commands the clients of a service may send. For one thread."""

    def __init__(self, rate: float, clock: Clock = time.monotonic) -> None:
        """Nobody has come yet.

        Args:
            rate: commands per s of one client in the long run; infinity for any number.
            clock: see `Clock`.
        """
        self.rate = rate
        self.waiting = 0
        """Number of clients that wait just now, because they sent too many."""
        self._clock = clock
        self._shared_credit = TokenBucket(
            FIRST_CREDIT * rate, SHARED_CREDIT * FIRST_CREDIT * rate, clock=clock
        )

    def newcomer(self) -> TokenBucket:
        """The commands of a new client."""
        if math.isinf(self.rate):
            return TokenBucket(self.rate, self.rate, clock=self._clock)
        grant = self._shared_credit.draw(FIRST_CREDIT * self.rate)
        return TokenBucket(self.rate, COMMAND_BURST * self.rate, start=grant, clock=self._clock)

    def own(self, client: TokenBucket) -> TokenBucket:
        """The commands that a new client may send whatever all the others do."""
        own, burst = OWN_SHARE * self.rate, OWN_BURST * self.rate
        start = min(burst, client.tokens)
        return TokenBucket(own, burst, start=start, deepest=2.0 * own, clock=self._clock)


def address_of(peer: str) -> str:
    """The host of `host:port`."""
    return peer.rpartition(":")[0]


def work_cost(seconds: float) -> float:
    """What commands have cost that took so many s of processor time, in commands."""
    return min(seconds, MOST_WORK) / COMMAND_WORK


def input_cost(lines: Sequence[bytes], commands: int) -> float:
    """What reading a chunk has cost, in commands.

    Args:
        lines: those that it completed.
        commands: number of commands in them.
    """
    long_parts = sum(len(line) // LONG_PART for line in lines)
    return READ_COST + max(len(lines), commands) + long_parts
