"""A command explained to the person who sent it: how it was read, and what could not be.

The readers of `commands.py` say themselves which segments they look for and what they make of their
texts (`values.Hearing`), so nothing here can differ from what is done. No sockets, no clock; every
function accepts any text and is linear in it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Mapping

from usarsim_server.protocol.commands import interpret
from usarsim_server.protocol.grammar import KNOWN_WORDS, Command
from usarsim_server.protocol.numbers import (
    MAX_MAGNITUDE,
    is_bool,
    is_number,
    read_bool,
    read_int,
    read_number,
    read_triple,
    vector_parts,
)
from usarsim_server.protocol.requests import Ignored, Request, Unknown
from usarsim_server.protocol.values import Hearing, near

MOST_FAULTS = 8
"""Faults of one command that are told; a line may have a thousand."""
_SHOWN = 40
"""Characters of a text of the client that are shown."""
_MOST_READING = 300
_MOST_KEYS = 24


class HeardCommand(Command):
    """A command whose reading is taken notice of."""

    hearing: Hearing  # type: ignore[misc]

    def __init__(self, command: Command) -> None:
        super().__init__(command.word, command.segments, command.text, command.weight, command.cut)
        object.__setattr__(self, "hearing", Hearing())


def heard(command: Command) -> tuple[HeardCommand, Request]:
    """Read a command as `interpret` does, and remember how."""
    listening = HeardCommand(command)
    return listening, interpret(listening)


def reading(request: Request) -> str:
    """A request in plain words: what it is, and every member that was sent."""
    if isinstance(request, Unknown):
        return "nothing: no such command"
    members = [
        f"{member.name}={_plain(value)}"
        for member in dataclasses.fields(request)
        if member.name not in {"segments", "hearing", "spelled_classname_exactly"}
        and (value := getattr(request, member.name)) not in (None, "", (), {})
        and value != member.default
    ]
    return shorten(f"{type(request).__name__}({', '.join(members)})", _MOST_READING)


def faults(command: HeardCommand, request: Request) -> list[str]:
    """What could not be read of a command, each in one sentence; call it when it was carried out,
    because what CONTROL looks for depends on its type."""
    if isinstance(request, Unknown):
        if not command.word:
            return ["there is no command word at the beginning of the line"]
        word = shorten(command.word)
        return [f"there is no command `{word}`{near(command.word, KNOWN_WORDS)}"]
    if isinstance(request, Ignored):
        return [f"{request.word} is accepted, and does nothing here"]
    found: list[str] = []
    if command.cut:
        found.append("the line has too many segments: the rest was thrown away")
    hearing = command.hearing
    seen: set[str] = set()
    for key, value in command.segments:
        if len(found) > MOST_FAULTS:
            break
        name = key.lower()
        known = name in hearing.asked or hearing.rest is not None
        if not known:
            if name not in seen:
                found.append(_unknown_key(command, key, value))
        elif name in seen and name not in hearing.repeated:
            found.append(f"{shorten(key)}: sent twice, the first one counts")
        else:
            read = hearing.asked.get(name) or hearing.rest
            found += [f"{shorten(key)}: {fault}" for fault in _unread(value, read)]
        seen.add(name)
    if len(found) > MOST_FAULTS:
        found[MOST_FAULTS:] = ["and more"]
    return found


def _unknown_key(command: HeardCommand, key: str, value: str) -> str:
    known = command.hearing.asked
    name = shorten(key)
    if not value and (cut := _glued(key, known)):
        return f"`{name}`: write a blank between `{cut}` and its value"
    hint = near(key, known)
    if not hint and known:
        keys = sorted(known)
        more = ", ..." if len(keys) > _MOST_KEYS else ""
        hint = f" (it knows {', '.join(keys[:_MOST_KEYS])}{more})"
    return f"{command.word} has no segment `{name}`{hint}"


def _glued(key: str, known: Collection[str]) -> str:
    """The name at the beginning of a word like `Left=0.5`, if it is a known one."""
    for mark in "=:,":
        head = key.partition(mark)[0]
        if head != key and head.lower() in known:
            return head
    return ""


def _unread(text: str, read: Callable[[str], object] | None) -> list[str]:
    """What is wrong with the text of a segment, given what read it."""
    shown = shorten(text)
    if read in (read_number, read_int):
        if not is_number(text):
            why = f"`{shown}` is not a number" if text else "it has no number"
            return [f"{why}, read as 0"]
        if abs(value := read_number(text)) >= MAX_MAGNITUDE:
            return [f"`{shown}` is out of range, read as {value:g}"]
        if read is read_int and value != int(value):
            return [f"`{shown}` is not a whole number, read as {int(value)}"]
    elif read is read_bool and not is_bool(text):
        return [f"`{shown}` is neither true nor false, read as false"]
    elif read is read_triple and text:
        parts = vector_parts(text)
        wrong = [part for part in parts[:3] if not is_number(part)]
        if wrong:
            return [f"`{shorten(wrong[0])}` is not a number, read as 0"]
        if len(parts) < 3:
            return [f"{len(parts)} of 3 numbers, the others are read as 0"]
    return []


def _plain(value: object) -> str:
    if isinstance(value, float):
        return f"{value:g}" if value != int(value) else f"{value:.1f}"
    if isinstance(value, str):
        return shorten(value)
    if isinstance(value, tuple):
        return "(" + ", ".join(_plain(one) for one in value[:16]) + ")"
    if isinstance(value, Mapping):
        pairs = list(value.items())[:16]
        return "{" + ", ".join(f"{shorten(str(k))}: {_plain(v)}" for k, v in pairs) + "}"
    if dataclasses.is_dataclass(value):
        members = [getattr(value, one.name) for one in dataclasses.fields(value)]
        return f"({', '.join(_plain(one) for one in members if one is not None)})"
    return shorten(str(getattr(value, "value", value)))


def shorten(text: str, most: int = _SHOWN) -> str:
    """A text of a client as one printable line of at most so many characters."""
    cut = text[:most]
    if not cut.isprintable():
        cut = "".join(one if one.isprintable() else "?" for one in cut)
    return cut if len(text) <= most else cut[: most - 3] + "..."
