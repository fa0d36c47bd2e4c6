"""The page: its own tests, its build and size."""

import gzip
import hashlib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from lanes import slow_but

pytest.importorskip("aiohttp")

WEB = Path(__file__).parents[2] / "tools" / "usarsim_operator" / "web"


def hashes(folder: Path) -> dict[str, str]:
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.iterdir()}


@pytest.mark.parametrize("script", slow_but({"test"}.__contains__, ["test", "types", "lint"]))
def test_the_page_passes_its_own_tests(npm: Callable[..., Any], script: str) -> None:
    """O-29 to O-32, O-35, O-36, CON-08, CON-18 to CON-20, CON-27: node's test runner; style."""
    done = npm("run", script)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]


def test_two_builds_are_identical_and_small(
    page_folder: Path, builder: ModuleType, npm: Callable[..., Any], tmp_path: Path
) -> None:
    """CON-03, CON-04: byte-identical, at most 300 kB compressed: the pages that go over a network,
    that is all but what `usarsim share` puts into a file, which no gateway's page asks for."""
    assert npm("run", "build", "--", str(tmp_path / "page")).returncode == 0
    assert hashes(page_folder) == hashes(tmp_path / "page")
    assert builder.is_fresh(WEB, page_folder)
    served = [p for p in page_folder.iterdir() if p.stem != "share"]
    size = sum(len(gzip.compress(p.read_bytes())) for p in served)
    assert size <= 300_000
