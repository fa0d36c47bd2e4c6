"""Opening stages: archives checked before they are, errors told, variants chosen."""

from __future__ import annotations

import contextlib
import re
import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from pxr import Ar, Tf, Usd, UsdGeom, UsdUtils

from usarsim_maps.apart import run_apart
from usarsim_maps.archives import open_archive
from usarsim_maps.files import MAX_BYTES, check_size, opened, read_bytes, read_head
from usarsim_maps.findings import Findings
from usarsim_maps.reader import Context
from usarsim_maps.usd.schemas import STAGES
from usarsim_server.base.errors import MapImportError, at
from usarsim_server.base.files import ALLOW, is_regular
from usarsim_server.base.launch import python
from usarsim_server.protocol.json_text import parse_json

BINARY = b"PXR-USDC"
TRIAL = Path(__file__).with_name("trial.py")

MAX_RESOURCE = 256 << 20
"""Bytes of a picture inside an archive."""

MAX_ROUNDS = 8
"""Variants within variants."""

LEVELS = "lod"
"""What the names of variant sets of levels of detail begin with, in lower case."""

_QUOTED = re.compile(r" : '(.*?)'\s*(?=\n\s*Error in|$)", re.DOTALL)
_PLACE = re.compile(r".*?:(?P<line>\d+):\d+: (?P<problem>.+)")
_CLASSES = re.compile(r"\b(?:pxrInternal\w*|Sdf_\w+)::")
_MEMORY = re.compile(r" \([^()]*<0x[0-9a-f]+>\)|<0x[0-9a-f]+>")
_ASSET = re.compile(r"@(?P<file>[^@]+)@")
_DIGITS = re.compile(r"\d+$")


def check_archive(source: Path) -> None:
    """Look through the table of a USDZ archive before anything is taken out of it.

    Raises:
        MapImportError: it is no archive, its files are compressed, which USDZ forbids and bombs
            need, or they are larger than the archive.
    """
    cure = "make it again with usdzip, or with the program that exported it"
    with opened(source) as file, open_archive(source, file, cure) as archive:
        entries = archive.infolist()
    for entry in entries:
        if entry.compress_type != zipfile.ZIP_STORED or entry.file_size != entry.compress_size:
            problem = f"{entry.filename} is compressed; USDZ allows no compression"
            raise MapImportError(at(source, problem, cure))
    total = sum(entry.file_size for entry in entries)
    if total > source.stat().st_size:
        problem = f"the files in it say they have {total} bytes, more than the archive"
        raise MapImportError(at(source, problem, cure))


def try_out(source: Path, context: Context) -> None:
    """Let another process read a binary file first: a damaged one may end or stall it.

    That is a `MapImportError` then, as is a file that the stage needs and that may not be read.
    Text is read here, unless it brings in other files.
    """
    binary = source.suffix.lower() == ".usdz" or read_head(source).startswith(BINARY)
    if not binary and b"@" not in read_bytes(source):
        return
    folders = context.options.assets
    command = python(str(TRIAL), str(source), *map(str, folders))
    cure = "the file is damaged; export it again, or as .usda"
    done = run_apart(command, source, "USD", cure, source.stat().st_size)
    try:
        named = parse_json(done.stdout or b"[]")
    except ValueError:
        named = []  # names that are no text; what is opened in the end is looked at once more
    for asker, path in named:
        check_layer(context, Path(asker), Path(path))


def check_layer(context: Context, asker: Path, path: Path) -> None:
    """Refuse a file that a stage is composed of, if it lies outside or is no regular file."""
    refusal = context.confined().refusal(path, asker)
    if refusal is not None:
        raise MapImportError(at(asker, refusal, ALLOW))
    read_head(path)


