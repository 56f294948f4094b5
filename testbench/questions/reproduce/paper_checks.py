"""The papers' own numbers: which of them our aircraft use, and whether they fit together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.constants import DEG_RAD
from testbench.flight import load_aircraft
from testbench.page.labels import symbol
from testbench.page.tables import Column, Table
from testbench.questions.reproduce.bench import (
    BAND_RAD_S,
    DOUBLET_S,
    ELEVATOR_DEG,
    EOLO_ASPECT_RATIO,
    EOLO_TABLE_1,
    EOLO_TABLE_2,
    IDENTIFICATION,
    LOG_HZ,
    RATE_HZ,
    RUDDER_DEG,
    STATED_INPUTS,
    STATED_PAIR,
    STATED_Z3,
    STATED_Z4,
    TABLE_3,
    TABLE_4,
    TAURUS_ASPECT_RATIO,
    TAURUS_TABLE_1_IN,
    TAURUS_TAIL_IN,
    TRANSFER_FUNCTIONS,
    VALIDATION,
    WINDOW_S,
    A,
    B,
    D,
    K,
    shown,
)
from testbench.questions.reproduce.section import (
    Comparison,
    Equation,
    Say,
    Section,
    Why,
    Written,
    claim_row,
    judge_claim,
    judge_number,
    number_row,
    taken_over,
)

_IN_M = 0.0254
_SELF = Why(
    "The printed numbers fit together.",
    "The printed numbers part among themselves.",
    "The printed numbers contradict each other.",
)


def taurus(say: Say) -> Section:
    """Return Table I beside our aircraft, and equations 6 to 9 beside each other."""
    say("Taurus: the paper's own numbers")
    aircraft = load_aircraft("taurus")
    checks = tuple(_taurus_checks())
    return Section(
        "taurus_paper",
        "The paper's own numbers (Table I, equations 1 to 9)",
        (in_words(checks),),
        tuple(_taurus_data(aircraft)),
        checks=checks,
        equations=TAURUS_EQUATIONS,
    )


def eolo(say: Say) -> Section:
    """Return Tables 1 and 2 beside our aircraft, and the printed model and tables checked."""
    say("EOLO: the paper's own numbers")
    aircraft = load_aircraft("eolo")
    checks = tuple(_eolo_checks())
    return Section(
        "eolo_paper",
        "The paper's own numbers (Tables 1 to 4, the identified matrices)",
        (in_words(checks),),
        tuple(_eolo_data(aircraft)),
        (_mode_table(aircraft),),
        checks=checks,
        equations=EOLO_EQUATIONS,
    )


def in_words(checks: Sequence[Comparison]) -> str:
    """Return how many checks of the paper against itself fail, and which."""
    parted = [r for r in checks if r.verdict != "agrees"]
    names, good = "; ".join(r.what for r in parted), len(checks) - len(parted)
    return (
        f"Of {len(checks)} checks of the printed numbers against each other {good} come{'s' if good == 1 else ''} out"
        + (f" and {len(parted)} {'does' if len(parted) == 1 else 'do'} not: {names}" if parted else "")
    )


def _data(what: str, where: str, printed: float, ours: float, unit: str, note: str = "") -> Comparison:
    """Return a printed property of the aircraft beside the simulated one's: taken over, or judged if it is not."""
    if abs(ours - printed) <= 0.005 * abs(printed):
        return taken_over(what, where, f"{shown(printed)} {unit}", f"{ours:.4g} {unit}", "A property of the aircraft.")
    why = Why(note, note, note)
    return number_row(what, where, printed, ours, Written(unit, 2, 3), why)


def _taurus_data(aircraft: Aircraft) -> list[Comparison]:
    g, table = aircraft.geometry, TAURUS_TABLE_1_IN
    full = {n: c.full / DEG_RAD for n, c in aircraft.controls.items()}
    return [
        _data("wing area", "Table I", table["wing area"], g.S_m2 / _IN_M**2, "in²"),
        _data("wing span", "Table I", table["span"], g.b_m / _IN_M, "in"),
        _data(
            "wing chord", "Table I", table["chord"], g.cbar_m / _IN_M, "in",
            "Area and span were taken; their quotient is the chord, which the printed one is not.",
        ),
        _data("elevator deflection", "Table I", ELEVATOR_DEG, full["de"], "deg"),
        _data("rudder deflection", "Table I", RUDDER_DEG, full["dr"], "deg"),
    ]  # fmt: skip


