"""Files of MRESim: teams, settings, batches."""

import json
import math
from dataclasses import asdict, replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_world import ROOMS, text_map

from usarsim_exploration.mresim.batch import read_batch
from usarsim_exploration.mresim.settings import Settings, read_settings
from usarsim_exploration.mresim.team import read_team
from usarsim_exploration.scenario import load
from usarsim_server import cli
from usarsim_server.base.errors import UsarsimError

TEAM = """\
1 ComStation 388 298 0 0 60 1000 BaseStation 1 0
2 Rex 389 298 1.5707963267948966 20 60 1000 Relay 1 3
3 Ada 387 298 -9.42477796076938 20 60 1000 Explorer 2 0
"""
FRONTIER: dict[str, object] = {"strategy": "FrontierExploration"}
LINES = [
    "FrontierExploration", "UtilReturn", "null", "DirectLine", "false", "/a/log.txt", "true",
    "/a/data.txt", "false", "null", "true", "false", "true", "false", "10", "false", "true",
    "0.75", "true", "false", "true", "null", "true", "225", "true", "false", "true", "true",
]  # fmt: skip


@pytest.fixture
def team(tmp_path: Path) -> Path:
    """Files of a team and of a map that MRESim would put in the middle of 800 x 600."""
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "rooms.txt").write_text(text_map(ROOMS))
    (tmp_path / "maps" / "team").write_text(TEAM)
    return tmp_path / "maps" / "team"


def test_a_team_file(team: Path) -> None:
    """E-08, E-10: 11 fields; speed 10 and 180 degrees are what the file does not say."""
    content = read_team(team)
    assert content["team"] == {"base": [388, 298], "base_radio": 60.0}
    rex, ada = content["robot"]  # type: ignore[misc]
    assert (rex["name"], rex["start"], rex["heading"]) == ("Rex", [389, 298], 90.0)
    assert (rex["role"], rex["parent"], rex["child"]) == ("relay", "Base", "Ada")
    assert (ada["role"], ada["parent"], ada["child"]) == ("explorer", "Rex", "nobody")
    assert abs(ada["heading"]) == 180.0
    assert (ada["speed"], ada["view"], ada["reach"], ada["radio"]) == (10.0, 180.0, 20, 60.0)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("4 Bob 9 9 0 20 60 1000 Explorer 1", "line 4: 10 fields"),
        ("4 Bob 9 9 0 20 60 1000 Explorer 1 0 7", "line 4: 12 fields"),
        ("4 Bob 9 9 0 20 60 1000 Explorr 1 0", "line 4: role 'Explorr' is not known (did you"),
        ("5 Bob 9 9 0 20 60 1000 Explorer 1 0", "line 4: robot 5 stands at place 4"),
        ("4 Bob 9 9 0 20 60 1000 BaseStation 1 0", "line 4: robot 4 is BaseStation"),
        ("4 Bob 9 x 0 20 60 1000 Explorer 1 0", "line 4: y 'x' is no whole number"),
        ("4 Bob 9 9 nan 20 60 1000 Explorer 1 0", "line 4: heading 'nan' is no number"),
    ],
)
def test_wrong_lines_of_teams(team: Path, line: str, told: str) -> None:
    """E-08: file, line and cure."""
    team.write_text(TEAM + line + "\n")
    with pytest.raises(UsarsimError) as caught:
        read_team(team)
    assert f"{team}: {told}" in str(caught.value)


def test_robot_1_is_the_base(team: Path) -> None:
    """E-09."""
    team.write_text(TEAM.replace("BaseStation", "Explorer"))
    with pytest.raises(UsarsimError, match="line 1: robot 1 is Explorer"):
        read_team(team)


@pytest.mark.parametrize("count", [18, 28])
def test_settings(tmp_path: Path, count: int) -> None:
    """E-11: both forms; what is missing at the end is false, 400, 0.9."""
    file = tmp_path / "settings.txt"
    file.write_text("\n".join(LINES[:count]) + "\n")
    found = read_settings(file)
    assert (found.strategy, found.policy, found.radio) == (*LINES[:2], LINES[3])
    assert found.ours == "ratio"
    assert (found.target, found.multi_point, found.rate) == (0.75, True, 10)
    assert found.data_log_file == "/a/data.txt"
    later = {"timestamps", "keep_assigning", "to_range", "relay_explores", "single_meeting_time"}
    assert {key for key, value in asdict(found).items() if key in later and value} == (
        later if count == 28 else set()
    )
    assert found.density == (225.0 if count == 28 else 400.0)
    file.write_text("\n".join(LINES[:17]))
    assert read_settings(file).target == 0.9
    content = found.content
    assert content["radio"] == {"model": "sight", "sum_of_ranges": True}
    assert content["strategy"]["target"] == 0.75  # type: ignore[index]
    assert content["links"] == "before"


