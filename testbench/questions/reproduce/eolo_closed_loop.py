"""Open question of the EOLO paper: identification with a stability augmentation system at work."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from testbench.aircraft.amend import Amendment, Insert
from testbench.core.record import FlightRecord
from testbench.core.scenario.inputs import StandardMultistep
from testbench.estimators.identification import Estimator
from testbench.estimators.prepare import prepare
from testbench.inputs import build
from testbench.page.figure import Panel, Plate
from testbench.page.tables import Column, Table
from testbench.questions.reproduce.bench import Bench, attempt, bench, dsr_e, subspace
from testbench.questions.reproduce.section import (
    Comparison,
    Say,
    Section,
    Why,
    claim_row,
    judge_claim,
    line,
    plate,
    span,
)
from testbench.sensors import load_suite

GAIN_S = 0.8
AMPLITUDES_DEG = (4.0, 2.0, 1.0)
TURBULENCE_M_S = 1.0
OMEGA = np.geomspace(1.0, 12.0, 40)
OUTPUTS = ("q", "V", "alpha", "theta")
_SEEDS = 4
_DURATION_S, _SETTLE_S = 28.0, 2.0
_COMMAND = "SSARX"
_FULL_RAD = 0.4363323  # full deflection of EOLO's elevator, by which the command is scaled
_SUM = "flight_control/channel[@name='elevator']/fcs_function[@name='fcs/elevator-command-rad']/function/product/sum"

OPEN_LOOP = ("MOESP", "N4SID", "CVA", "DSR_e")
CLOSED_LOOP = ("DSR_e, closed loop", "SSARX", "PBSID-opt")
METHODS: dict[str, Estimator] = {
    **{m.upper(): subspace(m, 5, 40, 40) for m in ("moesp", "n4sid", "cva")},
    "DSR_e": dsr_e(5, 40, 40),
    "DSR_e, closed loop": dsr_e(5, 40, 40, closed_loop=True),
    "SSARX": subspace("ssarx", 5, 40, 40, closed_loop=True),
    "PBSID-opt": subspace("pbsid_opt", 5, 40, 40, closed_loop=True),
}
"""Name -> estimator; those of OPEN_LOOP assume an input that does not react to the outputs."""


def pitch_damper(gain_s: float) -> Amendment:
    """Return a pitch damper: elevator command = pilot's + gain q (trailing edge down for nose up)."""
    feedback = f"<product><value>{gain_s / _FULL_RAD!r}</value><property>velocities/q-rad_sec</property></product>"
    return Amendment("pitch damper", f"elevator command + {gain_s:g} s times pitch rate", (Insert(_SUM, feedback),))


def _steps(amplitude_deg: float) -> tuple[StandardMultistep, ...]:
    return tuple(
        StandardMultistep(signal="3211", control="de", amplitude_deg=amplitude_deg, step_s=0.25, start_s=start)
        for start in (0.0, 15.0)
    )


def fly_augmented(stand: Bench, amplitude_deg: float, seed: int) -> FlightRecord:
    """Return the measured record of two 3-2-1-1 in turbulence."""
    truth = stand.fly(_steps(amplitude_deg), _DURATION_S, settle_s=_SETTLE_S, turbulence_m_s=TURBULENCE_M_S, seed=seed)
    return prepare(load_suite("eolo_alpha").measure(truth, seed), bias="trim", trim_s=_SETTLE_S)


def response_error(spec: Estimator, record: FlightRecord, truth: Bench) -> float:
    """Return the error of q per measured elevator against the bare airframe, percent of its size; NaN if refused."""
    model = attempt(spec, [record], ["de"], OUTPUTS)
    if model is None:
        return float("nan")
    true = truth.truth.linear.frequency_response(OMEGA, ["q"], ["de"])[:, 0, 0]
    found = model.frequency_response(OMEGA)[:, 0, 0]
    return float(100.0 * np.sqrt(np.mean(np.abs(found - true) ** 2) / np.mean(np.abs(true) ** 2)))


def section(say: Say) -> Section:
    """Return what feedback does to each method."""
    bare = bench("eolo_alpha")
    stand = bench("eolo_alpha", pitch_damper(GAIN_S))
    errors: dict[float, dict[str, float]] = {}
    command: list[tuple[float, float]] = []
    for amplitude in AMPLITUDES_DEG:
        say(f"EOLO: pitch damper at work, 3-2-1-1 of {amplitude:g} deg in turbulence")
        records = [fly_augmented(stand, amplitude, seed) for seed in range(1, _SEEDS + 1)]
        errors[amplitude] = {
            name: float(np.nanmedian([response_error(spec, r, bare) for r in records]))
            for name, spec in METHODS.items()
        }
        if amplitude == AMPLITUDES_DEG[0]:
            command = [command_errors(with_command(r, amplitude, stand), bare, stand) for r in records]
    pilot = tuple(float(v) for v in np.median(np.array(command), axis=0))
    return Section(
        "eolo_closed_loop",
        "Closed loop: a stability augmentation system at work",
        findings(errors, (pilot[0], pilot[1])),
        (comparison(errors[AMPLITUDES_DEG[0]]),),
        (_table(errors),),
        (_plate(errors),),
    )


