"""What checks find out: immutable values, without any form."""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

__all__ = ["Checked", "Finding", "Mark", "counted", "problem_and_advice"]


class Mark(enum.Enum):
    """How a thing stands.

    A note is neither good nor bad, for example something optional that is not there. With a warning
    the server runs, but not as well as it could; with a problem it does not start, or not as asked.
    """

    OK = "ok"
    NOTE = "note"
    WARNING = "warning"
    PROBLEM = "problem"


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of the report.

    Attributes:
        subject: what was looked at, a word or two.
        mark: see there.
        text: what was found, and what it means.
        cure: the one command that mends it.
        advice: where no command does, what to do instead.
        values: the same in numbers, for machines; finite, and named with their units.
    """

    subject: str
    mark: Mark
    text: str
    cure: str | None = None
    advice: str | None = None
    values: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Checked:
    """What one check found.

    Attributes:
        key: of the check.
        title: for readers.
        findings: in the order of the report.
    """

    key: str
    title: str
    findings: tuple[Finding, ...]


def counted(sections: Sequence[Checked], mark: Mark) -> int:
    """How many findings carry a mark."""
    return sum(finding.mark is mark for one in sections for finding in one.findings)


def problem_and_advice(message: str) -> tuple[str, str | None]:
    """Split an error meant for users into what is wrong and what is in the brackets at its end.

    The opposite of `errors.at`; a message without brackets at its end has no advice.
    """
    text = " ".join(message.split())
    depth = 0
    for place in reversed(range(len(text) if text.endswith(")") else 0)):
        depth += {")": 1, "(": -1}.get(text[place], 0)
        if depth == 0:
            advice = text[place + 1 : -1].removeprefix("cure: ")
            return text[:place].rstrip(), advice or None
    return text, None
