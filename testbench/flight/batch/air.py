"""The air and the motion through it, as JSBSim 1.3.3 has them (FGStandardAtmosphere, FGAuxiliary).

Each kernel takes the registers R (register, flight) and does one stage of the frame for every flight.
"""

from __future__ import annotations

import math
from functools import partial

from testbench.flight.batch import registers as r
from testbench.flight.batch.vector import Lanes, Rows, atan2, library, power, sometimes, sqrt, stage, where

# FGAtmosphere, FGStandardAtmosphere
_FT_M, _FT_IN = 0.3048, 1.0 / 12.0
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
_LAPSES = (_LAPSE_0, _LAPSE_2)
_P_1 = SEA_LEVEL_P * math.pow(SEA_LEVEL_T / (SEA_LEVEL_T + _LAPSE_0 * _LAYERS[1]), _G0 / (GAS_CONSTANT * _LAPSE_0))
_P_2 = _P_1 * math.exp(-_G0 * (_LAYERS[2] - _LAYERS[1]) / (GAS_CONSTANT * _TEMPERATURES[1]))
TOP_FT = 100000.0
"""Height above which this atmosphere does not hold."""
_SUTHERLAND, _BETA = 198.72, 2.269690e-08
# FGAuxiliary
_STANDARD_G = 9.80665 / _FT_M


def atmosphere(R: Rows) -> None:
    """Take the standard atmosphere at the height, and the wind as it is set (FGStandardAtmosphere, FGWinds)."""
    h = R[r.H_SL]
    H = h * _EARTH_RADIUS / (_EARTH_RADIUS + h)
    low, middle = _LAYERS[1] > H, (_LAYERS[1] <= H) & (_LAYERS[2] > H)
    lapsing = where(low, SEA_LEVEL_T + _LAPSE_0 * H, _TEMPERATURES[2] + _LAPSE_2 * (H - _LAYERS[2]))
    exponent = where(low, _G0 / (GAS_CONSTANT * _LAPSE_0), _G0 / (GAS_CONSTANT * _LAPSE_2))
    pressure = where(low, SEA_LEVEL_P, _P_2) * power(where(low, SEA_LEVEL_T, _TEMPERATURES[2]) / lapsing, exponent)
    falling = (H - _LAYERS[1]) * (-_G0 / (GAS_CONSTANT * _TEMPERATURES[1]))
    pressure = sometimes(middle, lambda: _P_1 * library("exp", falling), pressure)
    T = where(middle, _TEMPERATURES[1], lapsing)
    R[r.TEMPERATURE], R[r.PRESSURE] = T, pressure
    R[r.DENSITY] = pressure / (GAS_CONSTANT * T)
    R[r.SOUND_SPEED] = sqrt(1.4 * GAS_CONSTANT * T)
    for i in range(3):
        R[r.WIND + i] = R[r.GUST + i]


@stage
def altitudes(R: Rows) -> None:
    """Set the heights at which the standard atmosphere has this density, and this pressure (FGStandardAtmosphere)."""
    density = tuple(p / (GAS_CONSTANT * T) for p, T in zip((SEA_LEVEL_P, _P_1, _P_2), _TEMPERATURES, strict=False))
    for k, at, (ground, first, second) in ((0, r.DENSITY, density), (1, r.PRESSURE, (SEA_LEVEL_P, _P_1, _P_2))):
        x = R[at]
        low, middle = x >= first, (x < first) & (x >= second)
        exponents = [-GAS_CONSTANT * L / _G0 if k else -1.0 / (1.0 + _G0 / (GAS_CONSTANT * L)) for L in _LAPSES]
        slope = where(low, _TEMPERATURES[0] / _LAPSE_0, _TEMPERATURES[2] / _LAPSE_2)
        bent = power(x / where(low, ground, second), where(low, *exponents)) - 1.0
        H = where(low, _LAYERS[0], _LAYERS[2]) + slope * bent
        logarithm = sometimes(middle, partial(library, "log", x / first), 0.0)
        H = where(middle, _LAYERS[1] - GAS_CONSTANT * _TEMPERATURES[1] / _G0 * logarithm, H)
        R[r.DENSITY_ALTITUDE + k] = H * _EARTH_RADIUS / (_EARTH_RADIUS - H)


def _mach_of(impact: Lanes) -> Lanes:
    """Return the Mach number at sea level that gives an impact pressure (FGAuxiliary::MachFromImpactPressure)."""
    A = impact / SEA_LEVEL_P + 1.0
    slow = sqrt(5.0 * (power(A, 1.0 / 3.5) - 1.0))

    def supersonic() -> Lanes:
        M, coefficient = slow, math.pow(1.2, -0.25 * 7.0) * math.pow(1.2 / 1.4, -0.5 * 2.5)
        for _ in range(10):
            M = coefficient * sqrt(A * power(1.0 - 1.0 / (7.0 * M * M), 2.5))
        return M

    return sometimes(slow > 1.0, supersonic, slow)


def arm(R: Rows, at: int) -> tuple[Lanes, Lanes, Lanes]:
    """Return where a place (3 registers, in, structural axes) lies from the centre of gravity, ft, body axes."""
    k = r.CG
    return (R[k] - R[at]) * _FT_IN, (R[at + 1] - R[k + 1]) * _FT_IN, (R[k + 2] - R[at + 2]) * _FT_IN


