"""Real records with what is believed of them: JSBSim aircraft whose derivatives are those printed in the literature.

Printed values: R. V. Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015 (HFB-320: filter error;
ATTAS: output error, both elevator records). The frame of both aircraft (servos, lateral axes, which no record here
excites) is the Taurus model's; of the longitudinal motion nothing of it is left.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from math import comb
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from testbench.aircraft import Aircraft
from testbench.core.atmosphere import air_density
from testbench.core.constants import DEG_RAD, FT_M, G0_M_S2, LBF_N
from testbench.core.paths import AIRCRAFT_MODELS
from testbench.core.record import FlightRecord, FloatArray
from testbench.flight import FlightCondition, load_aircraft
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.commanded import quiet_samples
from testbench.sensors import Sensor, SensorSuite

RATE_HZ = 50.0  # of the simulation: two frames per sample of ATTAS, five of HFB-320
_FORCE = ("aero/qbar-psf", "metrics/Sw-sqft")
_MOMENT = (*_FORCE, "metrics/cbarw-ft")
_ALPHA, _Q, _DE = "aero/alpha-rad", "velocities/q-aero-rad_sec", "fcs/elevator-pos-rad"
_SPEED = "velocities/vt-fps"
_LATERAL = {
    "beta": "aero/beta-rad", "p": "velocities/p-aero-rad_sec", "r": "velocities/r-aero-rad_sec",
    "da": "fcs/left-aileron-pos-rad", "dr": "fcs/rudder-pos-rad",
}  # fmt: skip

# HFB-320, filter error; speeds in units of V0, rates as q cbar / (2 V0).
HFB = {
    "CD0": 0.1227, "CDV": -0.0645, "CDa": 0.3201, "CL0": -0.0929, "CLV": 0.1487, "CLa": 4.3279,
    "Cm0": 0.1119, "CmV": 0.0040, "Cma": -0.9679, "Cmq": -34.71, "Cmde": -1.5291,
}  # fmt: skip
HFB_V0, HFB_MASS, HFB_CBAR, HFB_RHO = 104.67, 7472.0, 2.43, 0.792
HFB_S = 4.028e-3 * HFB_MASS
HFB_IYY = HFB_S * HFB_CBAR / 8.0027e-4
HFB_THRUST_RAD, HFB_THRUST_MOMENT = 0.0524, -7.0153e-6
HFB_FULL_N = 200e3  # of full throttle: so much that the scatter of the measured thrust, 50 N, is no command

# ATTAS, output error: alphadot = z0 + Za alpha + (1 + Zq) q + Zde de, qdot = m0 + Ma alpha + Mq q + Mde de.
ATTAS = {"Za": -0.4834, "Zq": 0.1042, "Zde": 0.6763, "Ma": -4.9265, "Mq": -2.0057, "Mde": -7.2081}
# What the printed equations leave open, and the motion in alpha and q feels little: size and mass about those of the
# VFW-614 (from memory), the drag that the recorded thrust balances, 18.5 kN.
ATTAS_MASS, ATTAS_S, ATTAS_CBAR, ATTAS_IYY = 17000.0, 64.0, 3.16, 300e3
ATTAS_V, ATTAS_H, ATTAS_THRUST_N, ATTAS_FULL_N = 129.0, 4870.0, 18.5e3, 60e3
# ATTAS, output error, both records of aileron and rudder: pdot = Lp p + Lr r + Lda da + Ldr dr + Lb beta, rdot as well.
# Positive ailerons of the source roll to the left; here Lda and Nda have the house's sign. Beta was an input of that
# fit as it was read, and it was read late: kinematics of the same records say by 0.09 to 0.10 s (a test). As betadot is
# nearly -r, late by T makes of Nr what is printed, Nr - Nb T, and of Lr likewise. So Nb T and Lb T come on top.
ATTAS_LATE_S = 0.1
_PRINTED = {
    "Lp": -2.0675, "Lr": 1.0293, "Lda": 6.3059, "Ldr": 1.1452, "Lb": -3.8444,
    "Np": -0.1839, "Nr": -0.4856, "Nda": 0.3912, "Ndr": -1.7609, "Nb": 3.0314,
}  # fmt: skip
ATTAS_LATERAL = {
    **_PRINTED,
    "Lr": _PRINTED["Lr"] + ATTAS_LATE_S * _PRINTED["Lb"],
    "Nr": _PRINTED["Nr"] + ATTAS_LATE_S * _PRINTED["Nb"],
}
# Side force is not among what is printed: least squares of the lateral acceleration of fAttasRud1 on beta, r and dr,
# m/s2 (side_force, held by a test).
ATTAS_SIDE = {"Yb": -27.02, "Yr": 3.72, "Ydr": 5.88}


def hfb320(folder: Path, factors: Mapping[str, float] | None = None) -> Aircraft:
    """Write the HFB-320 of the printed filter-error result to ``folder`` and return it.

    Args:
        folder: where to write it.
        factors: coefficient, as in HFB -> what to falsify it by.
    """
    given = {n: v * (factors or {}).get(n, 1.0) for n, v in HFB.items()}
    rate = HFB_CBAR / (2.0 * HFB_V0)
    arm_ft = HFB_THRUST_MOMENT * HFB_IYY / FT_M
    per_V0 = FT_M / HFB_V0
    axes = {
        "DRAG": _sum("CD", _FORCE, (given["CD0"], ()), (given["CDV"] * per_V0, (_SPEED,)), (given["CDa"], (_ALPHA,))),
        "LIFT": _one("CL0", _FORCE, given["CL0"])
        + _one("CL_V", (*_FORCE, _SPEED), given["CLV"] * per_V0)
        + _one("CL_alpha", (*_FORCE, _ALPHA), given["CLa"]),
        "PITCH": _one("Cm0", _MOMENT, given["Cm0"])
        + _one("Cm_V", (*_MOMENT, _SPEED), given["CmV"] * per_V0)
        + _one("Cm_alpha", (*_MOMENT, _ALPHA), given["Cma"])
        + _one("Cm_q", (*_MOMENT, _Q), given["Cmq"] * rate)
        + _one("Cm_de", (*_MOMENT, _DE), given["Cmde"])
        + _one("thrust_moment", ("propulsion/engine/thrust-lbs",), arm_ft),
    }
    return _written(
        folder, "hfb320", axes, (HFB_S, HFB_CBAR, HFB_MASS, HFB_IYY), HFB_FULL_N, HFB_THRUST_RAD, (HFB_V0, 4000.0)
    )


def attas(folder: Path, factors: Mapping[str, float] | None = None) -> Aircraft:
    """Write an aircraft to ``folder`` whose motion in alpha, q, beta, p and r about trim is the printed one; return it.

    Args:
        folder: where to write it.
        factors: derivative, as in ATTAS, ATTAS_LATERAL or ATTAS_SIDE -> what to falsify it by.
    """
    given = {n: v * (factors or {}).get(n, 1.0) for n, v in ATTAS.items()}
    qbar = FlightCondition(ATTAS_V, ATTAS_H).qbar_Pa
    lift = ATTAS_MASS * ATTAS_V / (qbar * ATTAS_S)  # CL per rad/s of turning the path
    moment = ATTAS_IYY / (qbar * ATTAS_S * ATTAS_CBAR)  # Cm per rad/s2
    CD = ATTAS_THRUST_N / (qbar * ATTAS_S)
    CL = ATTAS_MASS * G0_M_S2 / (qbar * ATTAS_S)
    alpha0 = 2.26 * DEG_RAD  # recorded in the quiet flight
    CL_alpha = -given["Za"] * lift - CD  # drag turns with alpha, too: -(CL_alpha + CD) qbar S / (m V) = Za
    axes = {
        "DRAG": _sum("CD", _FORCE, (CD, ())),
        "LIFT": _one("CL0", _FORCE, CL - CL_alpha * alpha0)
        + _one("CL_alpha", (*_FORCE, _ALPHA), CL_alpha)
        + _one("CL_q", (*_FORCE, _Q), -given["Zq"] * lift)
        + _one("CL_de", (*_FORCE, _DE), -given["Zde"] * lift),
        "PITCH": _one("Cm0", _MOMENT, -given["Ma"] * moment * alpha0)
        + _one("Cm_alpha", (*_MOMENT, _ALPHA), given["Ma"] * moment)
        + _one("Cm_q", (*_MOMENT, _Q), given["Mq"] * moment)
        + _one("Cm_de", (*_MOMENT, _DE), given["Mde"] * moment),
    }
    axes |= _attas_lateral({n: v * (factors or {}).get(n, 1.0) for n, v in (ATTAS_LATERAL | ATTAS_SIDE).items()}, qbar)
    sizes = (ATTAS_S, ATTAS_CBAR, ATTAS_MASS, ATTAS_IYY)
    return _written(folder, "attas", axes, sizes, ATTAS_FULL_N, 0.0, (ATTAS_V, ATTAS_H))


def _attas_lateral(given: Mapping[str, float], qbar: float) -> dict[str, str]:
    """Return the lateral axes of an aircraft of these dimensional derivatives."""
    span = 8.0 * ATTAS_CBAR  # that of _written, which has Ixx = Iyy and Izz = 2 Iyy, too
    unit = {"Y": ATTAS_MASS / (qbar * ATTAS_S)}
    unit |= {n: k * ATTAS_IYY / (qbar * ATTAS_S * span) for n, k in (("L", 1.0), ("N", 2.0))}
    felt = {"b": "beta", "p": "p", "r": "r", "da": "da", "dr": "dr"}
    axes = {}
    for axis, letter, name in (("SIDE", "Y", "CY"), ("ROLL", "L", "Cl"), ("YAW", "N", "Cn")):
        factors = _FORCE if letter == "Y" else (*_FORCE, "metrics/bw-ft")
        axes[axis] = "".join(
            _one(f"{name}_{of}", (*factors, _LATERAL[of]), given[letter + short] * unit[letter])
            for short, of in felt.items()
            if letter + short in given
        )
    return axes


def hfb320_record(data: Path) -> FlightRecord:
    """Return the HFB-320 record: V, alpha, theta, q, ax, az and, as commands, elevator and thrust."""
    a = np.loadtxt(data / "hfb320" / "hfb320_1_10.asc")
    columns = {"V": a[:, 4], "alpha": a[:, 5], "theta": a[:, 6], "q": a[:, 7], "ax": a[:, 9], "az": a[:, 10]}
    return _record(a[:, 0], columns, {"de_cmd": a[:, 1], "thr_cmd": a[:, 3] / HFB_FULL_N})


def attas_record(data: Path, name: str) -> FlightRecord:
    """Return an ATTAS elevator record, e.g. "fAttasElv1": alpha, q and, as a command, the elevator.

    The first 0.4 s are left out: there q rings by 1 deg/s, which is the filter's that the record went through.
    """
    a = loadmat(data / "attas" / f"{name}.mat")[name][10:]
    columns = {"alpha": a[:, 12] * DEG_RAD, "q": a[:, 7] * DEG_RAD}
    return _record(a[:, 0], columns, {"de_cmd": a[:, 21] * DEG_RAD})


def attas_lateral_record(data: Path, name: str, everything: bool = False) -> FlightRecord:
    """Return an ATTAS record of aileron or rudder: beta, p, r, phi, ay and, as commands, the surfaces.

    Args:
        data: the folder of recorded flights.
        name: "1 aileron", "1 rudder", "2 aileron" or "2 rudder": a segment of fAttasAilRud1 or fAttasAilRud2, of which
            fAttasAil1 and fAttasRud1 are the two of the first. The first 0.4 s are left out, as of the others.
        everything: with the channels of the longitudinal motion, which kinematics of all axes need.
    """
    run, control = name.split()
    a = loadmat(data / "attas" / f"fAttasAilRud{run}.mat")[f"fAttasAilRud{run}"]
    joint = int(np.flatnonzero(np.diff(a[:, 0]) > 0.1)[0]) + 1
    a = a[10:joint] if control == "aileron" else a[joint + 10 :]
    angles = {"beta": 13, "p": 6, "r": 8, "phi": 9} | ({"alpha": 12, "q": 7, "theta": 10} if everything else {})
    others = {"ay": 2} | ({"ax": 1, "az": 3, "V": 14} if everything else {})
    columns = {n: a[:, i] * DEG_RAD for n, i in angles.items()} | {n: a[:, i] for n, i in others.items()}
    moved = {"de_cmd": a[:, 21], "da_cmd": 0.5 * (a[:, 27] - a[:, 28]), "dr_cmd": a[:, 29]}
    return _record(a[:, 0] - a[0, 0], columns, {n: u * DEG_RAD for n, u in moved.items()})


def side_force(record: FlightRecord) -> dict[str, float]:
    """Return what ATTAS_SIDE is, from one record."""
    X = np.column_stack([record.columns(["beta", "r", "dr_cmd"]), np.ones(len(record))])
    return dict(zip(("Yb", "Yr", "Ydr"), np.linalg.lstsq(X, record["ay"], rcond=None)[0].tolist(), strict=False))


def believe(
    aircraft: Aircraft,
    record: FlightRecord,
    noise: Mapping[str, float],
    V_m_s: float,
    h_m: float,
    late_s: Mapping[str, float] | None = None,
) -> Believed:
    """Return the belief in an aircraft and sensors with white noise of these deviations, SI, some of them late."""
    late = late_s or {}
    sensors = tuple(Sensor(channel=n, noise_std=noise.get(n, 0.0), delay_s=late.get(n, 0.0)) for n in record.channels)
    suite = SensorSuite("recorded", "the instruments of a real record", 1.0 / record.dt_s, sensors)
    return Believed(aircraft, suite, FlightCondition(V_m_s, h_m), RATE_HZ)


def quiet_noise(records: Sequence[FlightRecord]) -> dict[str, float]:
    """Return the standard deviation of each output in the quiet flight before the commands, SI.

    For the ATTAS records, whose q went through a low pass: nothing of its noise is left at high frequency.
    """
    names = [n for n in records[0].channels if not n.endswith("_cmd")]
    variance = np.mean([np.var(r.columns(names)[: quiet_samples(r)], axis=0) for r in records], axis=0)
    return dict(zip(names, np.sqrt(variance).tolist(), strict=True))


def fine_noise(record: FlightRecord) -> dict[str, float]:
    """Return the standard deviation of the white noise of each output by sixth differences, SI.

    Differences of order k of white noise have binom(2 k, k) times its variance; of what moves slowly they leave
    nothing. For the HFB-320, which turbulence moves all the time.
    """
    names = [n for n in record.channels if not n.endswith("_cmd")]
    variance = np.mean(np.diff(record.columns(names), 6, axis=0) ** 2, axis=0) / comb(12, 6)
    return dict(zip(names, np.sqrt(variance).tolist(), strict=True))


def altitude_m(rho_kg_m3: float) -> float:
    """Return where the standard atmosphere has this density."""
    heights = np.linspace(0.0, 10e3, 10001)
    return float(np.interp(-rho_kg_m3, [-air_density(h) for h in heights], heights))


def _record(t_s: FloatArray, outputs: Mapping[str, FloatArray], inputs: Mapping[str, FloatArray]) -> FlightRecord:
    """Return a record whose inputs, which move on between samples, are held as their means over the sample.

    The simulator takes a step of a held command as a ramp over the frame before it, half a frame early: the means are
    taken over a window that is as early, a share d of a sample.
    """
    dt = round(float(np.median(np.diff(t_s))), 4)  # the times are written with rounding errors
    d = 0.5 / (RATE_HZ * dt)
    held = {}
    for name, u in inputs.items():
        before, after = np.append(u[0], u[:-1]), np.append(u[1:], u[-1])
        early, late = u + 0.5 * d * (before - u), u + 0.5 * (1.0 - d) * (after - u)
        held[name] = d * early + (1.0 - d) * late
    columns = {**outputs, **held}
    return FlightRecord(np.arange(t_s.size) * dt, tuple(columns), np.column_stack(list(columns.values())), "measured")


def _one(name: str, factors: tuple[str, ...], value: float) -> str:
    return _sum(name, factors, (value, ()))


def _sum(name: str, factors: tuple[str, ...], *terms: tuple[float, tuple[str, ...]]) -> str:
    """Return a JSBSim function, the product of ``factors`` and of the sum of ``terms``."""
    added = "".join(
        f"<product> <value>{v!r}</value> {''.join(f'<property>{p}</property>' for p in names)} </product>"
        for v, names in terms
    )
    if len(terms) == 1 and not terms[0][1]:
        added = f"<value>{terms[0][0]!r}</value>"
    elif len(terms) > 1:
        added = f"<sum> {added} </sum>"
    body = "".join(f"<property>{p}</property>" for p in factors)
    return f'<function name="aero/coefficient/{name}"> <product> {body} {added} </product> </function>'


def _written(
    folder: Path,
    name: str,
    axes: Mapping[str, str],
    sizes: tuple[float, float, float, float],
    full_N: float,
    thrust_rad: float,
    design: tuple[float, float],
) -> Aircraft:
    """Write the Taurus with other longitudinal axes, sizes (S, cbar, mass, Iyy), thrust and no servo lag."""
    source = AIRCRAFT_MODELS / "taurus"
    tree = ET.fromstring((source / "taurus.xml").read_text(encoding="utf-8"))
    for axis, functions in axes.items():
        element = tree.find(f"aerodynamics/axis[@name='{axis}']")
        element[:] = list(ET.fromstring(f"<axis>{functions}</axis>"))
    S, cbar, mass, Iyy = sizes
    numbers = {
        "metrics/wingarea": S, "metrics/chord": cbar, "metrics/wingspan": 8.0 * cbar, "mass_balance/emptywt": mass,
        "mass_balance/ixx": Iyy, "mass_balance/iyy": Iyy, "mass_balance/izz": 2.0 * Iyy,
        "propulsion/engine/thruster/location/x": 0.0,
        "propulsion/engine/thruster/orient/pitch": thrust_rad / DEG_RAD,
    }  # fmt: skip
    for path, number in numbers.items():
        tree.find(path).text = repr(float(number))
    for p in tree.findall("flight_control/property"):
        if p.text.endswith("lag-rad_sec"):
            p.set("value", "1000")  # the records hold the surface itself
        elif p.text.endswith("rate-limit-rad_sec"):
            p.set("value", "100")
    throttle = tree.find("flight_control/channel/fcs_function[@name='fcs/thrust-fraction']/function/sum")
    throttle[:] = list(ET.fromstring("<s> <property>fcs/throttle-cmd-norm</property> <value>0</value> </s>"))
    (folder / "Engines").mkdir(parents=True)
    (folder / f"{name}.xml").write_text(ET.tostring(tree, encoding="unicode"), encoding="utf-8")
    watts = full_N / LBF_N * 745.7 / 550.0  # see the Taurus' Engines/motor.xml
    motor = f'<electric_engine name="motor"> <power unit="WATTS">{watts!r}</power> </electric_engine>'
    (folder / "Engines" / "motor.xml").write_text(motor, encoding="utf-8")
    (folder / "Engines" / "direct.xml").write_text('<direct name="direct"/>', encoding="utf-8")
    (folder / "aircraft.toml").write_text(
        f'title = "{name} of printed derivatives"\nmodel = "{name}.xml"\ndesign_V_m_s = {design[0]}\n'
        f"design_h_m = {design[1]}\n[simulation]\nrate_hz = {RATE_HZ}\n"
        '[controls.de]\ncommand = "fcs/elevator-cmd-norm"\nfull_deflection_deg = 12.5\n'
        '[controls.da]\ncommand = "fcs/aileron-cmd-norm"\nfull_deflection_deg = 25.0\n'
        '[controls.dr]\ncommand = "fcs/rudder-cmd-norm"\nfull_deflection_deg = 25.0\n'
        '[controls.thr]\ncommand = "fcs/throttle-cmd-norm"\n'
        "[limits]\nV_m_s = [60.0, 200.0]\nalpha_deg = [-15.0, 20.0]\ntheta_deg = [-40.0, 40.0]\n",
        encoding="utf-8",
    )
    return load_aircraft(name, folder=folder)