def _taurus_checks() -> list[Comparison]:
    S, b, c = (TAURUS_TABLE_1_IN[k] for k in ("wing area", "span", "chord"))
    tail = TAURUS_TAIL_IN
    _, above, under = TRANSFER_FUNCTIONS["theta"]
    q_0 = TRANSFER_FUNCTIONS["q"][1][-1] / TRANSFER_FUNCTIONS["q"][2][-1]
    below = [np.array(den) for _, _, den in TRANSFER_FUNCTIONS.values()]
    shares = float(max(np.max(np.abs(d - below[0])) for d in below[1:]))
    return [
        _check("aspect ratio b²/S", "Table I", TAURUS_ASPECT_RATIO, b**2 / S, "", 2, 0.05),
        _check(
            "aspect ratio of the horizontal tail, b²/S", "Table I", tail["aspect ratio"],
            tail["span"] ** 2 / tail["area"], "", 2, 0.05,
        ),
        _check("tail area as span times chord", "Table I", tail["area"], tail["span"] * tail["chord"], "in²", 0, 4.5),
        claim_row(
            "the elevator is a part of the tail", "Table I", f"elevator chord {tail['elevator chord']:g} in",
            f"tail chord {tail['chord']:g} in; “agrees” if the elevator's is the smaller one",
            judge_claim(tail["elevator chord"] < tail["chord"]), _SELF, headline=False,
        ),
        _check("wing area as span times chord", "Table I", S, b * c, "in²", 0, 0.05 * S),
        claim_row(
            "q is the derivative of θ", "equations 6 and 7", "no steady pitch rate from a steady elevator",
            f"steady q {q_0:.2f} 1/s per elevator, steady θ {above[-1] / under[-1]:.2f}; “agrees” if that q is 0",
            judge_claim(abs(q_0) < 1e-9), _SELF, headline=False,
        ),
        claim_row(
            "one aircraft, one denominator", "equations 6 to 9", "four denominators",
            f"they differ by up to {shares:.1f} in a coefficient; “agrees” if they do not",
            judge_claim(shares < 0.05), _SELF, headline=False,
        ),
        claim_row(
            "a doublet's sample", "sections IV and V", f"doublets of {DOUBLET_S:g} s, {LOG_HZ:g} Hz",
            f"{DOUBLET_S * LOG_HZ:.0f} samples per doublet; “agrees” from 10",
            judge_claim(DOUBLET_S * LOG_HZ >= 10.0), _SELF, headline=False,
        ),
    ]  # fmt: skip


def _eolo_data(aircraft: Aircraft) -> list[Comparison]:
    g, m = aircraft.geometry, aircraft.mass
    ours = {"S": g.S_m2, "c": g.cbar_m, "b": g.b_m, "mass": m.mass_kg, "Ixx": m.Ixx, "Iyy": m.Iyy, "Izz": m.Izz}
    units = {"S": "m²", "c": "m", "b": "m", "mass": "kg"}
    rows = [_data(name, "Table 1", value, ours[name], units.get(name, "kg m²")) for name, value in EOLO_TABLE_1.items()]
    rows.append(_data("aspect ratio", "section 3.1", EOLO_ASPECT_RATIO, g.b_m**2 / g.S_m2, ""))
    assert aircraft.elastic is not None
    pairs = list(zip(EOLO_TABLE_2.items(), aircraft.elastic.modes, strict=True))
    same = sum(
        judge_number(f, mode.f_hz) == "agrees" and judge_number(z, 100.0 * mode.zeta) == "agrees"
        for (_, (f, z)), mode in pairs
    )
    rows.append(
        taken_over(
            "eight elastic modes", "Table 2", f"{len(EOLO_TABLE_2)} frequencies and damping ratios",
            f"{same} of {len(pairs)} modes with both, in still air and without lift",
            "Mode shapes and generalised masses are not printed and are estimated.",
        )
    )  # fmt: skip
    return rows


