"""Standard output and error of a command that may be closed, full, or of an encoding without our
letters.

A shell may close them (`>&-`), point them to a full disk, or to a reader that goes away
(`| head -1`). No command looks after that by itself: `guard` replaces both streams once, at the
beginning of the program, and `settle` empties them at its end.
"""

from __future__ import annotations

import codecs
import contextlib
import errno
import io
import os
import sys
from typing import Any, TextIO

from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.files import reason

_ESCAPED = "usarsim.escaped"
"""How a stream writes what its encoding lacks: bytes of odd file names as they are, other letters
as an escape such as `\\u4e16`."""


class OutputError(UsarsimError):
    """Standard output cannot be written, for example because the disk is full."""


class ReaderGoneError(BrokenPipeError):
    """The program that read standard output has closed it, as `head` does."""


class _Output(io.FileIO):
    """A descriptor whose errors name standard output."""

    def write(self, data: Any) -> int:
        """Write bytes.

        Raises:
            ReaderGoneError: the reader has closed it.
            OutputError: they cannot be written.
        """
        try:
            return super().write(data)
        except BrokenPipeError as error:
            raise ReaderGoneError(error.errno, error.strerror) from None
        except OSError as error:
            cure = "make room, or send it elsewhere"
            raise OutputError(
                f"standard output: cannot be written: {reason(error)} ({cure})"
            ) from None


class _Complaints(io.FileIO):
    """A descriptor that swallows what cannot be written: there is no place left to say so."""

    def write(self, data: Any) -> int:
        """Write bytes, or lose them."""
        try:
            return super().write(data)
        except OSError:
            return len(data)


def guard() -> None:
    """Replace standard output and error by streams that can be written to whatever they are.

    Those that are closed lead nowhere. Called once, before the program opens anything: a file that
    is opened while descriptor 1 is closed would become standard output.
    """
    for descriptor in (0, 1, 2):
        _fill(descriptor)
    codecs.register_error(_ESCAPED, _escape)
    sys.stdout = _stream(sys.stdout, _Output(1, "wb", closefd=False))
    sys.stderr = _stream(sys.stderr, _Complaints(2, "wb", closefd=False))


def settle(code: int) -> int:
    """Write what is left for standard output; the exit code.

    Args:
        code: of the command. It stays as it is if the reader has gone, and becomes 2 if it was 0
            and the output is lost.
    """
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        mute()
    except OutputError as error:
        mute()
        print(f"error: {error}", file=sys.stderr)
        return code or 2
    return code


def mute() -> None:
    """Send standard output nowhere, so that no flush at the exit of Python fails again.

    See the Python library reference, signal, "Note on SIGPIPE".
    """
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)
    with contextlib.suppress(OSError, UsarsimError):
        sys.stdout.flush()


def _fill(descriptor: int) -> None:
    try:
        os.fstat(descriptor)
    except OSError as error:
        if error.errno != errno.EBADF:
            raise
        # The lowest free number is what open() gives, and all below are taken by now.
        os.open(os.devnull, os.O_RDONLY if descriptor == 0 else os.O_WRONLY)
        os.set_inheritable(descriptor, True)


def _stream(usual: TextIO | None, raw: io.FileIO) -> TextIO:
    """A text stream like the usual one, but for the descriptor that it writes to."""
    if not isinstance(usual, io.TextIOWrapper):
        return io.TextIOWrapper(io.BufferedWriter(raw), encoding="utf-8", errors=_ESCAPED)
    usual.flush()
    whole = isinstance(usual.buffer, io.RawIOBase)
    return io.TextIOWrapper(
        raw if whole else io.BufferedWriter(raw),
        encoding=usual.encoding,
        errors=_ESCAPED,
        line_buffering=usual.line_buffering,
        write_through=usual.write_through,
    )


def _escape(error: UnicodeError) -> tuple[str | bytes, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    found = b""
    for letter in error.object[error.start : error.end]:
        number = ord(letter)
        if 0xDC80 <= number <= 0xDCFF:
            found += bytes([number - 0xDC00])
        else:
            found += letter.encode("ascii", "backslashreplace")
    return found, error.end
