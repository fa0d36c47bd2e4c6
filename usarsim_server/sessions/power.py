"""The battery: an even drain from the moment of spawning, whatever the robot does.

The original divides the stored energy by a moving average of the drain that starts at the nominal
drain and never leaves it, so the printed value falls by one a second (robots reference 2.10).

The headlight: DRIVE switches it, STA reports it, cameras see what it shines on.
"""

from __future__ import annotations

import math
from collections.abc import Callable

NO_BATTERY = 99999
"""What STA prints for a robot without a battery, and the most it prints for one with it."""

_SLACK = 1e-6
"""s: 1200 s less 0.3 s less 0.7 s is 1199 s, although not in binary."""


class Battery:
    """A store of energy that lasts `life` seconds of simulated time after spawning."""

    def __init__(self, life: float, energy: float = 1.0e6) -> None:
        """Start with a full charge.

        Args:
            life: s that the charge lasts; not above zero is an empty battery.
            energy: J of a full charge.
        """
        self._life = max(life, 0.0) if math.isfinite(life) else 0.0
        self._energy = energy

    def remaining_energy(self, elapsed: float) -> float:
        """Energy (J) that is left `elapsed` simulated seconds after spawning."""
        return self._energy * self._remaining(elapsed) / self._life if self._life else 0.0

    def remaining_seconds(self, elapsed: float) -> int:
        """Whole seconds of life left `elapsed` simulated seconds after spawning, for STA."""
        return min(int(self._remaining(elapsed) + _SLACK), NO_BATTERY)

    def empty(self, elapsed: float) -> bool:
        """Whether nothing is left: sensors fall silent and the robot stops."""
        return self._remaining(elapsed) <= _SLACK

    def _remaining(self, elapsed: float) -> float:
        return max(self._life - max(elapsed, 0.0), 0.0)


class BatteryGauge:
    """Shows everybody the battery of a robot that its pilot keeps; may be read by any thread."""

    def __init__(self) -> None:
        """Until it is connected it shows a robot without a battery."""
        self._read: Callable[[float], int] = lambda time: NO_BATTERY

    def connect(self, read: Callable[[float], int]) -> None:
        """Show what a function makes of a simulated time (s): whole seconds of life left."""
        self._read = read

    def seconds(self, time: float) -> int:
        """Whole seconds of life left at a simulated time (s)."""
        return self._read(time)

    def empty(self, time: float) -> bool:
        """Whether the battery is empty as wireless simulation sees it (side channels 3.2)."""
        return self.seconds(time) <= 0


class Headlight:
    """Shows everybody whether the lamp that a pilot switches is lit; may be read by any thread."""

    def __init__(self) -> None:
        """Until it is connected it is dark."""
        self._read: Callable[[], bool] = lambda: False

    def connect(self, read: Callable[[], bool]) -> None:
        """Show what a function says; it must return at once."""
        self._read = read

    @property
    def lit(self) -> bool:
        """Whether it is on and has power."""
        return self._read()
