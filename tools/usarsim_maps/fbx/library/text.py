"""FBX as text: brought into UTF-8 for the library, and looked through for what it does not tell.

The library reads a file that ends between two sections, or after a bracket too many, without a
word, and where text is faulty it does not say in which line.
"""

from __future__ import annotations

import io
import re
from enum import Enum
from pathlib import Path

from usarsim_maps.files import decode
from usarsim_maps.meshes.mesh_files import broken
from usarsim_maps.numbers import read_number
from usarsim_server.base.errors import MapImportError

BINARY = b"Kaydara FBX Binary"

MAX_DEPTH = 200
"""Brackets within brackets; exporters need some ten."""

_PLAIN = b"0123456789.,+-eE \t\n"
_TOKEN = re.compile(rb'"[^"]*(?:"|$)|[{}:,]|;.*|[^\s{}:,";]+')
_LIST = re.compile(rb"\s*(\w+):(?=[^:{}\"]*$)")
_ARRAYS = frozenset(
    b"a Vertices PolygonVertexIndex Edges Normals Binormals Tangents UV UVIndex Colors ColorIndex "
    b"Materials TextureId Indexes Weights Transform TransformLink Matrix".split()
)
"""Nodes whose values are numbers."""


class _State(Enum):
    """What stood last."""

    BRACKET = "a bracket, or nothing"
    NAME = "the name of a node"
    VALUE = "a value"
    COMMA = "a comma"


def is_binary(content: bytes) -> bool:
    """Whether it is binary FBX."""
    return content.startswith(BINARY)


def plain_text(content: bytes) -> bytes:
    """Text in UTF-8 without a mark, with LF at the ends of lines."""
    if not content.isascii() or b"\0" in content:
        content = decode(content).encode("utf-8", "replace")
    return content.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in content else content


def check_text(source: Path, content: bytes, *, closely: bool = False) -> None:
    """Refuse text that is no sound FBX, by a `MapImportError` with the line.

    Args:
        source: the file, for errors.
        content: of `plain_text`.
        closely: look at every number, too, which takes longer.
    """
    scan = _Scan(source, closely)
    for line in io.BytesIO(content):
        scan.take(line)
    scan.end()


class _Scan:
    """Goes through a text line by line."""

    def __init__(self, source: Path, closely: bool) -> None:
        self._source = source
        self._closely = closely
        self._number = 0
        self._state = _State.BRACKET
        self._inside: list[bytes] = []
        self._name = b""
        self._quoted = False
        self._top: set[bytes] = set()
        self._shows_something = False

    def take(self, line: bytes) -> None:
        """The next line."""
        self._number += 1
        if self._quoted:
            _, mark, line = line.partition(b'"')
            if not mark:
                return
            self._quoted = False
        named = _LIST.match(line)
        if named is not None and not line[named.end() :].translate(None, _PLAIN):
            self._begin(named[1])
            line = line[named.end() :]
        if line.translate(None, _PLAIN):
            self._structure(line)
        else:
            self._numbers(line.strip())

    def end(self) -> None:
        """The text is over."""
        if self._inside or self._quoted:
            place = (self._inside or [self._name])[-1].decode("utf-8", "replace")
            raise self._wrong(f"the file ends within {place[:40]!r}")
        if self._shows_something and b"Connections" not in self._top:
            raise self._wrong("the file ends before its connections")

    def _wrong(self, problem: str) -> MapImportError:
        return broken(self._source, problem, max(1, self._number))

    def _out_of_place(self, word: bytes) -> MapImportError:
        text = word.decode("utf-8", "replace")
        return self._wrong(f"{text[:40]!r} after {self._state.value}")

    def _begin(self, name: bytes) -> None:
        """A node of this name."""
        if self._inside == [b"Objects"] and name in (b"Model", b"Geometry"):
            self._shows_something = True
        self._name, self._state = name, _State.NAME

    def _numbers(self, line: bytes) -> None:
        """A line of nothing but numbers and commas."""
        if not line:
            return
        if self._state is _State.BRACKET:
            raise self._out_of_place(line.partition(b",")[0] or b",")
        if b",," in line or (line.startswith(b",") and self._state is _State.COMMA):
            raise self._wrong("a comma after a comma")
        words = line.strip(b",").split(b",") if self._closely and line != b"," else []
        for word in words:
            self._check_number(word.strip())
        self._state = _State.COMMA if line.endswith(b",") else _State.VALUE

    def _check_number(self, word: bytes) -> None:
        try:
            read_number(word.decode("latin-1"))
        except ValueError:
            text = word.decode("utf-8", "replace")
            raise self._wrong(f"{text[:40]!r} is no number") from None

    def _structure(self, line: bytes) -> None:
        tokens = _TOKEN.findall(line)
        for number, token in enumerate(tokens):
            first = token[:1]
            if first == b";":
                break
            match token:
                case b"{":
                    if self._state is _State.BRACKET:
                        raise self._out_of_place(token)
                    if not self._inside:
                        self._top.add(self._name)
                    self._inside.append(self._name)
                    self._state = _State.BRACKET
                    if len(self._inside) > MAX_DEPTH:
                        raise self._wrong(f"more than {MAX_DEPTH} brackets within brackets")
                case b"}":
                    if not self._inside:
                        raise self._wrong("a bracket is closed that was never opened")
                    self._inside.pop()
                    self._state = _State.BRACKET
                case b",":
                    if self._state in (_State.BRACKET, _State.COMMA):
                        raise self._out_of_place(token)
                    self._state = _State.COMMA
                case b":":
                    self._state = _State.NAME
                case _ if first != b'"' and tokens[number + 1 : number + 2] == [b":"]:
                    self._begin(token)
                case _:
                    if self._state in (_State.BRACKET, _State.VALUE):
                        raise self._out_of_place(token)
                    if self._name in _ARRAYS and first != b"*":
                        self._check_number(token)
                    self._quoted = first == b'"' and (len(token) == 1 or token[-1:] != first)
                    self._state = _State.VALUE
