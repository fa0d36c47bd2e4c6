"""The tables of keys in `docs/`, written from the declarations of the fields.

Run `python tests/key_tables.py` after a change of a declaration.
"""

from __future__ import annotations

import importlib
import re
from pathlib import Path

from usarsim_server.fields import markdown

PAGES = sorted((Path(__file__).parents[1] / "docs").glob("*.md"))
MARKED = re.compile(r"(<!-- keys of ([^>]+) -->\n).*?(<!-- end of keys -->\n)", re.DOTALL)


def rewritten(text: str) -> str:
    """A page with the tables that follow from the declarations."""

    def table(found: re.Match[str]) -> str:
        classes = []
        for name in found[2].split(", "):
            module, _, cls = name.rpartition(".")
            classes.append(getattr(importlib.import_module(module), cls))
        return f"{found[1]}\n{markdown(*classes)}\n{found[3]}"

    return MARKED.sub(table, text)


if __name__ == "__main__":
    for page in PAGES:
        page.write_text(rewritten(page.read_text(encoding="utf-8")), encoding="utf-8")
