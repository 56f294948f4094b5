"""EOLO paper, figure 8: Bode plots at five speeds beside the identified model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from testbench.core.record import FloatArray
from testbench.estimators.model import ComplexArray
from testbench.evaluation.envelope import Envelope, fly_envelope
from testbench.evaluation.metrics import bode_error
from testbench.evaluation.modes import frequency_and_damping
from testbench.page.figure import DOTTED, PHASE_STEPS, Panel, Plate, Rule
from testbench.page.labels import ratio_unit, symbol
from testbench.page.tables import Column, Table, Value
from testbench.page.words import listed
from testbench.questions.reproduce.bench import BAND_RAD_S, HEIGHT_M, RATE_HZ, SPEEDS_M_S, VIBRATION_M_S, A, B, C, D
from testbench.questions.reproduce.section import Comparison, Say, Section, Why, claim_row, judge_claim, line, plate
from testbench.questions.run.ask import run
from testbench.questions.run.result import RunResult
from testbench.questions.run.scenario import Scenario

OUTPUTS = ("q", "V", "theta")
BAND = (1.0, BAND_RAD_S)  # rad/s: above the phugoid, below the end of the paper's input
NEAR_DB, FAR_DB = 3.0, 6.0
_FLOWN_M_S = 16.0


def printed_response(omega_rad_s: FloatArray) -> ComplexArray:
    """Return the frequency response (k, 3, 1) of the printed A, B, C, D at 100 Hz: q, V, theta per rad of elevator."""
    z = np.exp(1j * np.asarray(omega_rad_s) / RATE_HZ)[:, None, None]
    return np.asarray(C @ np.linalg.solve(z * np.eye(len(A)) - A, B[None]) + D, np.complex128)


def section(say: Say) -> Section:
    """Return the frequency responses over speed, and the identified ones, ours and the printed, among them."""
    say("EOLO: Bode plots at five speeds")
    result = run(Scenario.load("reproduction/eolo_table3"), causes=False)
    assert result.truth is not None
    found = fly_envelope(result.truth.aircraft, SPEEDS_M_S, HEIGHT_M)
    model = result.cases[0].model
    omega = np.geomspace(*BAND, 60)
    true = result.truth.response(omega, OUTPUTS, ["de"], model.dt_s)
    rows = [model.outputs.index(o) for o in OUTPUTS]
    ours = bode_error(model.frequency_response(omega)[:, rows], true).magnitude_db
    printed = {
        V: bode_error(printed_response(omega), m.frequency_response(omega, OUTPUTS, ["de"])).magnitude_db
        for V, m in zip(found.speeds, found.models, strict=True)
    }
    unstable = {
        V: [n for n in found.elastic if max(p.real for p in poles[n]) > 0.0]
        for V, poles in zip(found.speeds, found.poles, strict=True)
    }
    return Section(
        "eolo_bode",
        "Bode plots at five speeds (figure 8)",
        findings(ours, printed, unstable, (float(abs(printed_response(omega)[-1, 1, 0])), float(abs(true[-1, 1, 0])))),
        comparisons(ours, printed, unstable),
        (_distance_table(ours, printed), _mode_table(found)),
        (_plate(found, result),),
    )


def _three(values: FloatArray) -> str:
    return ", ".join(f"{symbol(o)} {v:.1f} dB" for o, v in zip(OUTPUTS, values, strict=True))


def nearest_speed(printed: Mapping[float, FloatArray]) -> float:
    """Return the speed whose linearised aircraft lies nearest to the printed model in q and theta."""
    return min(printed, key=lambda V: float(printed[V][0] + printed[V][2]))


def findings(
    ours: FloatArray,
    printed: Mapping[float, FloatArray],
    unstable: Mapping[float, Sequence[str]],
    floor: tuple[float, float],
) -> tuple[str, ...]:
    """Return how near the models lie, in words; ``floor``: |V / de| at the end of the band, printed and aircraft's."""
    best = nearest_speed(printed)
    close = [symbol(o) for o, v in zip(OUTPUTS, printed[best], strict=True) if v <= NEAR_DB]
    wide = [symbol(o) for o, v in zip(OUTPUTS, printed[best], strict=True) if v > FAR_DB]
    shaking = [V for V, names in unstable.items() if names]
    band = f"{BAND[0]:g} to {BAND[1]:g} rad/s"
    return (
        f"From {band} the model that the paper prints lies nearest to our linearised aircraft at {best:g} m/s "
        f"({_three(printed[best])} rms), our own identified model at {_FLOWN_M_S:g} m/s to {_three(ours)}"
        + (f"; within {NEAR_DB:g} dB of the printed one are {listed(close)}" if close else "")
        + (
            f". {listed(wide)} of the printed model is still {floor[0]:.1f} m/s per rad at {BAND[1]:g} rad/s, where "
            f"the aircraft's is {floor[1]:.2f}: noise taken for motion"
            if wide == [symbol("V")]
            else ""
        ),
        f"At {listed([f'{V:g}' for V in shaking])} m/s the simulated aircraft has an unstable mode of the wing "
        f"({listed(sorted({n for V in shaking for n in unstable[V]}))}): Bode plots can be drawn there, but "
        "nobody could fly them"
        if shaking
        else "The simulated aircraft has no unstable elastic mode at the five speeds",
    )


