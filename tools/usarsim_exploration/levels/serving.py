"""A server of a run's own: its world in lockstep, on ports that the system chooses."""

from __future__ import annotations

import re
import resource
import subprocess
import tempfile
import threading
from collections import deque
from pathlib import Path

from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.radio import Radio
from usarsim_exploration.radio.families.path_loss import PathLoss
from usarsim_exploration.radio.families.ranges import Circle, Sight
from usarsim_exploration.worlds import World
from usarsim_exploration.worlds.physics import write_world
from usarsim_server.base.children import python
from usarsim_server.base.toml import toml_text

ROBOTS = Path(__file__).parent / "robots"
"""Folder with the robots of explorations, for `usarsim serve --robots`."""
_OFF = ("image", "groundtruth", "truth", "comserver", "scene")
_GRACE = 5.0
"""s of wall time that a server has to end by itself."""
_LAST = 5
"""Lines of a server that are told when it has ended."""


class OwnServer:
    """A server in a process of its own, which ends with this one, however that ends.

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
            ExplorationError: it does not start; or its wireless server has no such radio.
        """
        self._folder = tempfile.TemporaryDirectory(prefix="usarsim-explore-")
        folder = Path(self._folder.name)
        self._used = 0.0
        try:
            write_world(world, folder / "world")
            settings = folder / "wireless.toml"
            settings.write_text(toml_text(wireless(radio, reach * world.environment.cell)))
            words = [
                f"--world={folder / 'world'}", f"--wireless={settings}", f"--robots={ROBOTS}",
                "--lockstep", f"--tick={tick}", f"--seed={seed}", "--max-robots=80",
                "--port=0", "--wireless-port=0", *(f"--{one}-port=off" for one in _OFF),
                "--lockstep-patience=0",
            ]  # fmt: skip
            self._process = subprocess.Popen(
                python("-m", "usarsim_server", "serve", *words, tied=True),
                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                text=True, start_new_session=True,
            )  # fmt: skip
        except BaseException:
            self._folder.cleanup()
            raise
        self._said: deque[str] = deque(maxlen=_LAST)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        assert self._process.stdout is not None
        found = dict(re.findall(r"(\w+)=\S+:(\d+)", self._process.stdout.readline()))
        if "control" not in found or "wireless" not in found:
            self.close()
            raise ExplorationError(f"the server did not start: {self.last_words()}")
        self.control, self.wireless = int(found["control"]), int(found["wireless"])

    def _read(self) -> None:
        assert self._process.stderr is not None
        for line in self._process.stderr:
            self._said.append(line.strip())

    def last_words(self) -> str:
        """What it said last, and its exit code if it has ended."""
        code = self._process.poll()
        ended = f"exit code {code}" if code is not None else "it still runs"
        return "; ".join([ended, *self._said])

    def close(self) -> float:
        """End it; processor s that it has used."""
        if self._process.returncode is None:
            before = _children()
            self._process.terminate()
            try:
                self._process.wait(_GRACE)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            self._used = _children() - before
        self._reader.join(1.0)
        for pipe in (self._process.stdout, self._process.stderr):
            if pipe is not None:
                pipe.close()
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
