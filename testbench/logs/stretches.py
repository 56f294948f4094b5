"""What kind of flight each stretch of a log is: parked, a check of controls on the ground, taxi, cruise, manoeuvre, ...

It is said before anything is cut out, of all that was logged: the autopilot's own word (landed, hovering), airspeed,
ground speed, height, attitude, and whether the aircraft answers its controls. Only what flies is identified from.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby, pairwise

import numpy as np
from numpy.typing import NDArray

from testbench.core.constants import DEG_RAD
from testbench.core.record import FlightRecord, FloatArray
from testbench.logs.manoeuvres import Manoeuvre
from testbench.logs.noise import Noise, moves
from testbench.logs.question import LIMITS, shown
from testbench.logs.signals import Log

SLOWEST_M_S = 3.0
"""Airspeed below which nothing is carried by its wing; judged: the lightest models of the field stall at 4 to 5 m/s."""
FLOWN = ("cruise", "climb", "descent", "turn", "manoeuvre", "flight")
"""Kinds of flight that a fixed wing is identified from."""
STALL = "stall"
"""Flight in which lift is lost as the angle of attack grows: derivatives at a trim do not hold in it."""
KINDS = (
    "parked", "control check", "taxi", "take-off roll", *FLOWN, STALL, "hover", "transition", "landing roll", "slow",
    "crash", "not logged",
)  # fmt: skip
"""Slow is what answers its controls below any speed of flight: in a hover, or the speed is wrong."""
_GROUND = ("parked", "control check", "taxi", "take-off roll", "landing roll", "slow")
_BLOCK_S = 0.5
_SHORTEST_S = 2.0  # of a kind: a shorter one is part of the one before, but for manoeuvres and rolls
_ROLLS_M_S = 1.0  # over ground: below it a receiver's noise is not told from rest
_SHARE = 0.4  # of the speed at which a log flies most: half the stall speed of most aircraft, twice that of a taxi
_ALOFT_M = 4.0  # above the place where it stood: beyond what a barometer drifts in minutes
_HOVER_M_S = 2.0
_LIFTED_M = 1.0  # of a rotorcraft above the lowest twentieth of its heights
_STILL_S = 2.5  # before and after: over which it does not move over ground
_STEADY_S = 1.5  # before and after: a gust on the pitot tube is no take-off
_TURN_RAD = 15.0 * DEG_RAD  # of bank, held
_CLIMB = 0.05  # of the speed: a path of 3 deg
_CLIMB_M_S = 0.5
_ANSWER = {"de": ("q", "alpha", "theta"), "da": ("p", "phi"), "dr": ("r", "beta", "p", "ay"), "thr": ("V", "u", "ax")}
"""Control -> the channels in which the motion shows that it causes."""
_STILL = ("p", "q", "r", "phi", "theta", "V", "h", "az")
"""Channels that rest where an aircraft rests."""
_BRIEF_S = 0.1  # within which the angle of attack hardly changes as a wing stalls
_FEWEST_BLOCKS, _FEWEST_BEYOND = 50, 5  # of flight, from which a line is told, and beyond it
_BACKWARDS_RAD = 60.0 * DEG_RAD  # of flow: in a tumble or a spin a wing has no line of lift
_LOST = 0.1  # of the lift that the line has
_ATTACHED_RAD = 8.0 * DEG_RAD  # above the angle of no lift: the flow about the thinnest plates stays attached so far
_OFF = 4.0  # standard deviations
_AFTER_S = 1.0  # the answer goes on after the control has come to rest


@dataclass(frozen=True)
class Stretch:
    """A stretch of one kind and one mode.

    Args:
        start_s: its start, in the time of the record.
        end_s: its end.
        kind: one of :data:`KINDS`.
        mode: the mode of the autopilot as it names it, with who flies behind it: "FBWA (stabilised)"; "" if none is
            logged.
        why: what told that it is not flight, "" where it is.
    """

    start_s: float
    end_s: float
    kind: str
    mode: str = ""
    why: str = ""

    @property
    def flown(self) -> bool:
        """Whether a wing carries it."""
        return self.kind in FLOWN


def stretches_of(
    record: FlightRecord, log: Log, found: Sequence[Manoeuvre], noise: Mapping[str, Noise]
) -> tuple[Stretch, ...]:
    """Return the stretches of a record, one after the other without a gap.

    Args:
        record: on one clock.
        log: it is made of: vehicle, modes and flags.
        found: stretches in which controls move.
        noise: of each channel.
    """
    return _Labels(record, log, found, noise).stretches()


def unanswered(record: FlightRecord, control: str, m: Manoeuvre, noise: Mapping[str, Noise]) -> str:
    """Say that no channel moves beyond its noise while a control does, "" if one does or none was logged.

    Args:
        record: on one clock.
        control: that moves.
        m: where.
        noise: of each channel.
    """
    names = [n for n in _ANSWER[control.removesuffix("_cmd")] if n in record and n in noise]
    part = (record.t_s >= m.start_s) & (record.t_s <= m.end_s + _AFTER_S)
    seen = [n for n in names if np.count_nonzero(part & _taken(record, n)) > 3]
    if not seen or any(moves(record[n][part & _taken(record, n)], _rate(record, n), noise[n]) for n in seen):
        return ""
    name = seen[0]
    size = shown(name, noise[name].size)
    return f"the aircraft does not respond to {control}: {name} moves no more than its noise ({size})"


def _taken(record: FlightRecord, name: str) -> NDArray[np.bool_]:
    return record.valid[:, record.channels.index(name)]


def _rate(record: FlightRecord, name: str) -> float:
    at = np.flatnonzero(_taken(record, name))
    return 1.0 / (record.dt_s * float(np.median(np.diff(at)))) if at.size > 1 else 1.0 / record.dt_s


class _Labels:
    """The kinds of blocks of half a second, and what they are told from: NaN where nothing was logged."""

    def __init__(self, record: FlightRecord, log: Log, found: Sequence[Manoeuvre], noise: Mapping[str, Noise]) -> None:
        self.record, self.log, self.found, self.noise = record, log, found, noise
        self.m = max(1, round(_BLOCK_S / record.dt_s))
        self.n = -(-len(record) // self.m)
        self.step = self.m * record.dt_s
        self.at = (np.arange(self.n) + 0.5) * self.step
        self.h, over_ground = self.mean("h"), self.mean("Vg")
        if not np.isfinite(over_ground).any():
            over_ground = np.hypot(self.mean("v_north"), self.mean("v_east"))
        over_ground = np.hypot(over_ground, np.nan_to_num(self.mean("hdot")))  # straight up is no rest
        self.speeds = (("airspeed", self.mean("V")), ("ground speed", over_ground))
        self.logged = np.add.reduceat(record.valid.any(axis=1), np.arange(0, len(record), self.m)) > 0
        self.why = np.full(self.n, "", dtype=object)

    def mean(self, name: str, size: int = 0) -> FloatArray:
        """Return the mean of a channel over each block, that of the block before where it has no sample.

        ``size`` is that of other blocks, in samples.
        """
        edges = np.arange(0, len(self.record), size or self.m)
        if name not in self.record:
            return np.full(edges.size, np.nan)
        taken, x = _taken(self.record, name), self.record[name]
        count = np.add.reduceat(taken.astype(float), edges)
        total = np.add.reduceat(np.where(taken, x, 0.0), edges)
        held = np.maximum.accumulate(np.where(count > 0, np.arange(edges.size), -1))
        first = int(np.argmax(count > 0))
        held = np.where(held < 0, first, held)
        return total[held] / np.maximum(count[held], 1.0) if count.any() else np.full(edges.size, np.nan)

    def stretches(self) -> tuple[Stretch, ...]:
        kinds = _without_short(self.aloft(self.flying()), round(_SHORTEST_S / self.step))
        self.why[~self.logged] = ""
        modes = self.modes()
        out, first = [], 0
        for (kind, mode), same in groupby(zip(kinds, modes, strict=True)):
            size = len(list(same))
            reasons = [text for text in self.why[first : first + size] if text]
            why = str(max(set(reasons), key=reasons.count)) if reasons and kind in (*_GROUND, STALL) else ""
            end = min((first + size) * self.step, float(self.record.t_s[-1]))
            out.append(Stretch(round(first * self.step, 9), round(end, 9), kind, mode, why))
            first += size
        return tuple(out)

    def flying(self) -> NDArray[np.bool_]:
        """Say for each block whether it is carried by the air, and why not."""
        landed = self.flag("landed")
        if landed is not None:
            self.why[landed] = "the autopilot reports a landing"
            return ~landed
        if self.log.vehicle == "rotorcraft":
            self.why[:] = f"it is less than {_LIFTED_M:g} m above its lowest"
            return self.lifted()
        known = [(name, x) for name, x in self.speeds if np.isfinite(x).any()]
        if not known:
            return self.answering()
        least = [max(SLOWEST_M_S, _SHARE * float(np.quantile(speed, 0.9))) for _, speed in known]
        each = [speed > limit for (_, speed), limit in zip(known, least, strict=True)]
        still = _steady(np.abs(known[-1][1]) < _ROLLS_M_S, round(_STILL_S / self.step))
        fast, rest = np.any(each, axis=0), still & ~np.any(each, axis=0)
        if len(known) > 1:  # slow over ground with air on the pitot tube: a wind on the ground, or against it aloft
            windy = fast & ~each[1]
            fast &= ~windy
            rest = rest if rest.any() else still & windy & (self.h <= np.min(self.h[windy], initial=np.inf) + _ALOFT_M)
        if np.isfinite(self.h).any() and rest.any():
            fast |= (self.h - np.interp(self.at, self.at[rest], self.h[rest]) > _ALOFT_M) & ~rest
        elif len(known) > 1:
            fast |= windy & ~still
        if self.log.vehicle == "VTOL" and np.isfinite(self.h).any():
            fast |= self.lifted()
        fast = _steady(fast, round(_STEADY_S / self.step))
        name, speed = known[0]
        for part in _parts(~fast):
            typical = float(np.median(speed[part]))
            why = f"the {name} is {typical:.2g} m/s, "
            below = f"and the wing cannot carry below {SLOWEST_M_S:g} m/s"
            self.why[part] = why + (below if typical < SLOWEST_M_S else "below that of its flight")
        return fast

    def lifted(self) -> NDArray[np.bool_]:
        """Of a rotorcraft: above the ground, or fast; where no height was logged nobody knows."""
        up = np.nan_to_num(self.speeds[-1][1]) > _HOVER_M_S
        if np.isfinite(self.h).any():
            return _steady(up | (self.h - float(np.quantile(self.h, 0.05)) > _LIFTED_M), round(_STEADY_S / self.step))
        return np.ones(self.n, bool)

    def answering(self) -> NDArray[np.bool_]:
        """Without any speed: what does not answer its controls, and rests, stands on the ground."""
        fast = np.ones(self.n, bool)
        still = [n for n in _STILL if n in self.record and n in self.noise]
        told = [(m, [unanswered(self.record, c, m, self.noise) for c in m.controls]) for m in self.found]
        checks = [(m, texts[0]) for m, texts in told if texts and all(texts)]
        if not checks or not still:
            return fast
        rests = np.ones(self.n, bool)
        around = max(1, round(2.0 / self.step))
        for name in still:
            for i in range(self.n):
                part = slice(max(0, i - around) * self.m, (i + around + 1) * self.m)
                x = self.record[name][part][_taken(self.record, name)[part]]
                rests[i] &= not moves(x, _rate(self.record, name), self.noise[name])
        for m, why in checks:
            inside = (self.at >= m.start_s - self.step) & (self.at <= m.end_s + self.step)
            if not rests[inside].all():
                continue
            first, last = np.flatnonzero(inside)[[0, -1]]
            part = next(p for p in _parts(rests) if p.start <= first and last < p.stop)
            fast[part] = False
            self.why[part] = why
        return fast

    def aloft(self, flying: NDArray[np.bool_]) -> NDArray[np.object_]:
        """Return the kind of each block."""
        kinds = np.where(flying, "cruise", "parked").astype(object)
        speed = next((x for _, x in self.speeds if np.isfinite(x).any()), np.full(self.n, np.nan))
        rotor, two_s = self.log.vehicle == "rotorcraft", round(2.0 / self.step)
        if rotor or not np.isfinite(speed).any():
            kinds[flying] = "flight"
        climb = self.mean("hdot")
        if not np.isfinite(climb).any() and np.isfinite(self.h).any() and self.n > 1:
            climb = np.gradient(_smooth(self.h, 2 * two_s), self.step)
        limit, climb = np.fmax(_CLIMB * np.abs(speed), _CLIMB_M_S), _smooth(climb, two_s)
        if rotor:
            kinds[flying & (speed < _HOVER_M_S)] = "hover"
        kinds[flying & (climb > limit)] = "climb"
        kinds[flying & (climb < -limit)] = "descent"
        kinds[flying & (np.abs(_smooth(self.mean("phi"), two_s)) > _TURN_RAD)] = "turn"
        for m in self.found:
            inside = (self.at >= m.start_s - 0.5 * self.step) & (self.at <= m.end_s + 0.5 * self.step)
            kinds[inside & flying] = "manoeuvre"
            kinds[inside & ~flying] = "control check"
        if not rotor:
            self.ground(kinds, flying)
        if self.log.vehicle == "VTOL":
            kinds[flying & (speed < SLOWEST_M_S)] = "hover"
        if not rotor:
            knee, beyond = self.stalled(flying & (kinds != "hover"))
            kinds[beyond] = STALL
            self.why[beyond] = f"lift is lost at angles of attack beyond {knee / DEG_RAD:.2g} deg"
        for name in ("hover", "transition"):
            flag = self.flag(name)
            if flag is not None:
                kinds[flying & flag] = name
        kinds[self.n - self.wild() :] = "crash"
        kinds[~self.logged] = "not logged"
        return kinds

    def stalled(self, flying: NDArray[np.bool_]) -> tuple[float, NDArray[np.bool_]]:
        """Return the angle of attack, rad, from which on lift is lost, and the blocks beyond it.

        Lift is the square of the airspeed times a straight line over the angle of attack. The line is fitted to the
        lower half of the angles and taken on, degree by degree, as long as lift follows it. The wing is stalled beyond
        the first degree in which a tenth of the lift is missing (Kirchhoff: the flow is separated from 0.8 of the chord
        on), and more than the line and its residuals leave open. Without a vane the angle is theta less the path's,
        with the wings level.
        """
        size = max(1, round(_BRIEF_S / self.record.dt_s))
        block = np.arange(-(-len(self.record) // size)) * size // self.m
        mean = partial(self.mean, size=size)
        speed, load, alpha, along, flying = mean("V"), -mean("az"), mean("alpha"), mean("ax"), flying[block]
        if not np.isfinite(alpha).any():
            path = np.arcsin(np.clip(mean("hdot") / np.maximum(np.abs(speed), SLOWEST_M_S), -1.0, 1.0))
            alpha = np.where(np.abs(np.nan_to_num(mean("phi"))) < _TURN_RAD, mean("theta") - path, np.nan)
        lift = load * np.cos(alpha) + along * np.sin(alpha) if np.isfinite(along).any() else load / np.cos(alpha)
        ok = flying & np.isfinite(alpha) & np.isfinite(lift) & (np.abs(alpha) < _BACKWARDS_RAD) & (speed > SLOWEST_M_S)
        nowhere = 0.0, np.zeros(self.n, bool)
        if np.count_nonzero(ok) < _FEWEST_BLOCKS:
            return nowhere
        x, y, square = alpha[ok], lift[ok], speed[ok] ** 2
        columns = square[:, None] * np.column_stack([np.ones(x.size), x])
        upto = max(float(np.median(x)), float(np.sort(x)[_FEWEST_BLOCKS // 2]))
        while np.max(x) > upto:
            below = x <= upto
            line, rest = _fitted(columns[below], y[below])
            alike = max(float(np.corrcoef(rest[1:], rest[:-1])[0, 1]), 0.0) if np.ptp(rest) > 0.0 else 0.0
            variance = float(rest @ rest) / (rest.size - 2) * (1.0 + min(alike, 0.9)) / (1.0 - min(alike, 0.9))
            known = np.linalg.pinv(columns[below].T @ columns[below])
            upto = max(upto + DEG_RAD, float(np.min(x[~below])))
            bin_ = ~below & (x <= upto)
            asked = columns[bin_] @ line
            off = np.sqrt(variance * (1.0 + np.einsum("ij,jk,ik->i", columns[bin_], known, columns[bin_])))
            missing = float(np.mean(asked - y[bin_]))
            if missing > _LOST * float(np.mean(asked)) and missing > _OFF * float(np.mean(off)):
                knee = float(np.min(x[bin_]))
                attached = knee + line[0] / line[1] if line[1] > 0.0 else 0.0  # from the angle of no lift on
                beyond = ok & (alpha >= knee)
                share = np.bincount(block, beyond, self.n) / np.bincount(block, minlength=self.n)
                enough = attached > _ATTACHED_RAD and np.count_nonzero(beyond) >= _FEWEST_BEYOND
                return (knee, share > 0.5) if enough else nowhere
        return nowhere

    def wild(self) -> int:
        """Return how many blocks at the end, and in most of them, do what no flight does: tumble, or fly backwards."""
        beyond = np.zeros(self.n, bool)
        for name in ("q", "r", "alpha"):
            if name in self.record:
                x = np.where(_taken(self.record, name), np.abs(self.record[name]), 0.0)
                beyond |= np.maximum.reduceat(x, np.arange(0, x.size, self.m)) > LIMITS[name][1]
        if not beyond.any():
            return 0
        last = self.n - int(np.argmax(beyond))
        return last if last < 0.5 * self.n and float(np.mean(beyond[-last:])) > 0.5 else 0

    def ground(self, kinds: NDArray[np.object_], flying: NDArray[np.bool_]) -> None:
        """Say of what is on the ground whether it rolls, and to what end."""
        name, speed = next((s for s in self.speeds[::-1] if np.isfinite(s[1]).any()), ("", np.zeros(self.n)))
        rolls = ~flying & (speed > (_ROLLS_M_S if name == "ground speed" else SLOWEST_M_S))
        kinds[rolls] = "taxi"
        if not flying.any() and "landed" not in self.log.flags:
            answers = [m for m in self.found if not all(unanswered(self.record, c, m, self.noise) for c in m.controls)]
            for m in answers:  # it moves, and is not fast enough: a hover, or the speed is wrong
                kinds[(self.at >= m.start_s - self.step) & (self.at <= m.end_s + _AFTER_S)] = "slow"
            return
        for i in np.flatnonzero(np.diff(flying.astype(np.int8))).tolist():
            if flying[i + 1]:
                while i >= 0 and rolls[i] and speed[i] <= speed[min(i + 1, self.n - 1)]:
                    kinds[i] = "take-off roll"
                    i -= 1
            else:
                i += 1
                while i < self.n and rolls[i]:
                    kinds[i] = "landing roll"
                    i += 1

    def flag(self, name: str) -> NDArray[np.bool_] | None:
        """Return for each block a flag that the log holds, held from each of its samples to the next."""
        if name not in self.log.flags:
            return None
        t, on = self.log.flags[name]
        last = np.searchsorted(t - float(self.record.provenance["clock_zero_s"]), self.at, side="right") - 1
        return np.asarray(on[np.maximum(last, 0)])

    def modes(self) -> list[str]:
        zero = float(self.record.provenance["clock_zero_s"])
        if not self.log.modes:
            return [""] * self.n
        begin = np.array([m.t_s - zero for m in self.log.modes])
        last = np.searchsorted(begin, self.at, side="right") - 1
        return [self.log.modes[i].said if i >= 0 else "" for i in last]


def _fitted(columns: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the values of least squares and what they leave."""
    values = np.asarray(np.linalg.lstsq(columns, y, rcond=None)[0], dtype=np.float64)
    return values, y - columns @ values


