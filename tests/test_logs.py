"""Log lines: one line each, structured, quiet by default, safe against what clients send."""

from __future__ import annotations

import io
import logging
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.base.logs import BURST, ROOT, LineFormatter, Log, Moderation, configure


@pytest.fixture
def stream() -> Iterator[io.StringIO]:
    """Where log lines of the test go; the logging module is left as it was."""
    root, ours = logging.getLogger(), logging.getLogger(ROOT)
    before = list(root.handlers), root.level, ours.level
    yield io.StringIO()
    root.handlers[:], level, ours_level = before
    root.setLevel(level)
    ours.setLevel(ours_level)


def test_line_is_level_area_facts_message(stream: io.StringIO) -> None:
    """The form is `LEVEL area key=value message`, facts in the order in which they were bound."""
    configure("info", stream)
    log = Log("control").bind(connection="127.0.0.1:50122")
    log.bind(robot="Rover7").info("robot spawned", model="P2AT", speed=1.0)
    assert stream.getvalue() == (
        "INFO control connection=127.0.0.1:50122 robot=Rover7 model=P2AT speed=1 robot spawned\n"
    )


def test_bind_leaves_the_original_alone(stream: io.StringIO) -> None:
    """Facts of one robot do not appear on the lines of another."""
    configure("info", stream)
    log = Log("control")
    log.bind(robot="A")
    log.info("nobody in particular")
    assert stream.getvalue() == "INFO control nobody in particular\n"


@pytest.mark.parametrize(
    ("level", "shown"),
    [
        ("debug", ["DEBUG", "INFO", "WARNING", "ERROR"]),
        ("info", ["INFO", "WARNING", "ERROR"]),
        ("warning", ["WARNING", "ERROR"]),
        ("error", ["ERROR"]),
    ],
)
def test_level_chooses_what_is_shown(stream: io.StringIO, level: str, shown: list[str]) -> None:
    """A level shows itself and what is more severe."""
    configure(level, stream)
    log = Log("server")
    for write in (log.debug, log.info, log.warning, log.error):
        write("x")
    assert [line.split()[0] for line in stream.getvalue().splitlines()] == shown


def test_libraries_speak_at_warning_only(stream: io.StringIO) -> None:
    """The chosen level is for this server; a library's chatter stays away, its warnings do not."""
    configure("debug", stream)
    logging.getLogger("asyncio").debug("chatter")
    logging.getLogger("asyncio").warning("trouble")
    assert stream.getvalue() == "WARNING asyncio trouble\n"


def test_configure_again_replaces(stream: io.StringIO) -> None:
    """A second call moves the lines, it does not double them."""
    other = io.StringIO()
    configure("info", other)
    configure("warning", stream)
    Log("server").warning("once")
    Log("server").info("not shown")
    assert other.getvalue() == ""
    assert stream.getvalue() == "WARNING server once\n"


def test_standard_error_is_the_default(stream: io.StringIO, capsys) -> None:
    """Standard output belongs to the READY line alone."""
    configure("info")
    Log("server").info("hello")
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", "INFO server hello\n")


def test_defect_carries_its_traceback(stream: io.StringIO) -> None:
    """Only `exception` shows a traceback, below its one line."""
    configure("error", stream)
    try:
        raise KeyError("wheel")
    except KeyError as error:
        Log("robots").exception("handler failed", error, robot="A")
    first, *rest = stream.getvalue().splitlines()
    assert first == "ERROR robots robot=A handler failed"
    assert rest[0] == "Traceback (most recent call last):"
    assert rest[-1] == "KeyError: 'wheel'"


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        ("Rover7", "Rover7"),
        ("my robot", '"my robot"'),
        ("", '""'),
        ('say "x"', '"say \\"x\\""'),
        ("a=b", '"a=b"'),
        ("back\\slash", '"back\\\\slash"'),
        ("two\r\nlines", '"two\\r\\nlines"'),
        ("\x1b[31mred", '"\\x1b[31mred"'),
        (0.27, "0.27"),
        (None, "None"),
    ],
)
def test_values_are_quoted_when_they_have_to_be(
    stream: io.StringIO, value: object, shown: str
) -> None:
    """Blanks, quotes and control characters cannot be mistaken for structure."""
    configure("info", stream)
    Log("control").info("spawned", robot=value)
    assert stream.getvalue() == f"INFO control robot={shown} spawned\n"


