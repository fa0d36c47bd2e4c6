"""Study files: what is right is read, what is wrong is refused with line, reason and cure."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

import pytest
from example import STUDY
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server import cli
from usarsim_study.errors import StudyError
from usarsim_study.layouts import look, mission_file
from usarsim_study.lines import line_of
from usarsim_study.study_file import Study, alike, find_study, read_study


def read(tmp_path: Path, text: str = STUDY) -> Study:
    """A study from its text."""
    path = tmp_path / "study.toml"
    path.write_text(text, encoding="utf-8")
    return read_study(path)


def test_a_study(tmp_path: Path) -> None:
    """One TOML says everything (HRI-01)."""
    study = read(tmp_path)
    assert [one.title for one in study.condition] == ["Keyboard", "Gamepad"]
    assert len(study.orders) == 4
    assert study.training is not None
    assert study.training.contacts == 2
    before, after_trial, after = (study.forms(one) for one in ("before", "after_trial", "after"))
    assert [item.name for item in before[0].items] == ["games", "hand"]
    assert before[0].items[1].choices == (("left", "Left"), ("right", "Right"))
    assert after_trial[0].kind == "nasa-tlx"
    assert after[0].items[0].choices == (("keyboard", "Keyboard"), ("gamepad", "Gamepad"))


def test_a_blind_preference_names_no_condition(tmp_path: Path) -> None:
    """What participants read are labels of the moment (HRI-05)."""
    form = read(tmp_path).forms("after", ("the first", "the second"))[0]
    shown = [text for _, text in form.items[0].choices]
    assert shown == ["the first", "the second"]


SEQUENCES = '[[sequence]]\ntrials = ["{}", "{}"]\n[[sequence]]\ntrials = ["{}", "{}"]\n'

WRONG = {
    "unknown key": ("seed = 7", "seed = 7\nsead = 7", "line 3: sead: unknown key", "did you mean"),
    "unknown key of a condition": (
        'label = "Gamepad"',
        'lable = "Gamepad"',
        "line 14: [[condition]] 2 (gamepad): lable",
        "label",
    ),
    "unknown key of an item": (
        'text = "Left"',
        'text = "Left"\ncolour = 1',
        "line 50: [[form]] 1 (before): [[item]] 2 (hand): [[choice]] 1 (left): colour",
        "known keys",
    ),
    "unknown policy": (
        'device = "gamepad"',
        'device = "gamepad"\nunattended = "serch"',
        "line 16: [[condition]] 2 (gamepad): unattended: 'serch'",
        "did you mean 'search'",
    ),
    "unknown measure": ('"tlx_raw"', '"tlx_row"', "line 5: secondary: 'tlx_row'", "'tlx_raw'"),
    "measure twice": ('"tlx_raw"', '"victims_credited"', "line 5", "once"),
    "path": ("path_length = 62.0", "path_length = 67.0", "line 26: [[layout]] 2 (B)", "by 10 %"),
    "occlusion": ("occlusion = 0.41", "occlusion = 0.6", "line 27", "by 33 %"),
    "path of one": ("path_length = 60.0\n", "", "line 17: [[layout]] 1 (A): path_length", "every"),
    "participants": ("participants = 8", "participants = 10", "line 3", "write 8 or 12"),
    "one condition": (
        '[[condition]]\nname = "gamepad"\nlabel = "Gamepad"\ndevice = "gamepad"\n',
        "",
        "condition: 1 given",
        "at least 2",
    ),
    "same names": ('name = "B"', 'name = "A"', "line 24: [[layout]] 2 (A): name", "its own"),
    "too few layouts": (
        "[training]",
        '[[condition]]\nname = "third"\n[training]',
        "line 18: [[layout]] 1",
        "at least 3",
    ),
    "preference after each": (
        'when = "after"\n',
        'when = "after_trial"\n',
        "line 63: [[form]] 3 (which): when",
        "after",
    ),
    "items of no questionnaire": (
        'kind = "questionnaire"',
        'kind = "sus"',
        "line 34: [[form]] 1 (before): kind",
        "remove",
    ),
    "unbalanced positions": (
        "[training]",
        SEQUENCES.format("keyboard A", "gamepad B", "keyboard B", "gamepad A") + "[training]",
        "line 30: [[sequence]] 1: trials: unbalanced: as trial 1",
        "equally",
    ),
    "unbalanced layouts": (
        "[training]",
        SEQUENCES.format("keyboard A", "gamepad B", "gamepad B", "keyboard A") + "[training]",
        "line 30: [[sequence]] 1: trials: unbalanced: conditions do not meet layouts",
        "equally",
    ),
    "unknown condition": (
        "[training]",
        SEQUENCES.format("keyboard A", "gamepat B", "gamepad B", "keyboard A") + "[training]",
        "line 30: [[sequence]] 1: trials: 'gamepat'",
        "gamepad",
    ),
    "four probes": (
        "[[probe]]",
        '[[probe]]\nat = 1\nquestion = "moving"\n' * 3 + "[[probe]]",
        "line 75: [[probe]] 4: at",
        "at most 3",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_refused_with_line_reason_and_cure(tmp_path: Path, case: str) -> None:
    """Unknown keys, unequal layouts, unbalanced orders and the rest (HRI-01)."""
    old, new, place, cure = WRONG[case]
    assert old in STUDY
    with pytest.raises(StudyError) as caught:
        read(tmp_path, STUDY.replace(old, new, 1))
    message = str(caught.value)
    assert place in message
    assert cure in message.rpartition(place)[2]


def test_command_says_the_plan(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`usarsim study check` prints orders; a wrong file is exit code 2 and one line (HRI-01)."""
    path = tmp_path / "study.toml"
    path.write_text(STUDY)
    assert cli.main(["study", "check", "--without-missions", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "keyboard A  gamepad B" in out
    path.write_text(STUDY.replace("seed = 7", "sead = 7"))
    assert cli.main(["study", "check", str(path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(("name", "sequences"), [("rsarsim", 4), ("scaling", 18)])
def test_shipped_studies(name: str, sequences: int, capsys: pytest.CaptureFixture[str]) -> None:
    """Both pass check, with their missions (HRI-02)."""
    assert len(read_study(find_study(name)).orders) == sequences
    assert cli.main(["study", "check", name]) == 0
    assert "mean way" in capsys.readouterr().out


def test_unknown_study(capsys: pytest.CaptureFixture[str]) -> None:
    """Names those that there are."""
    assert cli.main(["study", "check", "rsarsin"]) == 2
    assert "rsarsim" in capsys.readouterr().err


def with_shipped_missions(seed: int, other: int) -> str:
    """The study with two layouts of the shipped mission, by their seeds."""
    text = STUDY.replace('[training]\nmission = "slalom.toml"\n', "")
    for name, number in (("a", seed), ("b", other)):
        text = text.replace(f'"office-{name}.toml"', f'"rsarsim"\nseed = {number}')
    return re.sub(r"(path_length|occlusion) = .*\n", "", text)


class TestMissions:
    """What a study says is looked at in its missions, too (HRI-01)."""

    def test_unreachable_victim(self, tmp_path: Path) -> None:
        """A victim outside of all rooms is refused, with the line of the layout."""
        shipped = mission_file("rsarsim", tmp_path).read_text(encoding="utf-8")
        place = 'name = "MaleVictim_0"\nposition = [500.0, 500.0, 0.0]'
        (tmp_path / "office-b.toml").write_text(shipped.replace('name = "MaleVictim_0"', place))
        text = with_shipped_missions(1, 1).replace('"rsarsim"\nseed = 1', '"office-b.toml"')
        with pytest.raises(StudyError, match=r"line 19: \[\[layout\]\] 1 \(A\): mission") as caught:
            look(read(tmp_path, text), tmp_path / "study.toml")
        assert "MaleVictim_0" in str(caught.value)

    def test_unequal_ways(self, tmp_path: Path) -> None:
        """Layouts whose victims are differently far away are refused, others are shown."""
        ways: dict[int, float] = {}
        for seed in (1, 3):
            text = with_shipped_missions(seed, seed)
            places = look(read(tmp_path, text), tmp_path / "study.toml")
            assert {one.mission for one in places} == {"rsarsim"}
            ways[seed] = places[0].mean_way
        near, far = min(ways, key=ways.__getitem__), max(ways, key=ways.__getitem__)
        assert not alike(ways[near], ways[far])
        text = with_shipped_missions(near, far)
        with pytest.raises(StudyError, match=r"\[\[layout\]\] 2 \(B\): mission: victims are"):
            look(read(tmp_path, text), tmp_path / "study.toml")

    def test_unknown_mission(self, tmp_path: Path) -> None:
        """Has a line and a cure."""
        with pytest.raises(StudyError, match=r"line 19: \[\[layout\]\] 1 \(A\): mission"):
            look(read(tmp_path), tmp_path / "study.toml")


@given(
    st.integers(0, len(STUDY)), st.integers(0, 40), st.text(alphabet="ab[]=\"'.1\n {}", max_size=8)
)
def test_any_damage_is_one_error(at: int, length: int, text: str) -> None:
    """Whatever is cut out of a file or written into it: a study, or an error for users."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            study = read(Path(folder), STUDY[:at] + text + STUDY[at + length :])
        except StudyError:
            return
        assert study.participants % len(study.orders) == 0


def test_lines() -> None:
    """Places of errors have lines, where they are written as tables."""
    assert line_of(STUDY, "seed") == 2
    assert (
        line_of(STUDY, "[[form]] 1 (before): [[item]] 2 (hand): [[choice]] 2 (right): text") == 53
    )
    assert line_of(STUDY, "[training]: mission") == 30
    assert line_of(STUDY, "[[form]] 9: name") is None
    assert line_of(STUDY, "absent") is None


def test_the_example_of_the_page(tmp_path: Path) -> None:
    """The study file of docs/studies.md is a study."""
    page = (Path(__file__).parents[2] / "docs" / "studies.md").read_text(encoding="utf-8")
    example = page.partition("```toml\n")[2].partition("```")[0]
    study = read(tmp_path, example)
    assert len(study.orders) == 4
    one, other = look(study, tmp_path / "study.toml")
    assert alike(*sorted((one.mean_way, other.mean_way)))
