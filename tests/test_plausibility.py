"""Numbers that no real arm has are doubted where they count, and only there."""

import pickle
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

from ftforce import analyze, capability, census, known_robots, load_robot, simulate, sweep, timeline
from ftforce.robot.kinematics import tip_pose
from ftforce.robot.plausibility import STANDARD_GRAVITY
from ftforce.trajectory.path import Path
from urdfs import LINKS, arm, hand, joint, link, load, robot

NAMES = ("base", "l1", "l2", "l3", "l4", "l5", "l6")


def body(mass=2.0, inertia=(0.02, 0.02, 0.02), products=(0.0, 0.0, 0.0)):
    (xx, yy, zz), (xy, xz, yz) = inertia, products
    return (
        f'<inertial><origin xyz="0 0 0.2"/><mass value="{mass}"/><inertia ixx="{xx}" iyy="{yy}" '
        f'izz="{zz}" ixy="{xy}" ixz="{xz}" iyz="{yz}"/></inertial>'
    )


def six(efforts=(80, 70, 60, 50, 40, 30), bodies=None, length=0.2, kind="revolute"):
    """Return an arm of six joints, stretched 5 times the length from its first one to its tip."""
    bodies = [body()] * 6 if bodies is None else bodies
    joints = []
    for i, (ends, effort) in enumerate(zip(pairwise(NAMES), efforts, strict=True)):
        limit = f'<limit lower="-2" upper="2" effort="{effort}" velocity="1"/>'
        joints.append(
            joint(
                f"a{i + 1}",
                *ends,
                kind,
                axis=("0 0 1", "0 1 0", "1 0 0")[i % 3],
                limit=limit,
                xyz=f"0 0 {length}",
                rpy="0 0 0",
            )
        )
    links = [link("base"), *(link(name, one) for name, one in zip(NAMES[1:], bodies, strict=True))]
    return robot(*links, *joints)


def warned(tmp_path, *args, **options):
    found = load(tmp_path, six(*args, **options))
    assert set(found.implausible.all()) <= set(found.notes)
    return found.implausible


def test_an_ordinary_arm_is_not_doubted(tmp_path):
    assert warned(tmp_path) == ((), (), ())


def test_what_is_doubted_goes_with_the_arm(tmp_path):
    arm = load(tmp_path, six([87] * 6))
    again = pickle.loads(pickle.dumps(arm))  # before anybody has asked for it
    assert len(again.implausible.efforts) == 1
    assert again.notes == arm.notes == (*arm.notes[:-1], *again.implausible.efforts)


# ---- efforts ---------------------------------------------------------------------------------


def test_one_effort_everywhere_is_doubted(tmp_path):
    """`effort_2000_everywhere.urdf`; the payload is that of Pinocchio's gravity torque."""
    (words,) = warned(tmp_path, [2000] * 6).efforts
    stretched = load(tmp_path, six([2000] * 6))
    model, data = stretched.model, stretched.model.createData()
    # Gravity across the arm, which points along z, loads the hinges about y at full stretch.
    model.gravity.linear = np.array([STANDARD_GRAVITY, 0.0, 0.0])
    axes = pin.LOCAL_WORLD_ALIGNED
    J = pin.computeFrameJacobian(model, data, np.zeros(6), stretched.tip_frame, axes)
    per_kg = np.abs(J[:3].T @ model.gravity.linear)
    assert 2000 / per_kg.max() == pytest.approx(2000 / (STANDARD_GRAVITY * 0.8))
    held = 2000 / (STANDARD_GRAVITY * 1.0) - 12.0  # by the first joint, if it lay across, too
    assert held < 2000 / per_kg.max() - 12.0
    assert words == (
        "the effort limits are doubtful: all 6 are 2000 N·m, as if every joint had the same "
        "motor; stretched out, the arm could hold "
        f"{held:.3g} kg at its tip, {held / 12:.2g} times its own mass of 12 kg"
    )


@pytest.mark.parametrize(
    ("efforts", "is_doubted"),
    [
        ((30, 30, 30, 30, 30, 30), True),
        ((30, 30, 30, 30, 30, 0), True),  # five known ones
        ((30, 30, 30, 30, 0, 0), False),
        ((30, 30, 30, 30, 30, 29), False),
        ((0, 0, 0, 0, 0, 0), False),
        ((1e5, 1e5, 1e5, 1e5, 1e5, 1e5), False),  # unknown
    ],
)
def test_equal_efforts_are_doubted_from_five_joints_on(tmp_path, efforts, is_doubted):
    assert bool(warned(tmp_path, efforts).efforts) == is_doubted


