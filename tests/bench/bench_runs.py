"""Runs of whole measurements, for tests that look at what comes out of them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from usarsim_server.cli import main


def measured(folder: Path, name: str, seconds: float, robots: int = 2) -> dict[str, dict[str, Any]]:
    """Figures of one measurement by name, as the JSON file has them."""
    file = folder / f"{name}.json"
    words = ["--robots", str(robots), "--seconds", str(seconds), "--world", "empty"]
    assert main(["bench", name, *words, "--json", str(file)]) == 0
    sections = json.loads(file.read_text())["sections"]
    assert [section["key"] for section in sections] == [name]
    figures = {figure["name"]: figure for figure in sections[0]["figures"]}
    assert len(figures) == len(sections[0]["figures"])
    assert all(math.isfinite(figure["value"]) for figure in figures.values())
    return figures
