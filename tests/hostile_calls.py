"""Random calls of the public functions: usual, extreme and malformed values.

A call is drawn from its number alone, so that one can be repeated. Its parameters are those of the
signature; what each may get is listed here by name.
"""

from __future__ import annotations

import functools
import inspect
import math
import random
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pinocchio as pin

import ftforce
from ftforce.analysis.paper import replicate
from ftforce.batch.postures import Grid
from ftforce.batch.workspace_map import workspace_map
from ftforce.core.bounded_remap import bounded_remap
from ftforce.core.limits import Limits
from ftforce.planning.objective import MEASURES
from ftforce.robot.dynamics import Payload
from ftforce.robot.formats.dh import DHRow, MassModel
from ftforce.robot.kinematics import tip_pose
from ftforce.robot.posture import choose_posture
from ftforce.trajectory import Path as TipPath
from ftforce.trajectory import Recording
from helpers import SLIDING, load_text, serial_urdf

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

EXTREME = (
    *(0.0, -0.0, 5e-324, 1e-308, 1e-200, 1e-100, 1e-30, 1e-15, 1e-9, 1e-6, 1.0, 1e3, 1e6, 1e9),
    *(1.1e9, 1e12, 1e50, 1e100, 1e150, 1e155, 1e200, 1.7e308, math.inf, -math.inf, math.nan),
)
MALFORMED = (
    *("", "x", "nan", "1,2", "1e400", "\x00", "é", b"1", True, None, 10**400, 1j, Fraction(1, 3)),
    *((), [], [[]], [None], [[1.0], [2.0, 3.0]], ["1", "2", "3"], {}, {"a": 1}, object(), print),
    *(np.zeros((2, 2)), np.array(["a"]), np.array([1, None], dtype=object), np.bool_(True)),
    *(np.zeros(0), np.float32(2.5), np.int64(3), range(3), float, slice(None)),
)


class Chance(random.Random):
    """The source of the arguments of one call.

    Attributes
    ----------
    robot, folder :
        The arm of the call, and where it may write.
    odd :
        Share of the values that are extreme or wrong; 0 in half of the calls.
    """

    robot: Any
    folder: Path
    odd: float

    def one(self, *usual: Any, odd: tuple[Any, ...] = ()) -> Any:
        """Return a usual value or an odd one."""
        return self.choice(odd if odd and self.random() < self.odd else usual)

    def number(self, scale: float = 1.0) -> float:
        """Return a normal number, or an extreme one."""
        if self.random() < self.odd:
            return self.choice(EXTREME) * self.choice((1.0, 1.0, -1.0))
        return self.gauss(0.0, scale)

    def size(self, *usual: Any, scale: float) -> Any:
        """Return a usual value, or a number that should be positive."""
        return abs(self.number(scale)) if self.random() < max(self.odd, 0.1) else self.one(*usual)

    def vector(self, size: int, scale: float = 1.0) -> Any:
        """Return a vector, as an array or a list, of whole numbers or of one number throughout."""
        size += self.one(0, odd=(-1, 1))
        kind = self.random()
        if kind < 0.1:
            return [self.choice((-2, -1, 0, 1, 2)) for _ in range(size)]
        if kind < 0.2:
            return np.full(size, self.number(scale))
        values = [self.number(scale) for _ in range(size)]
        return values if kind < 0.4 else np.array(values)

    def joints(self) -> Any:
        """Return some joints of the arm, in one of the ways to say which."""
        n = self.robot.n
        chosen = self.sample(range(1, n + 1), min(n, self.choice((0, 1, 1, 1, 2, 3, n))))
        names = [self.robot.names[i - 1] for i in chosen]
        wrong = (0, n + 1, -1, "nobody", [1, 1], "1,,2", 2.0, "1;2", [[1]])
        return self.one(chosen, ",".join(map(str, chosen)) or (), names, odd=wrong)

    def maybe(self, value: Any, share: float = 0.5) -> Any:
        """Return a value in a share of the cases, else ``None``."""
        return value if self.random() < share else None


@functools.cache
def robots() -> tuple[Any, ...]:
    """Return arms of one to seven joints, slides among them."""
    y = {"axis": (0, 1, 0), "xyz": (0.4, 0, 0)}
    texts = (SLIDING, serial_urdf(("revolute", y)), serial_urdf(*[("revolute", y)] * 3))
    known = map(ftforce.load_robot, ("dh5", "dh5", "panda", "ur5", "tiago"))
    return (*known, *map(load_text, texts))


