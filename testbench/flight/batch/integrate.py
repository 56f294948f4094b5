"""The rigid body and its air, frame by frame, as JSBSim computes them (source of JSBSim 1.3.3, file by file below).

Each kernel takes the registers R (register, flight) and does one stage of the frame for every flight. The Earth turns
and is an ellipsoid: position and velocity are integrated in inertial axes, and everything local follows from them.
"""

from __future__ import annotations

import math

from testbench.core.record import FloatArray
from testbench.flight.batch import registers as r
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
# FGAtmosphere, FGStandardAtmosphere
_FT_M = 0.3048
_KG_SLUG = 0.06852168
_R_STAR = 8.31432 * _KG_SLUG / (1.8 * (_FT_M * _FT_M))
_M_AIR = 28.9645 * _KG_SLUG / 1000.0
GAS_CONSTANT = _R_STAR / _M_AIR
_G0 = 9.80665 / _FT_M
_EARTH_RADIUS = 6356766.0 / _FT_M
SEA_LEVEL_T = 518.67
SEA_LEVEL_P = 2116.228
SEA_LEVEL_RHO = SEA_LEVEL_P / (GAS_CONSTANT * SEA_LEVEL_T)
SEA_LEVEL_A = math.sqrt(1.4 * GAS_CONSTANT * SEA_LEVEL_T)
_LAYERS = (0.0, 36089.2388, 65616.7979, 104986.8766)  # geopotential ft; the wheel's own table goes on above
_TEMPERATURES = (518.67, 389.97, 389.97, 411.57)
_LAPSE_0 = (_TEMPERATURES[1] - _TEMPERATURES[0]) / (_LAYERS[1] - _LAYERS[0])
_LAPSE_2 = (_TEMPERATURES[3] - _TEMPERATURES[2]) / (_LAYERS[3] - _LAYERS[2])
_P_1 = SEA_LEVEL_P * math.pow(SEA_LEVEL_T / (SEA_LEVEL_T + _LAPSE_0 * _LAYERS[1]), _G0 / (GAS_CONSTANT * _LAPSE_0))
_P_2 = _P_1 * math.exp(-_G0 * (_LAYERS[2] - _LAYERS[1]) / (GAS_CONSTANT * _TEMPERATURES[1]))
TOP_FT = 100000.0
"""Height above which this atmosphere does not hold."""
_SUTHERLAND, _BETA = 198.72, 2.269690e-08
# FGAuxiliary
_STANDARD_G = 9.80665 / _FT_M
_LB_SLUG = 1.0 / 32.174049


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
    _turn_earth(R)
    _locate(R)
    _turn(R)
    _air(R)


@compiled
def _turn_earth(R: FloatArray) -> None:  # pragma: no cover
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
def _air(R: FloatArray) -> None:  # pragma: no cover
    """Take the standard atmosphere at the height, and the wind as it is set (FGStandardAtmosphere, FGWinds)."""
    R = lanes(R)
    for f in range(LANES):
        h = R[r.H_SL, f]
        H = h * _EARTH_RADIUS / (_EARTH_RADIUS + h)
        if _LAYERS[1] > H:
            T = SEA_LEVEL_T + _LAPSE_0 * H
            pressure = SEA_LEVEL_P * math.pow(SEA_LEVEL_T / T, _G0 / (GAS_CONSTANT * _LAPSE_0))
        elif _LAYERS[2] > H:
            T = _TEMPERATURES[1]
            pressure = _P_1 * math.exp(-_G0 * (H - _LAYERS[1]) / (GAS_CONSTANT * T))
        else:
            T = _TEMPERATURES[2] + _LAPSE_2 * (H - _LAYERS[2])
            pressure = _P_2 * math.pow(_TEMPERATURES[2] / T, _G0 / (GAS_CONSTANT * _LAPSE_2))
        R[r.TEMPERATURE, f], R[r.PRESSURE, f] = T, pressure
    for f in range(LANES):
        T = R[r.TEMPERATURE, f]
        R[r.DENSITY, f] = R[r.PRESSURE, f] / (GAS_CONSTANT * T)
        R[r.SOUND_SPEED, f] = math.sqrt(1.4 * GAS_CONSTANT * T)
    for i in range(3):
        for f in range(LANES):
            R[r.WIND + i, f] = R[r.GUST + i, f]


_ARCTAN = tuple((-1.0) ** n / (2.0 * n + 1.0) for n in range(20, -1, -1))
"""Coefficients of the series of atan(x) / x in x^2, highest first; for |x| <= tan 22.5 deg the rest is below 1e-17."""


@compiled
def _atan2(y: float, x: float) -> float:  # pragma: no cover
    """Return the angle of (x, y), 0 if both are 0: that of the library is not vectorised."""
    a, b = math.fabs(x), math.fabs(y)
    flat = b <= a
    small, large = (b if flat else a), (a if flat else b)
    above = small > 0.41421356237309503 * large
    t = (small - large if above else small) / ((small + large if above else large) + 1e-300)
    z = t * t
    p = 0.0
    for c in _ARCTAN[:11]:  # two short loops, which the compiler unrolls
        p = p * z + c
    for c in _ARCTAN[11:]:
        p = p * z + c
    p *= t
    p = p + 0.25 * math.pi if above else p
    p = p if flat else 0.5 * math.pi - p
    p = math.pi - p if x < 0.0 else p
    return math.copysign(p, y)


