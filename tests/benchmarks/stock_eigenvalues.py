"""Eigenvalues of our linear models against central differences made with JSBSim alone, on the models that it ships.

    python tests/benchmarks/stock_eigenvalues.py            # all that trim
    python tests/benchmarks/stock_eigenvalues.py c172p f16

The second way shares nothing with the package but the trimmed state and where controls, mixtures and blades stand: the
stock model is loaded from JSBSim's own folder, its own control system is commanded until the surfaces stand where they
stand in ours, and its accelerations are differenced over u, v, w, p, q, r, phi, theta. Propellers are held at their
speed; those with a governor follow, time passing until they and their blades have come to rest. Where its yaw damper or
stick feels the motion, the command is changed until the surface stands still again, as ours leaves them out.

What cannot be brought to our trim is said: a regulator of its own that moves the throttle, a turboprop that gives no
torque while time stands still, an actuator that lags.
"""

import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import jsbsim
import numpy as np
from smallest import sized

import testbench as tb
from testbench.core.errors import Refusal
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
_INTEGRATORS = tuple(
    f"simulation/integrator/{n}"
    for n in ("rate/rotational", "rate/translational", "position/rotational", "position/translational")
)
_FRAME_S, _MOST_S = 1.0 / 120.0, 120
_STANDS, _SAME, _BALANCED = 1e-5, 1e-4, 1e-3  # of a throw; of a speed; m/s2 or rad/s2


def stock_matrix(name: str, aircraft: tb.Aircraft, trimmed: tb.TrimmedFlight) -> tuple[np.ndarray, list[str]]:
    """Return A (8, 8) of the stock model in ft and s, and in words what stands elsewhere in it than in ours."""
    stock = _Stock(name, aircraft, trimmed)
    stock.place(stock.x)
    away, elsewhere = stock.stand(), stock.elsewhere()
    A = np.zeros((8, 8))
    for k, step in enumerate(_STEPS):
        columns = []
        for sign in (1.0, -1.0):
            moved = stock.x.copy()
            moved[k] += sign * step
            stock.place(moved)
            away = {c: max(a, away[c]) for c, a in stock.stand().items()}
            columns.append(np.array([stock.fdm[n] for n in _RATES]))
        A[:, k] = (columns[0] - columns[1]) / (2.0 * step)
    notes = [f"{c} stands {100.0 * a:.2g} % of its throw elsewhere" for c, a in away.items() if a > _STANDS]
    return A, [*elsewhere, *notes]


