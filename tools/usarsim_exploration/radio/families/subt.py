"""Radios as in the underground: frames get lost more and more before a link ends.

After the communication model of the DARPA Subterranean Challenge's simulator: log-distance path
loss, bits wrong by the ratio of signal to noise under QPSK, a frame lost with any of its bits, and
so many bytes for each radio in an epoch. There the rock between tiles is counted; here walls are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

from usarsim_exploration.messages import FRAME
from usarsim_exploration.radio.families.path_loss import PathLoss
from usarsim_exploration.radio.models import register
from usarsim_server.base.fields import field
from usarsim_server.base.tables import Table
from usarsim_server.radio import models as server

LAW = server.PathLoss(
    reference_power=-20.0,
    path_loss_exponent=3.5,
    reference_distance=1.0,
    wall_attenuation=10.0,
    max_walls=10**6,
)
"""20 dBm sent, 40 dB lost over the first metre."""


@register("subt")
@dataclass(frozen=True)
class SubT(PathLoss):
    """A link ends where half of the frames get lost.

    Attributes:
        noise: dBm.
    """

    law: server.PathLoss = LAW
    per_range: bool = False
    strict: bool = False
    bandwidth: int = field(
        default=4000, low=1, high=10**12, unit="bytes/step", help="of each radio"
    )
    noise: float = field(default=-90.0, low=-300.0, high=0.0, unit="dBm", help="noise floor")

    @classmethod
    def read(cls, table: Table) -> Self:
        """The keys of the law and of the traffic."""
        return table.read(cls, law=table.read(server.PathLoss, LAW), per_range=False, strict=False)

    def frame_loss(self, distance: float, reach: float, walls: int, cell: float) -> float:
        """1 - (1 - loss) (1 - b)^n with n bits of a frame and b = erfc(sqrt(signal / noise))."""
        ratio = 10.0 ** (min(self.strength(distance, reach, walls, cell) - self.noise, 60.0) / 10.0)
        wrong = math.erfc(math.sqrt(ratio))
        if wrong >= 1.0:
            return 1.0
        return 1.0 - (1.0 - self.loss) * math.exp(8 * FRAME * math.log1p(-wrong))

    def hears(self, distance: float, reach: float, walls: int, cell: float) -> bool:
        """Whether at least half of the frames arrive that chance alone would let through."""
        alone = 1.0 - self.loss
        return self.frame_loss(distance, reach, walls, cell) <= 1.0 - 0.5 * alone
