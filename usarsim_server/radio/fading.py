"""Fading: what a signal gains and loses by reflections, drawn so that runs repeat."""

from __future__ import annotations

import hashlib
import math
import struct
from dataclasses import dataclass

__all__ = ["Fading"]


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
