"""Registers of the rigid body and its air: rows of the array (register, flight) that the kernels read and write.

Units are JSBSim's own (ft, slug, lbf, rad, Rankine), so that every number can be set beside the property of that name.
Vectors and matrices lie in rows that follow each other, matrices row by row; the name is that of the first row.
"""

from __future__ import annotations

# fmt: off
(
    DT, TIME, EARTH_ANGLE, COS_EARTH, SIN_EARTH,
    ATTITUDE, _, _, _,                  # quaternion, body against inertial axes
    RATE, _, _,                         # of the body against inertial space, body axes
    POSITION, _, _,                     # inertial
    VELOCITY, _, _,                     # inertial
    # what the integrators remember: the rate of change one and two frames ago
    ATTITUDE_1, _, _, _, ATTITUDE_2, _, _, _,
    RATE_1, _, _, RATE_2, _, _,
    POSITION_1, _, _, POSITION_2, _, _,
    VELOCITY_1, _, _, VELOCITY_2, _, _,
    ATTITUDE_DOT, _, _, _,
    RATE_DOT, _, _,                     # against inertial space
    VELOCITY_DOT, _, _,                 # inertial axes
    INERTIAL_TO_BODY, _, _, _, _, _, _, _, _,
    LOCAL_TO_BODY, _, _, _, _, _, _, _, _,
    EARTH_TO_BODY, _, _, _, _, _, _, _, _,
    LOCATION, _, _,                     # earth-fixed axes
    RADIUS, SIN_LATITUDE, COS_LATITUDE, H_SL, H_AGL,
    U, V, W,                            # over the ground, body axes
    P, Q, R,                            # against the Earth
    V_NORTH, V_EAST, V_DOWN,
    U_DOT, V_DOT, W_DOT, P_DOT, Q_DOT, R_DOT,
    BODY_ACCEL, _, _,
    GRAVITY, _, _,                      # earth-fixed axes
    TEMPERATURE, PRESSURE, DENSITY, SOUND_SPEED,
    GUST, _, _, WIND, _, _,             # as set, and as it acts; north, east, down: where the air moves to
    U_AERO, V_AERO, W_AERO, P_AERO, Q_AERO, R_AERO,
    VT, ALPHA, BETA, ALPHA_DOT, BETA_DOT, QBAR, QBAR_UW, QBAR_UV, MACH, V_GROUND, GAMMA, TRACK,
    TOTAL_TEMPERATURE, TOTAL_PRESSURE, VC, VE,
    COS_ALPHA, SIN_ALPHA, COS_BETA, SIN_BETA,
    N_X, N_Y, N_Z,
    PILOT_ACCEL, _, _,
    H_B_CG, H_B_MAC, REYNOLDS,
    CL_SQUARED,
    BI2VEL, CI2VEL, ALPHA_WING, QBAR_AREA,
    # what is computed only if it is read
    PHI, THETA, PSI,
    LATITUDE, LATITUDE_GEODETIC, LONGITUDE,
    PHI_DOT, THETA_DOT, PSI_DOT,
    DENSITY_ALTITUDE, PRESSURE_ALTITUDE,
    # constants of an aircraft
    WING_AREA, WING_SPAN, CHORD, INCIDENCE,
    REFERENCE_POINT, _, _, EYE_POINT, _, _,         # in, structural axes
    WEIGHT, MASS, CG, _, _,                         # lbf, slug, in
    INERTIA, _, _, _, _, _,                         # Ixx Iyy Izz Ixy Ixz Iyz as the matrix has them
    INERTIA_INVERSE, _, _, _, _, _,                 # k1 k2 k3 k4 k5 k6, rows of the symmetric inverse
    # forces and moments, body axes unless said
    NATIVE, _, _, NATIVE_AT_CG, _, _, NATIVE_MOMENT, _, _,
    REFERENCE_SHIFT,
    AERO_FORCE, _, _, AERO_MOMENT, _, _, WIND_FORCE, _, _,
    ENGINE_FORCE, _, _, ENGINE_MOMENT, _, _,
    ADDED_FORCE, _, _, ADDED_MOMENT, _, _,
    FORCE, _, _, MOMENT, _, _,
    COUNT,
) = range(236)
# fmt: on
