"""The path from a command to its surface, judged by itself where both are recorded, before anything is flown for it.

What the surface does that the command does not explain is a feedback, an interconnect, or the servo: its lag, rate
limit, delay, gain, dead band or play. No coefficient, gust or force has a part in that. What differs from the believed
path is fitted to the recorded surface, driven by recorded command and motion; kinds are added one by one while the
likelihood asks for them, the order by BIC (G. Schwarz, 1978). The effects of the library are then sought in that path
only, or in no path that is as believed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import chi2

from testbench.aircraft.seams import control_path
from testbench.core.errors import ModelError
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.words import with_error
from testbench.effects import SERVOS, Effect
from testbench.effects.servo import WORDS, corner_of, declared
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.evidence.commanded import commands, moves_on, quiet_samples, surface_noise
from testbench.questions.gap.evidence.path_models import INSTANT, Kind, Path, kinds

SURFACES = ("de", "da", "dr")
_FED = {"alpha": "1", "q": "s", "theta": "1", "p": "s", "r": "s", "phi": "1"}
_MOST = 3  # kinds in one path
_STARTS = 2  # the best of a kind's, from which it is fitted
_BY_KIND = {
    "lag": ("lag", "second order"),
    "second order": ("second order", "delay and second order", "lag"),
    "delay": ("delay", "delay and second order"),
    "rate limit": ("rate limit", "rate limit, another one each way"),
    "gain": ("gain", "one-sided linkage"),
    "dead band": ("dead band", "free play"),
    "play": ("free play", "creeping free play", "dead band"),
}
_BY_FEEDBACK = {
    ("de", "q"): ("pitch_damper", "washed_pitch_damper", "filtered_pitch_damper"),
    ("da", "p"): ("roll_damper", "filtered_roll_damper"),
    ("da", "phi"): ("bank_hold", "limited_bank_hold", "heading_hold"),
    ("dr", "r"): ("yaw_damper", "filtered_yaw_damper"),
    ("dr", "da_cmd"): ("interconnect", "late_interconnect"),
}
# What a path that is as believed rules out. Its gain, straight or curved, is not among them, as those effects stand for
# a surface that works better or worse, too; nor is play, which may lie behind what is recorded.
_RULED_OUT = (
    "lag",
    "second order",
    "delay",
    "delay and second order",
    "rate limit",
    "rate limit, another one each way",
    "dead band",
    "one-sided linkage",
)

# What a surface that drives the model would do wrong to the noise of its reading: within the play it would not move.
_RATTLING = ("free play", "creeping free play")


@dataclass(frozen=True)
class PathTerm:
    """One way in which a path differs from the believed one: kind, parameters with standard errors, and their units."""

    kind: str
    values: tuple[float, ...]
    errors: tuple[float, ...]
    units: tuple[str, ...]

    @property
    def words(self) -> str:
        """What it is, with its size."""
        size = " and ".join(
            f"{with_error(v, e)}{'' if u == '1' else f' {u}'}"
            for v, e, u in zip(self.values, self.errors, self.units, strict=True)
        )
        if self.kind.startswith("fed "):
            quantity = self.kind.split()[1]
            joined = quantity.endswith("_cmd")
            what = f"an interconnect from {quantity}" if joined else f"a feedback of {quantity}"
            return f"{what}{', washed out,' if self.kind.endswith('washed') else ''} of {size}"
        return {
            "lag": f"a servo with a corner frequency of {size}",
            "second order": f"a servo of second order with corner frequency and damping of {size}",
            "delay": f"a delay of {size}",
            "rate limit": f"a rate limit of {size}",
            "gain": f"a gain of {size}",
            "dead band": f"a dead band of {size} to either side",
            "play": f"a play of {size}",
        }[self.kind]


@dataclass(frozen=True)
class JudgedPath:
    """What the recorded surface of one control says of its path.

    Attributes:
        control: "de", "da" or "dr".
        outcome: "as believed", "differs" (the terms say how), "unexplained", "not judged" or "not seen", where its
            recorded surface drives the model and no command of it is recorded.
        terms: what differs, the most important first.
        instead: kinds that may stand in place of the first term.
        gain, threshold: fall of minus twice the log-likelihood by the terms, and what noise reaches by the first once
            in 1 / ``Criteria.false_alarm`` cases.
        left: chi-square that is left, per sample.
        samples: number of them.
        offset_rad: how far the surface stands from where the command has it in quiet flight, beyond what is believed.
        offset_error_rad: its standard error.
        why: why it is not judged, "" if it is.
        falls: kind -> fall of minus twice the log-likelihood with it alone, 0 at least.
    """

    control: str
    outcome: str
    terms: tuple[PathTerm, ...] = ()
    instead: tuple[str, ...] = ()
    gain: float = 0.0
    threshold: float = 0.0
    left: float = 1.0
    samples: int = 0
    offset_rad: float = 0.0
    offset_error_rad: float = 0.0
    why: str = ""
    falls: Mapping[str, float] = field(default_factory=dict)

    def told(self, effect: Effect) -> float:
        """Return by how much minus twice the log-likelihood of the surface falls with an effect of the library.

        All that was found counts if each term is of a kind of it, or of one of its parts; else the kind that explains
        most alone. 0 for an effect of anything else.
        """
        parts = {p.name for p in effect.singles}
        if self.terms and all(parts & set(_effects_of(self.control, t.kind)) for t in self.terms):
            return self.gain
        alone = (fall for kind, fall in self.falls.items() if parts & set(_effects_of(self.control, kind)))
        return min(max(alone, default=0.0), self.gain)

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the library's effects of the kinds that were found."""
        found = [*(t.kind for t in self.terms), *self.instead]
        return tuple(dict.fromkeys(n for kind in found for n in _effects_of(self.control, kind)))

    @property
    def ruled_out(self) -> tuple[str, ...]:
        """Names of the library's effects that a path as believed rules out; of one that is not seen, none is sought."""
        own = [n for (control, _), names in _BY_FEEDBACK.items() if control == self.control for n in names]
        clock = ["clock_offset"] if self.control == "de" else []
        kinds_out = (*_RULED_OUT, *(_RATTLING if self.outcome == "not seen" else ()))
        servo = [SERVOS[kind, self.control].name for kind in kinds_out]
        return (*servo, *own, *clock)

    @property
    def sentence(self) -> str:
        """What was found, in words."""
        word = WORDS[self.control]
        if self.outcome == "not seen":
            return (
                f"the path of the {word} could not be seen: {self.why}, so what was recorded of the {word} itself "
                "drives the model. Lag, rate limit, delay, dead band and play of its servo, and what is fed back or "
                "joined to its command, do not show in these records and are not sought"
            )
        if self.outcome == "not judged":
            return f"the path of the {word} was not judged by itself: {self.why}"
        head = f"the {word}'s path by itself, from recorded command to recorded surface,"
        noise = f"noise alone reaches {self.threshold:.3g} once in {1.0 / CRITERIA.false_alarm:.0f} cases"
        offset = ""
        if abs(self.offset_rad) > max(CRITERIA.sure * self.offset_error_rad, CRITERIA.offset_rad):
            size = with_error(self.offset_rad, self.offset_error_rad)
            offset = f"; the surface stands {size} rad from where the command has it, or its sensor's zero is off"
        if self.outcome == "as believed":
            return f"{head} is as believed, so no effect of that path is sought ({noise}){offset}"
        if not self.terms:
            return f"{head} leaves {self.left:.3g} times the noise, which none of its effects explains{offset}"
        told = " beside ".join(t.words for t in self.terms)
        instead = f"; {' or '.join(self.instead)} would do as well" if self.instead else ""
        rest = f"; {self.left:.3g} times the noise is left" if self.outcome == "unexplained" else ""
        return f"{head} shows {told}: it gains {self.gain:.0f} ({noise}){instead}{rest}{offset}"


