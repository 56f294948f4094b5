"""Every model that comes with JSBSim: adopted, trimmed, compared with JSBSim's own trim, linearised and flown.

Run with ``make stock``; it writes results/aircraft/stock.csv and a page. Every model has a process of its own with a
time limit, so that none can end or hold up the others. Columns:

- name, status ("flies", or why not), V_m_s, h_m, alpha_deg, controls (deg, throttle in %), gamma_deg;
- residual: the largest acceleration left, m/s2 or rad/s2; trim_ms: median of three trims from scratch, processor time;
- jsbsim: JSBSim's own trim of the stock model with the same settings: alpha and elevator, JSBSim's less ours, deg; the
  elevator is compared by the first property that it drives;
- double_s: time to double of the fastest unstable motion, "stable" without one;
- flown: 20 s with a doublet of 10 % of the elevator's throw from the second second on;
- longitudinal_percent, lateral_percent: largest difference of eigenvalues from central differences of JSBSim's own
  accelerations, made without this package (stock_eigenvalues.py);
- elsewhere: what stands elsewhere in the stock model than in ours, so that the two are not of one state;
- batch: largest difference of its translation for batches from JSBSim in a flight of 20 s that moves every control,
  of a channel's range, or why JSBSim flies it alone.

The page results/aircraft/README.md shows the same.
"""

import json
import statistics
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from clock import since
from smallest import results, sized
from tables import write_rows

RESULTS = results("aircraft", "stock.csv")
LIMIT_S = 900.0  # of the clock, on a machine that may be busy; the slowest model takes some 100 s of a processor
FLIGHT_S = 20.0
DOUBLET = 0.1  # of the elevator's throw


def study(name: str) -> dict[str, str]:
    """Return the row of one model."""
    from testbench.aircraft.source import find_model, read_source
    from testbench.core.errors import Refusal
    from testbench.core.paths import stock_root
    from testbench.flight import trim
    from testbench.flight.adopt import adopt

    root = stock_root()
    if root is None:
        raise SystemExit("the jsbsim package must bring its models, but none are installed")
    row = {"name": name}
    try:
        path = find_model(root / "aircraft" / name)
        if path is None:
            return row | {"status": "the folder holds no JSBSim model"}
        adopted = adopt(read_source(path))
    except Refusal as error:
        return row | {"status": str(error).replace("\n", " ").replace(str(root), "JSBSim")}
    trimmed = adopted.trimmed
    condition = trimmed.condition
    shown = {n: f"{v * (100.0 if n == 'thr' else np.rad2deg(1.0)):.2f}" for n, v in trimmed.controls.items()}
    times = []
    for _ in range(3):
        start = time.process_time()
        trim(adopted.aircraft, condition)
        times.append(1e3 * since(start))
    burning = [e for e in adopted.engines if not e.startswith(("rocket", "electric"))]
    broken = burning and "thr" not in trimmed.controls
    return row | {
        "status": f"its engines give no thrust ({burning[0]}): it only glides" if broken else "flies",
        "V_m_s": f"{condition.V_m_s:g}",
        "h_m": f"{condition.h_m:g}",
        "alpha_deg": f"{np.rad2deg(trimmed.alpha):.2f}",
        "controls": " ".join(f"{n} {v}" for n, v in shown.items()),
        "gamma_deg": f"{np.rad2deg(condition.gamma_rad):.2f}",
        "residual": f"{np.max(np.abs(trimmed.residual)):.1e}",
        "trim_ms": f"{statistics.median(times):.0f}",
        "jsbsim": beside_jsbsim(adopted, root),
        "double_s": doubling(adopted),
        "flown": flown(adopted),
        **eigenvalues(name),
        "batch": in_batch(name),
    }


def eigenvalues(name: str) -> dict[str, str]:
    """Return the differences of eigenvalues from those made with JSBSim alone, %, and what stands elsewhere there."""
    from stock_eigenvalues import compare

    found = compare(name)
    return {
        "longitudinal_percent": found["longitudinal"],
        "lateral_percent": found["lateral-directional"],
        "elsewhere": found["note"],
    }


