"""XML of unknown origin: a light tree with line numbers, without entities, of bounded size.

The tolerant form mends what exporters of the leagues' maps got wrong (worlds reference 7): bytes
that are not UTF-8, `<` and stray `&` inside attributes, control characters.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np

from usarsim_maps.files import decode, read_bytes
from usarsim_maps.findings import Findings
from usarsim_maps.meshes.mesh_files import CURE, broken
from usarsim_maps.numbers import read_numbers, read_whole
from usarsim_maps.scene import Array, Integers
from usarsim_server.base.errors import MapImportError, at

MAX_BYTES = 512 << 20
MAX_DEPTH = 300
MAX_ELEMENTS = 3_000_000

FAR = 1e9
"""Larger numbers in a pose, a size or a colour have no meaning."""


_DECLARED = re.compile(rb"<\?xml[^>]{0,200}?encoding\s*=\s*[\"']([A-Za-z0-9._-]{1,40})[\"']")
_CONTROL = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff\ud800-\udfff]")
_STRAY = re.compile(r"&(?!(?:#\d{1,7}|#x[0-9A-Fa-f]{1,6}|amp|lt|gt|quot|apos);)")
_ATTRIBUTE = re.compile(r"(\s[\w:.\-]+\s*=\s*)(\"[^\"]*\"|'[^']*')")


class Node:
    """An element."""

    __slots__ = ("attributes", "children", "line", "tag", "text")

    def __init__(self, tag: str, attributes: dict[str, str], line: int) -> None:
        self.tag = tag  # without namespace prefix
        self.attributes = attributes  # as written, without namespace declarations
        self.text = ""  # of the element itself, stripped
        self.children: list[Node] = []  # elements inside
        self.line = line  # where it begins

    def get(self, attribute: str, default: str = "") -> str:
        """An attribute."""
        return self.attributes.get(attribute, default)

    def all(self, tag: str) -> Iterator[Node]:
        """Children with a tag."""
        return (child for child in self.children if child.tag == tag)

    def child(self, *path: str) -> Node | None:
        """The first child with a tag, the first child of that with the next tag, and so on."""
        node: Node | None = self
        for tag in path:
            node = None if node is None else next(node.all(tag), None)
        return node

    def word(self, *path: str, default: str = "") -> str:
        """The text of a child."""
        found = self.child(*path)
        return default if found is None else found.text

    def walk(self) -> Iterator[Node]:
        """This element and everything inside, in the order of the file."""
        todo = [self]
        while todo:
            node = todo.pop()
            yield node
            todo.extend(reversed(node.children))


@dataclass(frozen=True, slots=True)
class Document:
    """A file; numbers that make no sense where there must be some are a `MapImportError`."""

    path: Path  # of the file
    root: Node  # its outermost element
    comments: tuple[tuple[int, str], ...] = ()  # texts of all comments, with their lines
    # told of numbers that make no sense
    findings: Findings = field(default_factory=Findings, compare=False)

    def error(self, node: Node | None, problem: str, cure: str = CURE) -> MapImportError:
        """An error that names file and line."""
        where = None if node is None else f"line {node.line}"
        return MapImportError(at(self.path, problem, cure, where=where))

    def note(self, node: Node, text: str) -> None:
        """Tell in the report what is wrong with an element, and what was done about it."""
        self.findings.warn(self.path.name, f"line {node.line}: {text}")

    def vector(self, node: Node | None, *counts: int, far: float = FAR) -> Array | None:
        """The few numbers of an element; None, and a note unless it is missing, if they are bad.

        There may be as many numbers as one of the counts, ascending. Of more the first ones count,
        as for programs that stop reading when they have enough. Those beyond `far` have no meaning.
        """
        if node is None:
            return None
        try:
            values = read_numbers(node.text, *counts)
        except ValueError as error:
            self.note(node, f"{error}; this <{node.tag}> was left out")
            return None
        shown = f"<{node.tag}> of {node.text[:60]!r}"
        count = max((count for count in counts if count <= len(values)), default=0)
        if not count:
            self.note(node, f"{shown} has too few numbers; left out")
            return None
        if len(values) > count:
            self.note(node, f"of the {len(values)} numbers of {shown} the first {count} count")
        answer = np.array(values[:count])
        if not (np.abs(answer) < far).all():
            self.note(node, f"{shown} has a number without meaning; left out")
            return None
        return answer

    def vector_or(self, node: Node | None, default: Array, *counts: int, far: float = FAR) -> Array:
        """As `vector`, with a default for what is missing or bad."""
        found = self.vector(node, *counts, far=far)
        return default if found is None else found

    def number(self, node: Node | None, far: float = FAR) -> float | None:
        """The number of an element, as `vector`."""
        found = self.vector(node, 1, far=far)
        return None if found is None else float(found[0])

    def floats(self, node: Node) -> Array:
        """All numbers of a long list, those that are none as NaN."""
        try:
            return np.array(node.text.split(), dtype=float)
        except ValueError:
            pass
        try:
            count = node.get("count")
            return np.array(read_numbers(node.text, *([int(count)] if count.isdigit() else [])))
        except ValueError as error:
            raise self.error(node, f"{error}"[:120]) from None

    def integers(self, node: Node) -> Integers:
        """All whole numbers in the text of an element; `3.0` is one, too."""
        words = node.text.split()
        try:
            return np.array(words, dtype=np.int64)
        except (ValueError, OverflowError):
            pass
        try:
            return np.array([read_whole(word) for word in words], dtype=np.int64)
        except (ValueError, OverflowError) as error:
            raise self.error(node, f"{error}"[:120]) from None


def read_xml(
    path: Path,
    *,
    tolerant: bool = False,
    limit: int = MAX_BYTES,
    findings: Findings | None = None,
) -> Document:
    """Read a file of at most `limit` bytes; a `MapImportError` names the line of what is wrong.

    If tolerant, common faults are mended instead. The findings are told later on of numbers that
    make no sense.
    """
    text = _text(read_bytes(path, limit))
    findings = findings or Findings()
    try:
        return _parse(path, text, findings)
    except expat.ExpatError as error:
        problem = f"not sound XML: {expat.ErrorString(error.code)}"
        where = f"line {error.lineno}"
        if tolerant:
            try:
                return _parse(path, _mended(text), findings)
            except expat.ExpatError:
                pass
        raise broken(path, problem, where) from None


def _text(content: bytes) -> str:
    """By the declared encoding if it fits, else by looking."""
    declared = _DECLARED.match(content[:300].lstrip(b"\xef\xbb\xbf \t\r\n"))
    if declared is not None and declared[1].lower() not in (b"utf-8", b"utf-16"):
        try:
            return content.decode(declared[1].decode("ascii"))
        except (LookupError, UnicodeDecodeError):
            pass
    return decode(content)


def _mended(text: str) -> str:
    text = _STRAY.sub("&amp;", _CONTROL.sub("", text))
    return _ATTRIBUTE.sub(lambda found: found[1] + found[2].replace("<", "&lt;"), text)


def _parse(path: Path, text: str, findings: Findings) -> Document:
    # The text is Unicode already, whatever the declaration says.
    parser = expat.ParserCreate("utf-8")
    parser.buffer_text = True
    builder = _Builder(path, parser)
    parser.Parse(text.lstrip("\ufeff \t\r\n").encode("utf-8", "replace"), True)
    assert builder.root is not None  # expat refuses files without an element
    return Document(path, builder.root, tuple(builder.comments), findings)


class _Builder:
    """Makes nodes out of expat's events."""

    def __init__(self, path: Path, parser: expat.XMLParserType) -> None:
        self.root: Node | None = None
        self.comments: list[tuple[int, str]] = []
        self._path = path
        self._parser = parser
        self._open: list[Node] = []
        self._texts: list[list[str]] = []
        self._count = 0
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._data
        parser.CommentHandler = self._comment
        parser.StartDoctypeDeclHandler = self._doctype

    def _refuse(self, problem: str, cure: str) -> MapImportError:
        line = self._parser.CurrentLineNumber
        return MapImportError(at(self._path, problem, cure, where=f"line {line}"))

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._count += 1
        if self._count > MAX_ELEMENTS or len(self._open) >= MAX_DEPTH:
            raise self._refuse("too many or too deeply nested elements", "split the map")
        node = Node(tag.rpartition(":")[2], attributes, self._parser.CurrentLineNumber)
        if self._open:
            self._open[-1].children.append(node)
        else:
            self.root = node
        self._open.append(node)
        self._texts.append([])

    def _end(self, tag: str) -> None:
        self._open.pop().text = "".join(self._texts.pop()).strip()

    def _data(self, text: str) -> None:
        if self._texts:
            self._texts[-1].append(text)

    def _comment(self, text: str) -> None:
        self.comments.append((self._parser.CurrentLineNumber, text))

    def _doctype(self, *_: object) -> None:
        cure = "remove the DOCTYPE and its entities"
        raise self._refuse("document types and entities are not read", cure)
