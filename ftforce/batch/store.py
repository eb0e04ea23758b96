"""Sweeps on disk: a Zarr group that plain xarray opens, written chunk by chunk.

A chunk counts as done once it is in the progress file, which is written after the chunk's arrays
and replaced whole. So whenever a sweep is killed, what is on disk is right, and the same command
goes on from there and ends with the same bytes.
"""

from __future__ import annotations

import errno
import io
import json
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ftforce.batch.bins import Bins, Workspace
from ftforce.batch.job import PER_SET
from ftforce.batch.result import Sweep, SweepSetting, sets_from_lists, sets_to_lists
from ftforce.batch.summary import Summary
from ftforce.errors import FtforceError, OutputError, SweepError
from ftforce.source import write_whole

if TYPE_CHECKING:
    from collections.abc import Iterator
    from os import PathLike

    import zarr
    from numpy.typing import NDArray

    from ftforce.batch.job import Job
    from ftforce.faults import FaultSet

FORMAT = 1
_PROGRESS = ".progress.npz"
_ABOUT = "ftforce"
_KIND = "a sweep that ftforce wrote"
_SUMMARY = "summary_"
_DIMENSIONS = "_ARRAY_DIMENSIONS"  # where xarray looks for them
_PARTIAL = "*.partial"  # what Zarr leaves behind when it is killed while it writes

_WORDS: dict[str, tuple[str, str]] = {
    "q": ("rad", "joint positions (m for joints that slide)"),
    "tip": ("m", "position of the tip in the root's axes"),
    "healthy_rank": ("1", "rank of the healthy arm's task Jacobian J"),
    "healthy_margin": ("1", "sigma_min(J)/sigma_max(J)"),
    "verdict": ("1", "0 tolerated, 1 borderline, 2 not tolerated"),
    "rank_lost": ("1", "rank of J less that of K, J without the failed joints"),
    "sigma_min": ("m/rad", "smallest singular value of K (weighted)"),
    "margin": ("1", "sigma_min(K)/sigma_max(J)"),
    "rho": ("1", "relative manipulability w(K)/w(J), NaN where w(J) = 0"),
    "jump": ("N", "norm of the force jump, NaN where the arm cannot stand still"),
    "moment_jump": ("N m", "norm of the moments' jump"),
    "relative_jump": ("1", "weighted jump over the weighted force, 1 if nothing holds the arm"),
    "capability": ("N", "largest force commanded in the direction, NaN if nothing holds it"),
    "worst_set": ("1", "index of the fault set with the worst verdict, then jump, then margin"),
}  # fmt: skip


class Opened(NamedTuple):
    """A sweep that is being written.

    Attributes
    ----------
    store :
        What Zarr writes to: a path, or memory.
    group :
        The Zarr group.
    path :
        ``None`` in memory.
    summary :
        Of the chunks that are done.
    done :
        Which are, shape (chunks,).
    """

    store: Any
    group: zarr.Group
    path: Path | None
    summary: Summary
    done: NDArray[np.bool_]


@contextmanager
def disk_errors(path: Path | None) -> Iterator[None]:
    """Turn what a disk refuses into one clear line.

    Raises
    ------
    OutputError
        Something could not be written.
    """
    try:
        yield
    except OSError as problem:
        reason = problem.strerror or str(problem)
        kept = "; what is finished is kept: the same command goes on from there"
        if problem.errno in {errno.EACCES, errno.EPERM, errno.EROFS}:
            kept = ""
        raise OutputError(path or "memory", f"cannot be written ({reason}){kept}") from None


def create(
    path: Path | None, job: Job, setting: SweepSetting, sets: tuple[FaultSet, ...],
    identity: dict[str, Any],
) -> Opened:  # fmt: skip
    """Make an empty sweep, or go on with the one that is there.

    Parameters
    ----------
    path :
        Of the Zarr group; ``None`` for memory.
    job, setting, sets :
        What is asked.
    identity :
        What makes it this sweep and no other, as JSON has it.

    Raises
    ------
    OutputError
        There is something else; or it cannot be written.
    """
    if path is not None and path.exists() and (not path.is_dir() or any(path.iterdir())):
        return _go_on(path, job, identity)
    import zarr
    from zarr.storage import MemoryStore

    store: Any = MemoryStore() if path is None else str(path)
    with disk_errors(path):
        group = zarr.open_group(store, mode="w", zarr_format=2)
        _create_samples(group, job, setting)
        _create_coordinates(group, setting, sets)
        group.attrs.update(_attributes(job, setting, sets, identity))
    done = np.zeros(job.chunks, np.bool_)
    return Opened(store, group, path, job.empty_summary(), done)


