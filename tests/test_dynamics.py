"""Weight, motion and mass matrix meet roboticstoolbox, changed Pinocchio models, and energies."""

import math

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings

import ftforce
from ftforce.errors import InputError
from ftforce.robot.dynamics import Payload, mass_matrix, motion_torque, rnea_torques, weight_torque
from ftforce.robot.kinematics import tip_pose
from helpers import (
    KNOWN,
    arms,
    assert_close,
    campaign,
    changed_model,
    eager_threads,
    load_text,
    seeds,
    serial_urdf,
    toolbox,
    without_masses,
)

EXACT = 1e-12
MOON = np.array([0.3, -0.2, -1.6])  # tilted, too
B = {"xyz": (0.3, 0.0, 0.1), "axis": (0, 1, 0)}
C = {"xyz": (0.2, 0.1, 0.0), "axis": (1, 0, 0)}
D = {"xyz": (0.1, 0.0, 0.2), "rpy": (0.3, 0.2, 0.1)}
POINT = Payload.of(1.7, (0.05, -0.02, 0.1))


def total(arm, q, v, a, **options):
    gravity = {"gravity": options["gravity"]} if "gravity" in options else {}
    payload = options.get("payload")
    weight = weight_torque(arm, q, payload=payload, **gravity)
    return weight + motion_torque(arm, q, v, a, payload)


# ---- roboticstoolbox -------------------------------------------------------------------------


def inertials(arm):
    return arm.model.inertias.tolist()[1:]


@pytest.fixture(scope="module")
def toolbox_panda(panda):
    """The toolbox's Panda of DH parameters, with its own masses but those of the first and last.

    Its link 1 has the centre of mass at another height, which nothing feels on a vertical joint.
    Its last frame is the flange, 0.107 m beyond link 7, but its link 7 has the centre of mass that
    belongs to link 7's own frame; and it has no hand. So that link gets the URDF's inertials.
    """
    other = toolbox().models.DH.Panda()
    flange, last = other.links[6].d, inertials(panda)[6]
    assert flange == 0.107
    other.links[6].m, other.links[6].I = last.mass, last.inertia
    other.links[6].r = last.lever - [0.0, 0.0, flange]
    return other


def test_masses_of_the_toolbox_are_those_of_the_urdf(panda):
    own = toolbox().models.DH.Panda()
    for link, wanted in zip(own.links[:6], inertials(panda), strict=False):
        assert_close(link.m, wanted.mass)
        assert_close(link.I, wanted.inertia)
        assert_close(link.r[:2], wanted.lever[:2])
        assert link.r[2] == pytest.approx(wanted.lever[2]) or link is own.links[0]


def test_weight_and_motion_against_the_toolbox(panda, toolbox_panda):
    rng, rest = np.random.default_rng(1), np.zeros(7)
    for q, v, a in rng.uniform(-2.0, 2.0, size=(5, 3, 7)):
        weight = weight_torque(panda, q)
        assert_close(weight, toolbox_panda.gravload(q), tol=EXACT)
        wanted = toolbox_panda.rne(q, v, a)
        assert_close(weight + motion_torque(panda, q, v, a), wanted, tol=EXACT)
        assert_close(mass_matrix(panda, q), toolbox_panda.inertia(q), tol=EXACT)
        on_the_moon = toolbox_panda.rne(q, rest, rest, gravity=MOON)
        assert_close(weight_torque(panda, q, MOON), on_the_moon, tol=EXACT)


# ---- Pinocchio with another model ------------------------------------------------------------


SURROUNDINGS = [
    {},
    {"gravity": MOON},
    {"payload": Payload.of(2.0)},
    {"payload": POINT},
    {"gravity": MOON, "payload": POINT},
    {"gravity": np.zeros(3), "payload": POINT},
]


