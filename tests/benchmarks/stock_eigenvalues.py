"""Eigenvalues of our linear models against central differences made with JSBSim alone, on the models that it ships.

    python tests/benchmarks/stock_eigenvalues.py            # all that trim
    python tests/benchmarks/stock_eigenvalues.py c172p f16

The second way shares nothing with the package but the trimmed state and the position of the controls: the stock model
is loaded from JSBSim's own folder, its own control system is commanded until the surfaces stand where they stand in
ours, and its accelerations are differenced over u, v, w, p, q, r, phi, theta with propellers held at their speed. Where
its yaw damper or stick feels the motion, the command is changed until the surface stands still again, as ours leaves
them out.
"""

from __future__ import annotations

import math
import sys

import jsbsim
import numpy as np

import testbench as tb
from testbench.core.errors import TestbenchError
from testbench.core.paths import stock_names, stock_root
from testbench.flight.executive import Executive
from testbench.flight.trim import place_at_trim

_FT = 0.3048
_STATES = ("u", "v", "w", "p", "q", "r", "phi", "theta")
_STEPS = (0.1, 0.1, 0.1, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3)  # ft/s, rad/s, rad
_RATES = (
    *(f"accelerations/{a}dot-ft_sec2" for a in "uvw"),
    *(f"accelerations/{a}dot-rad_sec2" for a in "pqr"),
    "velocities/phidot-rad_sec",
    "velocities/thetadot-rad_sec",
)
_COMMANDS = {"de": "fcs/elevator-cmd-norm", "da": "fcs/aileron-cmd-norm", "dr": "fcs/rudder-cmd-norm"}
_PLANES = {"longitudinal": ("u", "w", "q", "theta"), "lateral-directional": ("v", "p", "r", "phi")}
_WITHIN = 0.01


def stock_matrix(name: str, aircraft: tb.Aircraft, trimmed: tb.TrimmedFlight) -> tuple[np.ndarray, dict[str, float]]:
    """Return A (8, 8) of the stock model in ft and s, and how far its surfaces are from ours, by control."""
    jsbsim.set_logger(jsbsim.FGLogger())
    fdm = jsbsim.FGFDMExec(str(stock_root()))
    fdm.set_debug_level(0)
    fdm.set_dt(1.0 / 120.0)
    assert fdm.load_model(name)
    for key, value in {**aircraft.adapter.neutral, **aircraft.adapter.settings}.items():
        fdm[key] = value
    ours = Executive(aircraft, trimmed.rate_hz, trimmed.condition)  # which leans the mixture for the height
    place_at_trim(ours, trimmed)
    for i in range(fdm.get_propulsion().get_num_engines()):
        if ours.has(f"fcs/mixture-cmd-norm[{i}]"):
            fdm[f"fcs/mixture-cmd-norm[{i}]"] = ours.get(f"fcs/mixture-cmd-norm[{i}]")
    fdm.get_propulsion().init_running(-1)
    x = np.array(
        [*(trimmed.state[a] / _FT for a in "uvw"), *(trimmed.state[a] for a in "pqr"), trimmed.phi, trimmed.theta]
    )

    def place(state: np.ndarray) -> None:
        fdm["ic/h-sl-ft"] = trimmed.condition.h_m / _FT
        fdm["ic/psi-true-rad"] = 0.0
        fdm["ic/theta-rad"], fdm["ic/phi-rad"] = state[7], state[6]
        for axis, value in zip("uvw", state[:3], strict=True):
            fdm[f"ic/{axis}-fps"] = value
        for axis, value in zip("pqr", state[3:6], strict=True):
            fdm[f"ic/{axis}-rad_sec"] = value

    def rest(frames: int = 400) -> None:
        for _ in range(frames):
            fdm.run_ic()

    place(x)
    if "thr" in trimmed.controls:
        for throttle in aircraft.adapter.throttles:
            fdm[throttle] = trimmed.controls["thr"]
    held = []
    for control, command in _COMMANDS.items():
        link = aircraft.adapter.link(control)
        if link is not None:
            drive = link.drives[0]
            d, v = np.array(drive.points).T
            held.append((control, command, drive.name, float(np.interp(trimmed.controls[control], d, v)), np.ptp(v)))

    def hold() -> dict[str, float]:
        """Command the stock control system so that every surface stands where it does in ours; return what is left."""
        away = {}
        for control, command, name, wanted, throw in held:
            x0, x1 = fdm[command], fdm[command] + 0.01
            rest(60)
            y0 = fdm[name] - wanted
            for _ in range(12):
                if abs(y0) <= 1e-12 * throw:
                    break
                fdm[command] = x1
                rest(60)
                y1 = fdm[name] - wanted
                if y1 == y0:
                    break
                x0, x1, y0 = x1, float(np.clip(x1 - y1 * (x1 - x0) / (y1 - y0), -1.5, 1.5)), y1
            away[control] = abs(fdm[name] - wanted) / throw
        return away

    away = hold()
    fdm.get_propulsion().get_steady_state()
    A = np.zeros((8, 8))
    for k, step in enumerate(_STEPS):
        columns = []
        for sign in (1.0, -1.0):
            moved = x.copy()
            moved[k] += sign * step
            place(moved)
            away = {c: max(a, away[c]) for c, a in hold().items()}
            rest(40)
            columns.append(np.array([fdm[n] for n in _RATES]))
        A[:, k] = (columns[0] - columns[1]) / (2.0 * step)
    return A, away


