"""The coefficients that two plans give, beside those of the packaged models.

    python tests/studies/geometry_against_committed.py    # writes results/aircraft/geometry.csv

The packaged numbers are no measurements of these plans: EOLO's are strip theory with a tail chosen for a static margin,
Taurus's are those of the Ultra Stick 25e, an aircraft of the same span and another shape. What the table shows is how
far apart careful estimates of one aircraft lie, in units of the deviation that is stated.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterator
from io import StringIO
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from smallest import results, sized

TABLE = results("aircraft", "geometry.csv")
HEAD = ("aircraft", "coefficient", "packaged", "build_up", "lattice", "used", "deviation", "apart_in_deviations")


def rows(name: str) -> Iterator[tuple[str, ...]]:
    """Yield the rows of one packaged aircraft with a geometry.toml."""
    from testbench.aircraft.geometry.build import model_from_plan
    from testbench.aircraft.geometry.read import read_plan
    from testbench.core.errors import ModelError
    from testbench.core.paths import AIRCRAFT_MODELS
    from testbench.flight import load_aircraft

    aircraft = load_aircraft(name)
    made = model_from_plan(read_plan(AIRCRAFT_MODELS / name / "geometry.toml"), name)
    for c in made.coefficients.values():
        try:
            packaged = aircraft.coefficient(c.name)
        except ModelError:  # the packaged model does without
            continue
        if c.name == "CD":  # the first number of its polar: CD0
            used, build = made.polar.CD0, made.polar.CD0
        else:
            used, build = c.used, c.buildup
        apart = (packaged - used) / (c.deviation * abs(used))
        lattice = "" if c.lattice is None else f"{c.lattice:.3g}"
        yield (
            name, "CD0" if c.name == "CD" else c.name, f"{packaged:.4g}", f"{build:.3g}", lattice, f"{used:.3g}",
            f"{c.deviation:.2g}", f"{apart:.1f}",
        )  # fmt: skip


def table() -> str:
    """Return the whole table as CSV."""
    out = StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(HEAD)
    for name in sized(("eolo", "taurus"), ("taurus",)):
        writer.writerows(rows(name))
    return out.getvalue()


if __name__ == "__main__":
    TABLE.write_text(table(), encoding="utf-8")
    print(TABLE.read_text(encoding="utf-8"))
