"""Signals, as seen from inside a program."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading

import pytest

from usarsim_server.base import interrupts

PROGRAM = """
import sys, threading, time
from usarsim_server.base import interrupts

def raised_inside():
    try:
        interrupts.begin()
        say()
        time.sleep(60)
    finally:
        print("tidied", flush=True)

def never_ends():
    interrupts.begin()
    try:
        say()
        time.sleep(60)
    finally:
        threading.Event().wait()

def swallowed():
    interrupts.begin()
    class Odd:
        def __del__(self):
            say()
            time.sleep(1.0)
    odd = Odd()
    del odd
    time.sleep(60)

def called():
    with interrupts.calling(lambda: print("called", flush=True)):
        say()
        time.sleep(0.5)
        time.sleep(0.5)
    return 7

def early():
    say()
    time.sleep(60)

def say():
    print("now", flush=True)

interrupts.arm(ordinary=False)
code = 1
try:
    code = globals()[sys.argv[1]]()
except BaseException:
    if not interrupts.interrupted():
        raise
sys.exit(interrupts.finish(code))
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    ("case", "said"),
    [
        ("early", ""),
        ("raised_inside", "tidied\n"),
        ("never_ends", ""),
        ("swallowed", ""),
    ],
)
def test_a_signal_ends_the_program(case: str, said: str, number: signal.Signals) -> None:
    """It ends with 128 and the number, tidies away if it can, and prints no traceback, wherever
    the signal strikes: before the work, in it, where nothing can be raised, or while tidying up
    never ends."""
    with _program(case) as process:
        process.send_signal(number)
        output, errors = process.communicate(timeout=90.0)
    assert process.returncode == 128 + number
    assert output == said
    assert "Traceback" not in errors


def test_a_function_is_called_instead() -> None:
    """Within `calling` nothing is raised, and the program decides about its code."""
    with _program("called") as process:
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=90.0)
    assert (process.returncode, output, errors) == (7, "called\n", "")


def test_handlers_are_given_back() -> None:
    """A program that embeds a server finds its own handlers afterwards."""
    came: list[int] = []
    before = signal.signal(signal.SIGTERM, lambda number, frame: came.append(number))
    try:
        with interrupts.calling(lambda: came.append(0)):
            os.kill(os.getpid(), signal.SIGTERM)
        os.kill(os.getpid(), signal.SIGTERM)
    finally:
        signal.signal(signal.SIGTERM, before)
        interrupts._state.first = None
    assert came == [0, signal.SIGTERM]


def test_other_threads_get_no_signals() -> None:
    """In a thread nothing is set up; whoever runs a server there ends it in another way."""
    found: list[object] = []

    def look() -> None:
        with interrupts.calling(lambda: None):
            found.append(signal.getsignal(signal.SIGINT))

    before = signal.getsignal(signal.SIGINT)
    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    assert found == [before]


def _program(case: str) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, case],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "now\n"
    return process
