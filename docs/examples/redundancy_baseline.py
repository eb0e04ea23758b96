"""Solve the tool path of docs/guides/plan.md with pink, and compare what a fault leaves.

The Panda's tool goes along a line, its orientation kept: by resolved rates, by pink without and
with its manipulability task, and by `ftforce.plan`. The margin after the worst fault comes from
Pinocchio's Jacobians and NumPy's singular values alone.

``python docs/examples/redundancy_baseline.py`` prints the numbers of docs/guides/plan.md. It needs
pink (``pip install pin-pink``) and takes about twenty seconds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from pink import Configuration, solve_ik
from pink.tasks import FrameTask, ManipulabilityTask, PostureTask

import ftforce
from ftforce.trajectory import Path

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

START, END = np.array([0.5, -0.2, 0.4]), np.array([0.5, 0.2, 0.4])  # m
SPEED = 0.1  # m/s
TIP = "panda_hand_tcp"
FRAME_COST = 1.0  # per m and per rad
COSTS = (1e-3, 1e-2, 1e-1)  # of the manipulability: the best for pink counts
RESTARTS = 20
SETTLING = 1000  # steps of 10 ms
STEPS = 4  # of pink, per instant of the plan
RATE = 0.1  # 1/s, pink's default


def model_of_arm() -> pin.Model:
    """Return Pinocchio's model of the Panda, as its URDF has it, with its fingers locked."""
    model = pin.buildModelFromUrdf(str(ftforce.load_robot("panda").path))
    fingers = [model.getJointId(f"panda_finger_joint{i}") for i in (1, 2)]
    return pin.buildReducedModel(model, fingers, pin.neutral(model))


def jacobian(model: pin.Model, data: pin.Data, q: Array) -> Array:
    """Return the Jacobian of the tip in its own axes, shape (6, n)."""
    return pin.computeFrameJacobian(model, data, q, model.getFrameId(TIP), pin.LOCAL)


def margins(model: pin.Model, path: Array) -> Array:
    """Return σ_min(K)/σ_max(J) of the force task after each lock, shape (N, n)."""
    data, rows = model.createData(), []
    for q in path:
        J = jacobian(model, data, q)[:3]
        locked = [np.delete(J, i, axis=1) for i in range(model.nv)]
        weakest = [np.linalg.svd(K, compute_uv=False)[-1] for K in locked]
        rows.append(np.array(weakest) / np.linalg.norm(J, 2))
    return np.array(rows)


def manipulability(model: pin.Model, path: Array) -> Array:
    """Return Yoshikawa's manipulability of the healthy arm, six rows, shape (N,)."""
    data = model.createData()
    return np.array([np.prod(np.linalg.svd(jacobian(model, data, q))[1]) for q in path])


def poses(model: pin.Model, path: Array) -> list[pin.SE3]:
    """Return the poses of the tip."""
    data, found = model.createData(), []
    for q in path:
        pin.framesForwardKinematics(model, data, q)
        found.append(data.oMf[model.getFrameId(TIP)].copy())
    return found


def follow(model: pin.Model, q: Array, targets: list[pin.SE3], t: Array, cost: float) -> Array:
    """Return the joint path of pink that follows the poses, shape (N, n)."""
    frame = FrameTask(TIP, FRAME_COST, FRAME_COST)
    rest = PostureTask(cost=1e-4)  # makes the problem strictly convex
    arm = Configuration(model, model.createData(), q.copy())
    tasks = [frame, rest]
    if cost > 0.0:
        tasks.append(ManipulabilityTask(TIP, model, cost=cost, manipulability_rate=RATE))
    path = [q]
    for target, dt in zip(targets[1:], np.diff(t), strict=True):
        frame.set_target(target)
        rest.set_target(arm.q)
        arm.integrate_inplace(solve_ik(arm, tasks, dt, solver="daqp", safety_break=False), dt)
        path.append(arm.q.copy())
    return np.array(path)