def with_command(record: FlightRecord, amplitude_deg: float, stand: Bench) -> FlightRecord:
    """Return ``record`` with the surface replaced by what the pilot commanded, known without error."""
    u = build(_steps(amplitude_deg), _DURATION_S, stand.trimmed.rate_hz)
    command = np.interp(record.t_s - record.t_s[0] - _SETTLE_S, u.t_s, u.u[:, 0], left=0.0, right=0.0)
    return record.with_columns({"de": command})


def command_errors(record: FlightRecord, bare: Bench, stand: Bench) -> tuple[float, float]:
    """Return the errors of q per command against the bare airframe and against the augmented one, percent."""
    return response_error(METHODS[_COMMAND], record, bare), response_error(METHODS[_COMMAND], record, stand)


def findings(errors: Mapping[float, Mapping[str, float]], pilot: tuple[float, float]) -> tuple[str, ...]:
    """Return what feedback does, in words; ``pilot``: errors from the command against bare and augmented airframe."""
    large, small = errors[AMPLITUDES_DEG[0]], errors[AMPLITUDES_DEG[-1]]
    open_, closed = [large[n] for n in OPEN_LOOP], [large[n] for n in CLOSED_LOOP]
    parted = max(closed) < min(open_)
    grows = all(small[n] > large[n] for n in METHODS)
    return (
        f"With a pitch damper of {GAIN_S:g} s at work in turbulence of {TURBULENCE_M_S:g} m/s, methods that allow for "
        f"feedback find the bare airframe's q per elevator to {span(closed, '%', 0)}, methods that do not to "
        f"{span(open_, '%', 0)} (3-2-1-1 of {AMPLITUDES_DEG[0]:g} deg, {OMEGA[0]:g} to {OMEGA[-1]:g} rad/s)"
        + (": no method of the second kind comes near the first" if parted else ": the two kinds overlap"),
        f"From the pilot's command instead of the measured surface {_COMMAND} finds "
        + (
            f"the augmented aircraft (to {pilot[1]:.0f} %) and not the bare one ({pilot[0]:.0f} %)"
            if pilot[1] < pilot[0]
            else f"neither surely: the bare aircraft to {pilot[0]:.0f} %, the augmented to {pilot[1]:.0f} %"
        ),
        f"With {AMPLITUDES_DEG[-1]:g} deg instead of {AMPLITUDES_DEG[0]:g} the errors are "
        f"{span([small[n] for n in CLOSED_LOOP], '%', 0)} and {span([small[n] for n in OPEN_LOOP], '%', 0)}"
        + (
            ": the smaller the pilot's input, the more of the elevator's motion is the damper's answer to gusts"
            if grows
            else ""
        ),
    )


def comparison(large: Mapping[str, float]) -> Comparison:
    """Return the paper's choice of DSR_e for closed loop beside the errors of DSR_e and the methods for open loop."""
    own, free = large["DSR_e, closed loop"], large["DSR_e"]
    return claim_row(
        "DSR_e serves in closed loop",
        "sections 1 and 2, reference 4",
        "DSR_e was chosen because it also serves in closed loop",
        f"q per elevator to {own:.0f} % with B of its deterministic problem, {free:.0f} % with B from the free run; "
        "“agrees” if the first is below half of the best method that assumes an open loop, in kind if below it",
        judge_claim(own < 0.5 * min(large[n] for n in OPEN_LOOP), own < min(large[n] for n in OPEN_LOOP)),
        Why(
            "A and K of DSR_e allow for feedback; B does so if it is not fitted to the free run.",
            "It does better than methods that assume an open loop.",
            "It does no better than methods that assume an open loop.",
        ),
    )


def _table(errors: Mapping[float, Mapping[str, float]]) -> Table:
    rows = [
        (name, "yes" if name in CLOSED_LOOP else "no", *(errors[a][name] for a in AMPLITUDES_DEG)) for name in METHODS
    ]
    return Table(
        "eolo_closed_loop",
        "Error of q per elevator with the pitch damper at work",
        f"Against the bare airframe, 1 to 12 rad/s, in percent of its size; order 5, J = L = 40, medians over {_SEEDS} "
        "turbulences and noises. Columns: amplitude of the pilot's 3-2-1-1.",
        (
            Column("method", "method"),
            Column("feedback", "allows for feedback"),
            *(Column(f"error {a:g} deg", f"{a:g} deg", "%", decimals=0) for a in AMPLITUDES_DEG),
        ),
        tuple(rows),
    )


def _plate(errors: Mapping[float, Mapping[str, float]]) -> Plate:
    x = np.array(AMPLITUDES_DEG)
    lines = []
    for k, name in enumerate(METHODS):
        y = np.array([errors[a][name] for a in AMPLITUDES_DEG])
        closed = name in CLOSED_LOOP
        lines.append(
            line(x, y, name, k if k < 6 else "ink", marker="^" if closed else "o", width=2.0 if closed else 1.0)
        )
    return plate(
        "eolo_closed_loop",
        "Feedback biases methods that do not allow for it",
        "Triangles: methods that allow for feedback; circles: methods that assume an open loop.",
        [Panel(x="amplitude of the 3-2-1-1, deg", y="error of q per elevator, %", draws=lines, log_x=True, log_y=True)],
        columns=1,
        height_in=2.4,
    )
