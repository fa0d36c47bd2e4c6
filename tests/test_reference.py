"""Citations of docs/reference: each names its page, and every cited number exists there.

docs/reference/README.md says how to cite.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

from usarsim_conformance.registry import all_checks

ROOT = Path(__file__).parents[1]
REFERENCE = ROOT / "docs" / "reference"

PLACES = ("*.md", "docs", "examples", "robots", "tests", "tools", "usarsim_server", "worlds")
SUFFIXES = {".c", ".diff", ".md", ".py", ".toml", ".ts", ".xml"}
LEFT_OUT = {"node_modules", "reference", "design"}
"""Folders: in a page of the reference a bare number is one of that page."""

COUNTED = ("protocol", "side channels", "robots", "worlds")
"""Pages whose checks have plain numbers."""
NAMED = {
    "E": "exploration",
    "EXP": "exploration",
    "O": "operator",
    "CON": "console",
    "HRI": "console",
    "DOOR": "doors",
    "BAT": "doors",
}
"""Pages by the letters of their checks."""

GAP = r"\s+(?:(?:#|//|\*)\s+)?"
"""Blank between two words of a text or comment, also over the end of a line."""
SECTION = r"\d{1,2}(?:\.\d{1,2}){1,2}"
NUMBER = rf"#?\d+(?:\.\d+)*(?:,?{GAP}(?:no\.|number){GAP}?\d+|{GAP}#\d+)?"
AND = rf"(?:,{GAP}(?:and{GAP}|or{GAP})?|;{GAP}|{GAP}(?:and|to|or){GAP}|-)(?:table{GAP})?"
CITED = re.compile(
    rf"([Pp]rotocol|[Ss]ide{GAP}channels|[Rr]obots|[Ww]orlds|[Ee]xploration|[Oo]perator)"
    rf"((?:{GAP}(?:reference,?|checklist|checks?|items?|section|table))*){GAP}"
    rf"({NUMBER}(?:{AND}{NUMBER})*)(?!\w|\.\d| ?%)"
)
CHECK = re.compile(rf"\b({'|'.join(NAMED)})-\d\d\b")
BARE = re.compile(
    rf"\b[Cc]heck(?:s|lists?)? #?{NUMBER}|\breference,? {SECTION}|\(#\d+\)"
    rf"|(?<![\d.]){SECTION},? (?:no\. |number |#)\d|\btable (?:1\.7|2\.2|4\.5)"
    rf"|\b(?:templates? of|examples? of|lines? of|items?|conflict) {SECTION}"
)
BARE_IN_TEXT = re.compile(
    rf"(?<!\w)\({SECTION}(?=\)|;|, (?:{SECTION}|[a-z]))"
    r'|"""#?\d{1,3}(?:\.\d+)*(?:(?:, | and | to )#?\d+(?:\.\d+)*)*:'
)
"""In docstrings and comments only: elsewhere such numbers are measurements."""
TEXT = re.compile(r'"""(?:.*?)"""|(?:#[^\n]*(?:\n[ \t]*(?=#))?)+|\bid="[^"]*"', re.S)
"""What people read in a program: docstrings, comments and names of cases."""
DIGIT = re.compile(r"\d")


class Page(NamedTuple):
    """What a page of the reference numbers."""

    sections: set[str]
    checks: set[str]
    rows: set[tuple[str, str]]
    """Sections, and numbers of rows of their tables or items of their lists."""


@cache
def page(name: str) -> Page:
    """The numbers of a page."""
    found = Page(set(), set(), set())
    section, checklist = "", False
    for line in (REFERENCE / f"{name.replace(' ', '-')}.md").read_text("utf-8").splitlines():
        if heading := re.match(r"(#+|\*\*(?=\d)) ?(\d+(?:\.\d+)*)?(.*)", line):
            section = heading[2] or ""
            found.sections.add(section)
            if heading[1] == "##":
                checklist = "checklist" in heading[3].lower()
        elif item := re.match(r"\|? ?(\d+)(?:\.| \|) ", line):
            found.rows.update({(section, item[1]), (section.partition(".")[0], item[1])})
            if checklist:
                found.checks.add(item[1])
        elif named := re.match(r"- \[ \] (\w+-\d\d) ", line):
            found.checks.add(named[1])
    return found


@cache
def sections() -> set[str]:
    """Numbers of sections of any page."""
    return {one for name in (*COUNTED, *NAMED.values()) for one in page(name).sections}


def known(name: str, number: str) -> bool:
    """Whether a page has a section, a check, or a row of a section."""
    section, *row = re.findall(r"\d+(?:\.\d+)*", number)
    of = page(name)
    return (section, row[0]) in of.rows if row else section in of.checks | of.sections


