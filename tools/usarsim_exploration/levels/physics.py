"""The `[physics]` table: what robots of the level `server` are, and how they drive."""

from __future__ import annotations

from dataclasses import dataclass

from usarsim_exploration.localisation import Mode
from usarsim_server.base.fields import field


@dataclass(frozen=True)
class Physics:
    """Keys of `[physics]`; they mean nothing to the grid."""

    robot: str = field(
        default="P3AT", help="class of all robots: skid steered, with a flat laser and odometry"
    )
    seconds: float = field(
        default=2.0, low=0.2, high=60.0, unit="s",
        help="simulated time of a step; `speed` cells of it are the most that a robot drives",
    )  # fmt: skip
    control: float = field(
        default=0.2, low=0.02, high=1.0, unit="s",
        help="simulated time between two commands to the wheels; the tick of the server",
    )  # fmt: skip
    localisation: Mode = field(
        default="scan-matching",
        help="where robots know from where they are: from wheels and scans, from their wheels "
        "alone, or from the sensor GroundTruth",
    )

    inertial: bool = field(
        default=True, help="robots with an INS go by that and not by their wheels alone"
    )
    skid: float = field(
        default=1.5, low=1.0, high=3.0,
        help="how much more the wheels of such a robot turn it than it turns",
    )  # fmt: skip

    @property
    def ticks(self) -> int:
        """Of a step."""
        return max(1, round(self.seconds / self.control))
