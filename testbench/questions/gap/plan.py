"""Before flight: which effects could these manoeuvres show, and which could they not tell apart?

Every effect of the library leaves a signature d: the change of all predicted outputs in units of their noise, less what
re-tuned coefficients can imitate. |d|^2 is the noncentrality of the test that would find the effect. The share of |d|^2
that another effect can imitate, with all of its own signatures, says how alike the two are. What is left, |d|^2 (1 -
share), is the noncentrality of the test that would tell them apart. Nothing is flown with noise, and nothing is fitted:
this is the isolability of fault diagnosis (E. Frisk and M. Krysander) for effects and flights.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import product
from operator import add

import numpy as np

from testbench.core.channels import CONTROLS
from testbench.core.constants import DEG_RAD, PERCENT
from testbench.core.errors import LimitError, TrimError, located
from testbench.core.record import FlightAborted, FlightRecord, FloatArray
from testbench.core.scenario.base import Manoeuvre
from testbench.core.scenario.inputs import Doublet, Input, Pulse, StandardMultistep, Sweep
from testbench.effects import Effect, library
from testbench.flight import load_aircraft
from testbench.inputs import build
from testbench.line import condition_of
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.drive import comparing
from testbench.questions.gap.evidence.commanded import commands, quiet_samples, starts_freely
from testbench.questions.gap.evidence.compared import not_compared
from testbench.questions.gap.explain import Explanation
from testbench.questions.gap.search.hypothesis import Hypothesis, changes
from testbench.questions.run.scenario import Scenario
from testbench.sensors import load_suite

# The threshold that tells two effects apart, 2 ln(1 / FALSE_ALARM), passed with a probability of 0.9.
_QUIET_S = 2.0  # before a manoeuvre that is added to records without quiet flight: that of scenarios
NEEDED = float((np.sqrt(2.0 * np.log(1.0 / CRITERIA.false_alarm)) + 1.2816) ** 2)
ALIKE = 0.9  # from this share on, two effects are told apart by the details of their form alone
_MOST_STARTS = 4
# Airspeeds of manoeuvres that may be added, as shares of the planned one; how far from those flown they must be; and
# how far within the limits of the aircraft, as manoeuvres change the airspeed.
_SPEEDS, _NEW_SPEED, _CLEAR = (1.25, 0.85), 0.1, 1.1
_AT_OTHER_SPEEDS = ("elevator 3211", "rudder 3211", "aileron doublet")
_UNSEEN = 1e-6


@dataclass(frozen=True, eq=False)
class Isolability:
    """What a set of manoeuvres could show.

    Attributes:
        effects: all effects of the library.
        noncentrality: (k,) of each effect at its usual size, the first of its starts.
        share: (k, k) share of effect i's signature that effect j can imitate; 1 on the diagonal, NaN for unseen i.
    """

    effects: tuple[Effect, ...]
    noncentrality: FloatArray
    share: FloatArray

    @property
    def unseen(self) -> tuple[Effect, ...]:
        """Effects that these manoeuvres would not show at their usual size."""
        return tuple(e for e, n in zip(self.effects, self.noncentrality, strict=True) if n < NEEDED)

    @property
    def left(self) -> FloatArray:
        """Noncentrality (k, k) of the test that tells effect i from j."""
        return np.asarray(self.noncentrality[:, None] * (1.0 - self.share))

    @property
    def closest(self) -> float:
        """The least noncentrality between any two effects."""
        left = np.where(np.eye(len(self.effects), dtype=bool), np.inf, np.nan_to_num(self.left))
        return float(left.min())

    def confused(self) -> list[tuple[Effect, Effect, float, float]]:
        """Return (effect, what it would be taken for, share, noncentrality left), the worst first.

        Only effects that would be seen; those that leave less than NEEDED, or are alike by more than ALIKE.
        """
        out = []
        for i, e in enumerate(self.effects):
            if self.noncentrality[i] < NEEDED:
                continue
            for j, other in enumerate(self.effects):
                if i != j and (self.left[i, j] < NEEDED or self.share[i, j] > ALIKE):
                    out.append((e, other, float(self.share[i, j]), float(self.left[i, j])))
        return sorted(out, key=lambda row: row[3])

    @property
    def inseparable(self) -> int:
        """Number of ordered pairs that would be seen and not told apart."""
        return sum(row[3] < NEEDED for row in self.confused())

    @property
    def nameable(self) -> tuple[Effect, ...]:
        """Effects that would be seen and told from every other one."""
        lost = {e.name for e in self.unseen} | {row[0].name for row in self.confused() if row[3] < NEEDED}
        return tuple(e for e in self.effects if e.name not in lost)


@dataclass(frozen=True, eq=False)
class Addition:
    """A manoeuvre that could be added, and what would be left unseen and inseparable with it."""

    name: str
    words: str
    with_it: Isolability


@dataclass(frozen=True, eq=False)
class GapPlan:
    """The isolability of planned manoeuvres and what adding one of a small family would change.

    Attributes:
        scenario: the scenario.
        believed: aircraft, sensors and condition.
        manoeuvres: names of those planned.
        planned: what they could show.
        additions: best first.
        skipped: additions that the believed aircraft cannot fly, with the reason.
    """

    scenario: Scenario
    believed: Believed
    manoeuvres: tuple[str, ...]
    planned: Isolability
    additions: tuple[Addition, ...]
    skipped: Mapping[str, str]

    @property
    def sentences(self) -> tuple[str, ...]:
        """The answer in words."""
        found = self.planned
        count, seen = len(found.effects), len(found.effects) - len(found.unseen)
        out = [
            f"of {count} effects of the library at their usual sizes, these manoeuvres would show {seen} and tell "
            f"{len(found.nameable)} of them from every other one"
        ]
        pairs = [f"{a.title} for {b.title}" for a, b, _, left in found.confused() if left < NEEDED]
        if pairs:
            more = f", and {len(pairs) - 3} more" if len(pairs) > 3 else ""
            out.append(f"they could mistake {'; '.join(pairs[:3])}{more}")
        if found.unseen:
            out.append(f"they would not show {', '.join(e.title for e in found.unseen)}")
        best = self.additions[0] if self.additions else None
        if best is None or len(best.with_it.nameable) <= len(found.nameable):
            out.append("no manoeuvre that was tried would add an effect that can be named")
        else:
            had = {e.name for e in found.nameable}
            gained = [e.title for e in best.with_it.nameable if e.name not in had]
            out.append(f"fly {best.words} as well: {', '.join(gained)} could then be named")
        return (*out, *not_compared(self.believed.suite))


def plan_gap(scenario: Scenario, progress: Callable[[str], None] | None = None) -> GapPlan:
    """Return what the manoeuvres of a scenario could show of the effects of the library, and what to add.

    The first suite of the scenario is believed. If it logs no commands, they are known all the same.

    Raises:
        ScenarioError, ModelError: aircraft or suite cannot be read.
        FlightAborted, TrimError, LimitError: the believed aircraft cannot fly the manoeuvres.
    """
    say = progress or (lambda text: None)
    aircraft, suite = load_aircraft(scenario.aircraft, scenario.wings), load_suite(scenario.suites[0])
    rate = scenario.simulation.rate_hz or aircraft.rate_hz
    with located(None, f"sensors '{suite.name}'"):
        believed = comparing(Believed(aircraft, suite, condition_of(scenario.condition), rate))
    effects = tuple(e for e in library(suite, aircraft).values() if e.met is None)  # nobody plans to meet a gust
    records = [as_record(believed, spec) for spec in scenario.manoeuvre]
    priors = believed.priors_of(records)
    parts = []
    for spec, record in zip(scenario.manoeuvre, records, strict=True):
        say(f"signatures in {spec.name}")
        parts.append(Grams.of(believed, record, effects, priors=priors))
    total = sum_of(parts)
    additions, skipped = [], {}
    for there, spec, words in candidates(believed, scenario.manoeuvre):
        say(f"what {spec.name} would add")
        try:
            grams = Grams.of(there, as_record(there, spec), effects, priors=priors)
        except (FlightAborted, LimitError, TrimError) as error:
            skipped[words] = str(error)
            continue
        additions.append(Addition(spec.name, words, (total + grams).isolability(effects)))
    additions.sort(key=lambda a: _worth(a.with_it), reverse=True)
    names = tuple(m.name for m in scenario.manoeuvre)
    return GapPlan(scenario, believed, names, total.isolability(effects), tuple(additions), skipped)


def _worth(found: Isolability) -> tuple[int, int, int]:
    """Return what is to be made large: effects named, effects seen, confusions avoided."""
    return len(found.nameable), -len(found.unseen), -found.inseparable


def as_record(believed: Believed, spec: Manoeuvre) -> FlightRecord:
    """Return a record with the commands of a planned manoeuvre, from the believed trim; its outputs are zero."""
    dt = 1.0 / believed.suite.rate_hz
    signal = build(spec.input, spec.duration_s, believed.suite.rate_hz)
    quiet = max(round(spec.settle_s / dt), round(1.0 / dt))
    trim = believed.trimmed.controls
    names = tuple(n for n in CONTROLS if n in trim)
    u = np.tile([trim[n] for n in names], (quiet + signal.u.shape[0], 1))
    for i, name in enumerate(signal.channels):
        u[quiet:, names.index(name)] += signal.u[:, i]
    data = np.hstack([np.zeros((len(u), len(believed.outputs))), u])
    valid = np.ones(data.shape, bool)
    own_hz = {s.channel: s.rate_hz or believed.suite.rate_hz for s in believed.suite.sensors}
    for i, name in enumerate(believed.outputs):  # a slow sensor takes few samples
        valid[:, i] = np.arange(len(u)) % round(believed.suite.rate_hz / own_hz[name]) == 0
    channels = (*believed.outputs, *(f"{n}_cmd" for n in names))
    t = np.arange(len(u), dtype=np.float64) * dt
    return FlightRecord(t_s=t, channels=channels, data=data, kind="measured", valid=valid)


@dataclass(frozen=True, eq=False)
class Grams:
    """Inner products of signatures; those of several manoeuvres add up.

    Attributes:
        G: (c + k, c + k) of c signatures and the k nuisances' tangents.
        columns: effect -> its columns, the usual size first; none if nothing of it flies.
        priors: nuisance -> relative standard deviation of its prior; the same in all that are added up.
    """

    G: FloatArray
    columns: tuple[tuple[int, ...], ...]
    priors: Mapping[str, float]

    @classmethod
    def of(
        cls,
        believed: Believed,
        record: FlightRecord,
        effects: Sequence[Effect],
        sizes: Mapping[str, Sequence[float]] | None = None,
        priors: Mapping[str, float] | None = None,
    ) -> Grams:
        """Return the inner products in one manoeuvre.

        Args:
            believed: aircraft, sensors and condition.
            record: with the commands.
            effects: whose signatures.
            sizes: effect -> parameter values that take the place of its usual size.
            priors: nuisance -> relative deviation of its prior; if not given, those that this
                manoeuvre asks for.

        Raises:
            FlightAborted, TrimError, LimitError: the believed aircraft cannot fly it.
        """
        base = Hypothesis.at(believed, believed, (record,), priors=priors)
        signatures: list[FloatArray] = []
        columns = []
        for effect in effects:
            starts = list(product(*(p.starts for p in effect.parameters)))[:_MOST_STARTS]
            if sizes is not None and effect.name in sizes:
                starts = [tuple(sizes[effect.name]), *starts]
            hidden = effect.lateral and not base.lateral
            found = [None] * len(starts) if hidden else changes(base, [(effect, np.array(x)) for x in starts])
            columns.append(tuple(range(len(signatures), len(signatures) + len(found))))
            # A start that cannot fly leaves nothing: the same columns must stand for the same starts everywhere.
            signatures += [np.zeros(base.exact.size) if d is None else d for d in found]
        S = np.column_stack([*signatures, base.tangents])
        return cls(S.T @ S, tuple(columns), base.priors)

    def __add__(self, other: Grams) -> Grams:
        return Grams(self.G + other.G, self.columns, self.priors)

    def isolability(self, effects: Sequence[Effect]) -> Isolability:
        """Return what these manoeuvres could show, nuisances re-tuned within their priors."""
        k = len(self.priors)
        prior = np.diag([1.0 / s**2 for s in self.priors.values()])
        nuisance, mixed = self.G[-k:, -k:] + prior, self.G[:-k, -k:]
        A = self.G[:-k, :-k] - mixed @ np.linalg.solve(nuisance, mixed.T)
        first = np.array([c[0] for c in self.columns])
        size = np.maximum(A[first, first], 0.0)
        share = np.full((len(effects), len(effects)), np.nan)
        for j, own in enumerate(np.array(c) for c in self.columns):
            values, vectors = np.linalg.eigh(A[np.ix_(own, own)])
            keep = values > 1e-9 * max(values[-1], _UNSEEN)
            projected = A[np.ix_(first, own)] @ (vectors[:, keep] / np.sqrt(values[keep]))
            share[:, j] = np.sum(projected**2, axis=1)
        share = np.where(size[:, None] > _UNSEEN, share / np.maximum(size, _UNSEEN)[:, None], np.nan)
        return Isolability(tuple(effects), size, np.clip(share, 0.0, 1.0))


def separate(believed: Believed, records: Sequence[FlightRecord], fits: Sequence[Explanation]) -> str:
    """Return, in words, which manoeuvre would tell apart effects that ``records`` do not.

    Each of a family of manoeuvres is added to the records in turn. The best one brings the two effects that are most
    alike at their fitted sizes furthest apart.
    """
    effects = [f.effect for f in fits]
    sizes = {f.effect.name: list(f.values.values()) for f in fits}
    plain = replace(believed, whiten=None)
    priors = believed.priors_of(records)
    flown = sum_of([Grams.of(plain, r, effects, sizes, priors) for r in records])
    quiet = max((quiet_samples(r) * r.dt_s for r in records if not starts_freely(r)), default=_QUIET_S)
    best, words = 0.0, ""
    for there, spec, text in candidates(plain, (), records):
        try:
            added = as_record(there, spec.model_copy(update={"settle_s": quiet}))
            grams = Grams.of(there, added, effects, sizes, priors)
        except (FlightAborted, LimitError, TrimError):
            continue
        apart = (flown + grams).isolability(effects).closest
        if apart > best:
            best, words = apart, text
    now = flown.isolability(effects).closest
    if best < NEEDED:
        return (
            f"no manoeuvre that was tried would separate them (noncentrality {best:.3g} at most, {NEEDED:.0f} "
            f"needed); what would separate them: {effects[0].separated_by}"
        )
    return (
        f"fly next: {words}; it raises the noncentrality between the two most alike from {now:.3g} to {best:.3g} "
        f"({NEEDED:.0f} needed)"
    )


def sum_of(grams: Sequence[Grams]) -> Grams:
    """Return the inner products over several manoeuvres."""
    return reduce(add, grams)


def candidates(
    believed: Believed, planned: Sequence[Manoeuvre], flown: Sequence[FlightRecord] = ()
) -> list[tuple[Believed, Manoeuvre, str]]:
    """Return what may be added: the belief where it is flown, a manoeuvre of the :func:`family`, and words for it.

    Some of the family are also flown at another airspeed: the moment of a damper grows with its square and that of
    Cm_q with the airspeed itself, so that no manoeuvre at one airspeed separates them. Airspeeds that were flown, and
    those near or beyond the limits of the aircraft, are left out.
    """
    here = family(believed, planned, flown)
    out = [(believed, spec, words) for spec, words in here]
    known = [believed.condition.V_m_s, *(b.condition.V_m_s for b in believed.at_each(flown))]
    low, high = believed.aircraft.limits.get("V", (0.0, np.inf))
    for share in _SPEEDS:
        V = float(f"{share * believed.condition.V_m_s:.3g}")
        if any(abs(V / v - 1.0) < _NEW_SPEED for v in known) or not _CLEAR * low <= V <= high / _CLEAR:
            continue
        there = replace(believed, condition=replace(believed.condition, V_m_s=V))
        out += [
            (there, spec.model_copy(update={"name": f"{spec.name} at {V:g} m per s"}), f"{words}, at {V:g} m/s")
            for spec, words in here
            if spec.name in _AT_OTHER_SPEEDS
        ]
    return out


def family(
    believed: Believed, planned: Sequence[Manoeuvre], flown: Sequence[FlightRecord] = ()
) -> list[tuple[Manoeuvre, str]]:
    """Return manoeuvres that may be added, each with words for it, as large as the largest that is planned or flown.

    Manoeuvres of aileron and rudder are among them only if one of these is planned or was flown.
    """
    rate = believed.suite.rate_hz
    largest = {"de": 2.0 * DEG_RAD, "da": 2.0 * DEG_RAD, "dr": 2.0 * DEG_RAD, "thr": 10.0 * PERCENT}
    moves = [build(spec.input, spec.duration_s, rate) for spec in planned]
    sizes = [(s.channels, s.u) for s in moves] + [commands(r) for r in flown]
    lateral = False
    for names, u in sizes:
        for name, column in zip(names, u.T, strict=True):
            if name in largest:
                size = float(np.max(np.abs(column)))
                largest[name] = max(largest[name], size)
                lateral = lateral or (name in ("da", "dr") and size > 1e-3)
    de, thr = largest["de"] / DEG_RAD, largest["thr"] / PERCENT
    fast = min(10.0, 0.1 * rate)  # a sweep whose samples are held goes no higher
    throttle = Doublet(signal="doublet", control="thr", amplitude_percent=thr, period_s=6.0)
    out: list[tuple[str, float, tuple[Input, ...], str]] = [
        (
            "elevator 3211",
            12.0,
            (StandardMultistep(signal="3211", control="de", amplitude_deg=de, step_s=0.4),),
            f"an elevator 3-2-1-1 of {de:.3g} deg with steps of 0.4 s",
        ),
        (
            "elevator sweep",
            20.0,
            (Sweep(signal="sweep", control="de", amplitude_deg=de, f_start_hz=0.5, f_end_hz=fast, sweep_s=18.0),),
            f"an elevator sweep of {de:.3g} deg from 0.5 to {fast:.3g} Hz",
        ),
        (
            "small elevator doublets",
            12.0,
            (Doublet(signal="doublet", control="de", amplitude_deg=0.25 * de, period_s=0.4, repeats=4, spacing_s=2.0),),
            f"short elevator doublets of a quarter of the amplitude, {0.25 * de:.2g} deg",
        ),
        ("throttle doublet", 20.0, (throttle,), f"a throttle doublet of {thr:.3g} % with a period of 6 s"),
        (
            "throttle and elevator",
            20.0,
            (
                throttle,
                Doublet(signal="doublet", control="de", amplitude_deg=de, period_s=1.0, repeats=4, spacing_s=3.0),
            ),
            "throttle and elevator doublets at once",
        ),
        (
            "slow pull",
            15.0,
            (Pulse(signal="pulse", control="de", amplitude_deg=-0.6 * de, width_s=4.0),),
            f"an elevator pulse of {0.6 * de:.2g} deg nose up, held for 4 s",
        ),
    ]
    out += _lateral_family(largest["da"] / DEG_RAD, largest["dr"] / DEG_RAD) if lateral else []
    controls = believed.aircraft.controls
    return [
        (Manoeuvre(name=name, use="identification", duration_s=duration, input=spec), words)
        for name, duration, spec, words in out
        if all(s.control in controls for s in spec)
    ]


def _lateral_family(da: float, dr: float) -> list[tuple[str, float, tuple[Input, ...], str]]:
    """Return manoeuvres of aileron and rudder, amplitudes in deg: name, duration, inputs, words."""
    rudder = StandardMultistep(signal="3211", control="dr", amplitude_deg=dr, step_s=0.5)
    aileron = Doublet(signal="doublet", control="da", amplitude_deg=da, period_s=1.6)
    short = Doublet(signal="doublet", control="dr", amplitude_deg=dr, period_s=0.4, repeats=3, spacing_s=2.0)
    bank = Pulse(signal="pulse", control="da", amplitude_deg=0.5 * da, width_s=1.0)
    return [
        ("rudder 3211", 12.0, (rudder,), f"a rudder 3-2-1-1 of {dr:.3g} deg with steps of 0.5 s"),
        ("aileron doublet", 12.0, (aileron,), f"an aileron doublet of {da:.3g} deg with a period of 1.6 s"),
        ("short rudder doublets", 12.0, (short,), f"short rudder doublets of {dr:.3g} deg"),
        ("turn", 20.0, (bank,), f"an aileron pulse of {0.5 * da:.2g} deg for 1 s into a turn, held for 18 s"),
    ]
