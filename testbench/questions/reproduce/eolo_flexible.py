"""Open question of the EOLO paper: what makes the flexible modes identifiable, and modal coordinates from the wing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.aircraft.airframe import mode_at
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.scenario.inputs import Input, StandardMultistep
from testbench.estimators.prepare import prepare
from testbench.evaluation.excitation import excitation
from testbench.evaluation.modes import match_poles
from testbench.page.figure import Panel, Plate
from testbench.page.labels import symbol
from testbench.page.tables import Column, Table, Value
from testbench.questions.reproduce.bench import Bench, attempt, bench, subspace
from testbench.questions.reproduce.section import (
    Comparison,
    Say,
    Section,
    Why,
    claim_row,
    judge_claim,
    line,
    not_printed,
    plate,
)
from testbench.sensors import load_suite

SUITES = {
    "eolo_no_alpha": "q, V, θ",
    "eolo_five_accelerometers": "and five accelerometers",
    "eolo_strain": "and five strain gauges",
}
_SEEDS = 4
STEPS, SINE = "3-2-1-1", "multisine to 24 Hz"
RIGID, ACCELEROMETERS, STRAIN = SUITES
_TWELVE_STATES = subspace("cva", 12, 30, 30, direct=True)
SYMMETRIC = (1, 5, 7)  # numbers of EOLO's symmetric modes: first bending, first torsion, second bending


@dataclass(frozen=True)
class Found:
    """How well one mode came out: share of runs with a pole for it within 10 % in ωn and 0.1 in ζ, median errors."""

    share: float
    wn_percent: float
    zeta: float


_WITH = dict(zip(SUITES, ("no instruments on the wing", "five accelerometers", "five strain gauges"), strict=True))
Results = dict[tuple[str, str, bool], dict[str, Found]]  # (input, suite, with noise) -> mode -> how well it came out
Coordinates = Mapping[str, Mapping[str, tuple[FloatArray, FloatArray]]]


def inputs(stand: Bench) -> dict[str, Input]:
    """Return the paper's kind of input and one that reaches the modes."""
    return {
        STEPS: StandardMultistep(signal="3211", control="de", amplitude_deg=2.0, step_s=0.4),
        SINE: stand.scenario.manoeuvre[0].input[0],
    }


def identify_modes(stand: Bench, truth: FlightRecord, suite_name: str, noisy: bool, seeds: int) -> dict[str, Found]:
    """Return elastic mode -> how well twelve states from this record find it."""
    suite = load_suite(suite_name)
    suite = suite if noisy else suite.without_errors()
    true = stand.truth.modes
    elastic = [n for n in true if "wing" in n]
    errors: dict[str, list[tuple[float, float]]] = {n: [] for n in elastic}
    for seed in range(1, (seeds if noisy else 1) + 1):
        record = prepare(suite.measure(truth, seed), bias="trim", trim_s=2.0)
        model = attempt(_TWELVE_STATES, [record], ["de"], [c for c in record.channels if c != "de"])
        matches = match_poles(next(iter(model.poles().values())), true) if model else []
        for m in matches:
            if m.name in errors and m.wn_error_percent is not None and m.zeta_error is not None:
                errors[m.name].append((m.wn_error_percent, m.zeta_error))
    runs = seeds if noisy else 1
    out = {}
    for name, pairs in errors.items():
        good = [abs(w) < 10.0 and abs(z) < 0.1 for w, z in pairs]
        wn, zeta = np.median(np.array(pairs), axis=0) if pairs else (np.nan, np.nan)
        out[name] = Found(sum(good) / runs, float(wn), float(zeta))
    return out


def strain_matrix(stand: Bench, stations: Sequence[int], modes: Sequence[int]) -> FloatArray:
    """Return (gauges, modes): strain at each station per unit of each modal coordinate, -height w''(y)."""
    elastic = stand.aircraft.flown_modes()
    assert elastic is not None
    places = [stand.aircraft.wing_stations[s - 1] for s in stations]
    return np.array([-p.height_m * mode_at(elastic, "curvature_1_m", p.y_m)[[m - 1 for m in modes]] for p in places])


def acceleration_matrix(stand: Bench, stations: Sequence[int], modes: Sequence[int]) -> FloatArray:
    """Return (accelerometers, 1 + modes): specific force per unit of az and of each modal acceleration.

    Pitch acceleration is left out: over the few centimetres that the stations lie off the axis it can hardly be told
    from torsion (:func:`torsion_scatter`).
    """
    elastic = stand.aircraft.flown_modes()
    assert elastic is not None
    index = [m - 1 for m in modes]
    rows = []
    for p in (stand.aircraft.wing_stations[s - 1] for s in stations):
        weight = mode_at(elastic, "bend_m", p.y_m) + p.x_m * mode_at(elastic, "twist_rad", p.y_m)
        rows.append([1.0, *(-weight[index])])
    return np.array(rows)


