"""The console's page, built once, and tests that share one stage in a real browser."""

import contextlib
import fcntl
import importlib.util
import inspect
import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]
WEB = ROOT / "tools" / "usarsim_operator" / "web"

Npm = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run a test that has a `stage` on the event loop of that stage."""
    stage = pyfuncitem.funcargs.get("stage")
    if stage is None or not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    names = inspect.signature(pyfuncitem.obj).parameters
    stage.run(pyfuncitem.obj(**{name: pyfuncitem.funcargs[name] for name in names}))
    return True


@pytest.fixture(scope="session")
def builder() -> ModuleType:
    """``hatch_build.py``, whose ``build`` makes the page."""
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@contextlib.contextmanager
def _one_at_a_time(file: Path) -> Iterator[None]:
    with file.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@pytest.fixture(scope="session")
def page_folder(builder: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the built page is; skips where it cannot be built (no node, no registry).

    Of pytest's processes the first one tries; the others take what it found.
    """
    shared = tmp_path_factory.getbasetemp().parent
    failed = shared / f"no-page-{os.environ.get('PYTEST_XDIST_TESTRUNUID', os.getpid())}"
    with _one_at_a_time(shared / "page.lock"):
        if not failed.exists():
            try:
                builder.build()
            except SystemExit as error:
                failed.write_text(str(error).removeprefix("error: "))
    if failed.exists():
        why = failed.read_text()
        if "build.mjs" in why:  # the sources are wrong; anything else is missing here
            pytest.fail(why, pytrace=False)
        pytest.skip(f"the console's page is not built, its tests are left out: {why}")
    return WEB.parent / "page"


@pytest.fixture(scope="session")
def npm(builder: ModuleType, page_folder: Path) -> Npm:
    """Runs npm in the folder of the page; skips where what the page is built with is not there."""
    try:
        program, node = builder.commands()
    except SystemExit as error:
        pytest.skip(str(error))
    if not builder.is_fetched(WEB):
        got = subprocess.run(
            [*program, "ci", "--loglevel=error", "--fetch-retries=1"],
            cwd=WEB,
            env=builder.environment(node),
            check=False,
        )
        if got.returncode:
            pytest.skip("npm's registry is not reached: the page's own tests are left out")

    def run(*arguments: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [*program, *arguments],
            cwd=WEB,
            env=builder.environment(node),
            capture_output=True,
            text=True,
            check=False,
        )

    return run
