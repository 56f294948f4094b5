"""Write records and identified models as files that other programs read.

A record keeps its channels. A model is written as the matrices of :mod:`testbench.questions.export.ask`, whatever
the estimator; JSBSim gets it in continuous time, mode by mode.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from math import factorial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from testbench.core import bring
from testbench.core.advice import Advised, as_json, from_json, ranked
from testbench.core.channels import channel
from testbench.core.door import read_json
from testbench.core.errors import RecordError, located, missing
from testbench.core.escape import one_line, xml_attribute, xml_comment
from testbench.core.files import mat_bytes, netcdf_bytes, parsed, write_file
from testbench.core.paths import not_found
from testbench.core.plugins import is_plugin
from testbench.core.record import NEEDS_PYARROW, FloatArray, load_record
from testbench.core.store import write_beside

PADE = 4  # order of a dead time in continuous time: right to 1 deg up to w tau = 4.5
_WORST = 1e10  # condition of the eigenvectors: above it modes cannot be told apart
_REAL = 1e-9  # of the size of a pole: an imaginary part below it is rounding
Terms = list[tuple[float, str]]
SUFFIXES = {
    "control": "_control.py", "csv": "_matrices.csv", "json": "_matrices.json", "jsbsim": "_jsbsim.xml", "mat": ".mat",
    "netcdf": ".nc", "parquet": "_matrices.parquet",
}  # fmt: skip
"""Format -> how the name of the file ends."""


def export_record(path: Path, to: str, out: Path | None = None) -> Path:
    """Write a record (NetCDF) as "csv", "mat", "mcap", "netcdf", "parquet", or by ``PACKAGE:NAME``; return the path.

    The last is a writer that an installed package brings: a function of the record and the path to write to.

    Args:
        path: the record.
        to: the format.
        out: the file; beside the record if not given.

    Raises:
        RecordError: the record is missing or damaged, there is no such format of records, or the file is the record
            itself.
        ScenarioError: no installed package brings the writer.
        BroughtCodeError: it fails.
        WriteError: the file cannot be written, or is there and was not written by the testbench.
    """
    writer = bring.find(to, None, "writers") if is_plugin(to) else None
    if writer is None and to not in ("csv", "mat", "mcap", "netcdf", "parquet"):
        raise RecordError(
            f"'{path}' is not a model (models/*.json), and records go to csv, mat, mcap, netcdf or parquet, got {to}"
        )
    record = load_record(path)
    out = out or path.with_suffix(".nc" if to == "netcdf" else f".{to.rpartition(':')[2]}")
    if out.exists() and out.samefile(path):
        raise RecordError(f"a record must not be written over itself, got '{out}'; it is NetCDF already, or give -o")
    if writer is not None:
        with bring.running(writer[0], f"the writer {to} must write"):
            return write_beside(out, partial(bring.load(*writer), record))
    save = {"csv": record.save_csv, "mat": record.save_mat, "mcap": record.save_mcap, "netcdf": record.save}
    return write_beside(out, save.get(to, record.save_parquet))


def export_model(model: Matrices, to: str, path: Path) -> Path:
    """Write a model and return the path.

    Args:
        model: the model.
        to: one of :data:`SUFFIXES`: "control" a Python module whose ``system`` is a python-control state space, dead
            times approximated (Pade, order 4) or, in discrete time, exact; "jsbsim" a ``<system>`` to include in a
            flight model; "csv" and "parquet" a row per entry of the matrices; "json", "mat" and "netcdf" the matrices.
        path: the file.

    Raises:
        RecordError: pyarrow is missing, or, for JSBSim, the model has a pole that no model in continuous time has, or
            poles that cannot be told apart.
        WriteError: the file cannot be written.
    """
    if to == "control":
        return write_file(path, control_text(model))
    if to == "jsbsim":
        return write_file(path, jsbsim_text(model))
    if to == "json":
        return write_file(path, (json.dumps(_plain(model), indent=1, ensure_ascii=False) + "\n"))
    if to == "csv":
        lines = ["matrix,row,column,value", *(f"{m},{r},{c},{v:.17g}" for m, r, c, v in _entries(model))]
        return write_file(path, ("\n".join(lines) + "\n"))
    if to == "mat":
        return write_file(path, _mat(model))
    return _write_netcdf(model, path) if to == "netcdf" else _write_parquet(model, path)


def _plain(model: Matrices) -> dict[str, Any]:
    out: dict[str, Any] = {key: getattr(model, key).tolist() for key in ("A", "B", "C", "D", "delays_s")}
    units = {name: channel(name).unit for name in (*model.inputs, *model.outputs)}
    return {
        "name": model.name, "method": model.method, "status": model.status, "advice": as_json(model.advice),
        "time": "discrete" if model.dt_s else "continuous", "dt_s": model.dt_s, "inputs": list(model.inputs),
        "outputs": list(model.outputs), "units": units, **out,
    }  # fmt: skip


def _entries(model: Matrices) -> list[tuple[str, str, str, float]]:
    states = tuple(f"x{i + 1}" for i in range(len(model.A)))
    out = []
    for name, matrix, rows, columns in (
        ("A", model.A, states, states),
        ("B", model.B, states, model.inputs),
        ("C", model.C, model.outputs, states),
        ("D", model.D, model.outputs, model.inputs),
        ("delays_s", model.delays_s, model.outputs, model.inputs),
        ("dt_s", np.array([[model.dt_s]]), ("",), ("",)),
    ):
        out += [(name, r, c, float(matrix[i, j])) for i, r in enumerate(rows) for j, c in enumerate(columns)]
    return out


def _mat(model: Matrices) -> bytes:
    """Return a MAT file; in MATLAB: ss(A, B, C, D, dt), with OutputDelay or InputDelay from delays_s."""
    names = {key: np.array(getattr(model, f"{key}s"), dtype=object) for key in ("input", "output")}
    numbers = {key: getattr(model, key) for key in ("A", "B", "C", "D", "delays_s")}
    words = {"inputs": names["input"], "outputs": names["output"], "method": model.method, "status": model.status}
    return mat_bytes({**numbers, "dt": model.dt_s, **words}, "identified model")


def _write_netcdf(model: Matrices, path: Path) -> Path:
    sizes = {"state": len(model.A), "output": len(model.outputs), "input": len(model.inputs)}
    dimensions = {"A": ("state", "state"), "B": ("state", "input"), "C": ("output", "state"), "D": ("output", "input"),
                  "delays_s": ("output", "input")}  # fmt: skip
    words = {"inputs": " ".join(model.inputs), "outputs": " ".join(model.outputs), "dt_s": model.dt_s,
             "method": model.method, "status": model.status}  # fmt: skip

    def fill(file: Any) -> None:
        """Fill the NetCDF file."""
        file.dimensions = sizes
        file.attrs.update(words)
        for name, axes in dimensions.items():
            file.create_variable(name, axes, data=getattr(model, name))

    return write_file(path, netcdf_bytes(fill), "a model must be written to a folder that can be written to")


def _write_parquet(model: Matrices, path: Path) -> Path:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise RecordError(missing(*NEEDS_PYARROW)) from error
    columns = list(zip(*_entries(model), strict=True))
    table = pa.table([pa.array(column) for column in columns], names=["matrix", "row", "column", "value"])
    buffer = pa.BufferOutputStream()
    pq.write_table(table, buffer)
    return write_file(path, buffer.getvalue().to_pybytes())


def control_text(model: Matrices) -> str:
    """Return a Python module whose ``system`` is the model in python-control, with named signals."""
    plain = without_delays(model)
    lines = [f"# {one_line(model.name)}: {one_line(model.method)}, deviations from trim, SI units and radians.",
             "import control", "import numpy as np", ""]  # fmt: skip
    lines += [f"# {a.severity}: {one_line(a)}" for a in ranked(model.advice)]
    if plain is not model:
        how = "exact" if model.dt_s else f"as Pade approximations of order {PADE}"
        lines.append(f"# dead times in s, by output and input, {how} in the matrices: {model.delays_s.tolist()}")
    for name in "ABCD":
        matrix = getattr(plain, name)
        lines.append(f"{name} = np.array({matrix.tolist()!r}).reshape({matrix.shape})")
    time = f", {model.dt_s!r}" if model.dt_s else ""
    lines += ["system = control.ss(", f"    A, B, C, D{time}, inputs={list(model.inputs)!r}, "
              f"outputs={list(model.outputs)!r}", ")", ""]  # fmt: skip
    return "\n".join(lines)


# --- a model as a system of JSBSim ------------------------------------------------------------------------------------


def modal(model: Matrices) -> tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.complex128]]:
    """Return the poles (n,) rad/s, C V (p, n) and V^-1 B (n, m) of a model in continuous time.

    Raises:
        RecordError: a pole that continuous time does not have, or poles that cannot be told apart.
    """
    if not len(model.A):
        none = np.zeros(0, complex)
        return none, np.zeros((len(model.C), 0), complex), np.zeros((0, model.B.shape[1]), complex)
    poles, V = np.linalg.eig(model.A.astype(complex))
    scale = np.linalg.norm(V, axis=0)
    if np.linalg.cond(V / scale) > _WORST:
        raise RecordError(
            f"the poles of '{model.name}' must differ to be written mode by mode, but some coincide; "
            "export it to control or mat instead, or identify it with another order"
        )
    inner, outer = np.linalg.solve(V, model.B.astype(complex)), model.C @ V
    if not model.dt_s:
        return np.asarray(poles), np.asarray(outer), np.asarray(inner)
    if np.any((poles.real <= 0.0) & (np.abs(poles.imag) <= _REAL * np.abs(poles))):
        worst = poles[np.argmin(poles.real)]
        raise RecordError(
            f"every pole of a model for JSBSim must have a counterpart in continuous time, but '{model.name}' has one "
            f"at z = {worst.real:.3g}; lower its order, or export it to control or mat instead"
        )
    lam = np.log(poles) / model.dt_s
    step = np.where(np.abs(poles - 1.0) < 1e-12, model.dt_s, (poles - 1.0) / np.where(lam == 0.0, 1.0, lam))
    return np.asarray(lam), np.asarray(outer), np.asarray(inner / step[:, None])


def jsbsim_text(model: Matrices) -> str:
    """Return the ``<system>``; see :func:`testbench.questions.export.ask.export_model`.

    Raises:
        RecordError: see :func:`modal`.
    """
    poles, outer, inner = modal(model)
    lines = [
        '<?xml version="1.0" encoding="utf-8"?>',
        f"<!-- {xml_comment(model.name)}: identified by {xml_comment(model.method)},",
        f"     status {xml_comment(model.status)}.",
        "     Inputs and outputs are deviations from trim, SI units and radians. Set the input properties in each",
        "     frame, or replace them by properties of the flight model; include it there as a system file.",
        "     The filters run at the rate that the simulation has when it loads them; set it before. -->",
        f"<system name={xml_attribute('identified ' + model.name)}>",
        *(f'  <property value="0"> {_input(name)} </property>  <!-- {channel(name).unit} -->' for name in model.inputs),
        '  <channel name="modes">',
    ]
    sums: list[Terms] = [[] for _ in model.outputs]
    for j, tau in sorted({(j, float(t)) for row in model.delays_s for j, t in enumerate(row)}):
        source = _input(model.inputs[j])
        late = [i for i in range(len(model.outputs)) if model.delays_s[i, j] == tau]
        stem = f"identified/{model.inputs[j]}-{round(1e6 * tau)}us"
        if tau > 0.0:
            lines += _block("sensor", stem, source, [f'<delay type="time"> {tau!r} </delay>'])
            source = stem
        for i in late:
            if model.D[i, j] != 0.0:
                sums[i].append((float(model.D[i, j]), source))
        lines += _modes(poles, outer, inner[:, j], late, stem, source, sums)
    lines += ["  </channel>", '  <channel name="outputs">']
    for name, terms in zip(model.outputs, sums, strict=True):
        lines += _sum(f"identified/output/{name}", terms)
    return "\n".join([*lines, "  </channel>", "</system>", ""])


def _modes(
    poles: NDArray[np.complex128],
    outer: NDArray[np.complex128],
    inner: NDArray[np.complex128],
    late: list[int],
    stem: str,
    source: str,
    sums: list[Terms],
) -> list[str]:
    """Return the filters that one input drives, and add what they contribute to the outputs ``late``."""
    lines: list[str] = []
    for k, pole in enumerate(poles):
        share = outer[:, k] * inner[k]
        name = f"{stem}-mode-{k + 1}"
        if abs(pole.imag) <= _REAL * abs(pole):
            a = float(-pole.real)
            if a == 0.0:
                lines += _block("integrator", name, source, ["<c1> 1 </c1>"])
                gain = 1.0
            else:
                lines += _block("lag_filter", name, source, [f"<c1> {a!r} </c1>"])
                gain = 1.0 / a
            for i in late:
                sums[i].append((float(share[i].real) * gain, name))
        elif pole.imag > 0.0:
            below = (1.0, float(-2.0 * pole.real), float(abs(pole) ** 2))
            for suffix, above in (("rate", (0.0, 1.0, 0.0)), ("value", (0.0, 0.0, 1.0))):
                numbers = [f"<c{i}> {c!r} </c{i}>" for i, c in enumerate((*above, *below), start=1)]
                lines += _block("second_order_filter", f"{name}-{suffix}", source, numbers)
            for i in late:
                sums[i].append((float(2.0 * share[i].real), f"{name}-rate"))
                sums[i].append((float(-2.0 * (share[i] * np.conj(pole)).real), f"{name}-value"))
    return lines


def _input(name: str) -> str:
    return f"identified/input/{name}"


def _block(kind: str, name: str, source: str, numbers: list[str]) -> list[str]:
    return [f'    <{kind} name="{name}">', f"      <input> {source} </input>", *(f"      {n}" for n in numbers),
            f"    </{kind}>"]  # fmt: skip


def _sum(name: str, terms: Terms) -> list[str]:
    products = [f"<product><value> {c!r} </value><property> {source} </property></product>" for c, source in terms]
    inside = ["<sum>", *(f"  {p}" for p in products), "  <value> 0 </value>", "</sum>"]
    return [f'    <fcs_function name="{name}">', "      <function>", *(f"        {line}" for line in inside),
            "      </function>", "    </fcs_function>"]  # fmt: skip


# --- matrices ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Matrices(Advised):
    """A model in the form above."""

    #: name, method: of the file and of the estimator
    name: str
    method: str
    #: inputs, outputs: channel names (m,) and (p,)
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    #: A, B, C, D: (n, n), (n, m), (p, n), (p, m)
    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    dt_s: float  #: sample time; 0 for continuous time
    delays_s: FloatArray  #: (p, m) dead times, whole samples in discrete time
    advice: tuple[str, ...]  #: that of the estimator; ``status`` follows from it


def load_matrices(path: Path | str) -> Matrices:
    """Return the matrices of a model file that ``testbench run`` or ``testbench identify`` wrote (models/*.json).

    Raises:
        RecordError: the file is missing, damaged, or none of a model with matrices or transfer functions.
    """
    path = Path(path)
    if not path.is_file():
        raise RecordError(f"a model must be a file that exists, got {not_found(path)}")
    content = read_json(path, "model")
    kinds = {"A": _of_state_space, "denominators": _of_transfer_functions}
    kind = next((key for key in kinds if isinstance(content, dict) and key in content), None)
    if kind is None:
        raise RecordError(
            f"'{path}' must hold a model with matrices or transfer functions (models/*.json of a run), but it does not"
        )
    with parsed(path, "a complete model file"):
        model = kinds[kind](path.stem, content)
    with located(path, "inputs and outputs"):
        for name in (*model.inputs, *model.outputs):
            channel(str(name))
    n, p, m = len(model.A), len(model.outputs), len(model.inputs)
    shapes = {"A": (n, n), "B": (n, m), "C": (p, n), "D": (p, m), "delays_s": (p, m)}
    for name, shape in shapes.items():
        found = getattr(model, name)
        if found.shape != shape or not np.all(np.isfinite(found)):
            raise RecordError(f"{name} of '{path}' must be finite and of shape {shape}, got shape {found.shape}")
    return model


def _of_state_space(name: str, content: Mapping[str, Any]) -> Matrices:
    A, B, C, D = (np.array(content[key], float) for key in "ABCD")
    p, m = len(content["outputs"]), len(content["inputs"])
    n = len(A)
    delays = np.tile(np.array(content.get("delays_s", [0.0] * m), float), (p, 1))
    return _matrices(name, content, A.reshape(n, n), B.reshape(n, m), C.reshape(p, n), D.reshape(p, m), delays)


def _of_transfer_functions(name: str, content: Mapping[str, Any]) -> Matrices:
    """Realise one block per output: denominators are its own."""
    outputs, discrete = content["outputs"], content["time"] == "discrete"
    if discrete:  # by output, one input, b1 ... bn against 1, a1 ... an
        above = np.array([[[0.0, *content["numerators"][o]]] for o in outputs], float)
        below = np.array([content["denominators"][o] for o in outputs], float)
        delays = float(content["dt_s"]) * np.array([[content["delays"][o]] for o in outputs], float)
    else:
        above, below = np.array(content["numerators"], float), np.array(content["denominators"], float)
        delays = np.array(content["delays_s"], float)
    blocks = [
        _companion(*(_without_zeros(above[i], below[i]) if discrete else (above[i], below[i])))
        for i in range(len(outputs))
    ]
    A, B, C, D = zip(*blocks, strict=True)
    return _matrices(name, content, block_diag(*A), np.vstack(B), block_diag(*C), np.stack(D), delays)


def _without_zeros(above: FloatArray, below: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a discrete transfer function without the powers of z that cancel."""
    while below.size > 1 and below[-1] == 0.0 and not np.any(above[:, -1]):
        above, below = above[:, :-1], below[:-1]
    return above, below


def _companion(above: FloatArray, below: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return A (n, n), B (n, m), c (n,), d (m,) of one output: the observable companion form.

    Args:
        above: (m, n + 1) numerators, highest power first.
        below: (n + 1,) denominator, zeros first where its degree is lower.
    """
    lead = int(np.flatnonzero(below)[0])
    if np.any(above[:, :lead] != 0.0):
        raise ValueError("a numerator must not be of a higher degree than its denominator")
    a, b = below[lead + 1 :] / below[lead], above[:, lead:] / below[lead]
    n = a.size
    A = np.eye(n, k=1)
    A[:, 0] = -a
    c = np.zeros(n)
    c[:1] = 1.0
    return A, (b[:, 1:] - b[:, :1] * a).T, c, b[:, 0]


def _matrices(
    name: str, content: Mapping[str, Any], A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, tau: FloatArray
) -> Matrices:
    dt = float(content["dt_s"]) if content["time"] == "discrete" else 0.0
    inputs, outputs = tuple(content["inputs"]), tuple(content["outputs"])
    advice = from_json(content.get("advice", ()))
    return Matrices(name, str(content["method"]), inputs, outputs, A, B, C, D, dt, tau, advice)


def without_delays(model: Matrices) -> Matrices:
    """Return the model with its dead times as states: Pade in continuous, exact in discrete time."""
    tau = model.delays_s
    if not np.any(tau > 0.0):
        return model
    every = np.arange(len(tau))
    blocks = [_delayed(model, rows) for rows in ([every] if np.all(tau == tau[0]) else every[:, None])]
    A, B, C, D = zip(*blocks, strict=True)
    together = {"A": block_diag(*A), "B": np.vstack(B), "C": block_diag(*C), "D": np.vstack(D)}
    return replace(model, **together, delays_s=np.zeros(tau.shape))


def _delayed(model: Matrices, rows: NDArray[np.intp]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return A, B, C, D of the outputs ``rows``, which share their dead times, behind these."""
    A, B, C, D = model.A, model.B.copy(), model.C[rows], model.D[rows].copy()
    for j, tau in enumerate(model.delays_s[rows[0]]):
        if tau <= 0.0:
            continue
        a, b, c, d = _dead_time(float(tau), model.dt_s)
        A = np.block([[A, np.outer(B[:, j], c)], [np.zeros((len(a), len(A))), a]])
        C = np.hstack([C, np.outer(D[:, j], c)])
        B = np.vstack([B, np.zeros((len(a), B.shape[1]))])
        B[:, j] *= d
        B[-len(a) :, j] = b
        D[:, j] *= d
    return A, B, C, D


def _dead_time(tau: float, dt_s: float) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Return A, b, c, d of a dead time."""
    if dt_s:
        n = round(tau / dt_s)
        return np.eye(n, k=1), np.eye(n)[-1], np.eye(n)[0], 0.0
    n = PADE  # coefficients: G. H. Golub, C. F. Van Loan, Matrix Computations, 4th ed. 2013, sec. 9.3.1
    k = np.arange(n, -1, -1)
    size = np.array([factorial(2 * n - i) / (factorial(i) * factorial(n - i)) for i in k.tolist()])
    A, B, c, d = _companion(np.array([size * (-tau) ** k]), size * tau**k)
    return A, B[:, 0], c, float(d[0])
