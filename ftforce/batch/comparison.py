"""Compare arms: the same question, over equally many postures within each arm's limits."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from ftforce.analysis.question import HEALTHY, AllFaultSets, Question, check_progress
from ftforce.batch.arm_report import ArmReport, arm_report, capability_of
from ftforce.batch.compiled import compile_kernels, with_faster_evaluator
from ftforce.batch.job import PIECE, Job
from ftforce.batch.plan import Plan
from ftforce.batch.result import Sweep, SweepSetting
from ftforce.batch.runner import InThreads, threads_of
from ftforce.batch.sparing import sparing
from ftforce.batch.summary.bins import Bins, Workspace
from ftforce.batch.sweep import request_of, run_request, sweep_question
from ftforce.core.arrays import is_number
from ftforce.core.display import Displayed
from ftforce.core.faults import FaultMode
from ftforce.core.joint_scale import DEFAULT_JOINT_LENGTH
from ftforce.core.ranks import ranks_of_intervals
from ftforce.errors import InputError, listed, printable
from ftforce.io.text import is_folder
from ftforce.robot.kinematics import reach_bound
from ftforce.robot.robot import Robot

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from numpy.typing import ArrayLike

    from ftforce.analysis.conditions import PayloadLike
    from ftforce.analysis.friction import FrictionLike
    from ftforce.analysis.limits_files import LimitsLike
    from ftforce.analysis.question import Progress
    from ftforce.batch.postures.drawn import Drawn
    from ftforce.batch.store.store import SweepRequest
    from ftforce.batch.summary.criticality import Estimate
    from ftforce.core.task import Axes, Task

Arm: TypeAlias = "Robot | Sweep | str | os.PathLike[str]"

SAMPLES = 100_000
_ENOUGH = 0.95
CELLS = 20  # across the workspace, the same number for every arm whatever its size
_ALIKE = 1.3  # the ratio of cell size to reach may differ by this factor


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Displayed):
    """Ranking of several arms.

    Attributes
    ----------
    arms :
        Best first: by the share of postures x fault sets that are tolerated, then the share of
        postures that tolerate every set, then the evenness of ρ, then the name.
    enough :
        Share of a cell's postures that must tolerate every set for the cell to survive.
    warnings :
        Reasons to doubt the ranking.
    """

    arms: tuple[ArmReport, ...]
    enough: float
    warnings: tuple[str, ...]

    @property
    def question(self) -> SweepSetting:
        """Setting of the first arm; task, axes, mode, force etc. are the same for all."""
        return self.arms[0].setting

    @property
    def best(self) -> tuple[ArmReport, ...]:
        """Arms that may be the best, given the confidence intervals."""
        return tuple(arm for arm in self.arms if arm.first == 1)

    def __getitem__(self, name: str) -> ArmReport:
        """Return the arm of this name.

        Raises
        ------
        UnknownNameError
            There is no such arm.
        """
        from ftforce.errors import UnknownNameError

        for arm in self.arms:
            if arm.name == name:
                return arm
        raise UnknownNameError("arm", name, [arm.name for arm in self.arms], "in the comparison")


class _Entry(NamedTuple):
    """A loaded arm of the comparison: a robot to sweep, or a finished sweep."""

    name: str
    hints: tuple[str, ...]
    arm: Robot | Sweep


def compare(
    arms: Iterable[Arm] | Mapping[str, Arm],
    *,
    n: float | None = None,
    method: str | None = None,
    seed: int | None = None,
    faults: int | None = None,
    mode: FaultMode | str | None = None,
    force: ArrayLike | None = None,
    direction: ArrayLike | None = None,
    limits: LimitsLike = None,
    friction: FrictionLike = None,
    gravity: ArrayLike | None = None,
    payload: PayloadLike = None,
    task: str | Iterable[str] | Task | None = None,
    length: float | None = None,
    joint_length: float | None = None,
    axes: Axes | None = None,
    rtol: float | None = None,
    wary: float | None = None,
    cell: float | None = None,
    enough: float = _ENOUGH,
    tip: str | None = None,
    base: str | None = None,
    args: Mapping[str, object] | None = None,
    package_path: str | os.PathLike[str] | Iterable[str | os.PathLike[str]] | None = None,
    srdf: str | os.PathLike[str] | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Comparison:
    """Sweep arms over equally many postures, with the same question, and rank them.

    All options except ``enough`` and ``threads`` apply to arms that are swept now. A stored sweep
    keeps its own setting, which must match.

    Parameters
    ----------
    arms :
        Two or more robots, URDF files, names of known robots, sweeps, or folders of stored sweeps.
        The keys of a mapping are the arms' names.
    n :
        Number of postures per arm, drawn within its limits; default 1e5.
    method, seed :
        How they are drawn, see `ftforce.sweep`; the seed is the same for all arms.
    faults, mode, force, direction, limits, friction, gravity, payload, task, axes, rtol, wary :
        As in `ftforce.sweep`.
    length :
        Characteristic length, m, the same for all arms: it weighs moments against forces.
    joint_length :
        Weighs slides against hinges in arms that have both, as in `ftforce.analyze`.
    cell :
        Edge length of the workspace cells, m; default a tenth of each arm's longest reach.
    enough :
        Share of a cell's postures that must tolerate every set for the cell to survive.
    tip, base, args, package_path, srdf :
        As in `ftforce.load_robot`, for all arms loaded here.
    threads :
        Number of threads; default one per processor.
    progress :
        Called with the number of postures done and the total, over all arms.

    Raises
    ------
    InputError
        Fewer than two arms, a malformed value, or sweeps with different settings; the message
        names the arm.
    FileError
        A file cannot be read.

    Examples
    --------
    >>> result = compare(["kinova", "dh5"], n=2000)
    >>> [arm.name for arm in result.arms]
    ['kinova', 'dh5']
    """
    if not (is_number(enough) and 0.0 < enough <= 1.0):
        raise InputError(f"enough is a share above 0 and up to 1, got {enough!r}")
    asked = _Asked.of(
        {"count": n, "method": method, "seed": seed},
        {"faults": faults, "mode": mode},
        {"force": force, "direction": direction, "limits": limits, "friction": friction,
         "gravity": gravity, "payload": payload, "task": task, "length": length,
         "joint_length": joint_length, "axes": axes, "rtol": rtol, "wary": wary},
        {"cell": cell},
    )  # fmt: skip
    loading = {
        "tip": tip, "base": base, "args": args, "package_path": package_path, "srdf": srdf
    }  # fmt: skip
    entries = _named(_loaded(arms, loading))
    stored = [one for one in entries if isinstance(one.arm, Sweep)]
    unused = [*asked.names, *(key for key, value in loading.items() if value is not None)]
    if len(stored) == len(entries) and unused:
        raise InputError(
            "every arm is a stored sweep with a question of its own; leave out "
            f"{', '.join('n (--samples)' if key == 'count' else key for key in unused)}"
        )
    check_progress(progress)
    reports = _Reports(asked, enough, threads, progress).of(entries)
    return Comparison(_ranked(reports), float(enough), _warnings(reports))


def _loaded(arms: Iterable[Arm] | Mapping[str, Arm], loading: dict[str, Any]) -> Any:
    if isinstance(arms, (str, os.PathLike, Robot, Sweep)):
        raise InputError("compare needs two or more arms in a list, got a single one")
    pairs = arms.items() if isinstance(arms, Mapping) else ((None, arm) for arm in arms)
    entries = [_entry(name, arm, loading) for name, arm in pairs]
    if len(entries) < 2:
        raise InputError(f"a comparison needs two arms or more, got {len(entries)}")
    return entries


def _entry(name: str | None, given: Any, loading: dict[str, Any]) -> _Entry:
    """Load an arm, and note what distinguishes it from others of the same name."""
    found, hints = given, tuple[str, ...]()
    if isinstance(given, (str, os.PathLike)):
        hints = (printable(Path(given).name), printable(given))
        found = _read(given, loading)
    if isinstance(found, Robot):
        return _Entry(name or found.name, hints or (found.tip, printable(found.path)), found)
    if isinstance(found, Sweep):
        path = found.path or found.setting.tip
        own = (printable(Path(path).name), printable(path))
        return _Entry(name or found.setting.robot, hints or own, found)
    raise InputError(
        "arms are robots, URDFs, names of known robots, sweeps or folders of stored sweeps, "
        f"got {given!r}"
    )


def _read(given: str | os.PathLike[str], loading: dict[str, Any]) -> Robot | Sweep:
    path = Path(given)
    if path.suffix == ".zarr" or (is_folder(path) and not _is_known(given)):
        from ftforce.batch.store.store import open_sweep

        sweep = open_sweep(path)
        if not sweep.summary.postures:
            raise InputError(f"{printable(path)}: no posture of this sweep is done yet")
        return sweep
    from ftforce.robot.load import load_robot

    return load_robot(given, **loading)


def _is_known(given: object) -> bool:
    from ftforce.robot.known_robots import known_robots

    return given in known_robots()


def _named(entries: Sequence[_Entry]) -> list[_Entry]:
    """Make names unique: by file name where these differ, else by number."""
    counts = Counter(one.name for one in entries)
    found = []
    for i, one in enumerate(entries):
        name = one.name
        if counts[name] > 1:
            alike = [k for k, other in enumerate(entries) if other.name == name]
            name = f"{name} {_apart([entries[k].hints for k in alike], alike.index(i))}"
        found.append(one._replace(name=name))
    return found


def _apart(hints: Sequence[tuple[str, ...]], i: int) -> str:
    for kind in zip(*hints, strict=True):
        if len(set(kind)) == len(kind):
            return f"({kind[i]})"
    return f"#{i + 1}"


class _Asked(NamedTuple):
    """The arguments that were given, `None` left out: they are parsed for each arm."""

    drawing: dict[str, Any]
    sets: dict[str, Any]
    question: dict[str, Any]
    cells: dict[str, Any]

    @classmethod
    def of(cls, *options: dict[str, Any]) -> _Asked:
        """Return those of the arguments that are not ``None``."""
        return cls(*({k: v for k, v in some.items() if v is not None} for some in options))

    @property
    def names(self) -> list[str]:
        """Names of the given arguments."""
        return [key for options in self for key in options]

    def about(self, robot: Robot) -> _Case:
        """Return the question about one arm.

        Raises
        ------
        InputError
            A malformed value, or one that does not suit the arm.
        """
        from ftforce.batch.postures.drawn import Drawn

        return _Case(
            sweep_question(robot, **self.question),
            AllFaultSets.parse(
                robot, self.sets.get("faults", 1), self.sets.get("mode", FaultMode.LOCKED)
            ),
            Drawn.of(robot, **{"count": SAMPLES} | self.drawing),
        )


class _Case(NamedTuple):
    """Question, fault sets and postures of one arm."""

    question: Question
    all_sets: AllFaultSets
    postures: Drawn


class _Reports:
    """Builds the reports of arms, sweeping those that are robots."""

    def __init__(
        self, asked: _Asked, enough: float, threads: int | None, progress: Progress | None
    ) -> None:
        self.asked, self.enough = asked, enough
        self.threads, self.progress = threads_of(threads), progress
        self.done = self.total = 0

    def of(self, entries: Sequence[_Entry]) -> list[ArmReport]:
        """Return one report per arm."""
        # Parse the question for all arms before the first sweep: most errors surface here.
        robots = {one.name: one.arm for one in entries if isinstance(one.arm, Robot)}
        cases = {name: self._case(name, robot) for name, robot in robots.items()}
        requests = {name: self._request(name, case) for name, case in cases.items()}
        settings = [(one.name, one.arm.setting) for one in entries if isinstance(one.arm, Sweep)]
        settings += [(name, request.setting) for name, request in requests.items()]
        for other in settings[1:]:
            _check_same(settings[0], other)
        _check_joint_lengths(settings)
        self.total = sum(case.postures.count for case in cases.values())
        found: list[ArmReport] = []
        for one in entries:
            swept, healthy = one.arm, None
            if isinstance(swept, Robot):
                swept, healthy = self._swept(one.name, requests[one.name], cases[one.name])
            found.append(
                arm_report(swept, one.name, enough=self.enough, healthy_capability=healthy)
            )
        return found

    def _case(self, name: str, robot: Robot) -> _Case:
        with _naming(name):
            return self.asked.about(robot)

    def _request(self, name: str, case: _Case) -> SweepRequest:
        reach = reach_bound(case.question.robot)[1]
        cell = 2.0 * reach / CELLS if 0.0 < reach < math.inf else None
        with _naming(name):
            return request_of(*case, keep="summary", cell=self.asked.cells.get("cell", cell))

    def _swept(self, name: str, request: SweepRequest, case: _Case) -> tuple[Sweep, Any]:
        before = self.done

        def progress(done: int, _: int, /) -> None:
            self.done = before + done
            if self.progress is not None:
                self.progress(self.done, self.total)

        with _naming(name):
            result = run_request(request, None, InThreads(self.threads), progress)
            healthy = healthy_capability(case.question, case.postures, self.threads)
        return result, healthy


@contextmanager
def _naming(name: str) -> Iterator[None]:
    """Prefix errors with the arm's name; file errors already name the file."""
    try:
        yield
    except InputError as problem:
        raise InputError(f"{name}: {problem}") from None


