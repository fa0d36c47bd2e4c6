"""The report: a table for readers, the same for machines."""

from __future__ import annotations

import io
import json
import math
import re
from datetime import UTC, datetime

import pytest

from usarsim_server.doctor.registry import Check, Checked, Finding, Mark
from usarsim_server.doctor.report import Printer, as_json, verdict

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
