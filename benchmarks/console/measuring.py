"""The checks of the console that are figures, by their numbers, and the one table of them."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import replace
from typing import Any

from benchmarks.console import ITEMS, hands, loads, sizes
from benchmarks.console.browser import chromium
from benchmarks.console.gateway import Rig
from benchmarks.plan import Plan
from usarsim_bench.figures import BenchError, Figure, Section
from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.extras import need
from usarsim_server.base.interrupts import calling

ROBOTS = 16
GRACE = 20.0
"""s to tell what was measured, and to end everything, after an interrupt."""

Measure = Callable[[Rig, Plan], Coroutine[Any, Any, list[Figure]]]


BEFORE: Mapping[str, Callable[[Plan], list[Figure]]] = {
    "con-02": sizes.extra,
    "con-04": sizes.imported_map,
}
"""What wants no gateway, or a server of its own."""
BESIDE: Mapping[str, Measure] = {
    "con-04": sizes.page_and_scene,
    "con-05": hands.first_paint,
    "con-07": loads.pages,
    "con-08": hands.frames,
    "con-12": hands.blocked,
    "con-15": loads.emergency_stop,
    "con-22": loads.slow_page,
    "o-37": hands.presses,
    "o-38": loads.long_look,
}
"""What is taken beside a gateway with a team."""


def measure_console(plan: Plan) -> Section:
    """Take the items of `plan.only`, or all of them, beside one server and one gateway."""
    need("aiohttp", extra="console", asker="the console")
    robots = plan.robots or ROBOTS
    figures: list[Figure] = []
    failed: list[str] = []
    stop = _Stop()
    at = ""
    with calling(stop, GRACE), contextlib.ExitStack() as stack:
        rig = None
        for at in plan.only or tuple(ITEMS):
            own = replace(plan, say=_named(plan, at))
            own.say(ITEMS[at])
            try:
                if at in BEFORE:
                    figures += _marked(at, BEFORE[at](own))
                if at in BESIDE:
                    if rig is None:
                        plan.say(f"console: {robots} robots come into the world")
                        rig = stack.enter_context(Rig(plan.world, robots))
                    figures += _marked(at, asyncio.run(stop.ending(BESIDE[at](rig, own))))
            except UsarsimError as error:
                failed.append(f"{at} ({error})")
            except asyncio.CancelledError:
                failed.append(f"{at} (interrupted)")
            except Exception as error:  # whatever an interrupt broke: a browser, a socket
                if not stop.called:
                    raise
                failed.append(f"{at} (interrupted: {error})")
            if stop.called:
                own.say("interrupted")
                # The interrupt has reached server and gateway, too, which may be a fault to them.
                with contextlib.suppress(BenchError):
                    stack.close()
                break
    interrupted = f"Interrupted at {at}. " if stop.called else ""
    if not figures:
        raise BenchError("; ".join(failed) or "interrupted before anything was measured")
    pages = "Chromium" if chromium() else "programs, as there is no Chromium with playwright"
    return Section(
        "console",
        "The operator console",
        f"{interrupted}{robots} P3AT of one gateway's own in {plan.world}, 16 tiles of 320 x 240; "
        f"pages are {pages}. Processors are those of whole processes."
        + (f" Not measured: {'; '.join(failed)}." if failed else ""),
        tuple(figures),
    )


class _Stop:
    """Ends what is being measured when a signal comes.

    Attributes:
        called: one has come.
    """

    def __init__(self) -> None:
        self.called = False
        self._cancel: Callable[[], object] = lambda: None

    def __call__(self) -> None:
        self.called = True
        self._cancel()

    async def ending(self, work: Coroutine[Any, Any, list[Figure]]) -> list[Figure]:
        """Do it, until it is done or a signal cancels it."""
        task, loop = asyncio.ensure_future(work), asyncio.get_running_loop()
        self._cancel = lambda: loop.call_soon_threadsafe(task.cancel)
        try:
            return await task
        finally:
            self._cancel = lambda: None


def _named(plan: Plan, key: str) -> Callable[[str], None]:
    return lambda text: plan.say(f"console {key}: {text}")


def _marked(key: str, figures: list[Figure]) -> list[Figure]:
    return [replace(one, name=f"{key.upper()} {one.name}") for one in figures]