# Settings that must match: arms with different questions cannot be compared.
_QUESTION = (
    *("components", "axes", "length", "mode", "largest", "force", "limits", "direction"),
    *("gravity", "payload", "rtol", "wary"),
)
_CALLED = {"components": "task", "largest": "size of sets", "joint_length": "joint length"}


def _check_joint_lengths(settings: Sequence[tuple[str, SweepSetting]]) -> None:
    """Check that arms with hinges and slides weigh them alike.

    Raises
    ------
    InputError
        They do not.
    """
    mixed = [one for one in settings if one[1].scale.is_mixed]
    for one in mixed:
        _check_same(mixed[0], one, ("joint_length",))


def _check_same(
    one: tuple[str, SweepSetting],
    other: tuple[str, SweepSetting],
    keys: Sequence[str] = _QUESTION,
) -> None:
    """Check that two arms, by name, have the same setting.

    Raises
    ------
    InputError
        They differ; the message says in what.
    """
    differs = [
        f"{_CALLED.get(key, key)} {_in_words(a)} and {_in_words(b)}"
        for key in keys
        for a, b in [(_asked(one[1], key), _asked(other[1], key))]
        if not _is_same(a, b)
    ]
    if differs:
        raise InputError(f"{one[0]} and {other[0]} have different settings: {'; '.join(differs)}")


