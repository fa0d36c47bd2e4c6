"""Reads everything in a stage once, as a program of its own.

The library's reader of binary files can crash or never end on damaged ones. `stage.py` lets it do
so here, in another process. Arguments: the file, then folders searched for references. It writes
one line of JSON: which files the stage is composed of, as `[[file that names it, file], ...]`.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import stat
import sys

from pxr import Ar, Sdf, Tf, Usd, UsdUtils

MOST_LAYERS = 20_000
"""Files of one stage."""

MEMORY = 12 << 30
"""Bytes of address space; the library's threads reserve some of it."""


def main(source: str, folders: list[str]) -> int:
    """0 also for files that the library refuses: it will say why again."""
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    silent = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        context = Ar.ResolverContext(Ar.DefaultResolverContext(folders))
        with Ar.ResolverContextBinder(context):
            named, whole = parts(source)
        print(json.dumps(named), flush=True)
        if not whole:
            return 0
        stage = Usd.Stage.Open(source, context)
        for prim in stage.TraverseAll() if stage else ():
            for attribute in prim.GetAuthoredAttributes():
                attribute.Get(Usd.TimeCode.EarliestTime())
    except (Tf.ErrorException, MemoryError):
        pass
    del silent
    return 0


def parts(source: str) -> tuple[list[tuple[str, str]], bool]:
    """Files that a stage is composed of, in pairs with the one that names them, before it is.

    Nothing but regular files is opened: the library would wait for ever for what a pipe says.

    Returns:
        The pairs, and whether all of them are regular files.
    """
    found: list[tuple[str, str]] = []
    seen, todo, whole = {source}, [source], True
    while todo and len(seen) < MOST_LAYERS:
        asker = todo.pop()
        layer = Sdf.Layer.FindOrOpen(asker)
        for name in layer.GetCompositionAssetDependencies() if layer else ():
            written = Sdf.ComputeAssetPathRelativeToLayer(layer, name)
            path = str(Ar.GetResolver().Resolve(written)) or written
            if path in seen:
                continue
            seen.add(path)
            outer = Ar.SplitPackageRelativePathOuter(path)[0]
            with contextlib.suppress(OSError, ValueError):
                regular = stat.S_ISREG(os.stat(outer).st_mode)
                whole &= regular
                found.append((asker, outer))
                if regular:
                    todo.append(path)
    return found, whole


if __name__ == "__main__":
    code = main(sys.argv[1], sys.argv[2:])
    # Nothing has to be tidied up, and taking a large stage apart takes long.
    os._exit(code)