@functools.cache
def models() -> tuple[Any, ...]:
    """Return Pinocchio models: an arm, and one with a free-flyer and several limbs."""
    return pin.buildSampleModelManipulator(), pin.buildSampleModelHumanoidRandom()


@functools.cache
def results() -> tuple[Any, ...]:
    """Return results to be written; the last three are sweeps."""
    arm = ftforce.load_robot("dh5")
    line = _line(arm, (0.0, 0.02, 0.0), 0.2)
    return (
        *(arm, 3, None, "x", replicate()),
        ftforce.analyze(arm, force=[1, 2, 3], locked=2),
        ftforce.census(arm, force=[1, 2, 3]),
        ftforce.capability(arm, locked=2),
        ftforce.remap(np.eye(3, 4), [1, 2, 3, 4], [True, False, False, False]),
        ftforce.simulate(arm, line, force=[1, 2, 3], faults="2@0.05", rate=50),
        ftforce.timeline(arm, line, force=[1, 2, 3], rate=20),
        ftforce.compare([arm, "panda"], n=64),
        ftforce.sweep(arm, n=64, mode="free", faults=2),
        ftforce.sweep(arm, n=64, force=[1, 2, 3], limits="urdf"),
        ftforce.sweep(arm, n=64),
    )


def _line(arm: Any, change: Any, speed: float) -> TipPath:
    start = tip_pose(arm, choose_posture(arm).q)[1]
    return TipPath.through([start, start + change], speed=speed)


def _weak(c: Chance) -> Any:
    if c.random() < 0.7:
        return ()
    chosen = c.sample(range(1, c.robot.n + 1), c.choice((1, 1, c.robot.n)))
    odd = (1e-12, 1e-100, 5e-324, 2.0, -0.1, math.nan)
    pairs = {i: c.one(0.5, 0.1, 1.0, 0.0, odd=odd) for i in chosen}
    return c.one(pairs, list(pairs.items()), ",".join(f"{i}:{x}" for i, x in pairs.items()))


def _payload(c: Chance) -> Any:
    mass = abs(c.number(2.0))
    return c.one(None, mass, f"{mass}", f"{mass}@0.1,0,0.1", f"{mass}@0,0,0@1,1,1,0,0,0",
        c.folder / "nowhere.toml", (mass, c.vector(3, 0.1)),
    )  # fmt: skip


def _limits(c: Chance) -> Any:
    if c.random() < 0.7:
        return c.one(None, "urdf", "none", odd=("nowhere.csv", str(c.folder), "limits.xml", ""))
    efforts, brakes = ([c.one(*LIMITS) for _ in range(c.robot.n)] for _ in range(2))
    return Limits.of(efforts, c.maybe(brakes))


LIMITS = (10.0, 50.0, 100.0, math.nan, 1e-6, 1e-300, 1e9)


def _trajectory(c: Chance) -> Any:
    kind = c.random()
    if kind < 0.2 * c.odd:
        return c.choice(("nowhere.csv", str(c.folder), ""))
    if kind < 0.5:
        t = np.linspace(0.0, c.choice((0.1, 0.5, 1.0)), c.choice((5, 9, 30)))
        bend = np.array([c.gauss(0.0, 0.3) for _ in range(c.robot.n)])
        return Recording.of(c.robot, t, choose_posture(c.robot).q + np.outer(t * t, bend))
    change = [c.gauss(0.0, 0.03) for _ in range(3)]
    return _line(c.robot, change, c.choice((0.1, 0.5, 2.0)))