def _asked(setting: SweepSetting, key: str) -> Any:
    value = getattr(setting, key)
    if key == "length" and not any(name[0] == "m" for name in setting.components):
        return None  # without moments it has no effect
    if key == "limits":  # limits differ between arms; only whether they apply must match
        return "none" if value is None else "enforced"
    return value


def _is_same(a: Any, b: Any) -> bool:
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(_is_same, a, b))
    if is_number(a) and is_number(b):
        return math.isclose(a, b, rel_tol=1e-9, abs_tol=1e-12)
    return bool(a == b)


def _in_words(value: Any) -> str:
    if isinstance(value, tuple):
        return f"({', '.join(map(_in_words, value))})"
    return "none" if value is None else f"{value:g}" if is_number(value) else str(value)


def _ranked(reports: Sequence[ArmReport]) -> tuple[ArmReport, ...]:
    """Sort arms, and set the range of ranks compatible with their intervals.

    An arm certainly ranks below another if its interval lies entirely below the other's.
    """
    arms = sorted(reports, key=_rank)
    ranks = ranks_of_intervals([(arm.tolerated.low, arm.tolerated.high) for arm in arms])
    return tuple(
        replace(arm, first=rank.first, last=rank.last)
        for arm, rank in zip(arms, ranks, strict=True)
    )


