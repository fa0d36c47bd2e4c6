"""Batches for SLURM, by its files: an array script, each task of which plays a part of the runs."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from pathlib import Path

from usarsim_batch.errors import BatchError
from usarsim_batch.folder import Folder, write
from usarsim_server.base.launch import python

SCRIPT = "slurm.sh"
MOST = 1000
"""Tasks of an array that SLURM takes without being told otherwise (its MaxArraySize)."""


def write_script(folder: Folder, words: Sequence[str], parts: int, missing: Sequence[int]) -> Path:
    """Write the script of an array.

    Args:
        folder: of results. words: of the command, without those about workers.
        parts: of the whole batch. missing: numbers of parts with anything left to play.

    Returns:
        its path; results of tasks are collected by the command that wrote it.

    Raises:
        BatchError: it cannot be written.
    """
    logs = folder.folder.absolute() / "slurm-%a.log"
    command = shlex.join(python("-m", "usarsim_server", *words, "--jobs", "1", "--part"))
    path = folder.folder / SCRIPT
    text = (
        "#!/bin/sh\n"
        f"#SBATCH --job-name=usarsim --array={','.join(map(str, missing))} --cpus-per-task=1\n"
        f"#SBATCH --output={shlex.quote(str(logs))}\n"
        f"cd {shlex.quote(str(Path.cwd()))} || exit 2\n"
        f'exec {command} "$SLURM_ARRAY_TASK_ID/{parts}"\n'
    )
    write(path, [text])
    return path


def part_of(text: str) -> tuple[int, int]:
    """`K/N`: part K, from 0, of N.

    Raises:
        BatchError: it is none.
    """
    found = re.fullmatch(r"(\d{1,7})/(\d{1,7})", text)
    if found is None or not int(found[1]) < int(found[2]):
        raise BatchError(f"--part: {text!r} is no part (cure: write K/N, K from 0 to N - 1)")
    return int(found[1]), int(found[2])
