"""Physical constants and conversion factors, each with its unit and source; and a level that all rooms test by."""

from __future__ import annotations

import math

G0_M_S2 = 9.80665  # standard acceleration of gravity, ISO 80000-3
FT_M = 0.3048  # international foot, m (exact, 1959 agreement)
LBF_N = 4.4482216152605  # pound-force, N (exact: 0.45359237 kg times standard gravity)
SLUG_KG = LBF_N / FT_M  # slug, kg
SLUG_FT2 = SLUG_KG * FT_M**2  # slug ft2, kg m2
PSF_PA = LBF_N / FT_M**2  # pound-force per square foot, Pa
DEG_RAD = math.pi / 180.0  # degree, rad
KT_M_S = 1852.0 / 3600.0  # international knot, m/s (exact)
PERCENT = 0.01  # percent, 1
RPM_RAD_S = 2.0 * math.pi / 60.0  # turn per minute, rad/s
JSBSIM_LENGTH_M = {"M": 1.0, "FT": FT_M, "IN": FT_M / 12.0}  # units of length in JSBSim's files, m
JSBSIM_AREA_M2 = {"M2": 1.0, "FT2": FT_M**2}  # and of area, m2
WHITE = 1e-3  # probability under whiteness from which residuals count as white: a false alarm in a thousand outputs

COEFFICIENTS = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
"""Forces in wind axes and moments in body axes, as coefficients."""
