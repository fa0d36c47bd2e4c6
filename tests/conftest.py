"""What holds for all tests: none of them decides what the next one may log, worlds of this
process share what is dear to make and never changes, and those that draw their examples draw the
same ones every time, for as long as they need; the files that take longest begin first.

`HYPOTHESIS_PROFILE=explore` draws new examples instead.
"""

from __future__ import annotations

import asyncio
import gc
import inspect
import logging
import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from sharing import shared_parts

from usarsim_server.base.logs import ROOT

PATIENT = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("explore", PATIENT)
settings.register_profile("same", PATIENT, derandomize=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))

DEAR = (
    *("test_fidelity_trials.py", "test_conformance_faults.py", "test_e2e_lockstep.py"),
    *("test_benchmarks.py", "test_operator_gateway.py", "test_golden_lines.py"),
    *("test_conformance_own_server.py", "test_mission_replay.py", "test_e2e_process.py"),
    *("test_operator_lockstep.py", "test_robots_all_of_them.py", "test_e2e_garage.py"),
    *("test_e2e_images.py", "test_e2e_limits.py", "test_conformance_planted.py"),
    *("test_study_trials.py", "test_operator_others.py", "test_howtos.py"),
    *("test_study_report.py", "test_robots_checklist_lines.py", "test_e2e_legacy_clients.py"),
    *("test_e2e_chaos.py", "test_maps_felt.py", "test_walls.py", "test_services_budget.py"),
    *("test_e2e_cameras.py", "test_e2e_connection.py", "test_e2e_checks_robots.py"),
    *("test_study_crowd.py", "test_mission_match.py", "test_mission_batch.py"),
    *("test_maps_outside.py", "test_e2e_checks_protocol.py", "test_e2e_bad_input.py"),
    *("test_e2e_hostile.py", "test_study_file.py", "test_mission_growth.py"),
    *("test_study_session.py", "test_operator_scenarios.py"),
)
"""Files that take most of the processor, dearest first: none may be left for the end."""


SLOW_ADVICE = "Slow tests were left out; `make test-all` runs them too."

BROWSER = ("test_console_", "test_demo", "test_page", "test_share_page")
"""How files begin that open pages in Chromium."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Choose between the tests for every commit and the slow ones."""
    parser.addoption(
        "--lane",
        choices=("fast", "slow", "all"),
        help="fast: without tests marked slow (the default, but for tests named with ::); slow: "
        "only these; all",
    )


def lane(config: pytest.Config) -> str:
    """Which tests are run: `fast`, `slow` or `all`."""
    named = any("::" in argument for argument in config.args)
    chosen: str | None = config.getoption("--lane")
    return chosen or ("all" if named or config.option.markexpr else "fast")


def pytest_configure(config: pytest.Config) -> None:
    """Workers get files in the order of the collection, not those with most tests first."""
    if hasattr(config.option, "loadscopereorder"):
        config.option.loadscopereorder = False


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Each worker takes files; all that need a browser are one to it, for a second browser beside
    the first would only make both slow."""
    from xdist.scheduler import LoadFileScheduling

    class Files(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = super()._split_scope(nodeid)
            return "browser" if Path(file).name.startswith(BROWSER) else file

    return Files(config, log)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Keep the garbage collector off some million objects that stay to the end."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out the other lane, and bring dear files to the front, those with a browser first of
    all."""
    chosen = lane(config)
    if chosen != "all":
        parts: dict[bool, list[pytest.Item]] = {True: [], False: []}
        for item in items:
            parts[item.get_closest_marker("slow") is not None].append(item)
        config.hook.pytest_deselected(items=parts[chosen == "fast"])
        items[:] = parts[chosen == "slow"]
    places = {name: place for place, name in enumerate(DEAR)}
    places |= {one.path.name: -1 for one in items if one.path.name.startswith(BROWSER)}
    items.sort(key=lambda item: places.get(item.path.name, len(DEAR)))


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run a test that is a coroutine function on an event loop of its own."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    names = inspect.signature(pyfuncitem.obj).parameters
    asyncio.run(pyfuncitem.obj(**{name: pyfuncitem.funcargs[name] for name in names}))
    return True


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say once for each reason how many tests were left out for it."""
    skipped = terminalreporter.stats.get("skipped", ())
    reasons = Counter(str(one.longrepr[2]) for one in skipped if isinstance(one.longrepr, tuple))
    for reason, count in sorted(reasons.items()):
        terminalreporter.write_line(f"SKIPPED [{count}] {reason.removeprefix('Skipped: ')}")
    if lane(terminalreporter.config) == "fast":
        terminalreporter.write_line(SLOW_ADVICE)


@pytest.fixture(scope="session", autouse=True)
def _worlds_share_parts() -> Iterator[None]:
    with shared_parts():
        yield


@pytest.fixture(scope="session", autouse=True)
def _nobody_waits_for_the_disk() -> Iterator[None]:
    """What is written here need not outlast a loss of power; files are whole and in place at once
    all the same."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(os, "fsync", lambda descriptor: None)
        yield


@pytest.fixture(autouse=True)
def _logging_as_it_was() -> Iterator[None]:
    """Take back what a test, or a command that it runs, sets up about logging."""
    root, ours = logging.getLogger(), logging.getLogger(ROOT)
    kept = root.level, ours.level, ours.propagate, list(root.handlers)
    yield
    root.setLevel(kept[0])
    ours.setLevel(kept[1])
    ours.propagate = kept[2]
    for handler in [one for one in root.handlers if one not in kept[3]]:
        root.removeHandler(handler)
