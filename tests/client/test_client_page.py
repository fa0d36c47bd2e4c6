"""The page and the example about the client work as written, but for the ports."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from unittest.mock import patch

import pytest

import usarsim_client
from usarsim_server.testing import PATIENCE, running_server

ROOT = Path(__file__).parents[2]
PROGRAMS = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "client.md").read_text(), re.S)


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    """A server for all programs of the page."""
    with running_server(world="arena", speed=4.0) as (_, endpoints):
        yield endpoints["control"].port


@pytest.mark.parametrize("program", PROGRAMS, ids=range(len(PROGRAMS)))
def test_programs_of_the_page(program: str, port: int, capsys: pytest.CaptureFixture[str]) -> None:
    def elsewhere(how: str, *_: object) -> object:
        return partial(getattr(usarsim_client, how), port=port, timeout=PATIENCE)

    async_way, waiting = elsewhere("connect"), elsewhere("connect_blocking")
    with (
        patch("usarsim_client.connect", lambda *_: async_way()),  # type: ignore[operator]
        patch("usarsim_client.connect_blocking", lambda *_: waiting()),  # type: ignore[operator]
    ):
        exec(compile(program, "docs/client.md", "exec"), {"__name__": "page"})
    assert capsys.readouterr().out


def test_example_wanders(port: int) -> None:
    """It prints a line for each scan, with places that differ."""
    options = ("--port", str(port), "--start", "RobotStart2", "--seconds", "3")
    done = subprocess.run(
        [sys.executable, ROOT / "examples" / "wander.py", *options],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) > 10
    assert lines[0].partition("x")[2] != lines[-1].partition("x")[2]
