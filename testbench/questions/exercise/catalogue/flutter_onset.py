"""The flutter onset of a wing from flights well below it, by the flutter margin of Zimmerman and Weissenburger."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from testbench.core.constants import DEG_RAD
from testbench.core.record import FloatArray, load_record
from testbench.estimators.settings import Subspace
from testbench.questions.exercise.exercise import Answer, Case, Choice, Handout, Mistake, Number
from testbench.questions.exercise.motion import measured, respond

_DT, _SECONDS, _NOISE, _HORIZON = 0.02, 60.0, 0.04, 40
_SPEEDS = (8.0, 10.0, 12.0, 14.0, 16.0)
_STRAIN = 1e-4
_R2 = 0.25  # radius of gyration squared, half chords
_OUTPUTS = ("strain_wing_1", "strain_wing_2")


def wing(d: Mapping[str, float], V: float) -> FloatArray:
    """Return A (4, 4) of a wing section that plunges and twists in quasi-steady flow at V m/s.

    M x'' + (C + k V B) x' + (K + k V^2 D) x = 0 with x = (h, theta), h down, lengths per half chord: the lift
    k V^2 (theta + h' / V) acts e ahead of the elastic axis, and the twisting rate is damped.
    """
    M = np.array([[1.0, d["x_theta"]], [d["x_theta"], _R2]])
    K = np.diag([d["omega_h"] ** 2, _R2 * d["omega_theta"] ** 2])
    C = 2.0 * d["zeta"] * np.diag([d["omega_h"], _R2 * d["omega_theta"]])
    B, D = np.array([[1.0, 0.0], [-d["e"], d["damping"]]]), np.array([[0.0, 1.0], [0.0, -d["e"]]])
    inverse = np.linalg.inv(M)
    k = d["k"]
    return np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ (K + k * V**2 * D), -inverse @ (C + k * V * B)]])


def growth(d: Mapping[str, float], V: float) -> float:
    """Return the largest real part of the poles at V m/s; positive beyond the onset."""
    return float(np.linalg.eigvals(wing(d, V)).real.max())


def flutter_margin(poles: NDArray[Any]) -> float:
    """Return F = A2 A1 / A3 - (A1 / A3)^2 - A0 of s^4 + A3 s^3 + A2 s^2 + A1 s + A0: zero at the onset."""
    _, A3, A2, A1, A0 = np.poly(poles).real
    return float(A2 * A1 / A3 - (A1 / A3) ** 2 - A0)


def onset(V: Sequence[float], margins: Sequence[float]) -> float:
    """Return the speed at which a parabola in V^2 through the flutter margins becomes zero, beyond the fastest one."""
    scale = max(V) ** 2
    roots = np.roots(np.polyfit(np.square(V) / scale, np.asarray(margins) / margins[0], 2))
    real = [float(r.real) for r in roots if abs(r.imag) < 1e-9 and r.real > 1.0]
    return float(np.sqrt(min(real) * scale)) if real else float("inf")


def draw(rng: Generator) -> Mapping[str, Any]:
    """Draw a wing and its onset, and find the air loads that put the onset there."""
    while True:
        d = {
            "omega_h": float(2.0 * np.pi * rng.uniform(2.2, 2.8)),
            "omega_theta": float(2.0 * np.pi * rng.uniform(5.0, 6.0)),
            "x_theta": float(rng.uniform(0.12, 0.22)),
            "e": float(rng.uniform(0.3, 0.4)),
            "damping": float(rng.uniform(0.1, 0.2)),
            "zeta": float(rng.uniform(0.012, 0.02)),
        }
        onset_m_s = float(rng.uniform(18.5, 22.0))
        for k in np.geomspace(0.01, 2.0, 200):
            if growth({**d, "k": k}, onset_m_s) > 0.0:
                break
        low, high = k / 1.03, k
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if growth({**d, "k": middle}, onset_m_s) > 0.0 else (middle, high)
        d |= {"k": float(low), "onset": onset_m_s}
        poles = np.linalg.eigvals(wing(d, onset_m_s))
        flutters = abs(poles[np.argmax(poles.real)].imag) > 1.0  # not divergence
        guess = onset(_SPEEDS, [flutter_margin(np.linalg.eigvals(wing(d, V))) for V in _SPEEDS])
        if flutters and all(growth(d, V) < -0.1 for V in _SPEEDS) and abs(guess / onset_m_s - 1.0) < 0.02:
            return d


def hand_out(case: Case) -> Handout:
    """Return the response of two strain gauges to binary noise on the ailerons at each speed."""
    rng = np.random.default_rng(case.seed)
    n = round(_SECONDS / _DT)
    records = {}
    for V in _SPEEDS:
        u = 2.0 * DEG_RAD * np.repeat(rng.choice([-1.0, 1.0], n // 2 + 1), 2)[:n]
        A = wing(case.hidden, V)
        B = np.array([[0.0], [0.0], [1.0], [0.6]]) * V**2 / 10.0
        x = respond(A, B, u[:, None], _DT)
        y = x[:, :2] @ np.array([[1.0, 0.5], [1.0, -0.5]]).T
        y = _STRAIN * (y / y.std(axis=0) + _NOISE * rng.normal(size=y.shape))
        columns = {"da_cmd": u, **dict(zip(_OUTPUTS, y.T, strict=True))}
        records[f"speed_{V:02.0f}"] = measured(columns, _DT)
    return Handout(records, {"fastest_m_s": max(_SPEEDS)})


def answer(case: Case) -> Mapping[str, Answer]:
    """Return damping at the fastest speed flown, the ratio of the margins, and the onset."""
    poles = {V: np.linalg.eigvals(wing(case.hidden, V)) for V in _SPEEDS}
    zeta = {V: float(np.min(-s.real / np.abs(s))) for V, s in poles.items()}
    F = {V: flutter_margin(s) for V, s in poles.items()}
    top = max(_SPEEDS)
    slope, intercept = np.polyfit(_SPEEDS[-3:], [zeta[V] for V in _SPEEDS[-3:]], 1)
    straight = float(-intercept / slope) if slope < 0.0 else -1.0
    q_slope, q_intercept = np.polyfit(np.square(_SPEEDS), [F[V] for V in _SPEEDS], 1)
    s = poles[top][np.argmin(-poles[top].real / np.abs(poles[top]))]
    return {
        "least_damping": Answer(
            zeta[top],
            (Mistake(float(-s.real), "this is -Re(s) in 1/s; the damping ratio is that over |s|"),),
            "the smaller of the two damping ratios at the fastest speed",
        ),
        "margin_ratio": Answer(
            F[top] / F[min(_SPEEDS)],
            (Mistake(F[min(_SPEEDS)] / F[top], "the other way round: the margin shrinks with speed"),),
            "F from the four poles at each speed: numpy.poly gives the coefficients",
        ),
        "onset_m_s": Answer(
            case["onset"],
            (
                Mistake(
                    straight, "damping extrapolated on a straight line: it is no measure of the distance to flutter"
                ),
                Mistake(
                    float(np.sqrt(-q_intercept / q_slope)), "a straight line in V²: the margin is a parabola in V²"
                ),
                Mistake(case["onset"] ** 2, "this is V²; take the root"),
            ),
            "F over V² is nearly a parabola; its zero beyond the last flight is the onset",
        ),
        "why": Answer(
            "late",
            (
                Mistake("noise", "damping is estimated well enough here; it gives little information on higher speeds"),
                Mistake("constant", "it does change with speed, often upwards at first"),
                Mistake("frequency", "frequencies come together smoothly, too late for a warning of their own"),
            ),
        ),
    }


def solve(folder: Path) -> dict[str, float | str]:
    """Identify both modes at each speed by MOESP, and extrapolate the flutter margin."""
    from testbench.estimators.subspace import family

    margins, zeta = [], []
    for V in _SPEEDS:
        record = load_record(folder / "records" / f"speed_{V:02.0f}.nc")
        model = family.estimate(
            [record],
            ["da_cmd"],
            _OUTPUTS,
            Subspace(method="moesp", past_horizon=_HORIZON, future_horizon=_HORIZON, order=4, decimate=1),
        )
        s = np.concatenate(list(model.poles().values()))
        margins.append(flutter_margin(s))
        zeta.append(float(np.min(-s.real / np.abs(s))))
    return {
        "least_damping": zeta[-1],
        "margin_ratio": margins[-1] / margins[0],
        "onset_m_s": onset(_SPEEDS, margins),
        "why": "late",
    }


TITLE, LEVEL, MINUTES = "Find the flutter onset from flights below it", 3, 90
QUESTIONS = (
    Number("least_damping", "1", "Smaller of the two damping ratios at the fastest speed flown", 0.15),
    Number("margin_ratio", "1", "Flutter margin at the fastest speed over that at the slowest", 0.1, 0.03),
    Number("onset_m_s", "m/s", "Speed of the flutter onset", 0.08),
    Choice(
        "why",
        "Why not simply extrapolate the damping?",
        {
            "late": "it may stay or even grow with speed, and then fall steeply close to the onset",
            "noise": "damping cannot be identified from such records",
            "constant": "it does not depend on speed",
            "frequency": "the frequencies alone determine the onset better",
        },
    ),
)
