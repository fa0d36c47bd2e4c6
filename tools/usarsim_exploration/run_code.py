"""The option that lets commands which read results run programs that came with them."""

from __future__ import annotations

import argparse


def add_run_code(parser: argparse.ArgumentParser) -> None:
    """Add `--run-code`: whoever sent results may have put any program beside them."""
    parser.add_argument(
        "--run-code",
        action="store_true",
        help="run the strategy file (.py) that the results name; read it first",
    )
