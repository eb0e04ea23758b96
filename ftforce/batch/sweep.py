"""Fault analysis over many postures: surviving workspace, critical joints."""

from __future__ import annotations

import hashlib
import math
import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.__version__ import __version__
from ftforce.analysis.conditions import Conditions
from ftforce.analysis.limits_files import NONE, URDF, choose_limits
from ftforce.analysis.question import check_size, checked_mode, direction_or_force
from ftforce.batch.job import PIECE, Job
from ftforce.batch.plan import Plan, faults_of, mechanism_of, question_of
from ftforce.batch.postures.drawn import Drawn
from ftforce.batch.postures.files import postures_from_file
from ftforce.batch.postures.postures import Listed, Postures, whole_number
from ftforce.batch.result import KEEPS, Keep, Sweep, SweepSetting
from ftforce.batch.summary.bins import Bins, Workspace
from ftforce.core.arrays import Vector, as_vector, read_only
from ftforce.core.faults import FaultMode, fault_sets
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL, RTOL, check_tolerances
from ftforce.core.task import Axes, Task
from ftforce.errors import FtforceError, InputError, UnknownNameError
from ftforce.robot.kinematics import reach_bound, tip_pose

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from os import PathLike

    from numpy.typing import ArrayLike

    from ftforce.analysis.limits_files import LimitsLike
    from ftforce.analysis.question import Progress
    from ftforce.batch.runner import Runner
    from ftforce.core.faults import FaultSet
    from ftforce.core.limits import Limits
    from ftforce.robot.dynamics import Payload
    from ftforce.robot.robot import Robot

CHUNK = 65_536  # postures, at most
_LARGEST_ARRAY = 2**31 - 2**16  # bytes, the most a codec accepts
_VALUES = 2_000_000  # postures times fault sets per chunk, about 16 MB per stored array
_LEAST_RADIUS = 1e-3  # m, for a wrist whose tip never moves
CELLS = 20  # along the longest axis of the workspace, about