def beside_jsbsim(adopted, root: Path) -> str:
    """Return how JSBSim's own longitudinal trim of the stock model departs from ours."""
    import jsbsim

    from testbench.aircraft.adapter import THROTTLE
    from testbench.core.constants import FT_M

    aircraft, trimmed = adopted.aircraft, adopted.trimmed
    if THROTTLE not in [c.command for c in aircraft.controls.values()]:
        return "none: JSBSim's trim needs a throttle"
    fdm = jsbsim.FGFDMExec(str(root))
    fdm.set_debug_level(0)
    fdm.set_dt(1.0 / trimmed.rate_hz)
    for key, value in aircraft.adapter.neutral.items():
        fdm.set_property_value(key, value)  # a model that reads what nothing defines would end the process
    if not fdm.load_model(aircraft.name):
        return "none: the stock model does not load"
    for key, value in aircraft.adapter.settings.items():
        fdm.set_property_value(key, value)
    fdm.set_property_value("ic/h-sl-ft", trimmed.condition.h_m / FT_M)
    fdm.set_property_value("ic/vt-fps", trimmed.condition.V_m_s / FT_M)
    fdm.set_property_value("ic/gamma-deg", 0.0)
    fdm.run_ic()
    fdm.get_propulsion().init_running(-1)
    try:
        fdm.do_trim(0)
    except RuntimeError as error:
        return f"none: {' '.join(str(error).split())[:60]}"
    away = np.rad2deg(fdm.get_property_value("aero/alpha-rad") - trimmed.alpha)
    link = aircraft.adapter.link("de")
    text = f"alpha {away:+.3f}"
    if link is not None:
        drive = link.drives[0]
        deflections, values = np.array(drive.points).T
        order = np.argsort(values)
        de = np.interp(fdm.get_property_value(drive.name), values[order], deflections[order])
        text += f" de {np.rad2deg(de - trimmed.controls['de']):+.3f}"
    return text


def doubling(adopted) -> str:
    """Return the time to double of the fastest unstable motion, s."""
    from testbench.core.errors import Refusal
    from testbench.flight import linearise

    try:
        worst = float(np.max(linearise(adopted.aircraft, adopted.trimmed).poles().real))
    except Refusal as error:
        return f"not linearised: {type(error).__name__}"
    return "stable" if worst <= 1e-4 else f"{np.log(2.0) / worst:.3g}"


def flown(adopted) -> str:
    """Return how a flight with a doublet in the elevator ended."""
    from testbench.core.errors import Refusal
    from testbench.flight import Manoeuvre, fly
    from testbench.flight.simulate import FlightAborted
    from testbench.inputs.signal import InputSignal

    aircraft, trimmed = adopted.aircraft, adopted.trimmed
    name = next((n for n in ("de", "da", "dr") if n in aircraft.controls), None)
    if name is None:
        return "no surface to move"
    control = aircraft.controls[name]
    size = DOUBLET * (control.full - control.low)
    room = min(control.full - trimmed.controls[name], trimmed.controls[name] - control.low)
    t = np.arange(round(FLIGHT_S * trimmed.rate_hz)) / trimmed.rate_hz
    u = min(size, 0.9 * room) * (((t >= 2.0) & (t < 2.5)) * 1.0 - ((t >= 2.5) & (t < 3.0)) * 1.0)
    try:
        fly(aircraft, trimmed, Manoeuvre("doublet", InputSignal(t, u[:, None], (name,)), settle_s=0.0), 50.0)
    except FlightAborted as error:
        return f"ended after {error.time_s:.1f} s: {error.reason}"
    except Refusal as error:
        return str(error)
    return "completed"


def in_batch(name: str) -> str:
    """Return how a translation of the model departs from JSBSim in 20 s, of a channel's range, or why it has none."""
    import warnings

    from testbench.core.errors import Refusal
    from testbench.flight import FlightCondition, load_aircraft, trim
    from testbench.flight.batch.check import judged

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            aircraft = load_aircraft(f"jsbsim:{name}", commanded_at="surface")
        found = judged(aircraft, trim(aircraft, FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m)))
    except Refusal as error:
        return str(error)
    return found.reason if found.model is None else f"{found.worst:.0e}"


def of(name: str) -> dict[str, str]:
    """Return the row of one model, studied in a process of its own."""
    command = [sys.executable, __file__, "--one", name]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    except subprocess.TimeoutExpired:
        return {"name": name, "status": f"not decided within {LIMIT_S:g} s"}
    marked = [line for line in done.stdout.splitlines() if line.startswith("ROW ")]
    if not marked:
        last = (done.stderr.strip().splitlines() or [f"ended with {done.returncode}"])[-1]
        return {"name": name, "status": f"failed: {last}"}
    return json.loads(marked[-1].removeprefix("ROW "))


