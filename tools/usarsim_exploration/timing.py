"""How long the parts of a run take; told beside the results, never part of them."""

from __future__ import annotations

import time

PHASES = ("set up", "plan", "sense", "communicate", "record")


class Watch:
    """Adds up wall and processor time by phase."""

    def __init__(self) -> None:
        """Setting up begins now."""
        self._spent = dict.fromkeys(PHASES, (0, 0))
        self._phase = PHASES[0]
        self._since = time.perf_counter_ns(), time.process_time_ns()

    def begin(self, phase: str) -> None:
        """Another phase begins, and the last one ends."""
        now = time.perf_counter_ns(), time.process_time_ns()
        wall, processor = self._spent[self._phase]
        wall += now[0] - self._since[0]
        self._spent[self._phase] = wall, processor + now[1] - self._since[1]
        self._phase, self._since = phase, now

    def processor(self) -> dict[str, float]:
        """Processor seconds by phase, without the one that goes on."""
        return {phase: spent[1] / 1e9 for phase, spent in self._spent.items()}

    def facts(self, steps: int) -> dict[str, object]:
        """Seconds, and their split by phase; the watch goes on."""
        self.begin(self._phase)
        wall, processor = (sum(one) / 1e9 for one in zip(*self._spent.values(), strict=True))
        setting_up = self._spent[PHASES[0]][1] / 1e9
        return {
            "wall_s": wall,
            "processor_s": processor,
            "processor_ms_per_step": 1e3 * (processor - setting_up) / max(steps, 1),
            "phases": {
                phase: {"wall_s": spent[0] / 1e9, "processor_s": spent[1] / 1e9}
                for phase, spent in self._spent.items()
            },
        }
