"""Reports: what is told of runs out of folders, what is missing, and what cannot be read."""

import csv
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from batch_example import LIMIT, batch, example, failed, run, write
from small_world import ROOMS, small, text_map

from usarsim_exploration.reporting import pictures
from usarsim_exploration.reporting import report as writing
from usarsim_exploration.reporting.comparison import GOALS, Comparison, compare
from usarsim_exploration.reporting.runs import read
from usarsim_exploration.reporting.tables import runs_csv
from usarsim_server import cli
from usarsim_server.base.toml import toml_text

FILES = ("report.html", "report.md", "table.csv", "runs.csv", "table.tex")
NAMES = ("frontier", "ratio", "$_<&")


def few(seeds: int = 5) -> dict[str, Any]:
    """Three strategies in one setting, one of them without success; one run failed."""
    runs = [run(name, seed) for name in NAMES for seed in range(seeds)]
    return batch(*runs, failed("ratio", 99))


def report(*folders: Path, out: Path) -> int:
    """Call the command."""
    return cli.main(["explore", "report", *map(str, folders), "--out", str(out)])


def rows(path: Path) -> list[dict[str, str]]:
    """Of a CSV file."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def compared(folder: Path, content: dict[str, Any]) -> Comparison:
    """What a batch says."""
    return compare(read([write(folder / "batch", content)]))


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report of `few`."""
    folder = tmp_path_factory.mktemp("told")
    assert report(write(folder / "batch", few()), out=folder / "report") == 0
    return folder / "report"


def test_the_same_bytes_again(told: Path, tmp_path: Path) -> None:
    """EXP-20: regenerating is byte-identical, wherever the folder lies."""
    assert report(write(tmp_path / "batch", few()), out=tmp_path / "again") == 0
    assert sorted(path.name for path in told.iterdir()) == sorted(FILES)
    for name in FILES:
        assert (told / name).read_bytes() == (tmp_path / "again" / name).read_bytes(), name


def test_one_page_without_network(told: Path) -> None:
    """EXP-20: curves, goals, boxes, ranks; nothing is loaded, and names do no harm."""
    text = (told / "report.html").read_text()
    assert text.count("<svg") == 3 + 2
    assert not re.search(r"<script|<link|<img|@import|src=|url\((?!#)", text)
    assert set(re.findall(r'href="([^"]?)', text)) <= {"#"}
    found = re.findall(r'\bid="([^"]+)"', text)
    assert len(found) == len(set(found))
    assert "<b>broken" not in text
    assert "$_&lt;&amp;" in text
    assert "nan" not in re.findall(r">([^<>]*)<", text)
    assert text.count("critical difference") == 2
    text = (told / "report.md").read_text()
    assert r"ValueError: \<b>broken\</b> in line 3" in text
    assert re.search(r"^\| Base area under the curve \| [A-Z][^|]* \|$", text, re.M)  # no unit


def test_curves_are_means_with_bands(tmp_path: Path) -> None:
    """EXP-20: a band of each strategy in either panel, around a mean that keeps its last value."""
    found = compared(tmp_path, few())
    group = found.groups[0]
    assert group.horizon == LIMIT
    svg = pictures.curves("a", group, pictures.Look(found.strategies))
    assert len(re.findall(r'id="a-(?:FillBetween)?Poly[^"]*"', svg)) == 2 * len(NAMES)
    one = next(run for run in group.runs["frontier"] if run.curves)
    assert one.curves is not None
    assert one.curves.steps[-1] // 5 == -(-one.step // 5) < LIMIT // 5


def test_mean_deviation_and_rows(told: Path) -> None:
    """E-76: mean, standard deviation, a row for each run; a failed run is listed and counts not."""
    each = rows(told / "runs.csv")
    assert len(each) == 3 * 5 + 1
    assert [one["error"] for one in each if one["error"]] == ["ValueError: <b>broken</b> in line 3"]
    table = {(one["strategy"], one["measure"]): one for one in rows(told / "table.csv")}
    mine = [float(one["base_area"]) for one in each if one["strategy"] == "frontier"]
    cell = table["frontier", "base_area"]
    assert float(cell["mean"]) == pytest.approx(np.mean(mine))
    assert float(cell["sd"]) == pytest.approx(np.std(mine, ddof=1))
    assert float(cell["interval_low"]) < np.mean(mine) < float(cell["interval_high"])
    assert (cell["runs"], cell["with_value"], cell["horizon"]) == ("5", "5", "")
    assert table["ratio", "base_t90"]["runs"] == "5"


def test_missing_is_never_zero(told: Path) -> None:
    """What no run has is left out, what some lack is empty."""
    assert {one["overlap"] for one in rows(told / "runs.csv")} == {""}
    measures = {one["measure"] for one in rows(told / "table.csv")}
    assert "overlap" not in measures
    never = [one for one in rows(told / "table.csv") if one["with_value"] == "0"]
    assert {(one["strategy"], one["measure"]) for one in never} >= {("$_<&", "base_t95")}
    for one in never:
        assert {one[key] for key in ("mean", "interval_low", "sd", "median")} == {""}