EVENTS = ((), "2@0.05", "free:1@0.02", "weak:1:0.5@0", "1,2@0.1", ["1@0.01", "free:2@0.05"])
NO_EVENTS = ("1@9", "1@", "x", "", "@1", "1@-1", "1@nan", "1@0;2@0", [3])
TASKS = ("force", "force", "force", "moment", "wrench", "fx,fz", "fx", "my", "fx,my", ["fz"])
SETS = (1, 2, [[1], [1, 2]], ftforce.FaultSet.locked([0]))
FORCE = (3, 3, 3, 3, 3, 6, 2, 1)  # components
ARGUMENTS: dict[str, Callable[[Chance], Any]] = {
    "robot": lambda c: c.robot,
    "q": lambda c: c.maybe(c.vector(c.robot.n), 0.8),
    "locked": Chance.joints,
    "free": lambda c: c.one((), (), c.joints()),
    "weak": _weak,
    "force": lambda c: c.vector(c.choice(FORCE), 30.0),
    "torque": lambda c: c.maybe(c.vector(c.robot.n, 10.0), 0.3),
    "direction": lambda c: c.vector(c.choice(FORCE)),
    "velocity": lambda c: c.vector(c.robot.n),
    "acceleration": lambda c: c.vector(c.robot.n),
    "gravity": lambda c: c.one(c.vector(3, 9.8), "wall", "30,-45", odd=("wal", "1", "")),
    "payload": _payload,
    "limits": _limits,
    "friction": lambda c: c.one(
        None, 0, 0.1, "0.1", c.vector(c.robot.n), odd=("none", -1, "x.csv")
    ),
    "joint_friction": lambda c: c.one(False, True, odd=(None, "yes", 2)),
    "armature": lambda c: c.one(False, True, odd=(None, "yes", 2)),
    "inverse": lambda c: c.one("euclidean", "dynamic", odd=("newton",)),
    "task": lambda c: c.one(*TASKS, odd=("fq", "", "fx,fx", "force,fx")),
    "length": lambda c: c.size(None, 0.1, 1.0, scale=1.0),
    "joint_length": lambda c: c.size(None, 0.3, scale=1.0),
    "axes": lambda c: c.one("tool", "world", odd=("tip",)),
    "posture": lambda c: c.one("zero", "bent", "sample", "mid-range", odd=("nowhere",)),
    "rtol": lambda c: c.size(1e-6, 1e-9, 1e-3, scale=1e-6),
    "wary": lambda c: c.size(1e-2, 1e-3, 0.5, scale=1e-2),
    "faults": lambda c: c.one(1, 2, odd=(0, -1, 3, 99, 1.0, 10**30)),
    "mode": lambda c: c.one("locked", "free", ftforce.FaultMode.FREE, odd=("weak", "broken")),
    "rank_by": lambda c: c.one("jump", "capability", odd=("size",)),
    "progress": lambda c: None,
    "n": lambda c: c.size(1, 2, 10, 64, 100, 1e2, scale=50.0),
    "method": lambda c: c.one("sobol", "uniform", odd=("halton",)),
    "seed": lambda c: c.one(0, 1, 7, odd=(2**31, 2**70, -1, 1.5)),
    "keep": lambda c: c.one(None, "summary", "worst", "all", odd=("some",)),
    "cell": lambda c: c.size(None, 0.1, 0.5, scale=0.3),
    "output": lambda c: None,
    "chunk": lambda c: c.one(None, 4096, odd=(100, 0, 10**12)),
    "threads": lambda c: c.one(1, 2, odd=(0, 10**6, 1.5)),
    "workers": lambda c: c.one(None, odd=(0, -1, 10**6)),
    "scheduler": lambda c: None,
    "trajectory": _trajectory,
    "events": lambda c: c.one(*EVENTS, odd=NO_EVENTS),
    "delay": lambda c: c.size(0.0, 0.05, math.inf, scale=0.1),
    "remap": lambda c: c.one(True, False),
    "rate": lambda c: c.size(20, 50.0, 100, scale=50.0),
    "speed": lambda c: c.size(None, 0.5, scale=1.0),
    "keep_orientation": lambda c: c.one(False, True),
    "max_gap": lambda c: c.size(None, 0.5, scale=1.0),
    "topic": lambda c: c.one(None, odd=("/joint_states", "", 7)),
    "maximize": lambda c: c.one(*MEASURES, odd=("speed", None, 3)),
    "waypoints": lambda c: c.one(3, 4, 5, odd=(1, 2.5, -1, "3", True)),
    "max_acceleration": lambda c: c.one(None, 50.0, c.vector(c.robot.n), odd=(-1.0, "x", math.inf)),
    "keep_start": lambda c: c.one(False, True),
    "place": lambda c: c.one([0.3, 0.1, 0.3], c.vector(3), None),
    "rpy": lambda c: c.maybe(c.vector(3), 0.2),
    "like": lambda c: c.one(None, "zero", c.vector(c.robot.n), odd=("nowhere", 3)),
    "restarts": lambda c: c.one(2, 4, odd=(0, -1, 2.5, "3")),
    "step": lambda c: c.one(0.1, 0.2, odd=(0.0, -1.0, "x", 9.0)),
    "resolution": lambda c: c.one(0.8, 1.0, odd=(0.0, -1.0, "x")),
    "edge": lambda c: c.one(0.5, 1.0, odd=(0.0, -1.0, "x", 1e-6, math.nan)),
    "plane_task": lambda c: c.one(None, "force", odd=("fx", "fx,fy", "wrench", 3)),
    "within": lambda c: c.one(
        None, {1: (-0.5, 0.5)}, odd=({1: (1, -1)}, "no.toml", {9: (0, 1)}, 3)
    ),
    "release": lambda c: c.one(False, True, odd=("x",)),
    "soften": lambda c: c.one(False, False, odd=(1,)),
    "around": lambda c: c.one(None, odd=([[0, 0, 0], [1, 1, 1]], "x", 3)),
    "guarantee": lambda c: c.one(False, True),
    "locks": lambda c: c.one(None, "1@0.1", {2: -0.1}, "2@0.01s", odd=("2", "9@1", {1: "x"}, 3)),
    "smooth": lambda c: c.one("auto", "none", 0.1, odd=("much", -1.0, math.nan, 1e-9)),
    "static": lambda c: c.one(False, True),
    "enough": lambda c: c.size(0.95, 0.5, 1.0, scale=0.5),
    "tip": lambda c: c.one(None, odd=("tool", "tip", "nowhere", "")),
    "base": lambda c: c.one(None, odd=("base_link", "nowhere")),
    "args": lambda c: c.one(None, odd=({"length": 2}, "a=b", {1: None})),
    "srdf": lambda c: c.one(None, odd=(str(c.folder), "nowhere.srdf", "", 7)),
    "package_path": lambda c: c.one(None, odd=(str(c.folder), [c.folder, "nowhere"], "", 7)),
    "arms": lambda c: c.one(["dh5", c.robot], [c.robot] * 2, {"a": c.robot}, odd=([], "dh5", [3])),
    "J": lambda c: [c.vector(c.robot.n) for _ in range(3)],
    "tau": lambda c: c.vector(c.robot.n, 10.0),
    "failed": lambda c: c.one([True] + [False] * (c.robot.n - 1), odd=([1], [], c.vector(2))),
    "free_mask": lambda c: c.one(None, [False] * (c.robot.n - 1) + [True]),
    "rnea": lambda c: c.vector(c.robot.n, 5.0),
    "efforts": lambda c: np.abs([c.one(c.number(50.0), math.nan) for _ in range(c.robot.n)]),
    "source": lambda c: c.one("dh5", "panda", "ur5", odd=PATHS),
    "model": lambda c: c.one(*models(), odd=(None, "panda", c.robot)),
    "frame": lambda c: c.one(None, "effector_body", "elbow_joint", odd=("universe", "", "tip")),
    "configuration": lambda c: c.one(None, "zero", c.vector(6), odd=("nowhere", c.vector(33))),
    "motors": lambda c: c.one(
        None, {"elbow_joint": 5.0}, abs(np.array(c.vector(6))), odd=(3, [], {"a": 1}, {1: None})
    ),
    "path": lambda c: c.one(*PATHS, str(c.folder), "x.npz", "x.csv", "x.zarr", "x.toml"),
    "target": lambda c: c.folder / c.one(*(f"a.{x}" for x in ENDINGS), odd=NO_FILES),
    "result": lambda c: c.one(*results()),
    "value": lambda c: c.one("tolerated", "locked", odd=("", 1)),
    "joint": lambda c: c.one(0, 1, 2, odd=(-1, 10**9, 1.5)),
    "factor": lambda c: c.size(1.0, scale=1.0),
    "fault_tuple": lambda c: tuple(
        ftforce.Fault(j) for j in c.one((), (0,), (2, 1), odd=((1, 1),))
    ),
    "components": lambda c: c.one(("fx", "fy", "fz"), ("fx",), ("mz", "fx"), odd=((), ("fq",))),
    "sets": lambda c: c.one(*SETS, odd=([], 0, [[]], [[9]], [["nobody"]], 10**30)),
    "points": lambda c: [c.vector(3) for _ in range(c.one(2, 3, odd=(0, 1)))],
    "t": lambda c: c.one(np.linspace(0.0, 1.0, 5), [0, 1, 2, 3, 4], c.vector(5)),
    "qs": lambda c: [c.vector(c.robot.n) for _ in range(5)],
    "counts": lambda c: c.one(1, 2, 3, [2, 2], [2, 2, 2, 2, 2], odd=(0, 10**9, 1.5, -2, 10**30)),
    "mass": lambda c: abs(c.number(3.0)),
    "offset": lambda c: c.vector(3, 0.1),
    "some": lambda c: c.one(None, [1], [2], [1, 2], odd=([9], [0], [])),
    "plane": lambda c: c.one(None, "xy", "xz", "yz", odd=("xx",)),
    "at": lambda c: c.maybe(c.number()),
    "solid": lambda c: c.one(False, True),
    "quantities": lambda c: c.one(("rho", "margin"), ("jump",), ("capability",), odd=((), ("a",))),
    "sweep": lambda c: c.one(*results()[-3:]),
    **dict.fromkeys(("a", "alpha", "d", "theta"), lambda c: c.number(0.3)),
    "type": lambda c: c.one("revolute", "prismatic", odd=("screw",)),
    "lower": lambda c: -c.size(1.0, scale=1.0),
    "upper": lambda c: c.size(1.0, scale=1.0),
    "effort": lambda c: c.size(None, 10.0, scale=1.0),
    "kind": lambda c: c.one("solid cylinder", "point masses", odd=("foam",)),
    "radius": lambda c: c.size(0.03, scale=0.1),
    "density": lambda c: c.size(None, 2700.0, scale=1e3),
}
PATHS = ("pandas", "nowhere.urdf", ".", "/dev/null", "", "a\x00b", "~", "x" * 300)
ENDINGS = ("json", "csv", "xlsx", "tex", "md", "npz", "parquet", "txt")
NO_FILES = ("a", "no/a.json", ".json", "a.zarr", "x" * 300 + ".json")


