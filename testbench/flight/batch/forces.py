"""Forces and moments on the rigid body, and what they accelerate, as JSBSim 1.3.3 sums them.

FGAerodynamics, FGExternalForce, FGThruster, FGMassBalance and FGAccelerations. Each kernel takes the registers R
(register, flight) and does one stage of the frame for every flight.
"""

from __future__ import annotations

from testbench.core.record import FloatArray
from testbench.flight.batch import registers as r
from testbench.flight.batch.compiled import LANES, compiled, lanes
from testbench.flight.batch.motion import EARTH_RATE

_LB_SLUG = 1.0 / 32.174049


@compiled
def weigh(R: FloatArray) -> None:  # pragma: no cover
    """Invert the inertia (end of FGMassBalance::Run)."""
    R = lanes(R)
    for f in range(LANES):
        i = r.INERTIA
        Ixx, Iyy, Izz = R[i, f], R[i + 1, f], R[i + 2, f]
        Ixy, Ixz, Iyz = -R[i + 3, f], -R[i + 4, f], -R[i + 5, f]
        k1, k2, k3 = Iyy * Izz - Iyz * Iyz, Iyz * Ixz + Ixy * Izz, Ixy * Iyz + Iyy * Ixz
        over = 1.0 / (Ixx * k1 - Ixy * k2 - Ixz * k3)
        i = r.INERTIA_INVERSE
        R[i, f], R[i + 1, f], R[i + 2, f] = k1 * over, k2 * over, k3 * over
        R[i + 3, f] = (Izz * Ixx - Ixz * Ixz) * over
        R[i + 4, f] = (Ixy * Ixz + Iyz * Ixx) * over
        R[i + 5, f] = (Ixx * Iyy - Ixy * Ixy) * over
        R[r.MASS, f] = _LB_SLUG * R[r.WEIGHT, f]


@compiled
def motion_numbers(R: FloatArray) -> None:  # pragma: no cover
    """Set b/2V, c/2V and their like, after the functions that stand before the axes (FGAerodynamics::Run)."""
    R = lanes(R)
    for f in range(LANES):
        twice, b, c = 2.0 * R[r.VT, f], R[r.BI2VEL, f], R[r.CI2VEL, f]
        over_b, over_c = R[r.WING_SPAN, f] / twice, R[r.CHORD, f] / twice
        R[r.BI2VEL, f] = over_b if twice != 0.0 else b
        R[r.CI2VEL, f] = over_c if twice != 0.0 else c
        R[r.ALPHA_WING, f] = R[r.ALPHA, f] + R[r.INCIDENCE, f]
        R[r.QBAR_AREA, f] = R[r.WING_AREA, f] * R[r.QBAR, f]


BODY, WIND_AXES, STABILITY, AXIAL_NORMAL = 0, 1, 2, 3


@compiled
def _to_body(R: FloatArray, first: int, axes: int) -> None:  # pragma: no cover
    """Turn a vector of aerodynamic axes into body axes, in place."""
    R = lanes(R)
    if axes == WIND_AXES:
        for f in range(LANES):
            ca, sa, cb, sb = R[r.COS_ALPHA, f], R[r.SIN_ALPHA, f], R[r.COS_BETA, f], R[r.SIN_BETA, f]
            x, y, z = R[first, f], R[first + 1, f], R[first + 2, f]
            R[first, f] = ca * cb * x - ca * sb * y - sa * z
            R[first + 1, f] = sb * x + cb * y
            R[first + 2, f] = sa * cb * x - sa * sb * y + ca * z
    elif axes == STABILITY:
        for f in range(LANES):
            ca, sa, x, z = R[r.COS_ALPHA, f], R[r.SIN_ALPHA, f], R[first, f], R[first + 2, f]
            R[first, f], R[first + 2, f] = ca * x - sa * z, sa * x + ca * z


