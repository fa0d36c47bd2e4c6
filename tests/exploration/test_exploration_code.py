"""Results that a stranger sent run no code, unless the user says so."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from small_world import ROOMS, text_map

from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.scenario import load
from usarsim_server import cli

CODE = """
from dataclasses import dataclass
from pathlib import Path
from usarsim_exploration.strategy import Plan, Strategy, View

Path(__file__).with_name("ran").touch()

@dataclass
class Still(Strategy):
    def decide(self, view: View) -> Plan | None:
        return None
"""
READERS = (
    ["explore", "replay", "RUN"],
    ["explore", "replay", "RUN", "--radio", "circle"],
    ["explore", "show", "RUN", "--out", "x.png"],
    ["explore", "show", "RUN", "--from-log", "--out", "x.png"],
    ["explore", "show", "BATCH/result.json", "--run", "KEY", "--files", "FILES", "--out", "x.png"],
    ["explore", "verify", "BATCH/result.json", "--files", "FILES", "--jobs", "0"],
)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run and a batch with a strategy out of a file, as the user's own commands made them."""
    folder = tmp_path_factory.mktemp("results")
    (folder / "rooms.txt").write_text(text_map(ROOMS))
    (folder / "mine.py").write_text(CODE)
    (folder / "batch.toml").write_text(
        'title = "T"\nenvironments = ["rooms.txt"]\nteams = [1]\nstrategies = ["mine.py:Still"]\n'
        'radios = ["circle"]\nseeds = [1]\n[team]\nbase = [3, 3]\nspeed = 2.0\nreach = 8\n'
        "[end]\nsteps = 3\n"
    )
    (folder / "run.toml").write_text(
        '[environment]\nname = "rooms.txt"\n[team]\nrobots = 1\nbase = [3, 3]\nspeed = 2.0\n'
        'reach = 8\n[strategy]\nname = "mine.py:Still"\n[end]\nsteps = 3\n'
    )
    for words in (
        ["run", str(folder / "run.toml"), "--out", str(folder / "run")],
        ["bench", str(folder / "batch.toml"), "--out", str(folder / "batch"), "--jobs", "0"],
    ):
        assert cli.main(["explore", *words]) == 0
    assert (folder / "ran").exists(), "the user's own commands run it"
    return folder


def filled(words: list[str], results: Path, out: Path) -> list[str]:
    """A command line for these results."""
    batch = results / "batch" / "result.json"
    row = json.loads(batch.read_text())["runs"][0]
    key = f"{row['environment']}/{row['robots']}/{row['strategy']}/{row['radio']}/{row['seed']}"
    places = {
        "RUN": str(results / "run"),
        "BATCH/result.json": str(batch),
        "FILES": str(results),
        "KEY": key,
        "x.png": str(out / "x.png"),
    }
    return [places.get(word, word) for word in words]


def marks(results: Path) -> set[Path]:
    """What the program leaves when it is run."""
    return set(results.rglob("ran"))


@pytest.mark.parametrize("words", READERS, ids=lambda words: " ".join(words[1:3]))
def test_readers_run_no_code(
    words: list[str], results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One error that names the file and the option; with the option it is run."""
    for mark in marks(results):
        mark.unlink()
    command = filled(words, results, tmp_path)
    assert cli.main(command) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "mine.py is a program that came with the results (read it, then let it run by" in told
    assert "--run-code" in told
    assert not marks(results)
    assert cli.main([*command, "--run-code"]) == 0
    assert marks(results)


def test_reports_run_no_code(results: Path, tmp_path: Path) -> None:
    """They need none."""
    for mark in marks(results):
        mark.unlink()
    sources = [str(results / "run"), str(results / "batch")]
    assert cli.main(["explore", "report", *sources, "--out", str(tmp_path / "report")]) == 0
    assert not marks(results)


def test_shipped_strategies_need_no_option(tmp_path: Path) -> None:
    """Only files are programs of somebody else."""
    (tmp_path / "rooms.txt").write_text(text_map(ROOMS))
    sheet = tmp_path / "run.toml"
    sheet.write_text('[environment]\nname = "rooms.txt"\n[team]\nbase = [3, 3]\n')
    assert load(sheet, code=False).strategy_name == "frontier"
    with pytest.raises(ExplorationError, match=r"--run-code"):
        load(sheet, ["strategy.name=mine.py"], code=False)