def _rank(arm: ArmReport) -> tuple[float, float, float, str]:
    evenness = 0.0 if math.isnan(arm.evenness) else arm.evenness
    return (-arm.tolerated.value, -arm.every.value, -evenness, arm.name)


def _warnings(reports: Sequence[ArmReport]) -> tuple[str, ...]:
    """Return reasons to doubt the ranking, grouping arms with the same problem."""
    found = []
    weak = [f"{arm.name} at {arm.full_rank:.0%}" for arm in reports if not arm.is_whole]
    if weak:
        found.append(
            "the healthy arm lacks full rank in some postures, so its shares refer to fewer "
            f"forces; full rank: {listed(weak)} of the postures"
        )
    slides = [arm.name for arm in reports if "m" in arm.setting.joint_units]
    if slides and len({unit for arm in reports for unit in arm.setting.joint_units}) > 1:
        found.append(
            f"prismatic joints: margin, ρ and verdict equate {_joint_length(reports):g} m of "
            f"travel with 1 rad of rotation: {listed(slides)}"
        )
    unknown = [
        f"{arm.name} ({listed(arm.setting.unknown_limits, 3)})"
        for arm in reports
        if arm.setting.unknown_limits
    ]
    if unknown:
        found.append(f"unknown effort limits are not enforced: {listed(unknown)}")
    found += [f"{arm.name}: {words}" for arm in reports for words in arm.setting.implausible]
    return (*found, *_posture_warnings(reports))


