"""The subcommands of `usarsim explore`: each module has `add_parser`; a new file is enough."""

from __future__ import annotations

import argparse


def add_run_code(parser: argparse.ArgumentParser) -> None:
    """Add `--run-code`: whoever sent results may have put any program beside them."""
    parser.add_argument(
        "--run-code",
        action="store_true",
        help="run the strategy file (.py) that the results name; read it first",
    )
