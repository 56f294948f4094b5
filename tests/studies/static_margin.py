"""Does what an alpha vane buys hang on the static margin that was chosen for EOLO?

    python tests/studies/static_margin.py             # what the margins are; nothing is flown
    python tests/studies/static_margin.py --write     # the study, into results/aircraft: some two minutes

The static margin is the distance of the neutral point behind the centre of gravity over the mean chord, -Cm_alpha /
CL_alpha, which the derivatives of the linear model give as M_alpha Iyy / (Z_alpha m cbar). With the elastic modes held
it is that of eolo.xml. In flight the wings twist with the load: with the modes in static equilibrium with the motion
(residualised, ``testbench.evaluation.derivatives``) it is another, and that is the one that the aircraft flies with.

The study is the packaged ``compare eolo_alpha``, flown with Cm_alpha such that this flown margin is 0.3 (as packaged),
1, 2.6, 5 and 10 %, all else as packaged: seeds, inputs, sensors, estimators.

static_margin.csv: one row for each margin and each error that both suites give. ``without`` and ``with``: median size
over the repetitions; ``p_holm``: probability of the difference by chance, corrected for all rows of its margin;
``predicted``: ratio of the standard errors by information, with alpha over without.
"""

import argparse
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from smallest import results, sized
from tables import read_rows, write_rows

from testbench.aircraft import Aircraft
from testbench.core.paths import AIRCRAFT_MODELS
from testbench.evaluation.derivatives import dimensional_derivatives, static_margin
from testbench.evaluation.modes import frequency_and_damping
from testbench.flight import FlightCondition, linearise, load_aircraft, trim
from testbench.questions.compare import compare
from testbench.questions.compare.result import CompareResult
from testbench.questions.compare.scenario import CompareScenario

ROOT = Path(__file__).resolve().parents[2]
RESULTS = results("aircraft")
SCENARIO = ROOT / "scenarios" / "compare" / "eolo_alpha.toml"
FLOWN_PERCENT = (None, 1.0, 2.6, 5.0, 10.0)[: sized(None, 2)]  # None: as packaged
PATTERN = re.compile(r'(<function name="aero/coefficient/Cm_alpha">.*?<value>)([^<]*)(</value>)', re.DOTALL)
DERIVATIVES = ("Z_alpha", "M_alpha", "M_q", "M_de")


@dataclass(frozen=True)
class Margin:
    """Static margins in percent of the mean chord, and M_alpha in 1/s2, with the modes held and following."""

    held: float
    flown: float
    M_alpha_held: float
    M_alpha_flown: float


def margin(aircraft: Aircraft) -> Margin:
    """Return the static margins of an aircraft at its design condition."""
    trimmed = trim(aircraft, FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m))
    found = {d.name: d for d in dimensional_derivatives(linearise(aircraft, trimmed), trimmed)}
    flown = found["M_alpha"].held if found["M_alpha"].static is None else found["M_alpha"].static
    size = static_margin(aircraft, list(found.values()))
    return Margin(size.held, size.flown, found["M_alpha"].held, flown)


