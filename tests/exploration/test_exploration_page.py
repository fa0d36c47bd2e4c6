"""The page of a run over HTTP: the same pictures as files, while the run goes on."""

from __future__ import annotations

import asyncio
import json
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("aiohttp")

import aiohttp
from small_world import small

from usarsim_exploration import run_folder
from usarsim_exploration.commands import run as run_command
from usarsim_exploration.running import run
from usarsim_exploration.showing.overlays import OVERLAYS
from usarsim_exploration.showing.page import Page, served
from usarsim_exploration.showing.tape import tape_of
from usarsim_server import cli


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Of a run of nine steps."""
    run_folder.write(run(small(tmp_path, "end.steps=9", "end.base=off")), tmp_path / "out", {})
    return tmp_path / "out"


def test_pictures_are_those_of_files(folder: Path) -> None:
    """E-78: byte by byte what `show --out` writes; of any step, robot and overlays."""

    async def look() -> None:
        tape = tape_of(folder)
        async with served(Page(tape)) as address, aiohttp.ClientSession(address) as http:
            news = await (await http.get("/progress")).json()
            assert (news["ended"], len(news["shares"])) == (None, 1)
            assert (await http.get("/picture?step=1")).status == 400
            while tape.advance():
                pass
            news = await (await http.get("/progress?since=4")).json()
            assert (news["ended"], len(news["shares"])) == ("steps", 6)
            told = await (await http.get("/run")).json()
            assert [one["name"] for one in told["overlays"]] == list(OVERLAYS)
            usual = {one["name"] for one in told["overlays"] if one["default"]}
            for step, robot, options in ((9, "", []), (3, "R2", ["--robot=R2"]), (5, "", [])):
                overlays = usual | {"trail"} if step == 5 else usual
                more = ["--overlays=trail"] if step == 5 else []
                out = folder / f"{step}.png"
                place = ["explore", "show", str(folder), f"--step={step}", "--out", str(out)]
                assert await asyncio.to_thread(cli.main, [*place, *options, *more]) == 0
                query = {"step": str(step), "overlays": ",".join(overlays), "robot": robot}
                answer = await http.get("/picture", params=query)
                assert answer.headers["Content-Type"] == "image/png"
                assert await answer.read() == out.read_bytes()
            figures = await (await http.get("/figures?step=9")).json()
            assert [one["name"] for one in figures] == told["names"] == ["Base", "R1", "R2"]

    asyncio.run(look())


def test_bad_requests(folder: Path) -> None:
    """Who asks for nonsense is told so; who is from elsewhere gets nothing."""

    async def look() -> None:
        async with served(Page(tape_of(folder))) as address, aiohttp.ClientSession(address) as http:
            for path, told in (
                ("/picture?step=-1", "step must be a whole number"),
                ("/picture?step=1e3", "step must be a whole number"),
                ("/picture?overlays=dragons", "there is no overlay 'dragons'"),
                ("/picture?robot=R9", "there is no robot 'R9'"),
                ("/figures?step=99", "step 99 has not come"),
                ("/progress?since=x", "since must be a whole number"),
            ):
                answer = await http.get(path)
                assert (answer.status, await answer.text()) == (400, told)
            for headers in ({"Host": "evil.example"}, {"Origin": "http://evil.example"}):
                assert (await http.get("/picture", headers=headers)).status == 403
            assert (await http.get("/../pyproject.toml")).status == 404

    asyncio.run(look())


def test_a_run_that_is_shown(tmp_path: Path) -> None:
    """`run --show` serves while it runs, writes its folder, and goes on serving until Ctrl-C."""
    small(tmp_path, "end.steps=9")
    command = [sys.executable, "-m", "usarsim_server", "explore", "run", "small.toml", "--show"]
    with subprocess.Popen(
        [*command, "--set", "end.steps=9", "--out", "out"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        try:
            word, address = process.stdout.readline().split()
            assert word == "SHOW"
            assert "steps after 9 steps" in process.stdout.readline()
            with urllib.request.urlopen(f"{address}progress") as answer:
                told: dict[str, Any] = json.load(answer)
            assert (told["ended"], len(told["shares"])) == ("steps", 10)
            assert (tmp_path / "out" / "run.json").is_file()
            process.send_signal(signal.SIGINT)
            assert process.wait() == 0
        finally:
            process.kill()


def test_without_pages_there_are_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without the extra, `run --show` writes pictures and a film beside the results."""
    monkeypatch.setattr(run_command, "can_serve", lambda: False)
    small(tmp_path)
    options = ["explore", "run", str(tmp_path / "small.toml"), "--show", "--set", "end.steps=3"]
    assert cli.main(options) == 2
    assert "give --out" in capsys.readouterr().err
    out = tmp_path / "out"
    assert cli.main([*options, "--out", str(out)]) == 0
    assert {one.name for one in (out / "pictures").iterdir()} == {
        f"step-{step:06}.png" for step in range(4)
    }
    assert (out / "film.mp4").stat().st_size > 1000
    assert (out / "run.json").is_file()