def comparisons(
    ours: FloatArray, printed: Mapping[float, FloatArray], unstable: Mapping[float, Sequence[str]]
) -> tuple[Comparison, ...]:
    """Return figure 8 and the pilot's report beside ours."""
    best = nearest_speed(printed)
    shaking = [V for V, names in unstable.items() if names]
    safe = [V for V, names in unstable.items() if not names]
    rule = f"; “agrees” if all lie within {NEAR_DB:g} dB, in kind if q and θ within {FAR_DB:g} dB"
    rigid, own = max(printed[best][0], printed[best][2]), max(ours[0], ours[2])
    between = bool(shaking and safe) and max(safe) <= VIBRATION_M_S <= min(shaking)
    speed = "V hardly moves above the phugoid: its record there is noise, and so is the model."
    return (
        claim_row(
            "the printed model responds like our linearised aircraft", "figure 8, A, B, C, D", "similar behaviour",
            f"{_three(printed[best])} rms at {best:g} m/s, the nearest of five speeds" + rule,
            judge_claim(bool(np.all(printed[best] <= NEAR_DB)), rigid <= FAR_DB),
            Why("All three outputs.", "q and θ come out. " + speed, "Not even q and θ come out."),
        ),
        claim_row(
            "our identified model responds like our linearised aircraft", "figure 8", "similar behaviour",
            f"{_three(ours)} rms at {_FLOWN_M_S:g} m/s" + rule,
            judge_claim(bool(np.all(ours <= NEAR_DB)), own <= FAR_DB),
            Why("All three outputs.", "q and θ come out. " + speed, "Not even q and θ come out."),
        ),
        claim_row(
            "vibration from about 20 m/s on", "section 3.2", f"at velocities of about {VIBRATION_M_S:g} m/s",
            f"an unstable mode from {shaking[0]:g} m/s on, none at {max(safe):g} m/s" if between else
            f"unstable at {listed([f'{V:g}' for V in shaking])} m/s",
            judge_claim(between),
            Why("The elastic model was derived to begin to vibrate there: an assumption, no prediction.", "",
                "The simulated wings flutter elsewhere."),
        ),
    )  # fmt: skip


