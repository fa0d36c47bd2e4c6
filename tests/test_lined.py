"""Errors of tables name the line of the key, wherever TOML lets it stand."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.base.errors import WorldError
from usarsim_server.base.lined import key_lines, open_toml
from usarsim_server.base.tables import Table

TEXT = '''# c = 3
a = 1
b = [1,
 { x = 2 }, # ]
 3]
"q.r" = "z = 4"
d.e = """
f = 3
"""

[zones.yellow]   # [no]
modes = ["a",
  "b"]
[[v]]
name = 'x'

[[v]]

[v.sub]
name = "y"
 [ "h" . i ]
k=1
[h.j]
'''


def test_every_key_has_its_line() -> None:
    assert key_lines(TEXT) == {
        ("a",): 2,
        ("b",): 3,
        ("q.r",): 6,
        ("d", "e"): 7,
        ("zones", "yellow"): 11,
        ("zones", "yellow", "modes"): 12,
        ("v",): 14,
        ("v", 0): 14,
        ("v", 0, "name"): 15,
        ("v", 1): 17,
        ("v", 1, "sub"): 19,
        ("v", 1, "sub", "name"): 20,
        ("h", "i"): 21,
        ("h", "i", "k"): 22,
        ("h", "j"): 23,
    }


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        (
            "name = 'a'\n\n[[lamp]]\nreach = 2\n[[lamp]]\nreach = 1\nreech = 3\n",
            "line 7: [[lamp]] 2: reech",
        ),
        ("name = 'a'\n[[lamp]]\nreach = 'far'\n", "line 3: [[lamp]] 1: reach"),
        ("name = 'a'\n[sky]\nblue = 1\n", "line 3: [sky]: blue"),
        ("name = 'a'\nsky = {blue = 1}\n", "line 2: [sky]: blue"),
        ("\n\nnam = 'a'\n", "f.toml: name: is missing"),
        ("\nname = 'a'\n nome = 1", "line 3: nome"),
    ],
)
def test_errors_name_the_line(tmp_path: Path, text: str, wanted: str) -> None:
    path = tmp_path / "f.toml"
    path.write_text(text)

    def lamp(table: Table) -> float:
        return table.number("reach")

    def read() -> None:
        table = open_toml(path, WorldError)
        table.text("name")
        table.all("lamp", lamp)
        table.table("sky").finish()
        table.finish()

    with pytest.raises(WorldError) as refusal:
        read()
    assert wanted in str(refusal.value)


@given(st.text("ab[]{}=\"'#\n .,\\", max_size=60))
def test_no_text_ends_the_search(text: str) -> None:
    for line in key_lines(text).values():
        assert 1 <= line <= text.count("\n") + 1