def _go_on(path: Path, job: Job, identity: dict[str, Any]) -> Opened:
    import zarr

    about = _about(path, OutputError)
    found = about["identity"]
    if found != identity:
        keys = sorted(k for k in {*found, *identity} if found.get(k) != identity.get(k))
        differs = "; ".join(_difference(k, found.get(k), identity.get(k)) for k in keys)
        raise OutputError(
            path, f"holds another sweep ({differs}); give another --output, or remove that one"
        )
    summary, done = _progress(path, job.bins, job.workspace, job.n_sets, job.chunks)
    if about["complete"]:
        done[:] = True
    for left in path.rglob(_PARTIAL):
        left.unlink(missing_ok=True)
    group = zarr.open_group(str(path), mode="r+", zarr_format=2)
    return Opened(str(path), group, path, summary, done)


def _difference(key: str, found: object, asked: object) -> str:
    there, here = (json.dumps(value, ensure_ascii=False) for value in (found, asked))
    if max(len(there), len(here)) > 60:
        return f"another {key}"
    return f"{key} {there} there, {here} here"


def _attributes(
    job: Job, setting: SweepSetting, sets: tuple[FaultSet, ...], identity: dict[str, Any]
) -> dict[str, Any]:
    return {
        "title": f"fault sweep of {setting.robot}",
        "conventions": f"axes of the force: {setting.axes}; positions in the root's axes; forces "
        "are what the robot exerts on its environment",
        _ABOUT: {
            "format": FORMAT,
            "complete": False,
            "identity": identity,
            "setting": setting.to_dict(),
            "sets": sets_to_lists(sets),
            "bins": asdict(job.bins),
            "workspace": asdict(job.workspace),
        },
    }


def _create_samples(group: zarr.Group, job: Job, setting: SweepSetting) -> None:
    """Make the arrays of what is kept of every posture, from one posture's."""
    if job.keep == "summary":
        return
    from ftforce.batch.job import samples_of

    q = job.postures.block(0, 1)
    for name, one in samples_of(q, job.plan.evaluator()(q), job.keep).items():
        dimensions = ("posture", *{"q": ("joint",), "tip": ("axis",)}.get(name, ()))
        if job.keep == "all" and name in PER_SET:
            dimensions = ("posture", "fault_set")
        count = job.postures.count
        _create(
            group, name, (count, *one.shape[1:]), one.dtype, dimensions, setting=setting,
            chunks=(min(job.chunk, count), *one.shape[1:]),
        )  # fmt: skip


def _create(
    group: zarr.Group,
    name: str,
    shape: tuple[int, ...],
    dtype: Any,
    dimensions: tuple[str, ...],
    *,
    setting: SweepSetting,
    chunks: tuple[int, ...] | None = None,
) -> Any:
    bare = name.removeprefix("worst_") if name != "worst_set" else name
    unit, words = _WORDS.get(bare, ("1", name.replace("_", " ")))
    if bare in {"jump", "capability"} and setting.size_unit == "N·m":
        unit = "N m"
    return group.create_array(
        name,
        shape=shape,
        dtype=dtype,
        chunks=chunks or tuple(max(1, size) for size in shape),
        fill_value=None if np.dtype(dtype).kind in "iub" else np.nan,  # none of ours is missing
        attributes={_DIMENSIONS: list(dimensions), "units": unit, "long_name": words},
        config={"write_empty_chunks": True},
    )


def _create_coordinates(
    group: zarr.Group, setting: SweepSetting, sets: tuple[FaultSet, ...]
) -> None:
    names = {
        "joint": list(setting.joints),
        "axis": ["x", "y", "z"],
        "fault_set": [str(one) for one in sets],
    }
    for dimension, values in names.items():
        words = np.array(values)
        array = group.create_array(
            dimension, shape=words.shape, dtype=words.dtype, chunks=words.shape, fill_value="",
            attributes={_DIMENSIONS: [dimension]},
        )  # fmt: skip
        array[:] = words


def write_samples(opened: Opened, job: Job, index: int, samples: dict[str, NDArray[Any]]) -> None:
    """Write what is kept of a chunk.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    with disk_errors(opened.path):
        _write(opened.group, job, index, samples)


def write_chunk(path: Path, job: Job, index: int, samples: dict[str, NDArray[Any]]) -> None:
    """Write what is kept of a chunk from another process.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    import zarr

    with disk_errors(path):
        _write(zarr.open_group(str(path), mode="r+", zarr_format=2), job, index, samples)


