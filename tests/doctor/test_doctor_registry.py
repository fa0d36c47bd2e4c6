"""Checks as plug-ins, trials in another process, and the report: nothing spoils the rest of it."""

from __future__ import annotations

import io
import json
import math
import re
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_doctor import checks, examination, registry, trials
from usarsim_doctor.examination import Audience, Checked, all_checks, examine
from usarsim_doctor.isolation import Outcome, attempt
from usarsim_doctor.printing import Printer, as_json, verdict
from usarsim_doctor.registry import Check, Context, Finding, Mark, check
from usarsim_doctor.trials import try_out
from usarsim_server.base.errors import UsarsimError, at, problem_and_advice
from usarsim_server.settings import Settings

HERE = Context(Settings())


def fine(context: Context) -> Iterator[Finding]:
    """A check that finds nothing wrong."""
    yield Finding("it", Mark.OK, f"with {context.settings.world}")


def fails_half_way(context: Context) -> Iterator[Finding]:
    """A check with a defect."""
    yield Finding("first", Mark.OK, "found")
    raise ZeroDivisionError("two\nlines")


class Listener(Audience):
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
        *("versions", "machine", "ports", "files", "graphics", "server")
    ]


def test_a_new_file_is_a_new_check_and_a_broken_one_a_failing_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Dropping a file into the folder adds its checks; one that cannot be imported says why."""
    (tmp_path / "zz_disk.py").write_text(
        "from usarsim_doctor.registry import Finding, Mark\n"
        "from usarsim_doctor.registry import check\n"
        "@check('disk', 'Disk', order=25)\n"
        "def look(context):\n"
        "    return [Finding('space', Mark.OK, '12 GiB')]\n"
    )
    (tmp_path / "zz_torn.py").write_text("import no_such_library\n")
    monkeypatch.setattr(checks, "__path__", [*checks.__path__, str(tmp_path)])
    monkeypatch.setattr(registry, "CHECKS", dict(registry.CHECKS))
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
    monkeypatch.setattr(registry, "CHECKS", dict(registry.CHECKS))
    with pytest.raises(ValueError, match=r"'ports' is already that of .*checks\.machine"):
        check("ports", "Ports", 1)(fine)


def test_a_check_apart_is_run_by_another_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its findings come from there; a process that dies is one line."""

    def attempt(names: list[str], settings: Settings, timeout: float) -> dict[str, Outcome]:
        finding = {"subject": "s", "mark": "problem", "text": "t", "advice": "a"}
        return {names[0]: outcome or Outcome({"findings": [finding]})}

    monkeypatch.setattr(examination, "attempt", attempt)
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


PORTS = Check("ports", "Ports", 1, lambda context: ())
FINDINGS = (
    Finding("3000", Mark.OK, "robot control: free", values={"port": 3000}),
    Finding("5003", Mark.WARNING, "camera images: taken", "usarsim serve --image-port 5004"),
    Finding("off", Mark.NOTE, "older wireless simulation: off"),
)
WRONG = Finding("host", Mark.PROBLEM, "is not of this machine", advice="give --host " * 60)


def printed(*findings: Finding, width: int = 80, color: bool = False) -> str:
    """The whole report on some findings of one check."""
    stream = io.StringIO()
    printer = Printer(stream, width, color)
    printer.begin(PORTS)
    for finding in findings:
        printer.tell(finding)
    printer.end([Checked("ports", "Ports", findings)])
    return stream.getvalue()


def test_the_table_has_marks_subjects_texts_and_cures() -> None:
    """Columns stand below each other, a cure below the text that it belongs to."""
    assert printed(*FINDINGS) == (
        "Ports\n"
        "  ok       3000             robot control: free\n"
        "  warning  5003             camera images: taken\n"
        "           to mend          usarsim serve --image-port 5004\n"
        "  note     off              older wireless simulation: off\n"
        "\n"
        "This machine can run the server (1 warning).\n"
    )


def test_texts_are_wrapped_and_commands_are_not() -> None:
    """No line is wider than the terminal, but a command can be copied in one piece."""
    command = "usarsim serve " + " ".join(f"--option{n} value" for n in range(9))
    long = Finding("load", Mark.WARNING, "word " * 50, command)
    lines = printed(long, width=70).splitlines()
    [whole] = [line for line in lines if command in line]
    assert all(len(line) <= 70 for line in lines if line != whole)
    assert sum(line.strip().startswith("word") for line in lines) > 3


def test_long_advice_is_cut_short() -> None:
    """A list of all names that would do does not push the rest off the screen."""
    lines = printed(WRONG).splitlines()
    advice = [line for line in lines if "give --host" in line]
    assert len(advice) == 3
    assert advice[0].startswith("           to mend ")
    assert advice[-1].endswith(" ...")


