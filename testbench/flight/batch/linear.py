"""Linearise trimmed flights, or along a flight: the points of one aircraft's differences fill blocks of a batch."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.channels import CONTROLS
from testbench.core.constants import FT_M
from testbench.core.errors import Refusal
from testbench.core.record import FlightRecord, FloatArray
from testbench.flight.batch import registers as r
from testbench.flight.batch.check import judged
from testbench.flight.batch.jobs import Simulator, by_jsbsim
from testbench.flight.batch.model import BatchModel, filled, put, registers
from testbench.flight.batch.properties import plain
from testbench.flight.batch.vector import LANES
from testbench.flight.condition import TrimmedFlight
from testbench.flight.linear_model import LinearModel
from testbench.flight.linearise import Layout, Points, along, linearise, linearise_along

_SURFACES = ("de", "da", "dr")
_ACCELERATIONS = np.array([FT_M, FT_M, FT_M, 1.0, 1.0, 1.0])


def linearise_many(
    aircraft: Sequence[Aircraft], trimmed: Sequence[TrimmedFlight], simulator: Simulator = "auto"
) -> list[LinearModel | Refusal]:
    """Linearise every aircraft about its trim, as :func:`testbench.flight.linearise` would.

    JSBSim's values at one point remember those at the one before in the last of nine digits, where lift depends on
    alphadot; the batch's do not.

    Args:
        aircraft: what flies.
        trimmed: about which, in air without a wind.
        simulator: "jsbsim" linearises one by one, as is done where the batch cannot; by all processes that may be used.

    Returns:
        For each flight its linear model, or why there is none.
    """
    out: list[LinearModel | Refusal | None] = []
    for each, at in zip(aircraft, trimmed, strict=True):
        try:
            found = None if simulator == "jsbsim" else _model(each, at)
            out.append(None if found is None else _in_blocks(*found, at))
        except Refusal as error:
            out.append(error)

    def alone(i: int) -> LinearModel | Refusal:
        try:
            return linearise(aircraft[i], trimmed[i])
        except Refusal as error:
            return error

    return by_jsbsim(out, alone)


def _in_blocks(model: BatchModel, layout: Layout, trimmed: TrimmedFlight) -> LinearModel:
    return layout.model(_values(model, layout, layout.points(layout.trim_of(trimmed))))


def linearise_flight(
    aircraft: Aircraft,
    trimmed: TrimmedFlight,
    flown: FlightRecord,
    states: Sequence[str],
    simulator: Simulator = "auto",
) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """Return the linear models along a flight, as :func:`testbench.flight.linearise_along` would.

    Args:
        aircraft: the aircraft that flew.
        trimmed: where it began.
        flown: truth of the flight with every channel.
        states: those wanted.
        simulator: "jsbsim" evaluates one point after the other.
    """
    found = None if simulator == "jsbsim" else _model(aircraft, trimmed)
    if found is None:
        return linearise_along(aircraft, trimmed, flown, states)
    model, layout = found
    return along(layout, flown, states, partial(_values, model, layout))


def _model(aircraft: Aircraft, trimmed: TrimmedFlight) -> tuple[BatchModel, Layout] | None:
    """Return the model of an aircraft and what its linear models consist of; None if JSBSim must make them."""
    model = judged(aircraft, trimmed).model
    layout = None if model is None else _layout(model)
    return None if model is None or layout is None else (model, layout)


def _layout(model: BatchModel) -> Layout | None:
    """Return what the linear model consists of; None if the program leaves out something that it needs."""
    aircraft, known, servos = model.aircraft, model.program.properties, {}
    if model.settles or aircraft.under_law:
        return None  # engines, or its control law, have states of their own
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


def _values(model: BatchModel, layout: Layout, points: Points) -> FloatArray:
    """Return the state derivatives, all channels and what the memories follow (rows, points), SI."""
    known, logged = model.program.properties, model.program.logged
    size = next(iter(points.values())).size
    at = {n: points.get(n, np.zeros(size)) for n in (*points, *(m.name for m in layout.memories))}
    modes = sum(s.startswith("eta_") for s in layout.states)
    followed = [*(f"modal/etaddot-{i + 1}" for i in range(modes)), *(m.follows for m in layout.memories)]
    wanted = [*range(r.U_DOT, r.U_DOT + 6), r.V_DOWN, *(logged[n] for n in (*followed, *model.channels))]
    set_to = {known[name]: at[state] for name, state in _modal(layout).items()}
    set_to |= {known[plain(m.start)]: at[m.name] for m in layout.memories}
    places = np.stack([at[n] for n in ("h", "theta", "phi", *"uvw", *"pqr")])
    commands = {n: at[n] for n in CONTROLS if n in model.commands}
    R, out = registers([model]), np.empty((len(wanted), size))
    if "modal/static-ic" in known:
        R[known["modal/static-ic"]] = 0.0
    start = R.copy()
    for k in range(0, size, LANES):
        b = slice(k, k + LANES)
        R[:] = start
        for register, x in set_to.items():
            R[register] = filled(x[b])
        put(model, R, places[:, b], {n: x[b] for n, x in commands.items()})
        model.program.machine.log(R)
        out[:, b] = R[wanted, : min(LANES, size - k)]
    p, q, s, c = at["p"], at["q"], np.sin(at["phi"]), np.cos(at["phi"])
    turning = q * s + at["r"] * c
    rates = p + turning * np.tan(at["theta"]), q * c - at["r"] * s, -FT_M * out[6]
    bent = [at[n] for n in layout.states if n.startswith("etadot_")]
    channels = out[7 + len(followed) :] * model.factors[:, None]
    channels[[i for i, n in enumerate(model.channels) if n == "psi"]] = 0.0
    own_modes, memories = out[7 : 7 + modes], out[7 + modes : 7 + len(followed)]
    return np.vstack([out[:6] * _ACCELERATIONS[:, None], *rates, *bent, own_modes, channels, memories])
