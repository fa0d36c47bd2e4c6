"""Forms: what they take, what they score, that half of one survives."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_study.errors import StudyError
from usarsim_study.forms import Form, FormState, Item
from usarsim_study.instruments import nasa_tlx, nasa_tlx_weighted, preference, sart, sus

RATINGS = {
    "mental": 70,
    "physical": 10,
    "temporal": 55,
    "performance": 40,
    "effort": 65,
    "frustration": 30,
}


def filled(form: Form, answers: dict[str, float]) -> FormState:
    """A form with some answers, a second each."""
    state = FormState(form)
    for number, (name, value) in enumerate(answers.items()):
        state.answer(name, value, number + 1.0)
    return state


class TestTlx:
    """NASA-TLX (O-42, HRI-06)."""

    def test_raw(self) -> None:
        """270 over six scales is 45 (HRI-06)."""
        assert filled(nasa_tlx("tlx"), RATINGS).scores()["tlx_raw"] == 45.0

    def test_weighted_by_hand(self) -> None:
        """Weights 5, 0, 3, 2, 4, 1: (350 + 0 + 165 + 80 + 260 + 30) / 15 = 59 (HRI-06)."""
        rank = ["mental", "effort", "temporal", "performance", "frustration", "physical"]
        form = nasa_tlx_weighted("tlx")
        state = filled(form, RATINGS)
        assert state.scores()["tlx_weighted"] is None
        for item in form.items[6:]:
            state.answer(item.name, min((name for name, _ in item.choices), key=rank.index), 30.0)
        assert len(form.items) == 21
        assert state.scores()["tlx_weighted"] == 59.0
        assert state.scores()["tlx_raw"] == 45.0

    @pytest.mark.parametrize("value", [-5, 3, 101, 105, 52.5, True, "50", float("nan")])
    def test_only_multiples_of_five(self, value: float) -> None:
        """From 0 to 100 (O-42)."""
        with pytest.raises(StudyError, match="form tlx: mental"):
            FormState(nasa_tlx("tlx")).answer("mental", value, 1.0)

    def test_missing_blocks_and_is_missing(self) -> None:
        """Neither the next page nor a score can be had without an answer (O-42, HRI-11)."""
        form = nasa_tlx_weighted("tlx")
        state = filled(form, {name: one for name, one in RATINGS.items() if name != "effort"})
        assert state.missing(1) == ("effort",)
        assert state.page == 1
        with pytest.raises(StudyError, match="not answered: effort"):
            state.hand_in()
        scores = state.scores()
        assert scores["tlx_raw"] is None
        assert scores["tlx_effort"] is None
        assert scores["tlx_mental"] == 70.0
        state.answer("effort", 0, 9.0)
        assert state.missing(1) == ()
        assert state.page == 2
        assert state.scores()["tlx_effort"] == 0.0


class TestOthers:
    """SUS, SART, preference (HRI-06)."""

    @pytest.mark.parametrize(("odd", "even", "score"), [(3, 3, 50.0), (5, 1, 100.0), (1, 5, 0.0)])
    def test_sus(self, odd: int, even: int, score: float) -> None:
        """All 3: 50; best: 100; worst: 0 (HRI-06)."""
        answers = {f"sus_{n}": odd if n % 2 else even for n in range(1, 11)}
        assert filled(sus("sus"), answers).scores() == {"sus": score}

    def test_sus_without_an_answer(self) -> None:
        """Missing, not 0 (HRI-11)."""
        answers = {f"sus_{n}": 3 for n in range(1, 10)}
        assert filled(sus("sus"), answers).scores() == {"sus": None}

    def test_sart(self) -> None:
        """Demand 3+4+5, supply 6+5+4+3, understanding 5+6+7: 18 - (12 - 18) = 24."""
        names = [item.name for item in sart("sart").items]
        given_ = dict(zip(names, (3, 4, 5, 6, 5, 4, 3, 5, 6, 7), strict=True))
        scores = filled(sart("sart"), given_).scores()
        assert scores == {
            "sart": 24.0,
            "sart_demand": 12.0,
            "sart_supply": 18.0,
            "sart_understanding": 18.0,
        }
        del given_["arousal"]
        scores = filled(sart("sart"), given_).scores()
        assert (scores["sart"], scores["sart_demand"]) == (None, 12.0)

    def test_preference_is_forced(self) -> None:
        """One of the conditions, and how strongly."""
        state = FormState(preference("which", [("k", "Keyboard"), ("g", "Gamepad")]))
        with pytest.raises(StudyError, match="none of k, g"):
            state.answer("preferred", "both", 1.0)
        state.answer("preferred", "g", 1.0)
        state.answer("strength", 4, 2.0)
        state.hand_in()
        with pytest.raises(StudyError, match="handed in"):
            state.answer("strength", 5, 3.0)


FREE = Form(
    "pre",
    "questionnaire",
    "Before we begin",
    "",
    (
        Item("games", "How often do you play?", low=1.0, high=7.0),
        Item("robots", "Have you driven a robot?", "flag", page=2),
        Item("note", "Anything else?", "text", required=False, page=2),
    ),
)


class TestState:
    """Half a form survives (HRI-07), with its answer times (HRI-06)."""

    def test_survives_json(self) -> None:
        """What was written down is the same state again, and goes on at the right page."""
        state = FormState(FREE)
        state.answer("games", 4, 2.5)
        state.answer("games", 5, 4.0)
        stored = json.loads(json.dumps(state.as_json()))
        again = FormState.from_json(FREE, stored)
        assert again == state
        assert again.times == {"games": 4.0}
        assert again.page == 2
        again.answer("robots", False, 6.0)
        again.hand_in()
        assert FormState.from_json(FREE, again.as_json()).done

    def test_answer_taken_back_is_missing(self) -> None:
        """None takes it back."""
        state = FormState(FREE)
        state.answer("games", 4, 2.5)
        state.answer("games", None, 3.0)
        assert state.missing() == ("games", "robots")

    @given(
        st.recursive(
            st.none() | st.booleans() | st.floats() | st.text(max_size=8),
            lambda one: (
                st.lists(one, max_size=3)
                | st.dictionaries(
                    st.sampled_from(("form", "answers", "times", "done", "games", "note")), one
                )
            ),
            max_leaves=8,
        )
    )
    def test_anything_else_is_one_error(self, stored: object) -> None:
        """A file with other contents is a state or an error for users, nothing else."""
        if isinstance(stored, dict):
            stored = {**stored, "form": "pre"}
        try:
            state = FormState.from_json(FREE, stored)
        except StudyError:
            return
        assert set(state.answers) <= {"games", "robots", "note"}

    def test_description(self) -> None:
        """What a page is told, as JSON (docs/studies.md)."""
        told = json.loads(json.dumps(FREE.description()))
        assert [[one["name"] for one in page] for page in told["pages"]] == [
            ["games"],
            ["robots", "note"],
        ]
        assert told["pages"][0][0] == {
            "name": "games",
            "text": "How often do you play?",
            "kind": "scale",
            "required": True,
            "low": 1.0,
            "high": 7.0,
            "step": 1.0,
            "left": "",
            "right": "",
        }