def test_runs_without_a_time_are_censored(tmp_path: Path) -> None:
    """EXP-12: stopped at 40, a run says no more than that; lost at 40, that it never would."""
    content = batch(*(run(name, seed) for name in ("frontier", "ratio") for seed in range(4)))
    for place, time in enumerate((100, None, 200, 300)):
        one = content["runs"][place]
        one["measures"]["team_t90"] = time
        one["ended"] = {"reason": "base knows", "step": time or 40}
    group = compared(tmp_path, content).groups[0]
    stopped = group.cells["team_t90", "frontier"]
    # of three at risk after step 40: 2/3 until 200, 1/3 until 300
    assert stopped.mean == pytest.approx((100 + 200 + 300) / 3)
    assert (stopped.reached, stopped.runs, stopped.sd, stopped.low) == (3, 4, None, None)
    assert group.rankings["team_t90"].pairs[0].ties == 1
    content["runs"][1]["ended"] = {"reason": "all lost", "step": 40}
    group = compared(tmp_path, content).groups[0]
    lost = group.cells["team_t90", "frontier"]
    assert lost.mean == pytest.approx((100 + 200 + 300 + LIMIT) / 4)
    assert group.rankings["team_t90"].pairs[0].ties == 0


def test_settings_are_compared_apart(tmp_path: Path) -> None:
    """Each setting has its own values; ranks are over all of them and over seeds in them."""
    found = compared(tmp_path, example())
    assert [str(one.setting) for one in found.groups] == [
        "maze, 4 robots, circle", "office, 2 robots, circle", "office, 4 robots, circle",
    ]  # fmt: skip
    assert found.by_seed["base_t90"].blocks == 3 * 10 - 1
    assert found.by_setting["base_t90"].blocks == 3
    assert list(found.by_seed["base_t90"].ranks)[-1] == "$_<&"
    slow, fast = (one.cells["team_t90", "ratio"].mean for one in found.groups[::2])
    assert slow is not None
    assert fast is not None
    assert slow > fast


def test_many_settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond so many settings there are numbers without pictures; a table has all of them."""
    monkeypatch.setattr(writing, "PICTURED", 0)
    monkeypatch.setattr(writing, "LISTED", 100)
    assert report(write(tmp_path / "batch", example()), out=tmp_path / "out") == 0
    text = (tmp_path / "out" / "report.md").read_text()
    assert "Pictures are of the first 0 settings, numbers of all." in text
    assert (tmp_path / "out" / "report.html").read_text().count("<svg") == 4
    assert "119 runs are too many for a page: see runs.csv." in text
    table = text[text.index("| Base 90 %, mean steps |") :].splitlines()
    assert table[2].startswith("| maze, 4 robots, circle | – (0 of 10) |")
    assert "(8 of 9)" in table[4]
    assert "Base 90 %: mean ranks over 3 settings, by mean times; 1 is best." in text


def test_single_runs_beside_a_batch(tmp_path: Path) -> None:
    """Folders of `explore run` are runs as others; their curves are those of the data log."""
    small(tmp_path)
    for name in ("frontier", "nearest"):
        arguments = ["explore", "run", str(tmp_path / "small.toml"), "--strategy", name]
        assert cli.main([*arguments, "--out", str(tmp_path / name)]) == 0
    folders = tmp_path / "frontier", tmp_path / "nearest", write(tmp_path / "batch", few(1))
    together = compare(read(folders))
    assert [str(one.setting) for one in together.groups] == [
        "office, 4 robots, circle", "rooms, 2 robots, circle",
    ]  # fmt: skip
    assert [one.partition(",")[0] for one in runs_csv(together).splitlines()[1:3]] == [
        "frontier", "nearest",
    ]  # fmt: skip
    facts = json.loads((tmp_path / "frontier" / "run.json").read_text())
    found = compare(read([tmp_path / "frontier"]))
    one = found.groups[0].runs["frontier"][0]
    assert one.curves is not None
    assert 100 * one.curves.base[-1] == pytest.approx(facts["measures"]["base_percent_reachable"])
    assert len(one.curves.steps) == facts["ended"]["step"] + 1
    assert [one.measures[goal] for goal in GOALS] == [facts["measures"][goal] for goal in GOALS]
    assert found.by_seed == {}


def test_other_scenarios_are_no_setting(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Runs that differ in more than strategy and seed are not compared under one name."""
    small(tmp_path)
    for name, speed in (("frontier", "2.0"), ("nearest", "3.0")):
        arguments = ["explore", "run", str(tmp_path / "small.toml"), "--strategy", name]
        arguments += ["--set", f"team.speed={speed}", "--out", str(tmp_path / name)]
        assert cli.main(arguments) == 0
    capsys.readouterr()
    assert report(tmp_path / "frontier", tmp_path / "nearest", out=tmp_path / "out") == 2
    assert "is not the same scenario as in" in capsys.readouterr().err


