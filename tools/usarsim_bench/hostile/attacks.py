"""All attacks by name."""

from __future__ import annotations

from collections.abc import Mapping

from usarsim_bench.hostile.attack import Attack
from usarsim_bench.hostile.control_attacks import CONTROL_ATTACKS
from usarsim_bench.hostile.side_attacks import SIDE_ATTACKS

ATTACKS: Mapping[str, Attack] = {one.name: one for one in (*CONTROL_ATTACKS, *SIDE_ATTACKS)}
"""In the order in which they are tried."""
