"""Looks through an MJCF or URDF file before MuJoCo reads it, which trusts whoever wrote it.

MuJoCo opens every file that a model names, copies what `<replicate>` says, and takes the memory
that a height field asks for. So the text, and that of all files it includes, is read here first:
what it names has to be regular files in allowed folders, and what it would grow into has a bound.
"""

from __future__ import annotations

import html
import math
import os
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from usarsim_server.base.errors import UsarsimError, at
from usarsim_server.base.files import Folders, is_regular, named, open_regular, read_regular, reason
from usarsim_server.base.toml import decoded

MAX_TEXT = 64 << 20
"""Bytes of one XML file; the scene of the largest imported map has 3 MB."""
MAX_FILES = 512 << 20
"""Bytes of all meshes and pictures that a model names."""
MAX_INCLUDES = 200
"""Files that bring in each other."""
MAX_DEPTH = 300
"""Elements within each other; MuJoCo reads them by recursion."""
MAX_ELEMENTS = 2_000_000
"""In all files together."""
MAX_COPIES = 5000
"""Elements made by `<replicate>`, `<composite>` and `<flexcomp>`. MuJoCo compiles 1,000 bodies in
0.1 s, 10,000 in 20 s."""
MAX_POINTS = 4096 * 4096
"""Of a height field; 9 million take 0.7 s and 130 MB."""
MAX_PIXELS = 64 << 20
"""Of a picture, as for maps."""
MAX_DETAIL = 100
"""Parameters of meshes that MuJoCo makes itself; work grows with their square at least."""
MAX_SLOTS = 10_000
"""Numbers that an element keeps for each state or user."""
MAX_SIDE = 16_384
"""Pixels along a side of what is drawn."""
MAX_MEMORY = 1 << 30
"""Bytes of the working memory that a file may ask for."""

ALLOW_MODEL = "copy it into the folder of the file that asks, or serve with --allow-outside"

_TOKEN = re.compile(
    r"<!--.*?-->|<!\[CDATA\[.*?\]\]>|<\?.*?\?>|<![^>]*>"
    r"|<(?P<end>/?)(?P<tag>[A-Za-z_][\w:.-]*)"
    r"(?P<attributes>(?:[^<>\"'/]++|/(?!>)|\"[^\"]*\"|'[^']*')*+)(?P<closed>/?)>",
    re.DOTALL,
)
_ATTRIBUTE = re.compile(r"([\w:.-]+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
_SCHEME = re.compile(r"^\w+://*")
_SIZES = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40, "P": 1 << 50, "E": 1 << 60}
_BOUNDS = {
    "actdim": MAX_SLOTS,
    "nsample": MAX_SLOTS,
    "num": MAX_SLOTS,
    "dim": MAX_SLOTS,
    "offwidth": MAX_SIDE,
    "offheight": MAX_SIDE,
    "shadowsize": MAX_SIDE,
    "numslices": MAX_DETAIL,
    "numstacks": MAX_DETAIL,
    "numquads": MAX_DETAIL,
}
"""Largest values of attributes that say how many there are of something."""
_PNG = b"\x89PNG\r\n\x1a\n"


def check_model(path: Path, folders: Folders, error: type[UsarsimError]) -> None:
    """Look through a model file and all that it includes.

    Args:
        path: of the file.
        folders: out of which it may read.
        error: what is raised.

    Raises:
        error: naming file, line and cure, if a file cannot be read, lies outside or is no regular
            file, or if the model would grow beyond a bound.
    """
    if not folders.admit(path):
        raise error(at(path, "is a link that leads out of its folder", ALLOW_MODEL))
    look = _Look(path.parent, folders, error, {str(path.parent)})
    look.through(path)
    look.check_files()


class _Element(NamedTuple):  # which is made faster than a dataclass: scenes have many
    """An element of a file."""

    path: Path  # of the file, and where in its text the element is
    text: str
    place: int
    tag: str  # with attributes, decoded
    attributes: dict[str, str]
    copies: float  # how many there will be of it

    @property
    def line(self) -> str:
        return f"line {self.text.count(chr(10), 0, self.place) + 1}"