def bench(folder: Path, strategy: str, **team: object) -> Path:
    """Results of `explore bench` in the small world."""
    (folder / "rooms.txt").write_text(text_map(ROOMS))
    content: dict[str, object] = {
        "environments": ["rooms.txt"],
        "teams": [{"label": "slow", "robots": 2, "speed": 1.0}],
        "radios": ["circle"],
        "seeds": 3,
        "team": {"base": "drawn", "reach": 8} | team,
        "end": {"steps": 6},
    }
    (folder / "batch.toml").write_text(toml_text(content))
    arguments = ["explore", "bench", str(folder / "batch.toml"), "--strategy", strategy]
    assert cli.main([*arguments, "--jobs", "1", "--out", str(folder / strategy)]) == 0
    return folder / strategy


@pytest.mark.slow
def test_batches_of_bench(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """E-76, EXP-20: real results of two batches together, unless their scenarios differ."""
    folders = bench(tmp_path, "frontier"), bench(tmp_path, "ratio")
    found = compare(read(folders))
    assert [str(one.setting) for one in found.groups] == ["rooms.txt, slow (2 robots), circle"]
    assert {name: len(runs) for name, runs in found.groups[0].runs.items()} == {
        "frontier": 3,
        "ratio": 3,
    }
    assert found.groups[0].horizon == 6
    assert found.by_seed["base_t90"].blocks == 3
    for run_ in found.groups[0].runs["ratio"]:
        assert run_.curves is not None
        assert 100 * run_.curves.team[-1] == pytest.approx(
            run_.measures["team_percent_reachable"], abs=1e-3
        )
        assert run_.spent
        assert run_.spent > 0
    other = bench(tmp_path, "greedy", radio=5.0)
    capsys.readouterr()
    assert report(folders[0], other, out=tmp_path / "out") == 2
    assert "circle is not the same scenario as in" in capsys.readouterr().err


def changed(**keys: object) -> dict[str, Any]:
    """A batch whose second run has other keys."""
    return batch(run("ratio", 1), run("ratio", 2) | keys)


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (None, "holds neither run.json nor result.json (name a folder"),
        ("{", "is no JSON"),
        ("[]", "is no table of JSON"),
        ({"format": "other/1"}, "format: 'other/1' is not 'usarsim-explore-batch/1'"),
        (batch(), "runs: there is none"),
        (changed(seed=1), "office, 4 robots, circle, ratio, seed 1: is also in"),
        (changed(seed="x"), "[[runs]] 2: seed: 'x' is not a whole number"),
        (changed(measures={"team_t90": "soon"}), "measures: team_t90: 'soon' is no number"),
        (changed(ended={"reason": "tired", "step": 3}), "reason: 'tired' is not known"),
        (
            changed(curves={"steps": [0, 5], "team": [0.1, 2], "base": [0, 0]}),
            "curves: team: is no list of 2 parts from 0 to 1",
        ),
        (
            changed(curves={"steps": [5, 0], "team": [0, 1], "base": [0, 1]}),
            "curves: steps: is no list of rising steps",
        ),
        (batch() | {"batch": {"end": {"steps": "x"}}}, "steps: 'x' is not a whole number"),
    ],
)
def test_bad_input_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: object, text: str
) -> None:
    """One line with file, place and cure, exit code 2, and nothing is written."""
    folder = tmp_path / "batch"
    folder.mkdir()
    if content is not None:
        data = content if isinstance(content, str) else json.dumps(content)
        (folder / "result.json").write_text(data)
    assert report(folder, out=tmp_path / "out") == 2
    error = capsys.readouterr().err
    assert text in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_no_folder_and_both_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A folder that is not there, or that holds a run and a batch."""
    assert report(tmp_path / "nowhere", out=tmp_path / "out") == 2
    assert "is no folder" in capsys.readouterr().err
    (write(tmp_path / "batch", few(1)) / "run.json").write_text("{}")
    assert report(tmp_path / "batch", out=tmp_path / "out") == 2
    assert "holds both run.json and result.json" in capsys.readouterr().err


def test_latex(told: Path) -> None:
    """EXP-20: as many columns in each line, names escaped, runs that got there counted."""
    text = (told / "table.tex").read_text()
    lines = [line for line in text.splitlines() if line.endswith(r"\\") and "multi" not in line]
    assert {line.replace(r"\&", "").count("&") for line in lines} == {7}
    assert r"\$\_<\&" in text
    assert "-- (0/5)" in text
