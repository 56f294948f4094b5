"""The result of operational modal analysis: modes with errors, the poles of every order, and doubts.

Doubts about modes that were found from outputs alone, in words.

Poles that return order after order: the criteria, the modes to which they belong, and one estimate of each.

A pole of order n is stable if a pole of the order before has frequency, damping ratio and mode shape within the
criteria of it. Stable poles that follow each other, and chains of them with gaps between that agree within the same
criteria, are one mode; modes stable at fewer orders than asked are not reported (F. Magalhaes, A. Cunha and E. Caetano,
MSSP 23(2), 2009, cluster poles by the same distances).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbench.core.advice import Advice, AdviceList, Advised, as_json
from testbench.core.record import FloatArray
from testbench.estimators.model import ComplexArray
from testbench.estimators.operational.realise import OrderPoles, mac

# --- poles that return order after order ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Criteria:
    """The criteria: when two poles are one, which poles may be modes, and how often a mode must be seen."""

    frequency: float = 0.01  #: largest relative difference of natural frequencies, |f1 - f2| / max(f1, f2)
    damping: float = 0.2  #: largest difference of damping ratios: ``damping`` of the larger one, or ``damping_floor``
    damping_floor: float = 0.005  #: absolute difference that is always allowed
    mac: float = 0.95  #: least modal assurance criterion
    largest_damping: float = 0.7  #: poles of a larger damping ratio are not modes; unstable ones never are
    least_orders: int = 5  #: at which a mode must be stable
    frequency_error: float = 0.05  #: modes whose natural frequency has a larger relative standard deviation are dropped
    #: the same of the damping ratio. Poles of noise alone have errors of about their half-power band.
    damping_error: float = 0.35


@dataclass(frozen=True, eq=False)
class OrderView:
    """The poles of one order in the stabilisation diagram."""

    order: int  #: number of states
    frequency_hz: FloatArray  #: (k,) natural frequencies
    damping: FloatArray  #: (k,) damping ratios
    stable: NDArray[np.bool_]  #: (k,) the pole meets all criteria against the order before
    #: (k,) number of the mode that it belongs to, counted from 0 in the order of the result, or -1
    mode: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Chain:
    """One mode: its members as (number of the order, number of the pole), and the estimate made of them.

    ``moves`` (b,) are the changes of ``pole`` by the blocks; None where they were not asked for.
    """

    members: tuple[tuple[int, int], ...]
    pole: complex
    shape: ComplexArray
    moves: ComplexArray | None


def stabilise(found: Sequence[OrderPoles], criteria: Criteria, band_hz: tuple[float, float]) -> list[Chain]:
    """Return the modes of poles at several orders, sorted by frequency.

    The estimate of a mode is the mean over its orders, each pole weighed with the inverse of its own variance where
    that is known; the mean has the mean of the moves of its members, so that what the orders share is not counted as
    if it were independent.
    """
    links = [_links(found, i, criteria, band_hz) for i in range(len(found))]
    chains: list[list[tuple[int, int]]] = []
    end: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for i, link in enumerate(links):
        for k, before in sorted(link.items()):
            chain = end.pop((i - 1, before), None)
            if chain is None:
                chain = [(i - 1, before)]
                chains.append(chain)
            chain.append((i, k))
            end[(i, k)] = chain
    whole = _joined([_estimate(found, chain) for chain in chains], found, criteria)
    kept = [c for c in whole if len({i for i, _ in c.members}) >= criteria.least_orders]
    return sorted(kept, key=lambda c: abs(c.pole))


def view(found: Sequence[OrderPoles], chains: Sequence[Chain], criteria: Criteria) -> tuple[OrderView, ...]:
    """Return the stabilisation diagram: poles of every order, stable or not, and the modes that they belong to."""
    belongs = {member: number for number, chain in enumerate(chains) for member in chain.members}
    out = []
    for i, at in enumerate(found):
        size = np.abs(at.poles)
        stable = np.zeros(size.size, bool)
        stable[list(_links(found, i, criteria, (0.0, np.inf)))] = True
        mode = np.array([belongs.get((i, k), -1) for k in range(size.size)], np.intp)
        out.append(OrderView(at.order, size / (2.0 * np.pi), -at.poles.real / size, stable | (mode >= 0), mode))
    return tuple(out)


def _links(found: Sequence[OrderPoles], i: int, criteria: Criteria, band_hz: tuple[float, float]) -> dict[int, int]:
    """Return stable pole of order number i -> the pole of the order before that it continues, one to one."""
    if i == 0:
        return {}
    here, before = found[i], found[i - 1]
    near: list[tuple[float, int, int]] = []
    for k in np.flatnonzero(_possible(here.poles, criteria, band_hz)):
        for j in np.flatnonzero(_possible(before.poles, criteria, band_hz)):
            one, other = complex(here.poles[k]), complex(before.poles[j])
            if _alike(one, other, _mac(here.shapes[k], before.shapes[j]), criteria):
                near.append((abs(one - other) / abs(one), int(k), int(j)))
    out: dict[int, int] = {}
    for _, pole, continued in sorted(near):
        if pole not in out and continued not in out.values():
            out[pole] = continued
    return out


def _possible(poles: ComplexArray, criteria: Criteria, band_hz: tuple[float, float]) -> NDArray[np.bool_]:
    size = np.abs(poles)
    damping = -poles.real / size
    inside = (size >= 2.0 * np.pi * band_hz[0]) & (size <= 2.0 * np.pi * band_hz[1])
    return np.asarray(inside & (damping > 0.0) & (damping <= criteria.largest_damping), bool)


def _alike(one: complex, other: complex, mac: float, criteria: Criteria) -> bool:
    f1, f2 = abs(one), abs(other)
    z1, z2 = -one.real / f1, -other.real / f2
    return (
        abs(f1 - f2) <= criteria.frequency * max(f1, f2)
        and abs(z1 - z2) <= max(criteria.damping * max(z1, z2), criteria.damping_floor)
        and mac >= criteria.mac
    )


def _mac(a: ComplexArray, b: ComplexArray) -> float:
    return float(abs(np.vdot(a, b)) ** 2)  # shapes are of unit length


def _estimate(found: Sequence[OrderPoles], members: Sequence[tuple[int, int]]) -> Chain:
    poles = np.array([found[i].poles[k] for i, k in members])
    moves = None
    weights = np.ones(poles.size)
    if found[0].moves is not None:
        own = np.array([found[i].moves[:, k] for i, k in members])  # type: ignore[index]
        variance = np.sum(np.abs(own) ** 2, axis=1)
        weights = 1.0 / np.maximum(variance, 1e-12 * np.abs(poles) ** 2)
        moves = weights / weights.sum() @ own
    weights /= weights.sum()
    shapes = np.array([found[i].shapes[k] for i, k in members])
    outer = (shapes * weights[:, None]).T @ shapes.conj()  # its first eigenvector: the mean, whatever the phases
    shape = np.asarray(np.linalg.eigh(outer)[1][:, -1], np.complex128)
    return Chain(tuple(members), complex(weights @ poles), shape, moves)


def _joined(chains: list[Chain], found: Sequence[OrderPoles], criteria: Criteria) -> list[Chain]:
    """Join what is one mode, the longest chain first; where two chains share an order the pole of the longer one stays.

    Chains that share more than half of the orders of the shorter one are two modes, however close.
    """
    left = sorted(chains, key=lambda c: (-len(c.members), abs(c.pole)))
    out: list[Chain] = []
    for chain in left:
        at = {i for i, _ in chain.members}
        for n, other in enumerate(out):
            taken = {i for i, _ in other.members}
            if 2 * len(at & taken) <= len(at) and _same(chain, other, criteria):
                new = [member for member in chain.members if member[0] not in taken]
                out[n] = _estimate(found, sorted((*other.members, *new)))
                break
        else:
            out.append(chain)
    return out


def _same(one: Chain, other: Chain, criteria: Criteria) -> bool:
    """Say whether two chains meet the criteria, or lie within two standard deviations of their poles' difference.

    Both come from the same data: the difference has the difference of their moves, far less than either has.
    """
    likeness = _mac(one.shape, other.shape)
    if _alike(one.pole, other.pole, likeness, criteria):
        return True
    if one.moves is None or other.moves is None:
        return False
    apart = float(np.sqrt(np.sum(np.abs(one.moves - other.moves) ** 2)))
    return likeness >= criteria.mac and abs(one.pole - other.pole) <= 2.0 * apart


# --- the result of operational modal analysis -------------------------------------------------------------------------


ASSUMPTION = (
    "the method assumes that the turbulence is white noise and excites every mode alike. Turbulence is coloured: "
    "poles of its spectrum and of the rigid motion can appear as modes, and the outputs alone do not distinguish them"
)
"""The assumptions of every result; reports state them."""
_HEAVY = 0.2  # damping ratio from which on a pole is rarely a structural mode alone
_FEW_BLOCKS = 30
_WANDER = 0.03  # of the airspeed: 6 % in dynamic pressure
_CLOSE = 0.1  # relative distance of two frequencies, within which
_SAME_SHAPE = 0.9  # a larger MAC of their shapes makes two modes doubtful
_LINE = 0.003  # damping ratios below this are rarely those of a structure in flight (estimate)


def remarks(mode: OperationalMode) -> tuple[Advice, ...]:
    """Return what is doubtful about one mode."""
    out = AdviceList()
    if mode.damping > _HEAVY:
        out.doubt("heavily_damped", "heavily damped: it may include rigid motion or the colour of the excitation")
    if mode.damping < _LINE:
        out.doubt("hardly_damped", "almost no damping: a rotating part gives such a line")
    if _complexity(mode) > 0.5:
        out.doubt("complex_shape", "shape far from real: two modes close to each other, or strong damping by the air")
    return tuple(out)


def advise(modes: Sequence[OperationalMode], blocks: int, short: int, wander: float) -> tuple[Advice, ...]:
    """Return what is doubtful about a result, and what to do about it.

    Args:
        modes: found.
        blocks: of data that the errors come from.
        short: number of records that were shorter than the lags.
        wander: standard deviation of the airspeed over its mean, 0 if not known.
    """
    out = AdviceList(said.about(f"mode at {m.frequency_hz:.3g} Hz") for m in modes for said in m.remarks)
    for one, other in combinations(modes, 2):
        close = abs(one.frequency_hz - other.frequency_hz) < _CLOSE * other.frequency_hz
        if close and mac(one.scaled_shape, other.scaled_shape) > _SAME_SHAPE:
            out.doubt(
                "same_shape",
                f"modes at {one.frequency_hz:.4g} and {other.frequency_hz:.4g} Hz have the same shape: they are one "
                "mode split in two (it may have changed during the flight), or two that these sensors do not "
                "distinguish; add sensors",
            )
    if blocks < _FEW_BLOCKS:
        out.doubt("few_data", f"the errors come from only {blocks} blocks of data and are rough; give more data")
    if wander > _WANDER:
        out.doubt(
            "airspeed_wandered",
            f"airspeed varied by {100.0 * wander:.1f} % (one standard deviation): modes that vary with airspeed are "
            "means over it, and their intervals include random errors only; fly in calmer air or give records of one "
            "speed",
        )
    if short:
        out.note(
            "records_left_out",
            f"records shorter than the lags were not used: {short}; raise the lowest frequency of the band",
        )
    return tuple(out)


def _complexity(mode: OperationalMode) -> float:
    """Return 1 - |sum of c^2| / sum of |c|^2 of the shape: 0 if all outputs move in phase or against it, 1 at most."""
    c = mode.scaled_shape
    return float(1.0 - abs(np.sum(c**2)) / np.sum(np.abs(c) ** 2))


METHOD = "ssi_cov"


@dataclass(frozen=True, eq=False)
class OperationalMode:
    """One mode that was found at many orders."""

    pole: complex  #: s = -zeta wn + j wn sqrt(1 - zeta^2), rad/s, the mean over ``orders`` (see stabilise.py)
    #: frequency_std_hz, damping_std: standard deviations of natural frequency and damping ratio
    frequency_std_hz: float
    damping_std: float
    correlation: float  #: of the two
    shape: ComplexArray  #: (r,) the same in SI units of the channels, 1 at the output where ``scaled_shape`` is largest
    #: (r,) of the outputs over their rms, of unit length, the largest element real and positive
    scaled_shape: ComplexArray
    orders: tuple[int, ...]  #: at which it was stable
    remarks: tuple[Advice, ...] = ()  #: what is doubtful about it

    @property
    def frequency_hz(self) -> float:
        """Natural frequency |s| / 2 pi."""
        return abs(self.pole) / (2.0 * np.pi)

    @property
    def damping(self) -> float:
        """Damping ratio -Re(s) / |s|."""
        return -self.pole.real / abs(self.pole)


@dataclass(frozen=True, eq=False)
class OperationalModes(Advised):
    """Modes of outputs alone, identified without any input.


    An interval of 95 % is the value plus and minus ``quantile`` standard deviations.
    """

    channels: tuple[str, ...]  #: (r,) outputs, in the order of the mode shapes
    scale: FloatArray  #: (r,) rms of the outputs, which were divided by it
    dt_s: float  #: sample time that the covariances were taken at, s
    duration_s: float  #: of all records together
    blocks: int  #: of data that the errors were computed from
    modes: tuple[OperationalMode, ...]  #: in the order of their frequencies
    views: tuple[OrderView, ...]  #: poles of every order with the criteria that they meet: the stabilisation diagram
    singular_values: FloatArray  #: of the block Hankel matrix
    spectrum: FloatArray  #: (k, 2) frequency in Hz, and the mean spectral density of the scaled outputs in 1/Hz
    settings: Mapping[str, Any] = field(default_factory=dict)  #: as JSON values
    advice: tuple[str, ...] = ()  #: what is wrong or doubtful and what to do about it; ``status`` follows from it
    method: str = METHOD

    @property
    def quantile(self) -> float:
        """0.975 quantile of Student's t with one degree of freedom less than there are blocks."""
        from scipy.special import stdtrit

        return float(stdtrit(self.blocks - 1, 0.975))

    def to_dict(self) -> dict[str, Any]:
        """Return the result as JSON values; complex numbers as [real, imaginary]."""
        return {
            "method": self.method,
            "channels": list(self.channels),
            "scale": self.scale.tolist(),
            "dt_s": self.dt_s,
            "duration_s": self.duration_s,
            "blocks": self.blocks,
            "quantile": self.quantile,
            "settings": dict(self.settings),
            "modes": [
                {
                    "frequency_hz": m.frequency_hz,
                    "frequency_std_hz": m.frequency_std_hz,
                    "damping": m.damping,
                    "damping_std": m.damping_std,
                    "correlation": m.correlation,
                    "pole_rad_s": [m.pole.real, m.pole.imag],
                    "shape": [[float(c.real), float(c.imag)] for c in m.shape],
                    "orders": list(m.orders),
                    "remarks": list(m.remarks),
                }
                for m in self.modes
            ],
            "singular_values": self.singular_values.tolist(),
            "status": self.status,
            "advice": as_json(self.advice),
        }