class _Stock:
    """The stock model with its engines running, commanded until it stands as ours does at trim."""

    def __init__(self, name: str, aircraft: tb.Aircraft, trimmed: tb.TrimmedFlight) -> None:
        jsbsim.set_logger(jsbsim.FGLogger())
        self.fdm = jsbsim.FGFDMExec(str(stock_root()))
        self.fdm.set_debug_level(0)
        self.fdm.set_dt(_FRAME_S)
        assert self.fdm.load_model(name)
        self._h_ft = trimmed.condition.h_m / _FT
        self.x = np.array(
            [*(trimmed.state[a] / _FT for a in "uvw"), *(trimmed.state[a] for a in "pqr"), trimmed.phi, trimmed.theta]
        )
        for key, value in {**aircraft.adapter.neutral, **aircraft.adapter.settings}.items():
            self.fdm[key] = value
        self._held = []
        for control, command in _COMMANDS.items():
            link = aircraft.adapter.link(control)
            if link is not None:
                drive = link.drives[0]
                d, v = np.array(drive.points).T
                wanted = float(np.interp(trimmed.controls[control], d, v))
                self._held.append((control, command, drive.name, wanted, np.ptp(v)))
        self.place(self.x)
        self._start(aircraft, trimmed)

    def _start(self, aircraft: tb.Aircraft, trimmed: tb.TrimmedFlight) -> None:
        """Start the engines with the blades as ours has them: a governor turns them to a stop and stalls the engine."""
        fdm, propulsion = self.fdm, self.fdm.get_propulsion()
        self._ours = Executive(aircraft, trimmed.rate_hz, trimmed.condition)
        place_at_trim(self._ours, trimmed)
        engines = [f"propulsion/engine[{i}]" for i in range(propulsion.get_num_engines())]
        self._turning = [e for e in engines if self._ours.has(f"{e}/propeller-rpm")]
        self._governed = [e for e in self._turning if self._value(f"{e}/constant-speed-mode")]
        for i in range(len(engines)) if "thr" in trimmed.controls else ():
            for throttle in {f"fcs/throttle-cmd-norm[{i}]", *aircraft.adapter.throttles[i : i + 1]}:
                fdm[throttle] = trimmed.controls["thr"]
        for engine in self._governed:
            fdm[f"{engine}/constant-speed-mode"] = 0.0
            fdm[f"{engine}/blade-angle"] = self._value(f"{engine}/blade-angle")
        propulsion.init_running(-1)
        for i in range(len(engines)):  # once they run: starting makes a mixture full rich
            if self._ours.has(f"fcs/mixture-cmd-norm[{i}]"):
                fdm[f"fcs/mixture-cmd-norm[{i}]"] = self._value(f"fcs/mixture-cmd-norm[{i}]")
        self._rest()
        propulsion.get_steady_state()
        for engine in self._governed:
            fdm[f"{engine}/constant-speed-mode"] = 1.0

    def _value(self, name: str) -> float:
        return self._ours.get(name) if self._ours.has(name) else 0.0

    def place(self, state: np.ndarray) -> None:
        """Set the initial conditions: u, v, w, p, q, r, phi, theta in ft and s."""
        fdm = self.fdm
        fdm["ic/h-sl-ft"] = self._h_ft
        fdm["ic/psi-true-rad"] = 0.0
        fdm["ic/theta-rad"], fdm["ic/phi-rad"] = state[7], state[6]
        for axis, value in zip("uvw", state[:3], strict=True):
            fdm[f"ic/{axis}-fps"] = value
        for axis, value in zip("pqr", state[3:6], strict=True):
            fdm[f"ic/{axis}-rad_sec"] = value

    def _rest(self, frames: int = 60) -> None:
        for _ in range(frames):
            self.fdm.run_ic()

    def stand(self) -> dict[str, float]:
        """Let governors turn the blades and command every surface to where it stands in ours; return what is left."""
        if self._governed:
            self._govern()
        away = self._hold()
        self._rest(40)
        return away

    def _govern(self) -> None:
        """Let time pass in which the aircraft does not move, until propellers and blades come to rest."""
        fdm = self.fdm
        self._rest()
        before = {n: fdm[n] for n in _INTEGRATORS}
        for n in _INTEGRATORS:
            fdm[n] = 0.0
        last = np.inf
        for _ in range(_MOST_S):
            for _ in range(round(1.0 / _FRAME_S)):
                fdm.run()
            now = np.array([fdm[f"{e}/{x}"] for e in self._governed for x in ("propeller-rpm", "blade-angle")])
            if np.all(np.abs(now - last) <= 1e-9 * np.abs(now)):
                break
            last = now
        for n, value in before.items():
            fdm[n] = value

    def _hold(self) -> dict[str, float]:
        """Command the stock control system so that every surface stands where it does in ours; return what is left."""
        fdm, away = self.fdm, {}
        for control, command, name, wanted, throw in self._held:
            x0, x1 = fdm[command], fdm[command] + 0.01
            self._rest()
            y0 = fdm[name] - wanted
            for _ in range(12):
                if abs(y0) <= 1e-12 * throw:
                    break
                fdm[command] = x1
                self._rest()
                y1 = fdm[name] - wanted
                if y1 == y0:
                    break
                x0, x1, y0 = x1, float(np.clip(x1 - y1 * (x1 - x0) / (y1 - y0), -1.5, 1.5)), y1
            away[control] = abs(fdm[name] - wanted) / throw
        return away

    def elsewhere(self) -> list[str]:
        """Return in words which propellers turn at another speed than ours, and what is left of the balance."""
        out = []
        for engine in self._turning:
            ours, theirs = self._value(f"{engine}/propeller-rpm"), self.fdm[f"{engine}/propeller-rpm"]
            if abs(theirs - ours) > _SAME * ours:
                out.append(f"{engine.removeprefix('propulsion/')} turns at {theirs:.0f} rpm, ours at {ours:.0f}")
        left = [self.fdm[n] * (_FT if "ft_" in n else 1.0) for n in _RATES[:6]]
        k = int(np.argmax(np.abs(left)))
        if abs(left[k]) > _BALANCED:
            out.append(f"{left[k]:.2g} {'m/s2' if k < 3 else 'rad/s2'} of {_STATES[k]}dot are left at trim")
        return out


def our_matrix(model: tb.LinearModel) -> np.ndarray:
    """Return A (8, 8) with speeds in ft/s; propellers held at their speed or governed, as in the other way."""
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
        aircraft = tb.load_aircraft(f"jsbsim:{name}", commanded_at="surface")  # the airframe alone
        trimmed = tb.trim(aircraft, tb.FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m))
        ours = our_matrix(tb.linearise(aircraft, trimmed))
    except Refusal as error:
        return row | {"note": str(error)}
    theirs, notes = stock_matrix(name, aircraft, trimmed)
    for plane, states in _PLANES.items():
        i = [_STATES.index(s) for s in states]
        found = difference(ours[np.ix_(i, i)], theirs[np.ix_(i, i)])
        row[plane] = f"{100.0 * found:.3g}"
    return row | {"note": "; ".join(notes)}


def main(names: list[str]) -> None:
    """Compare and print the table; ``make stock`` writes it."""
    rows = []
    for name in names or stock_names()[: sized(None, 1)]:
        row = compare(name)
        rows.append(row)
        print(f"{name:16} {row['longitudinal']:>10} {row['lateral-directional']:>10}  {row['note'][:110]}", flush=True)
    both = [r for r in rows if r["longitudinal"] and max(float(r[p]) for p in _PLANES) <= 100.0 * _WITHIN]
    one = [r for r in rows if r["longitudinal"] and min(float(r[p]) for p in _PLANES) <= 100.0 * _WITHIN]
    print(f"within {100.0 * _WITHIN:g} %: both motions {len(both)}, at least one {len(one)} of {len(rows)}")


if __name__ == "__main__":
    assert math.isclose(_FT, 0.3048)
    main(sys.argv[1:])
