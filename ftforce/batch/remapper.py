"""Torque remap for control loops: fault sets fixed in advance, microseconds per posture."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from os import PathLike
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from ftforce.analysis.limits_files import choose_limits
from ftforce.analysis.question import AllFaultSets, Question, limits_for, single_mode
from ftforce.analysis.warnings import unjudged
from ftforce.batch.compiled import announced
from ftforce.batch.plan import Plan, faults_of
from ftforce.core.arrays import Matrix, Vector, as_floats, as_vector, check_finite, read_only
from ftforce.core.faults import FaultMode, FaultSet
from ftforce.core.limits import Limits, middle_and_half
from ftforce.core.reduced_jacobian import BORDERLINE_RTOL, RTOL, check_tolerances
from ftforce.core.verdict import CODES, VERDICTS, Verdict
from ftforce.errors import DimensionError, FtforceError, InputError
from ftforce.robot.robot import require_robot

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from ftforce.analysis.conditions import PayloadLike
    from ftforce.analysis.fault_names import Joints
    from ftforce.analysis.friction import FrictionLike
    from ftforce.analysis.limits_files import LimitsLike
    from ftforce.batch.kernels.layout import Faults, Integers
    from ftforce.core.task import Axes, Task
    from ftforce.robot.robot import Robot

FaultSets: TypeAlias = "int | FaultSet | Iterable[FaultSet | Joints]"

_FLOAT = np.dtype(np.float64)
_USUAL = {"task": "force", "axes": "tool"}  # defaults of arguments that need a robot


class JacobianQuestion(NamedTuple):
    """What is asked about an arm of which only Jacobians are known.

    Attributes
    ----------
    m, n :
        Numbers of task rows and of joints.
    limits :
        Torque limits; ``None`` if none are in force.
    friction :
        Friction of each joint, NaN where it follows from the weight, shape (n,).
    rtol, wary :
        Rank tolerance, and the largest tolerance considered for a borderline verdict.
    """

    m: int
    n: int
    limits: Limits | None
    friction: Vector
    rtol: float
    wary: float

    @classmethod
    def parse(
        cls,
        m: object,
        n: object,
        *,
        limits: object,
        friction: object,
        rtol: float,
        wary: float,
        **robot_only: object,
    ) -> JacobianQuestion:
        """Return the question that the arguments of `Remapper` ask without a robot.

        Parameters
        ----------
        m, n, limits, friction, rtol, wary :
            As in `Remapper`.
        **robot_only :
            What only a robot can have; ``None`` or its default.

        Raises
        ------
        InputError
            An argument is invalid, or needs a robot.
        """
        for name, size in (("m", m), ("n", n)):
            is_integer = isinstance(size, (int, np.integer)) and not isinstance(size, bool)
            if not is_integer or not size >= 1:  # type: ignore[operator] # an integer
                raise InputError(
                    "a Remapper needs a robot, or the shape of the Jacobians it will be called "
                    f"with, Remapper(m=3, n=7, faults=...); got {name}={size!r}"
                )
        for name, value in robot_only.items():
            if value is not None and not (isinstance(value, str) and value == _USUAL.get(name)):
                raise InputError(
                    f"{name} needs a robot; without one the Jacobian says what the task is, and "
                    "its rows (and columns) are weighted by you, see docs/guides/array-core"
                )
        check_tolerances(rtol, wary)
        count = int(n)  # type: ignore[call-overload] # an integer
        return cls(
            int(m),  # type: ignore[call-overload] # an integer
            count,
            _given_limits(limits, count),
            _given_friction(friction, count),
            rtol,
            wary,
        )

    def __str__(self) -> str:
        """Return the shape of the Jacobians."""
        return f"Jacobians of shape ({self.m}, {self.n})"


def _given_limits(limits: object, n: int) -> Limits | None:
    """Return torque limits from an array, or as they are."""
    if limits is None:
        return None
    if isinstance(limits, (str, PathLike)):
        raise InputError(
            "without a robot, limits are numbers, one per column of J, or "
            f"ftforce.core.limits.Limits, got {limits!r}"
        )
    known = limits if isinstance(limits, Limits) else Limits.of(limits)  # type: ignore[arg-type]
    if len(known.effort) != n:
        raise DimensionError("limits", (n,), known.effort.shape, "one per column of J")
    return _without_lines(known)


def _without_lines(limits: Limits | None) -> Limits | None:
    """Return limits that do not depend on velocities, which a remapper does not know.

    Raises
    ------
    InputError
        They have torque-speed lines.
    """
    if limits is not None and limits.line is not None:
        raise InputError(
            "a Remapper has no velocities for torque-speed lines (stall_torque, no_load_speed); "
            "give limits without them, or use analyze"
        )
    return limits


def _given_friction(friction: object, n: int) -> Vector:
    """Return the friction of each joint: ideal joints, one number for all, or one for each."""
    values = as_floats(0.0 if friction is None else friction, "friction")  # type: ignore[arg-type]
    if values.ndim == 0:
        values = np.full(n, float(values))
    if values.shape != (n,):
        raise DimensionError("friction", (n,), values.shape, "one per column of J")
    if (values < 0.0).any() or np.isinf(values).any():
        raise InputError(f"friction must not be negative or infinite, got {values.tolist()}")
    return read_only(values)


class Remapped(NamedTuple):
    """Result of `Remapper` for S fault sets, in arrays that its next call overwrites.

    The arrays are read-only. Values are NaN where the arm cannot be held. ``verdicts`` has the
    verdicts as `ftforce.Verdict`, ``verdict`` as numbers.

    Attributes
    ----------
    U :
        Motor torques that exert the force after the remap, N·m (N if prismatic), without the
        torques for weight and motion, shape (S, n); 0 at locked joints. At a free-swinging joint
        it is the torque that balances the joint's weight, as in
        `ftforce.core.changes.TorqueChange`. With limits, ``U`` plus those torques is within them.
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
        Without a robot, the norm over all rows, in their unit.
    moment_jump_norm :
        Norm of its moment components, N·m, shape (S,); ``None`` if the task has none, and without a
        robot.
    margin :
        σ_min(K)/σ_max(J), shape (S,).
    sigma_min :
        σ_min(K) of the weighted Jacobian, m; dimensionless if a joint is prismatic, since hinges
        are then divided by the joint length, shape (S,).
    rank_lost :
        rank(J) - rank(K), shape (S,).
    verdict :
        ``verdicts`` as numbers, for arrays: index in ``ftforce.core.verdict.VERDICTS``, shape (S,);
        0 tolerated, 1 borderline, 2 not tolerated.
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
        """Verdict of each set, a `ftforce.Verdict`; a tuple that the next call leaves as it is."""
        return tuple([VERDICTS[code] for code in self.verdict.tolist()])

    def verdict_of(self, row: int) -> Verdict:
        """Return the verdict of one set, without making a list of all.

        Parameters
        ----------
        row :
            Index of the set in `Remapper.sets`.
        """
        verdict: Verdict = VERDICTS[self.verdict[row]]
        return verdict

    def copy(self) -> Remapped:
        """Return a copy that later calls do not overwrite."""
        kept = (None if array is None else read_only(array.copy()) for array in self)
        return Remapped(*kept)  # type: ignore[arg-type] # ``None`` fields stay ``None``


