"""Subspace methods and their peers on inputs that flight tests use: who is right, who warns, who is wrong in silence.

Run with ``make estimator-study``; the table is results/estimators/subspace_inputs.csv. A short period of 3 rad/s and
damping 0.617 seen by alpha and q, 30 s, 5 % noise, order 2 given, block sizes 10 and 20, at 50 and 10 Hz, the worst of
three draws of the noise. Right is a frequency within 2 %. Peers, each as it comes: SIPPY (sippy-unipi) and nfoursid
where they are installed, SLICOT's moen4 and n4sid through GNU Octave's control package. Rows of a peer that is absent
stay as the table has them.
"""

import argparse
import contextlib
import importlib.util
import io
import itertools
import os
import shutil
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterable
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from smallest import ROOT, results, sized
from tables import read_rows, write_rows

sys.path.insert(0, str(ROOT / "tests" / "estimators" / "subspace"))

from dsr_e_systems import flight_test_inputs, record, sampled, short_period, simulate
from rich.progress import track

from testbench.core.errors import EstimationError
from testbench.estimators.model import continuous_poles
from testbench.estimators.settings import DsrE, Subspace
from testbench.estimators.subspace import dsr_e, family
from testbench.estimators.subspace.family import PREDICTORS, PROJECTIONS

WN, ZETA = 3.0, 0.617
RATES_HZ, BLOCKS, SEEDS = sized(((50.0, 10.0), (10, 20), 3), ((50.0,), (20,), 1))
OURS = (*PROJECTIONS, *PREDICTORS, "dsr_e", "dsr_e eolo")
SIPPY = ("N4SID", "MOESP", "CVA", "PARSIM-K", "PARSIM-S", "PARSIM-P")
COLUMNS = (
    "method",
    "input",
    "rate_hz",
    "block",
    "worst_wn_error_percent",
    "worst_zeta_error_percent",
    "right",
    "warned_or_refused",
    "wrong_in_silence",
)
Data = tuple[float, np.ndarray, np.ndarray]  # dt, u (n, 1), y (n, 2)
Answer = tuple[np.ndarray | None, bool]  # poles in rad/s, None for a refusal; warned


def data(name: str, rate_hz: float, seed: int) -> Data:
    """Return a simulated record."""
    dt = 1.0 / rate_hz
    A, B = sampled(*short_period(WN, ZETA), dt)
    u = flight_test_inputs(dt)[name]
    y = simulate(A, B, np.eye(2), np.zeros((2, 1)), u)
    return dt, u, y + 0.05 * y.std(axis=0) * np.random.default_rng(seed).standard_normal(y.shape)


def ours(method: str, z: Data, block: int) -> Answer:
    """Return what one of our methods makes of it."""
    flown = record(*z, ("de",), ("alpha", "q"))
    settings = {"past_horizon": block, "future_horizon": block, "order": 2}
    try:
        if method.startswith("dsr_e"):
            variant = "eolo" if method.endswith("eolo") else "original"
            model = dsr_e.estimate([flown], ("de",), ("alpha", "q"), DsrE(variant=variant, **settings))
        else:
            model = family.estimate([flown], ("de",), ("alpha", "q"), Subspace(method=method, **settings))
    except EstimationError:
        return None, True
    (poles,) = model.poles().values()
    return poles, model.status != "good"


def quietly(action: Callable[[], np.ndarray], dt: float) -> Answer:
    """Return the poles of a peer's matrix A; an exception or a killed process counts as a refusal."""
    said = io.StringIO()
    try:
        with warnings.catch_warnings(record=True) as caught, contextlib.redirect_stdout(said):
            warnings.simplefilter("always")
            A = action()
        z = np.linalg.eigvals(A).astype(complex)
    except (Exception, SystemExit):
        return None, True
    own = [w for w in caught if issubclass(w.category, UserWarning)]
    return continuous_poles(z, dt)[0], bool(own)


def sippy(method: str, z: Data, block: int) -> Answer:
    """Return what SIPPY makes of it."""
    from sippy_unipi import system_identification

    dt, u, y = z
    settings = {"SS_fixed_order": 2, "SS_f": block, "SS_p": block, "tsample": dt}
    return quietly(lambda: system_identification(y.T, u.T, method, **settings).A, dt)


def nfoursid(_: str, z: Data, block: int) -> Answer:
    """Return what nfoursid makes of it."""
    import pandas as pd
    from nfoursid.nfoursid import NFourSID

    dt, u, y = z
    table = pd.DataFrame(np.hstack([u, y]), columns=["de", "alpha", "q"])

    def run() -> np.ndarray:
        peer = NFourSID(table, output_columns=["alpha", "q"], input_columns=["de"], num_block_rows=block)
        peer.subspace_identification()
        return np.asarray(peer.system_identification(rank=2)[0].a)

    return quietly(run, dt)


