"""`usarsim study power`: how many participants an effect needs."""

from __future__ import annotations

import argparse
import math

from usarsim_server.cli.common import Subparsers, add_command, facts
from usarsim_server.errors import UsarsimError
from usarsim_server.extras import need

_EPILOG = (
    "dz is the mean difference between two conditions over the standard deviation of the "
    "differences: 0.2 is small, 0.5 medium, 0.8 large."
)


def add_parser(subparsers: Subparsers) -> None:
    """Add `power`."""
    text = "power of a study within participants, simulated and in closed form"
    parser = add_command(subparsers, "power", text, run, epilog=_EPILOG)
    parser.add_argument("--dz", type=_positive, default=0.8, help="true effect (default 0.8)")
    parser.add_argument("--n", type=_pairs, help="participants; without it, how many are needed")
    parser.add_argument(
        "--power", type=_share, default=0.8, help="that is needed without --n (default 0.8)"
    )
    parser.add_argument("--alpha", type=_share, default=0.05, help="level (default 0.05)")


def run(arguments: argparse.Namespace) -> int:
    """Print power, or the number that is needed.

    Raises:
        UsarsimError: no number of participants is enough, or scipy is not installed.
    """
    need("scipy", "matplotlib", extra="study", asker="the power")
    from usarsim_study import power

    n = arguments.n or power.needed(arguments.dz, arguments.power, arguments.alpha)
    if n is None:
        raise UsarsimError(
            f"--dz: needs more than {power.MOST} participants (look for more effect)"
        )
    rows: list[tuple[str, object]] = [
        ("participants", n),
        ("dz", f"{arguments.dz:g}"),
        ("alpha", f"{arguments.alpha:g}"),
        ("paired t, closed form", f"{power.closed_form(arguments.dz, n, arguments.alpha):.3f}"),
        ("paired t, simulated", f"{power.simulated(arguments.dz, n, arguments.alpha):.3f}"),
    ]
    if n <= 50:
        exact = power.simulated(arguments.dz, n, arguments.alpha, "wilcoxon")
        rows.append(("Wilcoxon, simulated", f"{exact:.3f}"))
    print(facts(rows))
    return 0


def _positive(text: str) -> float:
    number = float(text)
    if not 0.0 < number < math.inf:
        raise argparse.ArgumentTypeError("must be greater than 0")
    return number


def _share(text: str) -> float:
    number = float(text)
    if not 0.0 < number < 1.0:
        raise argparse.ArgumentTypeError("must be between 0 and 1")
    return number


def _pairs(text: str) -> int:
    number = int(text)
    if not 2 <= number <= 1000:
        raise argparse.ArgumentTypeError("must be from 2 to 1000")
    return number