def _effects_of(control: str, kind: str) -> tuple[str, ...]:
    if kind.startswith("fed "):
        return _BY_FEEDBACK.get((control, kind.split()[1]), ())
    names = tuple(SERVOS[k, control].name for k in _BY_KIND[kind])
    return (*names, "clock_offset") if (kind, control) == ("delay", "de") else names


def judge_paths(believed: Believed, records: Sequence[FlightRecord]) -> tuple[JudgedPath, ...]:
    """Judge the path of every control whose command and surface are both recorded and among the sensors believed.

    Raises:
        FlightAborted, LimitError, TrimError: the believed aircraft cannot fly the measured commands.
    """
    read = {s.channel for s in believed.suite.sensors}
    out = []
    for control in SURFACES:
        own = [r for r in records if control in r and f"{control}_cmd" in r and control not in surface_noise(r)]
        if own and control in read and control in believed.aircraft.controls:
            out.append(_judged(believed, control, own))
    return tuple(out)


def restricted(
    effects: Mapping[str, Effect], paths: Sequence[JudgedPath]
) -> tuple[Mapping[str, Effect], Mapping[str, Effect]]:
    """Return the effects that are sought, and those sought if these leave more than noise.

    Effects of a path that is as believed are in neither; if a path differs, those that it shows come first.
    """
    without = {n for p in paths if p.outcome in ("as believed", "not seen") for n in p.ruled_out}
    known = {n: e for n, e in effects.items() if n not in without}
    shown = {n for p in paths if p.outcome == "differs" for n in p.effects}
    first = {n: e for n, e in known.items() if n in shown}
    return (first, known) if first else (known, known)


