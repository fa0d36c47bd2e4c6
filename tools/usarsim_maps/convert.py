"""One import from end to end: find the reader, merge the sidecar, build, report, remember."""

from __future__ import annotations

import os
import secrets
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from usarsim_maps.build.builder import build
from usarsim_maps.build.sheet import safe
from usarsim_maps.cache import RECORD, ImportCache, default_cache
from usarsim_maps.findings import Findings
from usarsim_maps.reader import (
    Context,
    ImportOptions,
    find_reader,
    read_scene,
    unwatched,
    without_refused,
)
from usarsim_maps.report import Report, make_report
from usarsim_maps.sidecar import find_sidecar, load_sidecar
from usarsim_maps.terminal import ProgressBar, quiet
from usarsim_server import __version__
from usarsim_server.base.errors import MapImportError, at
from usarsim_server.base.files import ALLOW, Folders, is_folder, is_regular, publish_folder
from usarsim_server.world_cost import LIMITS, WorldLimits
from usarsim_server.worlds.loader import SHEET


@dataclass(frozen=True, slots=True)
class Request:
    """What to import and how."""

    source: Path  # the map
    out: Path | None = None  # folder in which the world folder is made; None: it stays in the cache
    name: str | None = None  # of the world; None: the file's
    options: ImportOptions = field(default_factory=ImportOptions)  # for the reader
    sidecar: Path | None = None
    """File that adds and overrides; None: the one beside the map, if there is one."""
    cache: Path = field(default_factory=default_cache)  # folder of finished imports
    fresh: bool = False  # import even if the cache has it
    hold: bool = False  # keep the world in the cache as it is until this process ends


@dataclass(frozen=True, slots=True, eq=False)
class Imported:
    """The result."""

    folder: Path  # a world folder
    report: Report  # about the import, even if it was made earlier
    cached: bool  # nothing had to be done


@quiet()
def import_map(request: Request, progress: Callable[[str, float], None] = unwatched) -> Imported:
    """Turn a map into a world folder; what libraries warn of meanwhile is only logged.

    Args:
        request: what and how.
        progress: told what is being done and the part of it that is done; may raise to stop.

    Raises:
        MapImportError: naming file, place and cure; what was there before is left alone.
    """
    source = _resolved(request.source)
    reader = find_reader(source)
    name = safe(request.name or source.stem)
    target = None if request.out is None else _target(source, request.out, name)
    sidecar_path = find_sidecar(source, request.sidecar)
    sidecar = None if sidecar_path is None else load_sidecar(sidecar_path)
    assets = tuple(_resolved(folder) for folder in request.options.assets)
    options = replace(request.options, assets=assets)
    folders = Folders([source.parent, *assets], allow_outside=options.allow_outside)
    if sidecar is not None:
        options = sidecar.options(options)
    if sidecar is not None and request.sidecar is not None:
        folders = folders.with_more([sidecar.path.parent, *sidecar.assets])
    for folder in options.assets:
        refusal = None if sidecar is None else folders.refusal(folder, sidecar.path)
        if refusal is not None and sidecar is not None:
            raise MapImportError(at(sidecar.path, refusal, ALLOW, where="assets"))
        if not is_folder(folder):
            raise MapImportError(at(folder, "no such folder", "check --assets"))
    cache = ImportCache(request.cache)
    key = cache.key(source, sidecar_path, options, name)
    with cache.changing():
        found = None if request.fresh else cache.find(key, name)
        held = None if found is None else cache.hold(found[0])
    if found is not None:
        folder, record = found
        remembered = _report(record)
        if remembered is not None:
            delivered = _deliver(folder, target)
            if not request.hold:
                cache.release(held)
            return Imported(delivered, remembered, cached=True)
        cache.release(held)
    findings, began = Findings(), time.monotonic()
    context = Context(options, findings, progress, folders)
    scene = read_scene(source, context)
    if sidecar is not None:
        scene = without_refused(sidecar.apply(scene, findings), context, sidecar.path)
    with cache.building(source) as workshop:
        place = workshop / name
        origin = _origin(source, options, reader.title)
        try:
            place.mkdir()
            built = build(scene, place, findings, progress, origin, options.limits)
            report = make_report(scene, built, findings, time.monotonic() - began)
            files = {*scene.source.files, source}
            if sidecar_path is not None:
                files.add(sidecar_path)
            with cache.changing():
                folder = cache.store(key, place, {"report": report.data()}, sorted(files))
                held = cache.hold(folder)
        except OSError as error:
            cure = "free some space, or set XDG_CACHE_HOME to another disk"
            problem = f"cannot be written: {error.strerror}"
            raise MapImportError(at(error.filename or place, problem, cure)) from error
    delivered = _deliver(folder, target)
    if not request.hold:
        cache.release(held)
    return Imported(delivered, report, cached=False)


def _resolved(path: Path) -> Path:
    try:
        return path.expanduser().resolve()
    except (OSError, RuntimeError, ValueError) as error:  # too long, in a circle, of nobody
        problem = f"no such file or folder ({error})"[:200]
        raise MapImportError(at(path, problem, "check the path")) from None


def _origin(source: Path, options: ImportOptions, title: str) -> dict[str, object]:
    return {
        "source": source.name,
        "format": title,
        "version": __version__,
        "scale": options.scale,
        "up": options.up,
        "mirror": options.mirror,
    }


def _target(source: Path, out: Path, name: str) -> Path:
    """The folder to write; refused if it holds something that no import made."""
    target = _resolved(out) / name
    if os.path.lexists(target) and not is_regular(target / RECORD) and any(_entries(target)):
        cure = "give another --out or --name; only imported worlds are replaced"
        raise MapImportError(at(target, "there is something here already", cure))
    if target == source:
        raise MapImportError(at(target, "this is the map itself", "give another --out"))
    return target


def _entries(path: Path) -> list[Path]:
    return list(path.iterdir()) if path.is_dir() else [path]


def _deliver(folder: Path, target: Path | None) -> Path:
    """Copy a world out of the cache if somebody wants it elsewhere."""
    if target is None:
        return folder
    fresh = target.with_name(f".new-{secrets.token_hex(8)}")
    try:
        shutil.copytree(folder, fresh)
        publish_folder(fresh, target)
    except OSError as error:
        # Of several errors `copytree` tells each as file, copy and text.
        reason = error.strerror or error.args[0][0][2].partition("] ")[2]
        problem = f"cannot be written: {reason}"
        raise MapImportError(at(target, problem, "give another --out")) from error
    finally:
        shutil.rmtree(fresh, ignore_errors=True)
    assert (target / SHEET).is_file()
    return target


def _report(record: dict[str, Any]) -> Report | None:
    """The report in a record; None if somebody has changed it."""
    try:
        data = dict(record["report"])
        for key in ("extents", "lower", "upper"):
            data[key] = None if data[key] is None else tuple(data[key])
        data["transparent"] = tuple(data["transparent"])
        for key in ("starts", "missing", "warnings", "clear"):
            data[key] = tuple(tuple(row) for row in data[key])
        return Report(**data)
    except (KeyError, TypeError, ValueError):
        return None


def world_of_map(source: Path, allow_outside: bool, limits: WorldLimits = LIMITS) -> Path:
    """The folder of a world that is made of a map, or was made of it before; shows a bar meanwhile.

    The server calls it, by the entry point group `usarsim_server.maps`, for `--world MAP`.

    Raises:
        MapImportError: see `import_map`.
    """
    with ProgressBar() as bar:
        options = ImportOptions(allow_outside=allow_outside, limits=limits)
        return import_map(Request(source, options=options, hold=True), bar).folder
