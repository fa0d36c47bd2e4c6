"""`make fidelity`: the physics acceptance tests of robots reference 3.3, and their table.

Robots are driven by DRIVE commands through the whole server, without sockets and without a clock;
the measuring instrument is the state of the physics itself. See docs/fidelity.md.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from motion.results import ANY, Band, Result, as_json, as_markdown, as_table
from motion.stage import StageError
from motion.table import TRIALS, Trial
from motion.workshop import Workshop
from usarsim_server.base.errors import UsarsimError, at
from usarsim_server.cli.common import written

TIMESTEPS = (0.001, 0.002, 0.004, 0.005)
"""s: the time steps that have to agree."""
QUICK_TIMESTEPS = (0.004,)
BEGIN, END = "<!-- fidelity table: begin -->", "<!-- fidelity table: end -->"
"""Lines of a page between which `--markdown` puts the table."""


def run_trials(
    trials: Sequence[Trial], timesteps: Sequence[float], tests: Sequence[str] = ()
) -> Iterator[Result]:
    """Carry out trials at time steps (s); one that breaks down yields a failed result and the next
    one follows. Of the results those of the given tests are wanted, all if there are none."""
    with Workshop() as shop:
        for trial in trials:
            for robot in trial.robots:
                try:
                    for result in trial.run(shop, robot, timesteps):
                        if not tests or result.test in tests:
                            yield result
                except StageError as error:
                    failed = trial.tests[0], robot, str(error), None, math.nan
                    yield Result(*failed, "", "", Band(0.0, 0.0))


def main(args: list[str]) -> int:
    """Run the acceptance tests and print their table.

    Returns 0 if everything lies in its band, else 1.

    Raises:
        UsarsimError: if a file cannot be written.
        SystemExit: from argparse.
    """
    options = _parser().parse_args(args)
    for path in (options.json, options.markdown):
        if path is not None and not path.absolute().parent.is_dir():
            raise UsarsimError(at(path, "there is no such folder", "make the folder first"))
    trials = [one for one in TRIALS if not options.only or set(options.only) & set(one.tests)]
    timesteps = QUICK_TIMESTEPS if options.quick else TIMESTEPS
    results = []
    print(as_table([]))
    for result in run_trials(trials, timesteps, options.only):
        results.append(result)
        print(as_table([result], heads=False), flush=True)
    print(_summary(results))
    if options.json is not None:
        with written(options.json) as page:
            page.write(as_json(results).encode() + b"\n")
    if options.markdown is not None:
        text = _page(options.markdown, as_markdown(results))
        with written(options.markdown) as page:
            page.write(text.encode())
    return 0 if all(result.passed for result in results) else 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="make fidelity ARGS=...",
        description="Physics acceptance tests: what the robots do, and what they should do.",
        allow_abbrev=False,
    )
    parser.add_argument(
        "--only",
        type=_tests,
        default=(),
        metavar="LIST",
        help="tests to run, separated by commas, for example V4,V5",
    )
    parser.add_argument("--quick", action="store_true", help="at a time step of 4 ms only")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results as JSON")
    parser.add_argument(
        "--markdown",
        type=Path,
        metavar="FILE",
        help="write the table into a page, between its marks if it has any",
    )
    return parser


def _tests(text: str) -> tuple[str, ...]:
    known = {number.lower(): number for trial in TRIALS for number in trial.tests}
    chosen = []
    for word in filter(None, (part.strip().lower() for part in text.split(","))):
        # The shell takes #59 for a comment, so 59 will do.
        number = known.get(word) or known.get(f"#{word}")
        if number is None:
            raise argparse.ArgumentTypeError(f"no test {word}; known: {', '.join(known.values())}")
        chosen.append(number)
    return tuple(chosen)


def _summary(results: Sequence[Result]) -> str:
    failed = sum(not result.passed for result in results)
    informative = sum(result.band == ANY for result in results)
    passed = len(results) - failed - informative
    return f"{passed} passed, {failed} failed, {informative} for information"


def _page(path: Path, table: str) -> str:
    """The page with its table replaced; a page without marks becomes the table alone."""
    text = path.read_text(encoding="utf-8") if path.is_file() else ""
    head, begin, rest = text.partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not (begin and end):
        return table
    return f"{head}{BEGIN}\n\n{table}\n{END}{tail}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