def torsion_scatter(stand: Bench) -> float:
    """Return the factor by which the torsional acceleration scatters more if pitch acceleration is estimated too."""
    stations = range(1, len(stand.aircraft.wing_stations) + 1)
    plain = acceleration_matrix(stand, stations, SYMMETRIC)
    ahead = np.array([[p.x_m] for p in stand.aircraft.wing_stations])
    scatter = [np.sqrt(np.linalg.inv(M.T @ M)[2, 2]) for M in (plain, np.hstack([plain, ahead]))]
    return float(scatter[1] / scatter[0])


def modal_coordinates(stand: Bench, truth: FlightRecord, seed: int) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Return name -> (true, estimated) modal coordinates from strain and modal accelerations from accelerometers.

    Least squares at every sample, from the stations' mode shapes; deviations from the mean of the first second.
    """
    out = {}
    gauges = load_suite("eolo_strain").measure(truth, seed)
    names = [c for c in gauges.channels if c.startswith("strain_wing")]
    bending = (1, 7)
    G = strain_matrix(stand, [int(n.rsplit("_", 1)[1]) for n in names], bending)
    eta = np.linalg.lstsq(G, gauges.columns(names).T, rcond=None)[0]
    for i, m in enumerate(bending):
        out[f"eta_{m}"] = (_level(truth[f"eta_{m}"]), _level(eta[i]))
    wing = load_suite("eolo_ten_accelerometers").measure(truth, seed)
    names = [c for c in wing.channels if c.startswith("az_wing")]
    A = acceleration_matrix(stand, [int(n.rsplit("_", 1)[1]) for n in names], SYMMETRIC)
    found = np.linalg.lstsq(A, wing.columns(names).T, rcond=None)[0]
    for i, m in enumerate(SYMMETRIC):
        out[f"etaddot_{m}"] = (_level(truth[f"etaddot_{m}"]), _level(found[1 + i]))
    return out


def _level(x: FloatArray) -> FloatArray:
    return np.asarray(x - np.mean(x[:100]))


def relative_error(pair: tuple[FloatArray, FloatArray]) -> float:
    """Return 100 ||estimated - true|| / ||true||."""
    true, found = pair
    return float(100.0 * np.linalg.norm(found - true) / np.linalg.norm(true))


def section(say: Say) -> Section:
    """Return which of input, sensors and noise kept the flexible modes away, and modal coordinates."""
    stand = bench("reproduction/eolo_flexible_modes")
    results: Results = {}
    ratios: dict[str, dict[str, float]] = {}
    flights = {}
    for name, entry in inputs(stand).items():
        say(f"EOLO: flexible modes from the {name}")
        flights[name] = stand.fly((entry,), 23.0)
        ratios[name] = _ratios(stand, flights[name])
        for suite in SUITES:
            for noisy in (False, True):
                results[name, suite, noisy] = identify_modes(stand, flights[name], suite, noisy, _SEEDS)
    coordinates = {name: modal_coordinates(stand, truth, 1) for name, truth in flights.items()}
    first = next(n for n in stand.truth.modes if n.startswith("1st symmetric wing bending"))
    return Section(
        "eolo_flexible",
        "Flexible modes: input, sensors or noise? And modal coordinates",
        findings(results, coordinates, first, _zeta(stand, first), stand.aircraft.elastic.modes[0].zeta),  # type: ignore[union-attr]
        comparisons(results, ratios, coordinates),
        (_mode_table(results, ratios), _coordinate_table(coordinates, torsion_scatter(stand))),
        (_count_plate(results), _coordinate_plate(flights[SINE], coordinates[SINE])),
    )


def cause(results: Results) -> tuple[str, dict[str, int]]:
    """Return which single change from (3-2-1-1, accelerometers, noise) shows most modes, and how many each shows."""
    single = {
        "the input (a multisine)": found_modes(results[SINE, ACCELEROMETERS, True]),
        "the noise (none)": found_modes(results[STEPS, ACCELEROMETERS, False]),
        "the sensors (strain gauges)": found_modes(results[STEPS, STRAIN, True]),
    }
    return max(single, key=lambda k: single[k]), single


def found_modes(found: Mapping[str, Found]) -> int:
    """Return how many modes are found in at least half of the noises."""
    return sum(f.share >= 0.5 for f in found.values())


def findings(
    results: Results, coordinates: Coordinates, first: str, flying_zeta: float, ground_zeta: float
) -> tuple[str, ...]:
    """Return what keeps the modes away and what shows them, in words."""
    base = found_modes(results[STEPS, ACCELEROMETERS, True])
    name, single = cause(results)
    total = len(results[STEPS, ACCELEROMETERS, True])
    others = ", ".join(f"{k}: {v}" for k, v in single.items() if k != name)
    helps = single[name] > base
    best = max(results, key=lambda k: found_modes(results[k]) if k[2] else -1)
    rigid = max(found_modes(results[SINE, RIGID, noisy]) for noisy in (False, True))
    bending = results[SINE, ACCELEROMETERS, True][first]
    errors = [relative_error(coordinates[SINE][f"etaddot_{m}"]) for m in SYMMETRIC]
    return (
        f"From the 3-2-1-1 five accelerometers show {base} of {total} symmetric modes; of one change at a time, "
        + (f"{name} shows most: {single[name]} ({others})" if helps else f"none shows more ({others}, {name})"),
        f"From q, V and θ alone even the multisine shows at most {rigid} of {total}, with noise or without"
        + (": both the input and instruments on the wing are needed" if rigid < single[name] and helps else "")
        + f". Most, {found_modes(results[best])}, come from the {best[0]} and {_WITH[best[1]]}",
        f"The first bending is damped by the air, ζ {flying_zeta:.2f} in flight and {ground_zeta:.3f} on the ground: "
        f"with the multisine and accelerometers it comes out {bending.wn_percent:+.0f} % in frequency and "
        f"{bending.zeta:+.2f} in ζ, in {100 * bending.share:.0f} % of noises near".replace("-", "−"),
        "Modal coordinates by least squares from the stations' mode shapes: under the multisine strain gives the first "
        f"bending to {relative_error(coordinates[SINE]['eta_1']):.0f} %, ten accelerometers give the accelerations of "
        f"the three modes to {', '.join(f'{e:.0f}' for e in errors)} %; under the 3-2-1-1 to "
        + ", ".join(f"{relative_error(coordinates[STEPS][f'etaddot_{m}']):.0f}" for m in SYMMETRIC)
        + " %",
    )


def comparisons(
    results: Results, ratios: Mapping[str, Mapping[str, float]], coordinates: Coordinates
) -> tuple[Comparison, ...]:
    """Return the paper's conclusion on flexible modes, and its proposal, beside ours."""
    step, sine = (found_modes(results[name, ACCELEROMETERS, True]) for name in (STEPS, SINE))
    name, single = cause(results)
    accelerations = ", ".join(f"{relative_error(coordinates[SINE][f'etaddot_{m}']):.0f}" for m in SYMMETRIC)
    return (
        claim_row(
            "a 3-2-1-1 does not show the flexible modes",
            "conclusions",
            "not possible: not enough energy in that band",
            f"{step} of {len(results[STEPS, ACCELEROMETERS, True])} modes, best sensor "
            f"{max(ratios[STEPS].values()):+.0f} dB over its noise; multisine {sine} and "
            f"{max(ratios[SINE].values()):+.0f} dB; “agrees” if none from the 3-2-1-1, in kind if fewer "
            "than from the multisine",
            judge_claim(step == 0, step < sine),
            Why(
                "More energy between 4 and 22 Hz shows them.",
                "What the 3-2-1-1 shows is the mode with least damping; more energy between 4 and 22 Hz shows more.",
                "More energy in their band does not show more modes here.",
            ),
        ),
        claim_row(
            "it was the input that hid the flexible modes",
            "conclusions",
            "a problem of the input, not of the method",
            "modes found with one thing changed: "
            + ", ".join(f"{k} {v}" for k, v in single.items())
            + "; “agrees” if the input alone shows most",
            judge_claim(
                name.startswith("the input") and sum(v == single[name] for v in single.values()) == 1,
                single["the input (a multisine)"] == single[name],
            ),
            Why(
                "Less noise or other sensors alone do not show more.",
                "The input shows as many as another change.",
                "Another change shows more.",
            ),
        ),
        not_printed(
            "modal coordinates from strain and acceleration",
            "section 3.2, proposed",
            "not carried out",
            f"η1 to {relative_error(coordinates[SINE]['eta_1']):.0f} %, accelerations of the three modes to "
            f"{accelerations} %",
            "Mode shapes are those of the simulated wing, known exactly; on a real one they come from the ground "
            "vibration test.",
            headline=True,
        ),
    )