@pytest.mark.parametrize(("factor", "is_doubted"), [(0.99, False), (1.01, True)])
def test_a_payload_of_twice_the_own_mass_is_the_limit(tmp_path, factor, is_doubted):
    """The joint whose lever leaves the least counts, here the first: 1 m, 36 kg with its own 12."""
    first = 3 * 12 * STANDARD_GRAVITY * 1.0 * factor
    efforts = (first, first + 1, first + 2, first + 3, first + 4, first + 5)
    assert bool(warned(tmp_path, efforts).efforts) == is_doubted
    light = [body(1.0)] * 6
    assert warned(tmp_path, efforts, light).efforts
    assert not warned(tmp_path, (80, *efforts[1:])).efforts
    assert not warned(tmp_path, efforts, [""] * 6).efforts  # without masses there is no measure


def test_the_lever_of_a_slide_is_its_travel(tmp_path):
    """Six slides of 2 m: each holds its effort over g."""
    found = warned(tmp_path, tuple(range(400, 406)), kind="prismatic").efforts
    assert f"could hold {400 / STANDARD_GRAVITY - 12:.3g} kg" in found[0]
    assert not warned(tmp_path, tuple(range(340, 346)), kind="prismatic").efforts


def test_the_travel_of_a_slide_is_part_of_the_lever(tmp_path):
    """A rail between two hinges of 600 N·m; its placeholder is no reason to doubt the masses."""

    def found(upper):
        limit = f'<limit lower="0" upper="{upper}" effort="5000" velocity="1"/>'
        hinge = '<limit lower="-1" upper="1" effort="{}" velocity="1"/>'
        straight = {"xyz": "0 0 0.5", "rpy": "0 0 0"}
        return load(tmp_path, robot(
            *(link(name, body()) for name in NAMES[:4]),
            joint("a", "base", "l1", limit=hinge.format(600), **straight),
            joint("rail", "l1", "l2", "prismatic", limit=limit, **straight),
            joint("b", "l2", "l3", limit=hinge.format(601), **straight),
        )).implausible  # fmt: skip

    # 1 m of links and the travel; 6 kg in all; the limit is 18 kg with the own weight.
    longest = 600 / (STANDARD_GRAVITY * 18.0) - 1.0
    assert found(longest - 0.01).efforts
    assert found(longest + 0.01) == found(1e6) == ((), (), ())


def test_efforts_are_doubted_wherever_limits_of_the_urdf_count(tmp_path):
    one = load(tmp_path, six([2000] * 6))
    (words,) = one.implausible.efforts
    assert words in analyze(one, locked=2, limits="urdf").warnings
    assert words in capability(one, locked=2).warnings
    assert words in census(one, limits="urdf").warnings
    assert words in census(one, rank_by="capability").warnings
    assert words not in analyze(one, locked=2).warnings
    assert words not in census(one).warnings
    from ftforce.core.limits import Limits

    own = Limits.of(np.full(6, 2000.0))
    assert words not in analyze(one, locked=2, limits=own).warnings


def test_efforts_are_doubted_in_sweeps_and_motions(tmp_path):
    one = load(tmp_path, six([2000] * 6, [body(2, (0.02, 0.02, 0.05))] * 6))
    (effort,), (inertia,) = one.implausible.efforts, one.implausible.inertias
    q = np.full((2, 6), 0.3)
    swept = sweep(one, q, direction=[0, 0, 1])
    assert effort in swept.warnings
    assert inertia not in swept.warnings
    assert effort not in sweep(one, q, direction=[0, 0, 1], limits="none").warnings
    start, end = tip_pose(one, q[0])[1], tip_pose(one, q[0] + 0.02)[1]
    path = Path.through([start, end], speed=0.05)
    for found in (
        simulate(one, path, q=q[0], force=[1, 0, 0], faults="2@0.1", limits="urdf", rate=20),
        timeline(one, path, q=q[0], rate=20),  # by default, the capability needs limits
    ):
        assert effort in found.warnings
        assert inertia in found.warnings


# ---- masses and inertias ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("bodies", "length", "words"),
    [
        ([body(0.001)] * 6, 0.2, "the masses are doubtful: 0.006 kg in all for a reach of 1 m"),
        ([body(2000)] * 6, 0.2, "the masses are doubtful: 1.2e+04 kg in all for a reach of 1 m"),
        ([body(2)] * 6, 200, "the masses are doubtful: 12 kg in all for a reach of 1e+03 m"),
        (
            [*[body(0.01)] * 5, body(12)],
            0.2,
            "the masses are doubtful: link 'l6' has 12 kg, all other links together have 0.05 kg",
        ),
        ([body(0.1), *[body(0.01)] * 5], 0.2, ""),
        ([body(400)] * 6, 0.2, ""),
        ([body(5)] * 6, 0.03, ""),  # three axes in one point, e.g. of a torso
    ],
)
def test_masses_out_of_proportion_are_doubted(tmp_path, bodies, length, words):
    found = warned(tmp_path, bodies=bodies, length=length).masses
    assert found == ((words,) if words else ())


