"""One run of a sweep: a server on ports of its own, controllers, and what came of them."""

from __future__ import annotations

import asyncio
import hashlib
import resource
import shutil
import sys
import time
from collections.abc import Awaitable, Mapping
from contextlib import AsyncExitStack, suppress
from pathlib import Path
from typing import Any

from usarsim_batch.sweep.plan import PLACE, SweepTask
from usarsim_batch.tasks import Played, failed, provenance
from usarsim_client.inbox import HangupError
from usarsim_client.scene import LiveScene, connect_scene
from usarsim_server.base.files import check_links, reason
from usarsim_server.base.launch import LaunchError, OwnServer, Program
from usarsim_server.protocol.json_text import parse_json

RESULT = "result.json"
"""What a controller writes there into `{out}` becomes part of the results."""
_LARGEST = 1 << 20
"""Bytes of it."""
HOST = "127.0.0.1"


def play(task: SweepTask) -> Played:
    """Play a run; whatever goes wrong is in the row."""
    begun, spent = time.monotonic(), _spent()
    try:
        row = asyncio.run(_play(task))
    except LaunchError as error:
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
        server = await _serve(task, stack)
        ports = server.ports
        names = {
            **task.parameters, "host": HOST, "port": ports["control"], "seed": task.seed,
            "out": files, "python": sys.executable,
            **{f"{name}_port": port for name, port in ports.items()},
        }  # fmt: skip
        programs = []
        for number, words in enumerate(task.commands, 1):
            command = [_filled(word, {**names, "robot": f"R{number}"}) for word in words]
            log = task.out / f"controller-{number}.log"
            programs.append(_start(command, task.folder, log, stack))
        ends: dict[str, Awaitable[Any]] = {
            "server": asyncio.wrap_future(server.ended),
            "controllers": asyncio.gather(*(asyncio.wrap_future(one.ended) for one in programs)),
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
            raise LaunchError(f"the server ended with code {server.ended.result()}")
        codes = [one.ended.result() if one.ended.done() else None for one in programs]
    for number, code in enumerate(codes, 1):
        if code is not None and code < 0:
            raise LaunchError(f"controller {number} was ended by signal {-code}")
    ended = next((one for one in ("controllers", "simulated") if one in over), "wall")
    return {"ended": ended, "exits": codes, **_written(files)}


async def _serve(task: SweepTask, stack: AsyncExitStack) -> OwnServer:
    """A server that is ready; ended with the run."""
    with (task.out / "server.log").open("wb") as log:
        options = (f"--host={HOST}", *task.options)
        server = OwnServer(*options, folder=task.folder, log=log, waits=False)
    stack.push_async_callback(asyncio.to_thread, server.close)
    try:
        await asyncio.to_thread(server.wait)
    except LaunchError:
        raise LaunchError("the server did not start") from None  # its log says why
    return server


def _start(command: list[str], folder: Path, file: Path, stack: AsyncExitStack) -> Program:
    """A program that is ended with the run; what it says is in a file."""
    with file.open("wb") as log:
        program = Program(command[0], command, folder=folder, log=log, announces=False)
    stack.push_async_callback(asyncio.to_thread, program.close)
    return program


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
    check_links(folder, LaunchError)
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
            raise LaunchError(f"{path}: is no JSON: {error}") from None
    return found


def _spent() -> float:
    """Processor seconds of programs that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
