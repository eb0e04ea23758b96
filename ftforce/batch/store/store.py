"""Sweeps on disk: a Zarr group that plain xarray can open, written chunk by chunk.

A sweep can be killed at any time:

- A chunk is done once it is listed in the progress file, which is replaced atomically after
  the arrays of the chunk are on disk.
- The attributes of the group are written last, both on creation and on completion.
- A lock excludes other processes, and its file marks the folder as ftforce's until completion.

Running the same command again therefore resumes the sweep and yields the same bytes.

The store uses Zarr format 2 with consolidated metadata, which xarray and all versions of Zarr from
2 on open without a warning. Format 3 has no stable specification yet of strings or of
consolidated metadata: current versions of Zarr warn about both, and 3.0.8 cannot read strings
written by 3.1.
"""

from __future__ import annotations

import io
import json
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.batch.job import PER_POSTURE, PER_SET, samples_of
from ftforce.batch.result import Sweep, SweepSetting, sets_from_lists
from ftforce.batch.store import folder, variables
from ftforce.batch.store.folder import disk_errors
from ftforce.batch.summary.bins import Bins, Workspace
from ftforce.batch.summary.summary import Summary
from ftforce.errors import FtforceError, OutputError, SweepError

if TYPE_CHECKING:
    from collections.abc import Iterable
    from os import PathLike

    from filelock import FileLock
    from numpy.typing import NDArray

    from ftforce.batch.job import Job
    from ftforce.core.faults import FaultSet

    Tree = dict[str, Any]  # keys and contents of a Zarr group

_FORMAT = 1
_PROGRESS = ".progress.npz"
_ATTRIBUTES, _CONSOLIDATED = ".zattrs", ".zmetadata"
_EXPECTED = "a sweep stored by ftforce"
_ARRAYS = "arrays"  # key in the identity: digest of all kernel inputs
_DIGESTS = {_ARRAYS, "postures", "check"}  # digests, meaningless in an error message
_SAMPLES = (*PER_POSTURE, *PER_SET, "worst_set", *(f"worst_{name}" for name in PER_SET))


class SweepRequest(NamedTuple):
    """A requested sweep.

    Attributes
    ----------
    job, setting, sets :
        Job, setting and fault sets.
    identity :
        Everything the output depends on, in JSON form.
    """

    job: Job
    setting: SweepSetting
    sets: tuple[FaultSet, ...]
    identity: dict[str, Any]


class OpenStore(NamedTuple):
    """A sweep that is being written.

    Attributes
    ----------
    request :
        The requested sweep.
    path :
        The folder; ``None`` in memory.
    store :
        Zarr store: a path, or memory.
    tree :
        Contents of the group, if in memory.
    arrays :
        Sample arrays, by name.
    summary :
        Summary of the finished chunks.
    done :
        Whether each chunk is finished, shape (chunks,).
    lock :
        Lock of the folder; ``None`` if the sweep is complete.
    """

    request: SweepRequest
    path: Path | None
    store: Any
    tree: Tree
    arrays: dict[str, Any]
    summary: Summary
    done: NDArray[np.bool_]
    lock: FileLock | None

    @property
    def is_complete(self) -> bool:
        """Whether the sweep is complete."""
        return self.path is not None and self.lock is None

    def close(self) -> None:
        """Release the lock."""
        if self.lock is not None:
            self.lock.release()


def create(path: Path | None, request: SweepRequest) -> OpenStore:
    """Create an empty sweep, or resume an existing one; close it with `OpenStore.close`.

    Parameters
    ----------
    path :
        Path of the Zarr group; ``None`` for memory.
    request :
        The requested sweep.

    Raises
    ------
    OutputError
        The folder contains something else, is being written by another process, or is not writable.
    """
    job, identity = request.job, request.identity
    none_done = (job.empty_summary(), np.zeros(job.chunks, np.bool_))
    if path is None:
        return _opened(request, None, _tree(request), none_done, None)
    if not _must_create(path) and _checked_metadata(path, identity)["complete"]:
        return _open_complete(request, path)
    lock = folder.lock(path)
    try:
        if _must_create(path):  # checked again, now that the folder is locked
            with disk_errors(path):
                folder.clear(path, _known_names())
                _write_tree(path, _tree(request))
        elif _checked_metadata(path, identity)["complete"]:
            lock.release()
            return _open_complete(request, path)
        with disk_errors(path):
            folder.remove_partial(path)
        progress = _stored_progress(path, job.bins, job.workspace, job.n_sets, job.chunks)
        return _opened(request, path, {}, progress, lock)
    except BaseException:
        lock.release()
        raise


