"""Lines of every class are those of the stored hashes, and the tool that tells."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

import pytest
from linehash import Stored, catalog, changes, difference, digest, dump, main

STORED = Path(__file__).with_name("line_hashes.json")
QUICK = "MultiView"
"""A class that is played in no time: it does nothing."""


QUICK_ONES = ("EverySensor", "Control", "P2AT", "BasicAckermanRobot", "AirRobot", "Submarine")
"""A session or class of each kind; the others are slow."""


def check(names: Sequence[str]) -> None:
    """None of these says anything else than when the hashes were stored."""
    stored = Stored.read(STORED)
    if strange := stored.strangeness():
        pytest.skip(f"numbers may differ in the last bit: {strange}")
    differing = "\n".join(changes(names, stored.hashes))
    assert not differing, (
        f"these lines have changed:\n{differing}\nTo see where, dump them before and after: python "
        "tests/golden/linehash.py --dump DIR, then --against DIR; if they should have changed, "
        "store them by --write"
    )


def test_lines_of_each_kind_are_the_stored_ones() -> None:
    """A class or session of each kind says the same as when the hashes were stored."""
    check(QUICK_ONES)


@pytest.mark.slow
def test_lines_are_the_stored_ones() -> None:
    """All other classes and sessions say the same as when the hashes were stored."""
    check([name for name in catalog() if name not in QUICK_ONES])


def test_all_classes_are_stored() -> None:
    """Every class of the catalog and every session has a hash."""
    names = catalog()
    assert len(names) > 70
    assert list(Stored.read(STORED).hashes) == names


def test_a_hash_counts_every_byte() -> None:
    """Ends of lines, their order and whose they are change the hash."""
    lines = {"udk": [b"A 1\r\n", b"B 2\r\n"], "ut2004": []}
    others = (
        {"udk": [b"A 1\n", b"B 2\r\n"], "ut2004": []},
        {"udk": [b"B 2\r\n", b"A 1\r\n"], "ut2004": []},
        {"udk": [b"A 1\r\n"], "ut2004": [b"B 2\r\n"]},
        {"udk": [b"A 1\r\nB 2\r\n"], "ut2004": []},
    )
    assert digest(lines) == digest(dict(lines))
    assert len({digest(lines), *map(digest, others)}) == 5


def test_the_first_difference_is_shown(tmp_path: Path) -> None:
    """Against a dump the first line that differs is told, both ways; a missing line, too."""
    before = {"udk": [b"same\r\n", b"SEN {Range " + b"1.00," * 99 + b"2.50}\r\n"]}
    now = {"udk": [b"same\r\n", b"SEN {Range " + b"1.00," * 99 + b"2.75}\r\n"]}
    dump(tmp_path, "P2AT", before)
    assert difference(tmp_path, "P2AT", before) == ""
    told = difference(tmp_path, "P2AT", now)
    assert re.match(r"P2AT\.udk\.txt line 2\n  was \.\.\..*2\.50.*\n  now \.\.\..*2\.75", told)
    assert "line 2" in difference(tmp_path, "P2AT", {"udk": before["udk"][:1]})
    assert "missing" in difference(tmp_path, "Nao", now)


def test_the_program_tells_what_differs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Equal hashes give 0, others 1 with the class and its line, wrong options 2."""
    stored, folder = tmp_path / "hashes.json", tmp_path / "dump"
    options = ["--class", QUICK.upper(), "--stored", str(stored)]
    assert main([*options, "--write", "--dump", str(folder)]) == 0
    assert main([*options, "--against", str(folder)]) == 0
    assert capsys.readouterr().out.endswith("equal to the stored hashes\n")
    content = json.loads(stored.read_text(encoding="utf-8"))
    content["hashes"][QUICK] = "0" * 64
    stored.write_text(json.dumps(content), encoding="utf-8")
    first = folder / f"{QUICK}.udk.txt"
    first.write_bytes(first.read_bytes().replace(b"NFO", b"NF0", 1))
    assert main([*options, "--against", str(folder)]) == 1
    told = capsys.readouterr().out
    assert f"DIFFERENT: {QUICK}" in told
    assert f"DIFFERS {QUICK}.udk.txt line 1\n" in told
    content["environment"]["numpy"] = "0.1"
    stored.write_text(json.dumps(content), encoding="utf-8")
    assert main(options) == 0
    assert "not compared" in capsys.readouterr().out
    assert main(["--class", "Nobody", "--stored", str(stored)]) == 2
    assert main([*options[:2], "--stored", str(tmp_path / "none.json")]) == 2
