"""Reads everything in a stage once, as a program of its own.

The library's reader of binary files can crash or never end on damaged ones. `stage.py` lets it do
so here, in another process. Arguments: the file, then folders searched for references.
"""

from __future__ import annotations

import contextlib
import os
import resource
import sys

from pxr import Ar, Tf, Usd, UsdUtils

MEMORY = 12 << 30
"""Bytes of address space; the library's threads reserve some of it."""


def main(source: str, folders: list[str]) -> int:
    """0 also for files that the library refuses: it will say why again."""
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    silent = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        context = Ar.ResolverContext(Ar.DefaultResolverContext(folders))
        stage = Usd.Stage.Open(source, context)
        for prim in stage.TraverseAll() if stage else ():
            for attribute in prim.GetAuthoredAttributes():
                attribute.Get(Usd.TimeCode.EarliestTime())
    except (Tf.ErrorException, MemoryError):
        pass
    del silent
    return 0


if __name__ == "__main__":
    code = main(sys.argv[1], sys.argv[2:])
    # Nothing has to be tidied up, and taking a large stage apart takes long.
    os._exit(code)
