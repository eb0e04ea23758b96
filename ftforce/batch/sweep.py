"""Fault analysis over many postures: surviving workspace, critical joints."""

from __future__ import annotations

import math
import os
from contextlib import closing
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ftforce.__version__ import __version__
from ftforce.analysis.limits_files import URDF
from ftforce.analysis.question import HEALTHY, AllFaultSets, Question, check_progress
from ftforce.analysis.warnings import implausible
from ftforce.batch.compiled import with_faster_evaluator
from ftforce.batch.job import PIECE, Job
from ftforce.batch.plan import Plan
from ftforce.batch.postures.drawn import Drawn
from ftforce.batch.postures.files import postures_from_file
from ftforce.batch.postures.postures import Listed, Postures, whole_number
from ftforce.batch.result import KEEPS, Keep, Sweep, SweepSetting
from ftforce.batch.runner import InThreads, run, threads_of
from ftforce.batch.size import check_room
from ftforce.batch.store import store
from ftforce.batch.summary.bins import Bins, Workspace
from ftforce.core.arrays import read_only
from ftforce.core.faults import FaultMode
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL, RTOL, reduce
from ftforce.errors import FtforceError, InputError, check_word
from ftforce.io.text import file_digest
from ftforce.robot.dynamics import numbers_of
from ftforce.robot.kinematics import reach_bound, task_jacobian, tip_pose

if TYPE_CHECKING:
    from collections.abc import Iterable
    from os import PathLike

    from numpy.typing import ArrayLike

    from ftforce.analysis.conditions import PayloadLike
    from ftforce.analysis.friction import FrictionLike
    from ftforce.analysis.limits_files import LimitsLike
    from ftforce.analysis.question import Progress
    from ftforce.batch.runner import Runner
    from ftforce.core.task import Axes, Task
    from ftforce.robot.robot import Robot

_CHUNK = 65_536  # postures, at most
_LARGEST_ARRAY = 2**31 - 2**16  # bytes, the most a codec accepts
_VALUES = 2_000_000  # postures times fault sets per chunk, about 16 MB per stored array
_SHARES = 32  # chunks of a sweep that is not stored, at least
_LEAST_RADIUS = 1e-3  # m, for a wrist whose tip never moves
_TRIED = 64  # postures, spread over the sweep, in which the healthy arm is tried first
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
    friction: FrictionLike = None,
    gravity: ArrayLike | None = None,
    payload: PayloadLike = None,
    task: str | Iterable[str] | Task = "force",
    length: float | None = None,
    joint_length: float | None = None,
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
        Torque limits of the capability: ``urdf`` (default), a TOML, YAML or CSV file, or
        `ftforce.core.limits.Limits`; ``none`` computes no capability. Verdicts and jumps ignore
        them.
    friction, gravity, payload, task, length, joint_length, axes, rtol, wary :
        As in `ftforce.analyze`.
    keep :
        Samples to keep: ``all``, those of each posture's ``worst`` set, or only the ``summary``;
        default ``worst`` with an output, else ``summary``.
    cell :
        Edge length of the workspace cells, m; default about a twentieth of the reach.
    output :
        Zarr group to write; default in memory. An interrupted sweep is resumed.
    chunk :
        Postures processed and stored at a time; default 65,536, or fewer for many sets or
        without an output.
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
    question = sweep_question(
        robot,
        force=force,
        direction=direction,
        limits=limits,
        friction=friction,
        gravity=gravity,
        payload=payload,
        task=task,
        length=length,
        joint_length=joint_length,
        axes=axes,
        rtol=rtol,
        wary=wary,
    )
    all_sets = AllFaultSets.parse(robot, faults, mode)
    return sweep_of(
        question,
        all_sets,
        _postures(robot, q, n, method, seed),
        keep=_checked_keep(keep, output),
        cell=cell,
        output=output,
        chunk=chunk,
        runner=_runner(threads, workers, scheduler, output),
        progress=progress,
    )


