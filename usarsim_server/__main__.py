"""The program: `usarsim`, or `python -m usarsim_server`."""

from __future__ import annotations

import sys

from usarsim_server.base import processes, streams

_UNTIL_INTERRUPTED = (["serve"], ["record"], ["console"], ["demo"])
"""Commands that run until a signal comes, which is no failure then."""


def main() -> int:
    """Run the command line as a program of its own, which owns the signals of this process.

    Returns:
        The exit code: that of the command; 130 or 143 if SIGINT or SIGTERM ended one that would
        have ended by itself.
    """
    streams.guard()
    processes.arm(ordinary=sys.argv[1:2] in _UNTIL_INTERRUPTED)
    code = 1
    try:
        from usarsim_server import cli

        processes.begin()
        code = cli.main()
    except BaseException:
        if not processes.interrupted():
            raise
    return processes.finish(code)


if __name__ == "__main__":
    sys.exit(main())