def _opened(
    request: SweepRequest, path: Path | None, tree: Tree, progress: tuple[Summary, Any], lock: Any
) -> OpenStore:
    import zarr
    from zarr.storage import MemoryStore

    store: Any = MemoryStore(tree) if path is None else str(path)
    with disk_errors(path):
        group = zarr.open_group(store, mode="r+", zarr_format=2)
        arrays = {name: group[name] for name in _sample_names(request.job)}
    return OpenStore(request, path, store, tree, arrays, *progress, lock)


def _open_complete(request: SweepRequest, path: Path) -> OpenStore:
    """Open a complete sweep, and remove what a killed process left behind."""
    job = request.job
    with suppress(OSError):  # a complete sweep can be read without write permission
        _clean_up(path)
    try:
        summary = _stored_summary(path, job.bins, job.workspace)
    except Exception as problem:  # a damaged store may raise anything
        raise SweepError(path, f"is damaged ({problem}); remove it to start again") from None
    return OpenStore(request, path, str(path), {}, {}, summary, np.ones(job.chunks, np.bool_), None)


def _clean_up(path: Path) -> None:
    folder.remove_partial(path)
    (path / _PROGRESS).unlink(missing_ok=True)
    (path / folder.LOCK).unlink(missing_ok=True)


def _must_create(path: Path) -> bool:
    """Return whether a folder must be created: it is missing, empty, or left incomplete."""
    with disk_errors(path):
        if not path.exists():
            return True
        if not path.is_dir():
            return False
        entries = {entry.name for entry in path.iterdir()}
        if entries <= {folder.LOCK}:
            return True
        return _ATTRIBUTES not in entries and folder.is_partly_created(path, _known_names())


def _known_names() -> set[str]:
    """Return the names of all files that ftforce may create for a sweep, except its lock."""
    dimensions = variables.all_coordinates()
    return {".zgroup", _ATTRIBUTES, _CONSOLIDATED, _PROGRESS, *_SAMPLES, *dimensions}


def _checked_metadata(path: Path, identity: dict[str, Any]) -> dict[str, Any]:
    """Return the stored description of a sweep, if it is the requested one.

    Raises
    ------
    OutputError
        The folder contains a different sweep, or none.
    """
    metadata = _metadata_of(path, OutputError)
    found = metadata["identity"]
    if found != identity:
        differs = _differences(found, identity) or "a different robot, or other limits or masses"
        raise OutputError(
            path, f"contains a different sweep ({differs}); choose another --output, or remove it"
        )
    return metadata


def _differences(found: dict[str, Any], request: dict[str, Any]) -> str:
    """Describe how two identities differ, with details for the postures."""
    stored, requested = ({**values, **_postures(values)} for values in (found, request))
    keys = sorted(key for key in {*stored, *requested} if stored.get(key) != requested.get(key))
    if "source of postures" in keys:  # then their other differences add nothing
        keys = [key for key in keys if key not in {*_postures(found), *_postures(request)}]
        keys.append("source of postures")
    named = [key for key in keys if key not in _DIGESTS]
    return "; ".join(_difference(key, stored.get(key), requested.get(key)) for key in named)


def _postures(identity: dict[str, Any]) -> dict[str, Any]:
    metadata = dict(identity["postures"])
    return {"source of postures": metadata.pop("source"), **metadata}


def _difference(key: str, found: object, request: object) -> str:
    stored, requested = (json.dumps(value, ensure_ascii=False) for value in (found, request))
    if max(len(stored), len(requested)) > 60:
        return f"different {key}"
    return f"{key} {stored} instead of {requested}"


# ---- writing ---------------------------------------------------------------------------------


def _sample_names(job: Job) -> list[str]:
    """Return the names of the arrays of samples."""
    return [] if job.keep == "summary" else list(_sample_of_one(job))


def _sample_of_one(job: Job) -> dict[str, NDArray[Any]]:
    """Return the samples of one posture, as a template of names, types and shapes."""
    q = job.postures.block(0, 1)
    return samples_of(q, job.plan.evaluator()(q), job.keep)


