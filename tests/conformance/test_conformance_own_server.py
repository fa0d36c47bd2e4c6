"""`usarsim conformance` judges, also our own server, whose side channels keep the rules."""

from __future__ import annotations

import asyncio
import json
import queue
import signal
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from mutants.fault_proxy import proxied
from mutants.wire_faults import all_wire_faults

from usarsim_conformance.own_server import as_table, judged_server
from usarsim_conformance.registry import Verdict, all_checks, select
from usarsim_conformance.report import from_json
from usarsim_conformance.runner import judge_all
from usarsim_conformance.side_lines import split_reply
from usarsim_conformance.survey import Target
from usarsim_server.cli import main
from usarsim_server.protocol.images import RAW
from usarsim_server.testing import PATIENCE, running_server


@contextmanager
def faulty(name: str, ports: Mapping[str, int]) -> Iterator[str]:
    """Our own server with a fault that a proxy in another thread makes; its port as text."""
    found: queue.Queue[tuple[int, asyncio.AbstractEventLoop, asyncio.Event]] = queue.Queue()
    fault = all_wire_faults()[name]

    async def serve() -> None:
        async with proxied(fault.kind, ports, fault.services) as faulty_ports:
            stop = asyncio.Event()
            found.put((faulty_ports["control"], asyncio.get_running_loop(), stop))
            await stop.wait()

    thread = threading.Thread(target=asyncio.run, args=(serve(),))
    thread.start()
    port, loop, stop = found.get(timeout=PATIENCE)
    try:
        yield str(port)
    finally:
        loop.call_soon_threadsafe(stop.set)
        thread.join(PATIENCE)


_FAST = ["--robot", "P2AT", "--dialect", "ut2004"]


