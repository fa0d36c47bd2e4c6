"""Pictures and films of a tape, as files."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from usarsim_exploration.showing.canvas import Picture
from usarsim_exploration.showing.overlays import DEFAULT
from usarsim_exploration.showing.picture import draw, png
from usarsim_exploration.showing.tape import Tape
from usarsim_report.films import KINDS, Frame, write_film
from usarsim_server.base.errors import UsarsimError, at
from usarsim_server.base.files import reason, write_bytes
from usarsim_server.base.interrupts import calling

PICTURE = ".png"
FPS = 20.0
"""Of films, usually."""


@dataclass(frozen=True, slots=True)
class Looks:
    """How scenes are drawn: names of overlays, and the number of a robot or None for the team."""

    overlays: frozenset[str] = DEFAULT
    robot: int | None = None

    def picture(self, tape: Tape, step: int) -> Picture:
        """A step."""
        return draw(tape.scene(step), self.overlays, self.robot)


def prepare(out: Path) -> None:
    """See before a long run whether something can be written there.

    Raises:
        UsarsimError: it is of no kind that is known, or its folder is not there.
    """
    kind = out.suffix.lower()
    if kind and kind not in (PICTURE, *KINDS):
        kinds = ", ".join((PICTURE, *KINDS))
        raise UsarsimError(f"--out: {out} is of no known kind (choose {kinds}, or name a folder)")
    if kind and not out.parent.is_dir():
        raise UsarsimError(f"--out: {out.parent} is not there (make it, or name another folder)")


def write_picture(tape: Tape, looks: Looks, step: int | None, out: Path) -> None:
    """Write one step as PNG, and say so; None: the last one.

    Raises:
        UsarsimError: the file cannot be written.
    """
    step = len(tape) - 1 if step is None else step
    _write(out, png(looks.picture(tape, step)))
    print(f"{out}: step {step}")


def write_many(tape: Tape, looks: Looks, out: Path, every: int = 1, fps: float = FPS) -> int:
    """Write a film, or a folder of pictures, and say so.

    Args:
        out: MP4, GIF, or a folder, which is made. every: steps between two pictures.
        fps: of a film, pictures a second.

    Returns:
        The exit code: 130 if it was interrupted; then what was drawn is there.

    Raises:
        UsarsimError: something cannot be written.
    """
    steps = [*range(0, len(tape), every)]
    if steps[-1] != len(tape) - 1:
        steps.append(len(tape) - 1)
    stopped: list[bool] = []
    with calling(lambda: stopped.append(True)):
        if out.suffix.lower() in KINDS:
            rows, columns = looks.picture(tape, 0).shape[:2]
            frames = _frames(tape, looks, steps)
            drawn = write_film(out, frames, len(steps), fps, (columns, rows), stopped)
            print(f"{out}: {drawn} frames, {drawn / fps:.1f} s")
        else:
            drawn = _write_folder(tape, looks, steps, out, stopped)
            print(f"{out}: {drawn} pictures")
    return 130 if stopped else 0


def _frames(tape: Tape, looks: Looks, steps: list[int]) -> Iterator[Frame]:
    for step in steps:
        yield np.ascontiguousarray(looks.picture(tape, step)[..., ::-1])


def _write_folder(
    tape: Tape, looks: Looks, steps: list[int], out: Path, stopped: list[bool]
) -> int:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        cure = "name another folder"
        raise UsarsimError(at(out, f"cannot be made: {reason(error)}", cure)) from None
    for drawn, step in enumerate(steps, 1):
        _write(out / f"step-{step:06}.png", png(looks.picture(tape, step)))
        if stopped:
            return drawn
    return len(steps)


def _write(path: Path, data: bytes) -> None:
    try:
        write_bytes(path, data)
    except OSError as error:
        cure = "name a file in a folder that can be written"
        raise UsarsimError(at(path, f"cannot be written: {reason(error)}", cure)) from None