def open_stage(source: Path, context: Context) -> Any:
    """Open a stage with all its payloads.

    References that are not found where they should be are searched in the asset folders; the
    findings are told of files that are missing.

    Raises:
        MapImportError: the file itself cannot be read; line and reason are those of the library.
            Or the stage needs a file that may not be read.
    """
    check_size(source, source.stat().st_size, MAX_BYTES)
    if source.suffix.lower() == ".usdz":
        check_archive(source)
    try_out(source, context)
    folders = Ar.DefaultResolverContext([str(folder) for folder in context.options.assets])
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        stage = Usd.Stage.Open(str(source), Ar.ResolverContext(folders))
    except Tf.ErrorException as error:
        raise broken(source, error) from None
    finally:
        messages = _messages(delegate)
        del delegate
    if stage is None:
        raise broken(source, "\n".join(messages))
    for path in files_of(stage):
        check_layer(context, source, path)
    _tell(stage, messages, context.findings)
    return stage


@contextlib.contextmanager
def listening(findings: Findings) -> Iterator[None]:
    """What the library would print meanwhile goes into the report."""
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        yield
    finally:
        for text in _messages(delegate):
            findings.warn("USD", _plain(text))
        del delegate


def _messages(delegate: Any) -> list[str]:
    """What the library would have printed; damaged files can put anything into it."""
    try:
        return [item.commentary for item in delegate.TakeUncoalescedDiagnostics()]
    except UnicodeDecodeError:
        return []


def broken(source: Path, reason: object) -> MapImportError:
    """The error for a file that the library does not read; the reason holds line and column."""
    try:
        text = str(reason)
    except UnicodeDecodeError:
        text = "it is no text"
    parts = [_plain(part) for part in _QUOTED.findall(text)] or [_plain(text)]
    problem, where = parts[0] or "the USD library cannot read it", ""
    place = _PLACE.match(problem)
    if place is not None:
        where, problem = f"line {place['line']}", place["problem"]
    cure = "the file is damaged or cut off; export it again"
    return MapImportError(at(source, problem, cure, where=where))


def _plain(text: str) -> str:
    """A message of the library on one line, without names of its classes and places in memory."""
    return " ".join(_CLASSES.sub("", _MEMORY.sub("", text)).split())[:300]


def _tell(stage: Any, messages: Iterable[str], findings: Findings) -> None:
    """Note missing and broken files and targets; the rest of the stage is there all the same."""
    # In order: the library's threads find them in any.
    errors = sorted(str(error) for error in stage.GetCompositionErrors())
    more = sorted(text for text in messages if not any(error in text for error in errors))
    for text in (*errors, *more):
        found = _ASSET.search(text)
        if found is not None and ("Could not open" in text or "Could not load" in text):
            _tell_file(found["file"], _plain(text.partition(" -- ")[2]), findings)
        else:
            findings.warn("USD", _plain(text))


def _tell_file(name: str, problem: str, findings: Findings) -> None:
    """Note a reference, a payload or a layer that is not there, or that the library cannot read.

    The name is that in the stage if it led to no file.
    """
    path = Path(name)
    if not (path.is_absolute() and is_regular(path)):
        findings.missing("file", name)
        findings.warn(name, "a reference or payload cannot be opened; left out")
        return
    findings.skip("file", path.name)
    if path.suffix.lower() in STAGES:
        findings.warn(path.name, f"a reference or payload is damaged and was left out ({problem})")
    else:
        findings.warn(path.name, "a reference to no file of OpenUSD was left out; export it as one")


def finest_variants(stage: Any, findings: Findings) -> None:
    """Choose the finest level of detail wherever a stage offers some (worlds 34).

    That are variant sets `LOD...`, and the children of prims with the schema `LODRootAPI`.
    Instances that hold such sets inside become single prims, since what instances share cannot be
    changed.
    """
    stage.SetEditTarget(Usd.EditTarget(stage.GetSessionLayer()))
    for _ in range(MAX_ROUNDS):
        changes = sum(
            _choose_finest(prim, findings)
            for prim in list(stage.TraverseAll())
            if prim  # no longer where a choice above it has taken it away
        )
        for prototype in stage.GetPrototypes():
            if any(_coarse(prim) for prim in Usd.PrimRange(prototype)):
                for instance in prototype.GetInstances():
                    if not instance.IsInPrototype():
                        instance.SetInstanceable(False)
                        changes += 1
        if not changes:
            return


