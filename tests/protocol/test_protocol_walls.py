"""The walls of the room: the protocol knows no socket, no clock, no physics."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import usarsim_server.protocol

ROOM = Path(usarsim_server.protocol.__file__).parent
MODULES = sorted(ROOM.rglob("*.py"))
IMPURE = {
    "asyncio",
    "concurrent",
    "datetime",
    "locale",
    "logging",
    "multiprocessing",
    "os",
    "pathlib",
    "queue",
    "random",
    "select",
    "selectors",
    "signal",
    "socket",
    "socketserver",
    "ssl",
    "subprocess",
    "threading",
    "time",
}
ALLOWED = (sys.stdlib_module_names - IMPURE) | {"numpy"}


def imported(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name} imports relatively"
            names.add(node.module or "")
    return names


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOM)))
def test_modules_import_only_values_and_numbers(path: Path) -> None:
    """Each module imports pure parts of the standard library, numpy and its own room only."""
    for name in imported(path):
        own = f"{name}.".startswith("usarsim_server.protocol.")
        assert own or name.partition(".")[0] in ALLOWED, name


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOM)))
def test_modules_can_be_read_in_one_sitting(path: Path) -> None:
    """No file of the room has more than 400 lines."""
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 400


def test_importing_the_core_loads_no_physics_and_no_event_loop() -> None:
    """A process that imports the whole core has neither MuJoCo nor asyncio loaded."""
    program = (
        "import sys, usarsim_server.protocol.commands, usarsim_server.protocol.dialects, "
        "usarsim_server.protocol.framing, usarsim_server.protocol.messages; "
        "print(sorted({'mujoco', 'embreex', 'asyncio'} & set(sys.modules)))"
    )
    answer = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert answer.stdout.strip() == "[]"
