"""`usarsim bench` measures a real server with tiny parameters; no figure is judged here."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from usarsim_bench import capacity
from usarsim_server.cli import main


@pytest.mark.slow
def test_all_three_are_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (("SETTLE", 1.0), ("PRESENT", 2), ("NEWCOMERS", 1)):
        monkeypatch.setattr(capacity, name, value)
    file = tmp_path / "report.json"
    words = ["--robots", "2", "--seconds", "5", "--world", "empty", "--json", str(file)]
    assert main(["bench", *words]) == 0
    sections = json.loads(file.read_text())["sections"]
    assert [one["key"] for one in sections] == ["robots", "cameras", "inits"]
    figures = {one["name"]: one for section in sections for one in section["figures"]}
    assert all(math.isfinite(one["value"]) for one in figures.values())
    assert figures["2 watched: pictures of a camera, fewest"]["value"] > 0
    assert figures["2 INITs at once: all served after"]["aim"] == "< 3"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["hostile"], "no measurement 'hostile' (known: robots, cameras, inits; measurements for"),
        (["robots", "--world", "no-such-world", "--seconds", "1"], "robots (reasons above)"),
    ],
)
def test_mistakes_are_one_error(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", *words]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("words", [["--robots", "0"], ["--robots", "x"], ["--seconds", "0"]])
def test_numbers_out_of_range_are_refused(words: list[str]) -> None:
    with pytest.raises(SystemExit):
        main(["bench", *words])