def _tree(request: SweepRequest, summary: Summary | None = None) -> Tree:
    """Return keys and contents of the Zarr group, without the samples.

    Parameters
    ----------
    request :
        The requested sweep.
    summary :
        Summary of the complete sweep; ``None`` if it is not complete.
    """
    import zarr
    from zarr.storage import MemoryStore

    job, setting, sets, identity = request
    tree: Tree = {}
    store = MemoryStore(tree)
    group = zarr.open_group(store, mode="w", zarr_format=2)
    if job.keep != "summary":
        for name, values in _sample_of_one(job).items():
            shape = (job.postures.count, *values.shape[1:])
            # Unfinished chunks read as NaN. A complete sweep needs no fill value, and xarray
            # would convert integers that have one to floats.
            fill = -1 if summary is None else None
            _create(group, name, (shape, values.dtype, fill), variables.sample(name, setting), job)
    given = (setting, sets, job.bins, job.workspace)
    for name, (values, variable) in variables.coordinates(*given).items():
        _create(group, name, values, variable)
    for name, values in (summary.arrays() if summary is not None else {}).items():
        whole = variables.shaped(name, values, job.workspace)
        _create(group, f"{variables.SUMMARY_PREFIX}{name}", whole, variables.counted(name, setting))
    complete = summary is not None
    metadata = variables.attributes(*given, version=_FORMAT, identity=identity, complete=complete)
    group.attrs.update(metadata)
    zarr.consolidate_metadata(store, zarr_format=2)
    return tree


def _create(group: Any, name: str, content: Any, variable: Any, job: Job | None = None) -> None:
    """Create an array of given values or, with a job, one to be filled with samples."""
    from numcodecs import Blosc  # type: ignore[import-untyped]

    values = None if isinstance(content, tuple) else content
    shape, dtype, fill = content if values is None else (values.shape, values.dtype, None)
    size = 0 if job is None else job.chunk
    chunks = tuple(max(1, length) for length in shape)
    if size:
        chunks = (size, *chunks[1:])
    array = group.create_array(
        name,
        shape=shape,
        dtype=dtype,
        chunks=chunks,
        # Measures in double precision hardly compress: this saves a quarter, at 0.2 µs per kB.
        compressors=Blosc("lz4", clevel=5, shuffle=Blosc.SHUFFLE),
        fill_value=_fill(np.dtype(dtype), fill),
        attributes={"_ARRAY_DIMENSIONS": list(variable.dimensions), **variable.attributes},
        config={"write_empty_chunks": True},  # a missing chunk is an unfinished one
    )
    if values is not None:
        array[...] = values


def _fill(dtype: np.dtype[Any], fill: int | None) -> Any:
    if dtype.kind == "f":
        return np.nan
    return "" if dtype.kind == "U" else fill


def _write_tree(path: Path, tree: Tree) -> None:
    """Write the keys of a group to files, the attributes last: they mark it as created."""
    last = [_CONSOLIDATED, _ATTRIBUTES]
    for key in [*(key for key in tree if key not in last), *last]:
        file, data = path / key, tree[key].to_bytes()
        if not (file.is_file() and file.read_bytes() == data):
            file.parent.mkdir(exist_ok=True)
            folder.write_durably(file, data)


def write_samples(opened: OpenStore, index: int, samples: dict[str, NDArray[Any]]) -> None:
    """Write the samples of a chunk, and wait until they are on disk.

    Parameters
    ----------
    opened :
        The sweep being written.
    index :
        Number of the chunk.
    samples :
        Its samples, by name.

    Raises
    ------
    OutputError
        They cannot be written.
    """
    with disk_errors(opened.path):
        _write(opened.arrays, opened.request.job, opened.path, index, samples)


def write_chunk(
    path: Path, token: str, job: Job, index: int, samples: dict[str, NDArray[Any]]
) -> None:
    """Write the samples of a chunk from a worker process, possibly on another machine.

    Parameters
    ----------
    path :
        The folder.
    token :
        Token of its lock, which shows that the worker sees the same folder.
    job, index, samples :
        The job, the chunk number, and the samples of the chunk.

    Raises
    ------
    OutputError
        They cannot be written, or this machine does not see the folder.
    """
    import zarr

    if folder.lock_of(path).get("token") != token:
        raise OutputError(
            path,
            "is not visible to all workers; --output must be on a file system that they share, or "
            "use --keep summary",
        )
    with disk_errors(path):
        group = zarr.open_group(str(path), mode="r+", zarr_format=2)
        _write({name: group[name] for name in samples}, job, path, index, samples)


def _write(arrays: dict[str, Any], job: Job, path: Path | None, index: int, samples: Any) -> None:
    start, stop = job.range(index)
    for name, values in samples.items():
        arrays[name][start:stop] = values
        if path is not None:
            folder.sync(path / name / ".".join([str(index), *["0"] * (values.ndim - 1)]))


def save_progress(opened: OpenStore) -> None:
    """Save the finished chunks and their summary, atomically.

    Raises
    ------
    OutputError
        The progress file cannot be written.
    """
    if opened.path is None:
        return
    stream = io.BytesIO()
    arrays: dict[str, Any] = {"done": np.packbits(opened.done), **opened.summary.arrays()}
    np.savez(stream, **arrays)
    with disk_errors(opened.path):
        for name in opened.arrays:
            folder.sync(opened.path / name)  # syncs the directory entries, not only the content
        folder.write_durably(opened.path / _PROGRESS, stream.getvalue())