def _coarse(prim: Any) -> dict[str, str]:
    """Finest variants by set, where another one is chosen."""
    sets = prim.GetVariantSets()
    answer = {}
    for name in sets.GetNames():
        if name.lower().startswith(LEVELS):
            chosen = sets.GetVariantSelection(name)
            finest = min(sets.GetVariantSet(name).GetVariantNames(), key=_level, default=chosen)
            if finest != chosen:
                answer[name] = finest
    return answer


def _choose_finest(prim: Any, findings: Findings) -> int:
    """Choose the finest level of detail of one prim; how many choices were made."""
    coarse = _coarse(prim)
    for name, finest in coarse.items():
        prim.GetVariantSets().SetSelection(name, finest)
        findings.fact("levels of detail", f"the finest ({finest})")
    changes = len(coarse)
    if "LODRootAPI" in prim.GetPrimTypeInfo().GetAppliedAPISchemas():
        for level in prim.GetChildren()[1:]:
            level.SetActive(False)
            findings.fact("levels of detail", "the finest")
            changes += 1
    return changes


def tell_unused(stage: Any, findings: Findings) -> None:
    """Count what a stage holds and does not show.

    Variants that are not selected, prims that are not active, and `over` of prims that no file
    defines, unless an instancer copies them. Levels of detail are no loss.
    """
    copied = [
        path
        for prim in stage.TraverseAll()
        if prim.GetTypeName() == "PointInstancer"
        for path in UsdGeom.PointInstancer(prim).GetPrototypesRel().GetTargets()
    ]
    walk = iter(Usd.PrimRange.AllPrims(stage.GetPseudoRoot()))
    for prim in walk:
        kind = ""
        if not prim.IsActive():
            kind = "" if _is_level(prim) else "inactive"
        elif prim.IsPseudoRoot() or prim.IsDefined() or prim.IsAbstract():
            _tell_variants(prim, findings)
            continue
        elif not any(
            path.HasPrefix(prim.GetPath()) or prim.GetPath().HasPrefix(path) for path in copied
        ):
            kind = "over"
        if kind:
            findings.skip(kind, prim.GetName())
        walk.PruneChildren()


def _tell_variants(prim: Any, findings: Findings) -> None:
    sets = prim.GetVariantSets()
    for name in sets.GetNames():
        if name.lower().startswith(LEVELS):
            continue
        chosen = sets.GetVariantSelection(name)
        for other in sets.GetVariantSet(name).GetVariantNames():
            if other != chosen:
                findings.skip("variant", f"{name} {other}")


def _is_level(prim: Any) -> bool:
    """Whether a prim is one of several levels of detail."""
    return "LODRootAPI" in prim.GetParent().GetPrimTypeInfo().GetAppliedAPISchemas()


def has_samples(stage: Any) -> bool:
    """Whether anything in a stage may change over time."""
    return any(layer.ListAllTimeSamples() for layer in stage.GetUsedLayers())


def _level(name: str) -> tuple[int, str]:
    digits = _DIGITS.search(name)
    return (int(digits[0]) if digits and len(digits[0]) < 9 else 10**9), name


def files_of(stage: Any) -> list[Path]:
    """All files that the stage is composed of."""
    paths = (layer.realPath for layer in stage.GetUsedLayers() if layer.realPath)
    outer = (Ar.SplitPackageRelativePathOuter(path)[0] for path in paths)
    return sorted({Path(path) for path in outer})


def read_resource(path: str) -> bytes | None:
    """A file inside an archive, by a path such as `a.usdz[wood.png]`; None if it is not there."""
    asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path))
    if asset is None or asset.GetSize() > MAX_RESOURCE:
        return None
    with asset:
        return bytes(asset.GetBuffer())