def _smooth(x: FloatArray, width: int) -> FloatArray:
    width = min(max(1, width), x.size)
    if width < 2 or not np.isfinite(x).all():
        return x
    padded = np.pad(x, (width // 2, width - 1 - width // 2), mode="edge")
    return np.convolve(padded, np.full(width, 1.0 / width), mode="valid")


def _parts(on: NDArray[np.bool_]) -> list[slice]:
    edges = np.flatnonzero(np.diff(np.r_[False, on, False].astype(np.int8)))
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _steady(on: NDArray[np.bool_], width: int) -> NDArray[np.bool_]:
    """Return what most of the blocks around each say."""
    return np.asarray(_smooth(on.astype(float), 2 * width + 1) > 0.5)


def _without_short(kinds: NDArray[np.object_], least: int) -> list[str]:
    out = [(kind, len(list(same))) for kind, same in groupby(kinds)]
    merged: list[tuple[str, int]] = []
    for i, (kind, size) in enumerate(out):
        kept = size >= least or kind in (
            "manoeuvre",
            "control check",
            "take-off roll",
            "landing roll",
            "transition",
            "crash",
            STALL,
        )
        after = out[i + 1][0] if i + 1 < len(out) else ""
        apart = merged and (merged[-1][0] in FLOWN) != (kind in FLOWN)
        if not kept and apart and after and (after in FLOWN) == (kind in FLOWN):
            out[i + 1] = (after, out[i + 1][1] + size)  # a short climb after a landing is no part of it
        elif merged and (not kept or merged[-1][0] == kind):
            merged[-1] = (merged[-1][0], merged[-1][1] + size)
        elif not kept and i + 1 < len(out):
            out[i + 1] = (out[i + 1][0], out[i + 1][1] + size)
        else:
            merged.append((kind, size))
    return [kind for kind, size in merged for _ in range(size)]


def beyond_ground(
    found: Sequence[Manoeuvre], stretches: Sequence[Stretch], record: FlightRecord, noise: Mapping[str, Noise]
) -> tuple[Manoeuvre, ...]:
    """Return the manoeuvres, those not to be cut out that lie where nothing flies, and why; the others within flight.

    Args:
        found: stretches in which controls move.
        stretches: of the record.
        record: on one clock.
        noise: of each channel.
    """
    out = []
    for m in found:
        rest = [s for s in stretches if not s.flown and s.kind != "not logged"]  # gaps are seen where it is cut
        here = [s for s in rest if s.start_s < m.end_s and s.end_s > m.start_s]
        here.sort(key=lambda s: min(s.end_s, m.end_s) - max(s.start_s, m.start_s), reverse=True)
        if not here:
            out.append(m if m.cut_s is None else replace(m, cut_s=_within(m, stretches)))
            continue
        texts = [unanswered(record, c, m, noise) for c in m.controls]
        why = "; ".join(dict.fromkeys(filter(None, [here[0].why, *texts])))
        what = _WORDS.get(here[0].kind, here[0].kind)
        out.append(replace(m, cut_s=None, reason=f"{what}: {why}" if why else what))
    return tuple(out)


_WORDS = {
    "slow": "on the ground, in a hover, or the airspeed is wrong", "parked": "on the ground",
    "control check": "a check of controls on the ground", "taxi": "in a taxi", "hover": "in a hover",
    "transition": "in a transition", STALL: "in a stall",
}  # fmt: skip


def _within(m: Manoeuvre, stretches: Sequence[Stretch]) -> tuple[float, float]:
    """Return the times to cut a manoeuvre, without what does not fly before and after it."""
    assert m.cut_s is not None
    first, last = m.cut_s
    for s in stretches:
        if not s.flown:
            first = max(first, s.end_s) if s.end_s <= m.start_s else first
            last = min(last, s.start_s) if s.start_s >= m.end_s else last
    return first, last


_LETTERS = dict(zip(KINDS, ".ktT-/\\uM=SoxLs! ", strict=True))


def strip(stretches: Sequence[Stretch], width: int = 60) -> tuple[str, str]:
    """Return a timeline of ``width`` letters, each of what lasts longest in its part, and what the letters mean.

    A manoeuvre and a check of controls show wherever there is one.
    """
    end = stretches[-1].end_s
    edges = np.linspace(0.0, end, width + 1)
    line = []
    for a, b in pairwise(edges.tolist()):
        here = {s.kind: min(s.end_s, b) - max(s.start_s, a) for s in stretches if s.start_s < b and s.end_s > a}
        shown: list[str] = [kind for kind in ("manoeuvre", "control check") if kind in here]
        shown += sorted(here, key=lambda kind: -here[kind])
        line.append(_LETTERS[shown[0]] if shown else " ")
    held = [kind for kind in KINDS if any(s.kind == kind for s in stretches)]
    return "".join(line), ", ".join(f"{_LETTERS[kind]} {kind}" for kind in held if kind != "not logged")


def not_flown(stretches: Sequence[Stretch]) -> str:
    """Say how much of a log no wing carries, so that nothing is identified from it: "" if all of it flies."""
    held = {kind: sum(s.end_s - s.start_s for s in stretches if s.kind == kind) for kind in KINDS}
    rest = [f"{kind} {time:.3g} s" for kind, time in held.items() if time > 0.0 and kind not in FLOWN]
    return (
        f"{sum(held[kind] for kind in FLOWN):.3g} s are flight on a wing; the rest is {', '.join(rest)}" if rest else ""
    )


def flown_parts(stretches: Sequence[Stretch]) -> list[tuple[float, float]]:
    """Return start and end, s of the record, of each part that flies without a break."""
    parts: list[tuple[float, float]] = []
    for s in stretches:
        if s.flown and parts and parts[-1][1] == s.start_s:
            parts[-1] = (parts[-1][0], s.end_s)
        elif s.flown:
            parts.append((s.start_s, s.end_s))
    return parts
