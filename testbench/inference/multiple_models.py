"""Does the aircraft still answer as believed? Explanations of a manoeuvre weighed in a bank of filters as it is flown.

The believed aircraft, linear about its trim, and M - 1 others a standard deviation away fly in Kalman filters, one for
each intensity of turbulence that there may be (multiple-model adaptive estimation: D. T. Magill, IEEE Transactions on
Automatic Control 10(4), 1965). What a filter of the right aircraft in the right air leaves is white:

    x[k+1] = A x[k] + B u[k] + w[k],    y[k] = C x[k] + e[k],
    v[k] = y[k] - C x[k|k-1] = v0[k] + N[k] z + E[k] c + white noise

N z is what the uncertainty of the aircraft does, z ~ N(0, 1), one column for each direction of it. E holds what no
model has exactly, with priors: the trim, the first state, the form of the equations over time, a delay shorter than
anybody asks for, gusts that die away while the aircraft's own motion does not. Its first columns are explanations, each
added by itself: controls that have another effect. Controls that act late, and instruments of the wrong sign, have
filters of their own. Coefficients are integrated; intensity of turbulence and scale of the noise are summed over. N is
zero in the quiet flight before a manoeuvre: there gusts and the colour of noise alone would tell which aircraft flies,
and neither is known so closely. Air and trim are told there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, ndtr

from testbench.core.record import FloatArray

P_FAULT = 0.05  # prior probability that a manoeuvre is not answered as believed; the kinds of explanation share it
DELAYS_S = (0.15, 0.25, 0.4, 0.6)
"""By which a control may be late. A shorter delay is no fault: it is one of what no model has exactly."""
_LATE_S = 0.05  # standard deviation of such a delay
REVERSED = -1.0
"""What an instrument of the wrong sign reads of what there is. Other scales would be told by gusts alone as well, whose
share in each reading is not known so closely; they are another aircraft here."""
LEAST = 0.3  # share by which a control must differ before anybody would call it a fault
AT_REST = 3.5
"""Deviations of the noise of a control that has not moved."""
_OTHER = 5.0  # standard deviations of what is believed, those of an aircraft that is not the believed one
_FORM = 0.1  # share of what turns a state by which its equation is off, changing
_FORM_S = 2.0  # over this time
_DOUBLINGS = 50  # of a time step
_SCALES = np.sqrt([0.5, 1.0, 2.0, 4.0, 8.0])
"""What the noise may be, of what it is in quiet flight: what a linear aircraft lacks stands beside it."""


@dataclass(frozen=True, eq=False)
class Bank:
    """What is believed, in steps of the clock."""

    A: FloatArray  # (M, n, n), B: (M, n, m); the believed aircraft first, then those a standard deviation away from it
    B: FloatArray
    read: tuple[int, ...]  # (p,) states that are measured
    noise: FloatArray  # (p,) standard deviation of each reading
    rest: FloatArray  # (n,) size of what the trim of each state is not known by
    gusts: FloatArray  # (I, n, n) covariance of the process noise of a step, one for each intensity of turbulence
    forced: tuple[int, ...]  # states whose equations hold forces or moments
    controls: tuple[int, ...]  # columns of the inputs that are controls
    dt_s: float  # of a step
    acting: FloatArray  # (c,) standard deviation of the white noise of each control as it is recorded
    # (n,) share by which the form of the equations is off for each unit of a state, beside that near trim
    bends: FloatArray
    decay: float = 0.0  # 1/s, by which gusts in the first state, a flow angle, die away: V / L

    @cached_property
    def variants(self) -> tuple[tuple[str, int, float], ...]:
        """What has a filter of its own, (kind, at, value): what is believed, late controls, reversed readings."""
        late = [("late", c, s) for c in self.controls for s in DELAYS_S]
        reads = [("reads", k, REVERSED) for k, state in enumerate(self.read) if state in self.forced]
        return ("believed", -1, 0.0), *late, *reads

    @cached_property
    def scales(self) -> FloatArray:
        """What each variant reads of each state, (J, p)."""
        out = np.ones((len(self.variants), len(self.read)))
        for j, (kind, at, value) in enumerate(self.variants):
            if kind == "reads":
                out[j, at] = value
        return out


def in_quiet_flight(
    A: FloatArray, read: Sequence[int], noise: FloatArray, gusts: FloatArray, turned: FloatArray, y: FloatArray
) -> FloatArray:
    """Return ln p (I,) of quiet flight for covariances of process noise (I, n, n) and noise of the readings (I, p).

    Args:
        A: (n, n) of a step.
        read: (p,) states that are measured.
        noise: standard deviation of each reading.
        gusts: the covariances.
        turned: (k, n) change of the states in each step by the controls.
        y: (k, p) readings, deviations from trim.
    """
    n, R, at = len(A), noise[:, :, None] ** 2 * np.eye(len(read)), list(read)
    C = np.eye(n)[at]
    P = _steady(A, C, gusts, R)
    S = P[:, at][:, :, at] + R
    precision = np.linalg.inv(S)
    K = P[:, :, at] @ precision
    x, logs = np.zeros((len(gusts), n)), -0.5 * len(y) * np.log(np.linalg.det(S))
    x[:, at] = y[0]
    for reading, change in zip(y, turned, strict=True):
        x = x @ A.T + change
        v = reading - x[:, at]
        x = x + np.einsum("inp,ip->in", K, v)
        logs = logs - 0.5 * np.einsum("ip,ipq,iq->i", v, precision, v)
    return logs


def _steady(A: FloatArray, C: FloatArray, Q: FloatArray, R: FloatArray) -> FloatArray:
    """Return the covariances (I, n, n) of prediction errors of steady Kalman filters, P = A P A' - A P C' K' + Q.

    By doubling, all at once (E. K.-W. Chu et al., International Journal of Control 77(8), 2004): step k is that of 2^k
    samples. Scipy takes some hundred times as long for as many small ones, and is less exact.
    """
    F, P, one = np.broadcast_to(A.T, Q.shape), Q, np.eye(len(A))
    G = C.T @ np.linalg.inv(R) @ C
    for _ in range(_DOUBLINGS):
        W = np.linalg.inv(one + G @ P)
        back = F.transpose(0, 2, 1)
        more, G, F = back @ P @ W @ F, G + F @ W @ G @ back, F @ W @ F
        P, G = P + 0.5 * (more + more.transpose(0, 2, 1)), 0.5 * (G + G.transpose(0, 2, 1))
        if np.all(np.abs(more) <= 1e-15 * np.abs(P).max(axis=(1, 2), keepdims=True)):
            break
    return np.asarray(P)


@dataclass(frozen=True)
class Weighed:
    """An explanation of a manoeuvre."""

    kind: str  # "believed", "gain", "late", "reads" or "other" (an aircraft beyond the uncertainty of the believed one)
    at: int  # place of the control among the inputs, or of the state that is read; -1 if it is of none
    value: float  # of what is expected, or s of delay; ``std`` its standard deviation
    std: float
    probability: float  # of it


class Watched:
    """A manoeuvre while it is flown.

    Args:
        bank: what is believed.
        quiet: samples before the controls move.
    """

    def __init__(self, bank: Bank, quiet: int = 0) -> None:
        self.bank, self._quiet = bank, quiet
        (M, n, m), forced, read = bank.B.shape, list(bank.forced), list(bank.read)
        I, J, D = len(bank.gusts), len(bank.variants), M - 1  # noqa: E741
        c, p = len(bank.controls), len(read)
        self._x = np.zeros((M, n, I, J))
        drift = np.abs(np.eye(n) - bank.A[0]) @ bank.rest
        # Columns: the drawn aircraft; the controls' effect; first state, trim in equations and readings, short delays,
        # decay of gusts, form over time; what is left.
        own = [np.ones(c), bank.rest, drift[forced], bank.rest[read], np.full(c, _LATE_S), np.ones(1)]
        self._std = np.concatenate([np.ones(D), *own])
        self._own = np.zeros((I, n, len(self._std) - D))
        self._own[:, :, c : c + n] = np.eye(n)
        self._constant = np.zeros((n, self._own.shape[2])), np.zeros((p, self._own.shape[2]))
        self._constant[0][forced, c + n + np.arange(len(forced))] = 1.0
        self._constant[1][np.arange(p), c + n + len(forced) + np.arange(p)] = 1.0
        self._sums = np.zeros((I, J, len(self._std) + 1, len(self._std) + 1))
        self._read_by, self._of = np.unique(bank.scales, axis=0, return_inverse=True)
        self._P = np.repeat(np.repeat(np.diag(bank.rest**2)[None, None], I, axis=0), len(self._read_by), axis=1)
        self._log_det = np.zeros((I, J))
        self._u: FloatArray = np.zeros((0, m))
        self._knots, self._taken = 0, 0

    def take(self, u: FloatArray, y: FloatArray, valid: NDArray[np.bool_]) -> None:
        """Take inputs (k, m), readings (k, p) and which of them count, deviations from trim.

        A control within its noise is at rest: the noise that was recorded has moved nothing.
        """
        first, acting = len(self._u), np.zeros(u.shape[1])
        acting[list(self.bank.controls)] = self.bank.acting
        u = np.where(np.abs(u) > AT_REST * acting, u, 0.0)
        self._u = np.vstack([self._u, u])
        if not first:
            self._x[:, list(self.bank.read)] = np.where(valid[0], y[0], 0.0)[None, :, None, None]
        knots = int(len(self._u) * self.bank.dt_s / _FORM_S) + 2
        more = (knots - self._knots) * 2 * len(self.bank.forced)
        if more > 0:
            self._knots, ends = knots, (0, more)
            self._std = np.append(self._std, np.full(more, _FORM))
            self._own = np.pad(self._own, ((0, 0), (0, 0), ends))
            self._constant = np.pad(self._constant[0], ((0, 0), ends)), np.pad(self._constant[1], ((0, 0), ends))
            last = self._sums.shape[2] - 1  # new columns go before what is left
            order = [*range(last), *range(last + 1, last + 1 + more), last]
            self._sums = np.pad(self._sums, ((0, 0), (0, 0), ends, ends))[:, :, order][:, :, :, order]
        begin = max(first, 1)
        if len(self._u) > begin:
            self._add(*self._flown(begin, y[begin - first :], valid[begin - first :]))
            self._taken += int(valid[begin - first :].sum())

    def _gain(self, jumped: FloatArray, valid: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
        """Return the gains K (I, J, n, p) of the next readings, and roots (I, J, p, p) that make what is left white.

        Where a control jumps between two samples nobody knows when: its mean over the step is off by up to a half.
        """
        bank, at = self.bank, list(self.bank.read)
        B = bank.B[0][:, list(bank.controls)]
        P = bank.A[0] @ self._P @ bank.A[0].T + bank.gusts[:, None] + (B * (jumped**2 / 12.0 + bank.acting**2)) @ B.T
        C = np.where(valid, self._read_by, 0.0)[:, :, None] * np.eye(len(P[0, 0]))[at]
        PC = P @ C.transpose(0, 2, 1)
        S = C @ PC + np.diag(np.where(valid, bank.noise**2, 1.0))
        root = np.linalg.inv(np.linalg.cholesky(S))
        K = PC @ root.transpose(0, 1, 3, 2) @ root
        P = P - K @ PC.transpose(0, 1, 3, 2)
        self._P = 0.5 * (P + P.transpose(0, 1, 3, 2))
        self._log_det += np.sum(np.log(np.diagonal(root, axis1=2, axis2=3)), axis=2)[:, self._of]
        return K[:, self._of], root[:, self._of]

    def _flown(self, begin: int, y: FloatArray, valid: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
        """Return what is left, white, (k, M, p, I, J), and what the own columns do to it (k, I, J, p, e)."""
        bank = self.bank
        read, forced, controls = list(bank.read), list(bank.forced), list(bank.controls)
        k, (M, n, I, J), e = len(y), self._x.shape, self._own.shape[2]  # noqa: E741
        times, here, each = np.arange(len(self._u)) * bank.dt_s, self._u[begin - 1 :], []
        for kind, at, value in bank.variants:
            late = here.copy()
            if kind == "late":
                late[:, at] = np.interp(times[begin - 1 :] - value, times, self._u[:, at])
            each.append(0.5 * (late[1:] + late[:-1]))
        forcing = np.einsum("mab,jkb->kmaj", bank.B, np.array(each))
        change = np.diff(here, axis=0) / bank.dt_s
        at_form, c = e - self._knots * 2 * len(forced), len(controls)
        at_short = c + n + len(forced) + len(read)
        scales = bank.scales.T[None, :, None, :]
        left, own = np.zeros((k, M, len(read), I, J)), np.zeros((k, I, J, len(read), e))
        ends = np.diff(self._u[max(begin - 2, 0) :, controls], axis=0)
        jumps = np.abs(np.diff(ends, axis=0, prepend=ends[:1] if begin == 1 else np.zeros((0, c))))
        for i in range(k):
            before = self._x[0, :, :, 0]
            x = (bank.A @ self._x.reshape(M, n, I * J)).reshape(M, n, I, J) + forcing[i][:, :, None, :]
            if begin + i < self._quiet:
                x[:] = x[0]
            v = np.where(valid[i][None, :, None, None], y[i][None, :, None, None] - scales * x[:, read], 0.0)
            K, root = self._gain(jumps[i], valid[i])
            left[i] = np.einsum("ijqp,mpij->mqij", root, v)
            F = np.repeat(self._constant[0][None], I, axis=0)
            F[:, :, :c] = bank.B[0][:, controls] * each[0][i, controls]
            F[:, :, at_short : at_short + c] = -bank.B[0][:, controls] * change[i, controls]
            F[:, 0, at_form - 1] = -bank.decay * bank.dt_s * before[0]
            hats = np.maximum(0.0, 1.0 - np.abs((begin + i) * bank.dt_s / _FORM_S - np.arange(self._knots)))
            away = np.hypot(1.0, bank.bends @ np.abs(before) / _FORM)  # (I,)
            acted = bank.B[0][:, controls] @ each[0][i, controls]
            # What turns a state may be the small difference of what its motion and the controls do: either may be off.
            for a, parts in enumerate(((bank.A[0] - np.eye(n)) @ before * away, acted[:, None] * away)):
                for k_state, state in enumerate(forced):
                    F[:, state, at_form + 2 * k_state + a :: 2 * len(forced)] = parts[state][:, None] * hats
            z = bank.A[0] @ self._own + F
            w = np.where(valid[i][None, :, None], self._constant[1] - z[:, read], 0.0)
            own[i] = np.einsum("ijqp,jp,ipe->ijqe", root, bank.scales, w)
            self._own = z + K[:, 0] @ w
            self._x = x + np.einsum("ijnp,mpij->mnij", K, v)
        return left, own

    def _add(self, left: FloatArray, own: FloatArray) -> None:
        """Add the sums of squares and products of all columns and of what is left, white."""
        columns = np.concatenate(
            [
                np.einsum("kmqij->ijmkq", left[:, 1:] - left[:, :1]),
                np.einsum("kijqe->ijekq", own),
                np.einsum("kmqij->ijmkq", left[:, :1]),
            ],
            axis=2,
        )
        rows = columns.reshape(*columns.shape[:3], -1)
        self._sums = self._sums + rows @ rows.transpose(0, 1, 3, 2)

    def _solved(
        self, scale: float, variants: slice, control: int | None = None, drawn: float = 1.0
    ) -> tuple[FloatArray, FloatArray]:
        """Return ln p (I, J), coefficients integrated, and the Cholesky factor it is told from.

        The effect of ``control`` is added as the last column before what is left; ``drawn`` are standard deviations of
        what is believed.
        """
        D, c, last = self._x.shape[0] - 1, len(self.bank.controls), len(self._std)
        order = [*range(D), *range(D + c, last), *([] if control is None else [D + control]), last]
        s = np.append(self._std, 1.0)[order] / scale
        s[:D] *= drawn
        G = self._sums[:, variants][:, :, order][:, :, :, order]
        L = np.asarray(np.linalg.cholesky(np.eye(len(s)) + s[:, None] * G * s), dtype=np.float64)
        diagonal = np.diagonal(L, axis1=2, axis2=3)
        logs: FloatArray = -0.5 * (diagonal[..., -1] ** 2 - 1.0) - np.sum(np.log(diagonal[..., :-1]), axis=2)
        return logs + self._log_det[:, variants] - self._taken * math.log(scale), L

    def weigh(self) -> tuple[Weighed, ...]:
        """Return what is believed, then the explanations of something else, with their probabilities."""
        bank, c = self.bank, len(self.bank.controls)
        ln, of, kinds = self._logs()
        share = {kind: P_FAULT / 4.0 / kinds.count(kind) for kind in kinds} | {"believed": 1.0 - P_FAULT}
        ln = ln + np.log([share[kind] for kind in kinds])
        chance = np.exp(ln - logsumexp(ln))
        out = [Weighed("believed", -1, 1.0, 0.0, float(chance[0]))]
        for a, control in enumerate(bank.controls):
            k = int(np.argmax(of[a, 0]))
            out.append(Weighed("gain", control, 1.0 + float(of[a, 1, k]), float(of[a, 2, k]), float(chance[1 + a])))
        out.append(Weighed("other", -1, 0.0, 0.0, float(chance[1 + c])))
        each = list(zip(bank.variants[1:], chance[2 + c :].tolist(), strict=True))
        for kind, at in dict.fromkeys((kind, at) for (kind, at, _), _ in each):
            values, p = np.array([(v, q) for (k, a, v), q in each if (k, a) == (kind, at)]).T
            mean, late = float(values @ p) / max(float(p.sum()), 1e-300), kind == "late"
            out.append(Weighed(kind, at if late else bank.read[at], mean, late * _LATE_S, float(p.sum())))
        return tuple(out)

    def _logs(self) -> tuple[FloatArray, FloatArray, list[str]]:
        """Return ln p (h,) of each; ln p, change and error (controls, 3, scales x gusts) of their effects; kinds."""
        c = len(self.bank.controls)
        variants, other, gains = [], [], []
        for scale in _SCALES:
            variants.append(self._solved(scale, slice(None))[0])
            other.append(self._solved(scale, slice(1), drawn=_OTHER)[0][:, 0])
            gains.append([_beyond(*self._solved(scale, slice(1), control=a)) for a in range(c)])
        by_variant = logsumexp(np.array(variants), axis=(0, 1))
        of = np.array(gains).transpose(1, 2, 0, 3).reshape(c, 3, -1)  # (controls, ln p, value, std; scales x gusts)
        ln = [by_variant[0], *logsumexp(of[:, 0], axis=1), logsumexp(np.array(other)), *by_variant[1:]]
        kinds = ["believed", *["gain"] * c, "other", *[v[0] for v in self.bank.variants[1:]]]
        return np.array(ln), of, kinds

    def learnt(self) -> tuple[FloatArray, FloatArray]:
        """Return mean (D,) and covariance (D, D) of z of the believed aircraft, in the most probable air and noise."""
        each = [self._solved(scale, slice(1)) for scale in _SCALES]
        logs, L = max(each, key=lambda one: float(one[0].max()))
        factor, D = L[int(np.argmax(logs[:, 0])), 0], self._x.shape[0] - 1
        back = np.linalg.inv(factor[:-1, :-1])
        mean: FloatArray = -(back.T @ factor[-1, :-1])[:D]
        covariance: FloatArray = (back.T @ back)[:D, :D]
        return mean, covariance


def _beyond(logs: FloatArray, L: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return ln p (I,) of an effect that differs by more than LEAST, and its change from 1 and error."""
    std = 1.0 / L[:, 0, -2, -2]
    value = -L[:, 0, -1, -2] * std
    beyond = ndtr((-LEAST - value) / std) + ndtr((value - LEAST) / std)
    return logs[:, 0] + np.log(np.maximum(beyond, 1e-300) / (2.0 * ndtr(-LEAST))), value, std
