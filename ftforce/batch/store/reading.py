"""Reading of the arrays of a stored sweep: nothing is believed, and nothing unchecked is decoded.

Zarr would run the codecs that a file names, allocate what it declares, and follow links. Here it
gets bytes only after their digest, and metadata only if ftforce could have written it.
"""

from __future__ import annotations

import asyncio
import json
import math
import re
from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core import indexing
from zarr.core.buffer import default_buffer_prototype
from zarr.storage import LocalStore

from ftforce.batch.store import variables
from ftforce.batch.store.manifest import checked_content
from ftforce.errors import SweepError

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray
    from zarr.abc.store import ByteRequest
    from zarr.core.buffer import Buffer, BufferPrototype

    from ftforce.batch.result import SweepSetting
    from ftforce.batch.store.manifest import Files

_CONSOLIDATED = ".zmetadata"
_TYPES = re.compile(r"<f8|<i8|<i4|\|i1|<U\d{1,6}")
_LARGEST_CHUNK = 2**31 - 1  # bytes, the most that Blosc encodes
_TEXT = [{"id": "vlen-utf8"}]  # how some versions of Zarr write names
_LARGEST_TEXT = 10_000_000  # bytes
_PLAIN = {"order": "C", "zarr_format": 2}
_COMPRESSOR = {"id": "blosc", "cname": "lz4", "clevel": 5, "shuffle": 1, "blocksize": 0}


class CheckedStore(LocalStore):
    """A folder of which Zarr reads what is listed in the manifest, as it was written.

    Parameters
    ----------
    path :
        The folder.
    files :
        Its files.
    shapes :
        Shape of each array that it may hold, see `variables.shapes_of`.
    is_complete :
        Whether all chunks are written.

    Raises
    ------
    SweepError
        The metadata is damaged, or not as ftforce writes it.
    """

    def __init__(
        self, path: Path, files: Files, shapes: dict[str, tuple[int, ...]], *, is_complete: bool
    ) -> None:
        super().__init__(path, read_only=True)
        self._files = files
        if _CONSOLIDATED not in files:
            raise SweepError(path, f"is damaged: {_CONSOLIDATED} is not in its manifest")
        about = json.loads(checked_content(path, _CONSOLIDATED, files[_CONSOLIDATED]))["metadata"]
        counts = Counter(key.partition("/")[0] for key in files if key.rpartition("/")[2][0] != ".")
        self._sizes = {}
        for key in (key for key in about if key.endswith("/.zarray")):
            name = key.removesuffix("/.zarray")
            try:
                self._sizes[name], chunks = _checked_size(about[key], shapes[name])
                if counts[name] > chunks or (is_complete and counts[name] < chunks):
                    raise ValueError(f"{counts[name]} of {chunks} chunks")
            except (KeyError, TypeError, ValueError) as problem:
                reason = f"is damaged or not from ftforce: array {name!r} ({problem})"
                raise SweepError(path, reason) from None

    async def get(
        self,
        key: str,
        prototype: BufferPrototype | None = None,
        byte_range: ByteRequest | None = None,
    ) -> Buffer | None:
        """Return the content of a file, ``None`` if it is not part of the sweep.

        Parameters
        ----------
        key, prototype :
            The file, and the kind of buffer to return.
        byte_range :
            Not used by Zarr format 2.

        Raises
        ------
        SweepError
            It is missing or damaged.
        """
        assert byte_range is None
        if key not in self._files or key.endswith("/.zarray"):  # only the checked metadata
            return None
        data = await asyncio.to_thread(checked_content, self.root, key, self._files[key])
        name, _, last = key.rpartition("/")
        # Blosc allocates what the header of a chunk declares.
        size, wanted = int.from_bytes(data[4:8], "little"), self._sizes.get(name)
        is_right = size <= _LARGEST_TEXT if wanted == -1 else size == wanted
        if last[0] != "." and not is_right:
            raise SweepError(self.root, f"is damaged or not from ftforce: size of {key}")
        return (prototype or default_buffer_prototype()).buffer.from_bytes(data)


