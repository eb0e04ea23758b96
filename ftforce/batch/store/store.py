"""Sweeps on disk: a Zarr group that plain xarray opens, written chunk by chunk.

What makes it safe to kill at any moment:

- A chunk counts as done once it is in the progress file, which is replaced whole, after the chunk's
  arrays are on the disk.
- The group's attributes are written last when the folder is made, and last when it is completed.
- A lock keeps other processes out, and its file marks the folder as ftforce's until it is complete.

So the same command goes on with what is there and ends with the same bytes.

Zarr's format 2 is written, with consolidated metadata. Every Zarr, from 2 on, and every xarray
opens that without a warning; format 3 has no stable type of text yet, and none of consolidated
metadata, so today's Zarr warns of both, and 3.0.8 cannot read the text that 3.1 writes.
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

    Tree = dict[str, Any]  # of a Zarr group: keys and contents

FORMAT = 1
_PROGRESS = ".progress.npz"
_ATTRIBUTES, _CONSOLIDATED = ".zattrs", ".zmetadata"
_KIND = "a sweep that ftforce wrote"
_ARRAYS = "arrays"  # of the identity: a digest of all that the kernels are given
_UNTOLD = {_ARRAYS, "postures", "check"}  # they say it in numbers nobody knows
_SAMPLES = (*PER_POSTURE, *PER_SET, "worst_set", *(f"worst_{name}" for name in PER_SET))


class Asked(NamedTuple):
    """A sweep.

    Attributes
    ----------
    job, setting, sets :
        What is done.
    identity :
        What makes it this sweep and no other, as JSON has it.
    """

    job: Job
    setting: SweepSetting
    sets: tuple[FaultSet, ...]
    identity: dict[str, Any]


class Opened(NamedTuple):
    """A sweep that is being written.

    Attributes
    ----------
    asked :
        The sweep.
    path :
        The folder; ``None`` in memory.
    store :
        What Zarr writes to: a path, or memory.
    tree :
        What is in memory, if it is.
    arrays :
        Of the samples, by name.
    summary :
        Of the chunks that are done.
    done :
        Which are, shape (chunks,).
    lock :
        Of the folder; ``None`` where nothing is left to write.
    """

    asked: Asked
    path: Path | None
    store: Any
    tree: Tree
    arrays: dict[str, Any]
    summary: Summary
    done: NDArray[np.bool_]
    lock: FileLock | None

    @property
    def is_complete(self) -> bool:
        """Whether nothing is left to write."""
        return self.path is not None and self.lock is None

    def close(self) -> None:
        """Let other processes write."""
        if self.lock is not None:
            self.lock.release()


def create(path: Path | None, asked: Asked) -> Opened:
    """Make an empty sweep, or go on with the one that is there. `Opened.close` ends it.

    Parameters
    ----------
    path :
        Of the Zarr group; ``None`` for memory.
    asked :
        The sweep.

    Raises
    ------
    OutputError
        There is something else, another process writes it, or it cannot be written.
    """
    job, identity = asked.job, asked.identity
    none_done = (job.empty_summary(), np.zeros(job.chunks, np.bool_))
    if path is None:
        return _opened(asked, None, _tree(asked), none_done, None)
    if not _is_new(path) and _checked(path, identity)["complete"]:
        return _complete(asked, path)
    lock = folder.lock(path)
    try:
        if _is_new(path):  # looked at again: now nobody else writes
            with disk_errors(path):
                folder.clear(path, _known())
                _put(path, _tree(asked))
        elif _checked(path, identity)["complete"]:
            lock.release()
            return _complete(asked, path)
        with disk_errors(path):
            folder.remove_partial(path)
        so_far = _progress(path, job.bins, job.workspace, job.n_sets, job.chunks)
        return _opened(asked, path, {}, so_far, lock)
    except BaseException:
        lock.release()
        raise


def _opened(
    asked: Asked, path: Path | None, tree: Tree, so_far: tuple[Summary, Any], lock: Any
) -> Opened:
    import zarr
    from zarr.storage import MemoryStore

    store: Any = MemoryStore(tree) if path is None else str(path)
    with disk_errors(path):
        group = zarr.open_group(store, mode="r+", zarr_format=2)
        arrays = {name: group[name] for name in sample_names(asked.job)}
    return Opened(asked, path, store, tree, arrays, *so_far, lock)


def _complete(asked: Asked, path: Path) -> Opened:
    """Return the sweep that has nothing left to do, and remove what a killed process left."""
    job = asked.job
    with suppress(OSError):  # who may not write can still read
        _remove_traces(path)
    try:
        summary = _stored_summary(path, job.bins, job.workspace)
    except Exception as problem:  # a damaged store may raise anything
        raise SweepError(path, f"is damaged ({problem}); remove it to begin anew") from None
    return Opened(asked, path, str(path), {}, {}, summary, np.ones(job.chunks, np.bool_), None)


def _remove_traces(path: Path) -> None:
    folder.remove_partial(path)
    (path / _PROGRESS).unlink(missing_ok=True)
    (path / folder.LOCK).unlink(missing_ok=True)


def _is_new(path: Path) -> bool:
    """Tell whether a folder is still to be made: missing, empty, or half made and then killed."""
    with disk_errors(path):
        if not path.exists():
            return True
        if not path.is_dir():
            return False
        entries = {entry.name for entry in path.iterdir()}
        if entries <= {folder.LOCK}:
            return True
        return _ATTRIBUTES not in entries and folder.is_half_made(path, _known())


def _known() -> set[str]:
    """Return the names of all that ftforce may put into the folder of a sweep, but its lock."""
    dimensions = variables.all_coordinates()
    return {".zgroup", _ATTRIBUTES, _CONSOLIDATED, _PROGRESS, *_SAMPLES, *dimensions}


def _checked(path: Path, identity: dict[str, Any]) -> dict[str, Any]:
    """Return what a folder says of its sweep if that is the one that is asked.

    Raises
    ------
    OutputError
        It is another one, or none.
    """
    about = _about(path, OutputError)
    found = about["identity"]
    if found != identity:
        differs = _differences(found, identity) or "the robot, its limits or its masses are others"
        raise OutputError(
            path, f"holds another sweep ({differs}); give another --output, or remove that one"
        )
    return about


def _differences(found: dict[str, Any], asked: dict[str, Any]) -> str:
    """Say what differs, of the postures what differs about them."""
    there, here = ({**one, **_postures(one)} for one in (found, asked))
    keys = sorted(key for key in {*there, *here} if there.get(key) != here.get(key))
    if "source of postures" in keys:  # then nothing else about them tells more
        keys = [key for key in keys if key not in {*_postures(found), *_postures(asked)}]
        keys.append("source of postures")
    told = [key for key in keys if key not in _UNTOLD]
    return "; ".join(_difference(key, there.get(key), here.get(key)) for key in told)


def _postures(identity: dict[str, Any]) -> dict[str, Any]:
    about = dict(identity["postures"])
    return {"source of postures": about.pop("source"), **about}


def _difference(key: str, found: object, asked: object) -> str:
    there, here = (json.dumps(value, ensure_ascii=False) for value in (found, asked))
    if max(len(there), len(here)) > 60:
        return f"another {key}"
    return f"{key} {there} there, {here} here"


# ---- what is written -------------------------------------------------------------------------


def sample_names(job: Job) -> list[str]:
    """Return the names of the arrays of samples."""
    return [] if job.keep == "summary" else list(_one(job))


def _one(job: Job) -> dict[str, NDArray[Any]]:
    """Return the samples of one posture: their names, types and shapes are all samples'."""
    q = job.postures.block(0, 1)
    return samples_of(q, job.plan.evaluator()(q), job.keep)


