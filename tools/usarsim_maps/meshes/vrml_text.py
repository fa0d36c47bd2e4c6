"""The classic syntax of VRML 2 and X3D (`.wrl`, `.x3dv`) as the tree that X3D has in XML.

Both hold the same nodes and fields. Values become the text that an XML attribute would hold, and
nodes become children, whatever field they stand in (ISO/IEC 14772-1, annex A; 19776-2).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from usarsim_maps.files import decode, read_bytes
from usarsim_maps.meshes.mesh_files import broken
from usarsim_maps.meshes.xml_text import MAX_DEPTH, MAX_ELEMENTS, Document, Node
from usarsim_server.base.errors import MapImportError, at

MAX_BYTES = 256 << 20

_TOKEN = re.compile(
    r'(?P<space>[\s,]+|#[^\n]*)|(?P<text>"(?:[^"\\]|\\.)*")|(?P<mark>[\[\]{}])'
    r"|(?P<word>[^\s,\[\]{}\"#]+)|(?P<other>.)",
    re.DOTALL,
)
_NAME = re.compile(r"[A-Za-z_]")
STATEMENTS = {
    "ROUTE": "ROUTE", "PROTO": "ProtoDeclare", "EXTERNPROTO": "ExternProtoDeclare",
    "IMPORT": "IMPORT", "EXPORT": "EXPORT",
}  # fmt: skip
"""Statements that show nothing, and their elements in XML."""

_VALUES = {"TRUE", "FALSE"}
_DECLARED = {"field", "exposedField", "eventIn", "eventOut", "inputOutput", "initializeOnly",
             "inputOnly", "outputOnly"}  # fmt: skip


def read_vrml(path: Path) -> Document:
    """Read a file; a `MapImportError` names the line of what is wrong."""
    text = decode(read_bytes(path, MAX_BYTES))
    if text.startswith("#VRML V1"):
        problem = "VRML 1 is not known"
        raise MapImportError(at(path, problem, "export it as VRML 2 (VRML97) or X3D"))
    return Document(path, _Parser(path, text).root())


class _Parser:
    """Reads one token after the other."""

    def __init__(self, path: Path, text: str) -> None:
        self._path = path
        self._tokens = self._cut(text)
        self._line = 1
        self._next = ""
        self._nodes = 0
        self._advance()

    def root(self) -> Node:
        """All nodes of the file, in one called Scene."""
        scene = Node("Scene", {}, 1)
        while self._next:
            if self._next in ("PROFILE", "COMPONENT", "META", "UNIT"):
                self._statement(scene)
            elif self._next in STATEMENTS:
                # A node of the same name: it is left out, as that of XML is, and counted.
                scene.children.append(Node(STATEMENTS[self._next], {}, self._line))
                self._skipped()
            else:
                scene.children.append(self._node(1))
        return scene

    def _cut(self, text: str) -> Iterator[tuple[str, int]]:
        line = 1
        for found in _TOKEN.finditer(text):
            token = found[0]
            if found.lastgroup == "other":
                raise self._error(f"{token!r} where a value should be", line)
            if found.lastgroup != "space":
                yield token, line
            line += token.count("\n")

    def _advance(self) -> str:
        token = self._next
        self._next, self._line = next(self._tokens, ("", self._line))
        return token

    def _take(self, count: int) -> list[str]:
        return [self._advance() for _ in range(count)]

    def _error(self, problem: str, line: int | None = None) -> MapImportError:
        where = f"line {self._line if line is None else line}"
        return broken(self._path, problem, where)

    def _expect(self, mark: str) -> None:
        if self._next != mark:
            raise self._error(f"{self._next[:40]!r} instead of {mark!r}")
        self._advance()

    def _statement(self, scene: Node) -> None:
        """Of the head of an X3D file; only the unit of length has a meaning here."""
        word, line = self._advance(), self._line
        count = {"PROFILE": 1, "COMPONENT": 1, "META": 2, "UNIT": 3}[word]
        values = self._take(count)
        if word == "UNIT":
            facts = {"category": values[0], "conversionFactor": values[2]}
            scene.children.append(Node("unit", facts, line))

    def _skipped(self) -> bool:
        """Pass over a route or a prototype; True if there was one."""
        word = self._next
        match word:
            case "ROUTE":
                self._take(4)
            case "PROTO" | "EXTERNPROTO":
                self._take(2)
                self._block()
                self._block()  # of addresses, or one address; of a body
            case "IMPORT" | "EXPORT":
                self._take(2)
                self._take(2 if self._next == "AS" else 0)
            case _:
                return False
        return True

    def _block(self) -> None:
        """Pass over everything between two brackets, or over one value."""
        depth = 0
        while self._next:
            token = self._advance()
            depth += (token in ("[", "{")) - (token in ("]", "}"))
            if depth <= 0:
                return

    def _node(self, depth: int) -> Node:
        self._nodes += 1
        if depth > MAX_DEPTH or self._nodes > MAX_ELEMENTS:
            raise self._error("too many or too deeply nested nodes")
        line, name = self._line, ""
        if self._next == "USE":
            self._advance()
            return Node("USE", {"USE": self._advance()}, line)
        if self._next == "DEF":
            self._advance()
            name = self._advance()
        tag = self._advance()
        if not _NAME.match(tag):
            raise self._error(f"{tag[:40]!r} is no node", line)
        node = Node(tag, {"DEF": name} if name else {}, line)
        self._expect("{")
        while self._next != "}":
            if not self._next:
                raise self._error(f"the file ends inside {tag}")
            if not self._skipped():
                self._field(node, depth)
        self._advance()
        return node

    def _field(self, node: Node, depth: int) -> None:
        name = self._advance()
        if name in _DECLARED:  # of a script: type and name
            self._advance()
            name = self._advance()
            if not self._is_value():
                return
        if self._next == "IS":
            self._take(2)
        elif self._next == "[":
            self._advance()
            values = []
            while self._next != "]":
                if not self._next:
                    raise self._error(f"the file ends inside {name[:40]}")
                if self._is_node():
                    node.children.append(self._node(depth + 1))
                else:
                    values.append(self._advance())
            self._advance()
            node.attributes[name] = " ".join(values)
        elif self._next == "NULL":
            self._advance()
        elif self._is_node():
            node.children.append(self._node(depth + 1))
        else:
            values = []
            while self._is_value():
                values.append(self._advance())
            node.attributes[name] = " ".join(values)

    def _is_node(self) -> bool:
        return bool(_NAME.match(self._next)) and self._next not in _VALUES

    def _is_value(self) -> bool:
        return self._next not in ("", "[", "]", "{", "}") and not self._is_node()