def test_long_values_are_cut(stream: io.StringIO) -> None:
    """A client that names its robot with 60 KiB gets a short line."""
    configure("info", stream)
    Log("control").info("spawned", robot="x" * 60_000)
    assert len(stream.getvalue()) < 300


@given(st.text(), st.text())
def test_a_record_is_always_one_line(value: str, message: str) -> None:
    """Whatever a client puts into a name or a command, one record stays one printable line."""
    record = logging.LogRecord(f"{ROOT}.control", logging.INFO, "", 0, "%s", (message,), None)
    record.usarsim_facts = {"robot": value}
    line = LineFormatter().format(record)
    assert line.isprintable()
    assert line.startswith("INFO control robot=")


def test_text_with_percent_signs_is_taken_as_it_is(stream: io.StringIO) -> None:
    """A message is no format string."""
    configure("info", stream)
    Log("control").info("100 %d", text="%s")
    assert stream.getvalue() == "INFO control text=%s 100 %d\n"


# -- too many lines --------------------------------------------------------------------------------


class Clock:
    """A clock that stands still until it is moved."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


def record(message: str, level: int = logging.WARNING) -> logging.LogRecord:
    """A record of the area `robot`."""
    return logging.LogRecord(f"{ROOT}.robot", level, "", 0, "%s", (message,), None)


def test_a_client_cannot_fill_the_log(stream: io.StringIO) -> None:
    """Of thousands of lines of one kind a burst is written, whatever stands behind the colon."""
    configure("warning", stream)
    for number in range(5000):
        Log("robot", connection=number).warning(f"INIT failed: no class {number}")
    lines = stream.getvalue().splitlines()
    assert BURST <= len(lines) < BURST + 20
    Log("robot").warning("something else")
    assert stream.getvalue().endswith("WARNING robot something else\n")


def test_lines_left_out_are_counted() -> None:
    """After a while one more line of the kind is written, and tells how many were not."""
    clock = Clock()
    moderation = Moderation(burst=3, rate=0.5, clock=clock)
    assert [moderation.filter(record("refused")) for _ in range(8)] == [True] * 3 + [False] * 5
    clock.now += 1.0
    assert not moderation.filter(record("refused"))
    clock.now += 1.0
    late = record("refused")
    assert moderation.filter(late)
    expected = "WARNING robot refused (6 lines like this one were left out)"
    assert LineFormatter().format(late) == expected
    clock.now += 1e6
    again = [record("refused") for _ in range(4)]
    assert [moderation.filter(one) for one in again] == [True, True, True, False]
    assert LineFormatter().format(again[0]) == "WARNING robot refused"


def test_kinds_do_not_take_each_others_turn() -> None:
    """Areas, levels and beginnings make kinds; memory for them is bounded."""
    moderation = Moderation(burst=1, clock=Clock())
    assert moderation.filter(record("refused: 1"))
    assert not moderation.filter(record("refused: 2"))
    assert moderation.filter(record("refused: 3", logging.ERROR))
    assert moderation.filter(record("closed"))
    for number in range(5000):
        moderation.filter(record(f"kind {number}"))
    assert len(moderation._kinds) <= 1000


def test_a_developer_misses_nothing(stream: io.StringIO) -> None:
    """At `debug` every line is written, warnings as well."""
    configure("debug", stream)
    for _ in range(BURST + 50):
        Log("robot").warning("again")
        Log("robot").debug("detail")
    assert len(stream.getvalue().splitlines()) == 2 * (BURST + 50)
