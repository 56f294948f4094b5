"""An identified model as a ``<system>`` of JSBSim: its modes as filters of first and second order.

In continuous time, with eigenvalues lambda_i, left and right eigenvectors,

    y = sum_i C v_i w_i' B / (s - lambda_i) u + D u,

which JSBSim's filters compute by Tustin's rule at the rate of the simulation (JSBSim, FGFilter). A model in discrete
time is first converted to continuous time: lambda = ln(z) / dt, exact for held inputs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from testbench.core.channels import channel
from testbench.core.errors import RecordError
from testbench.core.escape import xml_attribute, xml_comment
from testbench.questions.export.matrices import Matrices

_WORST = 1e10  # condition of the eigenvectors: above it modes cannot be told apart
_REAL = 1e-9  # of the size of a pole: an imaginary part below it is rounding
Terms = list[tuple[float, str]]


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
