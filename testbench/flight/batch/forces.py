"""Forces and moments on the rigid body, and what they accelerate, as JSBSim 1.3.3 sums them.

FGAerodynamics, FGExternalForce, FGThruster, FGMassBalance and FGAccelerations. Each kernel takes the registers R
(register, flight) and does one stage of the frame for every flight.
"""

from __future__ import annotations

from testbench.flight.batch import registers as r
from testbench.flight.batch.air import arm
from testbench.flight.batch.motion import EARTH_RATE
from testbench.flight.batch.vector import Lanes, Rows, stage, where

_LB_SLUG = 1.0 / 32.174049


@stage
def weigh(R: Rows) -> None:
    """Invert the inertia (end of FGMassBalance::Run)."""
    i = r.INERTIA
    Ixx, Iyy, Izz = R[i], R[i + 1], R[i + 2]
    Ixy, Ixz, Iyz = -R[i + 3], -R[i + 4], -R[i + 5]
    k1, k2, k3 = Iyy * Izz - Iyz * Iyz, Iyz * Ixz + Ixy * Izz, Ixy * Iyz + Iyy * Ixz
    over = 1.0 / (Ixx * k1 - Ixy * k2 - Ixz * k3)
    i = r.INERTIA_INVERSE
    R[i], R[i + 1], R[i + 2] = k1 * over, k2 * over, k3 * over
    R[i + 3] = (Izz * Ixx - Ixz * Ixz) * over
    R[i + 4] = (Ixy * Ixz + Iyz * Ixx) * over
    R[i + 5] = (Ixx * Iyy - Ixy * Ixy) * over
    R[r.MASS] = _LB_SLUG * R[r.WEIGHT]


@stage
def motion_numbers(R: Rows) -> None:
    """Set b/2V, c/2V and their like, after the functions that stand before the axes (FGAerodynamics::Run)."""
    twice, b, c = 2.0 * R[r.VT], R[r.BI2VEL], R[r.CI2VEL]
    over = 1.0 / twice
    over_b, over_c = R[r.WING_SPAN] * over, R[r.CHORD] * over
    R[r.BI2VEL] = where(twice.differs(0.0), over_b, b)
    R[r.CI2VEL] = where(twice.differs(0.0), over_c, c)
    R[r.ALPHA_WING] = R[r.ALPHA] + R[r.INCIDENCE]
    R[r.QBAR_AREA] = R[r.WING_AREA] * R[r.QBAR]


BODY, WIND_AXES, STABILITY, AXIAL_NORMAL = 0, 1, 2, 3


def _to_body(R: Rows, first: int, axes: int) -> None:
    """Turn a vector of aerodynamic axes into body axes, in place."""
    if axes == WIND_AXES:
        ca, sa, cb, sb = R[r.COS_ALPHA], R[r.SIN_ALPHA], R[r.COS_BETA], R[r.SIN_BETA]
        x, y, z = R[first], R[first + 1], R[first + 2]
        R[first] = ca * cb * x - ca * sb * y - sa * z
        R[first + 1] = sb * x + cb * y
        R[first + 2] = sa * cb * x - sa * sb * y + ca * z
    elif axes == STABILITY:
        ca, sa, x, z = R[r.COS_ALPHA], R[r.SIN_ALPHA], R[first], R[first + 2]
        R[first], R[first + 2] = ca * x - sa * z, sa * x + ca * z


