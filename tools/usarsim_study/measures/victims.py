"""Victims and marks: what was found, seen, marked, and how soon."""

from __future__ import annotations

from statistics import median

from usarsim_study.measures.base import ANALYSIS, BALAKIRSKY, LEWIS, Part, measure
from usarsim_study.trial import Record, Span, Trial


def _mark_owners(trial: Trial) -> dict[object, str]:
    """Operators by the marks that they set."""
    return {
        one["mark"]: trial.operator(one.get("page")) or _by_name(trial, one.get("by"))
        for one in trial.all("mark_set")
    }


def _by_name(trial: Trial, name: object) -> str:
    return str(name) if name in trial.operators else ""


def _owned(trial: Trial, part: Part, records: list[Record]) -> list[Record]:
    """Records about marks of the operators of a part."""
    if part.whole:
        return records
    owners = _mark_owners(trial)
    return [one for one in records if owners.get(one.get("mark"), "") in part.operators]


def _standing(trial: Trial) -> dict[str, tuple[Record, bool]]:
    """The find of each victim that was found in the end, and whether it is credited.

    The referee tells `found`, then `credit`; a `credit` without a `found` takes the find back.
    """
    found: dict[str, tuple[Record, bool]] = {}
    fresh: set[str] = set()
    for one in trial.of("found", "credit"):
        name = str(one["victim"])
        if one["kind"] == "found":
            fresh.add(name)
            found[name] = one, False
        elif name in fresh:
            fresh.remove(name)
            found[name] = found[name][0], bool(one.get("credited"))
        elif not one.get("credited"):
            found.pop(name, None)
    return found


def _found(trial: Trial, part: Part) -> dict[str, Record]:
    """The finds of a part."""
    standing = [one for one, _ in _standing(trial).values()]
    return {str(one["victim"]): one for one in _owned(trial, part, standing)}


def _marked(trial: Trial, part: Part) -> dict[str, Record]:
    """The first valid mark of each victim, also of those that were taken back."""
    first: dict[str, Record] = {}
    for one in trial.of("found"):
        if one.get("mark") is not None:
            first.setdefault(str(one["victim"]), one)
    return {str(one["victim"]): one for one in _owned(trial, part, list(first.values()))}


@measure(
    "victims_found",
    "Victims found",
    "victims",
    "Victims found at the end, marked validly or met by the rule of credit, whatever the zone rule "
    "says. Of an operator: those found by the operator's own marks.",
    LEWIS,
    by=("operator",),
    adds=True,
    better="more",
    judged=True,
)
def victims_found(trial: Trial, part: Part) -> float | None:
    """Counts victims of `found`."""
    return float(len(_found(trial, part)))


@measure(
    "victims_credited",
    "Victims credited",
    "victims",
    "Victims found at the end of which the zone rule was satisfied, so that they count.",
    LEWIS,
    by=("operator",),
    adds=True,
    better="more",
    judged=True,
)
def victims_credited(trial: Trial, part: Part) -> float | None:
    """Counts victims of `credit`."""
    credited = {name for name, (_, counts) in _standing(trial).items() if counts}
    return float(len(credited & set(_found(trial, part))))


@measure(
    "score",
    "Score",
    "points",
    "Total of the scoring file at the end of the trial.",
    BALAKIRSKY,
    better="more",
)
def score(trial: Trial, part: Part) -> float | None:
    """The last `score`."""
    scores = trial.all("score")
    total = scores[-1].get("total") if scores else trial.score.get("total")
    return None if total is None else float(total)


@measure(
    "marks_valid",
    "Valid marks",
    "marks",
    "Marks within the tolerance of a victim that had no valid mark yet.",
    ANALYSIS,
    by=("operator",),
    adds=True,
    better="more",
    judged=True,
)
def marks_valid(trial: Trial, part: Part) -> float | None:
    """Counts marks of `found`."""
    return float(len(_marked(trial, part)))