def our_matrix(model: tb.LinearModel) -> np.ndarray:
    """Return A (8, 8) with speeds in ft/s; propellers held at their speed, as in the other way."""
    at = [model.states.index(s) for s in _STATES]
    scale = np.array([1.0 / _FT] * 3 + [1.0] * 5)
    return model.A[np.ix_(at, at)] * scale[:, None] / scale[None, :]


def difference(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Return the largest distance between eigenvalues of two matrices, over their size, at best one-to-one match."""
    from scipy.optimize import linear_sum_assignment

    a, b = np.linalg.eigvals(ours), np.linalg.eigvals(theirs)
    floor = 1e-2 * np.abs(a).max()  # a root near zero has no relative accuracy
    cost = np.abs(a[:, None] - b[None, :]) / np.maximum(np.abs(a)[:, None], floor)
    return float(cost[linear_sum_assignment(cost)].max())


def compare(name: str) -> dict[str, str]:
    """Return one row: differences per motion, or why there is none."""
    row = {"name": name, "longitudinal": "", "lateral-directional": "", "note": ""}
    try:
        aircraft = tb.load_aircraft(f"jsbsim:{name}")
        trimmed = tb.trim(aircraft, tb.FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m))
        ours = our_matrix(tb.linearise(aircraft, trimmed))
    except TestbenchError as error:
        return row | {"note": str(error)}
    theirs, away = stock_matrix(name, aircraft, trimmed)
    notes = [f"{c} stands {100.0 * a:.2g} % of its throw elsewhere" for c, a in away.items() if a > 1e-4]
    for plane, states in _PLANES.items():
        i = [_STATES.index(s) for s in states]
        found = difference(ours[np.ix_(i, i)], theirs[np.ix_(i, i)])
        row[plane] = f"{100.0 * found:.3g}"
    return row | {"note": "; ".join(notes)}


def main(names: list[str]) -> None:
    """Compare and print the table; ``make stock`` writes it."""
    rows = []
    for name in names or stock_names():
        row = compare(name)
        rows.append(row)
        print(f"{name:16} {row['longitudinal']:>10} {row['lateral-directional']:>10}  {row['note'][:110]}", flush=True)
    both = [r for r in rows if r["longitudinal"] and max(float(r[p]) for p in _PLANES) <= 100.0 * _WITHIN]
    one = [r for r in rows if r["longitudinal"] and min(float(r[p]) for p in _PLANES) <= 100.0 * _WITHIN]
    print(f"within {100.0 * _WITHIN:g} %: both motions {len(both)}, at least one {len(one)} of {len(rows)}")


if __name__ == "__main__":
    assert math.isclose(_FT, 0.3048)
    main(sys.argv[1:])