@pytest.mark.parametrize(
    ("inertia", "products", "is_possible"),
    [
        ((0.02, 0.02, 0.04), (0, 0, 0), True),  # a disc
        ((0.0, 0.02, 0.02), (0, 0, 0), True),  # a thin rod
        ((0.0, 0.0, 0.0), (0, 0, 0), True),  # a point
        ((1e-8, 1e-8, 2.03e-8), (0, 0, 0), True),  # few digits
        ((0.02, 0.02, 0.041), (0, 0, 0), False),
        ((0.02, 0.02, 0.02), (0.03, 0, 0), False),  # a negative moment
        ((0.02, 0.02, 0.02), (0.015, 0.015, 0.015), False),  # 0.05 and twice 0.005
    ],
)
def test_impossible_inertias_are_doubted(tmp_path, inertia, products, is_possible):
    xx, yy, zz = inertia
    xy, xz, yz = products
    about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    # A body with inertia I exists if and only if its second moments, trace(I)/2 - I, are positive
    # semidefinite.
    second = 0.5 * np.trace(about) * np.eye(3) - about
    assert (np.linalg.eigvalsh(second).min() >= -0.01 * abs(about).max()) == is_possible
    found = warned(tmp_path, bodies=[*[body()] * 3, body(2, inertia, products), *[body()] * 2])
    words = (
        "the inertias of l4 are impossible: a principal moment of a body is not negative and at "
        "most the sum of the other two"
    )
    assert found.inertias == (() if is_possible else (words,))


def test_masses_and_inertias_are_doubted_where_they_count(tmp_path):
    bodies = [body(0.001, (0.02, 0.02, 0.05))] * 6
    one = load(tmp_path, six(bodies=bodies))
    (mass,), (inertia,) = one.implausible.masses, one.implausible.inertias
    q, v = np.full(6, 0.3), np.full(6, 0.1)

    def found(**options):
        warnings = analyze(one, q, locked=2, **options).warnings
        return mass in warnings, inertia in warnings

    assert found() == (True, False)
    assert found(gravity=[0, 0, 0]) == (False, False)
    assert found(gravity=[0, 0, 0], velocity=v) == (True, True)
    assert found(acceleration=v) == (True, True)
    assert found(inverse="dynamic", torque=v) == (True, True)
    assert mass not in census(one, q).warnings
    assert mass in census(one, q, mode="free").warnings


def test_bodies_that_do_not_move_with_the_chain_do_not_count(tmp_path):
    broken = body(1e5, (0.02, 0.02, 0.5))
    head = [link("head", broken), joint("neck", "base", "head")]
    assert load(tmp_path, arm(*head), tip="tool").implausible == ((), (), ())
    finger = [*hand("f"), link("tip", broken), joint("t", "f", "tip", "fixed")]
    found = load(tmp_path, arm(*finger), tip="tool").implausible
    assert found.masses
    assert "the inertias of tip are" in found.inertias[0]
    assert load(tmp_path, arm(base=link("base", broken))).implausible == ((), (), ())
    assert LINKS[0] == "base"


def test_few_known_robots_are_doubted():
    """Of the robots on offer, those whose numbers are wrong."""
    found = {name: load_robot(name).implausible for name in known_robots()}
    doubted = {name for name, one in found.items() if any(one)}
    assert doubted == set()


# ---- arms of a space arm's size --------------------------------------------------------------

WEIGHTLESS = "use gravity 0,0,0"


def proposes_weightlessness(found):
    return any(WEIGHTLESS in warning for warning in found.warnings)


def test_weightlessness_is_proposed_for_an_arm_that_only_works_in_space():
    arm = load_robot("canadarm2")
    found = [
        analyze(arm, locked=[3]), census(arm, limits="urdf"), capability(arm, locked=[3]),
        sweep(arm, np.ones((2, 7)), direction=[0, 0, 1]),
    ]  # fmt: skip
    assert [proposes_weightlessness(result) for result in found] == [True] * len(found)
    (warning,) = (w for w in found[0].warnings if WEIGHTLESS in w)
    assert warning.startswith("this arm is up to 19 m long")


@pytest.mark.parametrize("gravity", [(0.0, 0.0, 0.0), (0.0, 0.0, -9.81), "wall"])
def test_gravity_that_is_given_is_meant(gravity):
    assert not proposes_weightlessness(
        analyze(load_robot("canadarm2"), locked=[3], gravity=gravity)
    )


@pytest.mark.parametrize(
    ("length", "effort", "expected"),
    [(1.1, 300.0, True), (1.1, 9_000.0, False), (0.9, 300.0, False)],
)
def test_long_arms_that_hold_themselves_and_short_ones_stay_on_earth(
    tmp_path, length, effort, expected
):
    """Six links of 20 kg; 5.5 m or 4.5 m from the first joint to the tip."""
    heavy = [body(20.0, (2.0, 2.0, 2.0))] * 6
    found = load(tmp_path, six((effort,) * 5 + (0.99 * effort,), heavy, length))
    assert proposes_weightlessness(analyze(found, locked=[2])) is expected
