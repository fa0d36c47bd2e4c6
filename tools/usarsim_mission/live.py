"""A run while it happens: what is told is logged, judged, and the verdicts are logged, too."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from usarsim_mission.deriving import derive
from usarsim_mission.errors import RunLogError
from usarsim_mission.records import Record
from usarsim_mission.referee import Referee
from usarsim_mission.runlog import SCORE, RunWriter
from usarsim_server.base.errors import at
from usarsim_server.base.files import reason, write_text


class LiveRun:
    """A log and its referee. When the disk fails the trial ends with that reason.

    Attributes:
        referee: whose `score`, `over` and `ends_at` may be looked at.
        log: whose `trouble` may be.
    """

    def __init__(self, log: RunWriter, referee: Referee) -> None:
        self.log, self.referee = log, referee

    def tell(self, kind: str, t_sim: float, **facts: Any) -> list[Record]:
        """Something happened.

        Args:
            kind: of record. t_sim: s of simulated time. facts: of that kind.

        Returns:
            The records of what happened and of all that the referee makes of it, as logged.
        """
        found = self._told({"t_sim": t_sim, "kind": kind, **facts})
        if self.log.trouble is not None and self.referee.running:
            text = f"the logs cannot be written: {self.log.trouble}"
            found += self._told({"t_sim": t_sim, "kind": "trial_end", "why": "error", "text": text})
        return found

    def _told(self, record: Record) -> list[Record]:
        told = self.log.write(record)
        return [told, *(self.log.write(derived) for derived in self.referee.feed(told))]

    def close(self) -> dict[str, Any]:
        """End the logs; write `score.json`, `state.csv` and, if there is a map, `map/`.

        Returns:
            What `score.json` tells.

        Raises:
            RunLogError: not all could be written.
        """
        result = self.referee.result()
        try:
            self.log.close()
        finally:
            write_score(self.log.folder, result)
        derive(self.log.folder)
        return result


def score_json(result: dict[str, Any]) -> str:
    """The text of `score.json`."""
    return json.dumps(result, indent=1, allow_nan=False) + "\n"


def write_score(folder: Path, result: dict[str, Any]) -> None:
    """Write `score.json` of a run.

    Raises:
        RunLogError: it cannot be written.
    """
    try:
        write_text(folder / SCORE, score_json(result))
    except OSError as error:
        cure = "make room on the disk, then run usarsim mission score --write"
        raise RunLogError(
            at(folder / SCORE, f"cannot be written: {reason(error)}", cure)
        ) from error
