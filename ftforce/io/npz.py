"""Arrays from NPZ files, without running or allocating what a file asks for."""

from __future__ import annotations

import io
import zipfile
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


def read_npz(data: bytes) -> dict[str, NDArray[Any]]:
    """Return the arrays of an NPZ file written by `numpy.savez`, read-only, by name.

    NumPy's own reader allocates what the header of an array declares, decompresses what is a
    thousand times its size in the file, and compares no checksum if a header is shorter than its
    array. Here an array is a view of bytes that were compared with their CRC-32.

    Parameters
    ----------
    data :
        Content of the file.

    Raises
    ------
    Exception
        Of any kind: the file is damaged, or compressed.
    """
    found = {}
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        for member in archive.infolist():
            if member.compress_type != zipfile.ZIP_STORED or member.file_size > len(data):
                raise ValueError(f"{member.filename!r} is compressed; use numpy.savez")
            name = member.filename.removesuffix(".npy")
            found[name] = _array(archive.read(member))
    return found


def _array(data: bytes) -> NDArray[Any]:
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    read = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }[version]
    shape, by_columns, dtype = read(stream)
    if dtype.hasobject:
        raise ValueError("it contains Python objects")
    flat: NDArray[Any] = np.frombuffer(data, dtype, offset=stream.tell())
    return flat.reshape(shape, order="F" if by_columns else "C")