@pytest.mark.parametrize(
    ("changed", "kept", "dropped"),
    [
        ({}, {"switch": False}, ""),
        ({"role_switch": True}, {"switch": True}, ""),
        ({"role_switch": True, "strict_role_switch": True}, {"switch": True}, "strict_role_switch"),
        ({"improved_rendezvous": False}, {}, "improved"),
        ({"explorer_replans": True}, {}, "explorer_replans"),
        ({"explorer_replans": True, "multi_point": False}, {}, ""),
        ({"relay_to_explorer": True}, {}, "relay_to_explorer"),
        ({"single_meeting_time": True}, {}, "single_meeting_time"),
        ({"relay_explores": True, "density": 90.0}, {"relay_explores": True, "density": 90.0}, ""),
        (FRONTIER | {"to_range": True}, {}, ""),
        (FRONTIER | {"policy": "UtilReturn", "to_range": True}, {}, "to_range"),
    ],
)  # fmt: skip
def test_options_are_kept_or_told(
    changed: dict[str, object], kept: dict[str, object], dropped: str
) -> None:
    """What a strategy of ours has no key for is named; runs end when all are home, as MRESim's."""
    found = replace(Settings(multi_point=True, improved_rendezvous=True), **changed)  # type: ignore[arg-type]
    strategy = found.content["strategy"]
    assert isinstance(strategy, dict)
    assert kept.items() <= strategy.items()
    assert [one.partition(":")[0] for one in found.dropped] == ([dropped] if dropped else [])
    assert found.content["end"] == {"of": "all", "home": True}


@pytest.mark.parametrize(
    ("number", "text", "told"),
    [
        (1, "Frontier", "line 1, strategy: 'Frontier' is not known (write one of"),
        (7, "maybe", "line 7, data log: 'maybe' is neither true nor false"),
        (18, "much", "line 18, target: 'much' is no number"),
    ],
)
def test_wrong_settings(tmp_path: Path, number: int, text: str, told: str) -> None:
    """Line and cure."""
    lines = LINES.copy()
    lines[number - 1] = text
    (tmp_path / "settings.txt").write_text("\n".join(lines))
    with pytest.raises(UsarsimError) as caught:
        read_settings(tmp_path / "settings.txt")
    assert told in str(caught.value)


def test_import_of_a_team(team: Path, tmp_path: Path) -> None:
    """E-04, E-09: the map is centred, so robots stand in it; a start in a wall is told."""
    out = tmp_path / "out"
    arguments = ["explore", "import", str(team), "--map", str(team.parent / "rooms.txt")]
    assert cli.main([*arguments, "--out", str(out)]) == 0
    scenario = load(out / "scenario.toml")
    assert scenario.world.environment.shape == (600, 800)
    assert [one.cell for one in scenario.team] == [(388, 298), (389, 298), (387, 298)]
    assert scenario.team[1].heading == math.pi / 2
    assert scenario.end.of == "all"
    team.write_text(TEAM.replace("2 Rex 389 298", "2 Rex 385 294"))
    assert cli.main([*arguments, "--out", str(tmp_path / "other")]) == 2
    assert not (tmp_path / "other").exists()
    assert cli.main([*arguments[:3], "--out", str(tmp_path / "other")]) == 2


def batch(**run: str) -> dict[str, object]:
    """Two runs, one of them as given."""
    basic = {"map": "rooms.txt", "conf": "team"}
    greedy = {"strategy": "greedy", "outputDir": "out\\one"}
    ratio = {"strategy": "ratio", "ratio": "0.5", "baseRange": "false", "outputDir": "out\\two"}
    return {
        "globalSettings": {"baseDir": "C:\\thesis\\", "envDir": "maps"},
        "runs": [basic | greedy, basic | ratio | run],
    }