@stage
def aerodynamics(R: Rows, forces: int, moments: int) -> None:
    """Take what the axes sum to into body axes at the centre of gravity (FGAerodynamics::Run).

    Args:
        R: registers; those of the native forces and moments are turned.
        forces: axes in which the model gives forces.
        moments: axes in which it gives moments.
    """
    if forces != BODY:  # drag and lift count backwards and upwards
        for i in (r.NATIVE, r.NATIVE + 2, r.NATIVE_AT_CG, r.NATIVE_AT_CG + 2):
            R[i] = -R[i]
        _to_body(R, r.NATIVE, forces)
        _to_body(R, r.NATIVE_AT_CG, forces)
    _to_body(R, r.NATIVE_MOMENT, moments)
    i, j, m = r.NATIVE, r.NATIVE_AT_CG, r.NATIVE_MOMENT
    ca, sa, cb, sb = R[r.COS_ALPHA], R[r.SIN_ALPHA], R[r.COS_BETA], R[r.SIN_BETA]
    fx, fy, fz = R[i], R[i + 1], R[i + 2]
    dx, dy, dz = arm(R, r.REFERENCE_POINT)
    dx = dx - R[r.REFERENCE_SHIFT] * R[r.CHORD]
    R[r.AERO_MOMENT] = R[m] + dy * fz - dz * fy
    R[r.AERO_MOMENT + 1] = R[m + 1] + dz * fx - dx * fz
    R[r.AERO_MOMENT + 2] = R[m + 2] + dx * fy - dy * fx
    fx, fy, fz = fx + R[j], fy + R[j + 1], fz + R[j + 2]
    R[r.AERO_FORCE], R[r.AERO_FORCE + 1], R[r.AERO_FORCE + 2] = fx, fy, fz
    R[r.WIND_FORCE] = -(ca * cb * fx + sb * fy + sa * cb * fz)
    R[r.WIND_FORCE + 1] = -ca * sb * fx + cb * fy - sa * sb * fz
    R[r.WIND_FORCE + 2] = -(-sa * fx + ca * fz)


@stage
def clear(R: Rows, first: int) -> None:
    """Set six registers to zero: a force and a moment that are summed anew."""
    for i in range(6):
        R[first + i] = 0.0


LOCAL, INERTIAL = 2, 3


@stage
def reaction(R: Rows, block: int, frame: int, is_moment: int) -> None:
    """Add one external force or moment (FGExternalForce, FGForce).

    Args:
        R: registers.
        block: first of magnitude, direction (3) and location (3, in, structural axes).
        frame: of the direction: BODY, WIND_AXES, LOCAL or INERTIAL.
        is_moment: 1 for a moment.
    """
    size = R[block]
    x, y, z = size * R[block + 1], size * R[block + 2], size * R[block + 3]
    if frame == WIND_AXES:
        ca, sa, cb, sb = R[r.COS_ALPHA], R[r.SIN_ALPHA], R[r.COS_BETA], R[r.SIN_BETA]
        x, y, z = ca * cb * x - ca * sb * y - sa * z, sb * x + cb * y, sa * cb * x - sa * sb * y + ca * z
    elif frame in (LOCAL, INERTIAL):
        i = r.LOCAL_TO_BODY if frame == LOCAL else r.INERTIAL_TO_BODY
        x, y, z = (
            R[i] * x + R[i + 1] * y + R[i + 2] * z,
            R[i + 3] * x + R[i + 4] * y + R[i + 5] * z,
            R[i + 6] * x + R[i + 7] * y + R[i + 8] * z,
        )
    if is_moment:
        _add(R, r.ADDED_MOMENT, x, y, z)
    else:
        dx, dy, dz = arm(R, block + 4)
        _add(R, r.ADDED_FORCE, x, y, z)
        _add(R, r.ADDED_MOMENT, dy * z - dz * y, dz * x - dx * z, dx * y - dy * x)


def _add(R: Rows, first: int, *vector: Lanes) -> None:
    """Add a vector to the registers from ``first`` on."""
    for i, x in enumerate(vector, start=first):
        R[i] += x


@stage
def thruster(R: Rows, block: int) -> None:
    """Add the thrust of one engine, its torque and the gyroscopic moment of what turns (FGThruster, FGPropeller).

    Args:
        R: registers.
        block: first of thrust (lbf), direction in body axes (3) and location (3, in, structural axes), torque (lbf ft)
            and angular momentum (slug ft2/s) about that direction.
    """
    thrust = R[block]
    ex, ey, ez = R[block + 1], R[block + 2], R[block + 3]
    x, y, z = thrust * ex, thrust * ey, thrust * ez
    torque, h = R[block + 7], R[block + 8]
    hx, hy, hz = ex * h, ey * h, ez * h
    p, q, s = R[r.RATE], R[r.RATE + 1], R[r.RATE + 2]
    dx, dy, dz = arm(R, block + 4)
    _add(R, r.ENGINE_FORCE, x, y, z)
    _add(
        R,
        r.ENGINE_MOMENT,
        q * hz - s * hy + ex * torque + (dy * z - dz * y),
        s * hx - p * hz + ey * torque + (dz * x - dx * z),
        p * hy - q * hx + ez * torque + (dx * y - dy * x),
    )