def sweep_question(robot: Robot, *, limits: LimitsLike = None, **asked: Any) -> Question:
    """Return the question of a sweep.

    The capability needs both limits and a direction; without either, both are dropped.

    Parameters
    ----------
    robot :
        The arm.
    limits :
        As in `ftforce.sweep`; by default those of the URDF.
    asked :
        Further arguments of `Question.parse`.

    Raises
    ------
    InputError
        A malformed value, or a force of zero.
    FtforceError
        The extra ``sweep`` is not installed.
    """
    _needs_numba()
    question = Question.parse(robot, limits=URDF if limits is None else limits, **asked)
    if question.force is not None and not question.force.any():
        raise InputError("the force must not be zero; omit it to consider all forces")
    direction = question.direction_or_that_of(question.F)
    if direction is None or question.limits is None:
        # The limits may supply the friction, which matters without a capability too.
        friction = question.friction if question.given_friction or limits else None
        return replace(question, direction=None, limits=None, given_friction=friction)
    return replace(question, direction=direction)


def sweep_of(
    question: Question,
    all_sets: AllFaultSets,
    postures: Postures,
    *,
    keep: str,
    cell: float | None,
    output: str | PathLike[str] | None = None,
    chunk: int | None = None,
    runner: Runner,
    progress: Progress | None = None,
) -> Sweep:
    """Return the sweep of a question over postures.

    Parameters
    ----------
    question, all_sets, postures :
        What is asked, of which sets, and where.
    keep, cell, output, chunk, progress :
        As in `ftforce.sweep`.
    runner :
        What runs the chunks.

    Raises
    ------
    InputError
        The chunk is malformed or too large, or the cell is malformed.
    FileError
        A file cannot be read or written, or the output holds another sweep.
    """
    request = request_of(
        question,
        all_sets,
        postures,
        keep=keep,
        cell=cell,
        chunk=chunk,
        is_stored=output is not None,
    )
    check_progress(progress)
    return run_request(request, None if output is None else Path(output), runner, progress)


def request_of(
    question: Question,
    all_sets: AllFaultSets,
    postures: Postures,
    *,
    keep: str,
    cell: float | None,
    chunk: int | None = None,
    is_stored: bool = False,
) -> store.SweepRequest:
    """Return what a sweep does, before any posture is analysed.

    Parameters
    ----------
    question, all_sets, postures, keep, cell, chunk :
        As of `sweep_of`.
    is_stored :
        Whether it has an output.

    Raises
    ------
    InputError
        The chunk is malformed or too large, or the cell is malformed.
    """
    _check_task(question, postures)
    sets = tuple(all_sets)
    needs_gravity = question.direction is not None or all_sets.mode is FaultMode.FREE
    job = Job(
        Plan.of(question, sets, needs_gravity=needs_gravity),
        postures,
        Bins(_size_of(question), question.direction is not None),
        _workspace(question.robot, postures, cell),
        keep,
        _chunk_of(chunk, len(sets), postures.count, is_stored=is_stored),
    )
    setting = _setting(question, all_sets, job, needs_gravity=needs_gravity)
    return store.SweepRequest(job, setting, sets)


def _needs_numba() -> None:
    """Check that the extra ``sweep`` is installed.

    Raises
    ------
    FtforceError
        A package is missing; the message names it.
    """
    for name in ("filelock", "numba", "xarray", "zarr"):  # found, but imported when needed only
        if find_spec(name) is None:
            raise FtforceError(
                f"sweeps need {name}: install the extra with pip install 'ftforce[sweep]'"
            )


def _check_task(question: Question, postures: Postures) -> None:
    """Check that the healthy arm can exert some of what is asked in one of some postures.

    Raises
    ------
    InputError
        It cannot in any of them.
    """
    robot, task = question.robot, question.task
    tried = min(postures.count, _TRIED)
    for k in range(tried):  # spread over the sweep: a recording may begin in a singular posture
        at = k * (postures.count - 1) // max(tried - 1, 1)
        q = read_only(postures.block(at, at + 1)[0].copy())
        J = question.weigh_jacobian(task_jacobian(robot, q, task))
        healthy = reduce(read_only(J), HEALTHY.mask(robot.n), question.rtol)
        load = question.load(healthy)
        if question.has_force_to_keep(healthy, None if load is None else load.F):
            return
    raise question.nothing_to_keep(f"in any of {tried} postures")