@pytest.mark.parametrize("surroundings", SURROUNDINGS, ids=str)
@pytest.mark.parametrize("name", KNOWN)
def test_gravity_and_payload_against_another_model(name, surroundings):
    arm = ftforce.load_robot(name)
    if arm.mass == 0.0:
        pytest.skip("has no masses")
    model, G = changed_model(arm, **surroundings), arm.coordinates.G
    data, rng = model.createData(), np.random.default_rng(4)
    q, v, a = rng.uniform(-1.0, 1.0, size=(3, arm.n))
    configuration, rest = arm.to_model(q), np.zeros(model.nv)
    assert_close(
        weight_torque(arm, q, **surroundings),
        G.T @ pin.rnea(model, data, configuration, rest, rest),
        scale=100.0,
        tol=EXACT,
    )
    assert_close(
        total(arm, q, v, a, **surroundings),
        G.T @ pin.rnea(model, data, configuration, G @ v, G @ a),
        scale=100.0,
        tol=EXACT,
    )
    columns = [
        pin.rnea(model, data, configuration, rest, G @ unit)
        - pin.rnea(model, data, configuration, rest, rest)
        for unit in np.eye(arm.n)
    ]
    M = mass_matrix(arm, q, surroundings.get("payload"))
    assert_close(M, G.T @ np.column_stack(columns), tol=1e-11)
    assert_close(M, M.T, tol=EXACT)


@pytest.mark.parametrize("options", [{}, {"gravity": MOON}, {"payload": POINT},
                                     {"gravity": MOON, "payload": POINT}])  # fmt: skip
@pytest.mark.parametrize("name", KNOWN)
def test_many_motions_at_once(name, options):
    arm = ftforce.load_robot(name)
    gravity = arm.gravity
    q, v, a = np.random.default_rng(2).normal(size=(3, 5, arm.n))
    found = rnea_torques(arm, q, v, a, **options)
    wanted = np.array([total(arm, *motion, **options) for motion in zip(q, v, a, strict=True)])
    assert_close(found, wanted, scale=np.abs(wanted).max(), tol=EXACT)
    np.testing.assert_array_equal(arm.model.gravity.linear, gravity)


def test_threads_with_different_gravities_do_not_disturb_each_other(panda):
    q = np.linspace(-1.0, 1.0, 7)
    gravities = np.random.default_rng(2).normal(size=(100, 3))

    def solve(gravity):
        return total(panda, q, q, -q, gravity=gravity, payload=POINT)

    alone = [solve(gravity) for gravity in gravities]
    with eager_threads() as pool:
        np.testing.assert_array_equal(list(pool.map(solve, gravities)), alone)


# ---- energies --------------------------------------------------------------------------------


def potential(arm, q, gravity, payload):
    """Return the potential energy of the links and the payload, J."""
    data = arm.model.createData()
    height = pin.centerOfMass(arm.model, data, arm.to_model(q)) @ gravity * data.mass[0]
    R, p = tip_pose(arm, q)
    return -height - payload.mass * (p + R @ payload.offset) @ gravity


@given(arms(least=2), seeds)
@settings(deadline=None, max_examples=campaign(40, 12))
def test_random_arms_against_their_energies(case, seed):
    arm, q = case
    v, a = np.random.default_rng(seed).normal(size=(2, arm.n))
    step = 1e-5
    slopes = [
        (potential(arm, q + d, MOON, POINT) - potential(arm, q - d, MOON, POINT)) / (2 * step)
        for d in step * np.eye(arm.n)
    ]
    assert_close(weight_torque(arm, q, MOON, POINT), slopes, scale=10.0, tol=1e-8)
    # d/dt ∂T/∂v - ∂T/∂q, along a path with this velocity and acceleration:
    ahead, behind = (
        mass_matrix(arm, q + t * v + t * t * a / 2, POINT) @ (v + t * a) for t in (step, -step)
    )
    gradient = [
        v @ (mass_matrix(arm, q + d, POINT) - mass_matrix(arm, q - d, POINT)) @ v / (4 * step)
        for d in step * np.eye(arm.n)
    ]
    wanted = (ahead - behind) / (2 * step) - gradient
    scale = 10.0 + np.abs(wanted).max()
    assert_close(motion_torque(arm, q, v, a, POINT), wanted, scale=scale, tol=1e-7)


# ---- followers and continuous joints ---------------------------------------------------------


def test_a_single_joint_by_hand():
    """A lever of 2 m along x turns about y; its mass of 1 kg lies at the joint, the tool's at 2 m.

    The tool is behind a fixed joint, so it belongs to the lever.
    """
    urdf = serial_urdf(("revolute", {"axis": (0, 1, 0)})).replace("0.11 0.05 0.03", "2 0 0")
    arm, q = load_text(urdf, tip="tool"), np.zeros(1)
    assert_close(weight_torque(arm, q), [-2.0 * 9.81])
    assert_close(weight_torque(arm, q, payload=Payload.of(3.0)), [-4.0 * 2.0 * 9.81])
    ahead = Payload.of(3.0, (0.5, 0.0, 0.0))
    assert_close(weight_torque(arm, q, payload=ahead), [-(2.0 + 3.0 * 2.5) * 9.81])
    assert_close(weight_torque(arm, q, np.array([0, 0, 9.81]), ahead), [(2.0 + 7.5) * 9.81])
    assert_close(mass_matrix(arm, q, ahead), [[0.02 + 4.0 + 3.0 * 2.5**2]])
    assert_close(motion_torque(arm, q, np.ones(1), np.full(1, 2.0), ahead), [2 * (4.02 + 18.75)])


