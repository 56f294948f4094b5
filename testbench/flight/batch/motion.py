"""Motion of the rigid body over a turning, oblate Earth, as JSBSim 1.3.3 integrates it (FGPropagate, FGInertial).

Each kernel takes the registers R (register, flight) and does one stage of the frame for every flight. Position and
velocity are integrated in inertial axes, and everything local follows from them.
"""

from __future__ import annotations

import math

from testbench.flight.batch import registers as r
from testbench.flight.batch.air import atmosphere
from testbench.flight.batch.vector import Rows, atan2, branch, copysign, fabs, sincos, sometimes, sqrt, stage, where

# FGInertial: WGS 84, ft and ft3/s2
EARTH_RATE = 0.00007292115
_GM = 14.0764417572e15
_J2 = 1.08262982e-03
_A = 20925646.32546
_B = 20855486.5951
_EC = _B / _A
_EC2 = _EC * _EC
_E2 = 1.0 - _EC2
_C = _A * _E2


def place(R: Rows, at: Rows, first: int = 0) -> None:
    """Set the initial state of every flight, over the equator at longitude 0 (FGPropagate::SetInitialState).

    Args:
        R: registers.
        at: rows in which height above sea level (ft), phi, theta, psi, velocity over the ground (3, ft/s, body axes)
            and rates against the Earth (3, rad/s) stand.
        first: of them.
    """
    h_ft, phi, theta, psi, u, v, w, p, q, s = (at[first + k] for k in range(10))
    R[r.TIME] = 0.0
    R[r.EARTH_ANGLE] = 0.0
    x = _A + h_ft
    R[r.POSITION], R[r.POSITION + 1], R[r.POSITION + 2] = x, 0.0, 0.0
    (sp, cp), (st, ct), (ss, cs) = (sincos(0.5 * x) for x in (phi, theta, psi))
    b0 = cp * ct * cs + sp * st * ss
    b1 = sp * ct * cs - cp * st * ss
    b2 = cp * st * cs + sp * ct * ss
    b3 = cp * ct * ss - sp * st * cs
    a0, a2 = math.sqrt(0.5), -math.sqrt(0.5)  # inertial to local axes there
    q0, q1, q2, q3 = a0 * b0 - a2 * b2, a0 * b1 + a2 * b3, a0 * b2 + a2 * b0, a0 * b3 - a2 * b1
    n = 1.0 / sqrt(q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
    q0, q1, q2, q3 = q0 * n, q1 * n, q2 * n, q3 * n
    R[r.ATTITUDE], R[r.ATTITUDE + 1], R[r.ATTITUDE + 2], R[r.ATTITUDE + 3] = q0, q1, q2, q3
    t11, t12, t13 = q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3, 2.0 * (q1 * q2 + q0 * q3), 2.0 * (q1 * q3 - q0 * q2)
    t21, t22, t23 = 2.0 * (q1 * q2 - q0 * q3), q0 * q0 - q1 * q1 + q2 * q2 - q3 * q3, 2.0 * (q2 * q3 + q0 * q1)
    t31, t32, t33 = 2.0 * (q1 * q3 + q0 * q2), 2.0 * (q2 * q3 - q0 * q1), q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3
    R[r.RATE] = p + t13 * EARTH_RATE
    R[r.RATE + 1] = q + t23 * EARTH_RATE
    R[r.RATE + 2] = s + t33 * EARTH_RATE
    R[r.VELOCITY] = t11 * u + t21 * v + t31 * w
    R[r.VELOCITY + 1] = t12 * u + t22 * v + t32 * w + EARTH_RATE * x
    R[r.VELOCITY + 2] = t13 * u + t23 * v + t33 * w


@stage
def begin(R: Rows) -> None:
    """Fill the memory of the integrators with the present rates (FGPropagate::InitializeDerivatives)."""
    for i in range(4):
        R[r.ATTITUDE_1 + i] = R[r.ATTITUDE_2 + i] = R[r.ATTITUDE_DOT + i]
    for i in range(3):
        R[r.RATE_1 + i] = R[r.RATE_2 + i] = R[r.RATE_DOT + i]
        R[r.POSITION_1 + i] = R[r.POSITION_2 + i] = R[r.VELOCITY + i]
        R[r.VELOCITY_1 + i] = R[r.VELOCITY_2 + i] = R[r.VELOCITY_DOT + i]


def _step(R: Rows, value: int, rate: int, before: int, earlier: int, count: int) -> None:
    """Integrate one vector by the rule of Adams and Bashforth of third order (FGPropagate::Integrate)."""
    c = (1.0 / 12.0) * R[r.DT]
    for i in range(count):
        new, old, older = R[rate + i], R[before + i], R[earlier + i]
        R[value + i] += c * (23.0 * new - 16.0 * old + 5.0 * older)
        R[earlier + i] = old
        R[before + i] = new


@stage
def _integrate(R: Rows) -> None:
    """Move by a frame: attitude, rates, position and velocity, in this order (FGPropagate::Run)."""
    _step(R, r.ATTITUDE, r.ATTITUDE_DOT, r.ATTITUDE_1, r.ATTITUDE_2, 4)
    _step(R, r.RATE, r.RATE_DOT, r.RATE_1, r.RATE_2, 3)
    _step(R, r.POSITION, r.VELOCITY, r.POSITION_1, r.POSITION_2, 3)
    _step(R, r.VELOCITY, r.VELOCITY_DOT, r.VELOCITY_1, r.VELOCITY_2, 3)
    q0, q1, q2, q3 = R[r.ATTITUDE], R[r.ATTITUDE + 1], R[r.ATTITUDE + 2], R[r.ATTITUDE + 3]
    norm = sqrt(q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
    n = sometimes(norm.differs(0.0) & ~(fabs(norm - 1.0) < 1e-10), lambda: 1.0 / norm, 1.0)
    R[r.ATTITUDE], R[r.ATTITUDE + 1], R[r.ATTITUDE + 2], R[r.ATTITUDE + 3] = q0 * n, q1 * n, q2 * n, q3 * n
    dt = R[r.DT]
    R[r.TIME] += dt
    R[r.EARTH_ANGLE] += EARTH_RATE * dt


@stage
def propagate(R: Rows) -> None:
    """Begin a frame: motion, gravity and atmosphere (FGPropagate, FGInertial, FGStandardAtmosphere).

    Flights of a block have the same frame time. Each has its own clock, and the Earth below it has turned by as much.
    """
    with branch(R[r.DT] > 0.0):
        _integrate(R)
    turn_earth(R)
    _locate(R)
    _turn(R)
    atmosphere(R)


@stage
def held(R: Rows, first: int) -> None:
    """Begin a frame of a flight whose motion is given: :func:`propagate` without what it integrates.

    Args:
        R: registers.
        first: of height (ft), phi, theta, psi, velocity (3, ft/s) and rates (3, rad/s), see :func:`place`.
    """
    time = R[r.TIME] + R[r.DT]
    place(R, R, first)
    R[r.TIME] = time
    turn_earth(R)
    _locate(R)
    _turn(R)
    atmosphere(R)


def turn_earth(R: Rows) -> None:
    """Take cosine and sine of the Earth's angle."""
    R[r.SIN_EARTH], R[r.COS_EARTH] = sincos(R[r.EARTH_ANGLE])


def _locate(R: Rows) -> None:
    """Take location, height and gravity from the inertial position (FGLocation, FGInertial::GetGravityJ2).

    Geodetic latitude: T. Fukushima, Journal of Geodesy 79 (2006), pp. 689-693.
    """
    ce, se = R[r.COS_EARTH], R[r.SIN_EARTH]
    x, y, z = R[r.POSITION], R[r.POSITION + 1], R[r.POSITION + 2]
    lx, ly, lz = ce * x + se * y, -se * x + ce * y, z
    R[r.LOCATION], R[r.LOCATION + 1], R[r.LOCATION + 2] = lx, ly, lz
    rxy2 = lx * lx + ly * ly
    radius, rxy = sqrt(rxy2 + lz * lz), sqrt(rxy2)
    sign = copysign(1.0, lz)
    s0 = fabs(lz)
    zc, c0 = _EC * s0, _EC * rxy
    c02, s02 = c0 * c0, s0 * s0
    a02 = c02 + s02
    a0 = sqrt(a02)
    a03 = a02 * a0
    s1 = zc * a03 + _C * s02 * s0
    c1 = rxy * a03 - _C * c02 * c0
    cs0c0 = _C * c0 * s0
    b0 = 1.5 * cs0c0 * ((rxy * s0 - zc * c0) * a0 - cs0c0)
    s1 = s1 * a03 - b0 * s0
    cc = _EC * (c1 * a03 - b0 * c0)
    over = 1.0 / sqrt(s1 * s1 + cc * cc)
    R[r.RADIUS] = radius
    R[r.SIN_LATITUDE], R[r.COS_LATITUDE] = sign * s1 * over, cc * over
    R[r.H_AGL] = (rxy * cc + s0 * fabs(s1) - _A * sqrt(_EC2 * s1 * s1 + cc * cc)) * over
    inverse = 1.0 / radius
    cos_gc, sin_gc = rxy * inverse, lz * inverse
    R[r.H_SL] = radius - _A * _EC / sqrt(1.0 - _E2 * cos_gc * cos_gc)
    a_r = _A * inverse
    common = 1.5 * _J2 * a_r * a_r
    g = -_GM * (inverse * inverse)
    g_xy = g * (1.0 + common * (1.0 - 5.0 * sin_gc * sin_gc)) * inverse
    g_z = g * (1.0 + common * (3.0 - 5.0 * sin_gc * sin_gc))
    R[r.GRAVITY], R[r.GRAVITY + 1], R[r.GRAVITY + 2] = g_xy * lx, g_xy * ly, g_z * sin_gc


def _turn(R: Rows) -> None:
    """Take matrices, velocities and rates in body axes from attitude and location (rest of FGPropagate::Run)."""
    ce, se = R[r.COS_EARTH], R[r.SIN_EARTH]
    lx, ly = R[r.LOCATION], R[r.LOCATION + 1]
    inverse = 1.0 / sqrt(lx * lx + ly * ly)
    sin_lon, cos_lon = ly * inverse, lx * inverse
    sin_lat, cos_lat = R[r.SIN_LATITUDE], R[r.COS_LATITUDE]
    # local axes against earth-fixed ones, then against inertial ones
    e11, e12, e13 = -cos_lon * sin_lat, -sin_lon * sin_lat, cos_lat
    e21, e22 = -sin_lon, cos_lon
    e31, e32, e33 = -cos_lon * cos_lat, -sin_lon * cos_lat, -sin_lat
    n11, n12, n13 = e11 * ce - e12 * se, e11 * se + e12 * ce, e13
    n21, n22 = e21 * ce - e22 * se, e21 * se + e22 * ce
    n31, n32, n33 = e31 * ce - e32 * se, e31 * se + e32 * ce, e33
    q0, q1, q2, q3 = R[r.ATTITUDE], R[r.ATTITUDE + 1], R[r.ATTITUDE + 2], R[r.ATTITUDE + 3]
    t11, t12, t13 = q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3, 2.0 * (q1 * q2 + q0 * q3), 2.0 * (q1 * q3 - q0 * q2)
    t21, t22, t23 = 2.0 * (q1 * q2 - q0 * q3), q0 * q0 - q1 * q1 + q2 * q2 - q3 * q3, 2.0 * (q2 * q3 + q0 * q1)
    t31, t32, t33 = 2.0 * (q1 * q3 + q0 * q2), 2.0 * (q2 * q3 - q0 * q1), q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3
    i = r.INERTIAL_TO_BODY
    R[i], R[i + 1], R[i + 2] = t11, t12, t13
    R[i + 3], R[i + 4], R[i + 5] = t21, t22, t23
    R[i + 6], R[i + 7], R[i + 8] = t31, t32, t33
    l11, l12 = t11 * n11 + t12 * n12 + t13 * n13, t11 * n21 + t12 * n22
    l21, l22 = t21 * n11 + t22 * n12 + t23 * n13, t21 * n21 + t22 * n22
    l31, l32 = t31 * n11 + t32 * n12 + t33 * n13, t31 * n21 + t32 * n22
    l13 = t11 * n31 + t12 * n32 + t13 * n33
    l23 = t21 * n31 + t22 * n32 + t23 * n33
    l33 = t31 * n31 + t32 * n32 + t33 * n33
    i = r.LOCAL_TO_BODY
    R[i], R[i + 1], R[i + 2] = l11, l12, l13
    R[i + 3], R[i + 4], R[i + 5] = l21, l22, l23
    R[i + 6], R[i + 7], R[i + 8] = l31, l32, l33
    # earth-fixed to inertial is a turn by the Earth's angle
    i = r.EARTH_TO_BODY
    R[i], R[i + 1], R[i + 2] = t11 * ce + t12 * se, -t11 * se + t12 * ce, t13
    R[i + 3], R[i + 4], R[i + 5] = t21 * ce + t22 * se, -t21 * se + t22 * ce, t23
    R[i + 6], R[i + 7], R[i + 8] = t31 * ce + t32 * se, -t31 * se + t32 * ce, t33
    x, y = R[r.POSITION], R[r.POSITION + 1]
    vx, vy, vz = R[r.VELOCITY] + EARTH_RATE * y, R[r.VELOCITY + 1] - EARTH_RATE * x, R[r.VELOCITY + 2]
    u = t11 * vx + t12 * vy + t13 * vz
    v = t21 * vx + t22 * vy + t23 * vz
    w = t31 * vx + t32 * vy + t33 * vz
    R[r.U], R[r.V], R[r.W] = u, v, w
    p, q, s = R[r.RATE], R[r.RATE + 1], R[r.RATE + 2]
    R[r.P], R[r.Q], R[r.R] = p - t13 * EARTH_RATE, q - t23 * EARTH_RATE, s - t33 * EARTH_RATE
    R[r.ATTITUDE_DOT] = -0.5 * (q1 * p + q2 * q + q3 * s)
    R[r.ATTITUDE_DOT + 1] = 0.5 * (q0 * p - q3 * q + q2 * s)
    R[r.ATTITUDE_DOT + 2] = 0.5 * (q3 * p + q0 * q - q1 * s)
    R[r.ATTITUDE_DOT + 3] = 0.5 * (-q2 * p + q1 * q + q0 * s)
    R[r.V_NORTH] = l11 * u + l21 * v + l31 * w
    R[r.V_EAST] = l12 * u + l22 * v + l32 * w
    R[r.V_DOWN] = l13 * u + l23 * v + l33 * w


@stage
def euler(R: Rows) -> None:
    """Take bank, pitch and heading from the attitude (FGQuaternion, FGMatrix33::GetEuler)."""
    i = r.LOCAL_TO_BODY
    R[r.PHI] = atan2(R[i + 5], R[i + 8])
    x = -R[i + 2]
    x = where(x < 1.0, x, 1.0)
    sine = where(x > -1.0, x, -1.0)
    R[r.THETA] = atan2(sine, sqrt((1.0 - sine) * (1.0 + sine)))
    psi = atan2(R[i + 1], R[i])
    R[r.PSI] = where(psi < 0.0, psi + 2.0 * math.pi, psi)


@stage
def geography(R: Rows) -> None:
    """Take longitude and latitudes from the location (FGLocation)."""
    x, y, z = R[r.LOCATION], R[r.LOCATION + 1], R[r.LOCATION + 2]
    R[r.LONGITUDE] = atan2(y, x)
    R[r.LATITUDE] = atan2(z, sqrt(x * x + y * y))
    R[r.LATITUDE_GEODETIC] = atan2(R[r.SIN_LATITUDE], R[r.COS_LATITUDE])


@stage
def euler_rates(R: Rows) -> None:
    """Take the rates of bank, pitch and heading from the body's (FGAuxiliary)."""
    p, q, s = R[r.P], R[r.Q], R[r.R]
    (sin_phi, cos_phi), (_, cos_theta) = sincos(R[r.PHI]), sincos(R[r.THETA])
    sin_theta = -R[r.LOCAL_TO_BODY + 2]
    R[r.THETA_DOT] = q * cos_phi - s * sin_phi
    upright, psi_dot = cos_theta.differs(0.0), (q * sin_phi + s * cos_phi) / cos_theta
    R[r.PSI_DOT] = where(upright, psi_dot, R[r.PSI_DOT])
    R[r.PHI_DOT] = where(upright, p + psi_dot * sin_theta, R[r.PHI_DOT])
