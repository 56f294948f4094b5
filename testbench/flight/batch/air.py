"""The air and the motion through it, as JSBSim 1.3.3 has them (FGStandardAtmosphere, FGAuxiliary).

Each kernel takes the registers R (register, flight) and does one stage of the frame for every flight.
"""

from __future__ import annotations

import math

from testbench.core.record import FloatArray
from testbench.flight.batch import registers as r
from testbench.flight.batch.compiled import LANES, compiled, lanes

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


@compiled
def atmosphere(R: FloatArray) -> None:  # pragma: no cover
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
def atan2(y: float, x: float) -> float:  # pragma: no cover
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
        beta, alpha = atan2(v, math.sqrt(uw)), atan2(w, u)
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
