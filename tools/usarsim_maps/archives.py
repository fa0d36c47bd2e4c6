"""Archives within bounds: what they say they hold is looked at before anything is unpacked.

A ZIP file of a megabyte may hold gigabytes, or a list of millions of empty files. Python's
`zipfile` reads the whole list at once, and of each file no more than the list says; so both are
bounded here, and then readers of a format may open it by whatever library they use.
"""

from __future__ import annotations

import io
import lzma
import re
import struct
import zipfile
import zlib
from pathlib import Path
from typing import BinaryIO

from usarsim_maps.files import read_bytes
from usarsim_server.base.errors import MapImportError, at

MAX_ENTRIES = 20_000
"""Files in an archive."""
MAX_DIRECTORY = 8 << 20
"""Bytes of the list of files; one takes 46 and its name."""
MAX_UNPACKED = 256 << 20
"""Bytes of all files together, where they are compressed."""
MAX_ELEMENTS = 1_000_000
"""Of XML in one archive; libraries that build a tree take 1 KB for each."""

_DAMAGED = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError),
    *(OSError, EOFError, RuntimeError, ValueError),
)
"""What unpacking raises."""
_XML = re.compile(r"\.(model|rels|xml)\Z", re.IGNORECASE)
_CHUNK = 1 << 20
_TAIL = 1 << 17
"""Bytes in which the end of an archive is, with the longest comment."""
_END, _END_64 = b"PK\5\6", b"PK\6\6"


def open_archive(source: Path, stream: BinaryIO, cure: str) -> zipfile.ZipFile:
    """A ZIP archive whose list of files is within bounds; nothing is unpacked.

    Args:
        source: where it comes from, for errors.
        stream: of the file.
        cure: what to do about a damaged one.

    Raises:
        MapImportError: it is damaged, or lists too many files.
    """
    try:
        if _directory(stream) > MAX_DIRECTORY:
            problem = f"a list of files of more than {MAX_DIRECTORY >> 20} MiB"
            raise MapImportError(at(source, problem, cure))
        archive = zipfile.ZipFile(stream)
    except _DAMAGED as error:
        raise MapImportError(at(source, f"a damaged archive: {error}", cure)) from None
    count = len(archive.infolist())
    if not 0 < count <= MAX_ENTRIES:
        raise MapImportError(at(source, f"{count} files in the archive", cure))
    return archive


def read_archive(source: Path, cure: str) -> bytes:
    """A file that may be an archive of XML, for a library that unpacks and parses it as a whole.

    Raises:
        MapImportError: it is damaged, or would grow beyond `MAX_UNPACKED` or `MAX_ELEMENTS`.
    """
    content = read_bytes(source, MAX_UNPACKED)
    if not content.startswith(b"PK"):
        _count(source, content.count(b"<") - content.count(b"</"))
        return content
    with open_archive(source, io.BytesIO(content), cure) as archive:
        entries = archive.infolist()
        size = sum(entry.file_size for entry in entries)
        if size > MAX_UNPACKED:
            problem = f"{size >> 20} MiB when unpacked, more than {MAX_UNPACKED >> 20}"
            raise MapImportError(at(source, problem, "split the map"))
        elements = 0
        for entry in entries:
            if _XML.search(entry.filename) is None:
                continue
            try:
                with archive.open(entry) as file:
                    while data := file.read(_CHUNK):
                        elements += data.count(b"<") - data.count(b"</")
                        _count(source, elements)
            except _DAMAGED as error:
                problem = f"a damaged archive: {entry.filename}: {error}"
                raise MapImportError(at(source, problem, cure)) from None
    return content


def _count(source: Path, elements: int) -> None:
    if elements > MAX_ELEMENTS:
        problem = f"more than {MAX_ELEMENTS} elements of XML"
        raise MapImportError(at(source, problem, "export it as glTF, or split the map"))


def _directory(stream: BinaryIO) -> int:
    """Bytes that the list of files has, as the end of an archive says; 0 if there is none."""
    stream.seek(max(0, stream.seek(0, io.SEEK_END) - _TAIL))
    content = stream.read()
    place, found = content.rfind(_END), 0
    if place >= 0 and len(content) >= place + 22:
        found = struct.unpack_from("<I", content, place + 12)[0]
        found = 0 if found == 0xFFFFFFFF else found
        wide = content.rfind(_END_64, 0, place)
        if wide >= 0 and len(content) >= wide + 56:
            found = max(found, struct.unpack_from("<Q", content, wide + 40)[0])
    return found