@dataclass(frozen=True, eq=False)
class _Part:
    """One record of a path.

    Attributes:
        command, motion: what drives it, as deviations from the quiet flight.
        residual: (n,) recorded surface less that of the believed model.
        flown: (n,) that of the believed model, as a deviation from trim.
        taken: (n,) samples that were taken.
        dt_s: between samples.
        moves_on: (n,) samples after which the command moves on until the next one.
    """

    command: FloatArray
    motion: Mapping[str, FloatArray]
    residual: FloatArray
    flown: FloatArray
    taken: NDArray[np.bool_]
    dt_s: float
    moves_on: NDArray[np.bool_]

    def left(self, believed: FloatArray, path: Path) -> FloatArray:
        """Return what a path leaves of the residual beyond the ``believed`` one's surface (n,), about its mean."""
        change = path.surface(self.command, self.motion, self.dt_s, self.moves_on) - believed
        r = (self.residual - change)[self.taken]
        return np.asarray(r - r.mean())


def _judged(believed: Believed, control: str, records: Sequence[FlightRecord]) -> JudgedPath:
    if turned_by_motion(believed, control, records[0]):
        return JudgedPath(control, "not judged", why="the believed model turns it by what it measures")
    fed = _that_move(believed, control, records)
    parts, offsets = [], []
    for record in records:
        part, offset = _part(believed, control, record, tuple(fed))
        parts.append(part)
        offsets.append(offset)
    path, misfit = _believed_path(believed, control, parts)
    noise = math.hypot(max(believed.suite.noise_std[control], CRITERIA.faintest_rad), misfit)
    means, weights = np.array(offsets).T
    error = noise / math.sqrt(float(weights.sum()))
    stands_off = float(means @ weights / weights.sum())
    scatter = {n: believed.suite.noise_std.get(n, 0.0) for n in fed}
    found = _Search(path, parts, noise, scatter).run(kinds(path, fed))
    return replace(found, control=control, offset_rad=stands_off, offset_error_rad=error)


def turned_by_motion(believed: Believed, control: str, record: FlightRecord) -> bool:
    """Return whether the surface moves otherwise, about its trim, where other coefficients move the aircraft so."""
    other = believed.with_nuisances(dict.fromkeys(believed.priors_of([record]), 1.03))
    a, b = (m.flown(record, (control,))[control] for m in (believed, other))
    return bool(np.max(np.abs((a - a[0]) - (b - b[0]))) > CRITERIA.turned_rad)


def _believed_path(believed: Believed, control: str, parts: Sequence[_Part]) -> tuple[Path, float]:
    """Return the believed path as its flights show it, and the rms in rad that it leaves of them."""
    aircraft = replace(believed.aircraft, rate_hz=believed.rate_hz)
    try:
        way = control_path(aircraft, control)
        limit = declared(aircraft, way.rate_limit) if way.rate_limit else math.inf
        stated = Path(min(corner_of(aircraft, control), INSTANT), limit, believed.rate_hz)
    except ModelError:
        stated = Path(INSTANT, math.inf, believed.rate_hz)
    moving = [p for p in parts if np.ptp(p.flown) > 0.0]
    if not moving:
        return stated, 0.0

    def path(x: FloatArray) -> Path:
        """Return the path with another corner and a delay of some frames, or less, as commands act within a frame."""
        return replace(stated, corner_rad_s=float(x[0]) * stated.corner_rad_s, delay_s=float(x[1]) / believed.rate_hz)

    def left(x: FloatArray) -> FloatArray:
        """Return what the path leaves of the flights."""
        return np.concatenate([p.flown - path(x).surface(p.command, p.motion, p.dt_s, p.moves_on) for p in moving])

    starts = [np.array([1.0, frames]) for frames in (-1.0, -0.5, 0.0, 0.5, 1.0, 1.5)]
    start = min(starts, key=lambda x: float(np.sum(left(x) ** 2)))
    found = least_squares(left, start, bounds=([0.5, -2.0], [2.0, 4.0]), diff_step=1e-3, x_scale=[0.1, 0.1])
    return path(found.x), float(np.sqrt(np.mean(found.fun**2)))


