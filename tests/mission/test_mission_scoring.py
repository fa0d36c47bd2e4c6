"""Scoring files: worked numbers of the presets (O-51), what is refused and where (O-52)."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from usarsim_mission.errors import ScoringError
from usarsim_mission.scoring import (
    VARIABLES,
    Points,
    Rules,
    ZoneRule,
    find_rules,
    presets,
    read_rules,
)

NOTHING = {**dict.fromkeys(VARIABLES, 0.0), "V": 10.0, "N": 1.0}


def preset(name: str) -> Rules:
    return find_rules(name)[1]


@pytest.mark.parametrize(
    ("name", "values", "points"),
    [
        ("rsarsim", {"VF": 5, "VC": 3}, 3.0),
        ("usarsim-scorekeeper", {"V": 10, "VF": 5, "T": 480 / 1200, "N": 1}, 45.0),
        ("usarsim-scorekeeper", {"V": 10, "VF": 5, "T": 480 / 1200, "N": 2}, 11.25),
        (
            "robocup-2006",
            {"ID": 6, "ST": 4, "LO": 5, "M": 0.6, "A": 0.7, "C": 2, "B": 0, "N": 1},
            51.25,
        ),
        (
            "usar-mj-1",
            {"VC": 5, "V": 10, "A": 0.7, "M": 0.6, "T": 0.4, "C": 1, "FM": 1, "L": 0},
            46.0,
        ),
    ],
)
def test_worked_numbers_of_the_presets(name: str, values: dict[str, float], points: float) -> None:
    """O-51, to the last digit."""
    assert preset(name).score({**NOTHING, **values}) == points


def test_the_presets_are_what_their_sources_say() -> None:
    assert set(presets()) == {"rsarsim", "usarsim-scorekeeper", "robocup-2006", "usar-mj-1"}
    for name in presets():
        assert preset(name).name == name
    keeper = preset("usarsim-scorekeeper").victims
    assert (keeper.credit, keeper.radius, keeper.sticky) == ("proximity", 10.0, False)
    assert keeper.pairs
    assert preset("rsarsim").zones.of("yellow") == ZoneRule(("autonomous",))
    assert preset("rsarsim").zones.of("red").open
    assert preset("rsarsim").zones.of("blue").transition
    assert preset("rsarsim").zones.of(None).open


def test_giving_up_at_once_is_worth_nothing_in_ours() -> None:
    assert preset("usar-mj-1").score({**NOTHING, "T": 1.0}) == 0.0
    assert preset("usarsim-scorekeeper").score({**NOTHING, "T": 1.0}) == 50.0


def write(folder: Path, text: str, name: str = "scoring.toml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


HEAD = 'schema = "usar-score/1"\nname = "mine"\n'


def test_without_total_points_are_added_and_penalties_taken(tmp_path: Path) -> None:
    text = HEAD + (
        "[victims]\npoints = { found = 10, id = 1, status = 2, location = 3 }\nfalse_mark = 4\n"
        "[area]\npoints_full = 50\n[map]\npoints_full = 20\n[time]\npoints_full = 100\n"
        "[penalties]\nvictim_contact = 5\nrobot_loss = 30\ncollision = 0.5\n"
        '[operators]\nrule = "divide_n2"\n'
    )
    rules = read_rules(write(tmp_path, text))
    assert rules.victims.points == Points(10.0, 1.0, 2.0, 3.0)
    values = {
        **NOTHING,
        "VC": 4,
        "ID": 3,
        "ST": 2,
        "LO": 1,
        "FM": 2,
        "A": 0.5,
        "M": 0.25,
        "T": 0.1,
        "C": 2,
        "L": 1,
        "K": 4,
        "B": 7,
        "N": 2,
    }
    plain = 40 + 3 + 4 + 3 - 8 + 25 + 5 + 10 - 10 - 30 - 2 + 7
    assert rules.score(values) == plain / 4.0
    other = read_rules(write(tmp_path, text.replace("divide_n2", "divide_1n2")))
    assert other.score({**values, "N": 1}) == plain / 4.0
    none = read_rules(write(tmp_path, text.replace("divide_n2", "none")))
    assert none.score(values) == plain


@pytest.mark.parametrize(
    ("text", "line", "problem"),
    [
        (HEAD + "victms = 3\n", 3, "victms: unknown key (did you mean victims?"),
        (HEAD + "\n[victims]\nradios = 3\n", 5, "did you mean radius?"),
        (HEAD + "[zones]\ngreen = { modes = [] }\n", 4, "green: unknown key"),
        (HEAD + '[zones.yellow]\nmodes = ["automatic"]\n', 4, "'automatic' is not known"),
        (HEAD + "[zones.yellow]\nmodes = []\n", 4, "is not a list of modes"),
        (HEAD + '[zones.yellow]\nelse = "half"\n', 4, "'half' is not known"),
        (HEAD + "[victims]\nradius = 0\n", 4, "out of range (write a number greater than 0"),
        (HEAD + "[victims]\ndwell = 'long'\n", 4, "is not a number"),
        (HEAD + "[victims]\nhalf_angle = nan\n", 4, "is not a finite number"),
        (HEAD + '[victims]\ncredit = "sight"\n', 4, "one of mark, proximity, view"),
        (HEAD + "[map]\nperfect = 0.5\n", 4, "is not below 0.5"),
        (HEAD + "[operators]\ncount = 0\n", 4, "out of range"),
        (HEAD + 'total = "VC + VX"\n', 3, "column 6: unknown variable VX (did you mean"),
        (HEAD + 'total = "VC / (1 - 1)"\n', 3, "column 4: division by zero"),
        (HEAD + 'total = "VC / VF"\n', 3, "column 4: division by zero"),
        (HEAD + 'total = "1 + total"\n', 3, "column 5: total stands in itself"),
        (HEAD + f'total = "{"(" * 60}1{")" * 60}"\n', 3, "nested too deeply"),
        (HEAD + 'total = "VC +"\n', 3, "column 5: a value is missing"),
        (HEAD + 'total = "VC"\n[penalties]\ncollision = 1\n', 5, "does not count beside total"),
        (HEAD + 'total = "VC"\n[victims.points]\nid = 1\n', 4, "does not count beside total"),
        ('schema = "usar-score/2"\nname = "x"\n', 1, "usar-score/2"),
    ],
)
def test_what_cannot_be_is_refused_with_its_line(
    tmp_path: Path, text: str, line: int, problem: str
) -> None:
    """O-52."""
    path = write(tmp_path, text)
    with pytest.raises(ScoringError) as refusal:
        read_rules(path)
    assert str(refusal.value).startswith(f"{path}: line {line}: ")
    assert problem in str(refusal.value)


def test_a_file_without_schema_or_name_is_refused(tmp_path: Path) -> None:
    for text, key in (('name = "x"\n', "schema"), ('schema = "usar-score/1"\n', "name")):
        with pytest.raises(ScoringError, match=f"{key}: is missing"):
            read_rules(write(tmp_path, text))


def test_yaml_and_json_say_the_same(tmp_path: Path) -> None:
    text = (
        "schema: usar-score/1\nname: mine\ntime_limit: 600\n"
        "victims:\n  credit: view\n  points: {found: 2}\n"
        "zones:\n  yellow: {modes: [autonomous], else: no_points}\n"
    )
    rules = read_rules(write(tmp_path, text, "a.yaml"))
    assert (rules.time_limit, rules.victims.credit, rules.victims.points.found) == (600, "view", 2)
    assert rules == read_rules(write(tmp_path, json.dumps(yaml.safe_load(text)), "a.json"))


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("schema: usar-score/1\nname: x\nvictims:\n  radios: 3\n", "line 4: [victims]: radios"),
        ("schema: usar-score/1\nname: x\nname: y\n", "line 3: name is given twice"),
        ("schema: usar-score/1\nname: x\nzones: &a [*a]\n", "line 3: an anchor or alias"),
        ("schema: usar-score/1\nname: [x\n", "is not valid YAML"),
        ("schema: usar-score/1\nname: x\n? [a]\n: 3\n", "line 3: a key that is no word"),
        ("schema: usar-score/1\nname: !!python/name:os.system x\n", "is not valid YAML"),
        ("- 3\n", "is no table"),
        ("", "schema: is missing"),
        ("schema: usar-score/1\nname: x\ntotal: VX\n", "line 3: total: column 1: unknown"),
        ("a: " + "[" * 100 + "]" * 100, "nested too deeply"),
        ("a: 2026-99-99\n", "is not valid YAML"),
    ],
)
def test_bad_yaml_is_refused_with_its_line(tmp_path: Path, text: str, problem: str) -> None:
    """O-52."""
    with pytest.raises(ScoringError) as refusal:
        read_rules(write(tmp_path, text, "a.yml"))
    assert problem in str(refusal.value)


def test_a_world_without_victims_is_refused_where_the_total_divides_by_them() -> None:
    with pytest.raises(ScoringError, match=r"division by zero.* with 0 victims"):
        preset("usar-mj-1").check(0)
    preset("usar-mj-1").check(1)
    preset("rsarsim").check(0)


def test_presets_and_files_are_found_by_name_or_path(tmp_path: Path) -> None:
    write(tmp_path, HEAD)
    path, rules = find_rules("scoring.toml", tmp_path)
    assert (path, rules.name) == (tmp_path / "scoring.toml", "mine")
    with pytest.raises(ScoringError, match="did you mean 'rsarsim'"):
        find_rules("rsarsm")
    with pytest.raises(ScoringError, match="cannot be read"):
        find_rules("nowhere.toml", tmp_path)


def test_the_example_of_the_page_is_read(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "missions.md").read_text()
    example = page.partition("## Scoring")[2].partition("```toml\n")[2].partition("```")[0]
    rules = read_rules(write(tmp_path, example))
    assert rules.zones.red.factor == 1.5
    assert rules.score({**NOTHING, "VC": 3, "C": 1}) == 25.0


def test_a_total_counts_on_the_range_of_each_variable() -> None:
    """By these ranges a total is refused that may divide by zero or has no finite value."""
    many, share = (0.0, 1e6), (0.0, 1.0)
    assert {name: limits for name, (limits, _) in VARIABLES.items()} == {
        **dict.fromkeys(("VF", "ID", "ST", "LO", "FM", "C", "K", "L"), many),
        **dict.fromkeys(("A", "M", "T"), share),
        "V": (1.0, 1e6),
        "VC": (0.0, 1e8),
        "B": (-1e9, 1e9),
        "N": (1.0, 1e3),
    }


@pytest.mark.parametrize(("rule", "divisor"), [("none", 1), ("divide_n2", 9), ("divide_1n2", 16)])
def test_parts_of_a_score_add_up_to_it(tmp_path: Path, rule: str, divisor: int) -> None:
    """Each part is divided as the whole is."""
    text = HEAD + f'[victims]\npoints = {{ found = 7, id = 2 }}\n[operators]\nrule = "{rule}"\n'
    rules = read_rules(write(tmp_path, text))
    values = {**NOTHING, "VC": 2.0, "ID": 3.0, "B": -1.0, "N": 3.0}
    parts = [(names, one) for names, one in rules.made_of(values) if one]
    assert parts == [
        (frozenset({"VC"}), pytest.approx(14 / divisor)),
        (frozenset({"ID"}), pytest.approx(6 / divisor)),
        (frozenset({"B"}), pytest.approx(-1 / divisor)),
    ]
    assert rules.score(values) == pytest.approx(sum(one for _, one in parts))
