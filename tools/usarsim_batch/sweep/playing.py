"""One run of a sweep: a server on ports of its own, controllers, and what came of them."""

from __future__ import annotations

import asyncio
import hashlib
import re
import resource
import shutil
import sys
import time
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections.abc import Awaitable, Mapping
from contextlib import AsyncExitStack, suppress
from pathlib import Path
from typing import Any

from usarsim_batch.sweep.plan import PLACE, SweepTask
from usarsim_batch.tasks import Played, failed, provenance
from usarsim_client.inbox import HangupError
from usarsim_client.scene import LiveScene, connect_scene
from usarsim_server.base.children import python
from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.files import check_links, reason
from usarsim_server.protocol.json_text import parse_json

RESULT = "result.json"
"""What a controller writes there into `{out}` becomes part of the results."""
_LARGEST = 1 << 20
"""Bytes of it."""
_PATIENCE = 120.0
"""s until a server is ready."""
_GRACE = 5.0
"""s to end after SIGTERM."""
HOST = "127.0.0.1"


class _FailedError(UsarsimError):
    """Why a run has failed."""


def play(task: SweepTask) -> Played:
    """Play a run; whatever goes wrong is in the row."""
    begun, spent = time.monotonic(), _spent()
    try:
        row = asyncio.run(_play(task))
    except _FailedError as error:
        return failed(task, str(error))
    except OSError as error:
        return failed(task, f"{error.filename or task.out}: {reason(error)}")
    timing = {"wall_s": time.monotonic() - begun, "processor_s": _spent() - spent}
    return Played(task.facts() | row, timing, provenance())


async def _play(task: SweepTask) -> dict[str, Any]:
    """A run; its row without facts."""
    shutil.rmtree(task.out, ignore_errors=True)
    files = task.out / "out"
    files.mkdir(parents=True)
    async with AsyncExitStack() as stack:
        server, ports = await _serve(task, stack)
        names = {
            **task.parameters, "host": HOST, "port": ports["control"], "seed": task.seed,
            "out": files, "python": sys.executable,
            **{f"{name}_port": port for name, port in ports.items()},
        }  # fmt: skip
        programs = []
        for number, words in enumerate(task.commands, 1):
            command = [_filled(word, {**names, "robot": f"R{number}"}) for word in words]
            log = task.out / f"controller-{number}.log"
            programs.append(await _start(command, task.folder, log, stack))
        ends: dict[str, Awaitable[object]] = {
            "server": server.wait(),
            "controllers": asyncio.gather(*(one.wait() for one in programs)),
        }
        if task.end.simulated is not None:
            ends["simulated"] = _simulated(ports["scene"], task.end.simulated)
        waits = {asyncio.ensure_future(one): name for name, one in ends.items()}
        stack.push_async_callback(_forget, list(waits))
        done, _ = await asyncio.wait(
            waits, timeout=task.end.wall, return_when=asyncio.FIRST_COMPLETED
        )
        over = {waits[one] for one in done}
        if "server" in over:
            raise _FailedError(f"the server ended with code {server.returncode}")
        codes = [one.returncode for one in programs]
    for number, code in enumerate(codes, 1):
        if code is not None and code < 0:
            raise _FailedError(f"controller {number} was ended by signal {-code}")
    ended = next((one for one in ("controllers", "simulated") if one in over), "wall")
    return {"ended": ended, "exits": codes, **_written(files)}


async def _serve(task: SweepTask, stack: AsyncExitStack) -> tuple[Process, dict[str, int]]:
    """A server that is ready, and its ports by service."""
    command = python("-m", "usarsim_server", "serve", f"--host={HOST}", *task.options, tied=True)
    server = await _start(command, task.folder, task.out / "server.log", stack, PIPE)
    assert server.stdout is not None
    try:
        ready = (await asyncio.wait_for(server.stdout.readline(), _PATIENCE)).decode()
    except TimeoutError:
        ready = ""
    ports = {name: int(port) for name, port in re.findall(r"(\w+)=\S+:(\d+)", ready)}
    if "control" not in ports:
        raise _FailedError("the server did not start")
    return server, ports


async def _start(
    command: list[str], folder: Path, log: Path, stack: AsyncExitStack, output: int | None = None
) -> Process:
    """A program that is ended with the run; PIPE: its output is for us, its errors for the log."""
    with log.open("wb") as file:
        try:
            program = await asyncio.create_subprocess_exec(
                *command, cwd=folder, stdin=DEVNULL,
                stdout=output or file, stderr=file,
            )  # fmt: skip
        except (OSError, ValueError) as error:
            raise _FailedError(f"{command[0]}: cannot be started: {error}") from None
    stack.push_async_callback(_end, program)
    return program


async def _end(program: Process) -> None:
    with suppress(ProcessLookupError):
        program.terminate()
    try:
        await asyncio.wait_for(program.wait(), _GRACE)
    except TimeoutError:
        with suppress(ProcessLookupError):
            program.kill()
        await program.wait()


async def _forget(waits: list[asyncio.Future[Any]]) -> None:
    for one in waits:
        one.cancel()
    await asyncio.gather(*waits, return_exceptions=True)


async def _simulated(port: int, seconds: float) -> LiveScene:
    """Until so much time has passed in the world."""
    live = await connect_scene(HOST, port, channels=("truth",))
    with suppress(HangupError, OSError):
        while (await live.truth()).time < seconds - 1e-6:
            pass
        return live
    await asyncio.Event().wait()  # the server ends; that is told elsewhere
    return live


def _filled(word: str, names: Mapping[str, object]) -> str:
    return PLACE.sub(lambda found: str(names.get(found[1], found[0])), word)


def _written(folder: Path) -> dict[str, Any]:
    """What controllers have left; none of it lies elsewhere."""
    check_links(folder, _FailedError)
    files = {}
    for path in sorted(one for one in folder.rglob("*") if one.is_file()):
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        files[str(path.relative_to(folder))] = digest
    found: dict[str, Any] = {"files": files}
    path = folder / RESULT
    if path.is_file() and path.stat().st_size <= _LARGEST:
        try:
            found["result"] = parse_json(path.read_bytes())
        except ValueError as error:
            raise _FailedError(f"{path}: is no JSON: {error}") from None
    return found


def _spent() -> float:
    """Processor seconds of programs that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