def _check(what: str, where: str, printed: float, again: float, unit: str, decimals: int, slack: float) -> Comparison:
    """Return a printed number beside what other printed numbers make of it; it agrees within ``slack``."""
    left, right = (f"{v:.{decimals}f} {unit}".strip().replace("-", "−") for v in (printed, again))
    return claim_row(
        what, f"{where}", left, f"{right} from the other numbers; “agrees” within {slack:g}",
        judge_claim(abs(printed - again) <= slack), _SELF, headline=False,
    )  # fmt: skip


_ROUNDING = 5e-4  # of eigenvalues: entries of A have four places, and the pair's hang on them some ten times over


def _eolo_checks() -> list[Comparison]:
    z = np.linalg.eigvals(A)
    real = np.sort([v.real for v in z if abs(v.imag) < 1e-9])
    pair = next(v for v in z if v.imag > 1e-9)
    stated = 2.0 * STATED_PAIR.real + STATED_Z3 + STATED_Z4
    pairs = (
        ("eigenvalue pair, real part", STATED_PAIR.real, pair.real),
        ("eigenvalue pair, imaginary part", STATED_PAIR.imag, pair.imag),
        ("z4 as a root of A", STATED_Z4, real[-1]),
        ("z3 as a root of A", STATED_Z3, real[0]),
        ("sum of the eigenvalues against the trace of A", stated, float(np.trace(A))),
    )
    rows = [_check(what, "section 3.2", one, other, "", 4, _ROUNDING) for what, one, other in pairs]
    rows += [
        claim_row(
            "D of the printed model", "section 2.1 and 3.2", "null matrix D",
            "printed D: " + ", ".join(shown(v) for v in D.ravel()) + "; “agrees” if zero",
            judge_claim(not D.any()), _SELF, headline=False,
        ),
        claim_row(
            "inputs of the printed model", "section 3.2", f"{STATED_INPUTS} inputs stated",
            f"B and D have {B.shape[1]} column{'s' if B.shape[1] > 1 else ''}; “agrees” if as many",
            judge_claim(B.shape[1] == D.shape[1] == STATED_INPUTS), _SELF, headline=False,
        ),
        _worst(),
        claim_row(
            "K of the printed model", "section 3.2", f"K23 = {shown(K[1, 2])}, K33 = {shown(K[2, 2])}",
            "the same entry twice; “agrees” if they differ", judge_claim(bool(K[1, 2] != K[2, 2])), _SELF,
            headline=False,
        ),
        _check(
            f"samples of the window from {WINDOW_S[0]:g} to {WINDOW_S[1]:g} s", "section 3.2",
            IDENTIFICATION + VALIDATION, (WINDOW_S[1] - WINDOW_S[0]) * RATE_HZ + 1.0, "", 0, 0.5,
        ),
        _check(
            "aspect ratio b²/S", "Table 1, section 3.1", EOLO_ASPECT_RATIO,
            EOLO_TABLE_1["b"] ** 2 / EOLO_TABLE_1["S"], "", 2, 0.01,
        ),
    ]  # fmt: skip
    for n, table in TABLE_3.items():
        for k, use in enumerate(("id. set", "val. set")):
            mean = float(np.mean([row[k] for key, row in table.items() if key != "mean"]))
            rows.append(_check("mean of the MRSE", f"Table 3, n = {n}, {use}", table["mean"][k], mean, "%", 2, 0.01))
    for which, column in TABLE_4.items():
        mean = float(np.mean([v for key, v in column.items() if key != "mean"]))
        rows.append(_check("mean of the MRSE", f"Table 4, {which} α", column["mean"], mean, "%", 2, 0.01))
    return rows