@stage
def accelerate(R: Rows) -> None:
    """End a frame: sum forces and moments, and take accelerations from them (FGAircraft, FGAccelerations)."""
    for i in range(3):
        R[r.FORCE + i] = R[r.AERO_FORCE + i] + R[r.ENGINE_FORCE + i] + R[r.ADDED_FORCE + i]
        R[r.MOMENT + i] = R[r.AERO_MOMENT + i] + R[r.ENGINE_MOMENT + i] + R[r.ADDED_MOMENT + i]
    i = r.INERTIAL_TO_BODY
    t11, t12, t13 = R[i], R[i + 1], R[i + 2]
    t21, t22, t23 = R[i + 3], R[i + 4], R[i + 5]
    t31, t32, t33 = R[i + 6], R[i + 7], R[i + 8]
    p, q, s = R[r.RATE], R[r.RATE + 1], R[r.RATE + 2]
    i = r.INERTIA
    Ixx, Iyy, Izz = R[i], R[i + 1], R[i + 2]
    Jxy, Jxz, Jyz = R[i + 3], R[i + 4], R[i + 5]
    hx, hy, hz = Ixx * p + Jxy * q + Jxz * s, Jxy * p + Iyy * q + Jyz * s, Jxz * p + Jyz * q + Izz * s
    roll = R[r.MOMENT] - (q * hz - s * hy)
    m = R[r.MOMENT + 1] - (s * hx - p * hz)
    n = R[r.MOMENT + 2] - (p * hy - q * hx)
    i = r.INERTIA_INVERSE
    k1, k2, k3, k4, k5, k6 = R[i], R[i + 1], R[i + 2], R[i + 3], R[i + 4], R[i + 5]
    pd, qd, sd = (k1 * roll + k2 * m + k3 * n, k2 * roll + k4 * m + k5 * n, k3 * roll + k5 * m + k6 * n)
    R[r.RATE_DOT], R[r.RATE_DOT + 1], R[r.RATE_DOT + 2] = pd, qd, sd
    ex, ey, ez = t13 * EARTH_RATE, t23 * EARTH_RATE, t33 * EARTH_RATE
    R[r.P_DOT] = pd + q * ez - s * ey
    R[r.Q_DOT] = qd + s * ex - p * ez
    R[r.R_DOT] = sd + p * ey - q * ex
    over = 1.0 / R[r.MASS]
    ax, ay, az = R[r.FORCE] * over, R[r.FORCE + 1] * over, R[r.FORCE + 2] * over
    R[r.BODY_ACCEL], R[r.BODY_ACCEL + 1], R[r.BODY_ACCEL + 2] = ax, ay, az
    u, v, w = R[r.U], R[r.V], R[r.W]
    wx, wy, wz = R[r.P] + 2.0 * ex, R[r.Q] + 2.0 * ey, R[r.R] + 2.0 * ez
    # omega x (omega x position) in inertial axes has no component along the Earth's axis
    cx, cy = -EARTH_RATE * EARTH_RATE * R[r.POSITION], -EARTH_RATE * EARTH_RATE * R[r.POSITION + 1]
    gx, gy, gz = R[r.GRAVITY], R[r.GRAVITY + 1], R[r.GRAVITY + 2]
    i = r.EARTH_TO_BODY
    R[r.U_DOT] = ax - (wy * w - wz * v) - (t11 * cx + t12 * cy) + (R[i] * gx + R[i + 1] * gy + R[i + 2] * gz)
    R[r.V_DOT] = ay - (wz * u - wx * w) - (t21 * cx + t22 * cy) + (R[i + 3] * gx + R[i + 4] * gy + R[i + 5] * gz)
    R[r.W_DOT] = az - (wx * v - wy * u) - (t31 * cx + t32 * cy) + (R[i + 6] * gx + R[i + 7] * gy + R[i + 8] * gz)
    ce, se = R[r.COS_EARTH], R[r.SIN_EARTH]
    R[r.VELOCITY_DOT] = t11 * ax + t21 * ay + t31 * az + ce * gx - se * gy
    R[r.VELOCITY_DOT + 1] = t12 * ax + t22 * ay + t32 * az + se * gx + ce * gy
    R[r.VELOCITY_DOT + 2] = t13 * ax + t23 * ay + t33 * az + gz