def page(rows: list[dict[str, str]]) -> str:
    """Return the table as a page."""
    flying = [r for r in rows if r["status"] == "flies"]
    times = sorted(float(r["trim_ms"]) for r in flying)
    both = [r for r in flying if max(_percent(r, "longitudinal"), _percent(r, "lateral")) <= 1.0]
    completed = [r for r in flying if r["flown"] == "completed"]
    batches = [r for r in flying if _is_number(r.get("batch", ""))]
    lines = [
        "# The models that come with JSBSim",
        "",
        "Made by `make stock`; the same numbers stand in `stock.csv`. Each model is adopted as it is: probed, started, "
        "trimmed and flown, without a word from us about it.",
        "",
        f"- {len(flying)} of {len(rows)} trim and fly; {len(completed)} of them fly 20 s with an elevator doublet.",
        f"- A trim takes {statistics.median(times):.0f} ms of a processor in the median, {times[-1]:.0f} ms at most.",
        "- Eigenvalues of both motions agree within 1 % with central differences of JSBSim's accelerations, made "
        f"without this package, on {len(both)} models.",
        f"- {len(batches)} fly in batches: their translation agrees with JSBSim within 1e-9 of every channel's range.",
        "",
        "Eigenvalues: largest difference, %; in both, free propellers are held at their speed and governed ones "
        "follow. Where it is large, the stock model could not be brought to our trim (last table), or a kink of its "
        "tables lies within our steps of 0.05 m/s and 0.01 rad/s: of J3Cub, minisgs, Camel, wrightFlyer1903 and c310 "
        "the two agree within 0.04 % once the steps are a hundredth of that. JSBSim's trim: its alpha and elevator "
        "less ours, deg, where it succeeds.",
        "",
        "| model | V, m/s | h, m | alpha, deg | controls, deg and % | path, deg | trim, ms | JSBSim's trim "
        "| doubles in, s | 20 s | longitudinal, % | lateral, % | batch |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    keys = ("name", "V_m_s", "h_m", "alpha_deg", "controls", "gamma_deg", "trim_ms", "jsbsim", "double_s", "flown",
            "longitudinal_percent", "lateral_percent", "batch")  # fmt: skip
    lines += ["| " + " | ".join(r.get(k, "") for k in keys) + " |" for r in flying]
    lines += ["", "## Those that do not fly, and why", "", "| model | reason |", "|---|---|"]
    lines += [f"| {r['name']} | {r['status']} |" for r in rows if r["status"] != "flies"]
    lines += ["", "## Those whose stock model could not be brought to our trim", ""]
    lines += ["| model | what stands elsewhere |", "|---|---|"]
    lines += [f"| {r['name']} | {r['elsewhere']} |" for r in flying if r.get("elsewhere")]
    return "\n".join(lines) + "\n"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _percent(row: dict[str, str], motion: str) -> float:
    return float(row.get(f"{motion}_percent") or "inf")


def main(names: list[str]) -> None:
    """Study all models, or those named, and write the table."""
    from testbench.core.paths import stock_root

    root = stock_root()
    if root is None:
        raise SystemExit("the jsbsim package must bring its models, but none are installed")
    everyone = sorted((p.name for p in (root / "aircraft").iterdir() if p.is_dir()), key=str.lower)
    with ThreadPoolExecutor(2) as pool:
        rows = list(pool.map(of, names or everyone[: sized(None, 1)]))
    if not names:
        write_rows(RESULTS, max(rows, key=len), rows)  # of those that fly
        RESULTS.with_name("README.md").write_text(page(rows), encoding="utf-8")
    for row in rows:
        print("; ".join(f"{k} {v}" for k, v in row.items()))
    flying = [row for row in rows if row["status"] == "flies"]
    times = [float(row["trim_ms"]) for row in flying] or [float("nan")]
    middle, most = statistics.median(times), max(times)
    print(f"{len(flying)} of {len(rows)} fly; trim {middle:.0f} ms in the median, {most:.0f} at most")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        print("ROW " + json.dumps(study(sys.argv[2])))
    else:
        main(sys.argv[1:])