# ---- calls -----------------------------------------------------------------------------------


def remapped(robot: Any, sets: Any, q: Any, *, tau: Any = None, force: Any, **asked: Any) -> Any:
    """Make a remapper, and call it."""
    return ftforce.Remapper(robot, sets, **asked)(q, tau, force=force).copy()


def remapped_jacobian(J: Any, tau: Any, faults: Any, **asked: Any) -> Any:
    """Make a remapper for Jacobians of a shape, and call it."""
    try:
        m, n, *_ = (*np.shape(J), 3, 7)
    except ValueError:  # rows of several lengths
        m, n = 3, 7
    return ftforce.Remapper(m=m, n=n, faults=faults, **asked)(J, tau).copy()


def written_table(target: Any, kind: Any, radius: Any, density: Any, **row: Any) -> Any:
    """Write the arm of a DH table, and load it."""
    rows = (DHRow(**row), DHRow(0.3, 0.0, 0.1, 0.2, "revolute", -1.0, 1.0))
    table = ftforce.DHTable("random", "standard", rows, MassModel(kind, radius, density))
    return ftforce.load_robot(ftforce.write_robot(table, target.with_suffix(".urdf"))[0])


def as_document(result: Any) -> Any:
    """Call `ftforce.to_dict`, which dispatches on its argument by position."""
    return ftforce.to_dict(result)


