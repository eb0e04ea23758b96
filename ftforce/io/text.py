"""Defensive reading of user files, and atomic writing."""

from __future__ import annotations

import errno
import math
import os
import re
from io import BytesIO
from pathlib import Path
from stat import S_ISDIR, S_ISFIFO, S_ISREG
from typing import TYPE_CHECKING, Any

from ftforce.errors import InputError, OutputError, printable

if TYPE_CHECKING:
    from os import PathLike

    from ftforce.errors import FileError

_PIECE = 1 << 20  # bytes read at a time
LARGEST_FILE = 100_000_000  # bytes; a URDF typically has about 100 kB
# In wide use; others in Python's list are no encodings of texts, or can encode commands.
_ENCODINGS = (
    r"iso-?8859-([1-9]|1[0-1]|1[3-6])|latin-?1|(windows-|cp)125[0-8]|gb18030|big5|shift-jis"
    r"|euc-(jp|kr)|koi8-[ru]|utf-16"
)
LARGEST_TOML = 1_000_000  # bytes; Python's parser takes a second for them
_MAX_PARTS = 100  # of a dotted key
LARGEST_NUMBER = 1e9  # of a length, angle, mass …; results computed from them stay finite


def read_text(
    path: str | PathLike[str], error: type[FileError], kind: str, largest: int | None = None
) -> str:
    """Read a UTF-8 file.

    Parameters
    ----------
    path :
        The file.
    error :
        Type of exception to raise.
    kind :
        Kind of file expected, for messages, e.g. ``"a URDF"``.
    largest :
        Maximum size in bytes; 100 MB by default.

    Raises
    ------
    FileError
        As ``error``: the file is missing, unreadable, empty, too large or not UTF-8 text.
    """
    data = read_bytes(path, error, kind, LARGEST_FILE if largest is None else largest)
    return text_of(data, path, error, kind)[0]