def sweep(
    robot: Robot,
    q: ArrayLike | str | PathLike[str] | Postures | None = None,
    *,
    n: float | None = None,
    method: str = "sobol",
    seed: int = 0,
    faults: int = 1,
    mode: FaultMode | str = FaultMode.LOCKED,
    force: ArrayLike | None = None,
    direction: ArrayLike | None = None,
    limits: LimitsLike = None,
    gravity: ArrayLike | None = None,
    payload: Payload | float | str | tuple[float, ArrayLike] | None = None,
    task: str | Iterable[str] | Task = "force",
    length: float | None = None,
    axes: Axes = "tool",
    rtol: float = RTOL,
    wary: float = BORDERLINE_RTOL,
    keep: Keep | None = None,
    cell: float | None = None,
    output: str | PathLike[str] | None = None,
    chunk: int | None = None,
    threads: int | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> Sweep:
    """Analyse every set of up to ``faults`` failed joints at many postures.

    Parameters
    ----------
    robot :
        The arm.
    q :
        Joint positions, rad or m, shape (k, n); or a file (.npy, .csv, .parquet); or a
        `ftforce.batch.postures.Grid`. By default, ``n`` postures are drawn within the limits.
    n :
        Number of postures to draw.
    method, seed :
        ``sobol`` (scrambled) or ``uniform``, and the seed of the random numbers.
    faults, mode :
        Size of the largest fault sets, and their mode, ``locked`` or ``free``.
    force :
        Force the tool exerts on its environment, N and N·m, in the task's axes, shape (m,).
    direction :
        Direction of the capability, in the task's axes, shape (m,); default that of the force.
    limits :
        Torque limits of the capability: ``urdf`` (default), a TOML or CSV file, or
        `ftforce.core.limits.Limits`; ``none`` computes no capability. Verdicts and jumps ignore
        them.
    gravity, payload, task, length, axes, rtol, wary :
        As in `ftforce.analyze`.
    keep :
        Samples to keep: ``all``, those of each posture's ``worst`` set, or only the ``summary``;
        default ``all`` with an output, else ``summary``.
    cell :
        Edge length of the workspace cells, m; default about a twentieth of the reach.
    output :
        Zarr group to write; default in memory. An interrupted sweep is resumed.
    chunk :
        Postures processed and stored at a time; default 65,536, or fewer for many sets.
    threads :
        Number of threads; default one per processor.
    workers, scheduler :
        Instead of threads, a number of Dask processes, or the address of a Dask scheduler.
    progress :
        Called after every chunk with the number of postures done and the total.

    Raises
    ------
    InputError
        A malformed value.
    FileError
        A file cannot be read or written, or the output holds another sweep.

    Examples
    --------
    >>> import ftforce
    >>> arm = ftforce.load_robot("dh5")
    >>> result = ftforce.sweep(arm, n=1000, force=[80, 50, 10])
    >>> result.joints[0].joint + 1  # the critical one
    2
    """
    needs_numba()
    check_tolerances(rtol, wary)
    check_size(robot, faults)
    how = checked_mode(mode)
    wanted = Task.parse(task, axes, length)
    conditions = Conditions.of(robot, gravity=gravity, payload=payload)
    F = _force(wanted, force)
    ray = direction_or_force(wanted, direction, None if F is None else wanted.weigh_force(F))
    counted = None
    if ray is not None and limits != NONE:
        counted = choose_limits(robot, URDF if limits is None else limits)
    ray = None if counted is None else ray
    postures = _postures(robot, q, n, method, seed)
    sets = tuple(fault_sets(robot.n, faults, how))
    weighs = ray is not None or how is FaultMode.FREE
    asked: dict[str, Any] = {"force": F, "direction": ray, "rtol": rtol, "wary": wary}
    plan = plan_of(robot, sets, wanted, conditions, weighs=weighs, limits=counted, **asked)
    kept = _checked_keep(keep, output)
    size = _chunk_of(chunk, len(sets), postures.count)
    bins = Bins(_size_of(wanted, F), ray is not None)
    job = Job(plan, postures, bins, _workspace(robot, postures, cell), kept, size)
    asked |= {"mode": how.value, "largest": faults, "keep": kept, "chunk": size}
    setting = _setting(robot, wanted, conditions, counted, postures, **asked)
    runner = _runner(threads, workers, scheduler, output)
    path = None if output is None else Path(output)
    return _run(job, setting, sets, path=path, runner=runner, progress=progress)


def needs_numba() -> None:
    """Check that the extra ``sweep`` is installed.

    Raises
    ------
    FtforceError
        A package is missing; the message names it.
    """
    try:
        import filelock  # noqa: F401
        import numba  # noqa: F401
        import xarray  # noqa: F401
        import zarr  # noqa: F401
    except ImportError as problem:
        raise FtforceError(
            f"sweeps need {problem.name}: install the extra with pip install 'ftforce[sweep]'"
        ) from None


def plan_of(
    robot: Robot,
    sets: Sequence[FaultSet],
    task: Task,
    conditions: Conditions,
    *,
    weighs: bool,
    **question: Any,
) -> Plan:
    """Return the plan of a sweep; ``question`` holds further arguments of `question_of`."""
    own = None if conditions.is_model_gravity else conditions.gravity
    return Plan(
        mechanism_of(robot, gravity=own, payload=conditions.payload, weighs=weighs),
        faults_of(sets, robot.n),
        question_of(task, robot.n, weighs=weighs, **question),
        robot.n,
        bool(task.force_rows and task.moment_rows),
    )


def _force(task: Task, force: ArrayLike | None) -> Vector | None:
    if force is None:
        return None
    F = as_vector(force, task.m, "force", f"{', '.join(task.components)} of the task '{task}'")
    if not F.any():
        raise InputError("the force needs a component that is not zero, or leave it out")
    return F


def _size_of(task: Task, F: Vector | None) -> float | None:
    """Return the norm of the force relative to which jumps are measured, N (N·m)."""
    if F is None:
        return None
    rows = list(task.force_rows or task.moment_rows)
    return math.hypot(*F[rows]) or math.hypot(*task.weigh_force(F))


def _checked_keep(keep: str | None, output: object) -> str:
    if keep is None:
        return "summary" if output is None else "all"
    if keep not in KEEPS:
        raise UnknownNameError("value of keep", keep, KEEPS)
    return keep


def _postures(robot: Robot, q: Any, n: float | None, method: str, seed: int) -> Postures:
    if q is None and n is None:
        raise InputError("give postures, or how many to draw (n, --samples)")
    if q is not None and n is not None:
        raise InputError("give either postures or how many to draw, not both")
    if q is None:
        assert n is not None
        return Drawn.of(robot, n, method, seed)
    if isinstance(q, (str, os.PathLike)):
        return postures_from_file(robot, q)
    if hasattr(q, "block") and hasattr(q, "identity"):
        if q.n != robot.n:
            raise InputError(f"the postures are of {q.n} joints; the chain has {robot.numbered()}")
        found: Postures = q
        return found
    return Listed.of(robot, q)


def _chunk_of(chunk: int | None, sets: int, count: int) -> int:
    """Return the number of postures per chunk: as requested, or a size that fits in memory."""
    if chunk is not None:
        size = min(whole_number(chunk, "chunk", PIECE), count)
        most = _LARGEST_ARRAY // (8 * sets)
        if size > most:
            raise InputError(f"a chunk for {sets} fault sets has {most:,} postures at most: 2 GB")
        return size
    size = CHUNK
    while size > PIECE and size * sets > _VALUES:
        size //= 2
    return min(size, count)


def _workspace(robot: Robot, postures: Postures, cell: float | None) -> Workspace:
    """Return cells that cover the reach of the tip."""
    centre, radius = reach_bound(robot)
    if not math.isfinite(radius):  # a prismatic joint without limits: use the postures' extent
        q = postures.block(0, min(postures.count, PIECE))
        places = np.array([tip_pose(robot, read_only(row.copy()))[1] for row in q])
        centre = 0.5 * (places.min(axis=0) + places.max(axis=0))
        radius = 1.5 * float(np.ptp(places, axis=0).max()) + 1e-3
    radius = max(radius, _LEAST_RADIUS)
    edge = _round_length(2.0 * radius / CELLS) if cell is None else cell
    return Workspace.around(centre, radius, edge)


def _round_length(x: float) -> float:
    """Return 1, 2 or 5 times a power of ten, not above x."""
    power = 10.0 ** math.floor(math.log10(x))
    step = max(step for step in (1.0, 2.0, 5.0) if step * power <= x * (1.0 + 1e-9))
    return float(f"{step * power:.6g}")


def _setting(
    robot: Robot,
    task: Task,
    conditions: Conditions,
    limits: Limits | None,
    postures: Postures,
    *,
    force: Vector | None,
    direction: Vector | None,
    **plain: Any,
) -> SweepSetting:
    unknown = () if limits is None else np.flatnonzero(np.isnan(limits.effort)).tolist()
    return SweepSetting(
        robot=robot.name,
        base=robot.base,
        tip=robot.tip,
        joints=robot.names,
        joint_units=tuple(joint.unit for joint in robot.joints),
        task=str(task),
        components=task.components,
        axes=task.axes,
        length=task.length,
        force=None if force is None else tuple(force.tolist()),
        direction=None if direction is None else tuple(direction.tolist()),
        limits=None if limits is None else limits.source,
        unknown_limits=tuple(robot.names[i] for i in unknown),
        gravity=tuple(conditions.gravity.tolist()),
        payload=None if conditions.payload is None else str(conditions.payload),
        postures=str(postures),
        count=postures.count,
        is_random=isinstance(postures, Drawn),
        version=__version__,
        **plain,
    )


def _runner(
    threads: int | None, workers: int | None, scheduler: str | None, output: object
) -> Runner:
    from ftforce.batch.runner import in_threads, threads_of

    if workers is None and scheduler is None:
        return in_threads(threads_of(threads))
    if threads is not None:
        raise InputError("threads are this process's; give either threads or workers")
    from ftforce.batch.cluster import on_cluster

    return on_cluster(workers, scheduler, output)


def _identity(job: Job, setting: SweepSetting) -> dict[str, Any]:
    """Return the identity of a sweep: everything its output depends on."""
    plain = setting.to_dict()
    for name in ("postures", "count", "is_random"):
        del plain[name]
    arrays = [*job.plan.mechanism, *job.plan.faults, *job.plan.question]
    content = b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)
    same = {
        **plain,
        "postures": job.postures.identity(),
        "cell": job.workspace.edge,
        "arrays": hashlib.sha256(content).hexdigest()[:16],
    }
    found: dict[str, Any] = _as_json(same)
    return found


def _as_json(value: Any) -> Any:
    import json

    return json.loads(json.dumps(value))


def _run(
    job: Job,
    setting: SweepSetting,
    sets: tuple[FaultSet, ...],
    *,
    path: Path | None,
    runner: Runner,
    progress: Progress | None,
) -> Sweep:
    from contextlib import closing

    from ftforce.batch.runner import run
    from ftforce.batch.store import store

    asked = store.SweepRequest(job, setting, sets, _identity(job, setting))
    with closing(store.create(path, asked)) as opened:
        if not opened.is_complete:
            run(job, opened, runner, progress)
            store.finish(opened)
    opening = partial(store.dataset_of, opened.store)
    return Sweep(setting, sets, opened.summary, None if path is None else str(path), opening)
