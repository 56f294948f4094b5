"""EOLO paper, figures 4 and 5: energy spectra of manoeuvres and accelerometers, and why accelerometers did not help."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from testbench.inputs.signal import band_share, energy_spectrum, frequency_below
from testbench.page.figure import DOTTED, Panel, Plate, Rule
from testbench.page.labels import number
from testbench.page.tables import Column, Table
from testbench.page.words import listed
from testbench.questions.reproduce.bench import BAND_RAD_S, EOLO_PAST, IDENTIFICATION
from testbench.questions.reproduce.section import Comparison, Say, Section, Why, claim_row, judge_claim, line, plate
from testbench.questions.run.ask import run
from testbench.questions.run.result import RunResult
from testbench.questions.run.scenario import Scenario

CHOSEN, NONE, FIVE = "6 3-2-1-1 of 0.4 s", "eolo_no_alpha", "eolo_five_accelerometers"
EXCITED_DB = 10.0  # response over noise from which a mode counts as excited
Shares = tuple[float, float, float]
"""Percent of energy below 10 rad/s, frequency below which 95 % lie (rad/s), octaves within 10 dB of the peak."""


def section(say: Say) -> Section:
    """Return what the elevator's manoeuvres and the accelerometers hold."""
    say("EOLO: spectra of seven manoeuvres")
    seven = run(Scenario.load("reproduction/eolo_seven_manoeuvres"), causes=False)
    say("EOLO: spectra of the accelerometers")
    wing = run(Scenario.load("reproduction/eolo_accelerometers"), causes=False)
    assert wing.truth is not None
    shares = _shares(seven)
    elastic = {e.mode: max(e.snr_db.values()) for e in wing.truth.excitation if "wing" in e.mode}
    mean = {(c.suite, str(c.estimator.label)): _rigid_mean(c) for c in wing.cases}
    return Section(
        "eolo_inputs",
        "Spectra of manoeuvres and accelerometers (figures 4 and 5)",
        findings(shares, elastic, mean),
        comparisons(shares, mean),
        (_seven_table(shares), _wing_table(wing)),
        (_seven_plate(seven), _wing_plate(wing)),
    )


def unknowns(inputs: int, outputs: int, past: int = EOLO_PAST) -> int:
    """Return the unknowns per output of step 1 of DSR_e: past horizon times channels."""
    return past * (inputs + outputs)


def findings(
    shares: Mapping[str, Shares], elastic: Mapping[str, float], mean: Mapping[tuple[str, str], float]
) -> tuple[str, ...]:
    """Return what spectra and accelerometers say, in words; ``elastic`` is mode -> dB of its best sensor."""
    clear = [n for n, db in elastic.items() if db >= EXCITED_DB]
    columns = IDENTIFICATION - EOLO_PAST
    asked = unknowns(2, 8)
    changes = [
        f"from {mean[NONE, label]:.1f} to {mean[FIVE, label]:.1f} % at {label}"
        for label in dict.fromkeys(label for _, label in mean)
    ]
    helps = [
        label for label in dict.fromkeys(label for _, label in mean) if mean[FIVE, label] < 0.9 * mean[NONE, label]
    ]
    return (
        f"The 3-2-1-1 of 0.4 s has {shares[CHOSEN][0]:.0f} % of its energy below {BAND_RAD_S:g} rad/s, and "
        + (f"{len(clear)}" if clear else "none")
        + f" of the {len(elastic)} flexible modes rises {EXCITED_DB:g} dB over the noise of the best accelerometer: "
        f"the clearest stands at {max(elastic.values()):+.0f} dB".replace("-", "−"),
        f"With J = {EOLO_PAST}, two inputs and eight outputs the first step has {asked} unknowns per output and some "
        f"{columns} columns, so that accelerometers "
        + ("could not show what they are worth" if asked > columns else "could show what they are worth")
        + ". With J = 40 they change the mean MRSE of q, V and θ on the identification half "
        + listed(changes)
        + (
            f": a wing's acceleration is its lift and replaces the missing α at {listed(helps)}, a short future"
            if helps and len(helps) < len(changes)
            else ": more than a tenth better everywhere"
            if helps
            else ": nowhere a tenth better, as the paper says"
        ),
    )


