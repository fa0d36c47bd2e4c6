"""The how-to pages work as written: their files are written down, their commands are run."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import pytest
from lanes import slow_but

PAGES = sorted((Path(__file__).parents[1] / "docs" / "howto").glob("*.md"))
FAST = {"sensor", "effector", "robot", "world", "family"}
"""Pages whose commands `make test` carries out: things that the server itself has."""
SCREEN = 90
"""Lines that a page may have."""

_BLOCK = re.compile(
    r"(?:^`(?P<name>[^`\n]+)`[^\n]*:\n\n)?^```(?P<kind>\w+)\n(?P<text>.*?)^```", re.M | re.S
)


@dataclass(frozen=True)
class Page:
    """The files that a page shows by name, and its commands with what they print."""

    files: dict[str, str]
    commands: list[tuple[str, list[str]]]


def parse(text: str) -> Page:
    """Take a page apart: "`name`:" above a block makes it a file, `console` is run."""
    files: dict[str, str] = {}
    commands: list[tuple[str, list[str]]] = []
    for block in _BLOCK.finditer(text):
        if block["kind"] == "console":
            for line in block["text"].splitlines():
                if line.startswith("$ "):
                    commands.append((line[2:], []))
                else:
                    commands[-1][1].append(line)
        else:
            assert block["name"], f"a block without a name: {block['text'][:40]}"
            files[block["name"]] = block["text"]
    return Page(files, commands)


def install(project: str, folder: Path) -> None:
    """What `pip install -e .` does that matters: the entry points of a folder can be found."""
    table = tomllib.loads(project)["project"]
    facts = folder / f"{table['name']}-{table['version']}.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text(f"Name: {table['name']}\nVersion: {table['version']}\n")
    groups = table["entry-points"].items()
    text = (
        f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in points.items())
        for group, points in groups
    )
    (facts / "entry_points.txt").write_text("".join(text))


@pytest.mark.parametrize(
    "page", slow_but(lambda page: page.stem in FAST, PAGES), ids=lambda page: page.stem
)
def test_the_page_works(page: Path, tmp_path: Path) -> None:
    """Each command succeeds, or prints the error that is shown, and prints the lines shown."""
    text = page.read_text(encoding="utf-8")
    parsed = parse(text)
    assert parsed.commands
    for name, content in parsed.files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(content, encoding="utf-8")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "PYTHONPATH": str(tmp_path)}
    for command, shown in parsed.commands:
        if command == "pip install -e .":
            install(parsed.files["pyproject.toml"], tmp_path)
            continue
        run = subprocess.run(
            command, shell=True, cwd=tmp_path, env=environment, capture_output=True, text=True
        )
        printed = run.stdout + run.stderr
        wanted = 2 if any(line.startswith("error: ") for line in shown) else 0
        assert run.returncode == wanted, f"{command}: {printed}"
        for line in shown:
            form = ".*".join(re.escape(part.strip()) for part in line.split("..."))
            assert re.search(f"^{form}", printed, re.MULTILINE), f"{command}: {line}\n{printed}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_one_screen(page: Path) -> None:
    """A how-to is read in one go."""
    assert len(page.read_text(encoding="utf-8").splitlines()) <= SCREEN


def test_every_kind_of_thing_has_a_page() -> None:
    """Sensor, effector, robot, family, world, mission, importer, radio model, strategy."""
    kinds = {"mission", "sensor", "effector", "robot", "family", "world", "importer"}
    kinds |= {"radio-model", "strategy"}
    assert kinds <= {page.stem for page in PAGES}