def _that_move(believed: Believed, control: str, records: Sequence[FlightRecord]) -> dict[str, str]:
    """Return the quantities recorded that move by more than their noise -> the unit of a feedback's gain."""
    known = {n: u for n, u in _FED.items() if all(n in r for r in records)}
    known |= {f"{n}_cmd": "1" for n in SURFACES if n != control and all(f"{n}_cmd" in r for r in records)}
    most = {n: max(float(np.std(r[n])) for r in records) for n in known}
    return {n: u for n, u in known.items() if most[n] > max(3.0 * believed.suite.noise_std.get(n, 0.0), 1e-4)}


def _part(
    believed: Believed, control: str, record: FlightRecord, fed: Sequence[str]
) -> tuple[_Part, tuple[float, int]]:
    """Return one record of a path; and the offset of its surface in quiet flight, with the number of samples."""
    there, quiet = believed.at(record), quiet_samples(record)
    sensor = next(s for s in there.suite.sensors if s.channel == control)
    ideal = replace(there.suite, sensors=(sensor,)).without_errors().sensors[0]
    flown = there.flown(record, ideal.needs)
    stride = there.suite.check_log_rate(1.0 / flown.dt_s)
    read = ideal.respond(flown)[::stride]
    names, u = commands(record)
    taken = record.valid[:, record.channels.index(control)]
    residual = record[control] - sensor.bias - read
    motion = {n: record[n] - record[n][:quiet].mean() for n in fed}
    held = taken[:quiet]
    gone = record[control][:quiet][held] - sensor.bias - sensor.scale * record[f"{control}_cmd"][:quiet][held]
    believed_off = float(read[0]) - sensor.scale * there.trimmed.controls[control]
    command = u[:, names.index(control)]
    on = moves_on(record, control, command)
    part = _Part(command, motion, residual, read - read[0], taken, record.dt_s, on)
    return part, (float(gone.mean()) - believed_off if gone.size else 0.0, max(int(gone.size), 1))


@dataclass(frozen=True, eq=False)
class _Fit:
    """Kinds in a path with their parameters: minus twice the log-likelihood, and that of the residuals alone."""

    kinds: tuple[Kind, ...]
    x: FloatArray
    cost: float
    chi2: float
    errors: FloatArray

    def bic(self, samples: int) -> float:
        """Schwarz's criterion."""
        return self.cost + self.x.size * math.log(samples)