def octave() -> dict[tuple[str, str, float, int, int], Answer]:
    """Return what Octave's moen4 and n4sid make of every case, by (method, input, rate, block, seed)."""
    keys = list(itertools.product(flight_test_inputs(), RATES_HZ, BLOCKS, range(SEEDS)))
    code = ["pkg load control"]
    with tempfile.TemporaryDirectory() as folder:
        for i, (name, rate, block, seed) in enumerate(keys):
            dt, u, y = data(name, rate, seed)
            np.savetxt(Path(folder) / f"data{i}.csv", np.hstack([u, y]), fmt="%.17g", delimiter=",")
            code.append(f'z = csvread ("{folder}/data{i}.csv"); d = iddata (z(:, 2:3), z(:, 1), {dt:.17g});')
            code += [
                f'try; s = {method} (d, "n", 2, "s", {block}); '
                f'dlmwrite ("{folder}/{method}{i}.csv", s.a, "precision", 17); catch; end'
                for method in ("moen4", "n4sid")
            ]
        (Path(folder) / "peers.m").write_text("\n".join(code), encoding="utf-8")
        subprocess.run(["octave-cli", "-q", str(Path(folder) / "peers.m")], check=False, capture_output=True)
        out: dict[tuple[str, str, float, int, int], Answer] = {}
        for i, key in enumerate(keys):
            for method in ("moen4", "n4sid"):
                file = Path(folder) / f"{method}{i}.csv"
                A = np.loadtxt(file, delimiter=",") if file.is_file() else None
                refused: Answer = (None, True)
                out[f"Octave {method}", *key] = (
                    refused if A is None else quietly(lambda A=A: A, 1.0 / key[1])
                )  # fmt: skip
    return out


def row(method: str, case: tuple[str, float, int], answers: Iterable[Answer]) -> dict[str, str]:
    """Return a line of the table from the answers of all seeds."""
    wn, zeta, right, told, silent = [], [], 0, 0, 0
    for poles, warned in answers:
        if poles is not None and poles.size == 2:
            found = float(np.sqrt(abs(np.prod(poles))))
            wn.append(abs(found / WN - 1.0))
            zeta.append(abs(-np.real(poles.sum()) / (2.0 * found) / ZETA - 1.0))
        elif poles is not None:  # a pole without a continuous counterpart
            wn.append(np.inf)
            zeta.append(np.inf)
        good = poles is not None and bool(wn) and wn[-1] < 0.02
        right += good
        told += warned
        silent += not good and not warned
    worst = [f"{100.0 * max(errors):.2f}" if errors else "" for errors in (wn, zeta)]
    name, rate, block = case
    cells = (method, name, f"{rate:g}", block, *worst, f"{right}/{SEEDS}", f"{told}/{SEEDS}", f"{silent}/{SEEDS}")
    return {column: str(cell) for column, cell in zip(COLUMNS, cells, strict=True)}


def main(arguments: list[str] | None = None) -> None:
    """Write subspace_inputs.csv; end with an error if one of our methods is wrong in silence."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=results("estimators"))
    given = parser.parse_args(arguments)
    file = given.folder / "subspace_inputs.csv"
    kept = read_rows(file)
    runs: dict[str, Callable[[Data, int], Answer]] = {
        method: (lambda z, block, method=method: ours(method, z, block)) for method in OURS[: sized(None, 1)]
    }
    if importlib.util.find_spec("sippy_unipi") is not None:
        runs |= {f"SIPPY {m}": (lambda z, block, m=m: sippy(m, z, block)) for m in SIPPY}
    if importlib.util.find_spec("nfoursid") is not None:
        runs["nfoursid"] = lambda z, block: nfoursid("", z, block)
    cases = list(itertools.product(flight_test_inputs(), RATES_HZ, BLOCKS))
    rows = []
    for method in track(list(runs), description="subspace methods", transient=True):
        for case in cases:
            answers = [runs[method](data(*case[:2], seed), case[2]) for seed in range(SEEDS)]
            rows.append(row(method, case, answers))
    if shutil.which("octave-cli") is not None:
        found = octave()
        for method in ("Octave moen4", "Octave n4sid"):
            rows += [row(method, case, [found[method, *case, seed] for seed in range(SEEDS)]) for case in cases]
    done = {r["method"] for r in rows}
    rows += [r for r in kept if r["method"] not in done]
    given.folder.mkdir(parents=True, exist_ok=True)
    write_rows(file, COLUMNS, rows)
    silent = [r for r in rows if r["method"] in OURS and not r["wrong_in_silence"].startswith("0/")]
    print(f"{len(rows)} rows; ours wrong in silence: {len(silent)}")
    for r in silent:
        print("  " + ", ".join(r.values()))
    if silent:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