@compiled
def aerodynamics(R: FloatArray, forces: int, moments: int) -> None:  # pragma: no cover
    """Take what the axes sum to into body axes at the centre of gravity (FGAerodynamics::Run).

    Args:
        R: registers; those of the native forces and moments are turned.
        forces: axes in which the model gives forces.
        moments: axes in which it gives moments.
    """
    if forces != BODY:  # drag and lift count backwards and upwards
        for i in (r.NATIVE, r.NATIVE + 2, r.NATIVE_AT_CG, r.NATIVE_AT_CG + 2):
            for f in range(LANES):
                R[i, f] = -R[i, f]
        _to_body(R, r.NATIVE, forces)
        _to_body(R, r.NATIVE_AT_CG, forces)
    _to_body(R, r.NATIVE_MOMENT, moments)
    R = lanes(R)
    i, j, m, k = r.NATIVE, r.NATIVE_AT_CG, r.NATIVE_MOMENT, r.CG
    for f in range(LANES):
        ca, sa, cb, sb = R[r.COS_ALPHA, f], R[r.SIN_ALPHA, f], R[r.COS_BETA, f], R[r.SIN_BETA, f]
        fx, fy, fz = R[i, f], R[i + 1, f], R[i + 2, f]
        dx = (R[k, f] - R[r.REFERENCE_POINT, f]) / 12.0 - R[r.REFERENCE_SHIFT, f] * R[r.CHORD, f]
        dy = (R[r.REFERENCE_POINT + 1, f] - R[k + 1, f]) / 12.0
        dz = (R[k + 2, f] - R[r.REFERENCE_POINT + 2, f]) / 12.0
        R[r.AERO_MOMENT, f] = R[m, f] + dy * fz - dz * fy
        R[r.AERO_MOMENT + 1, f] = R[m + 1, f] + dz * fx - dx * fz
        R[r.AERO_MOMENT + 2, f] = R[m + 2, f] + dx * fy - dy * fx
        fx, fy, fz = fx + R[j, f], fy + R[j + 1, f], fz + R[j + 2, f]
        R[r.AERO_FORCE, f], R[r.AERO_FORCE + 1, f], R[r.AERO_FORCE + 2, f] = fx, fy, fz
        R[r.WIND_FORCE, f] = -(ca * cb * fx + sb * fy + sa * cb * fz)
        R[r.WIND_FORCE + 1, f] = -ca * sb * fx + cb * fy - sa * sb * fz
        R[r.WIND_FORCE + 2, f] = -(-sa * fx + ca * fz)


@compiled
def clear(R: FloatArray, first: int) -> None:  # pragma: no cover
    """Set six registers to zero: a force and a moment that are summed anew."""
    R = lanes(R)
    for i in range(6):
        for f in range(LANES):
            R[first + i, f] = 0.0


LOCAL, INERTIAL = 2, 3


@compiled
def reaction(R: FloatArray, block: int, frame: int, is_moment: int) -> None:  # pragma: no cover
    """Add one external force or moment (FGExternalForce, FGForce).

    Args:
        R: registers.
        block: first of magnitude, direction (3) and location (3, in, structural axes).
        frame: of the direction: BODY, WIND_AXES, LOCAL or INERTIAL.
        is_moment: 1 for a moment.
    """
    R = lanes(R)
    for f in range(LANES):
        size = R[block, f]
        x, y, z = size * R[block + 1, f], size * R[block + 2, f], size * R[block + 3, f]
        if frame == WIND_AXES:
            ca, sa, cb, sb = R[r.COS_ALPHA, f], R[r.SIN_ALPHA, f], R[r.COS_BETA, f], R[r.SIN_BETA, f]
            x, y, z = ca * cb * x - ca * sb * y - sa * z, sb * x + cb * y, sa * cb * x - sa * sb * y + ca * z
        elif frame in (LOCAL, INERTIAL):
            i = r.LOCAL_TO_BODY if frame == LOCAL else r.INERTIAL_TO_BODY
            x, y, z = (
                R[i, f] * x + R[i + 1, f] * y + R[i + 2, f] * z,
                R[i + 3, f] * x + R[i + 4, f] * y + R[i + 5, f] * z,
                R[i + 6, f] * x + R[i + 7, f] * y + R[i + 8, f] * z,
            )
        if is_moment:
            i = r.ADDED_MOMENT
            R[i, f] += x
            R[i + 1, f] += y
            R[i + 2, f] += z
        else:
            k = r.CG
            dx = (R[k, f] - R[block + 4, f]) / 12.0
            dy = (R[block + 5, f] - R[k + 1, f]) / 12.0
            dz = (R[k + 2, f] - R[block + 6, f]) / 12.0
            i = r.ADDED_FORCE
            R[i, f] += x
            R[i + 1, f] += y
            R[i + 2, f] += z
            i = r.ADDED_MOMENT
            R[i, f] += dy * z - dz * y
            R[i + 1, f] += dz * x - dx * z
            R[i + 2, f] += dx * y - dy * x


@compiled
def thruster(R: FloatArray, block: int) -> None:  # pragma: no cover
    """Add the thrust of one engine, its torque and the gyroscopic moment of what turns (FGThruster, FGPropeller).

    Args:
        R: registers.
        block: first of thrust (lbf), direction in body axes (3) and location (3, in, structural axes), torque (lbf ft)
            and angular momentum (slug ft2/s) about that direction.
    """
    R = lanes(R)
    for f in range(LANES):
        thrust, k = R[block, f], r.CG
        ex, ey, ez = R[block + 1, f], R[block + 2, f], R[block + 3, f]
        x, y, z = thrust * ex, thrust * ey, thrust * ez
        torque, h = R[block + 7, f], R[block + 8, f]
        hx, hy, hz = ex * h, ey * h, ez * h
        p, q, s = R[r.RATE, f], R[r.RATE + 1, f], R[r.RATE + 2, f]
        dx = (R[k, f] - R[block + 4, f]) / 12.0
        dy = (R[block + 5, f] - R[k + 1, f]) / 12.0
        dz = (R[k + 2, f] - R[block + 6, f]) / 12.0
        i = r.ENGINE_FORCE
        R[i, f] += x
        R[i + 1, f] += y
        R[i + 2, f] += z
        i = r.ENGINE_MOMENT
        R[i, f] += q * hz - s * hy + ex * torque + (dy * z - dz * y)
        R[i + 1, f] += s * hx - p * hz + ey * torque + (dz * x - dx * z)
        R[i + 2, f] += p * hy - q * hx + ez * torque + (dx * y - dy * x)