def test_a_conforming_server(
    tmp_path: Path, own_ports: Mapping[str, int], capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 0, a table on standard output, and three files."""
    words = ["--port", str(own_ports["control"]), *_FAST, "--only", "greeting"]
    assert main(["conformance", *words, "--report", str(tmp_path / "r"), "--name", "Mini"]) == 0
    told = capsys.readouterr()
    assert "Mini conforms." in told.out
    assert "report.html" in told.err
    data = json.loads((tmp_path / "r" / "report.json").read_text())
    assert data["conforms"] is True
    assert {one["verdict"] for one in data["results"]} == {"pass"}
    assert "<testsuites" in (tmp_path / "r" / "report.xml").read_text()
    assert "<!DOCTYPE html>" in (tmp_path / "r" / "report.html").read_text()


def test_a_server_with_a_fault(
    own_ports: Mapping[str, int], capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 1, and the report shows the bytes."""
    with faulty("control.grammar.unknown-command", own_ports) as port:
        words = ["--port", port, *_FAST, "--only", "unknown-command,init.silent"]
        assert main(["conformance", *words]) == 1
    told = capsys.readouterr()
    assert "FAIL  control.grammar.unknown-command" in told.out
    assert "ERROR {Reason unknown command}" in told.out
    assert f"127.0.0.1:{port} does NOT conform." in told.out


def test_places_and_comparison(
    tmp_path: Path, own_ports: Mapping[str, int], capsys: pytest.CaptureFixture[str]
) -> None:
    """A place by coordinates is used; two reports are put side by side."""
    words = ["--port", str(own_ports["control"]), *_FAST, "--start", "20,0,-0.25"]
    words += ["--only", "control.init.no-package", "--report", str(tmp_path)]
    assert main(["conformance", *words]) == 0
    report = tmp_path / "report.json"
    assert "20.0000,0.0000,-0.2500" not in report.read_text()  # passes keep no transcript
    page = tmp_path / "compare.html"
    capsys.readouterr()
    assert main(["conformance", "compare", str(report), str(report), "--html", str(page)]) == 0
    assert "1 of 1 checks have the same verdict" in capsys.readouterr().out
    assert "side by side" in page.read_text()


def test_list(capsys: pytest.CaptureFixture[str]) -> None:
    """--list names every check and needs no server."""
    assert main(["conformance", "--list"]) == 0
    out = capsys.readouterr().out
    assert all(one.id in out for one in all_checks())


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--only", "no-such-check"], "no check fits 'no-such-check'"),
        (["--port", "1", "--only", "greeting"], "no connection to 127.0.0.1:1"),
        (["compare", "/no/such.json"], "/no/such.json: cannot be read"),
        (["compare", __file__], "no report"),
        (["--list", "--report", "x", "--only", "no-such"], "no check fits"),
    ],
)
def test_errors_in_a_line(words: list[str], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    """What is wrong is said in one line, with exit code 2."""
    assert main(["conformance", *words]) == 2
    errors = capsys.readouterr().err.strip().splitlines()
    assert len(errors) == 1
    assert errors[0].startswith("error: ")
    assert told in errors[0]


def test_a_folder_that_cannot_be_made(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It is refused before minutes of judging, not after."""
    file = tmp_path / "file"
    file.touch()
    assert main(["conformance", "--report", str(file / "r")]) == 2
    assert "cannot be made" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words", [["--port", "0"], ["--port", "x"], ["--start", "1,2"], ["--dialect", "ut99"]]
)
def test_nonsense_is_refused(words: list[str]) -> None:
    """Ports, places and dialects that are none end with code 2."""
    with pytest.raises(SystemExit) as ended:
        main(["conformance", *words])
    assert ended.value.code == 2


def test_last_words() -> None:
    """A server that hangs is ended and tells where each of its threads stands."""
    with judged_server() as server:
        server.end(signal.SIGABRT)
        words = server.errors
    assert server.died
    assert "Fatal Python error: Aborted" in words
    assert words.count("(most recent call first)") > 2
    assert "usarsim_server/simulation/" in words


@pytest.mark.slow
def test_our_own_server_with_several_classes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each class is judged and reported; what a class lacks does not apply to it."""
    only = "control.init.spawns,control.motion.forward"
    options = ("--speed", "max", "--robot", "P2AT,KR6", "--report", str(tmp_path))
    assert main(["conformance", "--self", "--only", only, *options]) == 0
    told = capsys.readouterr().out
    table = {line.split()[0]: line.split()[1:] for line in told.splitlines() if line[:1].isalpha()}
    assert table["P2AT"] == ["4"]
    assert table["KR6"] == ["2", "2"]
    assert told.endswith("conforms with 2 of 2 classes\n")
    broken = from_json((tmp_path / "KR6" / "report.json").read_text())
    failed = replace(broken.results[0], verdict=Verdict.FAIL, reason="no STA\nat all")
    broken = replace(broken, results=(failed, *broken.results[1:]))
    lines = as_table({"P2AT": broken, "KR6": broken}).splitlines()
    assert lines[1].endswith("does NOT conform")
    assert lines[2].split() == ["FAIL", failed.check, f"[{failed.dialect}]", "no", "STA"]
    assert lines[-1] == "conforms with 0 of 2 classes; not with P2AT, KR6"


def test_a_class_that_we_do_not_have(capsys: pytest.CaptureFixture[str]) -> None:
    """One line says so before anything is judged; case and package do not matter."""
    for named, told in (("P3ATT", "did you mean 'P3AT'?"), ("usarbot.p2at,xyz", "known are: ")):
        assert main(["conformance", "--self", "--robot", named]) == 2
        error = capsys.readouterr().err
        assert error.startswith(f"error: --robot: there is no robot class '{named.split(',')[-1]}'")
        assert told in error


QUICK = (
    "images.rectangle.*,images.raw.*,images.header.*,groundtruth.getobs.[deku]*,"
    "groundtruth.getpos.[fst]*,wireless.init.*,wireless.relay.[bt]*,comserver.*,truth.query.*"
)
"""Rules that are judged without long silences; `usarsim conformance --self` judges all."""
SIDES = ("images", "groundtruth", "wireless", "comserver", "truth")


@pytest.mark.slow
def test_our_server_keeps_the_rules() -> None:
    """No rule is broken, none is left open, and with raw pictures none of these is skipped."""
    names = ("image", "groundtruth", "wireless", "comserver", "truth")
    ports = dict.fromkeys((f"{name}_port" for name in names), 0)
    checks = select(all_checks(), QUICK)
    assert len(checks) > 40
    with running_server(world="empty", image_type=RAW, max_robots=16, **ports) as (_, found):
        target = Target(ports={name: found[name].port for name in ("control", *SIDES)})
        report = asyncio.run(judge_all(target, checks))
    wrong = [
        one
        for one in report.results
        if one.verdict is not Verdict.PASS and "the kit's own world" not in one.reason
    ]
    assert not wrong, [(one.check, one.verdict, one.reason) for one in wrong]


def test_every_side_channel_has_many_rules() -> None:
    """More than a hundred rules, each with its source in the reference, and a docstring."""
    checks = [check for check in all_checks() if check.service in SIDES]
    assert len(checks) >= 120
    for check in checks:
        assert check.source.startswith(("side channels reference ", "protocol reference ")), (
            check.id
        )
        assert len(check.rule) > 20, check.id
    assert {check.service for check in checks} == set(SIDES)


def test_the_splitter_stops_at_the_first_surprise() -> None:
    """Two blanks between groups, or none, lose all that follows (side channels reference 3.4)."""
    robot = "{Name A Location 1,2,3 BatteryEmpty False}"
    for between, robots in ((" ", 2), ("  ", 0), ("", 0)):
        kind, groups = split_reply(f"POSITIONS {{Robots 2}}{between}{robot}{between}{robot}")
        assert kind == "POSITIONS"
        assert len(groups) == 1 + robots
    assert split_reply("POSITIONS  {Robots 0}") == ("POSITIONS", [])