@compiled
def _angle(R: FloatArray, t: int, y: int, x: int) -> None:  # pragma: no cover
    R = lanes(R)
    for f in range(LANES):
        R[t, f] = _atan2(R[y, f], R[x, f])


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
        R[r.THETA, f] = _atan2(sine, math.sqrt((1.0 - sine) * (1.0 + sine)))
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


@compiled
def altitudes(R: FloatArray) -> None:  # pragma: no cover
    """Set the heights at which the standard atmosphere has this density, and this pressure (FGStandardAtmosphere)."""
    R = lanes(R)
    for f in range(LANES):
        for k in range(2):
            x = R[r.DENSITY, f] if k == 0 else R[r.PRESSURE, f]
            over = GAS_CONSTANT if k == 0 else 1.0
            first, second = _P_1, _P_2
            ground = SEA_LEVEL_P
            if k == 0:
                first, second = _P_1 / (over * _TEMPERATURES[1]), _P_2 / (over * _TEMPERATURES[2])
                ground = SEA_LEVEL_P / (over * _TEMPERATURES[0])
            if x >= first:
                power = -GAS_CONSTANT * _LAPSE_0 / _G0
                if k == 0:
                    power = -1.0 / (1.0 + _G0 / (GAS_CONSTANT * _LAPSE_0))
                H = _LAYERS[0] + (_TEMPERATURES[0] / _LAPSE_0) * (math.pow(x / ground, power) - 1.0)
            elif x >= second:
                H = _LAYERS[1] - GAS_CONSTANT * _TEMPERATURES[1] / _G0 * math.log(x / first)
            else:
                power = -GAS_CONSTANT * _LAPSE_2 / _G0
                if k == 0:
                    power = -1.0 / (1.0 + _G0 / (GAS_CONSTANT * _LAPSE_2))
                H = _LAYERS[2] + (_TEMPERATURES[2] / _LAPSE_2) * (math.pow(x / second, power) - 1.0)
            R[r.DENSITY_ALTITUDE + k, f] = H * _EARTH_RADIUS / (_EARTH_RADIUS - H)


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
def _mach_of(impact: float) -> float:  # pragma: no cover
    """Return the Mach number at sea level that gives an impact pressure (FGAuxiliary::MachFromImpactPressure)."""
    A = impact / SEA_LEVEL_P + 1.0
    M = math.sqrt(5.0 * (math.pow(A, 1.0 / 3.5) - 1.0))
    if M > 1.0:
        coefficient = math.pow(1.2, -0.25 * 7.0) * math.pow(1.2 / 1.4, -0.5 * 2.5)
        for _ in range(10):
            M = coefficient * math.sqrt(A * math.pow(1.0 - 1.0 / (7.0 * M * M), 2.5))
    return M


@compiled
def auxiliary(R: FloatArray) -> None:  # pragma: no cover
    """Take the motion through the air from that over the ground (FGAuxiliary); accelerations are the last frame's."""
    R = lanes(R)
    i = r.LOCAL_TO_BODY
    for f in range(LANES):
        wn, we, wd = R[r.WIND, f], R[r.WIND + 1, f], R[r.WIND + 2, f]
        R[r.P_AERO, f], R[r.Q_AERO, f], R[r.R_AERO, f] = R[r.P, f], R[r.Q, f], R[r.R, f]
        u = R[r.U, f] - (R[i, f] * wn + R[i + 1, f] * we + R[i + 2, f] * wd)
        v = R[r.V, f] - (R[i + 3, f] * wn + R[i + 4, f] * we + R[i + 5, f] * wd)
        w = R[r.W, f] - (R[i + 6, f] * wn + R[i + 7, f] * we + R[i + 8, f] * wd)
        R[r.U_AERO, f], R[r.V_AERO, f], R[r.W_AERO, f] = u, v, w
        u2, v2, w2 = u * u, v * v, w * w
        uw = u2 + w2
        vt2 = uw + v2
        vt, root = math.sqrt(vt2), math.sqrt(uw)
        moves, forward = vt > 0.001, uw >= 1e-6
        ud, vd, wd = R[r.U_DOT, f], R[r.V_DOT, f], R[r.W_DOT, f]
        vt_dot = (u * ud + v * vd + w * wd) / vt
        alpha_dot, beta_dot = (u * wd - w * ud) / uw, (vd * vt - v * vt_dot) / (vt * root)
        R[r.ALPHA_DOT, f] = alpha_dot if moves and forward else 0.0
        R[r.BETA_DOT, f] = beta_dot if moves and forward else 0.0
        R[r.COS_ALPHA, f] = u / root if moves and forward else 1.0
        R[r.SIN_ALPHA, f] = w / root if moves and forward else 0.0
        R[r.COS_BETA, f] = root / vt if moves else 1.0
        R[r.SIN_BETA, f] = v / vt if moves else 0.0
        half_rho = 0.5 * R[r.DENSITY, f]
        qbar = half_rho * vt2
        R[r.VT, f] = vt
        R[r.QBAR, f], R[r.QBAR_UW, f], R[r.QBAR_UV, f] = qbar, half_rho * uw, half_rho * (u2 + v2)
        R[r.MACH, f] = vt / R[r.SOUND_SPEED, f]
        vn, ve = R[r.V_NORTH, f], R[r.V_EAST, f]
        R[r.V_GROUND, f] = math.sqrt(vn * vn + ve * ve)
        # lift per dynamic pressure, for models that read aero/cl-squared (start of FGAerodynamics::Run)
        cl, old = R[r.WIND_FORCE + 2, f] / (R[r.WING_AREA, f] * qbar), R[r.CL_SQUARED, f]
        R[r.CL_SQUARED, f] = cl * cl if qbar > 1.0 else old
    _flow_angles(R)


