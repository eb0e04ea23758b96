"""Sweeps on disk: a Zarr group that plain xarray can open, written chunk by chunk.

A sweep can be killed at any time:

- A chunk is done once it is listed in the progress file, which is replaced atomically after
  the arrays of the chunk are on disk.
- The manifest is written last on creation, and replaced last on completion; no other file of the
  group but the chunks of the summary differs between the two.
- A lock excludes other processes, and its file marks the folder as ftforce's until completion.

Running the same command again therefore resumes the sweep and yields the same bytes. It also
computes again what was lost or altered, which the manifest reveals, see
`ftforce.batch.store.manifest`.

The store uses Zarr format 2 with consolidated metadata, which xarray and all versions of Zarr from
2 on open without a warning. Format 3 has no stable specification yet of strings or of
consolidated metadata: current versions of Zarr warn about both, and 3.0.8 cannot read strings
written by 3.1.
"""

from __future__ import annotations

import hashlib
import io
import json
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.batch.job import samples_of
from ftforce.batch.result import Sweep, SweepSetting, sets_from_lists
from ftforce.batch.store import folder, variables
from ftforce.batch.store.folder import disk_errors
from ftforce.batch.store.manifest import (
    AGAIN,
    EXPECTED,
    FORMAT,
    MANIFEST,
    Manifest,
    check_sizes,
    damaged,
    digest_of,
    read_manifest,
    read_regular,
)
from ftforce.batch.summary.bins import Bins, Workspace
from ftforce.batch.summary.summary import Summary, check_summary_size
from ftforce.errors import FtforceError, OutputError, SweepError
from ftforce.io.npz import read_npz

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from os import PathLike

    from filelock import FileLock
    from numpy.typing import NDArray

    from ftforce.batch.job import Job
    from ftforce.batch.store.manifest import Files
    from ftforce.core.faults import FaultSet

    Tree = dict[str, Any]  # keys and contents of a Zarr group

_PROGRESS = ".progress.npz"
_ATTRIBUTES, _CONSOLIDATED = ".zattrs", ".zmetadata"
_ARRAYS = "arrays"  # key in the identity: digest of all kernel inputs
_DIGESTS = {_ARRAYS, "postures", "check"}  # digests, meaningless in an error message
# Said in the identity in another way, or follows from what is; sweeps of older versions lack some.
_NOT_IDENTIFYING = (
    *("postures", "count", "is_random", "implausible"),
    *(
        "tip_source",
        "other_tips",
        "payload_mass",
        "payload_offset",
        "payload_inertia",
        "computed_with",
    ),
)


