"""Derivatives from geometry beside published ones of thirteen aircraft, and how far priors may be trusted.

    python tests/studies/corpus_study.py    # writes results/aircraft/corpus.csv, prints the spreads to state

Plans of the aircraft, each with its sources, and their published derivatives lie in tests/reference/corpus; of a value
"recalled" no copy of its source was at hand when it was written down. Bias and
spread of every derivative are fitted on one half ("fit"; aircraft of one family lie in the same half); the shares
within one and two deviations are judged on the other ("report"). ``ROWS`` of aircraft/geometry/coefficients.py carries
what is fitted; a test holds that it does, and the shares.

The bias is the median of published over computed, drawn towards 1 as if by twelve aircraft that agree; the spread is
the root mean square of what is left beyond the floor, with twelve more of the spread of its kind of derivative, which
is the 68 % quantile. Cm_alpha has no bias, a spread of 0.1, and beside it that of the neutral point, root mean square
over CL_alpha. Cross derivatives, whose values pass through zero, have a relative spread of 0.3 and an absolute one;
like all other floors both are judged.
"""

import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from smallest import results, sized
from tables import read_rows, write_rows

CORPUS = Path(__file__).resolve().parents[1] / "reference" / "corpus"
TABLE = results("aircraft", "corpus.csv")
HEAD = (
    "aircraft", "class", "half", "coefficient", "published", "build_up", "lattice", "used", "deviation",
    "apart_in_deviations", "source",
)  # fmt: skip
KINDS = {
    "wing": ("CL_alpha", "Cl_p"),
    "control": ("CL_de", "Cm_de", "CY_dr", "Cn_dr", "Cl_da"),
    "fin": ("CY_beta", "Cn_beta", "Cl_beta"),
    "rate": ("CL_q", "Cm_q", "CL_alphadot", "Cm_alphadot", "CY_r", "Cl_r", "Cn_r"),
}
_PRIOR, _FARTHEST = 12, 4.0
Row = Mapping[str, Any]


def published() -> list[dict[str, str]]:
    """Return the rows of published.csv."""
    return read_rows(CORPUS / "published.csv")


@cache
def computed(name: str) -> Mapping[str, Any]:
    """Return the coefficients that an aircraft's plan gives, by name."""
    from testbench.aircraft.geometry.aerodynamics import aerodynamics
    from testbench.aircraft.geometry.coefficients import coefficients
    from testbench.aircraft.geometry.read import read_plan

    plan = read_plan(CORPUS / f"{name}.toml")
    x, _, z = plan.balance.cg_m
    said = plan.said
    found = aerodynamics(plan.plane.about(x, z), plan.balance.mass_kg, said.design_V_m_s, said.design_h_m)
    return coefficients(found)


def fitted(rows: Sequence[Row]) -> dict[str, tuple[float, float]]:
    """Return coefficient -> (bias, spread) of rows of the table; of Cm_alpha the spread of the neutral point, cbar."""
    from testbench.aircraft.geometry.coefficients import ROWS

    bias, apart = {}, {}
    for name in (c for kind in KINDS.values() for c in kind):
        pairs = np.array([(float(r["published"]), float(r["lattice"])) for r in rows if r["coefficient"] == name])
        ratio = max(float(np.median(pairs[:, 0] / pairs[:, 1])), 0.2)
        bias[name] = ratio ** (len(pairs) / (len(pairs) + _PRIOR))
        error, used = pairs[:, 0] - bias[name] * pairs[:, 1], bias[name] * pairs[:, 1]
        apart[name] = np.sqrt(np.maximum(error**2 - ROWS[name].floor ** 2, 0.0)) / np.abs(used)
    out = {}
    for kind in KINDS.values():
        usual = float(np.quantile(np.concatenate([apart[c] for c in kind]), 0.68))
        for c in kind:
            left = np.minimum(apart[c], _FARTHEST * usual)
            spread = np.sqrt((float(np.sum(left**2)) + _PRIOR * usual**2) / (len(left) + _PRIOR))
            out[c] = (bias[c], float(spread))
    some = [r for r in rows if r["coefficient"] == "Cm_alpha"]
    slopes = {r["aircraft"]: float(r["lattice"]) for r in rows if r["coefficient"] == "CL_alpha"}
    missed = [(float(r["published"]) - float(r["lattice"])) / slopes[r["aircraft"]] for r in some]
    out["Cm_alpha"] = (1.0, float(np.sqrt(np.mean(np.square(missed)))))
    return out


def shares(rows: Sequence[Row]) -> tuple[float, float]:
    """Return the shares of rows within one and two deviations."""
    z = np.abs([float(r["apart_in_deviations"]) for r in rows])
    return float(np.mean(z < 1.0)), float(np.mean(z < 2.0))


def table() -> Iterator[tuple[str, ...]]:
    """Yield the rows of the table."""
    for row in published():
        if row["aircraft"] not in sized((row["aircraft"],), ("navion",)):
            continue
        c, value = computed(row["aircraft"])[row["coefficient"]], float(row["value"])
        yield (
            row["aircraft"], row["class"], row["half"], c.name, f"{value:.4g}", f"{c.buildup:.4g}", f"{c.lattice:.4g}",
            f"{c.used:.4g}", f"{c.deviation:.3g}", f"{(value - c.used) / (c.deviation * abs(c.used)):.2f}",
            row["source"],
        )  # fmt: skip


def main() -> None:
    """Write the table and print what is fitted and judged."""
    write_rows(TABLE, HEAD, table())
    rows = read_rows(TABLE)
    for label, key in (("half", "half"), ("class", "class")):
        for value in dict.fromkeys(r[key] for r in rows):
            some = [r for r in rows if r[key] == value]
            one, two = shares(some)
            print(f"{label} {value}: {len(some)} derivatives, {100 * one:.0f} % within 1, {100 * two:.0f} % within 2")
    if len({r["aircraft"] for r in rows}) > 1:
        for name, (bias, spread) in fitted([r for r in rows if r["half"] == "fit"]).items():
            print(f"{name}: bias {bias:.2f}, spread {spread:.2f}")


if __name__ == "__main__":
    main()