def comparisons(shares: Mapping[str, Shares], mean: Mapping[tuple[str, str], float]) -> tuple[Comparison, ...]:
    """Return figures 4 and 5 and what the text says of them beside ours."""
    below, above95, _ = shares[CHOSEN]
    widest = max(shares, key=lambda n: shares[n][2])
    without, with_ = mean[NONE, "L = 4"], mean[FIVE, "L = 4"]
    return (
        claim_row(
            "the 3-2-1-1 has its energy below 10 rad/s",
            "section 3.2, figure 4",
            f"components below {BAND_RAD_S:g} rad/s",
            f"{below:.0f} % of the energy below {BAND_RAD_S:g} rad/s, 95 % below {number(above95)} rad/s; “agrees” "
            "from 90 %, in kind from 80 %",
            judge_claim(below >= 90.0, below >= 80.0),
            Why(
                "The step length is not printed; 0.4 s was chosen by this very statement.",
                "The step length is not printed; 0.4 s was chosen by this very statement. Sharp steps have a tail.",
                "The step length that was assumed is too short for the statement.",
            ),
        ),
        claim_row(
            "the 3-2-1-1 has the richest spectrum of seven manoeuvres",
            "figure 4",
            "the 3-2-1-1 of 1300 s to 1325 s",
            f"“{widest}” of our seven, {number(shares[widest][2], 2)} octaves within 10 dB of its peak; a doublet of "
            f"2 s has {number(shares['3 doublet 2 s'][2], 2)}; “agrees” if it is the 3-2-1-1 of the window",
            judge_claim(widest == CHOSEN, "3-2-1-1" in widest),
            Why(
                "What the other windows held cannot be read from the text; a sequence that fits it is assumed.",
                "Another 3-2-1-1 is richer still.",
                "A doublet is richer here.",
            ),
        ),
        claim_row(
            "accelerometers add nothing to q, V and θ",
            "section 3.2, figure 5",
            "no improvement observed",
            f"mean MRSE with J = 40, L = 4: {without:.1f} % without, {with_:.1f} % with five; “agrees” if less than a "
            "tenth better",
            judge_claim(with_ > 0.9 * without),
            Why(
                "They show neither a flexible mode nor more of the rigid motion.",
                "",
                f"With the paper's J = {EOLO_PAST} eight outputs leave {unknowns(2, 8)} unknowns to "
                f"{IDENTIFICATION - EOLO_PAST} columns: no improvement could show; with a shorter past one does.",
            ),
        ),
    )


def _rigid_mean(case: object) -> float:
    scores = case.evaluation.identification.mrse_percent  # type: ignore[attr-defined]
    outputs = case.model.outputs  # type: ignore[attr-defined]
    return float(np.mean([scores[outputs.index(o)] for o in ("q", "V", "theta")]))


def _shares(result: RunResult) -> dict[str, Shares]:
    """Return manoeuvre -> percent of energy below 10 rad/s, frequency that 95 % lie below, octaves within 10 dB."""
    out = {}
    for flight in result.flights:
        assert flight.truth is not None
        u = flight.truth["de_cmd"] - flight.truth["de_cmd"][0]
        dt = flight.truth.dt_s
        omega = np.geomspace(0.1, 100.0, 2000)
        energy = energy_spectrum(u, dt, omega)[:, 0]
        inside = float(np.mean(energy >= 0.1 * energy.max()) * np.log2(omega[-1] / omega[0]))
        share = 100.0 * float(np.squeeze(band_share(u, dt, 0.0, BAND_RAD_S)))
        out[flight.name] = (share, float(np.squeeze(frequency_below(u, dt, 0.95))), inside)
    return out