@dataclass(frozen=True, eq=False)
class SweepRequest:
    """A requested sweep.

    Attributes
    ----------
    job, setting, sets :
        Job, setting and fault sets.
    """

    job: Job
    setting: SweepSetting
    sets: tuple[FaultSet, ...]

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Everything the output depends on, in JSON form."""
        plain = self.setting.to_dict()
        for name in _NOT_IDENTIFYING:
            del plain[name]
        plan = self.job.plan
        question = plan.question
        if not question.middle.any():  # not hashed before limits could differ by direction
            question = question._replace(middle=np.zeros(0))
        arrays = [*plan.mechanism, *plan.faults, *question]
        content = b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)
        same = {
            **plain,
            "postures": self.job.postures.identity(),
            "cell": self.job.workspace.edge,
            _ARRAYS: hashlib.sha256(content).hexdigest()[:16],
        }
        found: dict[str, Any] = json.loads(json.dumps(same))
        return found

    def computed_with(self, name: str) -> SweepRequest:
        """Return the same sweep, computed with ``kernels`` or ``numpy``.

        Parameters
        ----------
        name :
            Which of them.
        """
        job = replace(self.job, uses_numpy=name == "numpy")
        return replace(self, job=job, setting=replace(self.setting, computed_with=name))


class Progress(NamedTuple):
    """The finished chunks of a sweep.

    Attributes
    ----------
    summary :
        Their summary.
    done :
        Whether each chunk is finished and counted in the summary, shape (chunks,).
    lost :
        Whether it is, but its samples were lost or altered, shape (chunks,).
    files :
        The files of their samples.
    """

    summary: Summary
    done: NDArray[np.bool_]
    lost: NDArray[np.bool_]
    files: Files

    @classmethod
    def none(cls, summary: Summary, chunks: int) -> Progress:
        """Return that of a sweep of which nothing is done, from an empty summary."""
        return cls(summary, np.zeros(chunks, np.bool_), np.zeros(chunks, np.bool_), {})


class OpenStore(NamedTuple):
    """A sweep that is being written.

    Attributes
    ----------
    request :
        The requested sweep.
    path :
        The folder; ``None`` in memory.
    arrays :
        Names of the sample arrays; in memory, those written so far.
    progress :
        The finished chunks.
    lock :
        Lock of the folder; ``None`` if the sweep is complete.
    """

    request: SweepRequest
    path: Path | None
    arrays: dict[str, Any]
    progress: Progress
    lock: FileLock | None

    @property
    def summary(self) -> Summary:
        """Summary of the finished chunks."""
        return self.progress.summary

    @property
    def done(self) -> NDArray[np.bool_]:
        """Whether each chunk is finished, shape (chunks,)."""
        return self.progress.done

    @property
    def is_complete(self) -> bool:
        """Whether the sweep is complete."""
        return self.path is not None and self.lock is None

    def close(self) -> None:
        """Release the lock."""
        if self.lock is not None:
            self.lock.release()


def create(
    path: Path | None,
    request: SweepRequest,
    choose: Callable[[SweepRequest], SweepRequest] = lambda request: request,
) -> OpenStore:
    """Create an empty sweep, or resume an existing one; close it with `OpenStore.close`.

    Parameters
    ----------
    path :
        Path of the Zarr group; ``None`` for memory.
    request :
        The requested sweep.
    choose :
        Chooses what a new sweep is computed with.

    Raises
    ------
    OutputError
        The folder contains something else, is being written by another process, or is not writable.
    """
    if path is None:
        return OpenStore(choose(request), None, {}, _none_done(request.job), None)
    if not must_create(path) and (opened := _open_complete(request, path)) is not None:
        return opened
    lock = folder.lock(path)
    try:
        # Checked again, now that the folder is locked.
        if must_create(path):
            with disk_errors(path):
                folder.clear(path, _known_names())
            request = choose(request)
            progress = _none_done(request.job)
        elif (opened := _open_complete(request, path)) is not None:
            lock.release()
            return opened
        else:
            # As it was begun: the last digits of what is computed in two ways may differ.
            begun = read_manifest(path, SweepError).about["setting"]
            request = request.computed_with(begun.get("computed_with", "kernels"))
            progress = _resumed(request, path)
        with disk_errors(path):
            folder.remove_partial(path)
            if not progress.done.all():  # otherwise `finish` does
                _write_tree(path, request, _tree(request))
        names = dict.fromkeys(_sample_names(request.job))
        return OpenStore(request, path, names, progress, lock)
    except BaseException:
        lock.release()
        raise


def _none_done(job: Job) -> Progress:
    return Progress.none(job.empty_summary(), job.chunks)


def _open_complete(request: SweepRequest, path: Path) -> OpenStore | None:
    """Open a complete sweep, and remove what a killed process left behind.

    Returns
    -------
    :
        ``None`` if it is incomplete or damaged.
    """
    manifest = _checked_manifest(path, request.identity)
    if not manifest.is_complete or any(damaged(path, manifest.files)):
        return None
    with suppress(OSError):  # a complete sweep can be read without write permission
        _clean_up(path)
    summary = _stored_summary(path, manifest)
    request = request.computed_with(manifest.about["setting"].get("computed_with", "kernels"))
    done = np.ones(request.job.chunks, np.bool_)
    progress = Progress(summary, done, ~done, manifest.files)
    return OpenStore(request, path, {}, progress, None)


def _resumed(request: SweepRequest, path: Path) -> Progress:
    """Return what is done of a sweep that is incomplete or damaged."""
    job, manifest = request.job, read_manifest(path, SweepError)
    samples = set(_sample_names(job))
    if not manifest.is_complete:
        progress = _stored_progress(path, job.bins, job.workspace, job.n_sets, job.chunks)
        return _with_lost(progress, damaged(path, progress.files))
    flaws = set(damaged(path, manifest.files))
    if any(key == _CONSOLIDATED or key.startswith(variables.SUMMARY_PREFIX) for key in flaws):
        return _none_done(job)  # all chunks together give the summary
    files = {key: one for key, one in manifest.files.items() if _is_chunk_of(key, samples)}
    done = np.ones(job.chunks, np.bool_)
    progress = Progress(_stored_summary(path, manifest), done, ~done, files)
    return _with_lost(progress, flaws & files.keys())  # `finish` writes the others


def _is_chunk_of(key: str, names: set[str]) -> bool:
    name, _, last = key.rpartition("/")
    return name in names and not last.startswith(".")


def _with_lost(progress: Progress, flaws: Iterable[str]) -> Progress:
    for key in flaws:
        progress.lost[int(key.partition("/")[2].partition(".")[0])] = True
    return progress


def _clean_up(path: Path) -> None:
    folder.remove_partial(path)
    (path / _PROGRESS).unlink(missing_ok=True)
    (path / folder.LOCK).unlink(missing_ok=True)


def must_create(path: Path) -> bool:
    """Return whether a folder must be created: it is missing, empty, or left incomplete.

    Parameters
    ----------
    path :
        The folder.

    Raises
    ------
    OutputError
        It cannot be looked at.
    """
    with disk_errors(path):
        if not path.exists():
            return True
        if not path.is_dir():
            return False
        entries = {entry.name for entry in path.iterdir()}
        if entries <= {folder.LOCK}:
            return True
        return MANIFEST not in entries and folder.is_partly_created(path, _known_names())


def _known_names() -> set[str]:
    """Return the names of all files that ftforce may create for a sweep, except its lock."""
    dimensions = variables.all_coordinates()
    summary = (f"{variables.SUMMARY_PREFIX}{field.name}" for field in fields(Summary))
    own = (".zgroup", _ATTRIBUTES, _CONSOLIDATED, _PROGRESS, MANIFEST)
    return {*own, *variables.SAMPLES, *dimensions, *summary}


def _checked_manifest(path: Path, identity: dict[str, Any]) -> Manifest:
    """Return the manifest of a sweep, if it is the requested one.

    Raises
    ------
    OutputError
        The folder contains a different sweep, or none.
    """
    manifest = read_manifest(path, OutputError)
    found = manifest.about["identity"]
    if found != identity:
        differs = _differences(found, identity) or "a different robot, or other limits or masses"
        raise OutputError(
            path, f"contains a different sweep ({differs}); choose another --output, or remove it"
        )
    return manifest


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
    from ftforce.batch.numpy_path import NumpyEvaluator  # which compiles nothing

    q = job.postures.block(0, 1)
    return samples_of(q, NumpyEvaluator(job.plan)(q), job.keep)


def _tree(
    request: SweepRequest, summary: Summary | None = None, *, has_samples: bool = True
) -> Tree:
    """Return keys and contents of the Zarr group, without the samples.

    Parameters
    ----------
    request :
        The requested sweep.
    summary :
        Summary of the complete sweep; ``None`` if it is not complete.
    has_samples :
        Whether the group has arrays for the samples, if the sweep keeps any.
    """
    import zarr
    from zarr.storage import MemoryStore

    job, setting = request.job, request.setting
    tree: Tree = {}
    store = MemoryStore(tree)
    group = zarr.open_group(store, mode="w", zarr_format=2)
    if has_samples and job.keep != "summary":
        for name, values in _sample_of_one(job).items():
            shape = (job.postures.count, *values.shape[1:])
            _create(group, name, (shape, values.dtype), variables.sample(name, setting), job)
    for name, (values, variable) in _coordinates(request).items():
        _create(group, name, values, variable)
    for name, values in (summary or job.empty_summary()).arrays().items():
        whole = variables.shaped(name, values, job.workspace)
        content = (whole.shape, whole.dtype) if summary is None else whole
        about = variables.counted(name, setting)
        _create(group, f"{variables.SUMMARY_PREFIX}{name}", content, about)
    group.attrs.update(variables.attributes(setting))
    zarr.consolidate_metadata(store, zarr_format=2)
    return tree


def _coordinates(request: SweepRequest) -> dict[str, Any]:
    job = request.job
    return variables.coordinates(request.setting, request.sets, job.bins, job.workspace)


def _create(group: Any, name: str, content: Any, variable: Any, job: Job | None = None) -> None:
    """Create an array of given values, or with shape and type only, to be filled later."""
    values = None if isinstance(content, tuple) else content
    shape, dtype = content if values is None else (values.shape, values.dtype)
    chunks = tuple(max(1, length) for length in shape)
    if job is not None:
        chunks = (job.chunk, *chunks[1:])
    array = group.create_array(
        name,
        shape=shape,
        dtype=dtype,
        chunks=chunks,
        compressors=_codec(),
        fill_value=_unknown(name, np.dtype(dtype)),
        attributes={"_ARRAY_DIMENSIONS": list(variable.dimensions), **variable.attributes},
        config={"write_empty_chunks": True},  # a missing chunk is an unfinished one
    )
    if values is not None:
        array[...] = values


def _codec() -> Any:
    from numcodecs import Blosc  # type: ignore[import-untyped]

    # Measures in double precision hardly compress: this saves a quarter, at 0.2 µs per kB.
    return Blosc("lz4", clevel=5, shuffle=Blosc.SHUFFLE)


def _unknown(name: str, dtype: np.dtype[Any]) -> Any:
    """Return the fill value of an array, which stands for chunks that are not there."""
    if name in variables.VERDICTS:
        return 0
    return {"f": np.nan, "U": ""}.get(dtype.kind) if dtype.kind in "fU" else np.iinfo(dtype).min


def _write_tree(
    path: Path, request: SweepRequest, tree: Tree, samples: Files | None = None
) -> None:
    """Write the keys of a group to files, and then the manifest, which marks it as created.

    Parameters
    ----------
    path, request, tree :
        The folder, the sweep, and its group.
    samples :
        The files of its samples if it is complete.
    """
    contents = {key: tree[key].to_bytes() for key in tree}
    job = request.job
    about = variables.description(
        request.setting,
        request.sets,
        job.bins,
        job.workspace,
        version=FORMAT,
        identity=request.identity,
        complete=samples is not None,
    )
    files = {**(samples or {}), **{key: digest_of(data) for key, data in contents.items()}}
    for key, data in {**contents, MANIFEST: Manifest(about, files).to_bytes()}.items():
        file = path / key
        if file.is_symlink() or not (file.is_file() and file.read_bytes() == data):
            file.parent.mkdir(exist_ok=True)
            folder.write_durably(file, data)


def write_samples(opened: OpenStore, index: int, samples: dict[str, NDArray[Any]]) -> Files:
    """Write the samples of a chunk, wait until they are on disk, and return their files.

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
    if opened.path is not None:
        return _write(opened.path, opened.request.job, index, samples)
    job, arrays = opened.request.job, opened.arrays
    start, stop = job.range(index)
    for name, values in samples.items():
        if name not in arrays:  # two threads may get here: the array of one of them is kept
            arrays.setdefault(name, np.empty((job.postures.count, *values.shape[1:]), values.dtype))
        arrays[name][start:stop] = values
    return {}