def _tree(asked: Asked, summary: Summary | None = None) -> Tree:
    """Return keys and contents of the Zarr group: all but the samples.

    Parameters
    ----------
    asked :
        Job, setting, sets and identity.
    summary :
        Of the whole sweep; ``None`` if it is not complete.
    """
    import zarr
    from zarr.storage import MemoryStore

    job, setting, sets, identity = asked
    tree: Tree = {}
    store = MemoryStore(tree)
    group = zarr.open_group(store, mode="w", zarr_format=2)
    if job.keep != "summary":
        for name, one in _one(job).items():
            shape = (job.postures.count, *one.shape[1:])
            # What is not done yet reads as NaN. A complete sweep lacks nothing, and integers
            # with a fill value would come out of xarray as floats.
            fill = -1 if summary is None else None
            _create(group, name, (shape, one.dtype, fill), variables.sample(name, setting), job)
    given = (setting, sets, job.bins, job.workspace)
    for name, (values, variable) in variables.coordinates(*given).items():
        _create(group, name, values, variable)
    for name, values in (summary.arrays() if summary is not None else {}).items():
        whole = variables.shaped(name, values, job.workspace)
        _create(group, f"{variables.SUMMARY}{name}", whole, variables.counted(name, setting))
    complete = summary is not None
    about = variables.attributes(*given, version=FORMAT, identity=identity, complete=complete)
    group.attrs.update(about)
    zarr.consolidate_metadata(store, zarr_format=2)
    return tree