def read_bytes(path: str | PathLike[str], error: type[FileError], kind: str, largest: int) -> bytes:
    """Read a regular file or a pipe; devices are rejected.

    Parameters
    ----------
    path, error, kind :
        As in `read_text`.
    largest :
        Maximum size in bytes.

    Raises
    ------
    FileError
        As ``error``: the file is missing, unreadable or too large.
    """
    file = Path(path)
    try:
        if not str(path) or not file.exists():
            raise error(path, f"no such file; expected {kind}")
        mode = file.stat().st_mode
        if S_ISDIR(mode):
            raise error(path, f"is a folder; expected {kind}")
        if not (S_ISREG(mode) or S_ISFIFO(mode)):  # reading a device might never end
            raise error(path, f"is not a regular file; expected {kind}")
        # Opening a pipe blocks until it has a writer, possibly forever; non-blocking, it reads as
        # empty.
        descriptor = os.open(file, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        os.set_blocking(descriptor, True)
        with os.fdopen(descriptor, "rb") as stream:
            found = BytesIO()  # grows: read(n) would allocate n bytes
            while found.tell() <= largest and (piece := stream.read(_PIECE)):
                found.write(piece)
            data = found.getvalue()
    except (OSError, ValueError) as problem:  # ValueError: a NUL character in the path
        reason = getattr(problem, "strerror", None) or str(problem)
        raise error(path, f"cannot be read ({reason})") from None
    if len(data) > largest:
        raise error(path, f"is larger than {largest / 1_000_000:.3g} MB; expected {kind}")
    return data


def file_digest(path: str | PathLike[str]) -> str | None:
    """Return the SHA-256 of a file; ``None`` if it is no regular file, such as a pipe, or is gone.

    Parameters
    ----------
    path :
        The file; an empty text is none.
    """
    from hashlib import file_digest as digest  # needed only when a result is written

    try:
        if not S_ISREG(Path(path).stat().st_mode):
            return None
        with Path(path).open("rb") as stream:
            return digest(stream, "sha256").hexdigest()
    except (OSError, ValueError):
        return None


def text_of(
    data: bytes, path: str | PathLike[str], error: type[FileError], kind: str, declared: str = ""
) -> tuple[str, str]:
    """Decode the bytes of a file as UTF-8, or else in the encoding that it declares.

    Parameters
    ----------
    data :
        The bytes.
    path, error, kind :
        As in `read_text`.
    declared :
        Declared encoding; empty if none is. Only encodings of texts are accepted.

    Returns
    -------
    :
        The text, and the encoding if it is not UTF-8, else an empty string.

    Raises
    ------
    FileError
        As ``error``: the bytes are empty or not text.
    """
    encoding, text, flaw = "", "", ""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        encoding, flaw = _usable(declared), f"is not UTF-8 text (byte {problem.start})"
    if encoding:
        try:
            text, flaw = data.decode(encoding), ""
        except UnicodeDecodeError as problem:
            flaw = f"is neither UTF-8 nor {encoding}, as it declares (byte {problem.start})"
    if not flaw and "\0" in text:
        flaw = "is a binary file"
    if not flaw and (not text or text.isspace()):  # strip() would copy it
        flaw = "is empty"
    if flaw:
        raise error(path, f"{flaw}; expected {kind}")
    return text, encoding


def _usable(declared: str) -> str:
    """Return the encoding for a declared one; empty if it is not an encoding of texts."""
    name = declared.lower().replace("_", "-")
    if name in {"gb2312", "gbk", "x-gbk", "euc-cn"}:
        return "gb18030"  # contains them; files declare the smaller sets and use the larger
    return name if re.fullmatch(_ENCODINGS, name) else ""


def read_numbers(
    text: str, count: int, largest: float | None = LARGEST_NUMBER
) -> tuple[float, ...]:
    """Parse whitespace-separated numbers, as in a URDF.

    Parameters
    ----------
    text :
        The text.
    count :
        Required number of values.
    largest :
        Largest absolute value accepted; ``None`` also accepts infinities.

    Raises
    ------
    ValueError
        The text is invalid; the message quotes it and states why.
    """
    try:
        # float() accepts 1_000 and non-ASCII digits; other URDF parsers do not.
        numbers = tuple(map(float, text.split())) if text.isascii() and "_" not in text else None
    except ValueError:
        numbers = None
    if numbers is None:
        raise ValueError(f"{shortened(text)} is not a number")
    if len(numbers) != count:
        wanted = "1 number" if count == 1 else f"{count} numbers"
        raise ValueError(f"{shortened(text)}: expected {wanted}, got {len(numbers)}")
    is_finite = all(map(math.isfinite, numbers))
    if not is_finite and (largest is not None or any(map(math.isnan, numbers))):
        raise ValueError(f"{shortened(text)} is not finite")
    if largest is not None and max(map(abs, numbers)) > largest:
        raise ValueError(f"{shortened(text)} is too large; the maximum magnitude is {largest:g}")
    return numbers


def split_items(text: str) -> list[str]:
    """Split a list of joints at its commas.

    Parameters
    ----------
    text :
        The list, e.g. ``"2,elbow"``.

    Raises
    ------
    InputError
        An item is empty, as when a shell variable is not set: that must not mean no joint.
    """
    items = text.split(",")
    if not all(map(str.strip, items)):
        given = f"an empty item in {shortened(text)}" if text.strip() else "an empty text"
        raise InputError(f"joints are given as numbers or names, e.g. 2,4; got {given}")
    return items


def check_name(name: object, kind: str) -> None:
    """Check a name that a file gives to a part of an arm, before it is shown anywhere.

    Parameters
    ----------
    name :
        The name.
    kind :
        What is named, for messages, e.g. ``"joint"``.

    Raises
    ------
    ValueError
        The name is not a text, or has characters that are not printable, such as line breaks and
        control sequences of terminals.
    """
    if not isinstance(name, str):
        raise ValueError(f"the {kind} name {shortened(str(name))} is not a text")
    if not name.isprintable():
        raise ValueError(f"the {kind} name {shortened(name)} contains unprintable characters")


def printable_texts(content: Any) -> Any:
    """Return JSON content with unprintable characters of all its texts escaped, keys included."""
    if isinstance(content, str):
        return content if content.isprintable() else printable(content)
    if isinstance(content, dict):
        return {printable(key): printable_texts(value) for key, value in content.items()}
    return [printable_texts(one) for one in content] if isinstance(content, list) else content


def read_toml(text: str) -> dict[str, Any]:
    """Parse a TOML document.

    Raises
    ------
    InputError
        It is not valid TOML, or a key has more parts than any file needs: the time that Python's
        parser takes grows with the square of their number.
    """
    import tomllib  # imported lazily: needed only for TOML files

    runs = re.split(r"[,=\[\]{}\n\r#]", text)
    if any(sum(map(bool, run.split("."))) > _MAX_PARTS for run in runs if "." in run):
        raise InputError(f"is not valid: a key has more than {_MAX_PARTS} parts")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as problem:
        raise InputError(f"is not valid TOML: {problem}") from None


def shortened(text: str, most: int = 60) -> str:
    """Return a quoted text for a message, truncated to ``most`` characters.

    Parameters
    ----------
    text :
        The text.
    most :
        Number of characters to show.
    """
    return repr(text) if len(text) <= most else f"{text[:most]!r}…"


def write_whole(path: str | PathLike[str], content: str | bytes) -> Path:
    """Write a file atomically: to a temporary file next to it, which then replaces it.

    Devices and pipes are written to directly.

    Parameters
    ----------
    path :
        The file.
    content :
        Bytes, or text to encode as UTF-8.

    Raises
    ------
    OutputError
        The file cannot be written; no partial file is left behind and an existing file is
        unchanged.
    """
    check_writable(path)
    try:
        file = Path(path)
        data = content.encode() if isinstance(content, str) else content
        if file.exists() and not file.is_file():  # a device or pipe cannot be replaced
            _write_through(file, data)
        else:
            _replace(Path(os.path.realpath(file)), data)  # symbolic links are kept
    except (OSError, UnicodeEncodeError) as problem:
        reason = getattr(problem, "strerror", None) or str(problem)
        raise OutputError(path, f"cannot be written ({reason})") from None
    return Path(path)


def is_folder(path: str | PathLike[str]) -> bool:
    """Return whether a path is a folder; ``False`` too if it is too long, or in a closed one.

    Parameters
    ----------
    path :
        The path, of which ``Path.is_dir`` may raise an error.
    """
    return os.path.isdir(path)  # noqa: PTH112


def check_writable(path: str | PathLike[str]) -> None:
    """Check what can be told before a file is written.

    Parameters
    ----------
    path :
        The file.

    Raises
    ------
    OutputError
        It is a folder or read-only, or its name or its folder is not valid.
    """
    if not str(path) or "\0" in str(path):
        raise OutputError(path, "cannot be written: not a valid file name")
    try:
        file = Path(path)
        if file.is_dir():
            raise OutputError(path, "cannot be written: it is a folder")
        if file.exists() and not os.access(file, os.W_OK):  # replacing would bypass that
            raise OutputError(path, "cannot be written: it is read-only")
        folder = Path(os.path.realpath(file)).parent
        if not folder.is_dir():
            above = next(one for one in (folder, *folder.parents) if one.exists())
            raise OSError(errno.ENOENT if above.is_dir() else errno.ENOTDIR, "")
        if (not file.exists() or file.is_file()) and not os.access(folder, os.W_OK):
            raise OSError(errno.EACCES, "")
    except OSError as problem:
        reason = os.strerror(problem.errno or 0)
        raise OutputError(path, f"cannot be written ({reason})") from None


def _write_through(file: Path, data: bytes) -> None:
    # Opening a pipe blocks until it has a reader, possibly forever; non-blocking, it fails.
    descriptor = os.open(file, os.O_WRONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    os.set_blocking(descriptor, True)
    with os.fdopen(descriptor, "wb") as stream:
        stream.write(data)


def _replace(file: Path, data: bytes) -> None:
    import tempfile  # imported lazily: needed only for writing

    handle, scratch = tempfile.mkstemp(dir=file.parent, prefix=".ftforce-")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
        Path(scratch).chmod(file.stat().st_mode if file.exists() else 0o666 & ~_umask())
        Path(scratch).replace(file)
    finally:
        Path(scratch).unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
