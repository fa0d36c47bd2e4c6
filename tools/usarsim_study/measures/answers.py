"""What participants said: scores of the forms after a trial, and probes."""

from __future__ import annotations

from collections.abc import Iterable

from usarsim_study import instruments
from usarsim_study.forms import Scores
from usarsim_study.measures.base import OURS, Function, Part, measure
from usarsim_study.trial import Record, Trial

_FORMS = {name: make(name) for name, make in instruments.KINDS.items()}


def latest_forms(records: Iterable[Record]) -> dict[str, Record]:
    """The last record of each form, by its name, for further operators `NAME operator 2`.

    See `FormState.as_json`.
    """
    found = {}
    for one in records:
        if one["kind"] == "form":
            operator = one.get("operator", 1)
            name = str(one.get("form"))
            found[name if operator == 1 else f"{name} operator {operator}"] = one
    return found


def form_scores(records: Iterable[Record]) -> Scores:
    """All scores of the forms of a trial; those that nobody can compute are missing.

    Where two operators filled in the same form it is their mean, and missing if one is.
    """
    by_operator: dict[object, Scores] = {}
    for record in latest_forms(records).values():
        form = _FORMS.get(str(record.get("form_kind")))
        answers = record.get("answers")
        if form is not None and isinstance(answers, dict):
            found = by_operator.setdefault(record.get("operator", 1), {})
            for name, value in form.score(answers).items():
                found[name] = value if value is not None else found.get(name)
    told = list(by_operator.values())
    names = dict.fromkeys(name for one in told for name in one)
    return {name: _mean([one.get(name) for one in told]) for name in names}


def _mean(values: list[float | None]) -> float | None:
    known = [one for one in values if one is not None]
    return sum(known) / len(known) if len(known) == len(values) else None


def _score_of(name: str) -> Function:
    def score(trial: Trial, part: Part) -> float | None:
        return form_scores(trial.all("form")).get(name)

    return score


def _declare(name: str, title: str, definition: str, source: str, better: str) -> None:
    measure(
        name,
        title,
        "points",
        definition,
        source,
        better="more" if better == "more" else "less" if better == "less" else "",
    )(_score_of(name))


_TLX = _FORMS["nasa-tlx"].source
_declare("tlx_raw", "Workload (raw TLX)", "Mean of the six scales, 0 to 100.", _TLX, "less")
_declare(
    "tlx_weighted",
    "Workload (weighted TLX)",
    "Sum of the six scales, each times how often it was chosen in 15 pairs, over 15.",
    _TLX,
    "less",
)
for _item in _FORMS["nasa-tlx"].items:
    _title, _, _ = _item.text.partition(":")
    _declare(f"tlx_{_item.name}", f"TLX: {_title.lower()}", "One scale, 0 to 100.", _TLX, "less")
_declare(
    "sus",
    "Usability (SUS)",
    "Ten items from 1 to 5: 2.5 times the sum of odd items less 1 and 5 less even items.",
    _FORMS["sus"].source,
    "more",
)
_declare(
    "sart",
    "Situation awareness (SART)",
    "Understanding less demand plus supply, of ten items from 1 to 7.",
    _FORMS["sart"].source,
    "more",
)


@measure(
    "probes_right",
    "Probes answered rightly",
    "1",
    "Share of right answers among answered freeze probes.",
    OURS,
    better="more",
)
def probes_right(trial: Trial, part: Part) -> float | None:
    """Right over answered."""
    told = [one["correct"] for one in trial.of("probe") if isinstance(one.get("correct"), bool)]
    return sum(told) / len(told) if told else None
