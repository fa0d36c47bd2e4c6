"""Commands whose standard output or error is closed, full, or not read to its end."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from lanes import slow_but

FULL = "error: standard output: cannot be written: No space left on device ("

CHEAP = (
    ("--version", 0),
    ("--help", 0),
    ("robots", 0),
    ("robots P3AT", 0),
    ("robots NoSuchRobot", 2),
    ("worlds", 0),
    ("serve --no-such-option", 2),
    ("mission list", 0),
    ("study list", 0),
    ("mission check /nowhere.toml", 2),
    ("explore list", 0),
    ("explore worlds", 0),
    ("bench --help", 0),
    ("study --help", 0),
    ("conformance --help", 0),
)
"""Commands that take no time, and their exit codes."""
FAST = {CHEAP[0], ("mission check /nowhere.toml", 2), ("study --help", 0)}


def start(command: str, shell: str) -> subprocess.Popen[bytes]:
    """A command with redirections, its output and error kept apart."""
    return subprocess.Popen(
        f"exec {sys.executable} -m usarsim_server {command} {shell}",
        shell=True,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "COLUMNS": "100"},
    )


@pytest.mark.parametrize(("command", "code"), slow_but(FAST.__contains__, CHEAP))
def test_cheap_commands_without_streams(command: str, code: int) -> None:
    """Closed streams change no exit code; what is lost on a full disk is one error."""
    closed, full = start(command, "<&- >&- 2>&-"), start(command, ">/dev/full")
    assert (*closed.communicate(), closed.returncode) == (b"", b"", code)
    said = full.communicate()[1].decode()
    assert "Traceback" not in said
    assert full.returncode == 2
    if code == 0:
        assert said.startswith(FULL)
        assert said.count("\n") == 1
    else:
        assert "standard output" not in said


def test_a_full_standard_error_changes_nothing() -> None:
    """What cannot be said is left out; output and exit code are as they would be."""
    one, other = start("robots", "2>/dev/full"), start("robots NoSuchRobot", "2>/dev/full")
    out, said = one.communicate()
    assert (one.returncode, said) == (0, b"")
    assert b"P3AT" in out
    assert (*other.communicate(), other.returncode) == (b"", b"", 2)


def test_errors_stay_out_of_the_output() -> None:
    """With standard error closed, errors do not come by standard output."""
    done = start("robots NoSuchRobot", "2>&-")
    assert (*done.communicate(), done.returncode) == (b"", b"", 2)


def test_letters_that_the_encoding_lacks_are_escaped() -> None:
    """In the C locale letters are written as escapes, bytes of odd file names as they are."""
    program = (
        "from usarsim_server.base import streams; streams.guard(); "
        "print('gr\\xf6\\xdfe', '\\u4e16', '\\udcff', flush=True)"
    )
    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, env={**os.environ, **plain}
    )
    assert (done.stdout, done.stderr) == (b"gr\\xf6\\xdfe \\u4e16 \xff\n", b"")