def _seven_table(shares: dict[str, Shares]) -> Table:
    return Table.of(
        "eolo_manoeuvres",
        "Energy of the seven manoeuvres",
        "Of the commanded elevator, whole spectrum: share below 10 rad/s, the frequency that 95 % lie below, and the "
        "octaves within 10 dB of the peak.",
        (
            Column("manoeuvre", "manoeuvre", get=lambda x: x[0]),
            Column("below", "below 10 rad/s", "%", decimals=1, get=lambda x: x[1][0]),
            Column("below95", "95 % below", "rad/s", get=lambda x: x[1][1]),
            Column("octaves", "width", "octaves", decimals=1, get=lambda x: x[1][2]),
        ),
        shares.items(),
    )


def _wing_table(result: RunResult) -> Table:
    assert result.truth is not None
    return Table.of(
        "eolo_accelerometers",
        "What the 3-2-1-1 does to each mode, with five accelerometers",
        "Share of the input's energy in each mode's band, and the sensor that shows the mode best over its own noise. "
        "A mode counts as excited from 10 dB.",
        (
            Column("mode", "mode"),
            Column("wn", "ωn", "rad/s", get=lambda e: abs(e.pole)),
            Column("share", "input energy in its band", "%", digits=2, get=lambda e: 100.0 * e.input_share),
            Column("sensor", "best sensor", get="best_sensor"),
            Column("snr", "over its noise", "dB", decimals=0, get=lambda e: float(e.snr_db[e.best_sensor])),
        ),
        result.truth.excitation,
    )


def _seven_plate(result: RunResult) -> Plate:
    omega = np.geomspace(0.1, 40.0, 400)
    lines = []
    for k, flight in enumerate(result.flights):
        record = flight.measured["eolo_no_alpha"]
        u = record["de"] - np.mean(record["de"][:150])
        energy = energy_spectrum(u, record.dt_s, omega)[:, 0] * np.degrees(1.0) ** 2
        chosen = flight.name.startswith("6")
        lines.append(
            line(omega, energy, flight.name, "ink" if chosen else "quiet" if k > 5 else k, width=2.2 if chosen else 1.2)
        )
    return plate(
        "eolo_figure4",
        "EOLO figure 4: energy spectra of seven manoeuvres",
        "Measured elevator deflection. The floor on the right is the noise of the elevator's sensor.",
        (
            Panel(
                x="ω, rad/s", y="|Δδe(ω)|², deg² s²", log_x=True, log_y=True, x_range=(0.1, 40.0),
                draws=[*lines, Rule(at=BAND_RAD_S, text="10 rad/s", dash=DOTTED)],
            ),
        ),
        columns=1,
        height_in=2.6,
    )  # fmt: skip


def _wing_plate(result: RunResult) -> Plate:
    omega = np.geomspace(0.3, 150.0, 300)
    record = result.flights[0].measured["eolo_five_accelerometers"]
    assert result.truth is not None
    marks = [
        Rule(at=abs(s), text=name.split(" and")[0].replace("symmetric wing ", ""), dash=DOTTED)
        for name, s in result.truth.modes.items()
        if abs(s) > 20.0
    ]
    width = 2.0 ** (1.0 / 6.0)
    lines = []
    names = [c for c in record.channels if c.startswith("az_wing")]
    fine = np.geomspace(0.25, 180.0, 4000)
    for k, name in enumerate(names):
        energy = energy_spectrum(record[name] - np.mean(record[name][:150]), record.dt_s, fine)[:, 0]
        smooth = np.array([energy[(fine > w / width) & (fine < w * width)].mean() for w in omega])
        lines.append(line(omega, smooth, f"accelerometer {name.removeprefix('az_wing_')}", k))
    return plate(
        "eolo_figure5",
        "EOLO figure 5: energy spectra of five accelerometers along the wing",
        "Response to the 3-2-1-1, means over a third of an octave; the flat right part is the noise of the sensors. "
        "Dotted: the flexible modes in flight.",
        [
            Panel(
                x="ω, rad/s", y="|Δaz(ω)|², (m/s)²", draws=[*lines, *marks], log_x=True, log_y=True, x_range=(0.3, 150)
            )
        ],
        columns=1,
        height_in=2.6,
    )
