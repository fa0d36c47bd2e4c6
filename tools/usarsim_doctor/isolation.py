"""Trials in another process: what crashes there, or never ends, is one line here.

A processor that lacks an instruction, half a graphics driver or a broken wheel end a process
without any exception. So everything of that kind is done by a process that can be spared; if it
dies on one trial, another one goes on with the next.

That process runs this module: it reads a pickle of the trials' names and the settings, and writes a
line for each, a JSON object with the fields of `Outcome` and `trial`, the name. A name is that of a
function of this file; what follows a colon is its argument. Each such function takes the settings
of the server and that argument, imports what it needs itself, and returns facts that can be written
as JSON.

Beside that the commands that mend things, `pip` and `root`, written so that they can be pasted into
this shell.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import pickle
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any, TextIO

from usarsim_server.base import errors
from usarsim_server.base.errors import UsarsimError, problem_and_advice
from usarsim_server.base.launch import python
from usarsim_server.protocol.json_text import parse_json
from usarsim_server.settings import Settings

_WORKER = "usarsim_doctor.isolation"
_PACKAGES = tuple(str(Path(file).resolve().parents[1]) for file in (errors.__file__, __file__))


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a trial ended."""

    values: Mapping[str, Any] = field(default_factory=dict)  # what it found out; empty if it failed
    failure: str | None = None  # why it failed, in one line; None if it did not
    told: bool = False  # the failure is an error meant for users, and no defect
    advice: str | None = None  # what such an error says about mending it
    missing: str | None = None  # it failed because this Python module is not installed


def attempt(
    names: Sequence[str], settings: Settings, timeout: float, worker: str = _WORKER
) -> dict[str, Outcome]:
    """Make trials, in order.

    Args:
        names: of the trials.
        settings: what they go by.
        timeout: s of wall time for each process that is needed.
        worker: module that is run.
    """
    outcomes: dict[str, Outcome] = {}
    while remaining := [name for name in names if name not in outcomes]:
        found, reason = _one_process(remaining, settings, timeout, worker)
        outcomes.update(found)
        if len(found) < len(remaining):
            outcomes[remaining[len(found)]] = Outcome(failure=reason)
    return outcomes


def _one_process(
    names: Sequence[str], settings: Settings, timeout: float, worker: str
) -> tuple[dict[str, Outcome], str]:
    """What a process got done, in order, and why it ended."""
    paths = [*_PACKAGES, os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}
    try:
        ended = subprocess.run(
            python("-m", worker),
            input=pickle.dumps((tuple(names), settings)),
            capture_output=True,
            timeout=timeout,
            env=environment,
            check=False,
        )
    except subprocess.TimeoutExpired as late:
        return _outcomes(names, late.stdout or b""), f"did not end within {timeout:g} s"
    except OSError as error:
        return {}, f"no process could be started: {error.strerror}"
    return _outcomes(names, ended.stdout), _reason(ended.returncode, ended.stderr)


def _outcomes(names: Sequence[str], written: bytes) -> dict[str, Outcome]:
    """Outcomes by trial; lines that libraries wrote among them are passed over."""
    found: dict[str, Outcome] = {}
    for line in written.decode(errors="replace").splitlines():
        with contextlib.suppress(ValueError, TypeError):
            entry = parse_json(line)
            if isinstance(entry, dict) and entry.get("trial") in names:
                name = entry.pop("trial")
                found[name] = Outcome(**entry)
    return found


def _reason(code: int, errors: bytes) -> str:
    if code < 0:
        try:
            return f"the process was ended by {signal.Signals(-code).name}"
        except ValueError:
            return f"the process was ended by signal {-code}"
    said = errors.decode(errors="replace").strip().splitlines()
    return said[-1] if said else f"the process ended with status {code}"


def pip(*arguments: str) -> str:
    """`pip install` for the very Python that runs this program."""
    return " ".join([_python(), "-m pip install", *map(_quoted, arguments)])


def root(command: str) -> str:
    """A command that only root may give."""
    return command if os.geteuid() == 0 else f"sudo {command}"


def _python() -> str:
    """The shortest name under which this shell finds our Python."""
    own = Path(sys.executable)
    for name in ("python", "python3"):
        found = shutil.which(name)
        if found is not None and Path(found) == own:
            return name
    try:
        return shlex.quote(str(own.relative_to(Path.cwd())))
    except ValueError:
        return shlex.quote(str(own))


