"""The outcome of a run, and its form as JSON."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Any

from usarsim_conformance.registry import Check, Result, Severity, Verdict
from usarsim_server.protocol.json_text import parse_json

_FORMAT = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """What a report says of a check itself."""

    id: str
    title: str
    rule: str
    source: str
    severity: Severity
    service: str

    @classmethod
    def of(cls, check: Check) -> Rule:
        """The rule of a check."""
        return cls(
            id=check.id,
            title=check.title,
            rule=check.rule,
            source=check.source,
            severity=check.severity,
            service=check.service,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """Everything one run found."""

    name: str  # of the server, for comparisons
    server: Mapping[str, str]  # facts about it, for people
    taken: datetime  # when the run began, UTC
    seconds: float  # of wall time that it took
    dialects: tuple[str, ...]  # that were judged, in order
    rules: tuple[Rule, ...]  # all that were judged, in order
    results: tuple[Result, ...]  # one for each check and dialect, in order
    staged: bool = False
    """The server is ours, in the world of the kit, with the usual robot: all can be judged."""

    def count(self, verdict: Verdict, severity: Severity | None = None) -> int:
        """Number of results with a verdict, of rules of one severity if given."""
        severities = {rule.id: rule.severity for rule in self.rules}
        return sum(
            result.verdict is verdict and severity in (None, severities[result.check])
            for result in self.results
        )

    @property
    def conforms(self) -> bool:
        """Whether no rule that must be kept was found broken.

        A server in the kit's own world must also leave no such rule inconclusive.
        """
        failed = self.count(Verdict.FAIL, Severity.MUST)
        unjudged = self.count(Verdict.INCONCLUSIVE, Severity.MUST) if self.staged else 0
        return failed + unjudged == 0

    @property
    def counts(self) -> Counter[Verdict]:
        """Number of results by verdict."""
        return Counter(result.verdict for result in self.results)

    def of(self, check: str, dialect: str) -> Result | None:
        """The result of a check in a dialect."""
        return next(
            (one for one in self.results if one.check == check and one.dialect == dialect), None
        )

    def rule(self, check: str) -> Rule:
        """The rule of a check."""
        return next(rule for rule in self.rules if rule.id == check)


def as_json(report: Report) -> str:
    """The report as JSON; `from_json` reads it."""
    data = {
        "format": _FORMAT,
        "name": report.name,
        "server": dict(report.server),
        "taken": report.taken.isoformat(),
        "seconds": round(report.seconds, 1),
        "conforms": report.conforms,
        "staged": report.staged,
        "counts": {verdict.value: report.counts[verdict] for verdict in Verdict},
        "dialects": list(report.dialects),
        "rules": [{**asdict(rule), "severity": rule.severity.value} for rule in report.rules],
        "results": [
            {
                **asdict(result),
                "verdict": result.verdict.value,
                "seconds": round(result.seconds, 3),
            }
            for result in report.results
        ],
    }
    return json.dumps(data, indent=1) + "\n"


def from_json(text: str) -> Report:
    """The report that `as_json` wrote.

    Raises:
        ValueError: if it is none; says what is missing.
    """
    try:
        data: dict[str, Any] = parse_json(text)
        if data["format"] != _FORMAT:
            raise ValueError(f"format {data['format']!r}, not {_FORMAT}")
        return Report(
            name=str(data["name"]),
            server={str(key): str(value) for key, value in data["server"].items()},
            taken=datetime.fromisoformat(data["taken"]),
            seconds=float(data["seconds"]),
            dialects=tuple(map(str, data["dialects"])),
            rules=tuple(
                Rule(**{**rule, "severity": Severity(rule["severity"])}) for rule in data["rules"]
            ),
            results=tuple(
                Result(
                    **{
                        **result,
                        "verdict": Verdict(result["verdict"]),
                        "transcript": tuple(result["transcript"]),
                    }
                )
                for result in data["results"]
            ),
            staged=bool(data.get("staged", False)),
        )
    except KeyError as error:
        raise ValueError(f"there is no {error} in it") from None
    except (TypeError, AttributeError) as error:
        raise ValueError(f"it has another shape ({error})") from None
