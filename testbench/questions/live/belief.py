"""What is believed of the aircraft where it flies: derivatives, and the aircraft that its uncertainty allows."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete

from testbench.aircraft import Aircraft
from testbench.aircraft.believed import drawn, with_priors
from testbench.core.errors import Refusal
from testbench.core.record import FloatArray
from testbench.core.scenario.air import LOWEST_M
from testbench.estimators.parametric.kalman.innovations import sampled_noise
from testbench.estimators.parametric.structure import LinearStructure
from testbench.estimators.parametric.structures.lateral import lateral_directional
from testbench.estimators.parametric.structures.longitudinal import SHORT, longitudinal
from testbench.estimators.parametric.structures.settings import Trim
from testbench.evaluation.derivatives import Derivative, dimensional_derivatives, true_parameters
from testbench.flight import FlightCondition, linearise, trim
from testbench.flight.air import scale_lengths
from testbench.inference.form import ALPHA_RAD, FORM_STD
from testbench.inference.multiple_models import Bank, in_quiet_flight

DRAWS = 16
"""Aircraft drawn within the uncertainty of the believed one: their spread is known to 18 %."""
_TURBULENCE_M_S = (0.03, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2)
_BY_RATE = (0.1, 1.0, 10.0)
"""Intensities of turbulence that quiet flight is tried with, and those by which it turns each rate beside the usual."""
_INTERPOLATED = (0.5, 0.7, 1.0, 1.4)
"""White noise of a reading on the even clock, of that of its samples as they came."""
_LATER = (0.25, 1.0, 4.0, 16.0)
"""Squares of the intensity that there may be in a run, of that in the quiet flight before."""
LEAST_FORM = 0.03
"""Share of a derivative by which a linear fit is off on simulated records free of noise, at 25 to 100 Hz."""
_TAIL = 0.5  # of the damping of a rate that comes by the lag of the flow at the tail
_POWER = {"V": 0.0, "phi": 0.0, "theta": 0.0, "p": 1.0, "q": 1.0, "r": 1.0}
ATTITUDES = ("phi", "theta")
CONTROLS = {"longitudinal": ("de",), "lateral": ("da", "dr")}


def structure_of(plane: str, at: Trim, controls: Sequence[str]) -> LinearStructure:
    """Return the equations of a plane of motion about a trim."""
    if plane == "longitudinal":
        return longitudinal(at, states=SHORT, outputs=SHORT, controls=controls)
    return lateral_directional(at, controls=controls)


def by_airspeed(names: Sequence[str]) -> FloatArray:
    """Return the powers (f,) of airspeed that derivatives go with: 2 as forces and moments, 1 where a rate makes them.

    Dynamic pressure is the square, and a rate turns the flow by rate over airspeed.
    """
    return np.array([_POWER.get(name.partition("_")[2], 2.0) for name in names])


@dataclass(frozen=True, eq=False)
class Believed:
    """The believed aircraft at a condition, first, and those drawn within its uncertainty."""

    aircraft: Aircraft  # itself
    at: Trim  # its trim there
    members: tuple[tuple[Derivative, ...], ...]  # derivatives of each
    condition: FlightCondition  # of the trims

    @classmethod
    def of(cls, aircraft: Aircraft, V_m_s: float, h_m: float) -> Believed:
        """Trim and linearise the aircraft.

        Raises:
            TrimError: it does not fly there.
        """
        condition = FlightCondition(V_m_s, h_m)
        trimmed = trim(aircraft, condition)
        members = (tuple(dimensional_derivatives(linearise(aircraft, trimmed), trimmed)),)
        return cls(aircraft, Trim(V_m_s, trimmed.alpha, trimmed.alpha), members, condition)

    def with_draws(self, numbers: Iterable[int]) -> Believed:
        """Return it with further aircraft of its uncertainty: seed 1, draws of these numbers."""
        known, members = with_priors(self.aircraft), list(self.members)
        for k in numbers if known.uncertainty else ():
            try:
                one = drawn(known, 1, k)
                there = trim(one, self.condition)
                members.append(tuple(dimensional_derivatives(linearise(one, there), there)))
            except Refusal:  # a draw that does not fly says nothing of one that does
                continue
        return replace(self, members=tuple(members))

    def values(self, structure: LinearStructure) -> FloatArray:
        """Return the parameters (1 + draws, k) of a structure; those that no aircraft has are zero."""
        told = [true_parameters(structure.meaning, m, self.at.V) for m in self.members]
        return np.array([[t.get(n, 0.0) for n in structure.parameter_names] for t in told])


@dataclass(frozen=True, eq=False)
class Expected:
    """The aircraft that is expected to answer: parameters (k,) of a structure, and how they may differ."""

    structure: LinearStructure  # its equations
    params: FloatArray  # (k,)
    directions: FloatArray  # (d, k) independent ways in which they may differ, by a standard deviation each
    dt_s: float  # of the even clock

    @classmethod
    def of(cls, structure: LinearStructure, values: FloatArray, dt_s: float) -> Expected:
        """Return it from the parameters (1 + draws, k) of the believed aircraft and of those drawn of its uncertainty.

        Few draws know some directions far too well, so that the parameters are taken to be independent.
        """
        spread = (
            np.sqrt(np.mean((values[1:] - values[0]) ** 2, axis=0)) if len(values) > 1 else np.zeros(values.shape[1])
        )
        return cls(structure, values[0], np.diag(spread)[spread > 0.0], dt_s)

    def bank(
        self,
        believed: Believed,
        read: tuple[int, ...],
        noise: FloatArray,
        acting: FloatArray,
        quiet: FloatArray,
        u: FloatArray,
    ) -> Bank:
        """Return the filters that watch a run, see :class:`testbench.inference.multiple_models.Bank`.

        Gusts turn the flow angle, with the intensity that Dryden turbulence has above its corner frequency, roll the
        aircraft by their change over the span (MIL-F-8785C, 3.7.2), and pitch and yaw it as they pass the tail. How
        much each does is taken from the quiet flight before the run, (k, p) readings and (k, m) inputs. The last inputs
        of the bank are what turns the states beside the linear equations.
        """
        names, V, span = self.structure.states, believed.at.V, believed.aircraft.geometry.b_m
        _, L_v, L_w = scale_lengths(max(believed.condition.h_m, LOWEST_M))
        L = L_w if names[0] == "alpha" else L_v
        forced = tuple(i for i, name in enumerate(names) if name not in ATTITUDES)
        each, alone = [], []
        for k, params in enumerate(np.vstack([self.params, self.params + self.directions])):
            s = self.structure.matrices(params)
            inputs = np.hstack([s.B, np.eye(len(names))])
            none = np.zeros((0, len(names))), np.zeros((0, inputs.shape[1]))
            each.append(cont2discrete((s.A, inputs, *none), self.dt_s)[:2])
            if not k:
                white = np.zeros(len(names))
                white[0] = 2.0 / (L * V)
                for i in forced[1:]:
                    size = (_TAIL * s.A[i, i]) ** 2 * white[0]
                    if names[i] == "p":  # sigma_p^2 = 1.9^2 sigma^2 / (L_w b), white below pi V / (4 b)
                        size = s.A[i, i] ** 2 * 1.9**2 / (L_w * span) * 8.0 * span / (math.pi * V)
                    white[i] = size
                alone = [sampled_noise(s.A, row, self.dt_s)[1] for row in np.diag(np.sqrt(white))]
        A, B = np.array([a for a, _ in each]), np.array([b for _, b in each])
        least, readings = 1e-12 * np.eye(len(names)), len(read)
        gusts = np.array(
            [
                least + rms**2 * (alone[0] + sum(f**2 * alone[i] for f, i in zip(by_rate, forced[1:], strict=True)))
                for rms in _TURBULENCE_M_S
                for by_rate in product(_BY_RATE, repeat=len(forced) - 1)
            ]
        )
        noises = noise * np.array([*product(_INTERPOLATED, repeat=readings)])
        turned = u @ B[0][:, : u.shape[1]].T
        for _ in range(2):  # in turn, as both at once are thousands
            these = np.broadcast_to(noise, (len(gusts), readings))
            found = gusts[int(np.argmax(in_quiet_flight(A[0], read, these, gusts, turned, quiet)))]
            there = np.broadcast_to(found, (len(noises), *found.shape))
            noise = noises[int(np.argmax(in_quiet_flight(A[0], read, noises, there, turned, quiet)))]
        rest = np.full(len(names), noise[0])
        rest[list(read)] = np.maximum(quiet.std(axis=0), noise)
        later = np.array([x * found for x in _LATER])
        bends = np.where(np.arange(len(names)) == 0, FORM_STD["alpha"] / ALPHA_RAD, 0.0)
        controls = tuple(range(len(acting)))
        return Bank(A, B, read, noise, rest, later, forced, controls, self.dt_s, acting, bends, V / L)

    def by_speed(self, states: FloatArray, inputs: FloatArray, ratio: FloatArray) -> FloatArray:
        """Return what a speed that is ``ratio`` (b,) times that of the trim changes of the equations (b, n).

        Forces and moments go with dynamic pressure, those by rates with airspeed; a flow angle turns by force over
        airspeed. ``states`` (b, n) and ``inputs`` (b, m) are those measured.
        """
        s, names = self.structure.matrices(self.params), self.structure.states
        power = [_POWER.get(name, 2.0) for name in (*names, *self.structure.inputs)]
        rows = np.array([[p - (i == 0) if n not in ATTITUDES else 0.0 for p in power] for i, n in enumerate(names)])
        rows[:, [i for i, n in enumerate(names) if n in ATTITUDES]] = 0.0  # gravity: :func:`.track.kinematics` has it
        change = ratio[:, None, None] ** rows - 1.0
        out: FloatArray = np.einsum("bij,ij,bj->bi", change, np.hstack([s.A, s.B]), np.hstack([states, inputs]))
        return out

    def given(self, at: NDArray[np.intp], values: FloatArray, covariance: FloatArray) -> Expected:
        """Return what is expected after parameters ``at`` (f,) were found to be values (f,), with their covariance."""
        D = self.directions[:, at]
        weight = np.linalg.solve(covariance + np.diag((LEAST_FORM * values) ** 2), D.T)
        P = np.linalg.inv(np.eye(len(D)) + D @ weight)
        mean = P @ (weight.T @ (values - self.params[at]))
        return self.learnt(np.asarray(mean, dtype=np.float64), np.asarray(P, dtype=np.float64))

    def learnt(self, mean: FloatArray, covariance: FloatArray) -> Expected:
        """Return what is expected after a run said of multiples z of the directions that z ~ N(mean, covariance).

        No parameter is known better than a linear aircraft holds it.
        """
        here = self.params + mean @ self.directions
        both = self.directions.T @ covariance @ self.directions + np.diag((LEAST_FORM * here) ** 2)
        sizes, axes = np.linalg.eigh(both)
        away = (axes * np.sqrt(np.maximum(sizes, 0.0))).T
        return replace(self, params=here, directions=away[sizes > 0.0])
