"""The manifest of a stored sweep: its description, and size and SHA-256 of every other file.

A Zarr group has no digests, and a chunk that is missing reads as the fill value. The manifest makes
lost and altered data an error. Its first line is the SHA-256 of the rest, which is JSON. It is
replaced atomically, and what it does not list is not part of the sweep.
"""

from __future__ import annotations

import hashlib
import json
import re
from contextlib import suppress
from stat import S_ISDIR, S_ISREG
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from ftforce.errors import SweepError
from ftforce.io.text import read_bytes

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from ftforce.errors import FileError

MANIFEST = ".manifest"
EXPECTED = "a sweep stored by ftforce"
FORMAT = 2
AGAIN = "run the same sweep again with this --output, or copy it again"
_LARGEST = 200_000_000  # bytes: about 100 for each file
_KEY = re.compile(r"(\w+/)?(\.z\w+|\d+(\.\d+)*)")

Files: TypeAlias = "dict[str, tuple[int, str]]"
"""Size, bytes, and SHA-256 of files, by their path in the folder."""


class Manifest(NamedTuple):
    """Contents of a manifest.

    Attributes
    ----------
    about :
        Description of the sweep, in JSON form.
    files :
        Its files; without samples and summary until the sweep is complete.
    """

    about: dict[str, Any]
    files: Files

    def to_bytes(self) -> bytes:
        """Return the content of the file."""
        body = json.dumps(self._asdict(), ensure_ascii=False, sort_keys=True).encode()
        return _sha256(body).encode() + b"\n" + body

    @property
    def is_complete(self) -> bool:
        """Whether the sweep is complete."""
        return bool(self.about["complete"])


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def digest_of(data: bytes) -> tuple[int, str]:
    """Return size and SHA-256 of a content."""
    return len(data), _sha256(data)


def read_manifest(path: Path, error: type[FileError]) -> Manifest:
    """Return the manifest of a sweep.

    Parameters
    ----------
    path :
        The folder.
    error :
        Type of exception to raise.

    Raises
    ------
    FileError
        As ``error``: the folder holds no sweep, one of another format, or a damaged manifest.
    """
    try:
        is_there, is_ours = path.exists(), (path / MANIFEST).exists()
    except OSError as problem:  # such as a name that is too long, or a closed folder
        raise error(path, f"cannot be read ({problem.strerror}); expected {EXPECTED}") from None
    if not is_there:
        raise error(path, f"no such folder; expected {EXPECTED}")
    if not is_ours:
        raise error(path, _without_manifest(path))
    try:
        data = read_regular(path, MANIFEST)
        digest, _, body = data.partition(b"\n")
        if digest.decode() != _sha256(body):
            raise ValueError("its digest does not match")
        found = json.loads(body)
        about, version = found["about"], found["about"]["format"]
        _, _ = about["identity"], about["complete"]
        files = {key: (int(size), str(sha)) for key, (size, sha) in found["files"].items()}
        if strange := [key for key in files if not _KEY.fullmatch(key)]:
            raise ValueError(f"unexpected file {strange[0]!r}")
    except MemoryError:
        raise
    except Exception as problem:  # a damaged file may raise anything
        raise error(
            path / MANIFEST, f"is damaged ({problem}); copy the sweep again, or remove it"
        ) from None
    if version != FORMAT:
        raise error(path, f"has format {version}; this version of ftforce reads format {FORMAT}")
    return Manifest(about, files)


def _without_manifest(path: Path) -> str:
    """Say what a folder without a manifest is."""
    with suppress(OSError, ValueError, AttributeError):
        attributes = json.loads((path / ".zattrs").read_text("utf-8"))
        if "ftforce" in attributes:
            return (
                f"has format 1, without the digests that reveal lost data; this version of ftforce "
                f"reads format {FORMAT}: run the sweep again with another --output"
            )
        if str(attributes.get("source", "")).startswith("ftforce"):
            return f"lacks its file {MANIFEST}; copy the sweep again completely, or remove it"
    return f"is not a sweep; expected {EXPECTED}"


def read_regular(path: Path, key: str) -> bytes:
    """Return the content of a file of a sweep; links, pipes and devices are rejected.

    Parameters
    ----------
    path, key :
        The folder, and the path of the file in it.

    Raises
    ------
    SweepError
        The file is missing, unreadable or not a regular file.
    """
    if _size_of(path, key) is None:
        raise SweepError(path, f"is incomplete: {key} is missing or not a regular file; {AGAIN}")
    largest = _LARGEST if key == MANIFEST else 1 << 32
    return read_bytes(path / key, SweepError, EXPECTED, largest)


def _size_of(path: Path, key: str) -> int | None:
    """Return the size of a regular file reached without links, bytes; ``None`` if it is none."""
    try:
        about = (path / key).lstat()
        is_inside = "/" not in key or S_ISDIR((path / key).parent.lstat().st_mode)
    except OSError:
        return None
    return about.st_size if S_ISREG(about.st_mode) and is_inside else None


def checked_content(path: Path, key: str, wanted: tuple[int, str]) -> bytes:
    """Return the content of a file of a sweep after comparing it with its digest.

    Parameters
    ----------
    path, key, wanted :
        The folder, the path of the file in it, and its entry in the manifest.

    Raises
    ------
    SweepError
        The file is missing, or differs from what was written.
    """
    data = read_regular(path, key)
    if digest_of(data) != tuple(wanted):
        raise SweepError(path, f"is damaged: {key} differs from what was written; {AGAIN}")
    return data


def check_sizes(path: Path, files: Files) -> None:
    """Check that every file is there and has its size; contents are checked when they are read.

    Parameters
    ----------
    path, files :
        The folder, and what should be in it.

    Raises
    ------
    SweepError
        Files are missing, cut off, or not regular files, as after a copy that was cut off.
    """
    missing = [key for key, (size, _) in files.items() if _size_of(path, key) != size]
    if missing:
        raise SweepError(
            path,
            f"is incomplete: {len(missing)} of {len(files)} files are missing, cut off or not "
            f"regular files, first {missing[0]}; {AGAIN}",
        )


def damaged(path: Path, files: Files) -> Iterable[str]:
    """Yield the files that are missing or differ from what was written; all are read.

    Parameters
    ----------
    path, files :
        The folder, and what should be in it.
    """
    for key, wanted in files.items():
        try:
            checked_content(path, key, wanted)
        except SweepError:
            yield key