def _distance_table(ours: FloatArray, printed: Mapping[float, FloatArray]) -> Table:
    rows: list[tuple[Value, ...]] = [
        (f"printed model and aircraft at {V:g} m/s", *(float(v) for v in d)) for V, d in printed.items()
    ]
    rows.append((f"our model and aircraft at {_FLOWN_M_S:g} m/s", *(float(v) for v in ours)))
    return Table(
        "eolo_bode_distance",
        "How far the models lie from the linearised aircraft",
        f"Root mean square of the ratio of magnitudes in dB, {BAND[0]:g} to {BAND[1]:g} rad/s. The printed model is "
        "that of the printed A, B, C and D, elevator in rad.",
        (Column("pair", "pair"), *(Column(o, f"{symbol(o)} / δe", "dB", decimals=1) for o in OUTPUTS)),
        tuple(rows),
    )


def _mode_table(found: Envelope) -> Table:
    rows = []
    for name in found.names("longitudinal", False) + found.names("longitudinal", True):
        cells: list[str | float] = [name]
        for poles in found.poles:
            s = max(poles[name], key=lambda p: p.real)
            wn, zeta = frequency_and_damping(s)
            real = abs(s.imag) < 1e-9
            cells.append(
                " and ".join(f"{p.real:.2f} 1/s" for p in poles[name]).replace("-", "−")
                if real
                else f"{wn:.2f} rad/s, ζ {zeta:.3f}".replace("-", "−")
            )
        rows.append(tuple(cells))
    return Table(
        "eolo_modes",
        "Longitudinal modes of the simulated aircraft at the five speeds",
        f"At {HEIGHT_M:g} m. A negative damping ratio is an unstable mode.",
        (Column("mode", "mode"), *(Column(f"V{V:g}", f"{V:g} m/s") for V in found.speeds)),
        tuple(rows),
        wide=True,
    )


_PHASES = {"q": 120.0, "V": 100.0, "theta": 30.0}  # of the aircraft near 3 rad/s: the branch on which phases are drawn


def _plate(found: Envelope, result: RunResult) -> Plate:
    omega = np.geomspace(0.1, 60.0, 300)
    model = result.cases[0].model
    own, theirs = model.frequency_response(omega)[:, :, 0], printed_response(omega)[:, :, 0]
    panels = []
    for i, output in enumerate(OUTPUTS):
        factor, unit = ratio_unit(output, "de")
        responses = [
            (f"{V:g} m/s", m.frequency_response(omega, [output], ["de"])[:, 0, 0])
            for V, m in zip(found.speeds, found.models, strict=True)
        ]
        responses.append(("identified here, n = 4", own[:, model.outputs.index(output)]))
        responses.append(("printed A, B, C, D", theirs[:, i]))
        size, phase = [], []
        for k, (name, H) in enumerate(responses):
            extra = k - len(found.speeds)
            colour: int | str = k if extra < 0 else ("ink", "quiet")[extra]
            width = 1.2 if extra < 0 else (1.6, 2.4)[extra]
            angle = np.degrees(np.unwrap(np.angle(H)))
            middle = float(np.interp(3.0, omega, angle))
            angle = angle - 360.0 * np.round((middle - _PHASES[output]) / 360.0)
            size.append(line(omega, factor * np.abs(H), name, colour, width=width))
            phase.append(line(omega, angle, name, colour, width=width))
        mark = Rule(at=10.0, text="10 rad/s", dash=DOTTED)
        axis: dict[str, Any] = {"x": "ω, rad/s", "log_x": True, "x_range": (0.1, 60.0)}
        head = f"{symbol(output)} / δe"
        panels.append(Panel(title=f"{head}, {unit}", y="magnitude", draws=[*size, mark], log_y=True, **axis))
        panels.append(Panel(title=head, y="phase, deg", draws=[*phase, mark], y_steps=PHASE_STEPS, **axis))
    return plate(
        "eolo_figure8",
        "EOLO figure 8: frequency responses to the elevator",
        f"Coloured: the linearised aircraft at five speeds and {HEIGHT_M:g} m. Without colour: our model of order 4 "
        f"identified at {_FLOWN_M_S:g} m/s, and thick the printed model. Right of {BAND_RAD_S:g} rad/s the input has "
        "little energy, and both models little meaning.",
        panels,
        height_in=1.4,
    )