def _joint_length(reports: Sequence[ArmReport]) -> float:
    """Return the joint length of the arms that have hinges and slides."""
    lengths = (arm.setting.scale.effective_length for arm in reports)
    return next((length for length in lengths if length is not None), DEFAULT_JOINT_LENGTH)


def _posture_warnings(reports: Sequence[ArmReport]) -> list[str]:
    found = []
    given = [arm.name for arm in reports if not arm.setting.is_random]
    if given:
        found.append(f"postures not drawn at random within the joint limits: {listed(given)}")
    unfinished = [arm.name for arm in reports if arm.postures < arm.setting.count]
    if unfinished:
        found.append(f"unfinished sweeps: {listed(unfinished)}")
    counts = [f"{arm.postures:,} of {arm.name}" for arm in reports]
    if len({arm.postures for arm in reports}) > 1:
        found.append(f"different numbers of postures: {listed(counts)}")
    cells = [arm.workspace.cell / arm.workspace.reach for arm in reports if arm.workspace.reach]
    if cells and max(cells) > _ALIKE * min(cells):
        found.append(
            "cell sizes differ relative to the reach: shares of the workspace are only roughly "
            "comparable"
        )
    return found


_ANYWHERE = Workspace((0.0, 0.0, 0.0), 1.0, (1, 1, 1))


def healthy_capability(
    question: Question, postures: Drawn, threads: int
) -> tuple[Estimate, Estimate] | None:
    """Return 5 % and 50 % quantiles of the capability, N (N·m); ``None`` without a direction.

    Parameters
    ----------
    question, postures :
        Question and postures of the sweep.
    threads :
        Number of threads.
    """
    from concurrent.futures import ThreadPoolExecutor

    if question.direction is None:
        return None
    plan = Plan.of(replace(question, force=None), (HEALTHY,), needs_gravity=True)
    job = Job(plan, postures, Bins(direction=True), _ANYWHERE, "summary", 4 * PIECE)
    job = sparing(with_faster_evaluator(job))
    compile_kernels(job)
    summary = job.empty_summary()
    with ThreadPoolExecutor(threads) as pool:
        for part, _ in pool.map(job.run, range(job.chunks)):
            summary.merge(part)
    return capability_of(summary)
