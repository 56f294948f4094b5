"""What a channel is read as: unit, sign and axes, weighed by the motion of which all channels are parts.

Names and headings leave open whether 3 is degrees, which way z counts, whether 40 is knots. Every channel has
readings, a factor on its values each, with a prior by who stated what; every relation of flight weighs readings of
several channels at once. Let x be what one side of a relation says over intervals of half a second and y the other
side, with deviations s_x and s_y and correlation r. Then D = cosh(|ln(s_x/s_y)| + ln r) - r, where noise of one side
accounts for a factor of 1/r, is zero where both say the same and above one where they differ in size or sign, and n
intervals give ln p = -n/4 ln D, n no more than 40, as relations leave things out. Values that no flight has count
against a reading. The best reading is found by changing one channel, or one kind of unit, at a time; its probability is
what it has beside every other reading of the same channel, the rest at its best.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from scipy.special import log_ndtr

from testbench.core.atmosphere import air_density
from testbench.core.channels import SURFACES, UNITS, channel
from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.core.record import FloatArray
from testbench.logs.question import (
    FEW,
    MOVING_RAD_S,
    UNSTATED,
    Question,
    Signal,
    Signals,
    beyond,
    damaged,
    in_unit,
    shown,
)
from testbench.logs.signals import ONE_TURN, TURNING, Mapped

CERTAIN = 0.99
"""Probability from which on a reading that nobody stated is taken, and said."""
FULL_THROW_RAD = 25.0 * DEG_RAD
_STEP_S, _CLIMB_S = 0.5, 2.0
_MOST_SAMPLES, _MOST_ROWS, _MOST, _FEWEST = 200_000, 20_000, 40.0, 8
_LEAST_D = 0.003  # relations leave out some percent
_LOOSE, _CLOSE, _CHANCE = 0.5, 0.8, 3.0  # correlation below which a relation says nothing; of noise, in 1 / sqrt(n)
_BEYOND, _SOONER = -30.0, -10.0  # ln p of values that no flight has, and that few have
_STATED, _OTHER_SET = -5.0, -7.0  # ln p that a file states another unit than its own, and that another one was set
_EQUAL, _SELDOM, _AXES_SELDOM, _RARE = -0.7, -2.0, -3.0, -3.5  # of a unit, or a sign, where nobody stated one
_USUAL, _USUAL_LN = {"rad": 0.05, "rad/s": 0.15}, 1.2
"""Usual deviation of angles and rates in a flight, and the deviation of its logarithm; judged."""
_AXES = ("theta", "q", "r", "ay", "az", "v", "w")
"""What changes its sign between forward, right, down and forward, left, up."""
_GROUPS = (
    (("p", "q", "r"), -8.0), (("phi", "theta", "psi"), -8.0), (("ax", "ay", "az"), -8.0), (("de", "da", "dr"), -4.0),
    (("phi", "theta", "psi", "alpha", "beta", "p", "q", "r", "de", "da", "dr"), -2.0), (("V", "Vg", "h", "hdot"), -4.5),
)  # fmt: skip
"""Channels that one writer gives in one kind of unit, and ln p of each that differs from most, where nobody stated."""
_SYSTEM = {"kt": "ft", "km": "m"}  # who flies in knots climbs in feet
_ANSWERS = {"de": ("q", "alpha", -1.0, "nose up"), "da": ("p", "beta", 1.0, "left"), "dr": ("r", "beta", -1.0, "right")}
"""Surface -> the rate that answers, the flow angle that acts, the sign of the answer, what the other sign is called."""
_TURNED = 0.75 * np.pi  # of heading, over which wind is no constant difference
_ANOTHER = 0.7  # ln of a factor from which readings are of another size: twice, or half
_SELDOM_USED = ("rpm", "km", "cm", "cm/s", "cm/s2", "kN")  # units that nobody forgets to state
_MOVES = 0.5 * DEG_RAD  # of a control that tells something


class Choice(NamedTuple):
    """A reading of a channel: what its values are to be multiplied by, the unit that this is, ln p before the data."""

    factor: float
    unit: str
    prior: float


@dataclass(frozen=True)
class Reading:
    """The best reading of a channel that is not the one it was read by.

    Args:
        channel: of the table.
        factor: takes values as read to values as they are to be read.
        unit: in which they then are, "" for a sign alone, or where another unit was set than the file's own.
        probability: beside all other readings of the channel.
        got: what shows it, in words.
        means: what it would mean, as a question.
    """

    channel: str
    factor: float
    unit: str
    probability: float
    got: str
    means: str

    @property
    def certain(self) -> bool:
        """Whether it may be taken: a part of full throw has no size."""
        return self.probability >= CERTAIN and self.unit != "norm"

    @property
    def taken(self) -> str:
        """How it is taken, in words."""
        way = "with the other sign" if self.factor < 0.0 else ""
        return " and ".join(filter(None, [f"in {self.unit}" if self.unit else "", way]))

    def of(self, c: Mapped) -> Mapped:
        """Return a channel as this reading has it."""
        values = self.factor * c.values
        if c.name in TURNING and np.max(np.abs(values)) <= ONE_TURN:
            values = np.unwrap(values)
        return replace(c, values=values, said=f"{c.said}, taken {self.taken}", assumed="" if self.unit else c.assumed)

    @property
    def question(self) -> Question:
        """The reading as a question."""
        return Question(self.channel, self.got, self.means, self.unit, self.probability)


def readings(
    signals: Signals,
    unstated: Collection[str] = (),
    doubtful: Collection[str] = (),
    axes: bool = False,
    stated: Collection[str] = (),
) -> tuple[Reading, ...]:
    """Return the best reading of each channel of which another one is likelier than the one it was read by.

    Args:
        signals: the channels in SI units, as they were read.
        unstated: those whose unit nobody stated.
        doubtful: controls whose sign only the custom of the writer tells.
        axes: whether the axes of the body may be those of ROS (forward, left, up), as nobody stated them.
        stated: those whose unit the writer of the file stated.
    """
    held = {name: _thinned(t, x) for name, (t, x) in signals.items() if x.size > 1 and np.isfinite(x).all()}
    return tuple(_Weighed(held, unstated, doubtful, axes, stated).found()) if held else ()


def turned(channels: Sequence[Mapped]) -> tuple[Mapped, ...]:
    """Return channels that were logged in axes forward, left, up in the axes of the channel table."""
    return tuple(
        replace(c, values=-c.values, said=f"minus {c.said}; axes forward, left, up") if c.name in _AXES else c
        for c in channels
    )


def settled(channels: Sequence[Mapped], sure: Sequence[Reading]) -> tuple[tuple[Mapped, ...], list[str]]:
    """Return channels as certain readings have them, where nobody stated how, and what told it, in words."""
    said = []
    for reading in sure:
        if reading.channel == "axes":
            channels = turned(channels)
            taken = "axes are taken as forward, left, up"
        else:
            channels = [reading.of(c) if c.name == reading.channel else c for c in channels]
            taken = f"{reading.channel} is taken {reading.taken}"
        said.append(f"{taken}, which no heading states: {reading.got}")
    return tuple(channels), said


def _thinned(t: FloatArray, x: FloatArray) -> Signal:
    """Return a signal of at most twice MOST_SAMPLES: means of so many samples that follow each other."""
    n = x.size // _MOST_SAMPLES
    if n < 2:
        return t, x
    m = x.size // n * n
    return t[:m].reshape(-1, n).mean(axis=1), x[:m].reshape(-1, n).mean(axis=1)


# --- channels over intervals ------------------------------------------------------------------------------------------


class _Rows:
    """Means of channels over intervals, and about their ends, NaN where an interval has no sample."""

    def __init__(self, signals: Signals, step_s: float) -> None:
        start = min(float(t[0]) for t, _ in signals.values())
        end = max(float(t[-1]) for t, _ in signals.values())
        step_s = max(step_s, (end - start) / _MOST_ROWS)
        self.at = np.arange(start, end + 1e-9 * step_s, step_s)
        self.step_s, self.signals = step_s, signals
        self._kept: dict[tuple[str, bool], FloatArray] = {}

    def means(self, name: str) -> FloatArray:
        """Return the mean over each interval."""
        return self._of(name, False)

    def changes(self, name: str) -> FloatArray:
        """Return the change over each interval per second, of means over a short time about its ends."""
        return self._of(name, True)

    def _of(self, name: str, change: bool) -> FloatArray:
        if (name, change) not in self._kept:
            t, x = self.signals[name]
            a, b = self.at[:-1], self.at[1:]
            with np.errstate(over="ignore", invalid="ignore"):
                whole = np.r_[0.0, np.cumsum(0.5 * (x[1:] + x[:-1]) * np.diff(t))]
                mean = partial(_mean, t, whole)
                half = min(0.2 * self.step_s, 0.2)
                y = (mean(b - half, b + half) - mean(a - half, a + half)) / self.step_s if change else mean(a, b)
            held = np.searchsorted(t, b) - np.searchsorted(t, a)
            usual = max(1.0, 0.5 * self.step_s / float(np.median(np.diff(t))))
            y[(held < usual) | (a - t[0] < -1e-6) | (t[-1] - b < -1e-6)] = np.nan
            self._kept[name, change] = y
        return self._kept[name, change]


def _mean(t: FloatArray, whole: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    a, b = np.clip(a, t[0], t[-1]), np.clip(b, t[0], t[-1])
    return np.asarray((np.interp(b, t, whole) - np.interp(a, t, whole)) / np.maximum(b - a, 1e-12))


class _View:
    """Rows of channels, read as a hypothesis has it."""

    def __init__(self, rows: _Rows, factors: Mapping[str, float]) -> None:
        self.rows, self.factors = rows, factors

    def __contains__(self, name: str) -> bool:
        return name in self.rows.signals

    def __call__(self, name: str, usual: float | None = None) -> FloatArray:
        """Return means; ``usual`` where the channel is not there."""
        if name not in self and usual is not None:
            return np.full(self.rows.at.size - 1, usual)
        return self.factors.get(name, 1.0) * self.rows.means(name)

    def change(self, name: str) -> FloatArray:
        return self.factors.get(name, 1.0) * self.rows.changes(name)


# --- relations of flight ----------------------------------------------------------------------------------------------


_Sides = tuple[FloatArray, FloatArray]


class Relation(NamedTuple):
    """Two sides that must say the same: the channels that they need, those that help, and how closely they must agree.

    ``says`` names for each channel what speaks against it. With ``level``, the least D, the medians of both are
    compared, else their deviations and correlation.
    """

    needs: tuple[str, ...]
    helps: tuple[str, ...]
    sides: Callable[[_View], _Sides]
    says: Mapping[str, str]
    least: float = _LOOSE
    step_s: float = _STEP_S
    level: float = 0.0


def _flying(v: _View) -> FloatArray:
    speed = v("V")
    return np.where(speed > 0.4 * np.nanquantile(speed, 0.9), speed, np.nan) if np.isfinite(speed).any() else speed


def _nearer(y: FloatArray, *sides: FloatArray) -> _Sides:
    """Return the side that follows ``y`` best: in a gentle flight the terms of a bank hold more noise than motion."""
    ok = np.isfinite(y) & np.all([np.isfinite(x) for x in sides], axis=0)
    if np.count_nonzero(ok) < _FEWEST:
        return sides[0], y
    return max(sides, key=lambda x: abs(np.cov(x[ok], y[ok])[0, 1]) / max(float(np.std(x[ok])), 1e-300)), y


def _pitching(v: _View) -> _Sides:
    q = v("q")
    banked = q * np.cos(v("phi")) - v("r") * np.sin(v("phi")) if "r" in v and "phi" in v else q
    return _nearer(v.change("theta"), q, banked)


def _rolling(v: _View) -> _Sides:
    p = v("p")
    if not {"q", "r", "theta"} <= set(v.rows.signals):
        return p, v.change("phi")
    turn = v("q") * np.sin(v("phi")) + v("r") * np.cos(v("phi"))
    return _nearer(v.change("phi"), p, p + turn * np.clip(np.tan(v("theta")), -1.0, 1.0))


def _turning(v: _View) -> _Sides:
    return v("q") * np.sin(v("phi")) + v("r") * np.cos(v("phi")), v.change("psi") * np.cos(v("theta"))


def _weight(v: _View) -> FloatArray:
    return G0_M_S2 * np.cos(v("theta")) * np.cos(v("phi", 0.0))


def _curving(v: _View) -> _Sides:
    return -v("az") - _weight(v), _flying(v) * (v("q") - v.change("alpha"))


def _slipping(v: _View) -> _Sides:
    alpha = v("alpha")
    turning = v.change("beta") + v("r") * np.cos(alpha) - v("p") * np.sin(alpha)
    return v("ay"), _flying(v) * turning - G0_M_S2 * np.sin(v("phi")) * np.cos(v("theta"))


def _climbing(v: _View) -> _Sides:
    return _flying(v) * np.sin(v("theta") - v("alpha")), v.change("h")


def _banking(v: _View) -> _Sides:
    """A steady turn, in which nothing pushes sideways: V psidot = g tan(phi)."""
    return _flying(v) * v.change("psi"), G0_M_S2 * np.tan(np.clip(v("phi"), -1.2, 1.2))


def _standing(v: _View) -> _Sides:
    return -v("az"), np.full(v("az").size, G0_M_S2)


def _pressing(v: _View) -> _Sides:
    height = np.clip(v("h", 0.0), 0.0, 11_000.0)
    rho = air_density(float(np.nanmedian(height))) if np.isfinite(height).any() else air_density(0.0)
    return _flying(v), np.sqrt(2.0 * np.maximum(v("qbar"), 0.0) / rho)


def _going(v: _View) -> _Sides:
    """Airspeed and ground speed, where the heading turns so far that the wind is not from one side all the time."""
    speed, psi = _flying(v), v("psi")
    turned = float(np.nanmax(psi) - np.nanmin(psi)) if np.isfinite(psi).any() else 0.0
    return (speed, v("Vg")) if turned > _TURNED else (speed, np.full(speed.size, np.nan))


RELATIONS = (
    Relation(("q", "theta"), ("phi", "r"), _pitching, {"q": "theta", "theta": "q"}),
    Relation(("p", "phi"), ("theta", "q", "r"), _rolling, {"p": "phi", "phi": "p"}),
    Relation(("q", "r", "phi", "psi", "theta"), (), _turning, {"r": "psi", "psi": "r", "q": "psi"}),
    Relation(("V", "az", "q", "alpha", "theta"), ("phi",), _curving,
             dict.fromkeys(("V", "az", "q", "alpha", "theta"), "the curve of the path"), _CLOSE),
    Relation(("ay", "V", "beta", "alpha", "p", "r", "phi", "theta"), (), _slipping,
             {"ay": "sideslip, rates and bank"}, _CLOSE),
    Relation(("V", "theta", "alpha", "h"), (), _climbing,
             dict.fromkeys(("V", "theta", "alpha", "h"), "height and the path angle"), _CLOSE, _CLIMB_S),
    Relation(("hdot", "h"), (), lambda v: (v("hdot"), v.change("h")),
             {"hdot": "height", "h": "the climb rate"}, 0.8, _CLIMB_S),
    Relation(("V", "phi", "psi"), (), _banking, {"V": "bank and turn"}, _CLOSE, _CLIMB_S),
    Relation(("az",), (), _standing, {"az": "weight"}, level=_LEAST_D),
    Relation(("V", "qbar"), ("h",), _pressing,
             {"V": "dynamic pressure and height", "qbar": "airspeed"}, level=_LEAST_D),
    Relation(("V", "Vg", "psi"), (), _going, {"V": "ground speed", "Vg": "airspeed"}, level=0.06),
)  # fmt: skip


# --- readings weighed -------------------------------------------------------------------------------------------------


class _Weighed:
    """The readings of all channels of a record, and the likelihood of some."""

    def __init__(
        self,
        signals: Signals,
        unstated: Collection[str],
        doubtful: Collection[str],
        axes: bool,
        stated: Collection[str],
    ) -> None:
        self.unstated, self.stated = frozenset(unstated), frozenset(stated)
        self.rows: dict[float, _Rows] = {}
        choices = {name: _choices(name, name in self.unstated, name in doubtful) for name in signals}
        self.signals = signals = {n: kept for n, s in signals.items() if (kept := self._within(n, s, choices[n]))}
        self.choices = {name: found for name, found in choices.items() if len(found) > 1 and name in signals}
        if axes:
            self.choices["axes"] = [Choice(1.0, "frd", 0.0), Choice(-1.0, "flu", _AXES_SELDOM)]
        self.relations = [r for r in RELATIONS if set(r.needs) <= set(signals)]
        self.alone = {name: [self._alone(name, choice) for choice in found] for name, found in self.choices.items()}
        custom = {*doubtful, *(name for name in unstated if name.removesuffix("_cmd") in SURFACES)}
        self.answers = {name: _answer(signals, name) for name in custom if name in signals}
        self.groups = [
            (members, ln_p)
            for names, ln_p in _GROUPS
            if len(members := [n for n in self.choices if n.removesuffix("_cmd") in names and n in self.unstated]) > 1
        ]
        self._seen: dict[tuple[int, tuple[float, ...]], float] = {}

    def _within(self, name: str, signal: Signal, found: list[Choice]) -> Signal | None:
        """Return a signal without damaged samples; None if none of its readings is one of a flight."""
        t, x = signal
        out = beyond(name, t, x)
        if damaged(out, name in self.stated)[0]:
            return (t[~out], x[~out]) if np.count_nonzero(~out) > 1 else None
        fits = any(damaged(beyond(name, t, choice.factor * x), False)[0] for choice in found)
        return signal if fits else None

    def _alone(self, name: str, choice: Choice) -> float:
        """Return ln p of a reading by the channel's own values."""
        if name == "axes":
            return choice.prior
        t, x = self.signals[name][0], choice.factor * self.signals[name][1]
        if not damaged(beyond(name, t, x), name in self.stated)[0]:
            return choice.prior + _BEYOND
        sooner = UNSTATED.get(name.removesuffix("_cmd"), np.inf)
        few = name in self.unstated and np.mean(np.abs(x) > sooner) >= FEW
        usual = _USUAL.get(channel(name).unit) if name in self.unstated else None
        away = np.log(max(float(np.std(x)), 1e-9) / usual) / _USUAL_LN if usual else 0.0
        return choice.prior + (_SOONER if few else 0.0) - 0.5 * float(away) ** 2

    def factors(self, at: Mapping[str, int]) -> dict[str, float]:
        out = {name: self.choices[name][i].factor for name, i in at.items()}
        turned = out.pop("axes", 1.0)
        return out | {name: turned * out.get(name, 1.0) for name in _AXES if name in self.signals and turned < 0.0}

    def ln_p(self, at: Mapping[str, int]) -> float:
        """Return ln p of a hypothesis: channel -> the number of its reading."""
        factors = self.factors(at)
        total = sum(self.alone[name][i] for name, i in at.items())
        for k, relation in enumerate(self.relations):
            total += self._ln(k, relation, factors)
        for name, (slope, off) in self.answers.items():
            rate, _, sign, _ = _ANSWERS[name.removesuffix("_cmd")]
            way = sign * slope * np.sign(factors.get(name, 1.0) * factors.get(rate, 1.0))
            total += float(log_ndtr(0.5 * way / off)) if off > 0.0 else 0.0
        return total + self._alike(at)

    def _ln(self, k: int, relation: Relation, factors: Mapping[str, float]) -> float:
        used = [n for n in (*relation.needs, *relation.helps) if n in self.signals]
        key = (k, tuple(factors.get(name, 1.0) for name in used))
        if key not in self._seen:
            sides = self.sides(relation, factors)
            self._seen[key] = 0.0 if sides is None else _evidence(relation, *sides)
        return self._seen[key]

    def sides(self, relation: Relation, factors: Mapping[str, float]) -> _Sides | None:
        """Return both sides of a relation where both are known; None if that is seldom."""
        slowest = max(float(np.median(np.diff(self.signals[name][0]))) for name in relation.needs)
        step = max(relation.step_s, 2.0 * slowest)
        if step not in self.rows:
            self.rows[step] = _Rows(self.signals, step)
        with np.errstate(over="ignore", invalid="ignore"):
            x, y = relation.sides(_View(self.rows[step], factors))
        ok = np.isfinite(x) & np.isfinite(y)
        return (x[ok], y[ok]) if np.count_nonzero(ok) >= _FEWEST else None

    def _alike(self, at: Mapping[str, int]) -> float:
        """Return ln p of units that differ within a table, of the channels that nobody stated."""
        total = 0.0
        for members, ln_p in self.groups:
            kinds = [kind for name in members if (kind := self._kind(name, at[name])) != "norm"]
            most = max((kinds.count(kind) for kind in kinds), default=0)
            total += ln_p * (len(kinds) - most)
        return total

    def _kind(self, name: str, i: int) -> str:
        kind = (self.choices[name][i].unit or channel(name).unit).partition("/")[0]
        return _SYSTEM.get(kind, kind)

    def best(self, at: dict[str, int], held: str = "") -> dict[str, int]:
        """Return the hypothesis that no change of one channel, or of a group, but ``held`` makes likelier."""
        value = self.ln_p(at)
        free = {name: range(len(found)) for name, found in self.choices.items() if name != held}
        while True:
            others = [{**at, name: i} for name, every in free.items() for i in every if i != at[name]]
            for members, _ in self.groups:
                kinds = {self._kind(name, i) for name in members if name in free for i in free[name]}
                others += [{**at, **all_in} for kind in sorted(kinds) for all_in in self._all_in(kind, members, free)]
            other = max(others, key=self.ln_p, default=at)
            if (ln_p := self.ln_p(other)) <= value + 1e-9:
                return at
            at, value = other, ln_p

    def _all_in(self, kind: str, members: Sequence[str], free: Mapping[str, range]) -> Iterator[dict[str, int]]:
        """Yield the hypotheses in which all channels of a group are in one kind of unit, as ft/s or kt beside ft.

        Signs of surfaces are changed one at a time: the first of each is taken.
        """
        of = {name: [i for i in free[name] if self._kind(name, i) == kind] for name in members if name in free}
        held = {name: found if name not in SURFACES else found[:1] for name, found in of.items() if found}
        for each in product(*held.values()):
            yield dict(zip(held, each, strict=True))

    def found(self) -> Iterator[Reading]:
        start = dict.fromkeys(self.choices, 0)
        starts = [start, {**start, "axes": 1}] if "axes" in start else [start]
        at = max((self.best(s) for s in starts), key=self.ln_p)
        if at.get("axes"):
            yield self._turned(at)
        for name, found in self.choices.items():
            if at[name] and name != "axes":
                ln_p = [self.ln_p(self.best({**at, name: i}, name)) for i in range(len(found))]
                share = np.exp(np.array(ln_p) - max(ln_p))
                reading = self._reading(name, at, float(share[at[name]] / share.sum()))
                if reading is not None:
                    yield reading

    def _turned(self, at: Mapping[str, int]) -> Reading:
        other = self.best({**at, "axes": 0}, "axes")
        probability = 1.0 / (1.0 + float(np.exp(min(self.ln_p(other) - self.ln_p(at), 50.0))))
        names = ", ".join(name for name in _AXES if name in self.signals)
        got = f"{names} have the signs of axes forward, left, up"
        return Reading("axes", -1.0, "flu", probability, got, "are these its axes (--axes flu)")

    def _reading(self, name: str, at: Mapping[str, int], probability: float) -> Reading | None:
        """Return a reading; None where what speaks for it has the size that the channel was read by.

        A channel of noise agrees better with all others the smaller it is taken.
        """
        choice = self.choices[name][at[name]]
        factors = self.factors(at)
        before = {**factors, name: factors[name] / choice.factor}
        spoke, gain = None, max(self.alone[name][at[name]] - self.alone[name][0], 0.0)
        for k, relation in enumerate(self.relations):
            if name not in relation.says:
                continue
            more = self._ln(k, relation, factors) - self._ln(k, relation, before)
            if more > gain:
                spoke, gain = relation, more
        sides = None if spoke is None or spoke.level else self.sides(spoke, before)
        if sides is not None:
            agree, other = abs(np.log(_ratio(np.std(sides[0]), np.std(sides[1])))), abs(np.log(abs(choice.factor)))
            if other > _ANOTHER and agree < 0.5 * other:
                return None
        if name in self.answers and spoke is None and choice.factor < 0.0:
            got, means = self._against_answer(name)
        else:
            got, means = self._words(name, choice, spoke, before)
        return Reading(name, choice.factor, choice.unit, probability, got, means)

    def _against_answer(self, name: str) -> tuple[str, str]:
        surface = name.removesuffix("_cmd")
        rate, _, _, way = _ANSWERS[surface]
        got = f"{self.answers[name][0]:.3g} {rate}dot/{name} in 1/s2: positive {name} turns the aircraft {way}"
        return got, f"does full command move it the other way (--throw {surface}=-25 for 25 deg)"

    def _words(self, name: str, choice: Choice, spoke: Relation | None, before: Mapping[str, float]) -> tuple[str, str]:
        t, x = self.signals[name]
        largest, typical = float(x[np.argmax(np.abs(x))]), float(np.median(x))
        unit, factor = choice.unit, choice.factor
        sides = self.sides(spoke, before) if spoke is not None else None
        if spoke is None or sides is None:
            out = int(np.count_nonzero(beyond(name, t, x)))
            got = f"{shown(name, largest)} in {out} of {x.size} samples" if out else f"up to {shown(name, largest)}"
        else:
            says = spoke.says[name]
            size = np.median if spoke.level else np.std
            times = _ratio(size(sides[0]), size(sides[1]))
            times = times if name == spoke.needs[0] or spoke.level else 1.0 / times
            minus = "minus " if factor < 0.0 else ""
            got = f"up to {shown(name, largest)}, {minus}{times:.2g} times the value from {says}"
            if name == "az":
                got = f"{typical:.3g} m/s2 in the mean, where level flight has -9.81 m/s2"
            elif name == "ay":
                got = f"{minus}{times:.2g} times the value from {says}"
            elif name in ("V", "Vg"):
                got = f"{typical:.3g} m/s, {times:.2g} times the value from {says}"
            elif name == "h":
                got = f"it changes {times:.2g} times as fast as airspeed and the path angle say"
        left = "does it count to the left (scale = -1.0)"
        if unit == "norm":
            means = f"is it a part of full throw, or in deg ({largest:.3g} deg, read as {largest:.3g} rad)"
        elif name == "az" and factor < 0.0:
            means = "does it count upwards (scale = -1.0), or was the flight inverted"
            means = f"is it in {unit}, and {means}" if unit else means
        elif factor < 0.0:
            means = f"is it in {unit}, and {left.partition(' (')[0]}" if unit else left
        elif name in ("ax", "ay", "az") and unit:
            means = f"is it in {unit}"
        elif unit:
            means = in_unit(name, typical if name in ("V", "Vg") else largest, unit)
        elif name == "V":
            means = f"is another unit set than its own ({_set(1.0 / factor)}), or is it calibrated airspeed"
        else:
            means = f"is it in {channel(name).unit} already"
        return got, means


