"""What each instrument of a record should have read, by rigid-body kinematics from the others, whatever flies.

Every relation integrates rates or specific forces as they were measured, with the measured attitude and flow angles as
coefficients, and is compared with one channel. Over a flat earth, in air that moves steadily (u, v, w relative to the
air; ax, ay, az specific forces at the centre of gravity; R. V. Jategaonkar, Flight Vehicle System Identification, 2nd
ed., 2015, chapter 10; V. Klein and E. A. Morelli, Aircraft System Identification, 2006, chapter 10),

    udot = ax - g sin theta            + r v - q w        phidot   = p + tan theta (q sin phi + r cos phi)
    vdot = ay + g cos theta sin phi    + p w - r u        thetadot = q cos phi - r sin phi
    wdot = az + g cos theta cos phi    + q u - p v        psidot   = (q sin phi + r cos phi) / cos theta
    hdot = u sin theta - v cos theta sin phi - w cos theta cos phi - wind_down

so that

    theta, phi, psi   from the gyros
    alpha, beta       from az or ay, the gyros, airspeed and attitude
    V                 from ax, the gyros, attitude and flow angles
    h                 from airspeed, attitude and angle of attack; without a vane from az
    Vg                from airspeed, attitude, flow angles and a steady wind, where it is asked for

One relation does not lean on what another predicts, so that noise adds up once. An instrument of the integral is put
right, and that with which it is compared is read with its error: no noise is taken for motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from testbench.core.constants import G0_M_S2
from testbench.core.record import FlightRecord, FloatArray
from testbench.sensors.sensor import first_order_lag

RATES, FORCES, ANGLES, FLOW = ("p", "q", "r"), ("ax", "ay", "az"), ("phi", "theta", "psi"), ("alpha", "beta")
BESIDE = (("p", "r"), ("q", "p"), ("r", "p"), ("ax", "az"), ("ay", "az"), ("az", "ax"))
"""Instruments, and those whose axis they read a part of if they are turned."""
COMPARED = ("theta", "phi", "psi", "alpha", "beta", "V", "h", "Vg")
_NEEDED: Mapping[str, tuple[str, ...]] = {
    "theta": ("q",),
    "phi": ("p",),
    "psi": ("q", "r", "phi", "theta"),
    "alpha": ("q", "az", "V", "theta"),
    "beta": ("r", "ay", "V", "phi"),
    "V": ("ax", "az", "theta", "alpha"),
    "h": ("V", "theta"),
    "Vg": ("V", "theta", "psi"),
}
_IF_IT_TURNS: Mapping[str, tuple[str, ...]] = {
    "theta": ("phi", "r"),
    "phi": ("q", "r", "theta"),
    "alpha": ("phi", "p", "beta"),
    "beta": ("p", "alpha"),
    "V": ("phi", "ay", "beta"),
    "h": ("phi", "beta"),
    "Vg": ("phi", "alpha", "beta"),
}
"""Channels without which a relation holds only if the aircraft does not roll or yaw."""
_LATERAL = ("p", "r", "phi", "beta")
_TURNS_RAD = 0.05  # rms of a lateral channel from which the aircraft is not in symmetric flight
_FEWEST = 100  # samples
_FINEST_S = 0.02  # records that are sampled more finely are thinned: motion of a rigid body is slower
_HELD = 0.6  # share of samples equal to the one before, from which a channel is held and its timing not its own
_JUMP_RAD = 0.5  # between samples: an angle that was averaged across the end of its circle
_SMOOTH_S = 0.15  # of the airspeed as a coefficient: its noise is no motion, and it changes slowly
_SLOWEST_M_S = 3.0  # below it the airspeed is a deviation from trim, or none


@dataclass(frozen=True, eq=False)
class Kinematics:
    """One record as far as kinematics bind it."""

    x: Mapping[str, FloatArray]  # channel -> samples (n,), SI
    dt_s: float  # sample time
    compared: tuple[str, ...]  # channels (p,) with a relation
    gravity_m_s2: float = G0_M_S2  # at the place of the flight

    @classmethod
    def of(cls, record: FlightRecord, gravity_m_s2: float = G0_M_S2, ground: bool = False) -> Kinematics:
        """Return what binds the channels of a measured record; nothing is compared where too few are there.

        ``ground`` compares the speed over ground, too.
        """
        step = max(1, round(_FINEST_S / record.dt_s))
        n = len(record) // step * step
        x: dict[str, FloatArray] = {}
        for name in (*RATES, *FORCES, *ANGLES, *FLOW, "V", "h", *(("Vg",) if ground else ())):
            if name not in record:
                continue
            y, valid = record[name], record.valid[:, record.channels.index(name)] & np.isfinite(record[name])
            if np.mean(valid) < 0.8 or np.mean(np.diff(y[valid]) == 0.0) > _HELD:
                continue
            taken = np.unwrap(y[valid]) if name == "psi" else y[valid]
            if name in ANGLES and np.max(np.abs(np.diff(taken))) > _JUMP_RAD:
                continue
            y = np.interp(record.t_s, record.t_s[valid], taken)
            x[name] = y[:n].reshape(-1, step).mean(axis=1)
        if "V" in x and np.min(x["V"]) < _SLOWEST_M_S:
            del x["V"]
        turns = any(np.std(x[c]) > _TURNS_RAD for c in _LATERAL if c in x)
        compared = tuple(
            c
            for c in COMPARED
            if c in x
            and n // step >= _FEWEST
            and all(m in x for m in _NEEDED[c])
            and not (turns and any(m not in x for m in _IF_IT_TURNS.get(c, ())))
            and (c != "h" or "alpha" in x or {"az", "q"} <= set(x))
        )
        return cls(x, record.dt_s * step, compared, gravity_m_s2)

    @property
    def instruments(self) -> tuple[str, ...]:
        """The channels that the relations use."""
        used = set(self.compared)
        for c in self.compared:
            used |= {m for m in (*_NEEDED[c], *_IF_IT_TURNS.get(c, ())) if m in self.x}
            used |= {"az", "q"} if c == "h" and "alpha" not in self.x else set()
        return tuple(c for c in (*RATES, *FORCES, *ANGLES, *FLOW, "V", "h", "Vg") if c in used)

    def readings(self, errors: Mapping[str, float]) -> FloatArray:
        """Return what the channels compared would have read (n, p), SI, each from its first sample on.

        Args:
            errors: CHANNEL_KIND -> value, of ``bias``, ``scale`` (0 for none), ``late`` (s, of the clock), ``lag`` (s,
                first order), ``place`` (m ahead of the centre of gravity) and ``turned`` (rad, into the axis beside
                it); ``wind_bias`` (m/s, down), ``north_bias`` and ``east_bias`` (m/s, where the air moves to).
        """
        m = {c: self._right(c, errors) for c in self.x}
        zero = np.zeros(len(next(iter(self.x.values()))))
        got = {c: m.get(c, zero) for c in (*RATES, *FORCES, *ANGLES, *FLOW)}
        for to, source in BESIDE:
            if errors.get(f"{to}_turned") and source in m:
                got[to] = got[to] - errors[f"{to}_turned"] * m[source]
        p, q, r, ax, ay, az = (got[c] for c in (*RATES, *FORCES))
        phi, theta, alpha, beta = (got[c] for c in ("phi", "theta", "alpha", "beta"))
        V = self._smooth(m["V"]) if "V" in m else zero
        u, v, w = V * np.cos(alpha) * np.cos(beta), V * np.sin(beta), V * np.sin(alpha) * np.cos(beta)
        g, out = self.gravity_m_s2, []
        if {"az", "V"} & set(self.x) == {"az", "V"}:
            sink = self._integral(az + g * np.cos(theta) * np.cos(phi) + q * u - p * v)
            sink = sink + errors.get("az_place", 0.0) * (q - q[0])
        for c in self.compared:
            if c == "theta":
                y = self._integral(q * np.cos(phi) - r * np.sin(phi))
            elif c == "phi":
                y = self._integral(p + np.tan(theta) * (q * np.sin(phi) + r * np.cos(phi)))
            elif c == "psi":
                y = self._integral((q * np.sin(phi) + r * np.cos(phi)) / np.cos(theta))
            elif c == "alpha":
                y = alpha + (w[0] + sink) / u - np.tan(alpha)  # of what was measured and its sine: linear in sinking
            elif c == "beta":
                slip = self._integral(ay + g * np.cos(theta) * np.sin(phi) + p * w - r * u)
                slip = slip - errors.get("ay_place", 0.0) * (r - r[0])
                y = beta + (v[0] + slip) / (V * np.cos(beta)) - np.tan(beta)
            elif c == "V":  # by the work of all forces, in which turning has no part
                ahead, below = ax - g * np.sin(theta), az + g * np.cos(theta) * np.cos(phi)
                along = ahead * np.cos(alpha) + below * np.sin(alpha)
                y = self._integral(along * np.cos(beta) + (ay + g * np.cos(theta) * np.sin(phi)) * np.sin(beta))
            elif c == "Vg":
                ahead = u * np.cos(theta) + np.sin(theta) * (v * np.sin(phi) + w * np.cos(phi))
                right, psi = v * np.cos(phi) - w * np.sin(phi), got["psi"]
                north = ahead * np.cos(psi) - right * np.sin(psi) + errors.get("north_bias", 0.0)
                y = np.hypot(north, ahead * np.sin(psi) + right * np.cos(psi) + errors.get("east_bias", 0.0))
            else:
                down = w if "alpha" in m else sink
                climb = u * np.sin(theta) - np.cos(theta) * (v * np.sin(phi) + down * np.cos(phi))
                y = self._integral(climb - errors.get("wind_bias", 0.0))
            scale, late, lag = (errors.get(f"{c}_{kind}", 0.0) for kind in ("scale", "late", "lag"))
            y = (1.0 + scale) * _shifted(y, self.dt_s, late)  # as its instrument reads it
            out.append(first_order_lag(y, self.dt_s, lag) if lag else y)
        return np.stack(out, axis=1)

    def moved_by(self, errors: Mapping[str, float], c: str, size: float) -> FloatArray:
        """Return by how much noise of an instrument in one sample moves what is left of each channel (n, p), SI.

        From that sample on, as the sum of all samples is what a bias does; a speed over ground, which nothing
        integrates, in that sample alone. The noise of what is read is not in it, but where a channel is foretold.
        """
        bias, V = f"{c}_bias", self._divisors(errors)
        moved = self.readings(errors) - self.readings({**errors, bias: errors.get(bias, 0.0) - size})
        return np.where(self._at_once, moved, np.diff(V * moved, axis=0, prepend=0.0) / V)

    def scored(self, errors: Mapping[str, float], weights: FloatArray, moved: FloatArray) -> FloatArray:
        """Return what weights (n, p, k) of the channels make of noise in each sample (n, k), see :meth:`moved_by`."""
        V = self._divisors(errors)[:, :, None]
        later = V * np.cumsum((weights / V)[::-1], axis=0)[::-1]
        return np.asarray(np.einsum("npk,np->nk", np.where(self._at_once[:, None], weights, later), moved))

    @property
    def _at_once(self) -> NDArray[np.bool_]:
        return np.array([c == "Vg" for c in self.compared])

    def _divisors(self, errors: Mapping[str, float]) -> FloatArray:
        """Return by what the integral of each channel is divided (n, p): of a flow angle by the airspeed along it."""
        right = {c: self._right(c, errors) for c in (*FLOW, "V") if c in self.x}
        one = np.ones(len(next(iter(self.x.values()))))
        across = (self._smooth(right["V"]) if "V" in right else one) * np.cos(right.get("beta", 0.0))
        of = {"alpha": across * np.cos(right.get("alpha", 0.0)), "beta": across}
        return np.stack([of.get(c, one) for c in self.compared], axis=1)

    def _smooth(self, y: FloatArray) -> FloatArray:
        """Return the smoothed samples, and what is smooth of what that took away: peaks keep their height."""
        first = gaussian_filter1d(y, _SMOOTH_S / self.dt_s, mode="nearest")
        return np.asarray(first + gaussian_filter1d(y - first, _SMOOTH_S / self.dt_s, mode="nearest"))

    def _integral(self, f: FloatArray) -> FloatArray:
        return np.asarray(cumulative_trapezoid(f, dx=self.dt_s, initial=0.0))

    def _right(self, c: str, errors: Mapping[str, float]) -> FloatArray:
        """Return the samples of an instrument without its errors."""
        y = self.x[c]
        bias, scale, late, lag = (errors.get(f"{c}_{kind}", 0.0) for kind in ("bias", "scale", "late", "lag"))
        if lag:
            y = y + lag * np.gradient(y, self.dt_s)
        return (_shifted(y, self.dt_s, -late) - bias) / (1.0 + scale)


def _shifted(y: FloatArray, dt_s: float, late_s: float) -> FloatArray:
    """Return y(t - late_s), held beyond its ends."""
    if late_s == 0.0:
        return y
    t = np.arange(len(y)) * dt_s
    return np.asarray(CubicSpline(t, y)(np.clip(t - late_s, 0.0, t[-1])))