@compiled
def _flow_angles(R: FloatArray) -> None:  # pragma: no cover
    R = lanes(R)
    for f in range(LANES):
        u, v, w = R[r.U_AERO, f], R[r.V_AERO, f], R[r.W_AERO, f]
        uw, moves = u * u + w * w, R[r.VT, f] > 0.001
        beta, alpha = _atan2(v, math.sqrt(uw)), _atan2(w, u)
        R[r.BETA, f] = beta if moves else 0.0
        R[r.ALPHA, f] = alpha if moves and uw >= 1e-6 else 0.0


@compiled
def air_data(R: FloatArray) -> None:  # pragma: no cover
    """The rest of FGAuxiliary, which few models and channels read: track, pitot, load factors, height over span."""
    R = lanes(R)
    for f in range(LANES):
        vn, ve, vd = R[r.V_NORTH, f], R[r.V_EAST, f], R[r.V_DOWN, f]
        track = math.atan2(ve, vn)
        R[r.TRACK, f] = track + 2.0 * math.pi if track < 0.0 else track
        R[r.GAMMA, f] = math.atan2(-vd, R[r.V_GROUND, f])
        mach, pressure = R[r.MACH, f], R[r.PRESSURE, f]
        R[r.TOTAL_TEMPERATURE, f] = R[r.TEMPERATURE, f] * (1.0 + 0.2 * mach * mach)
        if mach < 1.0:
            total = pressure * math.pow(1.0 + 0.2 * mach * mach, 3.5)
        else:
            coefficient = math.pow(1.2, 3.5) * math.pow(6.0, 2.5)
            total = pressure * coefficient * math.pow(mach, 7.0) / math.pow(7.0 * mach * mach - 1.0, 2.5)
        R[r.TOTAL_PRESSURE, f] = total
        R[r.VC, f] = SEA_LEVEL_A * _mach_of(total - pressure) if mach > 0.0 else 0.0
        R[r.VE, f] = math.sqrt(2.0 * R[r.QBAR, f] / SEA_LEVEL_RHO) if mach > 0.0 else 0.0
        ax, ay, az = R[r.BODY_ACCEL, f], R[r.BODY_ACCEL + 1, f], R[r.BODY_ACCEL + 2, f]
        R[r.N_X, f], R[r.N_Y, f], R[r.N_Z, f] = ax / _STANDARD_G, ay / _STANDARD_G, -az / _STANDARD_G
        i, k = r.EYE_POINT, r.CG
        ex = (R[k, f] - R[i, f]) / 12.0
        ey = (R[i + 1, f] - R[k + 1, f]) / 12.0
        ez = (R[k + 2, f] - R[i + 2, f]) / 12.0
        pd, qd, sd = R[r.RATE_DOT, f], R[r.RATE_DOT + 1, f], R[r.RATE_DOT + 2, f]
        p, q, s = R[r.RATE, f], R[r.RATE + 1, f], R[r.RATE + 2, f]
        cx, cy, cz = q * ez - s * ey, s * ex - p * ez, p * ey - q * ex
        R[r.PILOT_ACCEL, f] = ax + qd * ez - sd * ey + q * cz - s * cy
        R[r.PILOT_ACCEL + 1, f] = ay + sd * ex - pd * ez + s * cx - p * cz
        R[r.PILOT_ACCEL + 2, f] = az + pd * ey - qd * ex + p * cy - q * cx
        T = R[r.TEMPERATURE, f]
        viscosity = _BETA * T * math.sqrt(T) / (_SUTHERLAND + T) / R[r.DENSITY, f]
        R[r.REYNOLDS, f] = R[r.VT, f] * R[r.CHORD, f] / viscosity
        h, span = R[r.H_AGL, f], R[r.WING_SPAN, f]
        i, j = r.REFERENCE_POINT, r.LOCAL_TO_BODY
        rx = (R[k, f] - R[i, f]) / 12.0
        ry = (R[i + 1, f] - R[k + 1, f]) / 12.0
        rz = (R[k + 2, f] - R[i + 2, f]) / 12.0
        R[r.H_B_CG, f] = h / span
        R[r.H_B_MAC, f] = (h - (R[j + 2, f] * rx + R[j + 5, f] * ry + R[j + 8, f] * rz)) / span


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
