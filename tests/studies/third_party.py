"""Aircraft of other people through every question: ``make third-party ARGS=FOLDER``.

FOLDER holds repositories as OWNER+NAME, fetched at the developer's desk; no model is committed. Without a folder it is
one of JSBSim's own sailplanes. Every JSBSim model in
them that is not a copy of one of JSBSim's own is adopted, flown and identified, and a design, a plan, a campaign and a
gap analysis are made of it, each by the command line in a process of its own. A cell of the table is "yes", or the
program's own line on why not. Columns:

- name, source: of the model, and the repository;
- adopt: design speed and height, how it is commanded and what gives thrust, or the refusal;
- run, design, plan, campaign, gap: as said;
- seconds: of the clock, of all.
"""

import argparse
import math
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from clock import since
from smallest import results, sized
from tables import read_rows, write_rows

from testbench.core.constants import DEG_RAD
from testbench.core.paths import stock_names, stock_root
from testbench.flight import FlightCondition, linearise, load_aircraft, trim

COLUMNS = ("name", "source", "adopt", "run", "design", "plan", "campaign", "gap", "seconds")
RESULTS = results("aircraft", "third_party.csv")
LIMIT_S = 900.0  # of a command, on a machine that may be busy
AT_ONCE = 2

_CONDITION = """
[condition]
V_m_s = {V}
h_m = {h}
"""
_MANOEUVRE = """
[[{at}manoeuvre]]
name = "{name}"
use = "{use}"
duration_s = {duration}
[[{at}manoeuvre.input]]
signal = "{signal}"
control = "{control}"
{size}
{timing}
start_s = 1.0
"""
_IDENTIFICATION = """
[{at}identification]
inputs = ["de"]
outputs = ["alpha", "q"]
[[{at}identification.estimators]]
method = "output_error"
structure = "short_period"
"""
_DESIGN = """
title = "Design"
question = "Which elevator input?"
aircraft = "mine"
suites = ["eolo_alpha"]
controls = ["de"]
duration_s = {duration}
start_s = 1.0
by = "autopilot"
shortest_step_s = {step}
[targets]
parameters = {{ M_alpha = 5.0, M_q = 5.0, M_de = 5.0 }}
[limits]
deflection_deg = {{ de = {room} }}
load_factor = [0.3, 1.8]
alpha_deg = [{low}, {high}]
speed_change_m_s = {speed_change}
"""


def models(folder: Path | None) -> Iterator[tuple[str, Path]]:
    """Yield repository and main file of every model; one of several with the same name is enough."""
    if folder is None:
        yield "JSBSim", Path(str(stock_root())) / "aircraft" / "SGS" / "SGS.xml"
        return
    seen = set(stock_names())
    for repository in sorted(p for p in folder.iterdir() if p.is_dir()):
        for path in sorted(repository.rglob("*.xml")):
            head = path.read_text(errors="replace")[:20000]
            if "<fdm_config" in head and path.stem not in seen:
                seen.add(path.stem)
                yield repository.name.replace("+", "/", 1), path


def study(source: str, path: Path) -> dict[str, str]:
    """Return the row of one model."""
    begun, row = time.monotonic(), {"name": path.stem, "source": source}
    with TemporaryDirectory() as place:
        said = _command(place, "aircraft", "adopt", str(path), "-o", "aircraft/mine", "--report", "out")
        if "--repair" in said:
            said = _command(place, "aircraft", "adopt", str(path), "-o", "aircraft/mine", "--report", "out", "--repair")
        row["adopt"] = said
        if said == "yes":
            row |= _questions(Path(place))
    return row | {"seconds": f"{since(begun, time.monotonic):.0f}"}