def _optional(function: Callable[..., Any]) -> tuple[str, ...]:
    """Return the parameters that may be left out."""
    found = inspect.signature(function).parameters.values()
    return tuple(one.name for one in found if one.default is not inspect.Parameter.empty)


class Kind(NamedTuple):
    """A function, how often it is called, and the parameters that it always and sometimes gets.

    A parameter with a colon gets the values listed for another name.
    """

    function: Callable[..., Any]
    share: int
    always: str
    sometimes: tuple[str, ...] = ()


_OF_MODEL = ("posture:configuration", "limits:motors")
_AFTER_LOCKS = ("locked:locks", *(x for x in _optional(ftforce.plan) if x != "locked"))
_OF_POSTURE = tuple(x for x in _optional(ftforce.best_posture) if x != "at")
_OF_REACH = ("task:plane_task", *(x for x in _optional(ftforce.reach) if x not in ("task", "cell")))
_TABLE = "target kind radius density a alpha d theta type lower upper"
KINDS = (
    *(Kind(one, 200, "robot", _optional(one)) for one in (ftforce.capability, ftforce.census)),
    Kind(ftforce.analyze, 600, "robot", _optional(ftforce.analyze)),
    Kind(ftforce.remap, 150, "J tau locked:failed", ("rtol",)),
    Kind(bounded_remap, 100, "J tau locked:failed limits:efforts", ("free:free_mask", "rnea")),
    Kind(remapped, 60, "robot sets q force", _optional(ftforce.Remapper)[4:]),
    Kind(remapped_jacobian, 30, "J tau faults", ("mode", "limits:efforts", "rtol", "wary")),
    Kind(ftforce.sweep, 12, "robot n", _optional(ftforce.sweep)),
    Kind(ftforce.timeline, 12, "robot trajectory", _optional(ftforce.timeline)),
    Kind(ftforce.best_posture, 6, "robot at:place restarts step resolution", _OF_POSTURE),
    Kind(ftforce.reach, 4, "robot cell:edge", _OF_REACH),
    Kind(ftforce.plan, 4, "robot trajectory waypoints", _AFTER_LOCKS),
    Kind(ftforce.simulate, 12, "robot trajectory force faults:events", _optional(ftforce.simulate)),
    Kind(ftforce.compare, 4, "arms n", _optional(ftforce.compare)),
    Kind(workspace_map, 20, "sweep", ("joints:some", "plane", "at", "solid", "quantities")),
    Kind(ftforce.load_robot, 40, "source", _optional(ftforce.load_robot)),
    Kind(ftforce.Robot.from_model, 40, "model", ("tip:frame", "base:frame", *_OF_MODEL)),
    Kind(ftforce.open_sweep, 20, "path"),
    Kind(ftforce.load_history, 20, "path"),
    Kind(ftforce.DHTable.from_toml, 10, "path"),
    Kind(ftforce.save, 40, "result path:target"),
    Kind(as_document, 20, "result"),
    Kind(written_table, 20, _TABLE, ("effort", "mass:effort")),
    Kind(ftforce.known_robots, 1, ""),
    Kind(ftforce.Fault, 40, "joint", ("mode", "factor")),
    Kind(ftforce.FaultSet, 20, "faults:fault_tuple"),
    Kind(ftforce.FaultMode.parse, 10, "mode:value"),
    Kind(ftforce.Task, 20, "components", ("axes", "length")),
    Kind(ftforce.Task.parse, 20, "task", ("axes", "length")),
    Kind(Payload.of, 40, "mass", ("offset",)),
    Kind(Limits.of, 20, "effort:efforts", ("brake:efforts",)),
    Kind(TipPath.through, 40, "points speed", ("keep_orientation",)),
    Kind(Recording.of, 40, "robot t q:qs", ("max_gap",)),
    Kind(Grid.of, 20, "robot counts"),
)


