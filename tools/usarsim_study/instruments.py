"""The forms everybody uses: NASA-TLX, SUS, SART, the choice between conditions.

Each function makes a `Form` of a name; `KINDS` has those that need nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations

from usarsim_study.forms import Answers, Form, Item, Scores

_TLX = (
    ("mental", "Mental demand", "How much thinking, deciding, looking and searching was needed?"),
    ("physical", "Physical demand", "How much pushing, turning and pressing was needed?"),
    ("temporal", "Temporal demand", "How hurried was the pace of the task?"),
    ("performance", "Performance", "How well did you do what you were asked to do?"),
    ("effort", "Effort", "How hard did you have to work for it?"),
    ("frustration", "Frustration", "How irritated, stressed or discouraged did you feel?"),
)
_TLX_SOURCE = (
    "S. G. Hart, L. E. Staveland, Development of NASA-TLX, Advances in Psychology 52 (1988) 139-183"
)

_SUS = (
    "I think that I would like to use this system frequently.",
    "I found the system unnecessarily complex.",
    "I thought the system was easy to use.",
    "I think that I would need the support of a technical person to be able to use this system.",
    "I found the various functions in this system were well integrated.",
    "I thought there was too much inconsistency in this system.",
    "I would imagine that most people would learn to use this system very quickly.",
    "I found the system very cumbersome to use.",
    "I felt very confident using the system.",
    "I needed to learn a lot of things before I could get going with this system.",
)
_SUS_SOURCE = (
    "J. Brooke, SUS: a quick and dirty usability scale, in Usability Evaluation in Industry, "
    "Taylor & Francis (1996) 189-194"
)

_SART = (
    ("instability", "How likely was the situation to change suddenly?"),
    ("complexity", "How complicated was the situation?"),
    ("variability", "How many things were changing in it?"),
    ("arousal", "How alert and ready to act were you?"),
    ("concentration", "How much did you concentrate on it?"),
    ("division", "Over how many things was your attention divided?"),
    ("capacity", "How much attention had you left for other things?"),
    ("quantity", "How much information did you get and understand?"),
    ("quality", "How good was that information?"),
    ("familiarity", "How familiar was the situation?"),
)
_SART_SOURCE = (
    "R. M. Taylor, Situational awareness rating technique (SART), in Situational Awareness in "
    "Aerospace Operations, AGARD-CP-478 (1990)"
)


def _numbers(answers: Answers, names: Sequence[str]) -> list[float] | None:
    """Answers as numbers; None if one is missing."""
    found = [answers.get(name) for name in names]
    numbers = [
        float(one) for one in found if isinstance(one, int | float) and not isinstance(one, bool)
    ]
    return numbers if len(numbers) == len(names) else None


def _tlx_items() -> tuple[Item, ...]:
    return tuple(
        Item(
            name,
            f"{title}: {text}",
            step=5.0,
            left="perfect" if name == "performance" else "very low",
            right="failure" if name == "performance" else "very high",
        )
        for name, title, text in _TLX
    )


def _tlx_score(answers: Answers) -> Scores:
    names = [name for name, _, _ in _TLX]
    ratings = _numbers(answers, names)
    scores: Scores = {
        f"tlx_{name}": None if one is None else one[0]
        for name in names
        for one in [_numbers(answers, [name])]
    }
    return scores | {"tlx_raw": None if ratings is None else sum(ratings) / len(ratings)}


def nasa_tlx(name: str) -> Form:
    """Six scales from 0 to 100 in steps of 5; the score is their mean ("raw TLX")."""
    return Form(
        name,
        "nasa-tlx",
        "Workload",
        "Rate the task that you have just done on each scale.",
        _tlx_items(),
        _tlx_score,
        _TLX_SOURCE,
    )


_PAIRS = {
    f"{one}-{other}": (one, other) for one, other in combinations([name for name, _, _ in _TLX], 2)
}


def _weighted_score(answers: Answers) -> Scores:
    scores = _tlx_score(answers)
    names = [name for name, _, _ in _TLX]
    chosen = [answers.get(pair) for pair in _PAIRS]
    ratings = _numbers(answers, names)
    weighted = None
    if ratings is not None and None not in chosen:
        weights = [chosen.count(name) for name in names]
        total = sum(rating * weight for rating, weight in zip(ratings, weights, strict=True))
        weighted = total / len(_PAIRS)
    return scores | {"tlx_weighted": weighted}


def nasa_tlx_weighted(name: str) -> Form:
    """The six scales, and on a second page 15 pairs of them: which one contributed more?

    A scale's weight is how often it was chosen; the score is the weighted sum over 15.
    """
    titles = {key: title for key, title, _ in _TLX}
    pairs = tuple(
        Item(
            pair,
            "Which of the two contributed more to the workload?",
            "choice",
            choices=((one, titles[one]), (other, titles[other])),
            page=2,
        )
        for pair, (one, other) in _PAIRS.items()
    )
    return Form(
        name,
        "nasa-tlx-weighted",
        "Workload",
        "Rate the task that you have just done on each scale.",
        _tlx_items() + pairs,
        _weighted_score,
        _TLX_SOURCE,
    )


def _sus_score(answers: Answers) -> Scores:
    given = _numbers(answers, [f"sus_{number}" for number in range(1, 11)])
    if given is None:
        return {"sus": None}
    good = sum(one - 1.0 for one in given[0::2])
    bad = sum(5.0 - one for one in given[1::2])
    return {"sus": 2.5 * (good + bad)}


def sus(name: str) -> Form:
    """Ten statements from 1 to 5; the score goes from 0 to 100."""
    items = tuple(
        Item(
            f"sus_{number}",
            text,
            low=1.0,
            high=5.0,
            left="strongly disagree",
            right="strongly agree",
        )
        for number, text in enumerate(_SUS, start=1)
    )
    title = "Usability"
    text = "Mark how much you agree with each statement about the system that you have just used."
    return Form(name, "sus", title, text, items, _sus_score, _SUS_SOURCE)


def _sart_score(answers: Answers) -> Scores:
    names = [name for name, _ in _SART]
    parts = {
        "sart_demand": _numbers(answers, names[:3]),
        "sart_supply": _numbers(answers, names[3:7]),
        "sart_understanding": _numbers(answers, names[7:]),
    }
    sums: Scores = {name: None if one is None else sum(one) for name, one in parts.items()}
    demand, supply, understanding = sums.values()
    whole = None
    if demand is not None and supply is not None and understanding is not None:
        whole = understanding - (demand - supply)
    return {"sart": whole, **sums}


def sart(name: str) -> Form:
    """Ten scales from 1 to 7: understanding - (demand - supply), from -14 to 46."""
    items = tuple(
        Item(key, text, low=1.0, high=7.0, left="low", right="high") for key, text in _SART
    )
    text = "Rate the situation that you have just been in."
    return Form(name, "sart", "Situation", text, items, _sart_score, _SART_SOURCE)


def preference(name: str, conditions: Sequence[tuple[str, str]]) -> Form:
    """Which condition is preferred (forced choice), and how strongly, from 1 to 5.

    Args:
        name: of the form.
        conditions: name and what participants call each; in a blind study, `first`, `second`.
    """
    items = (
        Item("preferred", "Which one did you prefer?", "choice", choices=tuple(conditions)),
        Item(
            "strength",
            "How strongly?",
            low=1.0,
            high=5.0,
            left="hardly",
            right="very strongly",
        ),
    )
    return Form(name, "preference", "Preference", "Compare what you have used.", items)


KINDS: dict[str, Callable[[str], Form]] = {
    "nasa-tlx": nasa_tlx,
    "nasa-tlx-weighted": nasa_tlx_weighted,
    "sus": sus,
    "sart": sart,
}