def _quoted(argument: str) -> str:
    return argument if argument.startswith("-") else shlex.quote(argument)


# -- in the other process --------------------------------------------------------------------------

MOST_CLASSES = 20
"""Robot classes of the user's own that are tried out."""


def main() -> int:
    """Make the trials that are asked for."""
    names, settings = pickle.loads(sys.stdin.buffer.read())
    # Native libraries may write what they like, but not between the answers.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    for name in names:
        _answer(answers, name, try_out(name, settings))
    answers.flush()
    # Threads and contexts of trials that failed are not waited for.
    os._exit(0)


def try_out(name: str, settings: Settings) -> dict[str, object]:
    """Fields of the outcome of one trial."""
    function, _, argument = name.partition(":")
    try:
        return {"values": globals()[function](settings, argument)}
    except UsarsimError as error:
        problem, advice = problem_and_advice(str(error))
        return {"failure": problem, "told": True, "advice": advice}
    except ImportError as error:
        text = _one_line(f"{type(error).__name__}: {error}")
        absent = isinstance(error, ModuleNotFoundError)
        return {"failure": text, "missing": error.name if absent else None}
    except Exception as error:
        return {"failure": _one_line(f"{type(error).__name__}: {error}")}


def _answer(stream: TextIO, name: str, outcome: dict[str, object]) -> None:
    print(json.dumps({"trial": name, **outcome}), file=stream, flush=True)


def _one_line(text: str) -> str:
    return " ".join(text.split())


def package(settings: Settings, module: str) -> dict[str, object]:
    """Import a module; which version of its distribution is installed."""
    loaded = importlib.import_module(module)
    for distribution in metadata.packages_distributions().get(module, ()):
        return {"version": metadata.version(distribution)}
    return {"version": str(getattr(loaded, "__version__", ""))}


def gl(settings: Settings, platform: str) -> dict[str, object]:
    """What an OpenGL context of a platform says about itself."""
    os.environ["MUJOCO_GL"] = "disable"
    os.environ["PYOPENGL_PLATFORM"] = platform
    context: Any = importlib.import_module(f"mujoco.{platform}").GLContext(16, 16)
    context.make_current()
    calls: Any = importlib.import_module("OpenGL.GL")
    asked = {"renderer": calls.GL_RENDERER, "vendor": calls.GL_VENDOR, "version": calls.GL_VERSION}
    return {name: (calls.glGetString(what) or b"").decode() for name, what in asked.items()}


def findings(settings: Settings, key: str) -> dict[str, object]:
    """What a check finds that shall run here."""
    from usarsim_doctor.registry import Context, all_checks

    [one] = [one for one in all_checks() if one.key == key]
    found = one.look(Context(settings))
    return {"findings": [asdict(finding) | {"mark": finding.mark.value} for finding in found]}


def server(settings: Settings, _: str) -> dict[str, object]:
    """Put the server together as `serve` would, but open no port and let no time pass.

    Robot classes of the user's own are put into the world, one after another.
    """
    from usarsim_server.app import assemble
    from usarsim_server.robots.catalog import load_catalog
    from usarsim_server.simulation import native
    from usarsim_server.simulation.rays.compiled import ray_code

    started = time.perf_counter()
    assembly = assemble(settings)
    try:
        seconds = time.perf_counter() - started
        folders = [folder.resolve() for folder in settings.robots]
        catalog = load_catalog(settings.robots, allow_outside=settings.allow_outside)
        own = [
            robot for robot in catalog.descriptions() if robot.source.resolve().parent in folders
        ]
        broken: list[dict[str, str | None]] = []
        for robot in own[:MOST_CLASSES]:
            try:
                vehicle = assembly.robots.spawn(robot, None, assembly.world.starts[0].pose)
                assembly.robots.remove(vehicle)
            except (UsarsimError, ValueError) as error:
                problem, advice = problem_and_advice(str(error))
                broken.append({"name": robot.name, "problem": problem, "advice": advice})
        return {
            "world": assembly.world.name,
            "seconds": seconds,
            "tried": len(own[:MOST_CLASSES]),
            "broken": broken,
            "not_compiled": native.library()[1]
            or (None if ray_code() else "Embree's library cannot be called for rays"),
        }
    finally:
        assembly.stop()


if __name__ == "__main__":
    sys.exit(main())