def write_chunk(
    path: Path, token: str, job: Job, index: int, samples: dict[str, NDArray[Any]]
) -> Files:
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
    if folder.lock_of(path).get("token") != token:
        raise OutputError(
            path,
            "is not visible to all workers; --output must be on a file system that they share, or "
            "use --keep summary",
        )
    return _write(path, job, index, samples)


def _write(path: Path, job: Job, index: int, samples: dict[str, NDArray[Any]]) -> Files:
    """Write the chunks of the arrays as Zarr does, which omits those that equal the fill value."""
    files = {}
    for name, values in samples.items():
        chunk = np.full((job.chunk, *values.shape[1:]), _unknown(name, values.dtype), values.dtype)
        chunk[: len(values)] = _stored_form(name, values)
        data = bytes(_codec().encode(chunk))
        key = f"{name}/{'.'.join([str(index), *['0'] * (values.ndim - 1)])}"
        with disk_errors(path):
            (path / name).mkdir(exist_ok=True)
            folder.write_content(path / key, data)
        files[key] = digest_of(data)
    return files


def _stored_form(name: str, values: NDArray[Any]) -> NDArray[Any]:
    return values + variables.FIRST_VERDICT if name in variables.VERDICTS else values


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
    files = np.frombuffer(json.dumps(opened.progress.files).encode(), np.uint8)
    arrays: dict[str, Any] = {"done": np.packbits(opened.done), "files": files}
    np.savez(stream, **(arrays | opened.summary.arrays()))
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
    if opened.path is None:
        return
    save_progress(opened)  # if killed after this, no chunk is repeated
    tree = _tree(opened.request, opened.summary)
    with disk_errors(opened.path):
        _write_tree(opened.path, opened.request, tree, opened.progress.files)
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
    manifest = read_manifest(where, SweepError)
    if not manifest.is_complete and not (where / _PROGRESS).exists():
        manifest = read_manifest(where, SweepError)  # it may have completed in the meantime
    _needs_zarr()
    try:
        setting, sets, bins, workspace = _described(manifest)
        check_sizes(where, manifest.files)
        if manifest.is_complete:
            summary = _stored_summary(where, manifest)
        else:
            chunks = -(-setting.count // setting.chunk)
            progress = _stored_progress(where, bins, workspace, len(sets), chunks)
            check_sizes(where, progress.files)
            summary = progress.summary
        opening = partial(dataset_of, str(where))
        opening()  # detect damage now, not on first access
        return Sweep(setting, sets, summary, str(where), opening)
    except (FtforceError, MemoryError):
        raise
    except Exception as problem:  # a damaged store may raise anything
        raise SweepError(path, f"is damaged ({problem}); expected {EXPECTED}") from None


def _described(manifest: Manifest) -> tuple[SweepSetting, tuple[FaultSet, ...], Bins, Workspace]:
    about = manifest.about
    stored = about["workspace"].items()
    grid: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in stored}
    bins, workspace = Bins(**about["bins"]), Workspace(**grid)
    sets = sets_from_lists(about["sets"])
    check_summary_size(len(sets), bins, workspace)  # before any array of that size is made
    return SweepSetting.from_dict(about["setting"]), sets, bins, workspace