def _size_of(question: Question) -> float | None:
    """Return the norm of the force relative to which jumps are measured, N (N·m)."""
    F, task = question.force, question.task
    if F is None:
        return None
    rows = list(task.force_rows or task.moment_rows)
    return math.hypot(*F[rows]) or math.hypot(*task.weigh_force(F))


def _checked_keep(keep: str | None, output: object) -> str:
    if keep is None:
        return "summary" if output is None else "worst"
    check_word("value of keep", keep, KEEPS)
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


def _chunk_of(chunk: int | None, sets: int, count: int, *, is_stored: bool) -> int:
    """Return the number of postures per chunk: as requested, or a size that fits in memory.

    Chunks that are not stored may be so small that threads have equal shares of them.
    """
    if chunk is not None:
        size = min(whole_number(chunk, "chunk", PIECE), count)
        most = _LARGEST_ARRAY // (8 * sets)
        if size > most:
            raise InputError(
                f"a chunk with {sets} fault sets can hold at most {most:,} postures "
                "(2 GB per array)"
            )
        return size
    size, shares = _CHUNK, 1 if is_stored else _SHARES
    while size > PIECE and (size * sets > _VALUES or (shares > 1 and size * shares > count)):
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
    question: Question, all_sets: AllFaultSets, job: Job, *, needs_gravity: bool
) -> SweepSetting:
    robot, task, limits = question.robot, question.task, question.limits
    force, direction, payload = question.force, question.direction, question.conditions.payload
    friction = [None if math.isnan(x) else x for x in question.friction.torque.tolist()]
    swings = all_sets.mode is FaultMode.FREE
    unknown = () if limits is None else np.flatnonzero(~limits.is_known).tolist()
    return SweepSetting(
        robot=robot.name,
        robot_sha256=file_digest(robot.path),
        base=robot.base,
        tip=robot.tip,
        tip_source=robot.tip_source,
        other_tips=dict(robot.other_tips),
        joints=robot.names,
        joint_units=robot.units,
        task=str(task),
        components=task.components,
        axes=task.axes,
        length=task.length,
        mode=all_sets.mode.value,
        largest=all_sets.largest,
        force=None if force is None else tuple(force.tolist()),
        direction=None if direction is None else tuple(direction.tolist()),
        limits=None if limits is None else limits.source,
        unknown_limits=tuple(robot.names[i] for i in unknown),
        gravity=tuple(question.conditions.gravity.tolist()),
        payload=None if payload is None else str(payload),
        **numbers_of(payload),
        rtol=question.rtol,
        wary=question.wary,
        keep=job.keep,
        chunk=job.chunk,
        postures=str(job.postures),
        count=job.postures.count,
        is_random=isinstance(job.postures, Drawn),
        version=__version__,
        joint_length=question.scale.length,
        friction=question.friction.in_words(robot) if swings else None,
        friction_torques=tuple(friction) if swings else (),
        implausible=tuple(implausible(question, needs_gravity=needs_gravity, needs_inertia=False)),
    )


def _runner(
    threads: int | None, workers: int | None, scheduler: str | None, output: object
) -> Runner:
    if workers is None and scheduler is None:
        return InThreads(threads_of(threads))
    if threads is not None:
        raise InputError("give either threads of this process or workers, not both")
    from ftforce.batch.cluster import on_cluster

    return on_cluster(workers, scheduler, output)


def run_request(
    request: store.SweepRequest, path: Path | None, runner: Runner, progress: Progress | None
) -> Sweep:
    """Return the sweep that was requested.

    Parameters
    ----------
    request :
        What it does.
    path, runner, progress :
        Output, what runs the chunks, and progress, as of `sweep_of`.

    Raises
    ------
    FileError
        A file cannot be read or written, or the output holds another sweep.
    """

    def choose(request: store.SweepRequest) -> store.SweepRequest:
        is_faster = isinstance(runner, InThreads) and with_faster_evaluator(request.job).uses_numpy
        return request.computed_with("numpy") if is_faster else request

    if path is not None and store.must_create(path):
        check_room(request, path)
    with closing(store.create(path, request, choose)) as opened:
        if not opened.is_complete:
            run(opened.request.job, opened, runner, progress)
            store.finish(opened)
    at, done = None if path is None else str(path), opened.request
    return Sweep(done.setting, done.sets, opened.summary, at, store.opening_of(opened))
