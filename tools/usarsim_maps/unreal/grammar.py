"""The grammar of T3D: nested blocks, properties, polygon lines (worlds reference 4.1).

Sans-IO: text in, blocks out. Keywords and keys are compared without case; the text may end lines
as it likes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

MAX_DEPTH = 64
MAX_LINES = 20_000_000
HUGE = 1e12

Value = str | Mapping[str, "Value"]
"""A word, number or text; or a struct."""

_ATTRIBUTE = re.compile(r'([\w()]+)\s*=\s*("[^"]*"|\S+)')
_REFERENCE = re.compile(r"^\s*(?:[\w.]+)?'([^']*)'\s*$")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_NOTHING = re.compile(r"[-+]?\d\.#\w+")
_DECIMAL = re.compile(r"[-+]?\d+,\d+")


class T3dError(ValueError):
    """The text is no T3D; says the line."""

    def __init__(self, line: int, problem: str) -> None:
        super().__init__(problem)
        self.line = line


@dataclass(slots=True)
class Block:
    """`Begin Kind a=b ... End Kind`."""

    kind: str  # lower case
    line: int  # of its `Begin`
    attributes: dict[str, str] = field(default_factory=dict)
    """Of the `Begin` line; keys in lower case."""
    properties: dict[str, str] = field(default_factory=dict)
    """`Key=Value` lines, keys in lower case; the last one wins."""
    children: list[Block] = field(default_factory=list)  # blocks inside, in order
    lines: list[tuple[int, str]] = field(default_factory=list)
    """All other lines, as (line number, text)."""

    def inner(self, kind: str) -> Iterator[Block]:
        """Children of a kind (lower case)."""
        return (child for child in self.children if child.kind == kind)

    def text(self, key: str) -> str:
        """A property (lower case key), as text without quotes; empty if it is missing."""
        return unquote(self.properties.get(key, ""))

    def __contains__(self, key: object) -> bool:
        return key in self.properties

    def vector(self, key: str, default: float = 0.0) -> tuple[float, float, float]:
        """`(X=1,Y=2,Z=3)`; members that are missing have the default."""
        x, y, z = _members(self.properties.get(key, ""), ("x", "y", "z"), default)
        return x, y, z

    def rotator(self, key: str) -> tuple[float, float, float]:
        """`(Pitch=1,Yaw=2,Roll=3)` in rotation units."""
        pitch, yaw, roll = _members(self.properties.get(key, ""), ("pitch", "yaw", "roll"), 0.0)
        return pitch, yaw, roll

    def number(self, key: str, default: float) -> float:
        """A numeric property; the default where it is missing or no number."""
        return _leading(self.properties.get(key, "").strip(), default)

    def flag(self, key: str, default: bool) -> bool:
        """A boolean property."""
        text = self.text(key).strip().lower()
        return default if not text else text in ("true", "1", "yes")


def unquote(text: str) -> str:
    """Text without the quotes around it."""
    text = text.strip()
    return text[1:-1] if len(text) >= 2 and text[0] == text[-1] == '"' else text


def parse(text: str, progress: Callable[[float], None] = lambda part: None) -> Block:
    """A block without kind that holds everything at the top of the text.

    Raises:
        T3dError: a block does not end, or ends that has not begun, or is nested too deeply.
    """
    root = Block("", 0)
    open_blocks = [root]
    total = text.count("\n") + 1
    if total > MAX_LINES:
        raise T3dError(MAX_LINES, f"more than {MAX_LINES} lines")
    number = 0
    for number, raw in enumerate(text.split("\n"), start=1):
        line = raw.strip()
        if not line:
            continue
        if number % 50_000 == 0:
            progress(number / total)
        word = line[:6].lower()
        if word.startswith("begin") and line[5:6] in (" ", "\t"):
            if len(open_blocks) > MAX_DEPTH:
                raise T3dError(number, f"blocks are nested more than {MAX_DEPTH} deep")
            block = _begin(line, number)
            open_blocks[-1].children.append(block)
            open_blocks.append(block)
        elif word.startswith("end") and line[3:4] in (" ", "\t", ""):
            _end(line[3:].strip().lower(), open_blocks, number)
        else:
            _content(open_blocks[-1], line, number)
    if len(open_blocks) > 1:
        block = open_blocks[-1]
        raise T3dError(
            number, f"the file ends inside `Begin {block.kind.title()}` of line {block.line}"
        )
    return root


def _begin(line: str, number: int) -> Block:
    kind, _, rest = line[5:].strip().partition(" ")
    block = Block(kind.strip().lower(), number)
    for key, value in _ATTRIBUTE.findall(rest):
        block.attributes[key.lower()] = unquote(value)
    if "=" not in rest and rest.strip():
        block.lines.append((number, rest.strip()))
    return block


def _end(kind: str, open_blocks: list[Block], number: int) -> None:
    kind = kind.split(" ")[0]
    block = open_blocks[-1]
    if len(open_blocks) > 1 and (block.kind == kind or not kind):
        open_blocks.pop()
    elif any(other.kind == kind for other in open_blocks[1:]):
        raise T3dError(
            number,
            f"`End {kind.title()}` comes before the end of `Begin {block.kind.title()}` of line "
            f"{block.line}",
        )
    # An end of what never began is left behind by some editors; nothing depends on it.


def _content(block: Block, line: str, number: int) -> None:
    if block.kind not in ("polygon", "triangle"):
        key, equals, value = line.partition("=")
        if equals and key.strip() and " " not in key.strip():
            block.properties[key.strip().lower()] = value.strip()
            return
    block.lines.append((number, line))


def numbers(text: str) -> list[float]:
    """All numbers in a text, such as `+00375.000000,-1,2e3`; `1.#IND` is a huge one."""
    return [finite(found) for found in _NUMBER.findall(_NOTHING.sub(str(HUGE), text))]


def finite(text: str) -> float:
    """A number, huge ones cut down to something that can be calculated with."""
    return min(max(float(text), -HUGE), HUGE)


def _leading(text: str, default: float) -> float:
    """The number that a text begins with, as Unreal reads it; the default for `1.#IND`."""
    if _DECIMAL.fullmatch(text):
        text = text.replace(",", ".")
    found = _NUMBER.match(text)
    return default if found is None or _NOTHING.match(text) else finite(found[0])


def value_of(text: str) -> Value:
    """A property's value: `(X=1,Y=(A=2))` becomes a mapping with lower-case keys.

    In `(X=1,5,Y=2)` the first comma is that of a decimal number.
    """
    text = text.strip()
    if not text.startswith("("):
        return unquote(text)
    result: dict[str, Value] = {}
    last = ""
    for item in _items(text[1:-1] if text.endswith(")") else text[1:]):
        key, equals, inner = item.partition("=")
        if equals:
            nested = inner.strip()
            last = key.strip().lower()
            result[last] = value_of(nested) if nested.count("(") < MAX_DEPTH else nested
        elif _DECIMAL.fullmatch(f"{result.get(last, '')},{item.strip()}"):
            result[last] = f"{result[last]},{item.strip()}"
    return result


def _items(text: str) -> Iterator[str]:
    """Parts between commas that are not inside brackets."""
    depth, start = 0, 0
    for index, character in enumerate(text):
        if character == "(":
            depth += 1
        elif character == ")":
            depth -= 1
        elif character == "," and depth <= 0:
            yield text[start:index]
            start = index + 1
    yield text[start:]


def _members(text: str, keys: tuple[str, str, str], default: float) -> list[float]:
    value = value_of(text)
    if isinstance(value, str):
        return [default] * 3
    found = []
    for key in keys:
        member = value.get(key, "")
        found.append(_leading(member.strip(), default) if isinstance(member, str) else default)
    return found


def reference(text: str) -> str:
    """The path in `Class'Package.Group.Name'`; empty for None."""
    match = _REFERENCE.match(text)
    path = match[1] if match else unquote(text)
    return "" if path.lower() == "none" else path