@stage
def auxiliary(R: Rows) -> None:
    """Take the motion through the air from that over the ground (FGAuxiliary); accelerations are the last frame's."""
    i = r.LOCAL_TO_BODY
    wn, we, wd = R[r.WIND], R[r.WIND + 1], R[r.WIND + 2]
    R[r.P_AERO], R[r.Q_AERO], R[r.R_AERO] = R[r.P], R[r.Q], R[r.R]
    u = R[r.U] - (R[i] * wn + R[i + 1] * we + R[i + 2] * wd)
    v = R[r.V] - (R[i + 3] * wn + R[i + 4] * we + R[i + 5] * wd)
    w = R[r.W] - (R[i + 6] * wn + R[i + 7] * we + R[i + 8] * wd)
    R[r.U_AERO], R[r.V_AERO], R[r.W_AERO] = u, v, w
    u2, v2, w2 = u * u, v * v, w * w
    uw = u2 + w2
    vt2 = uw + v2
    vt, root = sqrt(vt2), sqrt(uw)
    moves = vt > 0.001
    forward = moves & (uw >= 1e-6)
    ud, vd, wd = R[r.U_DOT], R[r.V_DOT], R[r.W_DOT]
    over_vt, over_root = 1.0 / vt, 1.0 / root
    vt_dot = (u * ud + v * vd + w * wd) * over_vt
    alpha_dot, beta_dot = (u * wd - w * ud) * (over_root * over_root), (vd * vt - v * vt_dot) * (over_vt * over_root)
    R[r.ALPHA_DOT] = where(forward, alpha_dot, 0.0)
    R[r.BETA_DOT] = where(forward, beta_dot, 0.0)
    R[r.COS_ALPHA] = where(forward, u * over_root, 1.0)
    R[r.SIN_ALPHA] = where(forward, w * over_root, 0.0)
    R[r.COS_BETA] = where(moves, root * over_vt, 1.0)
    R[r.SIN_BETA] = where(moves, v * over_vt, 0.0)
    half_rho = 0.5 * R[r.DENSITY]
    qbar = half_rho * vt2
    R[r.VT] = vt
    R[r.QBAR], R[r.QBAR_UW], R[r.QBAR_UV] = qbar, half_rho * uw, half_rho * (u2 + v2)
    R[r.MACH] = vt / R[r.SOUND_SPEED]
    vn, ve = R[r.V_NORTH], R[r.V_EAST]
    R[r.V_GROUND] = sqrt(vn * vn + ve * ve)
    # lift per dynamic pressure, for models that read aero/cl-squared (start of FGAerodynamics::Run)
    cl, old = R[r.WIND_FORCE + 2] / (R[r.WING_AREA] * qbar), R[r.CL_SQUARED]
    R[r.CL_SQUARED] = where(qbar > 1.0, cl * cl, old)
    R[r.BETA] = where(moves, atan2(v, root), 0.0)
    R[r.ALPHA] = where(forward, atan2(w, u), 0.0)


@stage
def air_data(R: Rows) -> None:
    """More of FGAuxiliary, which few models and channels read: track, load factors, height over span."""
    vn, ve, vd = R[r.V_NORTH], R[r.V_EAST], R[r.V_DOWN]
    track = atan2(ve, vn)
    R[r.TRACK] = where(track < 0.0, track + 2.0 * math.pi, track)
    R[r.GAMMA] = atan2(-vd, R[r.V_GROUND])
    ax, ay, az = R[r.BODY_ACCEL], R[r.BODY_ACCEL + 1], R[r.BODY_ACCEL + 2]
    R[r.N_X], R[r.N_Y], R[r.N_Z] = ax / _STANDARD_G, ay / _STANDARD_G, -az / _STANDARD_G
    i = r.EYE_POINT
    ex, ey, ez = arm(R, i)
    pd, qd, sd = R[r.RATE_DOT], R[r.RATE_DOT + 1], R[r.RATE_DOT + 2]
    p, q, s = R[r.RATE], R[r.RATE + 1], R[r.RATE + 2]
    cx, cy, cz = q * ez - s * ey, s * ex - p * ez, p * ey - q * ex
    R[r.PILOT_ACCEL] = ax + qd * ez - sd * ey + q * cz - s * cy
    R[r.PILOT_ACCEL + 1] = ay + sd * ex - pd * ez + s * cx - p * cz
    R[r.PILOT_ACCEL + 2] = az + pd * ey - qd * ex + p * cy - q * cx
    T = R[r.TEMPERATURE]
    viscosity = _BETA * T * sqrt(T) / (_SUTHERLAND + T) / R[r.DENSITY]
    R[r.REYNOLDS] = R[r.VT] * R[r.CHORD] / viscosity
    h, span = R[r.H_AGL], R[r.WING_SPAN]
    i, j = r.REFERENCE_POINT, r.LOCAL_TO_BODY
    rx, ry, rz = arm(R, i)
    R[r.H_B_CG] = h / span
    R[r.H_B_MAC] = (h - (R[j + 2] * rx + R[j + 5] * ry + R[j + 8] * rz)) / span


@stage
def pitot(R: Rows) -> None:
    """The rest of FGAuxiliary: what a pitot tube measures."""
    mach, pressure = R[r.MACH], R[r.PRESSURE]
    R[r.TOTAL_TEMPERATURE] = R[r.TEMPERATURE] * (1.0 + 0.2 * mach * mach)
    coefficient, square = math.pow(1.2, 3.5) * math.pow(6.0, 2.5), mach * mach
    total = sometimes(
        ~(mach < 1.0),
        lambda: pressure * coefficient * power(mach, 7.0) / power(7.0 * square - 1.0, 2.5),
        pressure * power(1.0 + 0.2 * square, 3.5),
    )
    R[r.TOTAL_PRESSURE] = total
    R[r.VC] = where(mach > 0.0, SEA_LEVEL_A * _mach_of(total - pressure), 0.0)
    R[r.VE] = where(mach > 0.0, sqrt(2.0 * R[r.QBAR] / SEA_LEVEL_RHO), 0.0)
