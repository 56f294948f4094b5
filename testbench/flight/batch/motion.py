"""Motion of the rigid body over a turning, oblate Earth, as JSBSim 1.3.3 integrates it (FGPropagate, FGInertial).

Each kernel takes the registers R (register, flight) and does one stage of the frame for every flight. Position and
velocity are integrated in inertial axes, and everything local follows from them.
"""

from __future__ import annotations

import math

from testbench.core.record import FloatArray
from testbench.flight.batch import registers as r
from testbench.flight.batch.air import atan2, atmosphere
from testbench.flight.batch.compiled import LANES, compiled, lanes

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


@compiled
def place(
    R: FloatArray, h_ft: FloatArray, euler: FloatArray, uvw: FloatArray, pqr: FloatArray
) -> None:  # pragma: no cover
    """Set the initial state of every flight, over the equator at longitude 0 (FGPropagate::SetInitialState).

    Args:
        R: registers.
        h_ft: (flights,) above sea level.
        euler: (3, flights) phi, theta, psi.
        uvw: (3, flights) velocity over the ground, body axes, ft/s.
        pqr: (3, flights) against the Earth, rad/s.
    """
    R = lanes(R)
    for f in range(LANES):
        R[r.TIME, f] = 0.0
        R[r.EARTH_ANGLE, f] = 0.0
        x = _A + h_ft[f]
        R[r.POSITION, f], R[r.POSITION + 1, f], R[r.POSITION + 2, f] = x, 0.0, 0.0
        sp, cp = math.sin(0.5 * euler[0, f]), math.cos(0.5 * euler[0, f])
        st, ct = math.sin(0.5 * euler[1, f]), math.cos(0.5 * euler[1, f])
        ss, cs = math.sin(0.5 * euler[2, f]), math.cos(0.5 * euler[2, f])
        b0 = cp * ct * cs + sp * st * ss
        b1 = sp * ct * cs - cp * st * ss
        b2 = cp * st * cs + sp * ct * ss
        b3 = cp * ct * ss - sp * st * cs
        a0, a2 = math.sqrt(0.5), -math.sqrt(0.5)  # inertial to local axes there
        q0, q1, q2, q3 = a0 * b0 - a2 * b2, a0 * b1 + a2 * b3, a0 * b2 + a2 * b0, a0 * b3 - a2 * b1
        n = 1.0 / math.sqrt(q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
        q0, q1, q2, q3 = q0 * n, q1 * n, q2 * n, q3 * n
        R[r.ATTITUDE, f], R[r.ATTITUDE + 1, f], R[r.ATTITUDE + 2, f], R[r.ATTITUDE + 3, f] = q0, q1, q2, q3
        t11, t12, t13 = q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3, 2.0 * (q1 * q2 + q0 * q3), 2.0 * (q1 * q3 - q0 * q2)
        t21, t22, t23 = 2.0 * (q1 * q2 - q0 * q3), q0 * q0 - q1 * q1 + q2 * q2 - q3 * q3, 2.0 * (q2 * q3 + q0 * q1)
        t31, t32, t33 = 2.0 * (q1 * q3 + q0 * q2), 2.0 * (q2 * q3 - q0 * q1), q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3
        R[r.RATE, f] = pqr[0, f] + t13 * EARTH_RATE
        R[r.RATE + 1, f] = pqr[1, f] + t23 * EARTH_RATE
        R[r.RATE + 2, f] = pqr[2, f] + t33 * EARTH_RATE
        u, v, w = uvw[0, f], uvw[1, f], uvw[2, f]
        R[r.VELOCITY, f] = t11 * u + t21 * v + t31 * w
        R[r.VELOCITY + 1, f] = t12 * u + t22 * v + t32 * w + EARTH_RATE * x
        R[r.VELOCITY + 2, f] = t13 * u + t23 * v + t33 * w


@compiled
def begin(R: FloatArray) -> None:  # pragma: no cover
    """Fill the memory of the integrators with the present rates (FGPropagate::InitializeDerivatives)."""
    R = lanes(R)
    for f in range(LANES):
        for i in range(4):
            R[r.ATTITUDE_1 + i, f] = R[r.ATTITUDE_2 + i, f] = R[r.ATTITUDE_DOT + i, f]
        for i in range(3):
            R[r.RATE_1 + i, f] = R[r.RATE_2 + i, f] = R[r.RATE_DOT + i, f]
            R[r.POSITION_1 + i, f] = R[r.POSITION_2 + i, f] = R[r.VELOCITY + i, f]
            R[r.VELOCITY_1 + i, f] = R[r.VELOCITY_2 + i, f] = R[r.VELOCITY_DOT + i, f]


@compiled
def _step(R: FloatArray, value: int, rate: int, before: int, earlier: int, count: int) -> None:  # pragma: no cover
    """Integrate one vector by the rule of Adams and Bashforth of third order (FGPropagate::Integrate)."""
    R = lanes(R)
    c = (1.0 / 12.0) * R[r.DT, 0]
    for i in range(count):
        for f in range(LANES):
            new, old, older = R[rate + i, f], R[before + i, f], R[earlier + i, f]
            R[value + i, f] += c * (23.0 * new - 16.0 * old + 5.0 * older)
            R[earlier + i, f] = old
            R[before + i, f] = new


@compiled
def _integrate(R: FloatArray) -> None:  # pragma: no cover
    """Move by a frame: attitude, rates, position and velocity, in this order (FGPropagate::Run)."""
    _step(R, r.ATTITUDE, r.ATTITUDE_DOT, r.ATTITUDE_1, r.ATTITUDE_2, 4)
    _step(R, r.RATE, r.RATE_DOT, r.RATE_1, r.RATE_2, 3)
    _step(R, r.POSITION, r.VELOCITY, r.POSITION_1, r.POSITION_2, 3)
    _step(R, r.VELOCITY, r.VELOCITY_DOT, r.VELOCITY_1, r.VELOCITY_2, 3)
    R = lanes(R)
    for f in range(LANES):
        q0, q1, q2, q3 = R[r.ATTITUDE, f], R[r.ATTITUDE + 1, f], R[r.ATTITUDE + 2, f], R[r.ATTITUDE + 3, f]
        norm = math.sqrt(q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
        n = 1.0 if norm == 0.0 or math.fabs(norm - 1.0) < 1e-10 else 1.0 / norm
        R[r.ATTITUDE, f], R[r.ATTITUDE + 1, f], R[r.ATTITUDE + 2, f], R[r.ATTITUDE + 3, f] = (
            q0 * n,
            q1 * n,
            q2 * n,
            q3 * n,
        )
    dt = R[r.DT, 0]
    for f in range(LANES):
        R[r.TIME, f] += dt
        R[r.EARTH_ANGLE, f] += EARTH_RATE * dt


@compiled
def propagate(R: FloatArray) -> None:  # pragma: no cover
    """Begin a frame: motion, gravity and atmosphere (FGPropagate, FGInertial, FGStandardAtmosphere).

    Flights of a block have the same frame time. Each has its own clock, and the Earth below it has turned by as much.
    """
    if R[r.DT, 0] > 0.0:
        _integrate(R)
    turn_earth(R)
    _locate(R)
    _turn(R)
    atmosphere(R)


@compiled
def held(R: FloatArray, first: int) -> None:  # pragma: no cover
    """Begin a frame of a flight whose motion is given: :func:`propagate` without what it integrates.

    Args:
        R: registers.
        first: of height (ft), phi, theta, psi, velocity (3, ft/s) and rates (3, rad/s), see :func:`place`.
    """
    time = R[r.TIME].copy()
    place(R, R[first], R[first + 1 : first + 4], R[first + 4 : first + 7], R[first + 7 : first + 10])
    for f in range(LANES):
        R[r.TIME, f] = time[f] + R[r.DT, f]
    turn_earth(R)
    _locate(R)
    _turn(R)
    atmosphere(R)


@compiled
def turn_earth(R: FloatArray) -> None:  # pragma: no cover
    """Take cosine and sine of the Earth's angle, by their series within 45 degrees of a quarter turn.

    Those of the library are not vectorised, and cost a tenth of a frame. The terms left out are below 1e-17.
    """
    R = lanes(R)
    for f in range(LANES):
        angle = R[r.EARTH_ANGLE, f]
        quarter = math.floor(angle * (2.0 / math.pi) + 0.5)
        x = angle - quarter * (0.5 * math.pi)
        z = x * x
        s, c = 1.0, 1.0
        for n in (16.0, 14.0, 12.0, 10.0, 8.0, 6.0, 4.0, 2.0):
            s = 1.0 - s * z / (n * (n + 1.0))
        for n in (18.0, 16.0, 14.0, 12.0, 10.0, 8.0, 6.0, 4.0, 2.0):
            c = 1.0 - c * z / ((n - 1.0) * n)
        s *= x
        half = math.floor(0.5 * quarter)
        odd = quarter - 2.0 * half  # quarters of a turn, modulo 2
        sign = 1.0 - 2.0 * (half - 2.0 * math.floor(0.5 * half))
        R[r.COS_EARTH, f] = sign * ((1.0 - odd) * c - odd * s)
        R[r.SIN_EARTH, f] = sign * ((1.0 - odd) * s + odd * c)


@compiled
def _locate(R: FloatArray) -> None:  # pragma: no cover
    """Take location, height and gravity from the inertial position (FGLocation, FGInertial::GetGravityJ2).

    Geodetic latitude: T. Fukushima, Journal of Geodesy 79 (2006), pp. 689-693.
    """
    R = lanes(R)
    for f in range(LANES):
        ce, se = R[r.COS_EARTH, f], R[r.SIN_EARTH, f]
        x, y, z = R[r.POSITION, f], R[r.POSITION + 1, f], R[r.POSITION + 2, f]
        lx, ly, lz = ce * x + se * y, -se * x + ce * y, z
        R[r.LOCATION, f], R[r.LOCATION + 1, f], R[r.LOCATION + 2, f] = lx, ly, lz
        radius = math.sqrt(lx * lx + ly * ly + lz * lz)
        rxy = math.sqrt(lx * lx + ly * ly)
        sign = math.copysign(1.0, lz)
        s0 = math.fabs(lz)
        zc, c0 = _EC * s0, _EC * rxy
        c02, s02 = c0 * c0, s0 * s0
        a02 = c02 + s02
        a0 = math.sqrt(a02)
        a03 = a02 * a0
        s1 = zc * a03 + _C * s02 * s0
        c1 = rxy * a03 - _C * c02 * c0
        cs0c0 = _C * c0 * s0
        b0 = 1.5 * cs0c0 * ((rxy * s0 - zc * c0) * a0 - cs0c0)
        s1 = s1 * a03 - b0 * s0
        cc = _EC * (c1 * a03 - b0 * c0)
        over = 1.0 / math.sqrt(s1 * s1 + cc * cc)
        R[r.RADIUS, f] = radius
        R[r.SIN_LATITUDE, f], R[r.COS_LATITUDE, f] = sign * s1 * over, cc * over
        R[r.H_AGL, f] = (rxy * cc + s0 * math.fabs(s1) - _A * math.sqrt(_EC2 * s1 * s1 + cc * cc)) * over
        cos_gc, sin_gc = rxy / radius, lz / radius
        R[r.H_SL, f] = radius - _A * _EC / math.sqrt(1.0 - _E2 * cos_gc * cos_gc)
        a_r = _A / radius
        common = 1.5 * _J2 * a_r * a_r
        g = -_GM / (radius * radius)
        g_xy = g * (1.0 + common * (1.0 - 5.0 * sin_gc * sin_gc)) / radius
        g_z = g * (1.0 + common * (3.0 - 5.0 * sin_gc * sin_gc))
        R[r.GRAVITY, f], R[r.GRAVITY + 1, f], R[r.GRAVITY + 2, f] = g_xy * lx, g_xy * ly, g_z * sin_gc


@compiled
def _turn(R: FloatArray) -> None:  # pragma: no cover
    """Take matrices, velocities and rates in body axes from attitude and location (rest of FGPropagate::Run)."""
    R = lanes(R)
    for f in range(LANES):
        ce, se = R[r.COS_EARTH, f], R[r.SIN_EARTH, f]
        lx, ly = R[r.LOCATION, f], R[r.LOCATION + 1, f]
        rxy = math.sqrt(lx * lx + ly * ly)
        sin_lon, cos_lon = ly / rxy, lx / rxy
        sin_lat, cos_lat = R[r.SIN_LATITUDE, f], R[r.COS_LATITUDE, f]
        # local axes against earth-fixed ones, then against inertial ones
        e11, e12, e13 = -cos_lon * sin_lat, -sin_lon * sin_lat, cos_lat
        e21, e22 = -sin_lon, cos_lon
        e31, e32, e33 = -cos_lon * cos_lat, -sin_lon * cos_lat, -sin_lat
        n11, n12, n13 = e11 * ce - e12 * se, e11 * se + e12 * ce, e13
        n21, n22 = e21 * ce - e22 * se, e21 * se + e22 * ce
        n31, n32, n33 = e31 * ce - e32 * se, e31 * se + e32 * ce, e33
        q0, q1, q2, q3 = R[r.ATTITUDE, f], R[r.ATTITUDE + 1, f], R[r.ATTITUDE + 2, f], R[r.ATTITUDE + 3, f]
        t11, t12, t13 = q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3, 2.0 * (q1 * q2 + q0 * q3), 2.0 * (q1 * q3 - q0 * q2)
        t21, t22, t23 = 2.0 * (q1 * q2 - q0 * q3), q0 * q0 - q1 * q1 + q2 * q2 - q3 * q3, 2.0 * (q2 * q3 + q0 * q1)
        t31, t32, t33 = 2.0 * (q1 * q3 + q0 * q2), 2.0 * (q2 * q3 - q0 * q1), q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3
        i = r.INERTIAL_TO_BODY
        R[i, f], R[i + 1, f], R[i + 2, f] = t11, t12, t13
        R[i + 3, f], R[i + 4, f], R[i + 5, f] = t21, t22, t23
        R[i + 6, f], R[i + 7, f], R[i + 8, f] = t31, t32, t33
        l11, l12 = t11 * n11 + t12 * n12 + t13 * n13, t11 * n21 + t12 * n22
        l21, l22 = t21 * n11 + t22 * n12 + t23 * n13, t21 * n21 + t22 * n22
        l31, l32 = t31 * n11 + t32 * n12 + t33 * n13, t31 * n21 + t32 * n22
        l13 = t11 * n31 + t12 * n32 + t13 * n33
        l23 = t21 * n31 + t22 * n32 + t23 * n33
        l33 = t31 * n31 + t32 * n32 + t33 * n33
        i = r.LOCAL_TO_BODY
        R[i, f], R[i + 1, f], R[i + 2, f] = l11, l12, l13
        R[i + 3, f], R[i + 4, f], R[i + 5, f] = l21, l22, l23
        R[i + 6, f], R[i + 7, f], R[i + 8, f] = l31, l32, l33
        # earth-fixed to inertial is a turn by the Earth's angle
        i = r.EARTH_TO_BODY
        R[i, f], R[i + 1, f], R[i + 2, f] = t11 * ce + t12 * se, -t11 * se + t12 * ce, t13
        R[i + 3, f], R[i + 4, f], R[i + 5, f] = t21 * ce + t22 * se, -t21 * se + t22 * ce, t23
        R[i + 6, f], R[i + 7, f], R[i + 8, f] = t31 * ce + t32 * se, -t31 * se + t32 * ce, t33
        x, y = R[r.POSITION, f], R[r.POSITION + 1, f]
        vx, vy, vz = R[r.VELOCITY, f] + EARTH_RATE * y, R[r.VELOCITY + 1, f] - EARTH_RATE * x, R[r.VELOCITY + 2, f]
        u = t11 * vx + t12 * vy + t13 * vz
        v = t21 * vx + t22 * vy + t23 * vz
        w = t31 * vx + t32 * vy + t33 * vz
        R[r.U, f], R[r.V, f], R[r.W, f] = u, v, w
        p, q, s = R[r.RATE, f], R[r.RATE + 1, f], R[r.RATE + 2, f]
        R[r.P, f], R[r.Q, f], R[r.R, f] = p - t13 * EARTH_RATE, q - t23 * EARTH_RATE, s - t33 * EARTH_RATE
        R[r.ATTITUDE_DOT, f] = -0.5 * (q1 * p + q2 * q + q3 * s)
        R[r.ATTITUDE_DOT + 1, f] = 0.5 * (q0 * p - q3 * q + q2 * s)
        R[r.ATTITUDE_DOT + 2, f] = 0.5 * (q3 * p + q0 * q - q1 * s)
        R[r.ATTITUDE_DOT + 3, f] = 0.5 * (-q2 * p + q1 * q + q0 * s)
        R[r.V_NORTH, f] = l11 * u + l21 * v + l31 * w
        R[r.V_EAST, f] = l12 * u + l22 * v + l32 * w
        R[r.V_DOWN, f] = l13 * u + l23 * v + l33 * w


@compiled
def _angle(R: FloatArray, t: int, y: int, x: int) -> None:  # pragma: no cover
    R = lanes(R)
    for f in range(LANES):
        R[t, f] = atan2(R[y, f], R[x, f])


@compiled
def euler(R: FloatArray) -> None:  # pragma: no cover
    """Take bank, pitch and heading from the attitude (FGQuaternion, FGMatrix33::GetEuler)."""
    i = r.LOCAL_TO_BODY
    _angle(R, r.PHI, i + 5, i + 8)
    _angle(R, r.PSI, i + 1, i)
    R = lanes(R)
    for f in range(LANES):
        x = -R[i + 2, f]
        x = x if x < 1.0 else 1.0
        sine = x if x > -1.0 else -1.0
        R[r.THETA, f] = atan2(sine, math.sqrt((1.0 - sine) * (1.0 + sine)))
    for f in range(LANES):
        psi = R[r.PSI, f]
        R[r.PSI, f] = psi + 2.0 * math.pi if psi < 0.0 else psi


@compiled
def geography(R: FloatArray) -> None:  # pragma: no cover
    """Take longitude and latitudes from the location (FGLocation)."""
    R = lanes(R)
    for f in range(LANES):
        x, y, z = R[r.LOCATION, f], R[r.LOCATION + 1, f], R[r.LOCATION + 2, f]
        R[r.LONGITUDE, f] = math.atan2(y, x)
        R[r.LATITUDE, f] = math.atan2(z, math.sqrt(x * x + y * y))
        R[r.LATITUDE_GEODETIC, f] = math.atan(R[r.SIN_LATITUDE, f] / R[r.COS_LATITUDE, f])


@compiled
def euler_rates(R: FloatArray) -> None:  # pragma: no cover
    """Take the rates of bank, pitch and heading from the body's (FGAuxiliary)."""
    R = lanes(R)
    for f in range(LANES):
        p, q, s = R[r.P, f], R[r.Q, f], R[r.R, f]
        sin_phi, cos_phi = math.sin(R[r.PHI, f]), math.cos(R[r.PHI, f])
        sin_theta, cos_theta = -R[r.LOCAL_TO_BODY + 2, f], math.cos(R[r.THETA, f])
        R[r.THETA_DOT, f] = q * cos_phi - s * sin_phi
        if cos_theta != 0.0:
            psi_dot = (q * sin_phi + s * cos_phi) / cos_theta
            R[r.PSI_DOT, f] = psi_dot
            R[r.PHI_DOT, f] = p + psi_dot * sin_theta
