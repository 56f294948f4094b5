"""Flights of an aircraft whose coefficients differ from the believed one's, as a user's files: CSV and a description.

Inputs are small and records quick: speed that changes with a large input, and a surface that bends between samples,
move derivatives by several percent.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

import testbench as tb
from testbench.aircraft import Aircraft, Amendment, ScaleCoefficient
from testbench.inputs import InputSignal
from testbench.line import fly_and_measure

RATE_HZ = 100.0
FLOWN_HZ = 1000.0  # what JSBSim's integration is late by, a frame, then is no part of the derivatives
UNITS = {"V": "m/s", "h": "m", "ax": "m/s2", "ay": "m/s2", "az": "m/s2"}
UNITS |= dict.fromkeys(("alpha", "beta", "theta", "phi", "de", "da", "dr", "de_cmd", "da_cmd", "dr_cmd"), "deg")
UNITS |= dict.fromkeys(("p", "q", "r"), "deg/s")
_EARLY = 1e-9  # steps are at samples, whatever the last digit of a time is


def changed_aircraft(name: str, factors: Mapping[str, float]) -> Aircraft:
    """Return an aircraft with multiples of its coefficients: the truth of a flight."""
    changes = tuple(ScaleCoefficient(k, f) for k, f in factors.items())
    return tb.load_aircraft(name).amended(Amendment("truth", "other coefficients", changes))


def steps(start_s: float, unit_s: float, deg: float, pattern: Sequence[int] = (3, 2, 1, 1)):
    """Return a signal of alternating steps, each so many units long."""

    def signal(t: np.ndarray) -> np.ndarray:
        u, at, sign = np.zeros_like(t), start_s, 1.0
        for count in pattern:
            u[(t >= at - _EARLY) & (t < at + count * unit_s - _EARLY)] = sign * np.radians(deg)
            at, sign = at + count * unit_s, -sign
        return u

    return signal


def flown(aircraft: Aircraft, V: float, h: float, signals: Mapping[str, object], seconds: float):
    """Return the truth of a flight from trim."""
    trimmed = tb.trim(aircraft, tb.FlightCondition(V, h), FLOWN_HZ)
    t = np.arange(round(seconds * FLOWN_HZ)) / FLOWN_HZ
    signal = InputSignal(t, np.column_stack([f(t) for f in signals.values()]), tuple(signals))
    return fly_and_measure(tb.Job(aircraft, trimmed, tb.Manoeuvre("flight", signal, 0.0), RATE_HZ)).flown


def described(
    folder: Path,
    name: str,
    flights: Sequence[object],
    believed: str | None,
    inputs: Sequence[str],
    outputs: Sequence[str],
    estimators: str,
    noise: Mapping[str, float] | None = None,
    seed: int = 1,
) -> Path:
    """Write flights, the last of them for validation, and their description; return the latter.

    Args:
        folder: for the files.
        name: of the description.
        flights: records.
        believed: aircraft of the description.
        inputs: of the identification.
        outputs: likewise.
        estimators: TOML, with [[identification.estimators]].
        noise: channel -> standard deviation in the file's unit.
        seed: of the noise.
    """
    rng = np.random.default_rng(seed)
    channels = list(dict.fromkeys([*outputs, "V", "alpha", "theta", "h", *inputs]))
    text = 'title = "A flight"\nsource = "simulated"\nrights = "free"\nfolder = "."\ntrim_s = 0.9\n'
    text += f'aircraft = "{believed}"\n' if believed else ""
    text += '[time]\ncolumn = "time"\n'
    for i, record in enumerate(flights):
        columns = [record.t_s]
        for c in channels:
            values = np.degrees(record[c]) if UNITS[c].startswith("deg") else record[c]
            columns.append(values + (noise or {}).get(c, 0.0) * rng.standard_normal(len(record)))
        head = ",".join(["time [s]", *(f"{c} [{UNITS[c]}]" for c in channels)])
        np.savetxt(folder / f"{name}_{i}.csv", np.column_stack(columns), "%.12g", ",", header=head, comments="")
        use = "identification" if i < len(flights) - 1 else "validation"
        text += f'[[record]]\nname = "flight {i}"\nfile = "{name}_{i}.csv"\nuse = "{use}"\n'
    for c in channels:
        text += f'[[channel]]\nname = "{c}"\ncolumn = "{c}"\nunit = "{UNITS[c]}"\n'
    listed = ", ".join(f'"{n}"' for n in inputs), ", ".join(f'"{n}"' for n in outputs)
    text += '[preparation]\nbias = "trim"\n'
    text += f"[identification]\ninputs = [{listed[0]}]\noutputs = [{listed[1]}]\n{estimators}"
    file = folder / f"{name}.toml"
    file.write_text(text, encoding="utf-8")
    return file


LONGITUDINAL = '[[identification.estimators]]\nmethod = "output_error"\nstructure = "longitudinal"\n'
LATERAL = '[[identification.estimators]]\nmethod = "output_error"\nstructure = "lateral_directional"\n'
NOISE = {"V": 0.03, "alpha": 0.03, "q": 0.1, "theta": 0.03, "beta": 0.03, "p": 0.1, "r": 0.1, "phi": 0.05}
