"""Fading: what a signal gains and loses by reflections, drawn so that runs repeat.

What a link does to the traffic it carries: latency, bandwidth, loss. No clock, no socket.
"""

from __future__ import annotations

import hashlib
import math
import random
import struct
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Fading:
    """Log-normal fading: a normal deviation in dB for each pair, constant for a while.

    The deviation is a function of seed, pair and simulated time alone, the same in both
    directions: whoever asks, however often, it repeats.

    Attributes:
        deviation: standard deviation, dB; 0 for no fading.
        interval: simulated s for which a value stays.
        seed: chooses the values.
    """

    deviation: float = 0.0
    interval: float = 1.0
    seed: int = 0

    def of(self, one: str, other: str, time: float) -> float:
        """dB to add to the signal between two stations at a simulated time (s)."""
        if not self.deviation:
            return 0.0
        pair = "\0".join(sorted((one, other)))
        key = f"{self.seed}\0{math.floor(time / self.interval)}\0{pair}"
        digest = hashlib.blake2b(key.encode("utf-8", "surrogatepass"), digest_size=16).digest()
        first, second = struct.unpack("<QQ", digest)
        # Box and Muller; the half keeps the logarithm away from zero.
        radius = math.sqrt(-2.0 * math.log((first + 0.5) / 2**64))
        return self.deviation * radius * math.cos(2.0 * math.pi * second / 2**64)


FRAME = 1500
"""Bytes that get lost together: the greatest payload of an IEEE 802.11 or Ethernet frame."""


@dataclass(frozen=True, slots=True)
class LinkShape:
    """Properties of every link in either direction; times are simulated.

    Attributes:
        latency: s from one end to the other.
        bandwidth: bytes/s; 0 for as much as the machine carries.
        loss: probability that a frame gets lost, below 1. Links carry TCP, so nothing is missing
            in the end: a lost frame is sent again, and that takes time.
        retry_delay: s until a lost frame is sent again.
    """

    latency: float = 0.0
    bandwidth: float = 0.0
    loss: float = 0.0
    retry_delay: float = 0.02

    @property
    def plain(self) -> bool:
        """Whether traffic simply passes."""
        return not (self.latency or self.bandwidth or self.loss)


class LinkClock:
    """Tells when each block of one direction of one link arrives; blocks never overtake."""

    def __init__(self, shape: LinkShape, seed: str) -> None:
        """Begin with an idle link; equal seeds lose equal frames."""
        self._shape = shape
        self._random = random.Random(seed)
        self._free = 0.0

    def arrival(self, now: float, size: int) -> float:
        """When a block of so many bytes, handed over now, has arrived whole (simulated s)."""
        shape = self._shape
        frames = -(-size // FRAME)
        again = self._lost(frames) if shape.loss else 0
        airtime = again * shape.retry_delay
        if shape.bandwidth:
            airtime += (size + again * FRAME) / shape.bandwidth
        self._free = max(self._free, now) + airtime
        return self._free + shape.latency

    def _lost(self, frames: int) -> int:
        """How often any of the frames has to be sent again."""
        again = 0
        for _ in range(frames):
            while self._random.random() < self._shape.loss:
                again += 1
        return again
