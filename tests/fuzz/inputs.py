"""A small valid input of every format that is read, made anew."""

import io
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np
from scipy.io import netcdf_file, savemat
from writers import dataflash_bin, dataflash_log, ulog, write_73

from testbench.aircraft.strips.ground_test import read_ground_test
from testbench.core.paths import SCENARIOS, SUITES
from testbench.core.record import FlightRecord
from testbench.estimators.contract import Text
from testbench.questions.files import load
from testbench.sensors import load_suite

T = 0.05 * np.arange(240)
DE = np.where((T >= 4.0) & (T < 5.0), 0.05, 0.0) - np.where((T >= 5.0) & (T < 6.0), 0.05, 0.0)
Q = 0.04 * np.sin(T)
CHANNELS = ("de", "q", "V", "alpha", "theta")
DATA = np.column_stack([DE, Q, 18.0 + 0.1 * np.sin(T), 0.02 * np.sin(1.3 * T), 0.1 * np.cos(T)])
UNITS = ("rad", "rad/s", "m/s", "rad", "rad")


def record() -> FlightRecord:
    """Return a flight of 12 s with a gap in one channel."""
    valid = np.ones(DATA.shape, bool)
    valid[100:110, 2] = False
    facts = {"aircraft": "none", "seed": 1, "suite": "vane", "list": [1.5, {"a": None}]}
    return FlightRecord(T, CHANNELS, DATA, "measured", valid, facts)


def _written(suffix: str, write: Callable[[Path], object], place: Path) -> bytes:
    path = place / f"made{suffix}"
    write(path)
    return path.read_bytes()


def _csv() -> bytes:
    heads = ",".join(["t [s]", *(f"{n} [{u}]" for n, u in zip(CHANNELS, UNITS, strict=True))])
    return "\n".join([heads, *(",".join(f"{x:.6g}" for x in row) for row in np.column_stack([T, DATA]))]).encode()


def _matrix_73(path: Path) -> None:
    write_73(path, {"data": {"time": T, **dict(zip(CHANNELS, DATA.T, strict=True)), "units": {"q": "rad/s"}}, "n": "a"})


def _mat(**options: bool) -> bytes:
    flight = {"time": T, **dict(zip(CHANNELS, DATA.T, strict=True)), "units": {"q": "rad/s", "de": "rad"}}
    runs = np.empty((1, 2), dtype=[("q", "O"), ("note", "O")])
    runs[0, 0], runs[0, 1] = (Q, "one"), (Q, "two")
    buffer = io.BytesIO()
    savemat(buffer, {"flight": flight, "runs": runs, "cells": np.array([["a", 1.0]], object), "n": 3}, **options)
    return buffer.getvalue()


def _foreign_netcdf(path: Path) -> None:
    with h5netcdf.File(path, "w") as file:
        file.dimensions = {"time": T.size}
        for name, values in {"time": T, **dict(zip(CHANNELS, DATA.T, strict=True))}.items():
            made = file.create_variable(name, ("time",), data=values, chunks=(60,), compression="gzip")
            made.attrs["units"] = "s" if name == "time" else UNITS[CHANNELS.index(name)]


def _classic_netcdf(path: Path) -> None:
    with netcdf_file(path, "w") as file:
        file.createDimension("time", None)
        for name, values in {"time": T, **dict(zip(CHANNELS, DATA.T, strict=True))}.items():
            made = file.createVariable(name, "d", ("time",))
            made[:] = values
            made.units = "s" if name == "time" else UNITS[CHANNELS.index(name)]


def paparazzi() -> tuple[str, str]:
    """Return the messages and the definitions of a Paparazzi log."""
    from logs.test_autopilot_logs import DEFINITIONS, lines

    return "\n".join([*lines()[:900], ""]), DEFINITIONS


def logs(place: Path) -> dict[str, tuple[str, bytes]]:
    """Return name -> (suffix, content) of all that ``testbench import`` reads from one file."""
    out = {
        "csv": (".csv", _csv()),
        "text": (".txt", _csv().replace(b",", b"  ").replace(b" [", b"[")),
        "mat 5": (".mat", _mat()),
        "mat 5 packed": (".mat", _mat(do_compression=True)),
        "mat of the testbench": (".mat", _written(".mat", record().save_mat, place)),
        "mat 7.3": (".mat", _written(".mat", _matrix_73, place)),
        "record": (".nc", _written(".nc", record().save, place)),
        "netcdf 4": (".nc", _written(".nc", _foreign_netcdf, place)),
        "netcdf classic": (".nc", _written(".nc", _classic_netcdf, place)),
        "ulog": (".ulg", ulog(8.0)),
        "dataflash": (".bin", dataflash_bin(8.0)),
        "dataflash text": (".log", dataflash_log(8.0).encode()),
    }
    try:
        import pyarrow  # noqa: F401

        out["parquet"] = (".parquet", _written(".parquet", record().save_parquet, place))
    except ImportError:
        pass
    return out


MODEL = {
    "method": "dsr_e", "inputs": ["de"], "outputs": ["q", "alpha"], "time": "discrete", "dt_s": 0.05, "status": "good",
    "A": [[0.9, 0.1], [-0.1, 0.9]], "B": [[0.1], [0.2]], "C": [[1.0, 0.0], [0.0, 1.0]], "D": [[0.0], [0.0]],
    "delays_s": [0.0], "advice": [{"severity": "note", "code": "x", "sentence": "a"}],
}  # fmt: skip


def model() -> bytes:
    """Return a model file as ``testbench run`` writes it."""
    return json.dumps(MODEL, indent=1).encode()


def scenarios() -> dict[str, str]:
    """Return name -> text of every packaged scenario, and of the suites."""
    files = [*SCENARIOS.rglob("*.toml"), *SUITES.glob("*.toml")]
    return {f"{f.parent.name}/{f.stem}": f.read_text(encoding="utf-8") for f in sorted(files)}


def read_scenario(name: str, text: str, folder: Path) -> Any:
    """Return what the reader of its kind makes of the text of a packaged file, or of one that was damaged."""
    path = folder / f"{Path(name).name}.toml"
    path.write_text(text, encoding="utf-8")
    match name.split("/")[0]:
        case "suites":
            return load_suite(str(path))
        case "ground_tests":
            for table in (SCENARIOS / "ground_tests").glob("*.csv"):
                shutil.copy(table, folder)
            return read_ground_test(path).content
        case "structures":
            return Text(path, "").made()
        case _:
            return load(path)