def _zeta(stand: Bench, mode: str) -> float:
    s = stand.truth.modes[mode]
    return float(-s.real / abs(s))


def _ratios(stand: Bench, truth: FlightRecord) -> dict[str, float]:
    """Return elastic mode -> response over noise, dB, of the sensor of all suites that shows it best."""
    noise: dict[str, tuple[float, float]] = {}
    known = stand.truth
    for name in SUITES:
        senses = load_suite(name).noise_std.items()
        noise |= {c: (s, 0.01) for c, s in senses if c != "de" and c in known.linear.outputs}
    u = truth.columns(["de"]) - truth["de"][0]
    model = known.linear.longitudinal(SYMMETRIC)
    found = excitation(model, known.modes, ["de"], u, truth.dt_s, noise, truth.duration_s)
    return {e.mode: float(e.snr_db[e.best_sensor]) for e in found if "wing" in e.mode}


def _mode_table(results: Results, ratios: Mapping[str, Mapping[str, float]]) -> Table:
    rows = []
    for (name, suite, noisy), found in results.items():
        for mode, f in found.items():
            rows.append(
                (
                    name,
                    SUITES[suite],
                    "all" if noisy else "none",
                    mode,
                    ratios[name][mode],
                    100 * f.share,
                    f.wn_percent,
                    f.zeta,
                )
            )
    return Table(
        "eolo_flexible_modes",
        "Three symmetric modes from two inputs, three suites, with and without noise",
        f"CVA, twelve states, J = L = 30; {_SEEDS} noises. Found: a pole within 10 % in frequency and 0.1 in damping "
        "ratio. The errors are medians over all runs with any pole near; where few are found they are chance.",
        (
            Column("input", "input"),
            Column("sensors", "sensors"),
            Column("noise", "noise"),
            Column("mode", "mode"),
            Column("snr", "best sensor over noise", "dB", decimals=0),
            Column("found", "found", "%", decimals=0),
            Column("wn", "error of ωn", "%", decimals=1),
            Column("zeta", "error of ζ", "", decimals=3),
        ),
        tuple(rows),
    )