def _choices(name: str, unstated: bool, doubtful: bool) -> list[Choice]:
    """Return the readings of a channel, the one by which it was read first."""
    si, base = channel(name).unit, name.removesuffix("_cmd")
    out = [Choice(1.0, "", 0.0)]
    others = {unit: f for unit, f in UNITS.get(si, {}).items() if unit != si and unit not in _SELDOM_USED}
    if si == "m/s" and name != "hdot":
        others.pop("ft/min")
    if base in SURFACES:
        if doubtful:
            return [*out, Choice(-1.0, "", 0.0)]
        if unstated:
            out += [Choice(DEG_RAD, "deg", _EQUAL), Choice(FULL_THROW_RAD, "norm", _EQUAL)]
            return [*out, *(Choice(-choice.factor, choice.unit, choice.prior + _RARE) for choice in out)]
        return [*out, Choice(DEG_RAD, "deg", _STATED)]
    usual = _EQUAL if si.startswith("rad") else _SELDOM
    out += [Choice(f, unit, usual if unstated else _STATED) for unit, f in others.items()]
    if name in ("ay", "az"):
        signs = [Choice(-choice.factor, choice.unit, choice.prior + _RARE) for choice in out]
        out += signs
    if name == "V" and not unstated:
        factors = {"m/s": 1.0, **others}
        ratios = {factors[a] / factors[b] for a in factors for b in factors if a != b} - set(others.values())
        out += [Choice(ratio, "", _OTHER_SET) for ratio in sorted(ratios) if ratio > 1.0]
    if si.startswith("rad") and not unstated:
        out.append(Choice(1.0 / DEG_RAD, "", _OTHER_SET))
    return out


