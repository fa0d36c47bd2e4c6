"""What a check can find, and how a check function says so: by returning or by raising."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Verdict(Enum):
    """What a check found."""

    PASS = "pass"
    FAIL = "fail"
    NOT_APPLICABLE = "not applicable"
    INCONCLUSIVE = "inconclusive"


class Severity(Enum):
    """How bad it is to break a rule.

    MUST: clients in the field stop working. SHOULD: some clients suffer, or the original's
    behaviour differs for no good reason. INFORMATIVE: worth knowing, no fault.
    """

    MUST = "must"
    SHOULD = "should"
    INFORMATIVE = "informative"


class Failed(Exception):  # noqa: N818  (a verdict, as the next two)
    """The rule is broken; the text says what was seen and what was expected."""


class NotApplicable(Exception):  # noqa: N818
    """The rule says nothing about this server; the text says why."""


class Inconclusive(Exception):  # noqa: N818
    """The rule could not be judged; the text says what stood in the way."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """The verdict of one check in one dialect.

    Attributes:
        check: identifier of the check.
        dialect: that the server was asked to speak; empty for checks to which it does not matter.
        verdict: what was found.
        reason: what was seen, for every verdict but a pass.
        seconds: of wall time that the check took.
        transcript: what was sent and received, shortened; kept for every verdict but a pass.
    """

    check: str
    dialect: str
    verdict: Verdict
    reason: str = ""
    seconds: float = 0.0
    transcript: tuple[str, ...] = ()
