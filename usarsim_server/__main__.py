"""The program: `usarsim`, or `python -m usarsim_server`."""

from __future__ import annotations

import sys

from usarsim_server.base import interrupts, streams

_UNTIL_INTERRUPTED = (["serve"], ["record"], ["console"], ["demo"])
"""Commands that run until a signal comes, which is no failure then."""


def main() -> int:
    """Run the command line as a program of its own, which owns the signals of this process.

    Returns:
        The exit code: that of the command; 130 or 143 if SIGINT or SIGTERM ended one that would
        have ended by itself.
    """
    streams.guard()
    interrupts.arm(ordinary=sys.argv[1:2] in _UNTIL_INTERRUPTED)
    code = 1
    try:
        from usarsim_server import cli

        interrupts.begin()
        code = cli.main()
    except BaseException:
        if not interrupts.interrupted():
            raise
    return interrupts.finish(code)


if __name__ == "__main__":
    sys.exit(main())