def _needs_zarr() -> None:
    try:
        import xarray  # noqa: F401
        import zarr  # noqa: F401
    except ImportError as problem:
        raise FtforceError(
            f"stored sweeps require {problem.name} (pip install 'ftforce[sweep]')"
        ) from None


def opening_of(opened: OpenStore) -> Callable[[], Any]:
    """Return a function that returns all arrays of a complete sweep as an xarray Dataset."""
    if opened.path is not None:
        return partial(dataset_of, str(opened.path))
    return partial(_dataset_in_memory, opened.request, opened.summary, opened.arrays)


def _dataset_in_memory(
    request: SweepRequest, summary: Summary, samples: dict[str, NDArray[Any]]
) -> Any:
    """Return what `dataset_of` returns of the same sweep on disk; the samples are not copied."""
    from zarr.storage import MemoryStore

    from ftforce.batch.store.reading import open_dataset, with_samples

    store = MemoryStore(_tree(request, summary, has_samples=False))
    return with_samples(open_dataset(store, is_complete=True), samples, request.setting)


def dataset_of(store: str) -> Any:
    """Return all arrays of a stored sweep as an xarray Dataset, loaded lazily.

    Verdicts are indices of `ftforce.core.verdict.VERDICTS`, which they are not in the store.

    Parameters
    ----------
    store :
        Path of the folder.
    """
    from ftforce.batch.store.reading import open_dataset

    path = Path(store)
    manifest = read_manifest(path, SweepError)
    return open_dataset(_checked_store(path, manifest), is_complete=manifest.is_complete)


