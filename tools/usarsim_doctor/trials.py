"""Makes trials in a process that may crash; `isolation` starts it.

It reads a pickle of the trials' names and the settings, and writes a line for each, a JSON object
with the fields of `isolation.Outcome` and `trial`, the name. A name is that of a function of this
file; what follows a colon is its argument. Each such function takes the settings of the server and
that argument, imports what it needs itself, and returns facts that can be written as JSON.
"""

from __future__ import annotations

import importlib
import json
import os
import pickle
import sys
import time
from dataclasses import asdict
from importlib import metadata
from typing import Any, TextIO

from usarsim_server.base.errors import UsarsimError, problem_and_advice
from usarsim_server.settings import Settings

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
    from usarsim_doctor.examination import all_checks
    from usarsim_doctor.registry import Context

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
