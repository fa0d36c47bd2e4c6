"""Hashes of all lines that the server sends, for every robot class in both dialects.

A gate for changes that must change nothing. Each class is played through a fixed script for five
simulated seconds, as a UT2004 and as a UDK robot, and all lines that its clients get are hashed
with their bytes. World controllers and avatars, the shipped worlds and lockstep are played in
sessions of their own. No socket and no clock takes part, so equal servers give equal hashes;
another processor, or another version of a library that computes, may differ in the last bit.

    python tests/golden/linehash.py                       # all, against the stored hashes
    python tests/golden/linehash.py --class P2AT,Nao --against /tmp/before
"""

from __future__ import annotations

import argparse
import hashlib
import json
import platform
import re
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from itertools import zip_longest
from pathlib import Path

sys.path += [str(Path(__file__).parents[1]), str(Path(__file__).parents[2])]

from linehash_play import SESSIONS, Lines, grounds, play
from linehash_yard import EVERY_SENSOR

from benchmarks.apart import all_classes
from usarsim_bench.figures import BenchError
from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.toml import read_text
from usarsim_server.protocol.json_text import parse_json

PACKAGES = ("mujoco", "numpy", "embreex")
_STORE = Path(__file__).with_name("line_hashes.json")
READABLE = ("AirRobot", "BasicAckermanRobot")
"""Classes whose lines are stored as text, too, so that a change of them can be read."""
LINES = Path(__file__).with_name("lines")
_SHOWN = 160
"""Characters of a line that are shown around the first difference."""


def catalog() -> list[str]:
    """All that is hashed: the classes of the catalog, the one with every sensor, the sessions.

    Raises:
        BenchError: if the server does not list its robots.
    """
    return [*all_classes(), EVERY_SENSOR, *SESSIONS]


def environment() -> dict[str, str]:
    """On what the last bits of numbers depend: libraries and processor."""
    found = {name: metadata.version(name) for name in PACKAGES}
    found["machine"] = platform.machine()
    try:
        flags = Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace")
    except OSError:
        flags = ""
    vectors = ("avx512f", "avx2", "avx", "asimd")
    found["vectors"] = next((one for one in vectors if re.search(rf"\b{one}\b", flags)), "unknown")
    found["libc"] = " ".join(platform.libc_ver())
    return found


def digest(lines: Lines) -> str:
    """SHA-256 over all lines of all clients, with their bytes."""
    total = hashlib.sha256()
    for client, heard in lines.items():
        total.update(f"== {client} {len(heard)}\n".encode())
        for line in heard:
            total.update(line)
    return total.hexdigest()


@dataclass(frozen=True, slots=True)
class Stored:
    """Hashes that were taken before, and where."""

    environment: Mapping[str, str]  # see `environment`
    hashes: Mapping[str, str]  # by class or session

    @classmethod
    def read(cls, path: Path) -> Stored:
        """Read a file.

        Raises:
            BenchError: if it cannot be read.
        """
        try:
            content = parse_json(read_text(path, UsarsimError))
            return cls(content["environment"], content["hashes"])
        except (UsarsimError, ValueError, KeyError, TypeError) as error:
            raise BenchError(f"{path}: no stored hashes ({error}); store some by --write") from None

    def write(self, path: Path) -> None:
        """Write a file."""
        content = {"environment": dict(self.environment), "hashes": dict(self.hashes)}
        path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")

    def strangeness(self) -> str:
        """Why hashes taken here cannot be compared with these; empty if they can."""
        here = environment()
        return ", ".join(
            f"{name} {self.environment.get(name)} there, {value} here"
            for name, value in here.items()
            if self.environment.get(name) != value
        )


def dump(folder: Path, name: str, lines: Lines) -> None:
    """Write the lines of each client into a file of its own, as they were sent."""
    folder.mkdir(parents=True, exist_ok=True)
    for client, heard in lines.items():
        (folder / f"{name}.{client}.txt").write_bytes(b"".join(heard))


def difference(folder: Path, name: str, lines: Lines) -> str:
    """The first line that differs from an earlier dump, both ways; empty if none does."""
    for client, heard in lines.items():
        path = folder / f"{name}.{client}.txt"
        if not path.is_file():
            return f"{path} is missing"
        # Other ends of lines than "\n" must not split: they may be what differs.
        new, old = (b"".join(heard).split(b"\n"), path.read_bytes().split(b"\n"))
        for number, (was, now) in enumerate(zip_longest(old, new), 1):
            if was != now:
                shown = f"\n  was {_around(was, now)}\n  now {_around(now, was)}"
                return f"{path.name} line {number}{shown}"
    return ""