def _questions(place: Path) -> dict[str, str]:
    mine = load_aircraft(str(place / "aircraft" / "mine"))
    V, h = mine.design_V_m_s, mine.design_h_m
    trimmed = trim(mine, FlightCondition(V, h))
    words = [f"{V:.3g} m/s at {h:g} m", "its own law" if mine.under_law else "surfaces"]
    words += [
        "thrust" if "thr" in mine.controls else "glides",
        *(n for n in ("de", "da", "dr") if n not in mine.controls),
    ]
    if "de" not in mine.controls:
        return {"adopt": f"{', '.join(words)}: no elevator to design for"}
    linear = linearise(mine, trimmed)
    q, alpha = linear.states.index("q"), linear.states.index("w")
    wn = math.sqrt(max(-linear.A[q, alpha] * V, 0.3))
    step = min(max(0.8 / wn, 0.15), 1.5)
    room = min(mine.controls["de"].full - trimmed.controls["de"], trimmed.controls["de"] - mine.controls["de"].low)
    turn = abs(linear.B[q, linear.inputs.index("de")])
    throw = 0.99 * min(mine.controls["de"].full, -mine.controls["de"].low)
    size = min(2.0 * DEG_RAD * wn**2 / max(turn, 1e-6), 0.3 * room) / DEG_RAD
    level, low, high = trimmed.alpha / DEG_RAD, *(x / DEG_RAD for x in mine.limits["alpha"])
    condition = _CONDITION.format(V=V, h=h)
    timing = {"3211": f"step_s = {step:.3g}", "doublet": f"period_s = {2.0 * step:.3g}"}

    def manoeuvres(at: str = "", *uses: str, control: str = "de") -> str:
        signals = ("3211", "doublet", "3211")
        return "".join(
            _MANOEUVRE.format(
                at=at, name=f"{signal} {i}", use=use, duration=round(20.0 * step + 4.0, 1), signal=signal,
                control=control, size=f"amplitude_deg = {size:.3g}", timing=timing[signal],
            )
            for i, (use, signal) in enumerate(zip(uses, signals, strict=False))
        )  # fmt: skip

    two = ("identification", "validation")
    head = 'title = "T"\nquestion = "Q?"\naircraft = "mine"\nseed = 1\n'
    run = head + 'suites = ["eolo_alpha"]\n' + condition + manoeuvres("", *two) + _IDENTIFICATION.format(at="")
    scenario = 'title = "C"\nquestion = "Q?"\nruns = 4\nseed = 1\n[vary]\n"aircraft.mass_percent" = ' + (
        '{ kind = "normal", mean = 0.0, std = 2.0 }\n[scenario]\ntitle = "T"\naircraft = "mine"\n'
        'suites = ["eolo_alpha"]\n'
    )
    scenario += condition.replace("[", "[scenario.", 1) + manoeuvres("scenario.", *two)
    scenario += _IDENTIFICATION.format(at="scenario.")
    sensors = "eolo_gap" if "thr" in mine.controls else "eolo_alpha"
    gap = head + f'suite = "{sensors}"\n' + condition + "[hidden]\n" + manoeuvres("", *two)
    design = condition + _DESIGN.format(
        duration=round(24.0 * step + 3.0, 1), step=f"{step:.3g}", room=f"{throw / DEG_RAD:.4g}",
        low=f"{max(level - 5.0, low):.3g}", high=f"{min(level + 5.0, high):.3g}", speed_change=f"{0.15 * V:.3g}",
    )  # fmt: skip
    files = {"run": run, "design": design, "campaign": scenario, "gap": gap}
    for name, text in files.items():
        (place / f"{name}.toml").write_text(_top_first(text))
    out: dict[str, str] = {"adopt": ", ".join(words)}
    out["run"] = _command(place, "run", "run.toml", "-o", "out")
    out["design"] = _command(place, "design", "design.toml", "-o", "out")
    new = _command(place, "plan", "new", "aircraft/mine", "-o", "plan.toml", "--suite", "eolo_alpha")
    out["plan"] = new if new != "yes" else _command(place, "plan", "plan.toml", "-o", "out")
    out["campaign"] = _command(place, "campaign", "run", "campaign.toml", "-o", "out", "--workers", "1")
    out["gap"] = _command(place, "gap", "gap.toml", "-o", "out")
    return out


def _top_first(text: str) -> str:
    """Return the text with keys that belong to no table before all tables."""
    parts = text.split("\n[condition]", 1)
    if len(parts) == 1 or parts[0].strip():
        return text
    table, _, rest = parts[1].partition("\ntitle")
    keys, _, tables = ("title" + rest).partition("\n[targets]")
    return f"{keys}\n[condition]{table}\n[targets]{tables}"


def _command(place: str | Path, *words: str) -> str:
    """Return "yes", or the last line that the program says."""
    run = [sys.executable, "-m", "testbench", *words, "-q"]
    try:
        ended = subprocess.run(run, cwd=place, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    except subprocess.TimeoutExpired:
        return f"no end within {LIMIT_S:g} s"
    if ended.returncode == 0:
        return "yes"
    lines = [x for x in (ended.stderr or ended.stdout).splitlines() if x.strip() and not x.startswith("...")]
    errors = [x for x in lines if x.startswith("error")]
    said = " ".join(errors[:1] or lines[-1:]).replace(str(place), "").removeprefix("error: ")
    return f"{said[:300]} (exit {ended.returncode})"


def main(arguments: Sequence[str] | None = None) -> None:
    """Study every model of a folder; rows that are there already stay."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--only", default="", help="names of models, separated by commas")
    parser.add_argument("--out", type=Path, default=RESULTS)
    given = parser.parse_args(arguments)
    wanted = [x for x in given.only.split(",") if x]
    found = [(s, p) for s, p in models(given.folder) if not wanted or p.stem in wanted]
    rows = {r["name"]: r for r in read_rows(given.out) if r["name"] not in wanted}
    left = [(s, p) for s, p in found if p.stem not in rows]
    with ThreadPoolExecutor(sized(AT_ONCE, 1)) as pool:
        for row in pool.map(lambda x: study(*x), left):
            rows[row["name"]] = row
            print(row, flush=True)
            write_rows(given.out, COLUMNS, (rows[n] for n in sorted(rows, key=str.lower)))


if __name__ == "__main__":
    main()
