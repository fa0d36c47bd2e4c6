"""What renders: the border between the studio and OpenGL or rays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.cameras.stage import Stage
from usarsim_server.cameras.viewpoint import Eye

__all__ = ["NEAR", "SKY", "Backend", "Quality", "Shot", "Wanted", "far_plane"]

NEAR = 0.12
"""m: nothing nearer is drawn, as in the original (robots reference 2.7 and 5.4 #102)."""

SKY = 0.6
"""Part of the far plane's distance within which things are seen. MuJoCo draws the sky itself as a
faceted ball of about 0.7, and it covers whatever is beyond."""
_MIN_FAR = 100.0
"""m to the far plane at least."""


def far_plane(model: mujoco.MjModel) -> float:
    """Distance (m) of the far plane in the scene of a model."""
    return max(_MIN_FAR, float(model.vis.map.zfar) * float(model.stat.extent))


@dataclass(frozen=True, slots=True)
class Quality:
    """What pictures may cost.

    Attributes:
        shadows: edge of the shadow map, pixels; 0: no shadows.
        multisample: samples per pixel; 0: none.
    """

    shadows: int = 0
    multisample: int = 0


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is wanted of a shot beside its colours."""

    depth: bool = False
    albedo: bool = False
    geoms: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """What one eye sees, top row first; valid until the next shot.

    Attributes:
        colors: (height, width, 3) uint8, red green blue.
        depth: (height, width) float32, metres along the viewing axis, infinity for the sky.
        albedo: (height, width, 3) uint8, colours in plain white light from everywhere.
        geoms: (height, width) int32, -1 for the sky.
    """

    colors: NDArray[np.uint8]
    depth: NDArray[np.float32] | None = None
    albedo: NDArray[np.uint8] | None = None
    geoms: NDArray[np.int32] | None = None


class Backend(Protocol):
    """Renders stages; made, used and closed by one thread."""

    @property
    def name(self) -> str:
        """For the log."""

    def render(self, stage: Stage, eye: Eye, wanted: Wanted) -> Shot:
        """What an eye sees of a stage as it is now.

        Raises:
            RuntimeError: if the machine cannot do it.
        """

    def close(self) -> None:
        """Give everything back."""