def _create(group: Any, name: str, content: Any, variable: Any, job: Job | None = None) -> None:
    """Make an array of given values, or, with a job, one that its samples will fill."""
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
        # Doubles of measures hardly compress; this takes 0.2 µs per kB and saves a quarter.
        compressors=Blosc("lz4", clevel=5, shuffle=Blosc.SHUFFLE),
        fill_value=_fill(np.dtype(dtype), fill),
        attributes={"_ARRAY_DIMENSIONS": list(variable.dimensions), **variable.attributes},
        config={"write_empty_chunks": True},  # a chunk that is not there is one to be done
    )
    if values is not None:
        array[...] = values


def _fill(dtype: np.dtype[Any], fill: int | None) -> Any:
    if dtype.kind == "f":
        return np.nan
    return "" if dtype.kind == "U" else fill


def _put(path: Path, tree: Tree) -> None:
    """Write a group's keys into files; the attributes, which tell what it is, last of all."""
    last = [_CONSOLIDATED, _ATTRIBUTES]
    for key in [*(key for key in tree if key not in last), *last]:
        file, data = path / key, tree[key].to_bytes()
        if not (file.is_file() and file.read_bytes() == data):
            file.parent.mkdir(exist_ok=True)
            folder.write_durably(file, data)


def write_samples(opened: Opened, index: int, samples: dict[str, NDArray[Any]]) -> None:
    """Write what is kept of a chunk; when this returns it is on the disk.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    with disk_errors(opened.path):
        _write(opened.arrays, opened.asked.job, opened.path, index, samples)


def write_chunk(
    path: Path, token: str, job: Job, index: int, samples: dict[str, NDArray[Any]]
) -> None:
    """Write what is kept of a chunk from another process, perhaps on another machine.

    Parameters
    ----------
    path :
        The folder.
    token :
        Of its lock.
    job, index, samples :
        The sweep, the chunk's number, and its samples.

    Raises
    ------
    OutputError
        It cannot be written, or this machine does not see that folder.
    """
    import zarr

    if folder.lock_of(path).get("token") != token:
        raise OutputError(
            path,
            "is not seen by all workers; --output needs a file system that they share, or "
            "keep the summary alone",
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


def save_progress(opened: Opened) -> None:
    """Write down which chunks are done, and their summary, whole or not at all.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    if opened.path is None:
        return
    stream = io.BytesIO()
    arrays: dict[str, Any] = {"done": np.packbits(opened.done), **opened.summary.arrays()}
    np.savez(stream, **arrays)
    with disk_errors(opened.path):
        for name in opened.arrays:
            folder.sync(opened.path / name)  # that the chunks are there, not only their content
        folder.write_durably(opened.path / _PROGRESS, stream.getvalue())


