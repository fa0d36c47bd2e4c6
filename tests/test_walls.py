"""The walls between the rooms: who may import whom.

Two guards: import-linter follows chains of imports (contracts in pyproject.toml), and a table here
lists for every room what it may import directly. A new room has to be entered into the table.
"""

from __future__ import annotations

import ast
import logging
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from importlinter.cli import lint_imports

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "usarsim_server"
TOOLS = ROOT / "tools" / "usarsim_tools"

VALUES = {"atomic", "errors", "files", "logs", "data", "model_check", "plugins", "tables"}
MIDDLE = {
    "protocol",
    "simulation",
    "worlds",
    "robots",
    "sensors",
    "actuators",
    "control",
    "cameras",
    "radio",
}
ROOMS: dict[str, set[str]] = {
    "atomic": set(),
    "errors": set(),
    "interrupts": set(),
    "files": set(),
    "model_check": {"errors", "files"},
    "logs": set(),
    "processes": set(),
    "data": set(),
    "plugins": {"errors", "logs"},
    "tables": {"errors", "files"},
    "protocol": set(),
    "options": {"errors", "files", "logs", "protocol"},
    "settings": {"errors", "files", "options", "protocol", "tables"},
    "simulation": {"errors", "logs"},
    "worlds": {"protocol", "simulation"} | VALUES,
    "sensors": MIDDLE | VALUES,
    "robots": MIDDLE | VALUES,
    "actuators": MIDDLE | VALUES,
    "control": MIDDLE | VALUES,
    "cameras": MIDDLE | VALUES,
    "radio": MIDDLE | VALUES,
    "importers": {"protocol", "simulation", "worlds"} | VALUES,
    "services": MIDDLE | VALUES | {"interrupts", "processes"},
    "app": MIDDLE | VALUES | {"importers", "services", "settings"},
    "testing": MIDDLE | VALUES | {"app", "options", "services", "settings"},
    "validation": MIDDLE | VALUES | {"app", "cli", "importers", "settings", "testing"},
    "doctor": MIDDLE
    | VALUES
    | {"app", "importers", "options", "processes", "services", "settings"},
    "cli": MIDDLE
    | VALUES
    | {"app", "doctor", "importers", "interrupts", "options", "services", "settings", "testing"}
    | {"__main__", "validation"},
    "__main__": {"cli", "interrupts"},
}
"""What each room may import of the others, beside itself."""

FOREIGN: dict[str, set[str]] = {
    "protocol": {"numpy"},
    "simulation": {"numpy", "mujoco", "embreex"},
    "services": set(),
}
"""Packages from outside that the stricter rooms may import, beside the standard library."""

SOCKETS = {"asyncio", "selectors", "select", "socket", "socketserver", "ssl"}
WITH_SOCKETS = {"services", "app", "doctor", "testing", "validation", "cli"}


def modules(folder: Path) -> list[Path]:
    """All Python files below a folder."""
    return sorted(folder.rglob("*.py"))


def room_of(path: Path) -> str:
    """The room that a file of the server belongs to; empty for the package's own `__init__`."""
    first = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    return "" if first == "__init__" else first


