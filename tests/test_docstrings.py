"""Docstrings name what exists: the attributes of their class, and modules of the product.

That `Args:` names parameters is ruff's rule DOC102.
"""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
FILES = sorted([*(ROOT / "usarsim_server").rglob("*.py"), *(ROOT / "tools").rglob("*.py")])
ROOMS = {path.stem for path in (ROOT / "usarsim_server").iterdir()}
PACKAGES = {path.name for path in (ROOT / "tools").iterdir()} | {"usarsim_server"}

GROUP = re.compile(r'^GROUP = "([\w.]+)"', re.MULTILINE)
SECTION = re.compile(r"^ *Attributes:\n((?:(?: {4,}\S.*)?\n)+)", re.MULTILINE)
ENTRY = re.compile(r"(?:^|[.;] )((?:\w+, )*\w+): ")
FILE_ENDINGS = (".py", ".jsonl", ".json.gz", ".toml", ".csv", ".xml")
CITED = re.compile(r"(?<!`)`((?:\w+\.)+\w+)`(?!`)")


@cache
def trees() -> dict[Path, ast.Module]:
    """The syntax of each file."""
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in FILES}


@cache
def classes() -> dict[str, ast.ClassDef]:
    """All classes of the product by name."""
    nodes = (node for tree in trees().values() for node in ast.walk(tree))
    return {node.name: node for node in nodes if isinstance(node, ast.ClassDef)}


def groups() -> set[str]:
    """Groups of entry points, which are named like modules."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    own = (name for path in FILES for name in GROUP.findall(path.read_text(encoding="utf-8")))
    return {*project["entry-points"], *own}


@cache
def members(node: ast.ClassDef) -> set[str]:
    """Names that a class and its bases in the product give to their objects."""
    found = set()
    for inner in ast.walk(node):
        match inner:
            case ast.FunctionDef() | ast.AsyncFunctionDef():
                found.add(inner.name)
            case ast.Attribute(value=ast.Name(id="self"), ctx=ast.Store()):
                found.add(inner.attr)
            case ast.Name(ctx=ast.Store()):
                found.add(inner.id)
    for base in node.bases:
        name = base.value if isinstance(base, ast.Subscript) else base
        word = name.attr if isinstance(name, ast.Attribute) else getattr(name, "id", "")
        if word in classes() and word != node.name:
            found |= members(classes()[word])
    return found


def documented(docstring: str) -> Iterator[str]:
    """Names that the section of attributes begins its lines with."""
    for section in SECTION.finditer(docstring + "\n"):
        lines = section[1].split("\n")
        least = len(lines[0]) - len(lines[0].lstrip())
        for line in lines:
            if len(line) - len(line.lstrip()) == least and (entry := ENTRY.match(line.strip())):
                yield from entry[1].split(", ")


def package_of(path: Path) -> str:
    """The package that a file belongs to."""
    parts = path.relative_to(ROOT).parts
    return parts[1] if parts[0] == "tools" else parts[0]


def module_exists(dotted: str) -> bool:
    """Whether a dotted name is a module, a folder or something that a module defines."""
    parts = dotted.split(".")
    if parts[0] in ROOMS:
        parts = ["usarsim_server", *parts]
    top = ROOT if parts[0] == "usarsim_server" else ROOT / "tools"
    folder = top
    for index, part in enumerate(parts):
        if (folder / f"{part}.py").is_file():
            return defines(folder / f"{part}.py", parts[index + 1 :])
        if not (folder / part).is_dir():
            return defines(folder / "__init__.py", parts[index:])
        folder /= part
    return True


def defines(path: Path, names: list[str]) -> bool:
    """Whether a module defines the first of these names (or none is asked for)."""
    if not names:
        return True
    return path.is_file() and any(
        names[0] in {getattr(node, "name", None), getattr(node, "id", None)}
        for node in ast.walk(trees()[path])
    )


def test_attributes_that_docstrings_name_exist() -> None:
    wrong = [
        f"{path.relative_to(ROOT)}:{node.lineno}: {node.name} has no {name!r}"
        for path, tree in trees().items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
        for name in documented(ast.get_docstring(node) or "")
        if name not in members(node)
    ]
    assert wrong == []


def test_modules_that_docstrings_name_exist() -> None:
    known = groups()
    wrong = [
        f"{path.relative_to(ROOT)}: there is no {cited!r}"
        for path in FILES
        for cited in CITED.findall(path.read_text(encoding="utf-8"))
        if cited.split(".")[0] in ROOMS | PACKAGES
        and cited not in known
        and not cited.endswith(FILE_ENDINGS)
        and not module_exists(cited)
        and not module_exists(f"{package_of(path)}.{cited}")
    ]
    assert wrong == []
