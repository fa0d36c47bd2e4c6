"""From the `[wireless]` table of a settings file to a model and all that goes with it.

That is fading, which a signal gains and loses by reflections, drawn so that runs repeat, and what a
link does to the traffic it carries: latency, bandwidth, loss. No clock, no socket.
"""

from __future__ import annotations

import hashlib
import math
import random
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from usarsim_server.base.errors import SettingsError
from usarsim_server.base.fields import field
from usarsim_server.base.tables import Table
from usarsim_server.base.toml import read_toml
from usarsim_server.radio.models import Propagation, create_model


@dataclass(frozen=True, slots=True)
class Fading:
    """Log-normal fading: a normal deviation in dB for each pair, constant for a while.

    The deviation is a function of seed, pair and simulated time alone, the same in both
    directions: whoever asks, however often, it repeats.
    """

    deviation: float = field(
        default=0.0,
        key="fading",
        unit="dB",
        low=0.0,
        high=100.0,
        help="standard deviation of Gaussian fading; 0: none",
    )
    interval: float = field(
        default=1.0,
        key="fading_interval",
        unit="s",
        low=1e-3,
        high=1e6,
        help="simulated time for which a value stays",
    )
    seed: int = field(
        default=0, low=0, high=2**63 - 1, help="of fading and loss; default: that of the server"
    )

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

    Links carry TCP, so nothing is missing in the end: a lost frame is sent again, which takes time.
    """

    latency: float = field(
        default=0.0, unit="s", low=0.0, high=60.0, help="from one end of a link to the other"
    )
    bandwidth: float = field(
        default=0.0,
        unit="bytes/s",
        low=0.0,
        high=1e12,
        help="in either direction of each link; 0: whatever the machine carries",
    )
    loss: float = field(
        default=0.0, low=0.0, high=0.9, help=f"probability that a frame of {FRAME} bytes is lost"
    )
    retry_delay: float = field(
        default=0.02, unit="s", low=0.0, high=60.0, help="until a lost frame is sent again"
    )

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


DEFAULT_MODEL = "obstacle"


@dataclass(frozen=True, slots=True, eq=False)
class RadioOptions:
    """How the wireless simulation works."""

    model: Propagation  # propagation
    fading: Fading  # random part of the signal
    shape: LinkShape  # of the traffic that links carry
    poll: float = field(
        default=0.25, unit="s", low=0.02, high=60.0, help="wall time between two looks at the world"
    )
    patience: float = field(
        default=1.0,
        unit="s",
        low=0.0,
        high=1e9,
        help="wall time that a registered robot may be missing in the simulator",
    )
    cache_distance: float = field(
        default=0.25,
        unit="m",
        low=0.0,
        high=1000.0,
        help="how far a robot may move before obstacles are counted again",
    )
    share: float = field(
        default=0.15, low=0.01, high=64.0, help="of a processor that all links together may use"
    )


def read_radio(
    content: Mapping[str, object], place: str, model: str | None = None, seed: int = 0
) -> RadioOptions:
    """Read a table.

    Args:
        content: keys as in docs/wireless.md; the model's own stand among them.
        place: where it stands, for errors.
        model: name that wins over the table's.
        seed: of fading and loss, unless the table names one.

    Raises:
        SettingsError: for the first thing that is wrong, with place and cure.
    """
    table = Table(content, place, SettingsError, kind="the wireless simulation", hyphens=True)
    written = table.text("model", DEFAULT_MODEL)
    where = f"{place}: model" if model is None else "--wireless-model"
    chosen = create_model(model or written, table, where)
    fading = table.read(Fading, Fading(seed=seed))
    options = table.read(RadioOptions, model=chosen, fading=fading, shape=table.read(LinkShape))
    table.finish()
    return options


def read_radio_file(path: Path) -> dict[str, object]:
    """The table that a file of its own holds, with or without a `[wireless]` head.

    Raises:
        SettingsError: if it cannot be read or is not TOML.
    """
    table = read_toml(path, SettingsError, "wireless.obstacle")
    inner = table.get("wireless")
    return inner if isinstance(inner, dict) and len(table) == 1 else table