def _evidence(relation: Relation, x: FloatArray, y: FloatArray) -> float:
    """Return ln p that both sides of a relation say the same, 0 where they say nothing."""
    n = min(float(x.size), _MOST)
    if relation.level:
        a, b = float(np.median(x)), float(np.median(y))
        if not a * b:
            return 0.0
        D = float(np.cosh(np.log(abs(a / b)))) - np.sign(a * b)
        return -0.25 * n * float(np.log(max(D, relation.level)))
    sx, sy = float(np.std(x)), float(np.std(y))
    r = float(np.corrcoef(x, y)[0, 1]) if min(sx, sy) > 0.0 else 0.0
    if abs(r) < max(relation.least, _CHANCE / np.sqrt(x.size)):
        return 0.0
    apart = max(abs(float(np.log(sx / sy))) + float(np.log(abs(r))), 0.0)  # noise makes one of them larger by 1 / r
    return -0.25 * n * float(np.log(max(np.cosh(apart) - r, _LEAST_D)))


def _ratio(a: Any, b: Any) -> float:
    """Return the size of a over that of b, both kept above zero."""
    return max(abs(float(a)), 1e-300) / max(abs(float(b)), 1e-300)


def _answer(signals: Signals, name: str) -> tuple[float, float]:
    """Return what a control does to the acceleration about its axis, 1/s2, and its deviation; (0, 0) if nothing tells.

    In the first moment an aircraft turns as its surface pushes it: trailing edge down pitches down, right wing down
    rolls right, trailing edge left yaws left. The acceleration is fitted by the rate, the flow angle and the control.
    """
    rate, flow, _, _ = _ANSWERS[name.removesuffix("_cmd")]
    if rate not in signals or np.ptp(signals[name][1]) < _MOVES or np.ptp(signals[rate][1]) < MOVING_RAD_S:
        return 0.0, 0.0
    names = (name, rate, *((flow,) if flow in signals else ()))
    rows = _Rows({n: signals[n] for n in names}, max(0.1, 2.0 * float(np.median(np.diff(signals[rate][0])))))
    held = np.column_stack([*(rows.means(n) for n in names), np.ones(rows.at.size - 1)])
    turned = rows.changes(rate)
    ok = np.isfinite(held).all(axis=1) & np.isfinite(turned)
    if np.count_nonzero(ok) < 12:
        return 0.0, 0.0
    held, turned = held[ok], turned[ok]
    found, *_, scale = np.linalg.lstsq(held, turned, rcond=None)
    if scale[-1] < 1e-9 * scale[0]:
        return 0.0, 0.0
    spread = float(np.std(turned - held @ found))
    return float(found[0]), spread * float(np.sqrt(np.linalg.inv(held.T @ held)[0, 0]))


def _set(times: float) -> str:
    """Return which unit, set for values in another one, comes nearest to making them so many times too large."""
    factors = {unit: np.log(factor) for unit, factor in UNITS["m/s"].items() if unit not in _SELDOM_USED}
    pairs = [(a, b) for a in factors for b in factors if a != b]
    wrong, right = min(pairs, key=lambda pair: abs(np.log(times) - factors[pair[0]] + factors[pair[1]]))
    return f"{wrong} for {right} makes {np.exp(factors[wrong] - factors[right]):.2g}"