def _count_plate(results: Results) -> Plate:
    places = np.arange(float(len(SUITES)))
    ticks = tuple(zip(places.tolist(), ("q, V, θ", "+ 5 accelerometers", "+ 5 strain gauges"), strict=True))
    panels = []
    for noisy in (False, True):
        lines = []
        for k, name in enumerate((STEPS, SINE)):
            shares = [100.0 * np.mean([f.share for f in results[name, s, noisy].values()]) for s in SUITES]
            lines.append(line(places + 0.06 * (2 * k - 1), np.array(shares), name, k, marker="os"[k], joined=False))
        title = f"all noise, mean over {_SEEDS}" if noisy else "no noise"
        panels.append(
            Panel(title=title, y="modes found, %", draws=lines, x_range=(-0.5, 2.5), y_range=(-5, 105), x_ticks=ticks)
        )
    return plate(
        "eolo_flexible",
        "Input, sensors or noise?",
        "Share of the three symmetric modes that twelve states find, by input, sensors and noise.",
        panels,
        height_in=1.7,
    )


def _coordinate_table(coordinates: Coordinates, scatter: float) -> Table:
    rows: list[tuple[Value, ...]] = []
    for key in next(iter(coordinates.values())):
        sensors = "five strain gauges" if key.startswith("eta_") else "ten accelerometers"
        rows.append((symbol(key), sensors, *(relative_error(c[key]) for c in coordinates.values())))
    return Table(
        "eolo_modal_coordinates",
        "Modal coordinates from the wing",
        "100 % times the norm of the error over that of the true coordinate, in the noise of the suites. Strain gauges "
        "solve for the two bending modes (torsion hardly bends the spar), accelerometers for the rigid acceleration "
        f"and the three symmetric modes; to ask for pitch acceleration as well would make the scatter of torsion "
        f"{scatter:.0f} times as large.",
        (
            Column("coordinate", "coordinate"),
            Column("sensors", "from"),
            *(Column(f"error {name}", name, "%", decimals=1) for name in coordinates),
        ),
        tuple(rows),
    )


def _coordinate_plate(truth: FlightRecord, found: Mapping[str, tuple[FloatArray, FloatArray]]) -> Plate:
    rows = (truth.t_s >= 4.0) & (truth.t_s <= 6.0)
    panels = []
    for key in ("eta_1", "etaddot_1", "etaddot_5", "etaddot_7"):
        true, own = found[key]
        lines = (
            line(truth.t_s[rows], true[rows], "true", "ink", width=2.0),
            line(truth.t_s[rows], own[rows], "least squares from the wing's sensors", 1),
        )
        title = f"{symbol(key)}: error {relative_error(found[key]):.0f} %"
        panels.append(Panel(title=title, x="t, s", y=symbol(key), draws=lines))
    return plate(
        "eolo_modal_coordinates",
        "Modal coordinates from strain and acceleration",
        "Two seconds of the multisine. First bending from five strain gauges, modal accelerations from ten "
        "accelerometers.",
        panels,
        height_in=1.4,
    )
