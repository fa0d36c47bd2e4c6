"""The walls between the rooms: who may import whom.

import-linter follows chains of imports through the contracts in pyproject.toml; what it cannot say
stands here: no cycles, no packages from outside in the strict rooms, sockets in few places.
"""

from __future__ import annotations

import ast
import logging
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest
from importlinter.cli import lint_imports

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "usarsim_server"
TOOLS = ROOT / "tools"
CONTRACTS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"][
    "contracts"
]

FOREIGN: dict[str, set[str]] = {
    "protocol": {"numpy"},
    "simulation": {"numpy", "mujoco", "embreex"},
    "services": set(),
}
"""Packages from outside that the stricter rooms may import, beside the standard library."""

SOCKETS = {"asyncio", "selectors", "select", "socket", "socketserver", "ssl"}
WITH_SOCKETS = {"services", "scene", "app", "doctor", "testing", "cli"}


def modules(folder: Path) -> list[Path]:
    """All Python files below a folder."""
    return sorted(folder.rglob("*.py"))


def module_name(path: Path) -> str:
    """Full name of the module in a file."""
    top = TOOLS if TOOLS in path.parents else ROOT
    return ".".join(path.relative_to(top).with_suffix("").parts).removesuffix(".__init__")


def room_of(path: Path) -> str:
    """The room that a file of the server belongs to; empty for the package's own `__init__`."""
    first = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    return "" if first == "__init__" else first


def imported(tree: ast.AST, *, later: bool = True) -> Iterator[str]:
    """Full names of all modules that a program imports.

    Args:
        tree: of the program, or of a part of it.
        later: with those that are imported when a function is called, or for types only.
    """
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports hide where they lead"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif later or not (
            isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
            or (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
        ):
            yield from imported(node, later=later)


@cache
def parsed(path: Path) -> ast.Module:
    """The program in a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


def tops_imported(path: Path) -> set[str]:
    """Top-level packages that a file imports directly."""
    return {name.split(".")[0] for name in imported(parsed(path))}


def lint(config: Path = ROOT / "pyproject.toml") -> int:
    """Exit status of import-linter for all contracts; it prints which are broken."""
    return lint_imports(config_filename=str(config), no_cache=True)


@pytest.fixture
def loggers_live_on() -> Iterator[None]:
    """import-linter configures logging and silences every logger that exists; undo that."""
    yield
    for logger in logging.Logger.manager.loggerDict.values():
        if isinstance(logger, logging.Logger):
            logger.disabled = False


@pytest.mark.usefixtures("loggers_live_on")
class TestContracts:
    """Chains of imports, by import-linter."""

    def test_walls_hold(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """No import, direct or through others, leads through the wall."""
        monkeypatch.chdir(ROOT)
        monkeypatch.syspath_prepend(str(TOOLS))
        assert lint() == 0

    def test_the_linter_would_notice(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """A wall where there is a door is reported: the contracts can fail."""
        config = tmp_path / "wrong.toml"
        config.write_text(
            "[tool.importlinter]\n"
            'root_packages = ["usarsim_server"]\n'
            "include_external_packages = true\n"
            "[[tool.importlinter.contracts]]\n"
            'id = "wrong"\nname = "Sensors know no physics"\ntype = "forbidden"\n'
            'source_modules = ["usarsim_server.sensors"]\nforbidden_modules = ["mujoco"]\n'
        )
        monkeypatch.chdir(ROOT)
        assert lint(config) == 1

    def test_exceptions_are_few(self) -> None:
        """Films overlook a wall, and some files import in a circle; the lists may only get
        shorter. The linter reports an exception that is none any more."""
        overlooked = {
            one["id"]: one["ignore_imports"] for one in CONTRACTS if "ignore_imports" in one
        }
        circles = overlooked.pop("cycles")
        assert len(circles) <= 50
        assert overlooked == {
            "outside": [
                "usarsim_operator.film.** -> usarsim_server.**",
                "usarsim_operator.film.** -> mujoco",
            ]
        }

    def test_every_room_has_walls(self) -> None:
        """Each folder and module of the server stands in the contracts; enter a new one there."""
        protocol = next(one for one in CONTRACTS if one["id"] == "protocol")
        walled = {name.removeprefix("usarsim_server.") for name in protocol["forbidden_modules"]}
        assert {room_of(path) for path in modules(PACKAGE)} <= walled | {"", "protocol", "__main__"}


class TestImports:
    """What the contracts cannot say."""

    def test_no_cycles(self) -> None:
        """No module is imported by those that it imports, in the server or beside it."""
        files = {module_name(path): path for top in (PACKAGE, TOOLS) for path in modules(top)}
        graph = {
            name: {
                one if one in files else one.rpartition(".")[0]
                for one in imported(parsed(path), later=False)
            }
            - {name}
            for name, path in files.items()
        }
        try:
            TopologicalSorter(graph).prepare()
        except CycleError as error:
            pytest.fail(" imports ".join(reversed(error.args[1])))

    @pytest.mark.parametrize("room", sorted(FOREIGN))
    def test_strict_rooms_need_few_packages(self, room: str) -> None:
        """The stricter rooms import nothing from outside but what the table allows."""
        allowed = FOREIGN[room] | set(sys.stdlib_module_names) | {"usarsim_server"}
        for path in modules(PACKAGE):
            if room_of(path) == room:
                strangers = tops_imported(path) - allowed
                assert not strangers, f"{path.relative_to(ROOT)} imports {sorted(strangers)}"

    def test_sockets_stay_where_they_belong(self) -> None:
        """Only services, what they show, and what puts them together or tests them know asyncio."""
        for path in modules(PACKAGE):
            if room_of(path) not in WITH_SOCKETS:
                assert not tops_imported(path) & SOCKETS, path.relative_to(ROOT)

    def test_hidden_imports_are_seen(self) -> None:
        """The reader of imports finds them inside functions and conditions, too."""
        tree = ast.parse("import a.b\nif x:\n    from c import d, e\ndef f():\n    import g as h\n")
        assert set(imported(tree)) == {"a.b", "c.d", "c.e", "g"}
        assert set(imported(tree, later=False)) == {"a.b", "c.d", "c.e"}

    def test_the_package_imports_nothing(self) -> None:
        """`import usarsim_server` loads no other module of ours."""
        program = (
            "import usarsim_server, sys; print([m for m in sys.modules if m[:8] == 'usarsim_'])"
        )
        assert answer(program) == "['usarsim_server']"

    @pytest.mark.parametrize(
        ("room", "heavy"),
        [
            ("protocol", ("mujoco", "asyncio", "socket", "embreex")),
            ("services", ("mujoco", "embreex")),
            ("settings", ("mujoco", "asyncio", "embreex")),
        ],
    )
    def test_importing_a_room_loads_nothing_heavy(self, room: str, heavy: tuple[str, ...]) -> None:
        """A fresh interpreter can import a whole room without loading what it must not know."""
        names = [module_name(path) for path in modules(PACKAGE) if room_of(path) == room]
        program = (
            "import importlib, sys\n"
            f"for name in {names!r}: importlib.import_module(name)\n"
            f"print([name for name in {heavy!r} if name in sys.modules])"
        )
        assert answer(program) == "[]"


def answer(program: str) -> str:
    """What a program prints in a fresh interpreter."""
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, check=True
    ).stdout.strip()
