"""Torque remap for control loops: fault sets fixed in advance, microseconds per posture."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from ftforce.analysis.question import AllFaultSets, Question, single_mode
from ftforce.batch.plan import Plan
from ftforce.core.arrays import Matrix, Vector, read_only
from ftforce.core.faults import FaultMode, FaultSet
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL, RTOL
from ftforce.core.verdict import VERDICTS
from ftforce.errors import FtforceError, InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from ftforce.analysis.fault_names import Joints
    from ftforce.analysis.friction import FrictionLike
    from ftforce.batch.kernels.layout import Integers
    from ftforce.core.task import Axes, Task
    from ftforce.core.verdict import Verdict
    from ftforce.robot.dynamics import Payload
    from ftforce.robot.robot import Robot

FaultSets: TypeAlias = "int | FaultSet | Iterable[FaultSet | Joints]"

_FLOAT = np.dtype(np.float64)


class Remapped(NamedTuple):
    """Result of `Remapper` for S fault sets, in arrays that its next call overwrites.

    The arrays are read-only. Values are NaN where the arm cannot be held.

    Attributes
    ----------
    U :
        Motor torques that exert the force after the remap, N·m (N if prismatic), without the
        torques for weight and motion, shape (S, n); 0 at locked joints. At a free-swinging joint
        it is the torque that balances the joint's weight, as in
        `ftforce.core.changes.TorqueChange`.
    self_motion :
        Part of the torques that exerts no static force but moves the arm, N·m (N if prismatic),
        shape (n,).
    force_before :
        Force that the healthy arm exerts, F̂, N and N·m, in the task's axes, shape (m,).
    force_after :
        Force that remains after each fault set, shape (S, m).
    jump :
        ΔF, ``force_before`` minus ``force_after``, shape (S, m).
    jump_norm :
        Norm of the force components of the jump, N, shape (S,); ``None`` if the task has none.
    moment_jump_norm :
        Norm of its moment components, N·m, shape (S,); ``None`` if the task has none.
    margin :
        σ_min(K)/σ_max(J), shape (S,).
    sigma_min :
        σ_min(K) of the weighted Jacobian, m (dimensionless if prismatic), shape (S,).
    rank_lost :
        rank(J) - rank(K), shape (S,).
    verdict :
        Index in ``ftforce.core.verdict.VERDICTS``, shape (S,): 0 tolerated, 1 borderline, 2 not
        tolerated.
    """

    U: Matrix
    self_motion: Vector
    force_before: Vector
    force_after: Matrix
    jump: Matrix
    jump_norm: Vector | None
    moment_jump_norm: Vector | None
    margin: Vector
    sigma_min: Vector
    rank_lost: Integers
    verdict: Integers

    @property
    def verdicts(self) -> tuple[Verdict, ...]:
        """Verdict of each set; for display, since it allocates."""
        return tuple(VERDICTS[code] for code in self.verdict.tolist())

    def copy(self) -> Remapped:
        """Return a copy that later calls do not overwrite."""
        kept = (None if array is None else read_only(array.copy()) for array in self)
        return Remapped(*kept)  # type: ignore[arg-type] # ``None`` fields stay ``None``


class Remapper:
    """Remap torques after faults fixed in advance, with the results of `ftforce.analyze`.

    Everything except the posture and the torques is checked and converted once, on construction.
    A call takes microseconds and allocates no memory; its result is overwritten by the next call.
    A remapper is not thread-safe: give each thread its own, for instance by ``copy.copy``.

    Requires numba, from the extra ``sweep``. The first remapper created on a machine waits for
    compilation, up to half a minute.

    Parameters
    ----------
    robot :
        The arm.
    faults :
        Largest number of joints that fail together, for all sets up to that size; or the sets
        themselves: joints by number (from 1) or name, masks of shape (n,), or `ftforce.FaultSet`
        for sets that mix modes.
    mode :
        Fault mode of joints not given in a `ftforce.FaultSet`: ``locked`` or ``free``.
    gravity, payload, friction :
        As in `ftforce.analyze`. They matter only for free-swinging joints, whose weight has to be
        balanced. Inertial torques are not considered.
    task, length, axes, rtol, wary :
        As in `ftforce.analyze`.

    Raises
    ------
    InputError
        A malformed value, no fault sets, or weak joints: they need torque limits, which only
        `ftforce.analyze` supports.
    FtforceError
        numba is missing.

    Examples
    --------
    >>> import ftforce
    >>> import numpy as np
    >>> arm = ftforce.load_robot("dh5")
    >>> remapper = Remapper(arm, [[2], [2, 4, 5]])
    >>> q = np.radians([10.0, 70.0, 25.0, 65.0, 0.0])
    >>> result = remapper(q, force=np.array([80.0, 50.0, 10.0]))
    >>> result.jump_norm.round(2), result.verdict
    (array([ 0.  , 43.66]), array([0, 2]))
    """

    __slots__ = ("_by_force", "_by_torque", "_question", "_result", "_sets")

    def __init__(
        self,
        robot: Robot,
        faults: FaultSets = 1,
        *,
        mode: FaultMode | str = FaultMode.LOCKED,
        gravity: ArrayLike | None = None,
        payload: Payload | float | str | tuple[float, ArrayLike] | None = None,
        friction: FrictionLike = None,
        task: str | Iterable[str] | Task = "force",
        length: float | None = None,
        axes: Axes = "tool",
        rtol: float = RTOL,
        wary: float = BORDERLINE_RTOL,
    ) -> None:
        question = Question.parse(
            robot,
            gravity=gravity,
            payload=payload,
            friction=friction,
            task=task,
            length=length,
            axes=axes,
            rtol=rtol,
            wary=wary,
        )
        self._build(question, _fault_sets(robot, faults, mode))

    def _build(self, question: Question, sets: tuple[FaultSet, ...]) -> None:
        self._question, self._sets = question, sets
        answer = _kernel()
        plan = Plan.of(question, sets, needs_gravity=any(one.free for one in sets))
        constants = _constants(plan)
        work, self._result = _workspace(plan, question.task)
        self._by_torque = partial(answer, False, *constants, *work)
        self._by_force = partial(answer, True, *constants, *work)

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self._question.robot

    @property
    def task(self) -> Task:
        """Components and axes of the forces."""
        return self._question.task

    @property
    def sets(self) -> tuple[FaultSet, ...]:
        """The fault sets, in the order of the results."""
        return self._sets

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the results at every posture."""
        has_free = any(one.free for one in self._sets)
        if has_free and self.robot.mass == 0.0:
            return ("the URDF has no masses: the weight of the arm is missing",)
        return ()

    @property
    def result(self) -> Remapped:
        """Result of the last successful call."""
        return self._result

    def __call__(
        self, q: ArrayLike, tau: ArrayLike | None = None, *, force: ArrayLike | None = None
    ) -> Remapped:
        """Remap the torques of one posture.

        Arrays of float64 are used in place. Anything else is converted first, which allocates and
        takes some microseconds.

        Parameters
        ----------
        q :
            Joint positions, rad or m, shape (n,).
        tau :
            Motor torques that exert the force at the tip, without those for weight and motion,
            N·m (N if prismatic), shape (n,): ``torque`` of `ftforce.analyze`.
        force :
            Alternatively, the force the tool exerts on its environment, N and N·m, in the task's
            axes, shape (m,).

        Returns
        -------
        :
            `result`, the same object each time.

        Raises
        ------
        InputError
            Wrong sizes, non-numeric values, NaN or infinity; both torques and a force, or neither.
            The previous result is kept.
        """
        run, given = self._by_torque, tau
        if force is not None:
            run, given = self._by_force, force
            if tau is not None:
                raise InputError("give either torques or a force, not both")
        if (
            q.__class__ is np.ndarray
            and given.__class__ is np.ndarray
            and q.dtype is _FLOAT
            and given.dtype is _FLOAT
            and q.ndim == given.ndim == 1
            and not run(q, given)
        ):
            return self._result
        return self._converted(q, tau, force)

    def _converted(self, q: ArrayLike, tau: ArrayLike | None, force: ArrayLike | None) -> Remapped:
        """Convert the arguments to arrays and try again, with clear errors for invalid ones."""
        q = self.robot.vector(q, "q")
        if force is not None:
            is_malformed = self._by_force(q, self.task.vector(force, "force"))
        elif tau is not None:
            is_malformed = self._by_torque(q, self.robot.vector(tau, "tau"))
        else:
            raise InputError("give torques or a force")
        if is_malformed:
            raise InputError("the posture, torques or force hold numbers too large to compute with")
        return self._result

    def __repr__(self) -> str:
        """Return the robot, the task and the number of sets."""
        return f"<Remapper {self.robot.name!r}: {self.task}, {len(self._sets)} fault sets>"

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy and pickle the question and the sets only: workspaces are never shared."""
        return _rebuilt, (self._question, self._sets)


def _rebuilt(question: Question, sets: tuple[FaultSet, ...]) -> Remapper:
    remapper = Remapper.__new__(Remapper)
    remapper._build(question, sets)
    return remapper


def _kernel() -> Any:
    try:
        from ftforce.batch.kernels.single import answer
    except ImportError as problem:
        if problem.name != "numba":
            raise
        raise FtforceError(
            "a Remapper needs numba: install the extra with pip install 'ftforce[sweep]'"
        ) from None
    return answer


def _fault_sets(robot: Robot, faults: FaultSets, mode: FaultMode | str) -> tuple[FaultSet, ...]:
    if isinstance(faults, (int, np.integer)):  # True too, which is rejected below
        return tuple(AllFaultSets.parse(robot, faults, mode))
    if isinstance(faults, FaultSet):
        faults = [faults]
    if isinstance(faults, str) or not isinstance(faults, Iterable):
        raise InputError(
            f"faults needs a number, or a list of sets such as [[2], [2, 4]], got {faults!r}"
        )
    how = single_mode(mode)
    sets = tuple(
        one if isinstance(one, FaultSet) else FaultSet.all_of(how, robot.indices(one))
        for one in faults
    )
    if not sets:
        raise InputError("faults needs at least one set")
    for one in sets:
        if one.in_mode(FaultMode.WEAK):
            raise InputError(
                f"the set {one} has weak joints, which need torque limits; use analyze"
            )
    return sets


def _constants(plan: Plan) -> tuple[NDArray[Any], ...]:
    """Return ``tree``, ``body``, ``task``, ``locked`` and ``free`` of `single.answer`."""
    from ftforce.batch.kernels import single

    mechanism, faults, question = plan.mechanism, plan.faults, plan.question
    E, m, n = len(mechanism.parent), len(question.rows), plan.n
    tree = np.zeros((E + 1, 4), dtype=np.int64)
    tree[:E] = np.column_stack(
        [mechanism.parent, mechanism.driver, mechanism.is_prismatic, mechanism.moves_tip]
    )
    tree[E, :3] = mechanism.tip_parent, question.in_tool, question.needs_gravity
    body = np.zeros((E + 1, single.BODY))
    frames = [mechanism.placement, mechanism.ratio, mechanism.offset]
    body[:E] = np.column_stack([*frames, mechanism.mass, mechanism.centre])
    body[E, :15] = np.concatenate([mechanism.tip, mechanism.gravity])
    task = np.zeros((5, max(m, n, 2)))
    task[0, :m], task[1, :m], task[3, :m] = question.rows, question.weights, question.floor
    task[2, :2], task[4, :n] = (question.rtol, question.wary), question.friction
    failed = np.zeros((-(-len(faults.locked) // single.SET_LANES), n, single.SET_LANES))
    for at, locked in enumerate(faults.locked):
        failed[at // single.SET_LANES, :, at % single.SET_LANES] = locked
    return tree, body, task, faults.locked.copy(), faults.free.copy(), failed


def _workspace(plan: Plan, task: Task) -> tuple[tuple[NDArray[Any], ...], Remapped]:
    """Return the output arrays of `single.answer`, and the views of them that are the result."""
    from ftforce.batch.kernels import single

    m, n, sets = task.m, plan.n, len(plan.faults.locked)
    square = np.zeros((single.SQUARES, m, m))
    square[0] = np.eye(m)  # in its own left singular basis, the left vectors of J are unit vectors
    torque = np.full((single.TORQUES + sets, n), np.nan)
    torque[0] = 0.0  # gravity torques, unless the kernel computes them
    force = np.full((1 + 2 * sets, m), np.nan)
    number = np.full((4, sets), np.nan)
    code = np.full((3, max(sets, 2)), len(VERDICTS), dtype=np.int64)
    work = (
        np.zeros((len(plan.mechanism.parent) + 1, single.FRAME)),
        np.zeros((single.MATRICES, m, n)),
        square,
        np.zeros((single.VECTORS, m)),
        np.zeros((m, m, single.SET_LANES)),
        np.zeros((single.LINES, single.SET_LANES)),
        *(torque, force, number, code),
    )
    return work, Remapped(
        U=_view(torque[single.TORQUES :]),
        self_motion=_view(torque[single.TORQUES - 1]),
        force_before=_view(force[0]),
        force_after=_view(force[1 : 1 + sets]),
        jump=_view(force[1 + sets :]),
        jump_norm=_view(number[2]) if task.force_rows else None,
        moment_jump_norm=_view(number[3]) if task.moment_rows else None,
        margin=_view(number[0]),
        sigma_min=_view(number[1]),
        rank_lost=_view(code[1, :sets]),
        verdict=_view(code[0, :sets]),
    )


def _view(array: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only view."""
    return read_only(array.view())