def _worst() -> Comparison:
    """Return the statement on the worst predictions beside the entries of Table 4."""
    worst = {w: max((v, n) for n, v in column.items() if n != "mean")[1] for w, column in TABLE_4.items()}
    of_mode = [name in ("q", "alpha") for name in worst.values()]
    said = ", ".join(f"{symbol(n)} {which} α ({shown(TABLE_4[which][n])} %)" for which, n in worst.items())
    return claim_row(
        "the worst predictions are related to the short period", "section 4 and Table 4", "they are",
        f"the largest MRSE of Table 4: {said}; V belongs to the phugoid; “agrees” if q or α in "
        "both columns, in kind in one",
        judge_claim(all(of_mode), any(of_mode)), _SELF, headline=False,
    )  # fmt: skip


def _mode_table(aircraft: Aircraft) -> Table:
    assert aircraft.elastic is not None
    rows = [
        (name, f, mode.f_hz, z, 100.0 * mode.zeta)
        for (name, (f, z)), mode in zip(EOLO_TABLE_2.items(), aircraft.elastic.modes, strict=True)
    ]
    return Table(
        "eolo_table2",
        "Table 2: modes of the ground vibration test",
        f"Printed, and those of the simulated wing without air. All lie above the {BAND_RAD_S:g} rad/s "
        f"({BAND_RAD_S / (2.0 * np.pi):.1f} Hz) of the paper's input."
        if min(f for f, _ in EOLO_TABLE_2.values()) > BAND_RAD_S / (2.0 * np.pi)
        else "Printed, and those of the simulated wing without air.",
        (
            Column("mode", "mode"),
            Column("printed_hz", "printed", "Hz", "frequency", given=True),
            Column("ours_hz", "ours", "Hz", "frequency", given=True),
            Column("printed_zeta", "printed", "%", "damping ratio", given=True),
            Column("ours_zeta", "ours", "%", "damping ratio", given=True),
        ),
        tuple(rows),
    )


# --- equations as the papers print them -------------------------------------------------------------------------------


def _row(*parts: str) -> str:
    return "<mrow>" + "".join(parts) + "</mrow>"


def _i(name: str) -> str:
    return f"<mi>{name}</mi>"


def _o(sign: str) -> str:
    return f"<mo>{sign}</mo>"


def _sub(base: str, index: str) -> str:
    return f"<msub>{base}{index}</msub>"


def _sup(base: str, power: str = "<mn>2</mn>") -> str:
    return f"<msup>{base}{power}</msup>"


def _over(above: str, below: str) -> str:
    return f"<mfrac>{_row(above)}{_row(below)}</mfrac>"


def _root(inside: str) -> str:
    return f"<msqrt>{inside}</msqrt>"


def _sum(inside: str, low: str = "", high: str = "") -> str:
    sign = f"<munderover>{_o('∑')}{_row(low)}{_i(high)}</munderover>" if low else _o("∑")
    return sign + inside


def _dot(name: str) -> str:
    return f'<mover accent="true">{_i(name)}{_o("˙")}</mover>'


def _hat(name: str) -> str:
    return f'<mover accent="true">{_i(name)}{_o("^")}</mover>'


_Y, _U = _sub(_i("y"), _i("i")), _sub(_i("u"), _i("i"))
_BELOW = _i("r") + _sum(_sup(_U)) + _o("−") + _sup(_row(_o("("), _sum(_U), _o(")")))