@contextmanager
def with_cm_alpha(value: float | None) -> Iterator[Path]:
    """Give the folder of an EOLO with another Cm_alpha; the packaged one for None."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "eolo"
        shutil.copytree(AIRCRAFT_MODELS / "eolo", folder)
        if value is not None:
            xml = folder / "eolo.xml"
            text, count = PATTERN.subn(rf"\g<1>{value!r}\g<3>", xml.read_text(encoding="utf-8"), count=1)
            assert count == 1
            xml.write_text(text, encoding="utf-8")
        yield folder


def cm_alpha_for(flown_percent: float) -> float:
    """Return the Cm_alpha of a flown margin by the secant method; the margin is all but linear in it."""
    x = [load_aircraft("eolo").coefficient("Cm_alpha")]
    x.append(2.0 * x[0])
    y = []
    for _ in range(6):
        for value in x[len(y) :]:
            with with_cm_alpha(value) as folder:
                y.append(margin(load_aircraft(str(folder))).flown - flown_percent)
        if abs(y[-1]) < 1e-4:
            return x[-1]
        x.append(round(x[-1] - y[-1] * (x[-1] - x[-2]) / (y[-1] - y[-2]), 6))
    raise AssertionError(f"no Cm_alpha found for a margin of {flown_percent} %")


def rows_of(result: CompareResult) -> list[list[str]]:
    """Return the columns from ``input`` on of every gain."""
    out = []
    for g in result.gains:
        sure = "yes" if g.significant(result.scenario.level) and g.after < g.before else "no"
        q = g.quantity
        name = q.name if q.kind != "missed" else f"missed {q.name}"
        figures = [_text(v) for v in (g.before, g.after, g.p_holm)]
        pairs = str(g.paired.pairs)
        out.append(
            [g.case.manoeuvre, g.case.estimator, q.kind, name, q.unit, pairs, *figures, sure, _text(g.predicted)]
        )
    return out


def _text(value: float | None) -> str:
    return "" if value is None or not np.isfinite(value) else f"{value:.4g}"


HEAD = (
    "flown_margin_percent", "held_margin_percent", "Cm_alpha", "short_period", "input", "estimator", "kind", "quantity",
    "unit", "pairs", "without", "with", "p_holm", "surely_smaller", "predicted",
)  # fmt: skip


def study() -> list[list[str]]:
    """Return the rows of static_margin.csv."""
    scenario = CompareScenario.load(SCENARIO)
    out = []
    for flown in FLOWN_PERCENT:
        with with_cm_alpha(None if flown is None else cm_alpha_for(flown)) as folder:
            aircraft = load_aircraft(str(folder))
            found = margin(aircraft)
            result = compare(scenario.model_copy(update={"aircraft": str(folder)}))
        poles = [p for name, p in result.known.modes.items() if name.startswith("short period")]
        words = "; ".join(_words(p) for p in poles)
        given = [f"{found.flown:.2f}", f"{found.held:.2f}", f"{aircraft.coefficient('Cm_alpha'):.4g}", words]
        out += [[*given, *row] for row in rows_of(result)]
        print(
            f"margin {found.flown:.2f} % in flight, {found.held:.2f} % held: {sum(r[-2] == 'yes' for r in out)} so far"
        )
    return out


def _words(pole: complex) -> str:
    wn, zeta = frequency_and_damping(pole)
    return f"{wn:.2f} rad/s, {zeta:.2f}" if pole.imag > 1e-9 else f"{pole.real:.2f} 1/s"


def read() -> list[dict[str, str]]:
    """Return the rows of the committed table."""
    return read_rows(RESULTS / "static_margin.csv")


def draw(rows: list[dict[str, str]]) -> bytes:
    """Return the figure: errors with alpha over errors without, over the margin; one panel per input."""
    from testbench.page.figure import COLOURS, INK, Chart, Curve, Panel, Plate, Rule

    chosen = [r for r in rows if r["estimator"] == "best case" and r["quantity"] in DERIVATIVES]
    panels = []
    for name in dict.fromkeys(r["input"] for r in chosen):
        draws = []
        for colour, q in zip(COLOURS, DERIVATIVES, strict=False):
            of = [r for r in chosen if r["input"] == name and r["quantity"] == q]
            x = [float(r["flown_margin_percent"]) for r in of]
            found = [float(r["with"]) / float(r["without"]) for r in of]
            draws.append(Curve(x=x, y=[float(r["predicted"]) for r in of], name=q, colour=colour))
            draws.append(Curve(x=x, y=found, colour=colour, marker="o", size=4.0))
        panels.append(
            Panel(
                draws=[*draws, Rule(at=1.0, of="y", colour=INK, width=0.7)],
                title=name,
                x="static margin in flight, %",
                y="error with alpha / without",
                log_x=True,
                log_y=True,
                x_range=(0.25, 12.0),
                y_range=(0.05, 5.0),
                tall_in=2.5,
            )
        )
    named = Chart([panels]).legend
    keys = [*named, Curve(x=[], y=[], name="predicted by information"),
            Curve(x=[], y=[], name="found, medians of 16", marker="o", size=4.0)]  # fmt: skip
    chart = Chart([panels], keys=keys)
    return Plate("static_margin", "What alpha buys over the static margin", "", chart).draw().png


def summary(rows: list[dict[str, str]]) -> list[str]:
    """Return what the table says, one line per margin."""
    out = []
    for m in dict.fromkeys(r["flown_margin_percent"] for r in rows):
        of = [r for r in rows if r["flown_margin_percent"] == m]
        sure = [r for r in of if r["surely_smaller"] == "yes"]
        worse = [r for r in of if r["p_holm"] and float(r["p_holm"]) <= 0.05 and float(r["with"]) > float(r["without"])]
        best = [r for r in of if r["estimator"] == "best case" and r["quantity"] in DERIVATIVES]
        ratios = [float(r["predicted"]) for r in best]
        out.append(
            f"{m} % in flight ({of[0]['held_margin_percent']} % held), short period {of[0]['short_period']}: "
            f"{len(sure)} of {len(of)} errors surely smaller, {len(worse)} surely larger; "
            f"standard errors of derivatives divided by {1.0 / max(ratios):.2f} to {1.0 / min(ratios):.2f}"
        )
        out += [f"    {r['input']}, {r['estimator']}: {r['quantity']} {r['without']} -> {r['with']}" for r in sure]
    return out


def main() -> None:
    """Print the margins, or make the study and write table and figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true")
    if parser.parse_args().write:
        rows = study()
        write_rows(RESULTS / "static_margin.csv", HEAD, rows)
        (RESULTS / "static_margin.png").write_bytes(draw(read()))
        print("\n".join(summary(read())))
        return
    found = margin(load_aircraft("eolo"))
    print(f"EOLO at its design condition, modes held: M_alpha {found.M_alpha_held:.2f} 1/s2, margin {found.held:.2f} %")
    print(f"modes in equilibrium with the motion: M_alpha {found.M_alpha_flown:.2f} 1/s2, margin {found.flown:.2f} %")


if __name__ == "__main__":
    sys.exit(main())
