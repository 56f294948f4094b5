"""THE table of strata, and the cases that are drawn by it from one seed, sealed before anything is named.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

import hashlib
import json
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace

import numpy as np
from studies.blind.flights import fly_truth, suite
from studies.blind.kinds import KINDS, Kind, parameter_errors
from studies.blind.truth import Truth
from studies.blind.truths import TRUTHS

from testbench.core.errors import LimitError, TrimError
from testbench.core.record import FlightAborted, FlightRecord

TURBULENCE_RMS_M_S = 0.25


@dataclass(frozen=True)
class Stratum:
    """One row of the table.

    Attributes:
        hides: "library" or "other" forms, "unseen" ones, a "pair", "small" or "inseparable" library forms, or "" for
            nothing.
        count: of cases.
        rms_m_s: of the turbulence.
    """

    hides: str
    count: int = 36
    rms_m_s: float = 0.0


STRATA: Mapping[str, Stratum] = {
    "library form": Stratum("library"),
    "other form": Stratum("other"),
    "unseen": Stratum("unseen", 30),
    "nothing": Stratum("", 30),
    "nothing in turbulence": Stratum("", 30, rms_m_s=TURBULENCE_RMS_M_S),
    "turbulence": Stratum("library", 30, rms_m_s=TURBULENCE_RMS_M_S),
    "two at once": Stratum("pair", 30),
    "below detectability": Stratum("small", 30),
    "inseparable": Stratum("inseparable", 30),
}


COUNTS = {name: s.count for name, s in STRATA.items()}

# What is also run of some cases, by the end of the row's name: without the true effect in the library, and naming on
# the set "short" alone.
WITHOUT, SHORT = ", true effect taken out", ", two manoeuvres"
# Sizes below detectability are so much of the drawn ones, counted from no effect, and halved further until they change
# the readings, in units of the noise and summed in squares over all records, by no more than this: so little that who
# knew all else would miss it, as the least that a test of 38 effects at 1e-3 finds is 18.
_TINY, _UNSEEN, _NONE = 0.02, 9.0, 1e-6
# Pairs of effects that fly in two different parts of the aircraft.
_PAIRS = (
    ("slow servo", "vane gain"), ("late link", "airspeed lag"), ("slew limit", "vane lag"), ("play", "slow motor"),
    ("linkage ratio", "late attitude"), ("high thrust", "slow servo"), ("ballast", "vane lag"),
    ("roughness", "late link"), ("slipstream", "late attitude"), ("rate feedback", "vane gain"),
    ("separation", "slow servo"), ("alpha-dot moment", "airspeed lag"), ("effectiveness with speed", "gyro gain"),
    ("boom", "slow motor"), ("sleepy servo", "accelerometer ahead"),
)  # fmt: skip
# Kinds whose small sizes the believed coefficients take up within their priors, and names that say the same thing.
_INSEPARABLE: Mapping[str, tuple[tuple[float, float], str, tuple[str, ...]]] = {
    "linkage ratio": ((0.90, 1.12), "gain", ("surface_scale",)),
    "shifted centre of gravity": ((-0.006, 0.006), "aft_chords", ("cg_shift", "payload")),
    "alpha-dot moment": ((-2.0, -0.5), "cm", ("alpha_dot", "wake_lag", "pitch_damper")),
    "rate feedback": ((0.005, 0.02), "gain_s", ("pitch_damper", "alpha_dot", "wake_lag")),
    "roughness": ((0.001, 0.003), "CD0", ("drag_increment",)),
    "bent lift line": ((-1.0, 1.0), "curve", ("nonlinear_lift", "stall", "stall_hysteresis")),
}


@dataclass(frozen=True)
class Case:
    """One case: everything that is hidden.

    Attributes:
        name: stratum and number.
        stratum: one of STRATA.
        aircraft: its name.
        kinds: kinds of hidden truth; none for "nothing".
        sizes: sizes of each kind.
        factors: what the true coefficients are times the believed ones.
        right: for each kind, the names that are right.
        turbulence_rms_m_s: of the air.
        seed: of noise and turbulence.
        near: whether a kind that the library does not hold resembles one that it does.
    """

    name: str
    stratum: str
    aircraft: str
    kinds: tuple[str, ...]
    sizes: tuple[Mapping[str, float], ...]
    factors: Mapping[str, float]
    right: tuple[tuple[str, ...], ...]
    turbulence_rms_m_s: float = 0.0
    seed: int = 0
    near: bool = False

    @property
    def truth(self) -> Truth:
        """What flies."""
        truth = Truth(factors=self.factors)
        for kind, sizes in zip(self.kinds, self.sizes, strict=True):
            truth = truth.with_(TRUTHS[kind](sizes, self.aircraft))
        return truth

    def fly(self, which: str) -> dict[str, FlightRecord]:
        """Fly the truth through a set of manoeuvres ("rich", "short", "held_out")."""
        offset = {"rich": 0, "short": 500_000, "held_out": 1_000_000}[which]
        return fly_truth(self.aircraft, self.truth, which, self.seed + offset, self.turbulence_rms_m_s)


def draw(seed: int, counts: Mapping[str, int]) -> tuple[Case, ...]:
    """Draw so many cases of every stratum, in an order that begins with the first of each."""
    drawn = {stratum: [draw_case(stratum, i, seed) for i in range(n)] for stratum, n in counts.items()}
    most = max(counts.values())
    return tuple(cases[i] for i in range(most) for cases in drawn.values() if i < len(cases))


def seal(cases: tuple[Case, ...]) -> tuple[str, str]:
    """Return the answers as JSON and their SHA-256."""
    text = json.dumps([asdict(c) for c in cases], indent=1, sort_keys=True)
    return text, hashlib.sha256(text.encode()).hexdigest()


def opened(text: str) -> tuple[Case, ...]:
    """Return the cases of a sealed text."""
    return tuple(
        Case(**{**c, "kinds": tuple(c["kinds"]), "sizes": tuple(c["sizes"]), "right": tuple(map(tuple, c["right"]))})
        for c in json.loads(text)
    )


def draw_case(stratum: str, i: int, seed: int, kind: str = "") -> Case:
    """Return case ``i`` of a stratum, or one of a given kind: the first of at most ten draws that flies all it must.

    Raises:
        LimitError: none of them does.
    """
    for attempt in range(10):
        rng = np.random.default_rng(np.random.SeedSequence([seed, zlib.crc32(stratum.encode()), i, attempt]))
        try:
            case = _case(stratum, i, rng, kind)
            case = _undetectable(case) if STRATA[stratum].hides == "small" else case
            case.fly("rich")
            case.fly("held_out")
        except (FlightAborted, LimitError, TrimError):
            continue
        return case
    raise LimitError(f"a case must fly within ten draws, '{stratum}' number {i} of seed {seed} did not")


def _undetectable(case: Case) -> Case:
    """Return the case with sizes so small that its records do not show them."""

    def shrunk(scale: float) -> Case:
        return replace(case, sizes=tuple(_shrunk(s, scale) for s in case.sizes))

    without, scale = shrunk(_NONE).fly("rich"), _TINY
    while sum(_energy(r, without[n]) for n, r in shrunk(scale).fly("rich").items()) > _UNSEEN:
        scale *= 0.5
    return shrunk(scale)


def _energy(a: FlightRecord, b: FlightRecord) -> float:
    """Return the sum of squares of what two records of one seed differ by, about the mean, in units of the noise."""
    noise = suite().noise_std
    names = [n for n in a.channels if noise.get(n, 0.0) > 0.0]
    d = (a.columns(names) - b.columns(names)) / np.array([noise[n] for n in names])
    return float(np.sum((d - d.mean(axis=0)) ** 2))


def _case(stratum: str, i: int, rng: np.random.Generator, kind: str) -> Case:
    row = STRATA[stratum]
    aircraft = "eolo" if rng.random() < 0.5 else "taurus"
    kinds = (kind,) if kind else _chosen(stratum, i, rng)
    if "flexible wings" in kinds:
        aircraft = "eolo"
    sizes: list[Mapping[str, float]] = [KINDS[k].draw(rng) for k in kinds]
    right = [KINDS[k].names for k in kinds]
    if row.hides == "inseparable":
        (low, high), size, names = _INSEPARABLE[kinds[0]]
        sizes, right = [{**sizes[0], size: float(rng.uniform(low, high))}], [names]
    return Case(
        name=f"{stratum} {i + 1}",
        stratum=stratum,
        aircraft=aircraft,
        kinds=kinds,
        sizes=tuple(sizes),
        factors=parameter_errors(rng),
        right=tuple(right),
        turbulence_rms_m_s=row.rms_m_s,
        seed=int(rng.integers(1, 2**31 - 10**7)),
        near=any(KINDS[k].near for k in kinds),
    )


def _chosen(stratum: str, i: int, rng: np.random.Generator) -> tuple[str, ...]:
    """Return the kinds of case ``i`` of a stratum: all that suit it in turn, in an order of its own."""
    hides = STRATA[stratum].hides
    if not hides:
        return ()
    if hides == "pair":
        return _PAIRS[i % len(_PAIRS)]
    if hides == "inseparable":
        return (tuple(_INSEPARABLE)[i % len(_INSEPARABLE)],)
    form = "library" if hides == "small" else hides
    if stratum == "turbulence" and rng.random() < 0.5:
        form = "other"
    names = [n for n, k in KINDS.items() if k.form == form and (hides != "small" or _can_shrink(k))]
    order = np.random.default_rng(zlib.crc32(stratum.encode())).permutation(len(names))
    return (names[order[i % len(names)]],)


_FROM_ONE = ("gain",)
_FROM_ZERO = (
    "delay_s",
    "lag_s",
    "width_rad",
    "half_rad",
    "z_m",
    "k",
    "ratio",
    "CD0",
    "gain_s",
    "curve",
    "ahead_m",
    "Cm",
)


def _can_shrink(kind: Kind) -> bool:
    return any(n in (*_FROM_ONE, *_FROM_ZERO) for n in kind.draw(np.random.default_rng(0)))


def _shrunk(sizes: Mapping[str, float], scale: float) -> dict[str, float]:
    """Return sizes with those that count from one or zero shrunk to a share of what they are."""
    out = {}
    for name, x in sizes.items():
        if name in _FROM_ONE:
            out[name] = 1.0 + scale * (x - 1.0)
        elif name in _FROM_ZERO:
            out[name] = scale * x
        else:
            out[name] = x
    return out