def imported(source: str) -> Iterator[str]:
    """Full names of all modules that a program text imports, wherever in the text."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports hide where they lead"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def rooms_imported(path: Path) -> set[str]:
    """Rooms of the server that a file imports directly."""
    names = (name.split(".") for name in imported(path.read_text(encoding="utf-8")))
    rooms = {parts[1] for parts in names if parts[0] == "usarsim_server" and len(parts) > 1}
    return rooms - {"__version__"}


def tops_imported(path: Path) -> set[str]:
    """Top-level packages that a file imports directly."""
    return {name.split(".")[0] for name in imported(path.read_text(encoding="utf-8"))}


def lint(contract: str, config: Path = ROOT / "pyproject.toml") -> int:
    """Exit status of import-linter for one contract."""
    return lint_imports(config_filename=str(config), limit_to_contracts=(contract,), no_cache=True)


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

    @pytest.mark.parametrize(
        "contract", ["protocol", "simulation", "worlds", "middle", "services", "doctor", "tools"]
    )
    def test_walls_hold(self, contract: str, monkeypatch: pytest.MonkeyPatch) -> None:
        """No import, direct or through others, leads through the wall."""
        monkeypatch.chdir(ROOT)
        monkeypatch.syspath_prepend(str(ROOT / "tools"))
        assert lint(contract) == 0

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
        assert lint("wrong", config) == 1


class TestTable:
    """Direct imports, by the table above."""

    def test_every_room_has_walls(self) -> None:
        """Each folder and module of the server is in the table; enter a new one there."""
        assert {room_of(path) for path in modules(PACKAGE)} - {""} <= set(ROOMS)

    @pytest.mark.parametrize("room", sorted(ROOMS))
    def test_rooms_import_what_they_may(self, room: str) -> None:
        """No file of a room imports a room that the table does not allow."""
        for path in modules(PACKAGE):
            if room_of(path) == room:
                strangers = rooms_imported(path) - ROOMS[room] - {room}
                assert not strangers, f"{path.relative_to(ROOT)} imports {sorted(strangers)}"

    @pytest.mark.parametrize("room", sorted(FOREIGN))
    def test_strict_rooms_need_few_packages(self, room: str) -> None:
        """The stricter rooms import nothing from outside but what the table allows."""
        allowed = FOREIGN[room] | set(sys.stdlib_module_names) | {"usarsim_server"}
        for path in modules(PACKAGE):
            if room_of(path) == room:
                strangers = tops_imported(path) - allowed
                assert not strangers, f"{path.relative_to(ROOT)} imports {sorted(strangers)}"

    def test_sockets_stay_where_they_belong(self) -> None:
        """Only services, what puts them together and what tests them know sockets and asyncio."""
        for path in modules(PACKAGE):
            if room_of(path) not in WITH_SOCKETS:
                assert not tops_imported(path) & SOCKETS, path.relative_to(ROOT)

    def test_neighbours_exchange_descriptions_only(self) -> None:
        """Sensors know of robots what their description says, nothing of how they are run."""
        for path in modules(PACKAGE / "sensors"):
            for name in imported(path.read_text(encoding="utf-8")):
                if name.startswith("usarsim_server.robots."):
                    assert name.startswith("usarsim_server.robots.description."), (
                        f"{path.relative_to(ROOT)} imports {name}"
                    )

    def test_tools_know_the_protocol_at_most(self) -> None:
        """Programs beside the server import its grammar and its version number only."""
        for path in modules(TOOLS):
            for name in imported(path.read_text(encoding="utf-8")):
                parts = name.split(".")
                if parts[0] == "usarsim_server":
                    assert parts[1:2] in (["protocol"], ["__version__"]), (
                        f"{path.relative_to(ROOT)} imports {name}"
                    )

    def test_only_the_front_door_knows_the_tools(self) -> None:
        """Of the server only the command line may start the programs beside it."""
        for path in modules(PACKAGE):
            if room_of(path) != "cli":
                assert "usarsim_tools" not in tops_imported(path), path.relative_to(ROOT)


def test_hidden_imports_are_seen() -> None:
    """The reader of imports finds them inside functions and conditions, too."""
    source = "import a.b\nif x:\n    from c import d, e\ndef f():\n    import g as h\n"
    assert set(imported(source)) == {"a.b", "c.d", "c.e", "g"}


@pytest.mark.parametrize(
    ("room", "heavy"),
    [
        ("protocol", ("mujoco", "asyncio", "socket", "embreex")),
        ("services", ("mujoco", "embreex")),
        ("settings", ("mujoco", "asyncio", "embreex")),
    ],
)
def test_importing_a_room_loads_nothing_heavy(room: str, heavy: tuple[str, ...]) -> None:
    """A fresh interpreter can import the whole room without loading what it must not know."""
    names = [
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for path in modules(PACKAGE)
        if room_of(path) == room
    ]
    program = (
        "import importlib, sys\n"
        f"for name in {names!r}: importlib.import_module(name)\n"
        f"print([name for name in {heavy!r} if name in sys.modules])"
    )
    answer = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, check=True
    )
    assert answer.stdout.strip() == "[]"