def finish(opened: OpenStore) -> None:
    """Write the summary, mark the sweep as complete, and remove progress and lock files.

    Raises
    ------
    OutputError
        A file cannot be written.
    """
    save_progress(opened)  # if killed after this, no chunk is repeated
    tree = _tree(opened.request, opened.summary)
    if opened.path is None:
        opened.tree.update(tree)
        return
    with disk_errors(opened.path):
        _write_tree(opened.path, tree)
        _clean_up(opened.path)


# ---- reading ---------------------------------------------------------------------------------


def open_sweep(path: str | PathLike[str]) -> Sweep:
    """Open a sweep written by `ftforce.sweep` or ``ftforce sweep``.

    An unfinished sweep contains the chunks done so far.

    Parameters
    ----------
    path :
        Path of the Zarr group.

    Raises
    ------
    SweepError
        The folder does not contain a sweep, or it is damaged.
    """
    where = Path(path)
    metadata = _metadata_of(where, SweepError)
    if not metadata["complete"] and not (where / _PROGRESS).exists():
        metadata = _metadata_of(where, SweepError)  # it may have completed in the meantime
    _needs_zarr()
    try:
        setting = SweepSetting.from_dict(metadata["setting"])
        sets = sets_from_lists(metadata["sets"])
        bins = Bins(**metadata["bins"])
        stored = metadata["workspace"].items()
        grid: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in stored}
        workspace = Workspace(**grid)
        if metadata["complete"]:
            summary = _stored_summary(where, bins, workspace)
        else:
            chunks = -(-setting.count // setting.chunk)
            summary, _ = _stored_progress(where, bins, workspace, len(sets), chunks)
        opening = partial(dataset_of, str(where))
        opening()  # detect damage now, not on first access
        return Sweep(setting, sets, summary, str(where), opening)
    except FtforceError:
        raise
    except Exception as problem:  # a damaged store may raise anything
        raise SweepError(path, f"is damaged ({problem}); expected {_EXPECTED}") from None


def _needs_zarr() -> None:
    try:
        import xarray  # noqa: F401
        import zarr  # noqa: F401
    except ImportError as problem:
        raise FtforceError(
            f"stored sweeps require {problem.name} (pip install 'ftforce[sweep]')"
        ) from None


def dataset_of(store: Any) -> Any:
    """Return all arrays of a store as an xarray Dataset, loaded lazily."""
    import xarray as xr

    return xr.open_dataset(store, engine="zarr", consolidated=True, chunks=None)


def _metadata_of(path: Path, error: Any) -> dict[str, Any]:
    """Return the stored description of the sweep in a folder."""
    if not path.exists():
        raise error(path, f"no such folder; expected {_EXPECTED}")
    try:
        attributes = json.loads((path / _ATTRIBUTES).read_text("utf-8"))
        found = json.loads(attributes[variables.METADATA])
        version, _, _ = found["format"], found["identity"], found["complete"]
    except (OSError, ValueError, KeyError, TypeError):
        raise error(path, f"is not a sweep; expected {_EXPECTED}") from None
    if version != _FORMAT:
        raise error(path, f"has format {version}; this version of ftforce reads format {_FORMAT}")
    return dict(found)


def _stored_progress(
    path: Path, bins: Bins, workspace: Workspace, n_sets: int, chunks: int
) -> tuple[Summary, NDArray[np.bool_]]:
    """Return the summary of the finished chunks, and which chunks are finished."""
    file = path / _PROGRESS
    if not file.exists():
        return Summary.empty(n_sets, bins, workspace), np.zeros(chunks, np.bool_)
    try:
        with np.load(file) as found:
            arrays = {name: found[name] for name in found.files}
        done = np.unpackbits(arrays.pop("done"), count=chunks).astype(np.bool_)
        return Summary.from_arrays(arrays, bins, workspace), done
    except Exception as problem:  # a damaged file may raise anything
        raise SweepError(file, f"is damaged ({problem}); remove it to start again") from None


def _stored_summary(path: Path, bins: Bins, workspace: Workspace) -> Summary:
    import zarr

    group = zarr.open_group(str(path), mode="r", zarr_format=2, use_consolidated=True)
    arrays = {}
    for name, array in _arrays(group):
        bare = name.removeprefix(variables.SUMMARY_PREFIX)
        if bare != name:
            arrays[bare] = variables.unshaped(bare, np.asarray(array[...]), workspace)
    return Summary.from_arrays(arrays, bins, workspace)


def _arrays(group: Any) -> Iterable[tuple[str, Any]]:
    found: Iterable[tuple[str, Any]] = group.arrays()
    return found