@dataclass(slots=True)
class _Look:
    home: Path
    folders: Folders
    error: type[UsarsimError]
    places: set[str] = field(default_factory=set)  # folders that names may be relative to
    named: list[tuple[_Element, str]] = field(default_factory=list)
    seen: set[Path] = field(default_factory=set)
    admitted: dict[str, bool] = field(default_factory=dict)  # folders that may be read out of
    elements: int = 0
    copies: float = 0.0

    def through(self, path: Path) -> None:
        """One file, and those that it includes."""
        todo = [path]
        while todo:
            path = todo.pop()
            if path in self.seen:
                continue
            self.seen.add(path)
            if len(self.seen) > MAX_INCLUDES:
                raise self.error(at(path, f"more than {MAX_INCLUDES} files", "include fewer"))
            for element in self._elements(path):
                self._measure(element)
                for key, value in element.attributes.items():
                    if key.startswith("file"):
                        self.named.append((element, value))
                        if element.tag in ("include", "model"):
                            todo += map(Path, self._found(element, value))
                    elif key in ("meshdir", "texturedir", "assetdir"):
                        self.places.add(str(self.home / named(value)))

    def check_files(self) -> None:
        """All files that elements name: where they are, what they are, how large."""
        known: set[str] = set()
        total = 0
        for element, name in self.named:
            for path in self._found(element, name):
                if path not in known:
                    known.add(path)
                    total += self._size(element, path)
                if total > MAX_FILES:
                    problem = f"its files have more than {MAX_FILES >> 20} MiB"
                    raise self._refuse(element, problem, "simplify meshes and pictures")

    def _elements(self, path: Path) -> Iterator[_Element]:
        try:
            text = decoded(read_regular(path, MAX_TEXT), path, self.error)
        except OSError as cause:
            problem = f"cannot be read: {reason(cause)}"
            raise self.error(at(path, problem, "check the path and its rights")) from None
        above: list[float] = [1.0]
        for token in _TOKEN.finditer(text):
            tag = token["tag"]
            if tag is None:
                continue
            if token["end"]:
                above = above[:-1] or [1.0]
                continue
            attributes = {
                key: html.unescape(value or other)
                for key, value, other in _ATTRIBUTE.findall(token["attributes"])
            }
            element = _Element(path, text, token.start(), tag, attributes, above[-1])
            yield element
            if not token["closed"]:
                times = self._number(element, "count") if tag == "replicate" else 1.0
                above.append(above[-1] * max(1.0, times))
                if len(above) > MAX_DEPTH:
                    raise self._refuse(element, "elements nested too deeply", "nest them less")

    def _measure(self, element: _Element) -> None:
        """Count an element with its copies, and look at what it says about sizes."""
        self.elements += 1
        if element.tag in ("composite", "flexcomp"):
            self.copies += element.copies * self._product(element, "count")
            self.copies += self._product(element, "cellcount") - 1.0
        elif element.copies > 1.0:
            self.copies += element.copies
        if self.copies > MAX_COPIES or self.elements > MAX_ELEMENTS:
            most = MAX_ELEMENTS if self.elements > MAX_ELEMENTS else MAX_COPIES
            kind = "elements" if self.elements > MAX_ELEMENTS else "copies of elements"
            raise self._refuse(element, f"more than {most} {kind}", "build a smaller model")
        if element.tag == "hfield":
            points = self._number(element, "nrow") * self._number(element, "ncol")
            self._bound(element, "points of a height field", points, MAX_POINTS)
        if element.tag == "texture":
            pixels = self._number(element, "width") * self._number(element, "height")
            self._bound(element, "pixels", pixels, 6 * MAX_PIXELS)
        if element.tag == "mesh" and "params" in element.attributes:
            self._bound(element, "params", max(self._numbers(element, "params")), MAX_DETAIL)
        if not _BOUNDS.keys().isdisjoint(element.attributes):
            for key, most in _BOUNDS.items():
                self._bound(element, key, self._number(element, key, 0.0), most)
        if element.tag == "size":
            for key in element.attributes.keys() - {"memory"}:
                self._bound(element, key, self._number(element, key), 100 * MAX_SLOTS)
            self._bound(element, "memory", self._memory(element), MAX_MEMORY)

    def _numbers(self, element: _Element, key: str) -> list[float]:
        words = element.attributes.get(key, "").split()
        try:
            return [math.inf if math.isnan(float(word)) else float(word) for word in words] or [1.0]
        except ValueError:
            problem = f"{key} is {element.attributes[key][:60]!r}, no number"
            raise self._refuse(element, problem, "write a number") from None

    def _number(self, element: _Element, key: str, default: float = 1.0) -> float:
        return max(self._numbers(element, key)) if key in element.attributes else default

    def _product(self, element: _Element, key: str) -> float:
        return math.prod(max(1.0, number) for number in self._numbers(element, key))

    def _memory(self, element: _Element) -> float:
        text = element.attributes.get("memory", "").strip().upper()
        digits = text.rstrip("KMGTPE")
        if not digits.isdecimal() or len(digits) > 20:
            return 0.0 if text in ("", "-1") else math.inf
        return float(digits) * _SIZES.get(text[len(digits) :], math.inf)

    def _bound(self, element: _Element, what: str, value: float, most: int) -> None:
        if value > most:
            problem = f"{what}: {value:g} are more than {most}"
            raise self._refuse(element, problem, "write a smaller number")

    def _found(self, element: _Element, name: str) -> Iterator[str]:
        """Files that MuJoCo may mean, whatever the rules of its version; those outside are refused.

        Its rules: relative to the main file, in the folder of meshes or textures, without the
        folders written (`strippath`), without the scheme of a URDF file.
        """
        written = {name, name.strip(), re.split(r"[/\\]", name)[-1]}
        if _SCHEME.match(name):
            plain = _SCHEME.sub("", name)
            written |= {plain, "/" + plain}
        texts = {_tidy(named(text)) for text in written if text}
        places = {str(element.path.parent), *self.places}
        # Strings: of a scene of thousands of meshes, paths would be most of the work.
        for path in sorted({os.path.join(place, text) for place in places for text in texts}):
            if not _there(path):
                continue
            if not self._is_near(path):
                refusal = self.folders.refusal(path, element.path)
                if refusal is not None:
                    raise self._refuse(element, refusal, ALLOW_MODEL)
            yield os.path.normpath(path)

    def _is_near(self, path: str) -> bool:
        """Whether something that is no link lies right in a folder out of which may be read."""
        folder, name = os.path.split(path)
        if name in ("", ".", "..") or os.path.islink(path):
            return False
        admitted = self.admitted.get(folder)
        if admitted is None:
            admitted = self.admitted[folder] = self.folders.admit(folder)
        return admitted

    def _size(self, element: _Element, path: str) -> int:
        """Bytes of a file; what it grows into when it is a picture or a height field is bounded."""
        try:
            with open_regular(path) as file:
                head = file.read(24) if element.tag in ("texture", "hfield") else b""
                size = os.fstat(file.fileno()).st_size
        except OSError as cause:
            problem = f"{os.path.basename(path)} cannot be read: {reason(cause)}"
            raise self._refuse(element, problem, "name a regular file") from None
        if element.tag in ("texture", "hfield"):
            width, height = 0, 0
            if head.startswith(_PNG) and len(head) >= 24:
                width, height = struct.unpack_from(">II", head, 16)
            elif os.path.splitext(path)[1].lower() != ".ktx" and len(head) >= 8:
                width, height = struct.unpack_from("<II", head)  # MuJoCo's own formats
            most = MAX_POINTS if element.tag == "hfield" else MAX_PIXELS
            name = os.path.basename(path)
            self._bound(element, f"pixels of {name}", float(width) * height, most)
        return size

    def _refuse(self, element: _Element, problem: str, cure: str) -> UsarsimError:
        return self.error(at(element.path, problem, cure, where=element.line))


def _tidy(text: str) -> str:
    """A path without what changes nothing in it."""
    plain = text[0] != "." and text[-1] != "/" and "//" not in text and "/." not in text
    return text if plain else str(Path(text))


def _there(path: str) -> bool:
    """Whether something other than a folder has this name."""
    try:
        return is_regular(path) or (os.path.lexists(path) and not os.path.isdir(path))
    except (OSError, ValueError):
        return False
