"""`usarsim demo` as its users start it, and what it records."""

from __future__ import annotations

import asyncio
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import psutil
import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

pytest.importorskip("aiohttp")

from console_browser import CHROMIUM, opened

from usarsim_operator import demo, packets, serving
from usarsim_operator.recording import Packet, Recording, Text
from usarsim_server.base.errors import UsarsimError
from usarsim_server.cli import build_parser
from usarsim_server.testing import PATIENCE

USARSIM = [sys.executable, "-m", "usarsim_server"]


@contextmanager
def running(*words: str) -> Iterator[tuple[subprocess.Popen[str], dict[str, str]]]:
    """A demo that is ready, and its URL for each role."""
    command = [*USARSIM, *(words or ("demo",)), "--no-browser", "--console-port=0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        urls: dict[str, str] = {}
        while len(urls) < 3:
            line = process.stdout.readline()
            found = re.fullmatch(r"CONSOLE (http://127\.0\.0\.1:\d+/#\S+) (\w+)\n", line)
            assert found is not None, line + process.communicate()[1]
            urls[found[2]] = found[1]
        yield process, urls
    finally:
        process.kill()
        process.communicate()


def children(process: subprocess.Popen[str]) -> list[psutil.Process]:
    return psutil.Process(process.pid).children()


def gone(processes: list[psutil.Process]) -> bool:
    """Whether processes end; zombies of ours have ended."""
    _, alive = psutil.wait_procs(processes, PATIENCE)
    return all(one.status() == psutil.STATUS_ZOMBIE for one in alive)


async def drive_a_metre(url: str) -> None:
    """Hold W until the robot has gone a metre; needs a picture first."""
    port, token = re.findall(r":(\d+)/#(\S+)", url)[0]
    async with opened(int(port), token, viewport={"width": 900, "height": 600}) as page:
        await page.wait_for_selector('[data-tile="R1"][data-stale="false"]')
        # The page's Content-Security-Policy forbids `wait_for_function`.
        await until(page, "window.usarsim.store.selected === 'R1'")
        place = "window.usarsim.store.robots.find(r => r.name === 'R1').pose.slice(0, 2)"
        start = await page.evaluate(place)
        await page.keyboard.down("w")
        await until(page, f"Math.hypot(...{place}.map((p, i) => p - {start}[i])) >= 1")
        await page.keyboard.up("w")


async def until(page: Any, true: str) -> None:
    async with asyncio.timeout(PATIENCE):
        while not await page.evaluate(true):
            await page.wait_for_timeout(100)


def entries(path: Path) -> tuple[list[dict[str, Any]], list[Packet]]:
    found = list(Recording(path))
    texts = [dict(one.fields) for one in found if isinstance(one, Text)]
    return texts, [one for one in found if isinstance(one, Packet)]


def test_a_metre_by_key_in_the_demo_and_its_recording(page_folder: Path, tmp_path: Path) -> None:
    """CON-01, O-29: the first picture comes, W drives a metre, and all of it is recorded."""
    if CHROMIUM is None:
        pytest.skip("no chromium on PATH: the demo is not tried in a browser")
    file = tmp_path / "session.rec"
    with running("console", "--demo", f"--record={file}") as (process, urls):
        asyncio.run(drive_a_metre(urls["operator"]))
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0
    texts, binary = entries(file)
    kinds = {one["type"] for one in texts}
    assert {"scene", "kind", "present", "state", "event", "input", "note"} <= kinds
    assert {packets.PICTURE, packets.POSES, packets.SCAN} <= {one.kind for one in binary}
    drives = [one for one in texts if one["type"] == "input" and one["text"]["type"] == "drive"]
    assert drives[0]["text"]["left"] > 0.0 == drives[-1]["text"]["left"]
    pings = [one for one in texts if one["type"] == "input" and "clock" in one["text"]]
    assert all(one["time"] >= 0.0 and one["gateway_clock"] > 0.0 for one in pings)
    assert urls["operator"].partition("#")[2].encode() not in file.read_bytes()
    film = tmp_path / "r1.mp4"
    words = (str(file), f"--out={film}", "--view=follow:R1", "--fps=2", "--size=160x90")
    done = subprocess.run([*USARSIM, "film", *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    video, frames = cv2.VideoCapture(str(film)), []
    while (read := video.read())[0]:
        frames.append(np.asarray(read[1], float))
    assert len(frames) > 4  # a metre takes 2.4 s
    assert min(float(np.std(frame)) for frame in frames) > 10.0
    assert np.abs(frames[-1] - frames[0]).mean() > 2.0  # it has driven


@pytest.mark.usefixtures("page_folder")
class TestEnds:
    def test_interrupt_ends_all_programs(self) -> None:
        """Ctrl-C: exit code 0, not a word, nothing is left."""
        with running("demo", "--world=empty", "--robots=0") as (process, _):
            programs = children(process)
            assert len(programs) == 2
            process.send_signal(signal.SIGINT)
            assert process.wait(PATIENCE) == 0
            assert process.stderr is not None
            assert process.stderr.read() == ""
        assert gone(programs)

    @pytest.mark.slow
    def test_a_program_that_dies_ends_the_demo(self) -> None:
        """With exit code 2 and what it said last."""
        with running("demo", "--world=empty", "--robots=0") as (process, _):
            programs = children(process)
            server = next(one for one in programs if "serve" in one.cmdline())
            server.kill()
            assert process.wait(PATIENCE) == 2
            assert process.stderr is not None
            said = process.stderr.read()
        assert "error: the server has ended (by SIGKILL)\n  READY " in said
        assert "Traceback" not in said
        assert gone(programs)

    @pytest.mark.slow
    def test_killed_demo_leaves_nothing(self) -> None:
        """SIGKILL cannot be caught; the programs end all the same."""
        with running("demo", "--world=empty", "--robots=0") as (process, _):
            programs = children(process)
            process.kill()
        assert gone(programs)


def test_a_world_that_is_none(page_folder: Path) -> None:
    """The server's own error, exit code 2."""
    command = [*USARSIM, "demo", "--no-browser", "--world=atlantis"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "error: the server has ended (exit code 2)\n" in done.stderr
    assert "atlantis" in done.stderr


def test_missing_page_is_one_error(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """With the cure."""
    monkeypatch.setattr(serving, "PAGE", tmp_path)
    with pytest.raises(UsarsimError, match=r"not built .cure: make console"):
        demo.run(arguments())


def test_missing_extra_is_one_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the cure."""
    monkeypatch.setitem(sys.modules, "aiohttp", None)
    with pytest.raises(UsarsimError, match=r'pip install "usarsim-server\[console\]"'):
        demo.run(arguments())


def closure(extra: str = "") -> set[str]:
    """Names of the distributions that the server needs with an extra."""
    found: set[str] = set()
    waiting = [Requirement(f"usarsim-server[{extra}]" if extra else "usarsim-server")]
    while waiting:
        wanted = waiting.pop()
        name = canonicalize_name(wanted.name)
        if name in found:
            continue
        found.add(name)
        for text in metadata.requires(wanted.name) or ():
            one = Requirement(text)
            cases = ({"extra": each} for each in (*wanted.extras, ""))
            if one.marker is None or any(map(one.marker.evaluate, cases)):
                waiting.append(one)
    return found


def test_the_extra_is_small() -> None:
    """CON-02: at most 12 further distributions, 20 MB."""
    added = closure("console") - closure()
    assert "aiohttp" in added
    assert len(added) <= 12, added
    size = 0
    for name in added:
        files = metadata.files(name) or ()
        size += sum(
            Path(str(file.locate())).stat().st_size
            for file in files
            if Path(str(file.locate())).is_file()
        )
    assert size <= 20e6


def test_a_recording_is_not_written_over(tmp_path: Path) -> None:
    """Told before anything is started."""
    old = tmp_path / "old.rec"
    old.write_text("precious")
    with pytest.raises(UsarsimError, match=r"old\.rec exists already"):
        demo.run(arguments(f"--record={old}"))
    assert old.read_text() == "precious"


def arguments(*words: str) -> Any:
    return build_parser(["demo"]).parse_args(["demo", *words])