def finish(opened: Opened) -> None:
    """Write the summary, mark the sweep as complete and remove what only unfinished ones have.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    save_progress(opened)  # killed from here on, nothing is done again
    tree = _tree(opened.asked, opened.summary)
    if opened.path is None:
        opened.tree.update(tree)
        return
    with disk_errors(opened.path):
        _put(opened.path, tree)
        _remove_traces(opened.path)


# ---- what is read ----------------------------------------------------------------------------


def open_sweep(path: str | PathLike[str]) -> Sweep:
    """Open a sweep that was written by `ftforce.sweep` or ``ftforce sweep``.

    One that is not complete yet shows what is done so far.

    Parameters
    ----------
    path :
        The Zarr group.

    Raises
    ------
    SweepError
        There is none, or it is damaged.
    """
    where = Path(path)
    about = _about(where, SweepError)
    if not about["complete"] and not (where / _PROGRESS).exists():
        about = _about(where, SweepError)  # it may have been completed just now
    _needs_zarr()
    try:
        setting = SweepSetting.from_dict(about["setting"])
        sets = sets_from_lists(about["sets"])
        bins = Bins(**about["bins"])
        stored = about["workspace"].items()
        grid: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in stored}
        workspace = Workspace(**grid)
        if about["complete"]:
            summary = _stored_summary(where, bins, workspace)
        else:
            chunks = -(-setting.count // setting.chunk)
            summary, _ = _progress(where, bins, workspace, len(sets), chunks)
        opening = partial(dataset_of, str(where))
        opening()  # what is damaged says so now
        return Sweep(setting, sets, summary, str(where), opening)
    except FtforceError:
        raise
    except Exception as problem:  # a damaged store may raise anything
        raise SweepError(path, f"is damaged ({problem}); {_KIND} was expected") from None


def _needs_zarr() -> None:
    try:
        import xarray  # noqa: F401
        import zarr  # noqa: F401
    except ImportError as problem:
        raise FtforceError(
            f"stored sweeps need {problem.name}: install the extra with "
            "pip install 'ftforce[sweep]'"
        ) from None


def dataset_of(store: Any) -> Any:
    """Return all arrays of a store as an xarray Dataset, read when they are looked at."""
    import xarray as xr

    return xr.open_dataset(store, engine="zarr", consolidated=True, chunks=None)


def _about(path: Path, error: Any) -> dict[str, Any]:
    """Return what a folder says of the sweep in it."""
    if not path.exists():
        raise error(path, f"no such folder; {_KIND} was expected")
    try:
        attributes = json.loads((path / _ATTRIBUTES).read_text("utf-8"))
        found = json.loads(attributes[variables.ABOUT])
        version, _, _ = found["format"], found["identity"], found["complete"]
    except (OSError, ValueError, KeyError, TypeError):
        raise error(path, f"is there but is no sweep; {_KIND} was expected") from None
    if version != FORMAT:
        raise error(path, f"is of format {version}; this ftforce knows format {FORMAT}")
    return dict(found)


def _progress(
    path: Path, bins: Bins, workspace: Workspace, n_sets: int, chunks: int
) -> tuple[Summary, NDArray[np.bool_]]:
    """Return what is done so far."""
    file = path / _PROGRESS
    if not file.exists():
        return Summary.empty(n_sets, bins, workspace), np.zeros(chunks, np.bool_)
    try:
        with np.load(file) as found:
            arrays = {name: found[name] for name in found.files}
        done = np.unpackbits(arrays.pop("done"), count=chunks).astype(np.bool_)
        return Summary.from_arrays(arrays, bins, workspace), done
    except Exception as problem:  # a damaged file may raise anything
        raise SweepError(file, f"is damaged ({problem}); remove it to begin anew") from None


def _stored_summary(path: Path, bins: Bins, workspace: Workspace) -> Summary:
    import zarr

    group = zarr.open_group(str(path), mode="r", zarr_format=2, use_consolidated=True)
    arrays = {}
    for name, array in _arrays(group):
        bare = name.removeprefix(variables.SUMMARY)
        if bare != name:
            arrays[bare] = variables.unshaped(bare, np.asarray(array[...]), workspace)
    return Summary.from_arrays(arrays, bins, workspace)


def _arrays(group: Any) -> Iterable[tuple[str, Any]]:
    found: Iterable[tuple[str, Any]] = group.arrays()
    return found