@dataclass(frozen=True, eq=False)
class _Search:
    """The search for what differs in one path, over its records.

    Attributes:
        believed: path.
        parts: its records.
        noise: standard deviation of the recorded surface, rad.
        scatter: quantity fed -> standard deviation of its noise, which a feedback of the record brings in.
    """

    believed: Path
    parts: Sequence[_Part]
    noise: float
    scatter: Mapping[str, float]

    @property
    def samples(self) -> int:
        """Number of samples."""
        return sum(int(p.taken.sum()) for p in self.parts)

    def run(self, known: Sequence[Kind]) -> JudgedPath:
        """Add kinds while the likelihood asks for them."""
        n = self.samples
        none = float(np.sum(self._left(self.believed) ** 2))
        noise_limit = float(chi2.isf(CRITERIA.false_alarm, n - len(self.parts)))
        here = _Fit((), np.zeros(0), none, none, np.zeros(0))
        first = [f for f in (self._fit(here, k) for k in known) if f is not None]
        threshold = self._threshold(known, 1)
        best = here
        instead: tuple[str, ...] = ()
        for step in range(_MOST):
            tried = first if step == 0 else [f for k in self._beside(best, known) if (f := self._fit(best, k))]
            following = min(tried, key=lambda f: f.bic(n), default=None)
            if following is None:
                break
            more = best.cost - following.cost
            if more <= self._threshold(known, following.x.size - best.x.size):
                break
            if step and (best.chi2 <= noise_limit or more <= CRITERIA.path_form * (none - best.cost)):
                break
            best = following
        if best.kinds:
            lead = min(first, key=lambda f: f.bic(n))
            form = 0.0 if lead.chi2 <= noise_limit else CRITERIA.path_form * (none - lead.cost)
            near = max(CRITERIA.told_apart, form)
            if len(best.kinds) == 1:
                instead = tuple(f.kinds[0].name for f in first if f is not lead and f.bic(n) - lead.bic(n) < near)
        gain = none - best.cost
        explained = gain >= CRITERIA.enough * (none - n)
        if best.kinds:
            outcome = "differs" if best.chi2 <= noise_limit or explained else "unexplained"
        else:
            outcome = "as believed" if none <= noise_limit else "unexplained"
        terms = self._terms(best)
        falls = {f.kinds[0].name: max(none - f.cost, 0.0) for f in first}
        return JudgedPath("", outcome, terms, instead, gain, threshold, best.chi2 / n, n, falls=falls)

    def _threshold(self, known: Sequence[Kind], parameters: int) -> float:
        return max(float(chi2.isf(CRITERIA.false_alarm / len(known), parameters)), CRITERIA.least)

    def _beside(self, fit: _Fit, known: Sequence[Kind]) -> list[Kind]:
        """Return the kinds that may stand beside those of a fit: not twice the same, nor one servo beside another."""
        names = {k.name for k in fit.kinds}
        servo = bool(names & {"lag", "second order"})
        fed = {n.split()[1] for n in names if n.startswith("fed ")}
        return [
            k
            for k in known
            if k.name not in names
            and not (servo and k.name in ("lag", "second order"))
            and not (k.name.startswith("fed ") and k.name.split()[1] in fed)
        ]

    def _left(self, path: Path) -> FloatArray:
        """Return what a path leaves, in units of the noise."""
        both = zip(self.parts, self._as_believed, strict=True)
        return np.concatenate([part.left(surface, path) for part, surface in both]) / self.noise

    @cached_property
    def _as_believed(self) -> list[FloatArray]:
        return [self.believed.surface(p.command, p.motion, p.dt_s, p.moves_on) for p in self.parts]

    def _path(self, fitted: Sequence[Kind], x: FloatArray) -> Path:
        path, at = self.believed, 0
        for kind in fitted:
            path = kind.put_in(path, x[at : at + len(kind.low)])
            at += len(kind.low)
        return path

    def _fit(self, beside: _Fit, kind: Kind) -> _Fit | None:
        """Return the best fit of a kind beside others; None if it changes nothing."""
        together = (*beside.kinds, kind)
        low = np.array([v for k in together for v in k.low])
        high = np.array([v for k in together for v in k.high])
        best: _Fit | None = None
        starts = [np.clip(np.concatenate([beside.x, start]), low + 1e-9, high - 1e-9) for start in kind.starts]
        starts.sort(key=lambda x: float(np.sum(self._left(self._path(together, x)) ** 2)))
        for x0 in starts[:_STARTS]:
            scale = np.maximum(np.abs(x0), 1e-3)
            found = least_squares(
                lambda x: self._left(self._path(together, x)),
                x0,
                bounds=(low, high),
                x_scale=scale,
                diff_step=1e-3,
                ftol=1e-6,
                xtol=1e-5,
                max_nfev=40,
            )
            r2 = float(2.0 * found.cost)
            if best is not None and best.chi2 <= r2:
                continue
            inflated = self._inflation(self._path(together, found.x))
            normal = found.jac.T @ found.jac
            spread = max(1.0, r2 / inflated / max(self.samples - found.x.size, 1)) * inflated
            errors = np.sqrt(np.maximum(np.diag(np.linalg.pinv(normal)), 0.0) * spread)
            best = _Fit(together, found.x, r2 / inflated + self.samples * math.log(inflated), r2 / inflated, errors)
        return best

    def _inflation(self, path: Path) -> float:
        """Return by how much the noise of fed quantities adds to the variance of the residual, as a factor."""
        dt_s = self.parts[0].dt_s
        a = math.exp(-min(path.corner_rad_s, 1e3) * dt_s)
        passed = 0.5 * (1.0 - a) ** 2 * (1.0 + a) / (1.0 - a * a)  # the mean of two samples through the lag
        added = sum((k * self.scatter.get(n, 0.0)) ** 2 for n, k in path.fed.items())
        return 1.0 + passed * added / self.noise**2

    def _terms(self, fit: _Fit) -> tuple[PathTerm, ...]:
        out, at = [], 0
        for kind in fit.kinds:
            own = slice(at, at + len(kind.low))
            values, errors = (tuple(float(v) for v in a[own]) for a in (fit.x, fit.errors))
            out.append(PathTerm(kind.name, values, errors, kind.units))
            at += len(kind.low)
        return tuple(out)
