"""The process that makes trials: reads what to do from standard input, writes a line for each.

The order is a pickle of the trials' names and the settings; an answer is a JSON object with the
fields of `isolation.Outcome` and `trial`, the name. A name is that of a function of `trials.py`,
and what follows a colon is its argument.
"""

from __future__ import annotations

import json
import os
import pickle
import sys
from typing import TextIO

from usarsim_server.doctor.registry import problem_and_advice
from usarsim_server.errors import UsarsimError
from usarsim_server.settings import Settings


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
    from usarsim_server.doctor import team as trials

    function, _, argument = name.partition(":")
    try:
        return {"values": getattr(trials, function)(settings, argument)}
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


if __name__ == "__main__":
    sys.exit(main())