def _write(group: zarr.Group, job: Job, index: int, samples: dict[str, NDArray[Any]]) -> None:
    start, stop = job.range(index)
    for name, values in samples.items():
        group[name][start:stop] = values  # type: ignore[index]


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
    write_whole(opened.path / _PROGRESS, stream.getvalue())


def finish(opened: Opened, setting: SweepSetting) -> None:
    """Write the summary, mark the sweep as complete and remove the progress file.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    dimensions = _summary_dimensions(opened.summary)
    with disk_errors(opened.path):
        for name, values in opened.summary.arrays().items():
            shaped = values
            if name.startswith("cell_"):
                shaped = values.reshape(*opened.summary.workspace.shape, *values.shape[1:])
            full = f"{_SUMMARY}{name}"
            if full in opened.group:
                del opened.group[full]
            given = (opened.group, full, shaped.shape, values.dtype, dimensions[name])
            _create(*given, setting=setting)[...] = shaped
        about = dict(opened.group.attrs[_ABOUT])  # type: ignore[arg-type]
        opened.group.attrs[_ABOUT] = about | {"complete": True}
        if opened.path is not None:
            (opened.path / _PROGRESS).unlink(missing_ok=True)


def _summary_dimensions(summary: Summary) -> dict[str, tuple[str, ...]]:
    """Name the dimensions of the summary's arrays by their sizes' meaning."""
    cells = ("cell_x", "cell_y", "cell_z")
    per_set = ("fault_set",)
    fixed: dict[str, tuple[str, ...]] = {
        "healthy_rank": ("rank",),
        "healthy_margin": ("share_bin",),
        "tolerated_sets": ("tolerated_set_count",),
        "verdicts": (*per_set, "verdict_code"),
        "rank_lost": (*per_set, "rank"),
        "margin": (*per_set, "share_bin"),
        "rho": (*per_set, "share_bin"),
        "jump": (*per_set, "jump_bin"),
        "capability": (*per_set, "capability_bin"),
        "cell_postures": cells,
        "cell_tolerates_all": cells,
        "cell_tolerated": (*cells, *per_set),
        "cell_worst_margin": (*cells, "cell_bin"),
        "cell_worst_rho": (*cells, "cell_bin"),
        "cell_min_margin": (*cells, *per_set),
    }
    return {
        name: fixed.get(name, per_set if values.ndim else ())
        for name, values in summary.arrays().items()
    }


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
    folder = Path(path)
    about = _about(folder, SweepError)
    try:
        setting = SweepSetting.from_dict(about["setting"])
        sets = sets_from_lists(about["sets"])
        bins = Bins(**about["bins"])
        stored = about["workspace"].items()
        grid: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in stored}
        workspace = Workspace(**grid)
        if about["complete"]:
            summary = _stored_summary(folder, bins, workspace)
        else:
            chunks = -(-setting.count // setting.chunk)
            summary, _ = _progress(folder, bins, workspace, len(sets), chunks)
        return Sweep(setting, sets, summary, str(folder), dataset_of(str(folder)))
    except FtforceError:
        raise
    except Exception as problem:  # a damaged store may raise anything
        raise SweepError(path, f"is damaged ({problem}); {_KIND} was expected") from None


def dataset_of(store: Any) -> Any:
    """Return all arrays of a store as an xarray Dataset, read when they are looked at."""
    import xarray as xr

    return xr.open_dataset(
        store, engine="zarr", consolidated=False, chunks=None, backend_kwargs={"zarr_format": 2}
    )


def _about(path: Path, error: Any) -> dict[str, Any]:
    """Return what a folder says of the sweep in it."""
    attributes = path / ".zattrs"
    if not path.exists():
        raise error(path, f"no such folder; {_KIND} was expected")
    try:
        found = json.loads(attributes.read_text("utf-8"))[_ABOUT]
        version = found["format"]
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

    group = zarr.open_group(str(path), mode="r", zarr_format=2)
    arrays = {}
    for name, array in group.arrays():
        if name.startswith(_SUMMARY):
            values = np.asarray(array[...])
            bare = name.removeprefix(_SUMMARY)
            if bare.startswith("cell_"):
                values = values.reshape(workspace.cells, *values.shape[3:])
            arrays[bare] = values
    return Summary.from_arrays(arrays, bins, workspace)