@measure(
    "marks_wrong",
    "Wrong marks",
    "marks",
    "Marks set that lay within the tolerance of no victim, deleted ones included.",
    ANALYSIS,
    by=("operator",),
    adds=True,
    better="less",
    judged=True,
)
def marks_wrong(trial: Trial, part: Part) -> float | None:
    """Counts marks of `wrong`."""
    return float(len({one["mark"] for one in _owned(trial, part, trial.of("wrong"))}))


@measure(
    "marks_duplicate",
    "Duplicate marks",
    "marks",
    "Marks within the tolerance of a victim that had a valid mark already.",
    ANALYSIS,
    by=("operator",),
    adds=True,
    better="less",
    judged=True,
)
def marks_duplicate(trial: Trial, part: Part) -> float | None:
    """Counts marks of `duplicate`."""
    return float(len({one["mark"] for one in _owned(trial, part, trial.of("duplicate"))}))


@measure(
    "marks_deleted",
    "Deleted marks",
    "marks",
    "Marks taken back, counted for whoever had set them.",
    ANALYSIS,
    by=("operator",),
    adds=True,
)
def marks_deleted(trial: Trial, part: Part) -> float | None:
    """Counts `mark_delete`."""
    return float(len(_owned(trial, part, trial.of("mark_delete"))))


def _displays(trial: Trial, part: Part) -> list[Span] | None:
    """Displays on the robots of a part; None: nobody logged views."""
    if not any("views" in one for one in trial.of("truth")):
        return None
    return [one for one in trial.displays if one.robot in part.robots]


@measure(
    "victims_seen",
    "Victims seen",
    "victims",
    "Different victims with a display: for more than 2 s a camera showed the victim within 30 "
    "degrees of its axis and nothing hid it.",
    ANALYSIS,
    by=("robot",),
    better="more",
)
def victims_seen(trial: Trial, part: Part) -> float | None:
    """Counts victims of displays."""
    displays = _displays(trial, part)
    return None if displays is None else float(len({one.what for one in displays}))


@measure(
    "display_time",
    "Time with a victim on display",
    "s",
    "Sum of the lengths of all displays, over robots and victims.",
    ANALYSIS,
    by=("robot",),
    adds=True,
)
def display_time(trial: Trial, part: Part) -> float | None:
    """Adds displays up."""
    displays = _displays(trial, part)
    return None if displays is None else sum(one.length for one in displays)


@measure(
    "seen_not_marked",
    "Seen, not marked",
    "victims",
    "Victims with a display that never got a valid mark.",
    ANALYSIS,
    better="less",
    judged=True,
)
def seen_not_marked(trial: Trial, part: Part) -> float | None:
    """Victims of displays less those of marks."""
    displays = _displays(trial, part)
    if displays is None:
        return None
    return float(len({one.what for one in displays} - set(_marked(trial, part))))


@measure(
    "marked_unseen",
    "Marked unseen",
    "victims",
    "Victims marked validly without a display that had begun before the mark.",
    ANALYSIS,
    judged=True,
)
def marked_unseen(trial: Trial, part: Part) -> float | None:
    """Victims of marks less those of displays before them."""
    displays = _displays(trial, part)
    if displays is None:
        return None
    marked = _marked(trial, part)
    return float(
        sum(
            not any(one.what == name and one.begin <= found["t_sim"] for one in displays)
            for name, found in marked.items()
        )
    )


@measure(
    "display_to_mark",
    "Display to mark",
    "s",
    "Median over valid marks: from the beginning of the last display of that victim on the marking "
    "robot (on any robot, if the mark names none) to the mark.",
    ANALYSIS,
    by=("operator",),
    better="less",
)
def display_to_mark(trial: Trial, part: Part) -> float | None:
    """Median of mark less begin."""
    times = display_to_mark_times(trial, part)
    return median(times) if times else None


def display_to_mark_times(trial: Trial, part: Part) -> list[float]:
    """One time per valid mark of a victim that had been displayed, s, in order of the marks."""
    times = []
    for name, found in _marked(trial, part).items():
        begins = [
            one.begin
            for one in trial.displays
            if one.what == name
            and one.begin <= found["t_sim"]
            and found.get("robot") in (None, one.robot)
        ]
        if begins:
            times.append(float(found["t_sim"]) - max(begins))
    return times
