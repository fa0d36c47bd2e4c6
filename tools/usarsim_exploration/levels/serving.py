"""A server of a run's own: its world in lockstep, on ports that the system chooses."""

from __future__ import annotations

import resource
import tempfile
from pathlib import Path

from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.radio import Radio
from usarsim_exploration.radio.families.path_loss import PathLoss
from usarsim_exploration.radio.families.ranges import Circle, Sight
from usarsim_exploration.worlds import World
from usarsim_exploration.worlds.physics import write_world
from usarsim_server.base.launch import OwnServer
from usarsim_server.base.toml import toml_text

ROBOTS = Path(__file__).parent / "robots"
"""Folder with the robots of explorations, for `usarsim serve --robots`."""


class WorldServer:
    """A server with the world of a scenario.

    Attributes:
        host: its address. control, wireless: its ports.
    """

    host = "127.0.0.1"

    def __init__(self, world: World, radio: Radio, reach: float, seed: int, tick: float) -> None:
        """Start it and wait until it is ready.

        Args:
            world: to be simulated. radio: of the scenario. reach: range of its radios, cells.
            seed: of all noise. tick: simulated s.

        Raises:
            ExplorationError: its wireless server has no such radio.
            LaunchError: it does not start.
        """
        self._folder = tempfile.TemporaryDirectory(prefix="usarsim-explore-")
        folder = Path(self._folder.name)
        self._used = 0.0
        try:
            write_world(world, folder / "world")
            settings = folder / "wireless.toml"
            settings.write_text(toml_text(wireless(radio, reach * world.environment.cell)))
            self._server = OwnServer(
                f"--world={folder / 'world'}", f"--wireless={settings}", f"--robots={ROBOTS}",
                "--lockstep", f"--tick={tick}", f"--seed={seed}", "--max-robots=80",
                "--wireless-port=0", "--lockstep-patience=0",
            )  # fmt: skip
        except BaseException:
            self._folder.cleanup()
            raise
        self.control, self.wireless = (self._server.ports[one] for one in ("control", "wireless"))

    def close(self) -> float:
        """End it; processor s that it has used."""
        if not self._server.died:
            before = _children()
            self._server.end()
            self._used = _children() - before
        self._folder.cleanup()
        return self._used


def wireless(radio: Radio, reach: float) -> dict[str, object]:
    """Settings of the wireless server for a radio of scenarios. reach: m.

    Raises:
        ExplorationError: it has none that is the same.
    """
    found: dict[str, object] = {"poll": 0.02}
    match radio:
        case PathLoss(law=law, per_range=per_range, count="walls") if type(radio) is PathLoss:
            keys = ("cutoff", "reference_power", "path_loss_exponent", "reference_distance",
                    "wall_attenuation", "max_walls")  # fmt: skip
            found |= {"model": "path-loss"} | {key: getattr(law, key) for key in keys}
            if per_range:
                found["reference_distance"] = reach
        case Circle(sum_of_ranges=False):
            found |= {"model": "distance", "cutoff": -93.0, "reference_power": -93.0,
                      "path_loss_exponent": 2.5, "reference_distance": reach}  # fmt: skip
        case Sight(sum_of_ranges=False):
            found |= {"model": "line-of-sight", "range": reach}
        case _:
            cure = "write model = path-loss, circle or sight"
            problem = "the wireless server has no such model"
            raise ExplorationError(f"[radio] model: {problem} ({cure})")
    return found


def cutoff(radio: Radio) -> float:
    """Weakest signal that makes a link, dBm."""
    return radio.law.cutoff if isinstance(radio, PathLoss) else -93.0


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
