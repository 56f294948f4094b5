"""What does a robust design save if the model is wrong by 30 %? results/design/robust.csv.

Coefficients of the short period are drawn with a relative standard deviation of 30 %. The robust design and the one
for the believed aircraft alone have the same time, and both keep the limits in every draw. Ratios are those of the
criterion of the latter over that of the former: the worst over the 20 draws of the design, and over 20 fresh ones.
"""

import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from smallest import results, sized
from studies.promise_study import DESIGNS
from tables import read_rows, write_rows

from testbench.core.paths import AIRCRAFT_MODELS
from testbench.core.schema import parse
from testbench.design.ensemble import Flier, draw, told
from testbench.questions.design.ask import run_design
from testbench.questions.design.pose import setting_of
from testbench.questions.design.scenario import DesignScenario

TABLE = results("design", "robust.csv")
STATED = {"CL_alpha": 0.1, "Cm_alpha": 0.3, "Cm_q": 0.3, "Cm_de": 0.3}
"""Relative standard deviations; that of the lift slope is smaller, or trims leave the limits."""
DRAWS = sized(20, 4)
NAMES = ("taurus longitudinal", "b1 longitudinal", "eolo longitudinal")
COLUMNS = ("design", "draws", "robust", "nominal", "worst_ratio", "median_ratio", "fresh_draws", "fresh_worst_ratio")


def uncertain(name: str, folder: Path) -> Path:
    """Return a copy of a packaged aircraft that states its uncertainty."""
    shutil.copytree(AIRCRAFT_MODELS / name, folder / name)
    with (folder / name / "aircraft.toml").open("a", encoding="utf-8") as file:
        file.write("\n[uncertainty]\n" + "".join(f"{k} = {v}\n" for k, v in STATED.items()))
    return folder / name


def row_of(name: str, folder: Path) -> dict[str, Any]:
    """Return the row of one design."""
    aircraft = uncertain(DESIGNS[name]["aircraft"], folder)
    asked = {"title": name, **DESIGNS[name], "aircraft": str(aircraft), "realise": 0, "robust": True, "draws": DRAWS}
    scenario, faults = parse(DesignScenario, asked, None)
    assert scenario is not None, faults
    r = run_design(scenario, progress=lambda text: print(f"  {text}", flush=True))
    assert r.nominal is not None
    best, nominal = r.best, r.ranking[r.nominal]
    assert best.over is not None
    assert nominal.over is not None
    ours, theirs = best.over.told, nominal.over.told
    other = scenario.changed(seed=scenario.seed + 1)
    setting = setting_of(other, r.believed, r.ensemble.range_.suite)
    fresh = draw(setting, r.aircraft, DRAWS, other.seed, best.design, Flier())
    names = r.problem.targets.names
    again = [told(e.design, fresh.judged, names).costs.max() for e in (nominal, best)]
    words = [f"{e.design.family}: {e.design.words}" for e in (best, nominal)]
    ratios = theirs.costs.max() / ours.costs.max(), nominal.over.rank[1] / best.over.rank[1], again[0] / again[1]
    worst, median, later = (f"{x:.3g}" for x in ratios)
    cells = (name, len(ours.costs), *words, worst, median, len(fresh.judged), later)
    return dict(zip(COLUMNS, cells, strict=True))


def main() -> None:
    """Run the designs that are missing, and write the table after each."""
    rows = read_rows(TABLE)
    for name in NAMES[: sized(None, 1)]:
        if any(r["design"] == name for r in rows):
            continue
        print(name, flush=True)
        with TemporaryDirectory() as folder:
            rows.append(row_of(name, Path(folder)))
        write_rows(TABLE, COLUMNS, rows)
        print(rows[-1], flush=True)


if __name__ == "__main__":
    main()