# ---- missing masses --------------------------------------------------------------------------

CHAIN = (("revolute", {}), ("revolute", B), ("revolute", C))


def test_an_arm_without_masses():
    arm, q = load_text(without_masses(serial_urdf(*CHAIN))), np.full(3, 0.3)
    assert arm.mass == 0.0
    for gravity in (None, MOON):
        assert_close(weight_torque(arm, q, gravity), np.zeros(3))
        carried = weight_torque(arm, q, gravity, POINT)
        assert np.abs(carried).max() > 0.1
    assert_close(motion_torque(arm, q, q, q), np.zeros(3))
    with pytest.raises(InputError, match="mass matrix of 'arm' is not positive definite"):
        mass_matrix(arm, q)


def without_link_masses(*links):
    """Return the URDF of the chain in which these links have no mass."""
    urdf = serial_urdf(*CHAIN)
    for name in links:
        start = urdf.index(f'<link name="{name}">')
        end = urdf.index("</link>", start)
        urdf = urdf[:start] + without_masses(urdf[start:end]) + urdf[end:]
    return urdf


def test_massless_links_in_between_do_no_harm():
    arm = load_text(without_link_masses("l1", "l2"))
    M = mass_matrix(arm, np.array([0.1, 0.2, 0.3]))
    assert np.linalg.eigvalsh(M)[0] > 0.0


def test_links_beyond_the_last_joint_without_mass():
    arm = load_text(without_link_masses("l3", "tool"))
    assert arm.mass == 2.0
    with pytest.raises(InputError) as caught:
        mass_matrix(arm, np.array([0.1, 0.2, 0.3]))
    assert str(caught.value) == (
        "the mass matrix of 'arm' is not positive definite: masses or inertias in its URDF are "
        "missing or unphysical"
    )
    assert mass_matrix(arm, np.array([0.1, 0.2, 0.3]), POINT).shape == (3, 3)


@pytest.mark.parametrize("seed", range(3))
def test_a_point_mass_on_the_last_axis_has_only_rounding_for_an_inertia(seed):
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    turned = {"xyz": (0.3, 0, 0.1), "rpy": tuple(rng.normal(size=3)), "axis": tuple(axis)}
    urdf = without_masses(serial_urdf(("revolute", {"axis": (0, 1, 0)}), ("revolute", turned)))
    place = " ".join(map(repr, (0.4 * axis).tolist()))
    point = (
        f'<inertial><origin xyz="{place}"/><mass value="1"/>'
        '<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>'
    )
    arm = load_text(urdf.replace('<link name="l2">', f'<link name="l2">{point}'))
    for q in rng.normal(size=(10, 2)):
        with pytest.raises(InputError, match="not positive definite"):
            mass_matrix(arm, q)


# ---- payloads --------------------------------------------------------------------------------


def test_payloads_say_what_they_are():
    assert str(Payload.of(2.5)) == "2.5 kg"
    assert str(Payload.of(2, [0, 0, 0.1])) == "2 kg at (0, 0, 0.1) m"
    assert Payload.of(0).mass == 0.0
    assert not Payload.of(1.0).offset.flags.writeable


@pytest.mark.parametrize(
    ("mass", "offset", "message"),
    [
        (math.nan, (0, 0, 0), "the payload's mass must be 0 kg or more, got nan"),
        (math.inf, (0, 0, 0), "the payload's mass must be 0 kg or more, got inf"),
        ([2.0], (0, 0, 0), r"the payload needs a mass in kg, got \[2.0\]"),
        ("2", (0, 0, 0), "the payload needs a mass in kg, got '2'"),
        (1.0, 5, "the payload's position needs 3 numbers, got a single number: x, y, z in m"),
        (1.0, (0, math.nan, 0), "the payload's position contains nan at position 2"),
    ],
)
def test_what_no_payload_is(mass, offset, message):
    with pytest.raises(InputError, match=f"^{message}"):
        Payload.of(mass, offset)