TAURUS_EQUATIONS = (
    Equation(
        "1",
        _row(_dot("x"), _o("="), _i("A"), _i("x"), _o("+"), _i("B"), _i("u")),
        "ẋ = A x + B u",
        "The linear longitudinal model, x = [u q θ h]ᵀ, u = [δe δt]ᵀ. The paper prints no A and B. Ours has angle of "
        "attack among its states, too: without it four states hold no short period.",
    ),
    Equation(
        "2",
        _row(_i("v"), _o("="), _sum(_sup(_sub(_i("e"), _i("i"))), _i("i") + _o("=") + "<mn>1</mn>", "r")),
        "v = Σ eᵢ², i = 1 … r",
        "The cost that least squares makes small; the same here.",
    ),
    Equation(
        "3",
        _row(_sub(_i("e"), _i("i")), _o("="), _Y, _o("−"), f"<msubsup>{_i('y')}{_i('i')}{_i('m')}</msubsup>"),
        "eᵢ = yᵢ − yᵢᵐ",
        "The error: measured output less the model's; the same here.",
    ),
    Equation(
        "4",
        _row(
            _sub(_i("B"), "<mn>0</mn>"), _o("="),
            _over(_sum(_Y) + _sum(_sup(_U)) + _o("−") + _sum(_U) + _sum(_row(_U, _Y)), _BELOW),
        ),
        "B₀ = (Σyᵢ Σuᵢ² − Σuᵢ Σuᵢyᵢ) / (r Σuᵢ² − (Σuᵢ)²)",
        "The offset of the best straight line. It is the textbook's, and fits a line through points, not a transfer "
        "function.",
    ),
    Equation(
        "5",
        _row(
            _sub(_i("B"), "<mn>1</mn>"), _o("="),
            _over(_i("r") + _sum(_row(_U, _Y)) + _o("−") + _sum(_U) + _sum(_Y), _BELOW),
        ),
        "B₁ = (r Σuᵢyᵢ − Σuᵢ Σyᵢ) / (r Σuᵢ² − (Σuᵢ)²)",
        "Its slope, as in the textbook. The line is an example of least squares; equations 6 to 9 are fitted by a "
        "toolbox, here by transfer_function.",
    ),
)  # fmt: skip

_YQ = _sub(_i("y"), _row(_i("k"), _o(","), _i("q")))
EOLO_EQUATIONS = (
    Equation(
        "1",
        _row(_sub(_i("y"), _i("J/1")), _o("="), f"<msubsup>{_i('y')}{_i('J/1')}{_i('d')}</msubsup>", _o("+"),
             _sub(_i("ε"), _i("J/1"))),
        "y_J/1 = y_J/1ᵈ + ε_J/1",
        "Step 1 of DSR_e splits the outputs into signal and innovations; step 1 of dsr_e here.",
    ),
    Equation(
        "2",
        _row(_sub(_i("x"), _i("k+1")), _o("="), _i("A"), _sub(_i("x"), _i("k")), _o("+"), _i("B"),
             _sub(_i("u"), _i("k")), _o("+"), _i("K"), _sub(_i("ε"), _i("k")), _o(","),
             f"<msubsup>{_i('y')}{_i('k')}{_i('d')}</msubsup>", _o("="), _i("C"), _sub(_i("x"), _i("k"))),
        "x_k+1 = A x_k + [B K] [u_k; ε_k],  y_kᵈ = C x_k",
        "Step 2: a deterministic problem with D = 0. The printed D is not zero.",
    ),
    Equation(
        "3",
        _row(_sub(_i("u"), _i("k")), _o("≔"), _o("["), _sub(_i("U"), _i("J/1")), _o(";"), _sub(_i("ε"), _i("J/1")),
             _o("]"), _o(","), _sub(_i("y"), _i("k")), _o("≔"), f"<msubsup>{_i('y')}{_i('J/1')}{_i('d')}</msubsup>"),
        "u_k := [U_J/1; ε_J/1],  y_k := y_J/1ᵈ",
        "Inputs and outputs of step 2, the innovations among the inputs; the same here.",
    ),
    Equation(
        "4",
        _row(_i("MRSE"), _o("="), _over("<mn>100</mn>", _i("l")),
             _sum(_root(_over(_sum(_sup(_row(_o("("), _YQ, _o("−"), _sub(_hat("y"), _row(_i("k"), _o(","), _i("q"))),
                                             _o(")")))), _sum(_sup(_YQ)))), _i("q") + _o("=") + "<mn>1</mn>", "l")),
        "MRSE = (100 / l) Σ_q √( Σ_k (y_k,q − ŷ_k,q)² / Σ_k y_k,q² ) %",
        "The criterion of Tables 3 and 4; the same here.",
    ),
)  # fmt: skip
