"""Small servers of poses: for the wireless program, and for scoring tools."""

from __future__ import annotations

import asyncio
from functools import partial

from usarsim_conformance.mutants.side_world import (
    MiniRobot,
    MiniWorld,
    groups_of,
    serve_lines,
    truncated,
)


class MiniGroundTruth:
    """GETPOS and GETOBS over flat ground at z = 0."""

    def __init__(self, world: MiniWorld) -> None:
        self._world = world
        self._has = world.has

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one client."""
        await serve_lines(
            reader,
            writer,
            self._answer,
            one_per_read=self._has("groundtruth-one-per-read"),
            end="\n" if self._has("groundtruth-lf") else "\r\n",
        )

    def _answer(self, line: str) -> str | None:
        match line.partition("{")[0].strip().upper():
            case "GETPOS":
                return self._positions()
            case "GETOBS":
                return self._obstacles(line)
            case "":
                return "" if self._has("groundtruth-blank-lines") else None
            case _:
                return "ERROR" if self._has("groundtruth-error") else None

    def _positions(self) -> str:
        robots = self._world.robots
        if self._has("groundtruth-by-name"):
            robots = sorted(robots, key=lambda robot: robot.name)
        between = "  " if self._has("groundtruth-two-blanks") else " "
        return between.join(
            [f"POSITIONS {{Robots {len(robots)}}}", *[self._position(one) for one in robots]]
        )

    def _position(self, robot: MiniRobot) -> str:
        form = "{:.4f}".format if self._has("groundtruth-rounds") else truncated
        place = ",".join(form(value) for value in robot.location)
        name = robot.name.lower() if self._has("groundtruth-lower-case") else robot.name
        parts = (f"Name {name}", f"Location {place}", "BatteryEmpty False")
        return "{" + ("} {" if self._has("groundtruth-many-groups") else " ").join(parts) + "}"

    def _obstacles(self, line: str) -> str | None:
        groups = groups_of(line)
        one, other, first, last = (groups.get(key) for key in ("from", "to", "start", "end"))
        if one and other:
            known = self._world.named(one) and self._world.named(other)
            return f"NUMOBS {{From {one}}} {{To {other}}} {{ObstCount {0 if known else -1}.0000}}"
        if first and last:
            count = self._between(first, last)
            if self._has("groundtruth-rewrites-points"):
                first = ",".join(f"{float(part):.4f}" for part in first.split(","))
            return f"NUMOBS {{Start {first}}} {{End {last}}} {{ObstCount {count}.0000}}"
        return None if self._has("groundtruth-silent-missing") else ""

    def _between(self, first: str, last: str) -> int:
        try:
            (x, y, low), (_, _, high) = (map(float, text.split(",")) for text in (first, last))
        except ValueError:
            return 0
        count = int((low < 0.0) != (high < 0.0))
        if self._has("groundtruth-counts-robots"):
            count += sum(
                abs(robot.location[0] - x) < 1.0 and abs(robot.location[1] - y) < 1.0
                for robot in self._world.robots
            )
        return count


class MiniTruth:
    """Listings for scoring tools."""

    def __init__(self, world: MiniWorld) -> None:
        self._world = world
        self._has = world.has

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one client."""
        await serve_lines(reader, writer, partial(self._answer, writer), end="")

    def _answer(self, writer: asyncio.StreamWriter, line: str) -> str | None:
        if not line and self._has("truth-ignores-empty"):
            return None
        groups = groups_of(line)
        wanted = groups.get("class", "").rpartition(".")[2]
        robots = [
            robot
            for robot in self._world.robots
            if self._has("truth-any-class") or wanted in ("", robot.class_name)
        ]
        lines = [self._line(robot) for robot in robots]
        if name := groups.get("name"):
            fold = str.lower if self._has("truth-name-case") else str
            lines = [line for line in lines if fold(f"{{Name {name}}}") in fold(line)]
        if not (self._has("truth-no-end") and not lines):
            lines.append("{End}")
        if self._has("truth-two-writes"):
            writer.write("".join(f"{line}\r\n" for line in lines[:-1]).encode())
            asyncio.get_running_loop().call_later(0.05, writer.write, b"{End}\r\n")
            return None
        return "".join(f"{line}\r\n" for line in lines)

    def _line(self, robot: MiniRobot) -> str:
        digits = 3 if self._has("truth-three-digits") else 2
        name = f"{robot.class_name}_{robot.index}"
        if self._has("truth-init-names"):
            name = robot.name
        package = "USARBot." if self._has("truth-packages") else ""
        place = ",".join(f"{value:.{digits}f}" for value in robot.location)
        rotation = "0.00, 0.00, 0.00" if self._has("truth-blanks") else "0.00,0.00,0.00"
        now = f"{self._world.time:.4f}"
        return (
            f"{{Name {name}}} {{Class {package}{robot.class_name}}} {{Time {now}}} "
            f"{{Location {place}}} {{Rotation {rotation}}}"
        )