class Call(NamedTuple):
    """A call that was drawn."""

    function: Callable[..., Any]
    given: dict[str, Any]
    is_tame: bool

    def __call__(self) -> Any:
        """Call the function."""
        return self.function(**self.given)

    def __str__(self) -> str:
        """Return the call about as one would type it."""
        words = ", ".join(f"{name}={_word(x)}" for name, x in self.given.items())
        return f"{self.function.__qualname__}({words})"


def _word(value: Any) -> str:
    return f"<{value.name}>" if isinstance(value, ftforce.Robot) else repr(value)


def draw(number: int, folder: Path) -> Call:
    """Return the call of a number; its arguments may be refused when they are made."""
    c = Chance(f"call {number}")
    c.folder, c.robot, c.odd = folder, c.choice(robots()), c.choice((0.0, 0.0, 0.03, 0.3))
    kind = c.choices(KINDS, [one.share for one in KINDS])[0]
    share = c.choice((0.1, 0.3, 0.5))
    names = [*kind.always.split(), *(name for name in kind.sometimes if c.random() < share)]
    pairs = dict(name.partition(":")[::2] for name in names)
    given = {name: ARGUMENTS[other or name](c) for name, other in pairs.items()}
    if given and c.random() < c.odd:
        given[c.choice(list(given))] = c.choice(MALFORMED)
    return Call(kind.function, given, c.odd == 0.0)
