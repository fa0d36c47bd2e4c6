"""All steps of a run, ready to be shown in any order.

Kept are what changed in the maps, and every `_BLOCK` steps the maps as a whole, packed: 20 kB for a
step of four robots in the office. So a jump costs the same wherever it leads.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.history import Counts
from usarsim_exploration.log_files import AGENTS, read_history
from usarsim_exploration.rendezvous import Meeting
from usarsim_exploration.replaying import again, log_of
from usarsim_exploration.run_folder import load_run
from usarsim_exploration.running import Run
from usarsim_exploration.showing.scene import (
    Cells,
    Figure,
    Scene,
    Selection,
    driven_by,
    figure_of,
    layers_of,
    links_of,
    meeting_of,
    selection_of,
    title_of,
)

_BLOCK = 64
"""Steps."""


@dataclass(slots=True)
class _Block:
    """Some steps: all layers at the first one, then cells and values that changed by step."""

    packed: bytes
    changes: list[tuple[NDArray[np.int32], NDArray[np.uint8]]] = field(default_factory=list)


@dataclass(frozen=True, slots=True, eq=False)
class _Moment:
    figures: tuple[Figure, ...]
    links: Cells


class Tape:
    """Records a run that somebody else drives, or drives it; shows any step of it.

    One thread may record while another one shows.

    Attributes:
        run: what is recorded. shares: by step the percentages of the reachable cells that the team,
            the base and each robot know.
    """

    def __init__(self, run: Run, logged: Counts | None = None) -> None:
        """The start is noted at once.

        Args:
            run: at its start.
            logged: (steps, bodies, 2) where everybody has to be; see `note`.
        """
        self.run, self._logged = run, logged
        self.title = title_of(run.scenario)
        self.names = tuple(body.member.name for body in run.cycle.bodies)
        self.shares: list[tuple[float, ...]] = []
        self._moments: list[_Moment] = []
        self._driven: list[list[Cells]] = []
        self._blocks: list[_Block] = []
        self._chosen: dict[int, tuple[Meeting, Selection | None]] = {}
        self._last = layers_of(run.cycle)
        self._shown = self._last.copy()
        self._at = -1
        self.note()

    def __len__(self) -> int:
        """Steps that can be shown, the start among them."""
        return len(self._moments)

    def advance(self) -> bool:
        """Make a step and note it; whether the run goes on."""
        goes_on = self.run.step()
        self.note()
        return goes_on

    def note(self) -> None:
        """Note the state of the run; a step that is known already is not noted again.

        Raises:
            ExplorationError: somebody is not where the log says.
        """
        cycle, step = self.run.cycle, len(self._moments)
        if cycle.step < step:
            return
        cells = np.array([body.view.cell for body in cycle.bodies])
        if self._logged is not None and not np.array_equal(self._logged[step : step + 1], [cells]):
            raise ExplorationError(
                f"{self.title}: step {step} is not that of the log (another version wrote it; "
                "show what the log says with --from-log)"
            )
        layers = layers_of(cycle)
        if step % _BLOCK == 0:
            self._blocks.append(_Block(zlib.compress(layers.tobytes(), 1)))
        else:
            changed = np.flatnonzero(layers != self._last)
            values = layers.reshape(-1)[changed]
            self._blocks[-1].changes.append((changed.astype(np.int32), values))
        self._last = layers
        figures = tuple(
            figure_of(body, self._selection(number)) for number, body in enumerate(cycle.bodies)
        )
        recorder = self.run.recorder
        known = recorder.known_team, *recorder.known
        self.shares.append(tuple(100 * one / recorder.reachable for one in known))
        self._driven.append([driven_by(body, step) for body in cycle.bodies])
        self._moments.append(_Moment(figures, links_of(cycle)))

    def scene(self, step: int) -> Scene:
        """A step; its layers are valid until the next one is asked for."""
        block = self._blocks[step // _BLOCK]
        first = step - step % _BLOCK
        if not first <= self._at <= step:
            flat = np.frombuffer(zlib.decompress(block.packed), np.uint8)
            self._shown, self._at = flat.reshape(self._last.shape).copy(), first
        flat = self._shown.reshape(-1)
        for cells, values in block.changes[self._at - first : step - first]:
            flat[cells] = values
        self._at = step
        moment = self._moments[step]
        team, base, *_ = self.shares[step]
        scenario = self.run.scenario
        return Scene(
            self.title, step, moment.figures, moment.links, self._shown,
            self._driven[: step + 1], team, base,
            scenario.radio, scenario.world.environment.cell,
        )  # fmt: skip

    def _selection(self, number: int) -> Selection | None:
        """That of the newest meeting of a robot; found when the meeting is new."""
        body = self.run.cycle.bodies[number]
        meeting = meeting_of(body)
        if meeting is None:
            return None
        before = self._chosen.get(number)
        if before is None or before[0] != meeting:
            before = self._chosen[number] = meeting, selection_of(body)
        return before[1]


def tape_of(folder: Path, *, from_log: bool = False, code: bool = False) -> Tape:
    """The run of a folder, at its start.

    Args:
        folder: with `scenario.toml` and, if the run has been, its logs.
        from_log: robots do what the log says; else they decide again, and the log has to agree.
        code: a strategy that stands in a file is run.

    Raises:
        UsarsimError: a file cannot be used.
    """
    scenario = load_run(folder, code=code)
    if not from_log:
        there = (folder / AGENTS).is_file()
        return Tape(Run(scenario), read_history(folder, scenario.rules, 0).cell if there else None)
    return Tape(again(scenario, log_of(read_history(folder, scenario.rules, 0))))