def test_colours_add_nothing_but_colour() -> None:
    """Without its escape sequences the coloured report is the plain one."""
    colored = printed(*FINDINGS, WRONG, color=True)
    assert "\x1b[33mwarning\x1b[0m" in colored
    assert "\x1b[1;31mproblem\x1b[0m" in colored
    assert re.sub(r"\x1b\[[0-9;]*m", "", colored) == printed(*FINDINGS, WRONG)


@pytest.mark.parametrize(
    ("findings", "text"),
    [
        (FINDINGS[:1], "This machine can run the server."),
        ((*FINDINGS[1:2] * 2,), "This machine can run the server (2 warnings)."),
        ((WRONG,), "1 problem to mend before the server can run."),
        (
            (WRONG, WRONG, FINDINGS[1]),
            "2 problems to mend before the server can run (1 warning).",
        ),
    ],
)
def test_the_verdict_counts(findings: tuple[Finding, ...], text: str) -> None:
    """One sentence: whether it runs, how much is to be mended."""
    assert verdict([Checked("k", "T", findings)]) == text


def test_json_holds_everything_and_is_strict() -> None:
    """Marks, cures and values come through; what JSON cannot say becomes null or text."""
    odd = Finding("odd", Mark.OK, "ä", values={"rate": math.inf, "list": (1, {"x": math.nan})})
    sections = [Checked("ports", "Ports", (*FINDINGS, WRONG, odd))]
    text = as_json(sections, datetime(2030, 1, 2, 3, 4, 5, tzinfo=UTC))
    document = json.loads(text, parse_constant=pytest.fail)
    assert document["taken"] == "2030-01-02T03:04:05+00:00"
    assert (document["can_run"], document["problems"], document["warnings"]) == (False, 1, 1)
    [section] = document["checks"]
    assert section["key"] == "ports"
    first, second, _, host, last = section["findings"]
    assert first["values"] == {"port": 3000}
    assert second["mark"] == "warning"
    assert second["cure"] == "usarsim serve --image-port 5004"
    assert host["advice"].startswith("give --host")
    assert last["values"] == {"rate": None, "list": [1, {"x": None}]}


WORKER = """
import json, os, pickle, signal, sys, time
names, settings = pickle.loads(sys.stdin.buffer.read())
for name in names:
    if name == "dies":
        os.kill(os.getpid(), signal.SIGKILL)
    if name == "hangs":
        time.sleep(600)
    if name == "exits":
        sys.exit("last words")
    print("a library talks: {not JSON}")
    print(json.dumps({"trial": name, "values": {"world": settings.world}}), flush=True)
"""


@pytest.fixture
def worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A worker whose trials come to grief by name."""
    (tmp_path / "grieving_worker.py").write_text(WORKER)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return "grieving_worker"


def test_trials_after_one_that_dies_are_made_by_another_process(worker: str) -> None:
    """Every other trial succeeds; those that ended their process say how."""
    names = ["one", "dies", "two", "exits", "three"]
    found = attempt(names, Settings(world="office"), 60.0, worker)
    good = Outcome({"world": "office"})
    assert found == {
        "one": good,
        "dies": Outcome(failure="the process was ended by SIGKILL"),
        "two": good,
        "exits": Outcome(failure="last words"),
        "three": good,
    }


def test_a_trial_that_hangs_is_given_up(worker: str) -> None:
    """What was done before counts, and the trial says that it did not end."""
    found = attempt(["one", "hangs"], Settings(), 2.0, worker)
    assert found["hangs"] == Outcome(failure="did not end within 2 s")


def test_the_real_worker_answers() -> None:
    """Importing a library in another process tells its version, a missing one its name."""
    found = attempt(["package:hypothesis", "package:no_such_library"], Settings(), 60.0)
    assert found["package:hypothesis"].values["version"].count(".") >= 1
    assert found["package:no_such_library"].missing == "no_such_library"


def test_errors_become_outcomes(monkeypatch: pytest.MonkeyPatch) -> None:
    """An error for users keeps its advice apart; a defect says of what kind it is."""

    def fail(settings: Settings, argument: str) -> dict[str, object]:
        raise error

    monkeypatch.setattr(trials, "server", fail)
    error: Exception = UsarsimError("world: no floor (add one)")
    told = {"failure": "world: no floor", "told": True, "advice": "add one"}
    assert try_out("server:", Settings()) == told
    error = ValueError("bad\nnews")
    assert try_out("server", Settings()) == {"failure": "ValueError: bad news"}
