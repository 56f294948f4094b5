"""Trim many flights at once: Newton's method on the forces of a batch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.constants import FT_M
from testbench.core.errors import TestbenchError
from testbench.core.record import FloatArray
from testbench.flight.air import Air
from testbench.flight.batch import registers as r
from testbench.flight.batch.check import judged, variant_known
from testbench.flight.batch.compiled import LANES
from testbench.flight.batch.jobs import Simulator
from testbench.flight.batch.model import BatchModel, filled, put, read, registers
from testbench.flight.condition import FlightCondition, TrimmedFlight
from testbench.flight.trim import (
    RADIUS_EAST_M,
    RADIUS_NORTH_M,
    TOLERANCE,
    UNKNOWN_STEP,
    checked_trim,
    first_guess,
    trim,
    unknowns,
)  # fmt: skip

_ITERATIONS = 12
_LONGEST = 0.3  # step of an unknown
_SI = np.array([FT_M, FT_M, FT_M, 1.0, 1.0, 1.0])


def trim_many(
    aircraft: Sequence[Aircraft],
    conditions: Sequence[FlightCondition],
    rate_hz: float | None = None,
    airs: Sequence[Air | None] | None = None,
    simulator: Simulator = "auto",
) -> list[TrimmedFlight | TestbenchError]:
    """Trim every aircraft at its condition, as :func:`testbench.flight.trim` would.

    The first of each shape is trimmed by JSBSim, which the batch is then compared with. What does not come to an
    equilibrium in the batch is trimmed by JSBSim, too, which says why there is none. What each comes to does not depend
    on the others.

    Args:
        aircraft: of each flight.
        conditions: of each flight.
        rate_hz: frame rate; each aircraft's own if not given.
        airs: of each flight; only its steady wind counts.
        simulator: "jsbsim" trims one by one.

    Returns:
        For each flight its trim, or why there is none.

    Example:
        >>> import testbench as tb
        >>> taurus = tb.load_aircraft("taurus")
        >>> trims = tb.trim_many([taurus] * 2, [tb.FlightCondition(V, 100.0) for V in (12.0, 14.0)])
        >>> trims[0].alpha > trims[1].alpha
        True
    """
    out: list[TrimmedFlight | TestbenchError | None] = [None] * len(aircraft)
    blowing = airs or [None] * len(aircraft)
    groups: dict[int, list[tuple[int, BatchModel]]] = {}
    for i, (each, condition) in enumerate(zip(aircraft, conditions, strict=True)):
        try:
            model = None if simulator == "jsbsim" else _model(each, rate_hz or each.rate_hz, condition, blowing[i])
        except TestbenchError as error:
            out[i] = error
            continue
        if model is None:
            out[i] = _by_jsbsim(each, condition, rate_hz, blowing[i])
        else:
            groups.setdefault(id(model.program), []).append((i, model))
    for group in groups.values():
        for k in range(0, len(group), LANES):
            block = group[k : k + LANES]
            members = [i for i, _ in block]
            found = _trimmed([m for _, m in block], [conditions[i] for i in members], [blowing[i] for i in members])
            for i, result in zip(members, found, strict=True):
                out[i] = _by_jsbsim(aircraft[i], conditions[i], rate_hz, blowing[i]) if result is None else result
    return [x for x in out if x is not None]


def _model(aircraft: Aircraft, rate_hz: float, condition: FlightCondition, air: Air | None) -> BatchModel | None:
    """Return the model to trim by, or None if JSBSim must; an unknown one is trimmed and judged first."""
    known = variant_known(aircraft, rate_hz, condition)
    if known is None:
        known = judged(aircraft, trim(aircraft, condition, rate_hz, air)).model
    return None if known is None or known.settles else known  # JSBSim brings propellers to rest


def _by_jsbsim(
    aircraft: Aircraft, condition: FlightCondition, rate_hz: float | None, air: Air | None
) -> TrimmedFlight | TestbenchError:
    try:
        return trim(aircraft, condition, rate_hz, air)
    except TestbenchError as error:
        return error


def _trimmed(
    models: Sequence[BatchModel], conditions: Sequence[FlightCondition], airs: Sequence[Air | None]
) -> list[TrimmedFlight | TestbenchError | None]:
    """Trim one block; None for a flight that does not come to rest."""
    problem = _Problem(models, conditions, airs)
    x, residual, done = problem.newton()
    state = problem.state()
    out: list[TrimmedFlight | TestbenchError | None] = []
    for lane, (model, condition) in enumerate(zip(models, conditions, strict=True)):
        if not done[lane]:
            out.append(None)
            continue
        found = dict(zip(problem.names, map(float, x[:, lane]), strict=True))
        try:
            out.append(
                checked_trim(
                    model.aircraft, condition, model.rate_hz, found, residual[:, lane],
                    dict(zip(model.channels, map(float, state[:, lane] * model.factors), strict=True)),
                )
            )  # fmt: skip
        except TestbenchError as error:
            out.append(error)
    return out


class _Problem:
    """Six accelerations (6, flights) as functions of the unknowns (unknowns, flights)."""

    def __init__(
        self, models: Sequence[BatchModel], conditions: Sequence[FlightCondition], airs: Sequence[Air | None]
    ) -> None:
        self._model = models[0]
        self._V, self._h, self._gamma = (
            np.array([getattr(c, n) for c in conditions]) for n in ("V_m_s", "h_m", "gamma_rad")
        )
        self.names = unknowns(models[0].aircraft)
        self._wind = np.array([(0.0, 0.0, 0.0) if a is None else a.wind_m_s for a in airs]).T
        self._models = models
        self._R = self._afresh()

    def _afresh(self) -> FloatArray:
        R = registers(self._models)
        R[r.GUST : r.GUST + 3] = filled(self._wind) / FT_M
        return R

    def newton(self) -> tuple[FloatArray, FloatArray, np.ndarray]:
        """Return unknowns, residuals and which flights have come to rest; each stops by itself."""
        x = np.repeat(first_guess(self.names)[:, None], len(self._models), axis=1)
        residual = self._accelerations(x)
        for _ in range(_ITERATIONS):
            moving = ~(np.max(np.abs(residual), axis=0) < TOLERANCE)
            if not np.any(moving):
                break
            J = self._jacobian(x)
            for lane in np.flatnonzero(moving):
                if not (np.all(np.isfinite(J[:, :, lane])) and np.linalg.cond(J[:, :, lane]) < 1e12):
                    continue
                step = np.linalg.solve(J[:, :, lane], residual[:, lane])
                x[:, lane] -= np.clip(step, -_LONGEST, _LONGEST)
            residual = np.where(moving, self._accelerations(x), residual)
        self._R = self._afresh()  # so that nothing remains of how long others took
        residual = self._accelerations(x)
        return x, residual, np.max(np.abs(residual), axis=0) < TOLERANCE

    def _jacobian(self, x: FloatArray) -> FloatArray:
        columns = []
        for i, name in enumerate(self.names):
            step = np.zeros_like(x)
            step[i] = UNKNOWN_STEP.get(name, 1e-4)
            up, down = self._accelerations(x + step), self._accelerations(x - step)
            columns.append((up - down) / (2.0 * step[i]))
        return np.stack(columns, axis=1)

    def _accelerations(self, x: FloatArray) -> FloatArray:
        at = dict(zip(self.names, x, strict=True))
        zero = np.zeros_like(self._V)
        alpha, phi, beta = at["alpha"], at["phi"], at.get("beta", zero)
        theta = alpha + at.get("gamma", self._gamma)
        uvw = self._V * np.stack([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)])
        C = _body_from_earth(theta, phi)
        uvw = uvw + np.einsum("ijf,jf->if", C, self._wind)
        north, east, _ = np.einsum("ijf,if->jf", C, uvw)
        turn = np.stack([east / (RADIUS_EAST_M + self._h), -north / (RADIUS_NORTH_M + self._h), zero])
        pqr = np.einsum("ijf,jf->if", C, turn)
        put(self._model, self._R, self._h, theta, phi, uvw, pqr, at, self._model.iterations)
        return self._R[r.U_DOT : r.U_DOT + 6, : len(self._models)] * _SI[:, None]

    def state(self) -> FloatArray:
        """Return every channel (channels, flights), in JSBSim's unit."""
        return read(self._model, self._R)[:, : len(self._models)]


def _body_from_earth(theta: FloatArray, phi: FloatArray) -> FloatArray:
    """Return the matrices (3, 3, flights) that take north, east, down to body axes, heading north."""
    s, c, sp, cp, zero = np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi), np.zeros_like(phi)
    return np.array([[c, zero, -s], [sp * s, cp, sp * c], [cp * s, -sp, cp * c]])