def _around(line: bytes | None, other: bytes | None) -> str:
    """A line from a little before the place where it differs from another."""
    if line is None:
        return "(no more lines)"
    pairs = enumerate(zip(line, other or b"", strict=False))
    at = next(
        (index for index, (one, two) in pairs if one != two), min(len(line), len(other or b""))
    )
    begin = max(0, at - _SHOWN // 2) if len(line) > _SHOWN else 0
    mark = "..." if begin else ""
    return f"{mark}{line[begin : begin + _SHOWN].decode('latin-1')!r} (character {at + 1})"


def changes(names: Sequence[str], stored: Mapping[str, str]) -> list[str]:
    """Play some classes or sessions; what has changed: names, or the first line where it is stored.

    Args:
        stored: hashes by name.
    """
    found = []
    with grounds() as place:
        for name in names:
            lines = play(name, place)
            shown = difference(LINES, name, lines) if name in READABLE else ""
            if shown or digest(lines) != stored[name]:
                found.append(shown or name)
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit code."""
    wishes = _parser().parse_args(arguments)
    try:
        return _run(wishes)
    except (BenchError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python tests/golden/linehash.py",
        description="Hash all lines that every robot class is sent, in both dialects, and compare "
        "with the stored hashes. Exit code 1 if any differs.",
    )
    parser.add_argument(
        "--class", dest="names", metavar="A,B", help=f"only these; or {', '.join(SESSIONS)}"
    )
    parser.add_argument("--dump", type=Path, metavar="DIR", help="write all lines there")
    parser.add_argument(
        "--against", type=Path, metavar="DIR", help="show the first line other than in this dump"
    )
    parser.add_argument("--write", action="store_true", help="store the hashes, and lines as text")
    parser.add_argument("--stored", type=Path, metavar="FILE", help=f"default: {_STORE}")
    return parser


def _run(wishes: argparse.Namespace) -> int:
    begun = time.process_time()
    known = catalog()
    names = known if wishes.names is None else [one for one in wishes.names.split(",") if one]
    lower = {name.lower(): name for name in known}
    if strangers := [name for name in names if name.lower() not in lower]:
        raise BenchError(f"unknown: {', '.join(strangers)}; there are {', '.join(known)}")
    path = wishes.stored or _STORE
    stored = Stored(environment(), {}) if wishes.write and not path.exists() else Stored.read(path)
    found: dict[str, str] = {}
    reports: list[str] = []
    with grounds() as place:
        for name in (lower[one.lower()] for one in names):
            lines = play(name, place)
            found[name] = digest(lines)
            print(f"{name:24} {found[name]}", flush=True)
            if wishes.dump is not None:
                dump(wishes.dump, name, lines)
            if wishes.write and name in READABLE and wishes.stored is None:
                dump(LINES, name, lines)
            if wishes.against is not None and (report := difference(wishes.against, name, lines)):
                reports.append(report)
    print(f"{len(found)} hashes in {time.process_time() - begun:.1f} s of processor")
    for report in reports:
        print(f"DIFFERS {report}")
    if wishes.write:
        kept = stored.hashes if wishes.names is not None and not stored.strangeness() else {}
        merged = {**kept, **found}
        Stored(environment(), {one: merged[one] for one in known if one in merged}).write(path)
        print(f"stored in {path}")
        return int(bool(reports))
    return _compare(found, stored, known if wishes.names is None else []) or int(bool(reports))


def _compare(found: Mapping[str, str], stored: Stored, known: Sequence[str]) -> int:
    """Say which hashes are not the stored ones; the exit code."""
    if strange := stored.strangeness():
        print(f"not compared with the stored hashes, numbers may differ in the last bit: {strange}")
        return 0
    differing = [name for name, value in found.items() if stored.hashes.get(name) != value]
    gone = [name for name in stored.hashes if known and name not in known]
    if differing:
        print(f"DIFFERENT: {', '.join(differing)}")
    if gone:
        print(f"GONE: {', '.join(gone)}")
    if not differing and not gone:
        print("equal to the stored hashes")
    return int(bool(differing or gone))


if __name__ == "__main__":
    sys.exit(main())
