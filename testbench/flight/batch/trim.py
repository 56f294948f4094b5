"""Trim many flights at once: Newton's method on the forces of a batch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.constants import FT_M
from testbench.core.errors import Refusal
from testbench.core.named import Named, obtain_all
from testbench.core.record import FloatArray
from testbench.flight.air import Air
from testbench.flight.batch import registers as r
from testbench.flight.batch.check import judged_at
from testbench.flight.batch.jobs import Simulator, by_jsbsim
from testbench.flight.batch.model import BatchModel, filled, keep_states, put, read, read_states, registers
from testbench.flight.batch.vector import LANES
from testbench.flight.condition import FlightCondition, TrimmedFlight
from testbench.flight.executive import body_from_earth
from testbench.flight.start import Beginning
from testbench.flight.trim import (
    RADIUS_EAST_M,
    RADIUS_NORTH_M,
    TOLERANCE,
    UNKNOWN_STEP,
    checked_trim,
    first_guess,
    trim,
    trim_and_executive,
    unknowns,
    values_of,
)  # fmt: skip

Near = tuple[TrimmedFlight, FloatArray]
"""A trim, and the slopes of accelerations over its unknowns (:func:`testbench.flight.trim.slopes_at`)."""
_ITERATIONS = 12  # of Newton's method; those with slopes that are known are cheap
_SHRINKS = 0.2  # of what is left, by a step with slopes that are known; else they are made afresh
_LONGEST = 0.3  # step of an unknown
_SI = np.array([FT_M, FT_M, FT_M, 1.0, 1.0, 1.0])


def trim_many(
    aircraft: Sequence[Named[Aircraft]],
    conditions: Sequence[FlightCondition],
    rate_hz: float | None = None,
    airs: Sequence[Air | None] | None = None,
    simulator: Simulator = "auto",
    near: Callable[[int], Near | None] | None = None,
) -> list[TrimmedFlight | Refusal]:
    """Trim every aircraft at its condition, as :func:`testbench.flight.trim` would.

    What does not come to an equilibrium in the batch is trimmed by JSBSim, which says why there is none; by all
    processes that may be used (:func:`testbench.core.processes.processes`). What each comes to does not depend on the
    others.

    Args:
        aircraft: of each flight.
        conditions: of each flight.
        rate_hz: frame rate; each aircraft's own if not given.
        airs: of each flight; only its steady wind counts.
        simulator: "jsbsim" trims one by one.
        near: flight -> a trim that is known of an aircraft much like it, with its slopes, to begin from.

    Returns:
        For each flight its trim, or why there is none.

    Example:
        >>> import testbench as tb
        >>> taurus = tb.load_aircraft("taurus")
        >>> trims = tb.trim_many([taurus] * 2, [tb.FlightCondition(V, 100.0) for V in (12.0, 14.0)])
        >>> trims[0].alpha > trims[1].alpha
        True
    """
    planes = obtain_all(Aircraft, aircraft)
    out: list[TrimmedFlight | Refusal | None] = [None] * len(planes)
    blowing = airs or [None] * len(planes)
    groups: dict[int, list[tuple[int, BatchModel]]] = {}
    turning: dict[int, BatchModel] = {}
    for i, (each, condition) in enumerate(zip(planes, conditions, strict=True)):
        try:
            model = None
            if simulator != "jsbsim":
                begin, slopes = (near(i) if near is not None else None) or (None, None)
                at_rest = partial(trim, each, condition, rate_hz, blowing[i], begin, slopes=slopes)
                model = judged_at(each, rate_hz or each.rate_hz, condition, at_rest).model
                if model is not None and model.settles:  # JSBSim brings propellers to rest
                    turning[i], model = model, None
        except Refusal as error:
            out[i] = error
            continue
        if model is not None:
            groups.setdefault(id(model.program), []).append((i, model))
    for group in groups.values():
        members = [i for i, _ in group]
        of = [conditions[i] for i in members], [blowing[i] for i in members]
        found = _trimmed([m for _, m in group], *of, [None if near is None else near(i) for i in members])
        for i, result in zip(members, found, strict=True):
            out[i] = result

    def alone(i: int) -> tuple[TrimmedFlight | Refusal, dict[str, float]]:
        begin, slopes = (near(i) if near is not None else None) or (None, None)
        try:
            found, fdm = trim_and_executive(planes[i], conditions[i], rate_hz, blowing[i], begin, slopes=slopes)
        except Refusal as error:
            return error, {}
        return found, read_states(turning[i], Beginning.at(found), fdm) if i in turning else {}

    known: list[tuple[TrimmedFlight | Refusal, dict[str, float]] | None]
    known = [None if each is None else (each, {}) for each in out]
    trims = by_jsbsim(known, alone)
    for i, (reached, states) in enumerate(trims):
        if states and isinstance(reached, TrimmedFlight):  # flights from here need not load the model again
            keep_states(turning[i], Beginning.at(reached), states)
    return [reached for reached, _ in trims]


def _trimmed(
    models: Sequence[BatchModel],
    conditions: Sequence[FlightCondition],
    airs: Sequence[Air | None],
    near: Sequence[Near | None],
) -> list[TrimmedFlight | Refusal | None]:
    """Trim flights of one program; None for one that does not come to rest."""
    problem = _Problem(models, conditions, airs)
    x, done = problem.newton(near)
    residual, state = problem.at_rest(x)
    out: list[TrimmedFlight | Refusal | None] = []
    for i, (model, condition) in enumerate(zip(models, conditions, strict=True)):
        if not (done[i] and np.max(np.abs(residual[:, i])) < TOLERANCE):
            out.append(None)
            continue
        found = dict(zip(problem.names, map(float, x[:, i]), strict=True))
        try:
            out.append(
                checked_trim(
                    model.aircraft, condition, model.rate_hz, found, residual[:, i],
                    dict(zip(model.channels, map(float, state[:, i] * model.factors), strict=True)),
                )
            )  # fmt: skip
        except Refusal as error:
            out.append(error)
    return out


class _Problem:
    """Six accelerations (6, points) as functions of the unknowns (unknowns, points) of flights of one program.

    Both sides of every difference of a Jacobian are points of their own, so that one flight fills a block. Each point
    is evaluated by fresh registers: it does not depend on those before it.
    """

    def __init__(
        self, models: Sequence[BatchModel], conditions: Sequence[FlightCondition], airs: Sequence[Air | None]
    ) -> None:
        self._models = models
        self._V, self._h, self._gamma = (
            np.array([getattr(c, n) for c in conditions]) for n in ("V_m_s", "h_m", "gamma_rad")
        )
        self.names = unknowns(models[0].aircraft)
        self._wind = np.array([(0.0, 0.0, 0.0) if a is None else a.wind_m_s for a in airs]).T
        self._steps = np.array([UNKNOWN_STEP.get(n, 1e-4) for n in self.names])

    def newton(self, near: Sequence[Near | None]) -> tuple[FloatArray, np.ndarray]:
        """Return unknowns (unknowns, flights), and which flights have come to rest; each stops by itself.

        Where slopes are known they are kept, with the change of rank one that each step tells (C. G. Broyden,
        Mathematics of Computation 19, 1965, pp. 577-593), until a step leaves too much.
        """
        n, m = len(self.names), len(self._models)
        x, J = np.repeat(first_guess(self.names)[:, None], m, axis=1), np.full((6, n, m), np.nan)
        for i, known in enumerate(near):
            if known is not None and known[1].shape == (6, n):
                x[:, i], J[:, :, i] = values_of(self.names, known[0]), known[1]
        kept = np.all(np.isfinite(J), axis=(0, 1))  # with slopes that are known
        moving = np.arange(m)
        residual = self._accelerations(x, moving)
        for _ in range(_ITERATIONS):
            moving = moving[~(np.max(np.abs(residual[:, moving]), axis=0) < TOLERANCE)]
            if not moving.size:
                break
            if (afresh := moving[~kept[moving]]).size:
                J[:, :, afresh] = self._jacobian(x[:, afresh], afresh)
            steps = np.zeros((n, m))
            for i in moving:
                if np.all(np.isfinite(J[:, :, i])) and np.linalg.cond(J[:, :, i]) < 1e12:
                    steps[:, i] = -np.clip(np.linalg.solve(J[:, :, i], residual[:, i]), -_LONGEST, _LONGEST)
            x += steps
            left = self._accelerations(x[:, moving], moving)
            for i, after in zip(moving, left.T, strict=True):
                step = steps[:, i]
                if kept[i] and np.max(np.abs(after)) < _SHRINKS * np.max(np.abs(residual[:, i])):
                    J[:, :, i] += np.outer(after - residual[:, i] - J[:, :, i] @ step, step) / (step @ step)
                else:
                    kept[i] = False
            residual[:, moving] = left
        return x, np.max(np.abs(residual), axis=0) < TOLERANCE

    def _jacobian(self, x: FloatArray, flights: np.ndarray) -> FloatArray:
        """Return d accelerations / d unknowns (6, unknowns, flights) by central differences."""
        n, m = x.shape
        steps = self._steps[:, None] * np.eye(n)
        points = np.concatenate([x[:, None, :] + steps[:, :, None], x[:, None, :] - steps[:, :, None]], axis=1)
        found = self._accelerations(points.reshape(n, -1), np.tile(flights, 2 * n)).reshape(-1, 2, n, m)
        return (found[:, 0] - found[:, 1]) / (2.0 * self._steps[:, None])

    def _accelerations(self, x: FloatArray, flights: np.ndarray) -> FloatArray:
        blocks = (slice(k, k + LANES) for k in range(0, len(flights), LANES))
        out = [self._block(x[:, b], flights[b])[r.U_DOT : r.U_DOT + 6, : len(flights[b])] for b in blocks]
        return np.concatenate(out, axis=1) * _SI[:, None]

    def _block(self, x: FloatArray, flights: np.ndarray) -> FloatArray:
        """Return the registers (registers, LANES) of up to LANES points.

        Args:
            x: (unknowns, points).
            flights: (points,) whose each is.
        """
        models = [self._models[i] for i in flights]
        R = registers(models)
        wind, V, h = self._wind[:, flights], self._V[flights], self._h[flights]
        R[r.GUST : r.GUST + 3] = filled(wind) / FT_M
        at = dict(zip(self.names, x, strict=True))
        zero = np.zeros_like(V)
        alpha, phi, beta = at["alpha"], at["phi"], at.get("beta", zero)
        theta = alpha + at.get("gamma", self._gamma[flights])
        uvw = V * np.stack([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)])
        C = body_from_earth(theta, phi)
        uvw = uvw + np.einsum("ijf,jf->if", C, wind)
        north, east, _ = np.einsum("ijf,if->jf", C, uvw)
        turn = np.stack([east / (RADIUS_EAST_M + h), -north / (RADIUS_NORTH_M + h), zero])
        pqr = np.einsum("ijf,jf->if", C, turn)
        put(models[0], R, np.stack([h, theta, phi, *uvw, *pqr]), at)
        return R

    def at_rest(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return accelerations (6, flights), SI, and every channel (channels, flights), in JSBSim's unit."""
        residual, state = [], []
        for k in range(0, len(self._models), LANES):
            flights = np.arange(len(self._models))[k : k + LANES]
            R = self._block(x[:, flights], flights)
            residual.append(R[r.U_DOT : r.U_DOT + 6, : flights.size] * _SI[:, None])
            state.append(read(self._models[0], R)[:, : flights.size])
        return np.concatenate(residual, axis=1), np.concatenate(state, axis=1)
