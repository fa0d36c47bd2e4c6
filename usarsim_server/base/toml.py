"""Reads and writes TOML files; whatever is wrong with one is one error that names line and cure."""

from __future__ import annotations

import json
import re
import tomllib
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Iterator, Mapping
from pathlib import Path

from usarsim_server.base.errors import UsarsimError, at
from usarsim_server.base.files import MAX_TEXT, read_regular, reason

MAX_DEPTH = 40
"""Lists and tables within each other. Robot files need eight; every check of a value that goes
down by recursion stays far from Python's limit."""

LARGEST = 2**256
"""Whole numbers in files; TOML promises 64 bits, and those of some thousand digits Python refuses
to print."""

_DIGITS = re.compile(r"[0-9_]{60,}|0[xob][0-9A-Fa-f_]{60,}")
_BRACKETS = re.compile(r"(?:[\[{][^\[\]{}\n]{0,40}){20}")
_LONG_KEY = re.compile(rf"(?<![\w\"'-])(?:[\w\"'-]++[ \t]*+\.[ \t]*+){{{MAX_DEPTH}}}")
"""A key of more parts; the time that tomllib needs for one grows with their square."""
_FLATTEN = f"nest lists and tables at most {MAX_DEPTH} deep"
_SHORTEN = "write fewer digits"
_SAVE = "save the file as UTF-8"
_MARKS = BOM_UTF16_LE, BOM_UTF16_BE
_ENDS = re.compile(rb"\r\n?|\n")


def read_toml(path: Path, error: type[UsarsimError], entry: str = "name") -> dict[str, object]:
    """Parse a TOML file.

    Args:
        path: the file.
        error: what is raised.
        entry: a list that such files have, for the cure.

    Raises:
        error: if it cannot be read or is not TOML.
    """
    return parse_toml(read_text(path, error), path, error, entry)


def read_text(path: Path, error: type[UsarsimError], limit: int = MAX_TEXT) -> str:
    """The text of a file that people write, with LF at the ends of lines.

    Args:
        path: the file.
        error: what is raised.
        limit: bytes that it may have.

    Raises:
        error: if it cannot be read, is no regular file, longer than the limit or not UTF-8.
    """
    try:
        data = read_regular(path, limit)
    except OSError as cause:
        problem = f"cannot be read: {reason(cause)}"
        raise error(at(path, problem, "check the path and its rights")) from cause
    return decoded(data, path, error)


def decoded(data: bytes, path: Path | str, error: type[UsarsimError]) -> str:
    """The text of bytes in UTF-8 that people wrote, with LF at the ends of lines.

    The byte order mark that editors put before it is left out.

    Args:
        data: the bytes.
        path: where they come from, for errors.
        error: what is raised.

    Raises:
        error: they are not UTF-8; names the line.
    """
    if data[:2] in _MARKS or data[1:4:2] == b"\0\0":
        raise error(at(path, "is in UTF-16", _SAVE))
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as cause:
        read, start = cause.object, cause.start
        problem = f"byte 0x{read[start]:02X} is not UTF-8"
        line = len(_ENDS.findall(read, 0, start)) + 1
        raise error(at(path, problem, _SAVE, where=f"line {line}")) from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def parse_toml(
    text: str, path: Path, error: type[UsarsimError], entry: str = "name"
) -> dict[str, object]:
    """The table in the text of a TOML file.

    Args:
        text: of the file.
        path: for errors.
        error: what is raised.
        entry: a list that such files have, for the cure.

    Raises:
        error: if it is not TOML, nested deeper than `MAX_DEPTH`, or has whole numbers beyond
            `LARGEST`.
    """
    if _LONG_KEY.search(text) is not None:
        where = _line(_LONG_KEY, text)
        raise error(at(path, "is not valid TOML: a key of too many parts", _FLATTEN, where=where))
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as cause:
        # Besides its own error tomllib lets those of int() and of the recursion limit through.
        problem, _, place = str(cause).partition(" (at ")
        cure = (
            "mend the line; TOML writes key = value, text in quotes, "
            f"[[{entry}]] for an entry of a list"
        )
        where = place.rstrip(")") or None
        if isinstance(cause, RecursionError):
            problem, cure, where = "nested too deeply", _FLATTEN, _line(_BRACKETS, text)
        elif not isinstance(cause, tomllib.TOMLDecodeError):
            problem, cure, where = "a number of too many digits", _SHORTEN, _line(_DIGITS, text)
        raise error(at(path, f"is not valid TOML: {problem}", cure, where=where)) from None
    _check_values(table, text, path, error)
    return table


def _check_values(
    table: dict[str, object], text: str, path: Path, error: type[UsarsimError]
) -> None:
    level: list[object] = [table]
    for _ in range(MAX_DEPTH):
        below: list[object] = []
        for value in level:
            if isinstance(value, dict):
                below.extend(value.values())
            elif isinstance(value, list):
                below.extend(value)
            elif isinstance(value, int) and abs(value) >= LARGEST:
                problem, where = "a whole number far too large", _line(_DIGITS, text)
                raise error(at(path, problem, _SHORTEN, where=where))
        level = below
        if not level:
            return
    raise error(at(path, "nested too deeply", _FLATTEN, where=_line(_BRACKETS, text)))


def _line(pattern: re.Pattern[str], text: str) -> str | None:
    """The first line in which something is, if it can be found."""
    found = pattern.search(text)
    return None if found is None else f"line {text.count(chr(10), 0, found.start()) + 1}"


def toml_text(content: Mapping[str, object]) -> str:
    """A table as TOML: plain keys first, then `[tables]`, then `[[lists of tables]]`.

    What stands in those is written inline; None values are left out. Numbers keep all their digits.
    """
    plain, tables, lists = [], [], []
    for key, value in content.items():
        if isinstance(value, Mapping):
            tables.append("\n".join([f"[{_key(key)}]", *_lines_of(value)]))
        elif isinstance(value, list | tuple) and value and isinstance(value[0], Mapping):
            lists += ["\n".join([f"[[{_key(key)}]]", *_lines_of(one)]) for one in value]
        elif value is not None:
            plain.append(f"{_key(key)} = {_written(value)}")
    return "\n\n".join(["\n".join(plain), *tables, *lists]).strip("\n") + "\n"


def _lines_of(content: Mapping[str, object]) -> Iterator[str]:
    return (f"{_key(k)} = {_written(v)}" for k, v in content.items() if v is not None)


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _quoted(key)


def _quoted(text: str) -> str:
    # A JSON string is a TOML basic string, but for DEL, which JSON leaves as it is.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007F")


def _written(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, Mapping):
        inner = ", ".join(f"{_key(k)} = {_written(v)}" for k, v in value.items() if v is not None)
        return "{ " + inner + " }" if inner else "{}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_written, value)) + "]"
    raise TypeError(f"{value!r} has no place in a TOML file")