@compiled
def accelerate(R: FloatArray) -> None:  # pragma: no cover
    """End a frame: sum forces and moments, and take accelerations from them (FGAircraft, FGAccelerations)."""
    R = lanes(R)
    for i in range(3):
        for f in range(LANES):
            R[r.FORCE + i, f] = R[r.AERO_FORCE + i, f] + R[r.ENGINE_FORCE + i, f] + R[r.ADDED_FORCE + i, f]
            R[r.MOMENT + i, f] = R[r.AERO_MOMENT + i, f] + R[r.ENGINE_MOMENT + i, f] + R[r.ADDED_MOMENT + i, f]
    for f in range(LANES):
        i = r.INERTIAL_TO_BODY
        t11, t12, t13 = R[i, f], R[i + 1, f], R[i + 2, f]
        t21, t22, t23 = R[i + 3, f], R[i + 4, f], R[i + 5, f]
        t31, t32, t33 = R[i + 6, f], R[i + 7, f], R[i + 8, f]
        p, q, s = R[r.RATE, f], R[r.RATE + 1, f], R[r.RATE + 2, f]
        i = r.INERTIA
        Ixx, Iyy, Izz = R[i, f], R[i + 1, f], R[i + 2, f]
        Jxy, Jxz, Jyz = R[i + 3, f], R[i + 4, f], R[i + 5, f]
        hx, hy, hz = Ixx * p + Jxy * q + Jxz * s, Jxy * p + Iyy * q + Jyz * s, Jxz * p + Jyz * q + Izz * s
        roll = R[r.MOMENT, f] - (q * hz - s * hy)
        m = R[r.MOMENT + 1, f] - (s * hx - p * hz)
        n = R[r.MOMENT + 2, f] - (p * hy - q * hx)
        i = r.INERTIA_INVERSE
        k1, k2, k3, k4, k5, k6 = R[i, f], R[i + 1, f], R[i + 2, f], R[i + 3, f], R[i + 4, f], R[i + 5, f]
        pd, qd, sd = (k1 * roll + k2 * m + k3 * n, k2 * roll + k4 * m + k5 * n, k3 * roll + k5 * m + k6 * n)
        R[r.RATE_DOT, f], R[r.RATE_DOT + 1, f], R[r.RATE_DOT + 2, f] = pd, qd, sd
        ex, ey, ez = t13 * EARTH_RATE, t23 * EARTH_RATE, t33 * EARTH_RATE
        R[r.P_DOT, f] = pd + q * ez - s * ey
        R[r.Q_DOT, f] = qd + s * ex - p * ez
        R[r.R_DOT, f] = sd + p * ey - q * ex
        mass = R[r.MASS, f]
        ax, ay, az = R[r.FORCE, f] / mass, R[r.FORCE + 1, f] / mass, R[r.FORCE + 2, f] / mass
        R[r.BODY_ACCEL, f], R[r.BODY_ACCEL + 1, f], R[r.BODY_ACCEL + 2, f] = ax, ay, az
        u, v, w = R[r.U, f], R[r.V, f], R[r.W, f]
        wx, wy, wz = R[r.P, f] + 2.0 * ex, R[r.Q, f] + 2.0 * ey, R[r.R, f] + 2.0 * ez
        # omega x (omega x position) in inertial axes has no component along the Earth's axis
        cx, cy = -EARTH_RATE * EARTH_RATE * R[r.POSITION, f], -EARTH_RATE * EARTH_RATE * R[r.POSITION + 1, f]
        gx, gy, gz = R[r.GRAVITY, f], R[r.GRAVITY + 1, f], R[r.GRAVITY + 2, f]
        i = r.EARTH_TO_BODY
        R[r.U_DOT, f] = (
            ax - (wy * w - wz * v) - (t11 * cx + t12 * cy) + (R[i, f] * gx + R[i + 1, f] * gy + R[i + 2, f] * gz)
        )
        R[r.V_DOT, f] = (
            ay - (wz * u - wx * w) - (t21 * cx + t22 * cy) + (R[i + 3, f] * gx + R[i + 4, f] * gy + R[i + 5, f] * gz)
        )
        R[r.W_DOT, f] = (
            az - (wx * v - wy * u) - (t31 * cx + t32 * cy) + (R[i + 6, f] * gx + R[i + 7, f] * gy + R[i + 8, f] * gz)
        )
        ce, se = R[r.COS_EARTH, f], R[r.SIN_EARTH, f]
        R[r.VELOCITY_DOT, f] = t11 * ax + t21 * ay + t31 * az + ce * gx - se * gy
        R[r.VELOCITY_DOT + 1, f] = t12 * ax + t22 * ay + t32 * az + se * gx + ce * gy
        R[r.VELOCITY_DOT + 2, f] = t13 * ax + t23 * ay + t33 * az + gz
