"""What follows from the logs of a run beside its score: `state.csv` and the files handed in."""

from __future__ import annotations

import io
from pathlib import Path

from usarsim_mission.hand_in import HandIn
from usarsim_mission.referee import Referee
from usarsim_mission.runlog import TRUTH, RunFolder
from usarsim_mission.state import STATE, StateTable, thinned
from usarsim_server.cli.common import written


def derive(folder: Path) -> list[Path]:
    """Write `state.csv` and, if the run has a map, `map/`.

    Returns:
        The files.

    Raises:
        MissionError: the logs cannot be read.
        UsarsimError: a file cannot be written.
    """
    run = RunFolder(folder)
    mission, world = run.world()
    referee, hand_in = Referee(mission, run.rules(), world), HandIn()
    with written(folder / STATE) as file:
        text = io.TextIOWrapper(file, "utf-8", newline="")
        with (folder / TRUTH).open("rb") as rows:
            every = thinned(sum(1 for _ in rows), max(1, len(world.starts)))
        table = StateTable(text, every)
        for record in run.records():
            if record["kind"] != "map":  # judging it takes long and is in no file here
                referee.feed(record)
            table.take(record, referee)
            hand_in.take(record, referee)
        text.detach()  # which flushes; the file is closed by whom it was opened
    return [folder / STATE, *hand_in.write(folder, mission.name, referee)]
