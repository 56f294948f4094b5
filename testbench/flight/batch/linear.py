"""Linearise many trimmed flights: the points of the differences of one aircraft fill blocks of a batch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.channels import CONTROLS
from testbench.core.constants import FT_M
from testbench.core.errors import TestbenchError
from testbench.core.record import FloatArray
from testbench.flight.batch import registers as r
from testbench.flight.batch.check import judged
from testbench.flight.batch.compiled import LANES
from testbench.flight.batch.fly import Simulator
from testbench.flight.batch.model import BatchModel, put, read, registers
from testbench.flight.batch.properties import CORE, plain
from testbench.flight.condition import TrimmedFlight
from testbench.flight.linear_model import LinearModel
from testbench.flight.linearise import Layout, linearise

_SURFACES = ("de", "da", "dr")
_OF_ENGINES = ("/propeller-rpm", "/map-pa")  # states that JSBSim brings to rest, and linearises by
_ACCELERATIONS = np.array([FT_M, FT_M, FT_M, 1.0, 1.0, 1.0])


def linearise_many(
    aircraft: Sequence[Aircraft], trimmed: Sequence[TrimmedFlight], simulator: Simulator = "auto"
) -> list[LinearModel | TestbenchError]:
    """Linearise every aircraft about its trim, as :func:`testbench.flight.linearise` would.

    JSBSim's values at one point remember those at the one before in the last of nine digits, where lift depends on
    alphadot; the batch's do not.

    Args:
        aircraft: what flies.
        trimmed: about which, in air without a wind.
        simulator: "jsbsim" linearises one by one.

    Returns:
        For each flight its linear model, or why there is none.
    """
    out: list[LinearModel | TestbenchError] = []
    for each, at in zip(aircraft, trimmed, strict=True):
        try:
            model = None if simulator == "jsbsim" or each.adapter is not None else judged(each, at).model
            layout = None if model is None else _layout(model)
            out.append(linearise(each, at) if model is None or layout is None else _linearised(model, layout, at))
        except TestbenchError as error:
            out.append(error)
    return out


def _layout(model: BatchModel) -> Layout | None:
    """Return what the linear model consists of; None if the program leaves out something that it needs."""
    aircraft, known, servos = model.aircraft, model.program.properties, {}
    if any(n.endswith(_OF_ENGINES) for n in known):
        return None
    for control in (u for u in _SURFACES if u in aircraft.controls):
        lag = aircraft.servo_of(control)
        if lag is None:
            continue
        if plain(lag) in known:
            servos[control] = float(model.start[known[plain(lag)]])
        elif plain(lag) in model.translation.declared:
            return None
    layout = Layout.of(aircraft, model.channels, servos)
    starts = [m.start for m in layout.memories]
    return layout if all(plain(n) in known for n in (*starts, *_modal(layout))) else None


def _modal(layout: Layout) -> dict[str, str]:
    """Return property -> state of every mode."""
    return {f"modal/{s.replace('_', '-')}": s for s in layout.states if s.startswith("eta")}


def _linearised(model: BatchModel, layout: Layout, trimmed: TrimmedFlight) -> LinearModel:
    points = layout.points(layout.trim_of(trimmed))
    names = dict.fromkeys(n for p in points for n in p)
    at = {n: np.array([p.get(n, 0.0) for p in points]) for n in names}
    parts = []
    for k in range(0, len(points), LANES):
        parts.append(_values(model, layout, {n: x[k : k + LANES] for n, x in at.items()}))
    return layout.model(np.concatenate(parts, axis=1))


def _values(model: BatchModel, layout: Layout, at: dict[str, FloatArray]) -> FloatArray:
    """Return the state derivatives, all channels and what the memories follow (rows, points), SI, of a block."""
    known, count = model.program.properties, at["h"].size
    R = registers([model] * count)
    for memory in layout.memories:
        R[known[plain(memory.start)], :count] = at.get(memory.name, 0.0)
    for name, state in _modal(layout).items():
        R[known[name], :count] = at[state]
    if "modal/static-ic" in known:
        R[known["modal/static-ic"]] = 0.0
    uvw, pqr = np.stack([at[n] for n in "uvw"]), np.stack([at[n] for n in "pqr"])
    commands = {n: at[n] for n in CONTROLS if n in model.commands}
    put(model, R, at["h"], at["theta"], at["phi"], uvw, pqr, commands, model.iterations)
    channels = read(model, R)[:, :count] * model.factors[:, None]
    channels[[i for i, n in enumerate(model.channels) if n == "psi"]] = 0.0
    R = R[:, :count]
    p, q, s, c = at["p"], at["q"], np.sin(at["phi"]), np.cos(at["phi"])
    turning = q * s + at["r"] * c
    rates = p + turning * np.tan(at["theta"]), q * c - at["r"] * s, -FT_M * R[r.V_DOWN]
    modes = sum(s.startswith("eta_") for s in layout.states)
    bent = [at[s] for s in layout.states if s.startswith("etadot_")]
    bent += [R[model.program.logged[f"modal/etaddot-{i + 1}"]] for i in range(modes)]
    followed = [R[model.program.logged[m.follows]] for m in layout.memories]
    return np.vstack([R[r.U_DOT : r.U_DOT + 6] * _ACCELERATIONS[:, None], *rates, *bent, channels, *followed])
