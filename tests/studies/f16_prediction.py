"""Models of order 16 of the F-16 ground vibration test, judged on periods that they never saw, beside GNU Octave's.

Run with ``make estimator-study``; the table is results/estimators/f16_prediction.csv, the folder of recorded flights is
named by TESTBENCH_FLIGHT_DATA.

Force of the shaker and three accelerations, 9 periods of a full multisine of 2 to 15 Hz at 400 Hz (J.-P. Noel and M.
Schoukens, F-16 aircraft benchmark based on ground vibration test data, 2017). Low-passed to 40 Hz; periods 2 to 7
identify, 8 and 9 judge. Every model flies free, its initial state fitted. Peers, if octave-cli is there: SLICOT's moen4
and n4sid of Octave's control package, whose "s" rows are varied in their favour.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.signal import fftconvolve, firwin

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from smallest import ROOT, results, sized
from tables import write_rows

from testbench.core.record import FlightRecord
from testbench.estimators.settings import DsrE, Subspace
from testbench.estimators.state_space import StateSpaceModel
from testbench.estimators.subspace import dsr_e, family
from testbench.estimators.subspace.family import PREDICTORS, PROJECTIONS

# The channel table knows no shaker: its force stands under "thrust" (N), the accelerations under ax, ay, az.
CHANNELS = ("thrust", "ax", "ay", "az")
STRIDE, PERIOD, ORDER, HORIZON = 10, 8192, 16, 30
ROWS = (20, 30, 40, 50)
METHODS = ("dsr_e", *PROJECTIONS, *PREDICTORS)
OCTAVE = """
pkg load control
z = csvread ("{folder}/data.csv");
data = iddata (z(:, 2:4), z(:, 1), {dt:.17g});
for s = [{rows}]
  sys = moen4 (data, "n", {order}, "s", s); [a, b, c, d] = ssdata (sys);
  dlmwrite (sprintf ("{folder}/moen4_%d.csv", s), [a b; c d], "precision", 17);
  sys = n4sid (data, "n", {order}, "s", s); [a, b, c, d] = ssdata (sys);
  dlmwrite (sprintf ("{folder}/n4sid_%d.csv", s), [a b; c d], "precision", 17);
endfor
"""


def records(file: Path) -> tuple[FlightRecord, FlightRecord]:
    """Return the periods that identify and those that judge."""
    z = np.genfromtxt(file, delimiter=",", skip_header=1, usecols=(0, 2, 3, 4))
    z = z - z[PERIOD:].mean(axis=0)
    low = fftconvolve(z, firwin(20 * STRIDE + 1, 0.8 / STRIDE)[:, None], mode="same", axes=0)[::STRIDE]
    t = np.arange(len(low)) * STRIDE / 400.0
    whole = FlightRecord(t, CHANNELS, low, "measured")
    cut = [periods * PERIOD / 400.0 for periods in (1, 7, 9)]
    return whole.between(cut[0], cut[1]), whole.between(cut[1], cut[2] - 0.5)


def error_percent(model: StateSpaceModel, judge: FlightRecord) -> float:
    """Return the free-run error of the outputs, each over its own root mean square."""
    y = judge.columns(model.outputs)
    e = y - model.simulate(judge)
    return 100.0 * float(np.sqrt(np.mean(np.mean(e**2, axis=0) / np.mean(y**2, axis=0))))


def ours(train: FlightRecord, method: str) -> StateSpaceModel:
    """Return one of our models."""
    settings = {
        "past_horizon": HORIZON,
        "future_horizon": HORIZON,
        "order": ORDER,
        "direct_feedthrough": True,
        "decimate": 1,
        "stable": True,
    }
    if method == "dsr_e":
        return dsr_e.estimate([train], CHANNELS[:1], CHANNELS[1:], DsrE(**settings))
    return family.estimate([train], CHANNELS[:1], CHANNELS[1:], Subspace(method=method, **settings))


def peers(train: FlightRecord) -> dict[str, StateSpaceModel]:
    """Return Octave's models by name and rows; none where there is no Octave."""
    if shutil.which("octave-cli") is None:
        return {}
    out = {}
    with tempfile.TemporaryDirectory() as folder:
        np.savetxt(Path(folder) / "data.csv", train.data, fmt="%.17g", delimiter=",")
        text = OCTAVE.format(folder=folder, dt=train.dt_s, rows=" ".join(map(str, ROWS)), order=ORDER)
        (Path(folder) / "peers.m").write_text(text, encoding="utf-8")
        # Octave may crash while it closes down, when all is done: its files tell.
        subprocess.run(["octave-cli", "-q", str(Path(folder) / "peers.m")], check=False, capture_output=True)
        for method in ("moen4", "n4sid"):
            for s in ROWS:
                file = Path(folder) / f"{method}_{s}.csv"
                if not file.is_file():
                    continue
                M = np.loadtxt(file, delimiter=",")
                out[f"Octave {method}, s = {s}"] = StateSpaceModel(
                    method=method,
                    inputs=CHANNELS[:1],
                    outputs=CHANNELS[1:],
                    dt_s=train.dt_s,
                    A=M[:ORDER, :ORDER],
                    B=M[:ORDER, ORDER:],
                    C=M[ORDER:, :ORDER],
                    D=M[ORDER:, ORDER:],
                    K=np.zeros((ORDER, 3)),
                )
    return out


def write_table(file: Path, folder: Path) -> Path:
    """Write f16_prediction.csv into a folder."""
    train, judge = records(file)
    models = {name: ours(train, name) for name in METHODS[: sized(None, 1)]} | peers(train)
    path = folder / "f16_prediction.csv"
    heads = "model of order 16", "free-run error on held-out periods, %"
    write_rows(path, heads, ([name, f"{error_percent(model, judge):.2f}"] for name, model in models.items()))
    return path


def main() -> None:
    """Write the table, or say that the record is missing."""
    folder = Path(os.environ.get("TESTBENCH_FLIGHT_DATA", ROOT.parent / "shared" / "flight_data"))
    file = folder / "f16_gvt" / "F16Data_FullMSine_Level1.csv"
    if not file.is_file():
        print(f"skipped: no record of the F-16's ground vibration test at {file}; set TESTBENCH_FLIGHT_DATA")
        return
    print(write_table(file, results("estimators")).read_text(encoding="utf-8"), end="")


if __name__ == "__main__":
    main()