def random_starts(model: pin.Model, target: pin.SE3) -> Array:
    """Return postures that pink finds from random ones, the most manipulable first."""
    rng, found = np.random.default_rng(0), []
    for _ in range(RESTARTS):
        q = rng.uniform(model.lowerPositionLimit, model.upperPositionLimit)
        count, step = SETTLING // 2, 0.01
        q = follow(model, q, [target] * count, np.arange(count) * step, COSTS[1])[-1]
        if off_path(model, q[None], [target]) < 1e-3:
            found.append(q)
    starts = np.array(found)
    return starts[np.argsort(-manipulability(model, starts))]


def off_path(model: pin.Model, path: Array, targets: list[pin.SE3]) -> float:
    """Return the largest distance of the tip from the path, m."""
    reached = poses(model, path)
    return max(
        float(np.linalg.norm(a.translation - b.translation))
        for a, b in zip(reached, targets, strict=True)
    )


def compare() -> dict[str, Array]:
    """Print the table, and return the margins of each path."""
    arm, model = ftforce.load_robot("panda"), model_of_arm()
    line = Path.through([START, END], speed=SPEED, keep_orientation=True)
    free, kept = (ftforce.plan(arm, line, keep_start=keep) for keep in (False, True))
    t, usual = free.t, free.before.q
    fine = np.linspace(t[0], t[-1], STEPS * (len(t) - 1) + 1)
    dense = np.array([np.interp(fine, t, column) for column in usual.T]).T
    rotation = poses(model, usual[:1])[0].rotation
    heights = [pose.translation for pose in poses(model, dense)]
    targets = [pin.SE3(rotation, START + (END - START) * share_of(p)) for p in heights]

    def settled(q: Array, cost: float) -> Array:  # where pink goes if it may choose the start
        return follow(model, q, targets[:1] * SETTLING, np.arange(SETTLING) * 0.01, cost)[-1]

    def best(start: Array, *, settles: bool = False) -> tuple[str, Array | None]:
        found = []
        for cost in COSTS:
            q = settled(start, cost) if settles else start
            path = follow(model, q, targets, fine, cost)
            if off_path(model, path, targets) < 1e-3:
                worst = margins(model, path).min(axis=1)
                found.append((worst.min(), worst.mean(), cost, path))
        if not found:  # a joint meets its limit, and the tip leaves the line
            return "", None
        _, _, cost, path = max(found, key=lambda one: one[:2])
        return f"(cost {cost:g})", path

    by_cost, steered = best(usual[0])
    by_own, own = best(usual[0], settles=True)
    starts = random_starts(model, targets[0])
    by_many, many = next(one for one in map(best, starts) if one[1] is not None)
    by_last, last = best(free.after.q[0])
    paths = {
        "usual (resolved rates)": (usual, targets[::STEPS]),
        "pink, no manipulability task": (follow(model, usual[0], targets, fine, 0.0), targets),
        f"pink, same start {by_cost}": (steered, targets),
        f"pink, its own start {by_own}": (own, targets),
        f"pink, best random start {by_many}": (many, targets),
        f"pink, the plan's start {by_last}": (last, targets),
        "ftforce.plan, same start": (kept.after.q, targets[::STEPS]),
        "ftforce.plan, free start": (free.after.q, targets[::STEPS]),
    }
    print(f"{'path':<38} worst margin  at      set   mean  manipulability  tip off")
    results = {}
    for name, (path, wanted) in paths.items():
        all_of = margins(model, path)
        worst = all_of.min(axis=1)
        i = int(worst.argmin())
        at = np.linspace(t[0], t[-1], len(path))[i]
        least = manipulability(model, path).min()
        off = 1e3 * off_path(model, path, wanted)
        print(
            f"{name:<38} {worst[i]:12.3f}  {at:3.1f} s  {{{all_of[i].argmin() + 1}}} "
            f"{worst.mean():7.3f}  {least:14.4f}  {off:4.2f} mm"
        )
        results[name] = worst
    return results


def share_of(p: Array) -> float:
    """Return how far along the line a point is, from 0 to 1."""
    along = END - START
    return float((p - START) @ along / (along @ along))


if __name__ == "__main__":
    compare()