def cited(text: str) -> Iterator[tuple[re.Match[str], str]]:
    """Citations by page and number with their pages; "4 robots 2 m apart" is none."""
    for found in CITED.finditer(text):
        name = re.sub(r"\W+", " ", found[1].lower())
        before = text[max(found.start() - 2, 0) : found.start()]
        if re.search(r"[\w{-]$", before):
            continue
        if "." not in found[3] and not found[2]:
            if name not in COUNTED:
                continue
            if name in ("robots", "worlds") and not re.search(r'[("]$|[(;,#] $|^$', before):
                continue
        yield found, name


def mistakes(text: str, program: bool = True) -> Iterator[tuple[int, str]]:
    """Positions and reasons of citations that lead nowhere, or do not say where to.

    Args:
        program: whether it is a docstring or a comment; otherwise it is a page, or a whole file.
    """
    spans = []
    for found, name in cited(text):
        spans.append(found.span())
        for number in re.findall(NUMBER, found[3]):
            if not known(name, number):
                yield found.start(), f"{' '.join(found[0].split())}: {name} has no {number}"
    for found in CHECK.finditer(text):
        if found[0] not in page(NAMED[found[1]]).checks:
            yield found.start(), f"{found[0]}: {NAMED[found[1]]} has none"
    for pattern in (BARE, BARE_IN_TEXT)[: 1 + program]:
        for found in pattern.finditer(text):
            number = re.search(SECTION, found[0])
            if number and number[0] not in sections():
                continue
            if not any(start <= found.start() < end for start, end in spans):
                yield found.start(), f"{found[0]}: names no page of the reference"


def told(file: Path) -> Iterator[str]:
    """The mistakes of a file."""
    text = file.read_text("utf-8")
    program = file.suffix in (".py", ".toml")
    for part in TEXT.finditer(text) if program else re.finditer("(?s).+", text):
        if DIGIT.search(part[0]):
            for at, reason in mistakes(part[0], program):
                line = text.count("\n", 0, part.start() + at) + 1
                yield f"{file.relative_to(ROOT)}:{line}: {reason}"


def files() -> Iterator[Path]:
    """What may cite."""
    for place in PLACES:
        for path in ROOT.glob(place):
            for file in path.rglob("*") if path.is_dir() else [path]:
                if file.suffix in SUFFIXES and not LEFT_OUT & {*file.parts}:
                    yield file


def test_every_citation_leads_somewhere() -> None:
    """Code, tests and docs cite pages and numbers that exist."""
    found = [one for file in files() if file != Path(__file__) for one in told(file)]
    assert not found, "\n".join(found)


def test_sources_of_the_conformance_kit() -> None:
    """Reports of the kit show them; they write 11.45 for item 45 of section 11."""
    for check in all_checks():
        source = re.sub(r"\b11\.(\d+)", r"11 no. \1", check.source)
        assert list(cited(source)) or not DIGIT.search(source), f"{check.id}: {source}"
        assert not list(mistakes(source)), f"{check.id}: {source}"


@pytest.mark.parametrize(
    "text",
    [
        "(protocol 3.4.6, 3.5 and 3.8 to 3.10)",
        "(protocol 109; robots 5.4, 113, side\n# channels 100)",
        "protocol reference 6, no. 101 and 102; protocol 5.2 no. 14",
        "protocol table 2.2, protocol 5.1.12",
        "worlds reference 13, items 43 to 47; exploration 12.4",
        "E-57, EXP-18, O-45, CON-15, HRI-17, DOOR-04 and BAT-03",
        "of 130 robots 999 m apart; operator 77; {Robots 0}; a door of (1.5 m)",
    ],
)
def test_good_citations(text: str) -> None:
    """Nothing is told of them."""
    assert list(mistakes(text)) == []


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("it does (protocol 189)", "protocol 189: protocol has no 189"),
        ("(protocol 3.4.6, 3.16)", "protocol 3.4.6, 3.16: protocol has no 3.16"),
        ("side\n# channels 5.2 no. 99", "side # channels 5.2 no. 99: side channels has no"),
        ("EXP-99", "EXP-99: exploration has none"),
        ("it does (check 109)", "check 109: names no page"),
        ("Checklist 7 to 9.", "Checklist 7: names no page"),
        ("it does (3.4.6)", "(3.4.6: names no page"),
        ('"""12 and 13: it does."""', '"""12 and 13:: names no page'),
        ("as 5.2 no. 14 says", "5.2 no. 1: names no page"),
    ],
)
def test_mistakes(text: str, reason: str) -> None:
    """Unknown numbers, and numbers without a page, are told."""
    (one,) = mistakes(text)
    assert one[1].startswith(reason)