def test_a_batch(team: Path, tmp_path: Path) -> None:
    """E-12, EXP-23: each entry gets settings and logs; separators are those of any system."""
    team.write_text(TEAM.replace(" 60 1000", " 20 1000"))
    file = tmp_path / "batch.json"
    file.write_text(json.dumps(batch()))
    out = tmp_path / "results"
    short = tmp_path / "settings.txt"
    short.write_text("\n".join(LINES))
    arguments = ["explore", "import", str(file), "--settings", str(short), "--out", str(out)]
    assert cli.main(arguments) == 0
    for name, strategy in (("out-one", "frontier"), ("out-two", "ratio")):
        path = out / name / "scenario.toml"
        assert f'name = "{strategy}"' in path.read_text()
        assert 'model = "sight"\nsum_of_ranges = true' in path.read_text()
        run = ["explore", "run", str(path), "--steps", "3", "--out", str(path.parent)]
        assert cli.main(run) == 0
        files = {one.name for one in path.parent.iterdir()}
        assert files >= {"scenario.toml", "steps.csv", "agents.csv", "run.json", "rooms.png"}
    told = json.loads((out / "out-two" / "run.json").read_text())
    assert told["scenario"]["strategy"]["target"] == 0.5


def test_role_based_runs_of_a_batch(
    team: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """E-12: keys of the one kind are needed only there; options that ours has are taken over."""
    options = {"multiPoint": "true", "baseRange": "true", "samplingDensity": "100"}
    options |= {"strategy": "role-based", "relayExplore": "true", "rvcalc": "improved"}
    file = tmp_path / "batch.json"
    file.write_text(json.dumps(batch(**options)))
    with pytest.raises(UsarsimError, match="2: exploreReplan: is missing"):
        read_batch(file, Settings())
    later = dict.fromkeys(
        ("exploreReplan", "tryToGetToExplorerRV", "useSingleMeetingTime"), "false"
    )
    for multi, name in (("true", "multi"), ("false", "single")):
        file.write_text(json.dumps(batch(**options | later | {"multiPoint": multi})))
        _, (_, content) = read_batch(file, Settings())
        strategy = content["strategy"]
        assert isinstance(strategy, dict)
        assert strategy["name"] == f"role-based-{name}-point"
        assert strategy["relay_explores"] is strategy["switch"] is True
        assert strategy.get("density") == (100.0 if multi == "true" else None)
    replans = {"strategy": "role-based", "multiPoint": "true", "exploreReplan": "true"}
    file.write_text(json.dumps(batch(**options | later | replans)))
    assert cli.main(["explore", "import", str(file), "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().err
    assert told.startswith(f"{tmp_path / 'out' / 'out-two'}: dropped explorer_replans: multi-point")


@pytest.mark.parametrize(
    ("run", "told"),
    [
        ({"ratio": None}, "[[runs]] 2: ratio: is missing"),
        ({"map": None}, "[[runs]] 2: map: is missing"),
        ({"strategy": "lazy"}, "[[runs]] 2: strategy: 'lazy' is not known"),
        ({"baseRange": "perhaps"}, "[[runs]] 2: baseRange: 'perhaps' is not"),
        ({"speed": "3"}, "[[runs]] 2: speed: unknown key"),
        ({"outputDir": "out/one"}, "two runs write to 'out-one'"),
    ],
)
def test_wrong_batches(team: Path, tmp_path: Path, run: dict[str, str | None], told: str) -> None:
    """E-12: the run is named."""
    content = batch()
    runs = content["runs"]
    runs[1] = {key: value for key, value in (runs[1] | run).items() if value is not None}  # type: ignore[index,operator]
    (tmp_path / "batch.json").write_text(json.dumps(content))
    with pytest.raises(UsarsimError) as caught:
        read_batch(tmp_path / "batch.json", Settings())
    assert told in str(caught.value)


@settings(max_examples=25, deadline=None)
@given(st.text(max_size=80))
def test_any_text(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    """Files of all three kinds are read, or refused in one line."""
    file = tmp_path_factory.getbasetemp() / "any.txt"
    file.write_text(text)
    for read in (read_team, read_settings, lambda path: read_batch(path, Settings())):
        told = ""
        try:
            read(file)
        except UsarsimError as error:
            told = str(error)
        assert "\n" not in told
