"""The array core with nothing but NumPy: a planar arm whose Jacobian is written by hand.

Any library that gives a Jacobian of the tip will do instead of ``planar_jacobian``.
"""

import numpy as np

import ftforce


def planar_jacobian(q: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Return the Jacobian of the tip of a planar arm, rows vx and vy, shape (2, n), in m."""
    angles = np.cumsum(q)
    x, y = lengths * np.cos(angles), lengths * np.sin(angles)
    # Joint k moves every link from k on: its column sums them up.
    return np.array([-np.cumsum(y[::-1])[::-1], np.cumsum(x[::-1])[::-1]])


lengths = np.array([0.5, 0.4, 0.3, 0.2])  # m
q = np.radians([30.0, 40.0, -50.0, 20.0])
J = planar_jacobian(q, lengths)

F = np.array([30.0, -10.0])  # N, what the tip exerts
tau = J.T @ F  # N·m, the force part of the motor torques
locked = np.array([False, True, False, False])

result = ftforce.remap(J, tau, locked)
print("before", result.tau.round(3), "N·m")
print("after ", result.U.round(3), "N·m")
print("jump  ", round(result.jump_norm, 6), "N")

# Only the first joint is left: it commands force in one direction, square to its lever arm.
result = ftforce.remap(J, tau, np.array([False, True, True, True]))
print("F     ", result.F.round(2), "N")
print("after ", result.F_after.round(2), "N")
print("jump  ", result.jump.round(2), "N, norm", round(result.jump_norm, 2))
print("brakes", result.brake_load.round(2), "N·m")
print("proved", result.is_proved())