class Remapper:
    """Remap torques after faults fixed in advance, with the results of `ftforce.analyze`.

    Everything except the posture and the torques is checked and converted once, on construction.
    A call takes microseconds and allocates no memory; its result is overwritten by the next call.
    A remapper is not thread-safe: give each thread its own, for instance by ``copy.copy``.

    Without a robot, ``Remapper(m=3, n=7, faults=...)`` is called with Jacobians of any library,
    ``remapper(J, tau)``, and has the results of `ftforce.remap` and
    `ftforce.core.bounded_remap.bounded_remap`.

    Requires numba, from the extra ``sweep``. The first remapper of its kind on a machine waits for
    compilation, some ten seconds.

    Parameters
    ----------
    robot :
        The arm; ``None`` if Jacobians will be given.
    faults :
        Largest number of joints that fail together, for all sets up to that size; or the sets
        themselves: joints by number (from 1) or name, masks of shape (n,), or `ftforce.FaultSet`
        for sets that mix modes.
    m, n :
        Without a robot, the shape of the Jacobians.
    mode :
        Fault mode of joints not given in a `ftforce.FaultSet`: ``locked`` or ``free``.
    limits :
        Torque limits, as in `ftforce.analyze`: by default none, except those of the URDF for sets
        with weak joints. Without a robot, `ftforce.core.limits.Limits` or the largest torque of
        each motor, NaN where unknown, shape (n,).
    gravity, payload :
        As in `ftforce.analyze`. They matter only for limits and for free-swinging joints, whose
        weight has to be balanced. Inertial torques are not considered.
    friction :
        As in `ftforce.analyze`; without a robot one number, or one per joint, and by default 0.
    task, length, joint_length, axes, rtol, wary :
        As in `ftforce.analyze`; the first four only with a robot.

    Raises
    ------
    InputError
        A malformed value, no fault sets, or weak joints of which no limits are known.
    LimitsError
        The file of limits or friction cannot be read or does not fit the robot.
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
    >>> result.jump_norm.round(2), [verdict.value for verdict in result.verdicts]
    (array([ 0.  , 43.66]), ['tolerated', 'not tolerated'])

    With the Jacobian of another library:

    >>> J = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0]])
    >>> remapper = Remapper(m=2, n=3, faults=[[2], [2, 3]], limits=[6.0, np.nan, 9.0])
    >>> remapper(J, tau=J.T @ [10.0, 5.0]).force_after.round(12)
    array([[6., 5.],
           [6., 0.]])
    """

    __slots__ = ("_at_rest", "_by_force", "_by_torque", "_question", "_result", "_sets")
    _question: Question | JacobianQuestion

    def __init__(
        self,
        robot: Robot | None = None,
        faults: FaultSets = 1,
        *,
        m: int | None = None,
        n: int | None = None,
        mode: FaultMode | str = FaultMode.LOCKED,
        limits: LimitsLike | ArrayLike = None,
        gravity: ArrayLike | None = None,
        payload: PayloadLike = None,
        friction: FrictionLike = None,
        task: str | Iterable[str] | Task = "force",
        length: float | None = None,
        joint_length: float | None = None,
        axes: Axes = "tool",
        rtol: float = RTOL,
        wary: float = BORDERLINE_RTOL,
    ) -> None:
        if robot is None and m is None and n is None:
            require_robot(robot)
        if robot is None:
            own = JacobianQuestion.parse(
                m, n, limits=limits, friction=friction, rtol=rtol, wary=wary, gravity=gravity,
                payload=payload, task=task, length=length, joint_length=joint_length, axes=axes,
            )  # fmt: skip
            self._build(own, _fault_sets(None, own.n, faults, mode))
            return
        require_robot(robot)
        if m is not None or n is not None:
            raise InputError(
                "m and n describe Jacobians; with a robot they follow from task and arm"
            )
        question = Question.parse(
            robot,
            gravity=gravity,
            payload=payload,
            limits=limits,  # type: ignore[arg-type] # which is checked
            friction=friction,
            task=task,
            length=length,
            joint_length=joint_length,
            axes=axes,
            rtol=rtol,
            wary=wary,
        )
        self._build(question, _fault_sets(robot, robot.n, faults, mode))

    def _build(self, question: Question | JacobianQuestion, sets: tuple[FaultSet, ...]) -> None:
        self._question, self._sets = question, sets
        compiled = _kernels()
        is_robot = isinstance(question, Question)
        if isinstance(question, Question):
            arm = _arm_of_robot(question, sets)
        else:
            arm = _arm_of_jacobian(question, sets)
        has_limits = arm.limit is not None
        kind = f"remapper{'' if is_robot else '-jacobian'}{'-limits' if has_limits else ''}"
        with announced(kind, "kernel of remappers of this kind", 13.0 if has_limits else 7.0):
            answer = compiled(not is_robot, has_limits)
        work, self._result, torques = _workspace(arm)
        constants = (*arm.place, arm.task, *_sets(arm))
        no_jacobian = (None, None) if is_robot else ()
        self._by_torque = partial(answer, False, *constants, *work, *no_jacobian)
        self._by_force = partial(answer, True, *constants, *work, *no_jacobian)
        self._at_rest = None if is_robot else read_only(np.zeros(arm.n))
        if arm.weights is not None:
            scaling = _Scaling(arm.weights, torques, np.empty(arm.n))
            self._by_torque = partial(scaling.by_torque, self._by_torque)
            self._by_force = partial(scaling.by_force, self._by_force)

    @property
    def robot(self) -> Robot | None:
        """The arm; ``None`` if Jacobians are given."""
        return self._question.robot if isinstance(self._question, Question) else None

    @property
    def task(self) -> Task | None:
        """Components and axes of the forces; ``None`` if Jacobians are given."""
        return self._question.task if isinstance(self._question, Question) else None

    @property
    def sets(self) -> tuple[FaultSet, ...]:
        """The fault sets, in the order of the results."""
        return self._sets

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the results at every posture."""
        question = self._question
        if not isinstance(question, Question):
            return ()
        found: dict[str, None] = {}
        needs_weight = question.limits is not None
        for one in self._sets:
            needs_weight |= bool(one.free or one.in_mode(FaultMode.WEAK))
            limits = choose_limits(question.robot, limits_for(one, question.limits))
            found |= dict.fromkeys(unjudged(question.robot, one, limits))
        if needs_weight and question.robot.mass == 0.0:
            return ("the URDF has no masses: the weight of the arm is missing", *found)
        return tuple(found)

    @property
    def result(self) -> Remapped:
        """Result of the last successful call; before the first one, NaN and *not tolerated*."""
        return self._result

    def __call__(
        self,
        q: ArrayLike,
        tau: ArrayLike | None = None,
        *,
        force: ArrayLike | None = None,
        rnea: ArrayLike | None = None,
    ) -> Remapped:
        """Remap the torques of one posture.

        Arrays of float64 are used in place. Anything else is converted first, which allocates and
        takes some microseconds.

        Parameters
        ----------
        q :
            Joint positions, rad or m, shape (n,); or, without a robot, the Jacobian J of the task
            at the tip, its rows in one unit or weighted, shape (m, n).
        tau :
            Motor torques that exert the force at the tip, without those for weight and motion,
            N·m (N if prismatic), shape (n,): ``torque`` of `ftforce.analyze`.
        force :
            Alternatively, the force the tool exerts on its environment, N and N·m, in the task's
            axes, shape (m,); without a robot weighted, as J is.
        rnea :
            Without a robot, the torques for weight and motion, shape (n,); 0 by default. They
            matter only for limits and free-swinging joints.

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
        if self._at_rest is not None:
            return self._of_jacobian(q, run, given, self._at_rest if rnea is None else rnea)
        if (
            q.__class__ is np.ndarray
            and given.__class__ is np.ndarray
            and q.dtype is _FLOAT
            and given.dtype is _FLOAT
            and q.ndim == given.ndim == 1
            and rnea is None
            and not run(q, given)
        ):
            return self._result
        return self._converted(q, tau, force, rnea)

    def _of_jacobian(self, J: Any, run: Any, given: Any, rnea: Any) -> Remapped:
        """Run the kernel with a Jacobian."""
        if (
            J.__class__ is np.ndarray
            and given.__class__ is np.ndarray
            and rnea.__class__ is np.ndarray
            and J.dtype is _FLOAT
            and given.dtype is _FLOAT
            and rnea.dtype is _FLOAT
            and J.ndim == 2
            and given.ndim == rnea.ndim == 1
            and not run(rnea, J, None, given)
        ):
            return self._result
        if given is None:
            raise InputError("give torques or a force")
        question = self._question
        assert isinstance(question, JacobianQuestion)
        m, n = question.m, question.n
        matrix = as_floats(J, "J")
        if matrix.shape != (m, n):
            raise DimensionError("J", (m, n), matrix.shape, "one column per joint")
        check_finite(matrix, "J")
        load = as_vector(rnea, n, "rnea", "one per column of J")
        if run is self._by_force:
            vector = as_vector(given, m, "force", "one per row of J")
        else:
            vector = as_vector(given, n, "tau", "one torque per column of J")
        if run(load, matrix, None, vector):
            raise InputError(
                "the Jacobian, torques or force hold numbers too large to compute with"
            )
        return self._result

    def _converted(
        self, q: ArrayLike, tau: ArrayLike | None, force: ArrayLike | None, rnea: ArrayLike | None
    ) -> Remapped:
        """Convert the arguments to arrays and try again, with clear errors for invalid ones."""
        question = self._question
        assert isinstance(question, Question)
        if rnea is not None:
            raise InputError(
                "rnea goes with a Jacobian, Remapper(m=..., n=...); the weight of a robot is known"
            )
        q = question.robot.vector(q, "q")
        if force is not None:
            is_malformed = self._by_force(q, question.task.vector(force, "force"))
        elif tau is not None:
            is_malformed = self._by_torque(q, question.robot.vector(tau, "tau"))
        else:
            raise InputError("give torques or a force")
        if is_malformed:
            raise InputError("the posture, torques or force hold numbers too large to compute with")
        return self._result

    def __repr__(self) -> str:
        """Return the robot, the task and the number of sets."""
        question = self._question
        what = str(question)
        if isinstance(question, Question):
            what = f"{question.robot.name!r}: {question.task}"
        return f"<Remapper {what}, {len(self._sets)} fault sets>"

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy and pickle the question and the sets only: workspaces are never shared."""
        return _rebuilt, (self._question, self._sets)


def _rebuilt(question: Question | JacobianQuestion, sets: tuple[FaultSet, ...]) -> Remapper:
    remapper = Remapper.__new__(Remapper)
    remapper._build(question, sets)
    return remapper


def _kernels() -> Any:
    try:
        from ftforce.batch.kernels.single import compiled
    except ImportError as problem:
        if problem.name != "numba":
            raise
        raise FtforceError(
            "a Remapper needs numba: install the extra with pip install 'ftforce[sweep]'"
        ) from None
    return compiled


def _fault_sets(
    robot: Robot | None, n: int, faults: FaultSets, mode: FaultMode | str
) -> tuple[FaultSet, ...]:
    if isinstance(faults, (int, np.integer)):  # True too, which is rejected below
        every = AllFaultSets.of(n, faults, mode) if robot is None else None
        return tuple(every or AllFaultSets.parse(robot, faults, mode))  # type: ignore[arg-type]
    if isinstance(faults, FaultSet):
        faults = [faults]
    if isinstance(faults, str) or not isinstance(faults, Iterable):
        raise InputError(
            f"faults needs a number, or a list of sets such as [[2], [2, 4]], got {faults!r}"
        )
    how, indices = single_mode(mode), partial(_columns, n) if robot is None else robot.indices
    sets = tuple(
        one if isinstance(one, FaultSet) else FaultSet.all_of(how, indices(one)) for one in faults
    )
    if not sets:
        raise InputError("faults needs at least one set")
    return sets


def _columns(n: int, joints: Any) -> tuple[int, ...]:
    """Return the indices of columns given by numbers from 1, or by a mask.

    Raises
    ------
    InputError
        A joint is given by its name, or does not exist.
    """
    given = (
        list(joints) if isinstance(joints, Iterable) and not isinstance(joints, str) else [joints]
    )
    if given and all(isinstance(joint, (bool, np.bool_)) for joint in given):
        if len(given) != n:
            raise InputError(f"a joint mask needs {n} entries, one per joint, got {len(given)}")
        return tuple(i for i, failed in enumerate(given) if failed)
    for joint in given:
        is_number = isinstance(joint, (int, np.integer)) and not isinstance(joint, bool)
        if not is_number or not 1 <= joint <= n:
            raise InputError(
                f"the columns of a Jacobian are numbered from 1 to {n} and have no names, "
                f"got joint {joint!r}"
            )
    return tuple(int(joint) - 1 for joint in given)


class _Arm(NamedTuple):
    """What the kernel has to know in advance.

    Attributes
    ----------
    m, n, joints :
        Numbers of task rows, of joints of the chain, and of the whole tree.
    place, task :
        Arguments ``tree``, ``body`` and ``task`` of `single.answer`.
    faults :
        The fault sets.
    limit :
        Weighted torque limits with each set, and their middles, shape (2 S, n); ``None`` if all
        sets only lock joints, without limits.
    has_forces, has_moments :
        Whether there are such rows.
    weights :
        Weights of hinges against slides, shape (n,), or ``None``.
    """

    m: int
    n: int
    joints: int
    place: tuple[NDArray[Any] | None, ...]
    task: Matrix
    faults: Faults
    limit: Matrix | None
    has_forces: bool
    has_moments: bool
    weights: Vector | None


def _arm_of_jacobian(asked: JacobianQuestion, sets: tuple[FaultSet, ...]) -> _Arm:
    """Return an arm of which only Jacobians are known.

    Raises
    ------
    InputError
        A joint is weak, and its torque limit is unknown.
    """
    m, n, limits = asked.m, asked.n, asked.limits
    faults = faults_of(sets, n)
    for one in sets:
        weak = set(one.in_mode(FaultMode.WEAK)) - set(_freed(one))
        if any(limits is None or not limits.is_known[joint] for joint in weak):
            raise InputError(f"the set {one} has weak joints, which need torque limits: limits=...")
    task = np.zeros((4 + n, max(m, n, 2)))
    task[1], task[2, :2], task[3, :n] = 1.0, (asked.rtol, asked.wary), asked.friction
    limit = None
    if limits is not None or faults.free.any():
        rows = [None if limits is None else limits.largest_torques(one) for one in sets]
        limit = _limit_rows(rows, n)
    return _Arm(m, n, 0, (None, None), task, faults, limit, True, False, None)


def _freed(one: FaultSet) -> tuple[int, ...]:
    """Return the weak joints of a set that have no torque left."""
    weak = one.in_mode(FaultMode.WEAK)
    return tuple(joint for joint in one.free if joint in weak)


def _limit_rows(limits: list[Vector | None], n: int) -> Matrix:
    """Return the half width of limits as S rows, NaN where there are none, then their S middles."""
    pairs = [middle_and_half(np.full(n, np.nan) if row is None else row) for row in limits]
    return np.array([half for _, half in pairs] + [middle for middle, _ in pairs]).reshape(-1, n)


def _arm_of_robot(question: Question, sets: tuple[FaultSet, ...]) -> _Arm:
    """Return a robot."""
    from ftforce.batch.kernels import single

    robot, scale = question.robot, question.scale
    _without_lines(question.limits)
    limits = [choose_limits(robot, limits_for(one, question.limits)) for one in sets]
    is_bounded = any(x is not None or one.free for x, one in zip(limits, sets, strict=True))
    plan = Plan.of(question, sets, needs_gravity=is_bounded)
    mechanism, asked = plan.mechanism, plan.question
    E, m, n = len(mechanism.parent), len(asked.rows), plan.n
    tree = np.zeros((E + 1, 4), dtype=np.int64)
    tree[:E] = np.column_stack(
        [mechanism.parent, mechanism.driver, mechanism.is_prismatic, mechanism.moves_tip]
    )
    tree[E, :2] = mechanism.tip_parent, asked.in_tool
    body = np.zeros((E + 1, single.BODY))
    frames = [mechanism.placement, mechanism.ratio, mechanism.offset]
    body[:E] = np.column_stack([*frames, mechanism.mass, mechanism.centre, mechanism.gain])
    body[E, :15] = np.concatenate([mechanism.tip, mechanism.gravity])
    task = np.zeros((4 + n, max(m, n, 2)))
    task[0, :m], task[1, :m], task[4:, :m] = asked.rows, asked.weights, asked.floor.T
    task[2, :2], task[3, :n] = (asked.rtol, asked.wary), asked.friction
    rows = [
        None if x is None else question.largest_torques(one, x)
        for x, one in zip(limits, sets, strict=True)
    ]
    limit = _limit_rows(rows, n) if is_bounded else None
    kinds = bool(question.task.force_rows), bool(question.task.moment_rows)
    return _Arm(m, n, E, (tree, body), task, plan.faults, limit, *kinds, scale.weights)


def _sets(arm: _Arm) -> tuple[NDArray[Any] | None, ...]:
    """Return ``locked``, ``free``, ``limit`` and ``failed`` of `single.answer`."""
    from ftforce.batch.kernels import single

    faults = arm.faults
    failed = np.zeros((-(-len(faults.locked) // single.SET_LANES), arm.n, single.SET_LANES))
    for at, locked in enumerate(faults.locked):
        failed[at // single.SET_LANES, :, at % single.SET_LANES] = locked
    return faults.locked.copy(), faults.free.copy(), arm.limit, failed


class _Scaling(NamedTuple):
    """Torques of the kernel, where hinges are weighed against slides (theory §2.7).

    Attributes
    ----------
    weights :
        Joint weights, shape (n,).
    outputs :
        Torques that the kernel writes, weighted, shape (1 + S, n).
    buffer :
        For the weighted torques that it reads, shape (n,).
    """

    weights: Vector
    outputs: Matrix
    buffer: Vector

    def by_torque(self, run: Any, q: Vector, torque: Vector) -> int:
        """Run the kernel with torques."""
        if torque.shape == self.buffer.shape:  # the kernel rejects other shapes
            torque = np.multiply(torque, self.weights, out=self.buffer)
        return self.by_force(run, q, torque)

    def by_force(self, run: Any, q: Vector, given: Vector) -> int:
        """Run the kernel, and unweight the torques that it writes."""
        code: int = run(q, given)
        if not code:
            np.divide(self.outputs, self.weights, out=self.outputs)
        return code


def _workspace(arm: _Arm) -> tuple[tuple[NDArray[Any] | None, ...], Remapped, NDArray[Any]]:
    """Return the output arrays of `single.answer`, and the views of them that are the result.

    The last item holds all torques of the result, τ_N and U of every set, shape (1 + S, n).
    """
    from ftforce.batch.kernels import single

    m, n, sets = arm.m, arm.n, len(arm.faults.locked)
    square = np.zeros((single.SQUARES, m, m))
    square[0] = np.eye(m)  # in its own left singular basis, the left vectors of J are unit vectors
    torque = np.full((single.TORQUES + sets, n), np.nan)
    torque[0] = 0.0  # gravity torques, unless the kernel computes them
    force = np.full((1 + 2 * sets, m), np.nan)
    number = np.full((4, sets), np.nan)
    code = np.full((3, max(sets, 2)), CODES[Verdict.NOT_TOLERATED], dtype=np.int64)
    work = (
        np.zeros((arm.joints + 1, single.FRAME)) if arm.joints else None,
        np.zeros((single.MATRICES, m, n)),
        square,
        np.zeros((single.VECTORS, m)),
        np.zeros((m, m, single.SET_LANES)),
        np.zeros((single.LINES, single.SET_LANES)),
        *(torque, force, number, code),
    )
    result = Remapped(
        U=_view(torque[single.TORQUES :]),
        self_motion=_view(torque[single.TORQUES - 1]),
        force_before=_view(force[0]),
        force_after=_view(force[1 : 1 + sets]),
        jump=_view(force[1 + sets :]),
        jump_norm=_view(number[2]) if arm.has_forces else None,
        moment_jump_norm=_view(number[3]) if arm.has_moments else None,
        margin=_view(number[0]),
        sigma_min=_view(number[1]),
        rank_lost=_view(code[1, :sets]),
        verdict=_view(code[0, :sets]),
    )
    return work, result, torque[single.TORQUES - 1 :]


def _view(array: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only view."""
    return read_only(array.view())
