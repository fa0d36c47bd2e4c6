"""What holds for all tests: none of them decides what the next one may log, worlds of this
process share what is dear to make and never changes, and those that draw their examples draw the
same ones every time, for as long as they need.

`HYPOTHESIS_PROFILE=explore` draws twice as many, and new ones each time.
"""

from __future__ import annotations

import asyncio
import gc
import inspect
import logging
import os
from collections import Counter
from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, settings
from sharing import shared_parts

from usarsim_server.base.logs import ROOT

PATIENT = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("explore", PATIENT)
settings.register_profile("same", PATIENT, derandomize=True, max_examples=50)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))

SLOW_ADVICE = "Slow tests were left out; `make test-all` runs them too."


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
    """Leave out the other lane."""
    chosen = lane(config)
    if chosen != "all":
        parts: dict[bool, list[pytest.Item]] = {True: [], False: []}
        for item in items:
            parts[item.get_closest_marker("slow") is not None].append(item)
        config.hook.pytest_deselected(items=parts[chosen == "fast"])
        items[:] = parts[chosen == "slow"]


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
