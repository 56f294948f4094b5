"""Tables of poles: true modes beside those found, every pole of every model, and printed references."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from testbench.estimators.identification import estimator_name
from testbench.page.labels import symbol
from testbench.page.tables import Column, Table, Value
from testbench.questions.run.labels import case_names

if TYPE_CHECKING:
    from testbench.questions.run.result import RunResult

_FARTHEST = 1.0  # as in the evaluation: a factor of e in frequency, or 57 deg in the s-plane
_MODES = {"phugoid", "short period", "dutch roll"}
_WN, _ZETA = re.compile(r"wn_(?:(.+)_)?rad_s"), re.compile(r"zeta(?:_(.+))?")


def frequency_and_damping(pole: complex) -> tuple[float, float]:
    """Return |s| in rad/s and -Re(s)/|s|; the damping ratio of a pole at the origin is called 0."""
    wn = abs(pole)
    return wn, -pole.real / wn if wn else 0.0


def mode_table(result: RunResult) -> Table | None:
    """Return frequency and damping of every true mode and of the pole found for it, cases side by side."""
    if not any(case.evaluation.poles for case in result.cases):
        return None
    names = case_names(result.cases)
    columns = [
        Column("mode", "mode"),
        Column("outputs", "from"),
        Column("true wn", "ωn", "rad/s", "true"),
        Column("true zeta", "ζ", "", "true", decimals=3),
    ]
    for name in names:
        columns += [
            Column(f"{name} wn", "ωn", "rad/s", name),
            Column(f"{name} zeta", "ζ", "", name, decimals=3),
            Column(f"{name} wn error", "Δωn", "%", name, decimals=1),
        ]
    found: dict[tuple[str, str], dict[int, Any]] = {}
    for k, case in enumerate(result.cases):
        for match in case.evaluation.poles:
            whole = len(match.outputs.split(", ")) == len(case.model.outputs)
            source = "all outputs" if whole else _symbols(match.outputs)
            found.setdefault((match.name, source), {})[k] = match
    rows: list[tuple[Value, ...]] = []
    for (mode, outputs), matches in sorted(found.items(), key=lambda item: abs(next(iter(item[1].values())).true)):
        row: list[Value] = [mode, outputs, *frequency_and_damping(next(iter(matches.values())).true)]
        for k in range(len(names)):
            own = matches.get(k)
            if own is None or own.found is None:
                row += [None, None, None]
            else:
                row += [*frequency_and_damping(own.found), own.wn_error_percent]
        rows.append(tuple(row))
    known = {row[0] for row in rows if any(v is not None for v in row[4:])}
    empty = {row[0]: row for row in reversed(rows) if row[0] not in known}  # one row for a mode that nothing found
    rows = [row for row in rows if any(v is not None for v in row[4:]) or empty.get(row[0]) is row]
    if all(row[1] == "all outputs" for row in rows):
        columns, rows = [columns[0], *columns[2:]], [(row[0], *row[2:]) for row in rows]
    caption = (
        "Each true mode and the pole of each model that stands for it. A dash: no pole lies near (within a factor of e "
        "in frequency or 57 deg of angle in the s-plane)."
    )
    return Table("modes", "Modes found and true", caption, tuple(columns), tuple(rows))


def _symbols(outputs: str) -> str:
    return ", ".join(symbol(name) for name in outputs.split(", ") if name)


def pole_table(result: RunResult) -> Table:
    """Return every continuous-time pole of every model, conjugates once, slowest first."""
    columns = (
        Column("model", "model"),
        Column("outputs", "from"),
        Column("real", "Re s", "rad/s", digits=4),
        Column("imaginary", "Im s", "rad/s", digits=4),
        Column("wn", "ωn", "rad/s"),
        Column("zeta", "ζ", "", decimals=3),
        Column("f", "f", "Hz"),
    )
    rows: list[tuple[Value, ...]] = []
    for name, case in zip(case_names(result.cases), result.cases, strict=True):
        for outputs, poles in case.model.poles().items():
            for pole in sorted((complex(p) for p in poles if p.imag >= -1e-12), key=abs):
                wn, zeta = frequency_and_damping(pole)
                rows.append((name, _symbols(outputs), pole.real, abs(pole.imag), wn, zeta, wn / (2.0 * math.pi)))
    caption = (
        "Continuous-time poles, ln(z) over the sample time, in rad/s; Im s stands for both poles of a pair. A positive "
        "Re s is unstable."
    )
    return Table("poles", "Every pole of every model", caption, columns, tuple(rows))


def reference_tables(result: RunResult) -> list[Table]:
    """Return the printed frequencies and dampings of a recorded flight beside those found, and other printed values."""
    values = {k: v for k, v in result.reference.items() if isinstance(v, (int, float)) and not isinstance(v, bool)}
    source = str(result.reference.get("source", ""))
    modes = _printed_modes(values)
    rest = [k for k in values if not _WN.fullmatch(k) and not _ZETA.fullmatch(k)]
    out = []
    if modes:
        out.append(_reference_table(result, modes, source))
    if rest:
        out.append(_printed_values({k: float(values[k]) for k in rest}, result, source))
    return out


def _printed_values(values: Mapping[str, float], result: RunResult, source: str) -> Table:
    """Return printed values that are no modes, with what each model that has them as parameters found."""
    columns = [Column("quantity", "quantity"), Column("printed", "printed", digits=4)]
    rows: list[tuple[Value, ...]] = [(name, value) for name, value in values.items()]
    for model, case in zip(case_names(result.cases), result.cases, strict=True):
        found = {p.name: p for p in case.evaluation.parameters if p.free and p.name in values}
        if found:
            columns += [
                Column(f"{model} estimate", "estimate", "", model, digits=4),
                Column(f"{model} std", "± std", "", model, digits=2),
            ]
            own = {name: (p.value, p.std) for name, p in found.items()}
            rows = [(*row, *own.get(str(row[0]), (None, None))) for row in rows]
    none = "" if len(columns) > 2 else "; these estimators give poles and responses, not derivatives"
    caption = f"{source}. SI units and radians{none}."
    return Table("printed_values", "Other printed values", caption, tuple(columns), tuple(rows))


def printed_poles(result: RunResult) -> dict[str, complex]:
    """Return mode -> pole, rad/s, of every printed frequency that comes with a damping ratio between 0 and 1."""
    values = {k: v for k, v in result.reference.items() if isinstance(v, (int, float))}
    return {
        name: complex(-zeta * wn, wn * math.sqrt(1.0 - zeta**2))
        for name, (wn, zeta) in _printed_modes(values).items()
        if zeta is not None and 0.0 <= zeta <= 1.0
    }


def _printed_modes(values: Mapping[str, Any]) -> dict[str, tuple[float, float | None]]:
    """Return mode -> (wn, zeta) of "wn_rad_s" and "zeta" (the short period), "wn_NAME_rad_s" and "zeta_NAME"."""
    out = {}
    for key, value in values.items():
        match = _WN.fullmatch(key)
        if match is not None:
            suffix = match[1] or ""
            zeta = values.get(f"zeta_{suffix}" if suffix else "zeta")
            words = suffix.replace("_", " ")
            name = words if words in _MODES else f"short period ({words})" if words else "short period"
            out[name] = (float(value), None if zeta is None else float(zeta))
    return out


def _reference_table(result: RunResult, modes: Mapping[str, tuple[float, float | None]], source: str) -> Table:
    columns = (
        Column("printed", "printed"),
        Column("printed wn", "ωn", "rad/s", "printed value"),
        Column("printed zeta", "ζ", "", "printed value", decimals=3),
        Column("model", "estimator"),
        Column("outputs", "from"),
        Column("wn", "ωn", "rad/s", "found"),
        Column("zeta", "ζ", "", "found", decimals=3),
        Column("wn difference", "Δωn", "%", "found", decimals=1),
        Column("zeta difference", "Δζ", "", "found", decimals=3),
    )
    rows: list[tuple[Value, ...]] = []
    for mode, (wn, zeta) in modes.items():
        for name, case in zip(_estimators(result), result.cases, strict=True):
            for outputs, poles in case.model.poles().items():
                pole = _nearest([complex(p) for p in poles], wn, zeta)
                found: list[Value] = [None] * 4
                if pole is not None:
                    own_wn, own_zeta = frequency_and_damping(pole)
                    found = [own_wn, own_zeta, 100.0 * (own_wn / wn - 1.0), None if zeta is None else own_zeta - zeta]
                rows.append((mode, wn, zeta, name, _symbols(outputs), *found))
    caption = f"Printed: {source}. Found: the oscillatory pole nearest to the printed one. A dash: none lies near."
    return Table("reference", "Found and printed", caption, columns, tuple(rows))


def _estimators(result: RunResult) -> list[str]:
    """Return what to call each case by its estimator; the suite too where there are several."""
    names = case_names(result.cases)
    one = len({c.suite for c in result.cases}) == 1 and len({estimator_name(c.estimator) for c in result.cases}) == 1
    return [estimator_name(c.estimator) for c in result.cases] if one and len(names) == 1 else names


def _nearest(poles: list[complex], wn: float, zeta: float | None) -> complex | None:
    """Return the oscillatory pole nearest to frequency and damping, by |ln(s / s_printed)| <= 1, or None."""
    angle = None if zeta is None else math.acos(min(1.0, max(-1.0, -zeta)))

    def distance(pole: complex) -> float:
        """Return |ln(s / s_printed)|, by frequency alone if no damping was printed."""
        turned = 0.0 if angle is None else math.atan2(pole.imag, pole.real) - angle
        return math.hypot(math.log(abs(pole) / wn), turned)

    near = [p for p in poles if p.imag > 1e-9 and distance(p) <= _FARTHEST]
    return min(near, key=distance) if near else None
