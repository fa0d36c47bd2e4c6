"""A report as JUnit XML, which continuous integration servers read."""

from __future__ import annotations

import re
from xml.etree import ElementTree

from usarsim_conformance.report import Report
from usarsim_conformance.verdicts import Severity, Verdict

# XML 1.0, production 2: what may not stand in a document at all.
_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def as_junit(report: Report) -> str:
    """One test suite for each dialect, one test case for each verdict.

    Broken rules are failures, informative ones only notes; what could not be judged is an error,
    what does not apply is skipped.
    """
    root = ElementTree.Element("testsuites", name="usarsim conformance")
    severities = {rule.id: rule.severity for rule in report.rules}
    for dialect in (*report.dialects, ""):
        results = [one for one in report.results if one.dialect == dialect]
        if not results:
            continue
        suite = ElementTree.SubElement(root, "testsuite", name=dialect or "any dialect")
        counts = {"failures": 0, "errors": 0, "skipped": 0}
        for result in results:
            service, _, name = result.check.partition(".")
            case = ElementTree.SubElement(
                suite,
                "testcase",
                classname=f"{dialect or 'any'}.{service}",
                name=name,
                time=f"{result.seconds:.3f}",
            )
            kind = _kind(result.verdict, severities[result.check])
            if kind is None:
                continue
            tag, counter = kind
            counts[counter] += 1
            note = ElementTree.SubElement(case, tag, message=_clean(result.reason))
            if tag != "skipped":
                note.text = _clean("\n".join(result.transcript))
        suite.set("tests", str(len(results)))
        for name, count in counts.items():
            suite.set(name, str(count))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _kind(verdict: Verdict, severity: Severity) -> tuple[str, str] | None:
    if verdict is Verdict.PASS:
        return None
    if verdict is Verdict.FAIL and severity is not Severity.INFORMATIVE:
        return "failure", "failures"
    return ("error", "errors") if verdict is Verdict.INCONCLUSIVE else ("skipped", "skipped")


def _clean(text: str) -> str:
    return _FORBIDDEN.sub("?", text)