def _checked_size(about: dict[str, Any], shape: tuple[int, ...]) -> tuple[int, int]:
    """Return the size of a decoded chunk of an array, bytes, and the number of chunks.

    Parameters
    ----------
    about, shape :
        The metadata, and the shape that the array has to have.

    Raises
    ------
    KeyError, TypeError, ValueError
        ftforce does not write such an array.
    """
    is_text = about["filters"] == _TEXT and about["dtype"].startswith("<U")
    if (about["filters"] and not is_text) or any(
        about[name] != value for name, value in _PLAIN.items()
    ):
        raise ValueError("its filters or order")
    compressor = dict(about["compressor"])
    compressor.pop("typesize", None)  # written by some versions of numcodecs
    if compressor != _COMPRESSOR or about.get("dimension_separator", ".") != ".":
        raise ValueError("its compressor")
    if not _TYPES.fullmatch(about["dtype"]):
        raise ValueError("its type")
    chunks = about["chunks"]
    if tuple(about["shape"]) != shape or len(chunks) != len(shape):
        raise ValueError("its shape")
    if not all(type(length) is int and length > 0 for length in chunks):
        raise ValueError("its chunks")
    size = math.prod(chunks) * np.dtype(about["dtype"]).itemsize
    number = math.prod(-(-a // b) for a, b in zip(shape, chunks, strict=True))
    if size > _LARGEST_CHUNK:
        raise ValueError("its chunks")
    return (-1 if is_text else int(size)), number


class _VerdictCodes(BackendArray):
    """Verdicts as indices of `ftforce.core.verdict.VERDICTS`, read when they are looked at.

    Parameters
    ----------
    stored :
        The variable of the store.
    """

    def __init__(self, stored: xr.Variable) -> None:
        self._stored, self.shape, self.dtype = stored, stored.shape, stored.dtype

    def __getitem__(self, key: Any) -> Any:
        """Return some of the verdicts."""
        level = indexing.IndexingSupport.OUTER
        return indexing.explicit_indexing_adapter(key, self.shape, level, self._get)

    def _get(self, key: tuple[Any, ...]) -> Any:
        stored = self._stored[key].values
        return stored - stored.dtype.type(variables.FIRST_VERDICT)


def open_dataset(store: Any, *, is_complete: bool) -> xr.Dataset:
    """Return the arrays of a store, loaded lazily.

    Parameters
    ----------
    store :
        The store.
    is_complete :
        Whether all is done; otherwise integers become floats, and NaN where they are unknown.
    """
    # Masking turns every integer into a float.
    data = xr.open_dataset(
        store, engine="zarr", consolidated=True, chunks=None, mask_and_scale=not is_complete
    )
    for array in data.variables.values():
        array.attrs.pop("_FillValue", None)
    codes = {"verdict_code": data["verdict_code"].variable - variables.FIRST_VERDICT}
    for name in variables.VERDICTS:
        if name in data.variables:
            stored = data.variables[name]
            lazy = indexing.LazilyIndexedArray(_VerdictCodes(stored))
            codes[name] = xr.Variable(stored.dims, lazy, stored.attrs)
    for one in codes.values():
        one.attrs = {**data["verdict_code"].attrs, **one.attrs, **variables.VERDICT_CODES}
    return data.assign(codes)


def with_samples(
    data: xr.Dataset, samples: dict[str, NDArray[Any]], setting: SweepSetting
) -> xr.Dataset:
    """Return a dataset with samples that were never stored, as if it had been opened with them.

    Parameters
    ----------
    data :
        The dataset without samples.
    samples :
        The samples by name, not copied.
    setting :
        The setting of the sweep.
    """
    found = {}
    for name, values in samples.items():
        dimensions, attributes = variables.sample(name, setting)
        about = dict(attributes)
        if name in variables.VERDICTS:
            about |= variables.VERDICT_CODES
        encoding = {"coordinates": about.pop("coordinates")} if "coordinates" in about else {}
        found[name] = xr.Variable(dimensions, values, about, encoding)
    return data.assign(found)
