"""Checks as plug-ins: found, run in order, and none of them spoils the report."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.doctor import checks, registry
from usarsim_server.doctor.isolation import Outcome
from usarsim_server.doctor.registry import (
    Check,
    Context,
    Finding,
    Mark,
    all_checks,
    check,
    examine,
    problem_and_advice,
)
from usarsim_server.errors import at
from usarsim_server.settings import Settings

HERE = Context(Settings())


def fine(context: Context) -> Iterator[Finding]:
    """A check that finds nothing wrong."""
    yield Finding("it", Mark.OK, f"with {context.settings.world}")


def fails_half_way(context: Context) -> Iterator[Finding]:
    """A check with a defect."""
    yield Finding("first", Mark.OK, "found")
    raise ZeroDivisionError("two\nlines")


class Listener:
    """An audience that remembers."""

    def __init__(self) -> None:
        self.heard: list[str] = []

    def begin(self, check: Check) -> None:
        """Remember the check."""
        self.heard.append(check.key)

    def tell(self, finding: Finding) -> None:
        """Remember the subject."""
        self.heard.append(finding.subject)


def test_a_check_that_crashes_is_one_line_and_the_others_go_on() -> None:
    """What it found before stays, its error is a warning in one line, the next check is run."""
    broken = Check("broken", "Broken things", 1, fails_half_way)
    listener = Listener()
    first, second = examine([broken, Check("fine", "Fine", 2, fine)], HERE, listener)
    assert [finding.subject for finding in first.findings] == ["first", "broken things"]
    failure = first.findings[1]
    assert failure.mark is Mark.WARNING
    assert failure.text == "could not be looked at: ZeroDivisionError: two lines"
    assert second.findings == (Finding("it", Mark.OK, "with arena"),)
    assert listener.heard == ["broken", "first", "broken things", "fine", "it"]


def test_the_built_in_checks_come_in_order() -> None:
    """All subjects are there, versions first, what takes long last."""
    found = all_checks()
    assert [one.key for one in found] == [
        *("versions", "machine", "ports", "files", "graphics", "server", "rates")
    ]
    assert [one.key for one in found if one.measures] == ["rates"]


def test_a_new_file_is_a_new_check_and_a_broken_one_a_failing_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Dropping a file into the folder adds its checks; one that cannot be imported says why."""
    (tmp_path / "zz_disk.py").write_text(
        "from usarsim_server.doctor.registry import Finding, Mark\n"
        "from usarsim_server.doctor.registry import check\n"
        "@check('disk', 'Disk', order=25)\n"
        "def look(context):\n"
        "    return [Finding('space', Mark.OK, '12 GiB')]\n"
    )
    (tmp_path / "zz_torn.py").write_text("import no_such_library\n")
    monkeypatch.setattr(checks, "__path__", [*checks.__path__, str(tmp_path)])
    monkeypatch.setattr(registry, "_CHECKS", dict(registry._CHECKS))
    try:
        found = {one.key: one for one in all_checks()}
        assert list(found)[2:4] == ["disk", "ports"]
        disk, torn = examine([found["disk"], found["zz_torn"]], HERE)
        assert disk.findings[0].text == "12 GiB"
        assert "No module named 'no_such_library'" in torn.findings[0].text
    finally:
        for name in ("zz_disk", "zz_torn"):
            sys.modules.pop(f"{checks.__name__}.{name}", None)
            vars(checks).pop(name, None)


def test_two_checks_cannot_have_one_key(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second function that enters itself under a key is refused."""
    all_checks()
    monkeypatch.setattr(registry, "_CHECKS", dict(registry._CHECKS))
    with pytest.raises(ValueError, match=r"'ports' is already that of .*checks\.machine"):
        check("ports", "Ports", 1)(fine)


def test_a_check_apart_is_run_by_another_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its findings come from there; a process that dies is one line."""

    def attempt(names: list[str], settings: Settings, timeout: float) -> dict[str, Outcome]:
        finding = {"subject": "s", "mark": "problem", "text": "t", "advice": "a"}
        return {names[0]: outcome or Outcome({"findings": [finding]})}

    monkeypatch.setattr(registry, "attempt", attempt)
    one = Check("far", "Far away", 1, fails_half_way, apart=True)
    outcome = None
    assert examine([one], HERE)[0].findings == (Finding("s", Mark.PROBLEM, "t", advice="a"),)
    outcome = Outcome(failure="the process was ended by SIGSEGV")
    [finding] = examine([one], HERE)[0].findings
    assert finding.mark is Mark.WARNING
    assert finding.text == "could not be looked at: the process was ended by SIGSEGV"


def test_the_command_to_serve_keeps_what_was_given_but_for_what_is_replaced() -> None:
    """Options are quoted for the shell, one that is replaced is left out, hyphens stay values."""
    given = (("--config", "my lab.toml"), ("--port", "3000"), ("--spectator", "-1,0,0,0,0,0"))
    context = Context(Settings(), given)
    assert context.serve({"--port": 3001}) == (
        "usarsim serve --config 'my lab.toml' --spectator=-1,0,0,0,0,0 --port 3001"
    )


words = st.text("abc ()'=,:", min_size=1, max_size=20).filter(lambda text: text.strip(" ") == text)


@given(words.filter(lambda text: "(" not in text and ")" not in text), words)
def test_an_error_is_split_where_it_was_put_together(problem: str, cure: str) -> None:
    """What `errors.at` joins comes apart again, balanced brackets inside the cure or not."""
    depth = 0
    for letter in cure:
        depth += {"(": 1, ")": -1}.get(letter, 0)
        if depth < 0:
            return
    if depth:
        return
    message = at("file", problem, cure)
    expected = " ".join(f"file: {problem}".split()), " ".join(cure.split())
    assert problem_and_advice(message) == expected


@pytest.mark.parametrize("text", ["", "plain", "ends (in the middle) here", "closed only)"])
def test_an_error_without_a_cure_stays_whole(text: str) -> None:
    """Without brackets at the end there is no advice."""
    assert problem_and_advice(text) == (text, None)