def _checked_store(path: Path, manifest: Manifest) -> Any:
    from ftforce.batch.store.reading import CheckedStore

    described = setting, sets, bins, workspace = _described(manifest)
    files = manifest.files
    if not manifest.is_complete:
        chunks = -(-setting.count // setting.chunk)
        progress = _stored_progress(path, bins, workspace, len(sets), chunks)
        files = {**files, **progress.files}
    shapes = variables.shapes_of(*described)
    return CheckedStore(path, files, shapes, is_complete=manifest.is_complete)


def _stored_progress(
    path: Path, bins: Bins, workspace: Workspace, n_sets: int, chunks: int
) -> Progress:
    """Return the finished chunks."""
    file = path / _PROGRESS
    if not file.exists():
        return Progress.none(Summary.empty(n_sets, bins, workspace), chunks)
    try:
        arrays = read_npz(read_regular(path, _PROGRESS))
        done = np.unpackbits(arrays.pop("done"), count=chunks).astype(np.bool_)
        files = {key: tuple(one) for key, one in json.loads(arrays.pop("files").tobytes()).items()}
        summary = Summary.from_arrays(arrays, bins, workspace)
        return Progress(summary, done, np.zeros(chunks, np.bool_), files)
    except MemoryError:
        raise
    except Exception as problem:  # a damaged file may raise anything
        raise SweepError(file, f"is damaged ({problem}); remove it to start again") from None


def _stored_summary(path: Path, manifest: Manifest) -> Summary:
    """Return the summary of a complete sweep.

    Raises
    ------
    SweepError
        It is damaged.
    """
    import zarr

    _, _, bins, workspace = _described(manifest)
    try:
        store = _checked_store(path, manifest)
        group = zarr.open_group(store, mode="r", zarr_format=2, use_consolidated=True)
        arrays = {}
        for name, array in _arrays(group):
            bare = name.removeprefix(variables.SUMMARY_PREFIX)
            if bare != name:
                arrays[bare] = variables.unshaped(bare, np.asarray(array[...]), workspace)
        return Summary.from_arrays(arrays, bins, workspace)
    except (FtforceError, MemoryError):
        raise
    except Exception as problem:  # a damaged store may raise anything
        raise SweepError(path, f"is damaged ({problem}); {AGAIN}") from None


def _arrays(group: Any) -> Iterable[tuple[str, Any]]:
    found: Iterable[tuple[str, Any]] = group.arrays()
    return found
