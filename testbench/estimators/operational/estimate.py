"""Operational modal analysis: modes with errors from the outputs alone, of one or several records."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, replace

import numpy as np

from testbench.core.errors import EstimationError, nearest
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.model import check_records
from testbench.estimators.operational.realise import Masked, covariances, realise
from testbench.estimators.operational.result import (
    Chain,
    Criteria,
    OperationalMode,
    OperationalModes,
    advise,
    remarks,
    stabilise,
    view,
)
from testbench.estimators.prepare import prepare

_OVERSAMPLED = 4.0  # rate over the highest frequency looked for, that data are decimated to
_CUT = 1.2  # low-pass before decimation, over the highest frequency looked for
_COLUMNS = 40  # most lags of one side of the Hankel matrix where no band is given
_SPANS = 200  # periods of the lowest frequency that the data hold where no band is given
_BLOCK = 2  # least length of a block, in spans of all lags
_ORDER = 40
_HIGHEST = 0.8  # of the Nyquist frequency, looked for where no band is given
_MOST_BLOCKS, _LEAST_BLOCKS = 100, 20


def estimate(
    records: Sequence[FlightRecord],
    channels: Sequence[str],
    *,
    references: Sequence[str] = (),
    band_hz: tuple[float, float] | None = None,
    order: int | None = None,
    criteria: Criteria | None = None,
) -> OperationalModes:
    """Return the modes that the outputs of the records show, without knowing any input.

    Covariance-driven stochastic subspace identification at orders 2, 4, ... ``order``, modes by their stability over
    the orders, errors by first-order perturbation of the covariances (see covariances.py, realise.py, stabilise.py).
    It takes the excitation as white noise: poles of the filter that shapes it, and of the rigid motion, come out as
    modes too.

    Args:
        records: measured, of one sample time, of any length; samples marked as not taken do not count.
        channels: outputs with the motion wanted, e.g. accelerometers and strain gauges along the wing.
        references: those of the channels that all are correlated with; all if not given.
        band_hz: lowest and highest frequency looked for; the lags of one side of the Hankel matrix span one period of
            the lowest. By default the data hold 200 periods of it, or 40 samples one, and the highest is 0.8 of the
            Nyquist frequency. Records sampled 8 times as fast as the highest, or more, are low-passed and decimated.
        order: the largest number of states, even; 40 if not given, or what the lags have room for.
        criteria: of stability; :class:`Criteria` as it stands if not given.

    Raises:
        EstimationError: no record, a truth record, no channel, a channel that never moves, a setting without sense, too
            little data for the lowest frequency, or none left after the criteria.
        ChannelError: a record lacks a channel.
    """
    channels, references = tuple(channels), tuple(references or channels)
    criteria = criteria or Criteria()
    _check(records, channels, references, order)
    band, stride = _band(records, band_hz)
    if stride > 1:
        records = [prepare(r, bias="mean", trim_s=0.0, lowpass_hz=_CUT * band[1], decimate=stride) for r in records]
    dt = records[0].dt_s
    columns = max(math.ceil(1.0 / (band[0] * dt) - 1e-9), 4)
    used = [r for r in records if len(r) > 2 * columns]
    samples = sum(len(r) for r in used)
    wanted = _blocks(samples, 2 * columns, band[0], dt)
    most = columns * len(references)
    order = order or min(_ORDER, most - most % 2)
    if order > most:
        raise EstimationError(
            f"order <= {most} must hold for {columns} lags of {len(references)} references, got {order}; lower it, or "
            "the lowest frequency of the band"
        )
    data, scale = _scaled(used, channels)
    R = covariances(data, [channels.index(c) for c in references], 2 * columns, wanted)
    found, sigma = realise(R.lags, dt, columns, range(2, order + 1, 2), R.deviations)
    chains = [c for c in stabilise(found, criteria, band) if _certain(c, criteria)]
    if not chains:
        raise EstimationError(
            f"no mode between {band[0]:g} and {band[1]:g} Hz is stable at {criteria.least_orders} of {len(found)} "
            "orders; give more data, another band or a higher order"
        )
    modes = tuple(_mode(c, scale, [at.order for at in found]) for c in chains)
    advice = advise(modes, len(R.deviations), len(records) - len(used), _wander(used))
    return OperationalModes(
        channels=channels,
        scale=scale,
        dt_s=dt,
        duration_s=samples * dt,
        blocks=len(R.deviations),
        modes=modes,
        views=view(found, chains, criteria),
        singular_values=sigma,
        spectrum=_spectrum(data, dt, band[0]),
        settings={
            "references": list(references),
            "band_hz": list(band),
            "order": order,
            "lags": 2 * columns,
            "decimated": stride,
            "criteria": asdict(criteria),
        },
        advice=advice,
    )


def _check(
    records: Sequence[FlightRecord], channels: tuple[str, ...], references: tuple[str, ...], order: int | None
) -> None:
    """Refuse what no estimate can be made of."""
    if not channels:
        raise EstimationError("operational modal analysis needs at least one channel, got none")
    for what, names in (("channels", channels), ("references", references)):
        if len(set(names)) != len(names):
            raise EstimationError(f"{what} must differ, got {', '.join(names)}")
    foreign = [name for name in references if name not in channels]
    if foreign:
        raise EstimationError(
            f"references must be among the channels, got '{foreign[0]}'{nearest(foreign[0], channels)}"
        )
    if order is not None and (order < 2 or order % 2):
        raise EstimationError(f"the order must be even and at least 2 (a mode takes two states), got {order}")
    check_records(records, (), channels)


def _band(records: Sequence[FlightRecord], given: tuple[float, float] | None) -> tuple[tuple[float, float], int]:
    """Return lowest and highest frequency, Hz, and the stride to decimate by."""
    rate, duration = 1.0 / records[0].dt_s, sum(len(r) * r.dt_s for r in records)
    band = given or (max(_SPANS / duration, rate / _COLUMNS), _HIGHEST * rate / 2.0)
    if not 0.0 < band[0] < band[1] <= rate / 2.0:
        if given is None:
            raise EstimationError(
                f"{_SPANS} periods of a mode must fit into the records, got {duration:g} s; give more data"
            )
        raise EstimationError(
            f"0 < lowest < highest <= {rate / 2.0:g} Hz (half the sample rate) must hold for the band, got {band[0]:g} "
            f"to {band[1]:g} Hz"
        )
    return (float(band[0]), float(band[1])), max(int(rate / (_OVERSAMPLED * band[1]) + 1e-9), 1)


def _blocks(samples: int, lags: int, lowest_hz: float, dt_s: float) -> int:
    """Return into how many blocks the data are divided."""
    blocks = min(_MOST_BLOCKS, samples // (_BLOCK * lags))
    if blocks < _LEAST_BLOCKS:
        raise EstimationError(
            f"modes down to {lowest_hz:g} Hz need {_LEAST_BLOCKS * _BLOCK * lags * dt_s:.0f} s of data "
            f"({_LEAST_BLOCKS} blocks), got {samples * dt_s:.0f} s; give more data, or raise the lowest frequency of "
            "the band"
        )
    return blocks


def _scaled(records: Sequence[FlightRecord], channels: Sequence[str]) -> tuple[list[Masked], FloatArray]:
    """Return samples over their rms with the mean of each record removed, their validity, and the rms (r,)."""
    data: list[Masked] = []
    moved = np.zeros(len(channels))
    for record in records:
        y, valid = record.columns(channels), record.select(channels).valid
        lost = [name for name, known in zip(channels, valid.T, strict=True) if not known.any()]
        if lost:
            raise EstimationError(f"output '{lost[0]}' was never sampled in a record; leave out the one or the other")
        low, high = (f(y, axis=0, where=valid, initial=end) for f, end in ((np.min, np.inf), (np.max, -np.inf)))
        moved = np.maximum(moved, high - low)
        data.append((y - y.mean(axis=0, where=valid), valid))
    still = [name for name, reach in zip(channels, moved, strict=True) if reach == 0.0]
    if still:
        raise EstimationError(f"output '{still[0]}' never moves in these records; leave it out")
    energy = sum(np.sum(y**2, axis=0, where=valid) for y, valid in data)
    scale = np.asarray(np.sqrt(energy / sum(valid.sum(axis=0) for _, valid in data)))
    return [(y / scale, valid) for y, valid in data], scale


def _wander(records: Sequence[FlightRecord]) -> float:
    """Return the standard deviation of the airspeed over its mean where the records hold it, else 0."""
    V = np.concatenate([r["V"][r.select(["V"]).valid[:, 0]] for r in records if "V" in r] or [np.ones(1)])
    return float(V.std() / V.mean()) if V.size and V.mean() > 0.0 else 0.0


def _certain(chain: Chain, criteria: Criteria) -> bool:
    _, std = _errors(chain)
    wn, zeta = abs(chain.pole), -chain.pole.real / abs(chain.pole)
    return bool(std[0] <= criteria.frequency_error * wn and std[1] <= criteria.damping_error * zeta)


def _errors(chain: Chain) -> tuple[float, FloatArray]:
    """Return the correlation and the standard deviations (2,) of natural frequency, rad/s, and damping ratio."""
    assert chain.moves is not None
    s = chain.pole
    wn = abs(s)
    dw = (s.conjugate() * chain.moves).real / wn
    dz = -(chain.moves.real + (-s.real / wn) * dw) / wn
    covariance = np.stack([dw, dz]) @ np.stack([dw, dz]).T
    std = np.sqrt(np.diag(covariance))
    both = float(std[0] * std[1])
    return float(covariance[0, 1]) / both if both > 0.0 else 0.0, np.asarray(std)


def _mode(chain: Chain, scale: FloatArray, orders: Sequence[int]) -> OperationalMode:
    correlation, std = _errors(chain)
    largest = chain.shape[np.argmax(np.abs(chain.shape))]
    mode = OperationalMode(
        pole=chain.pole,
        frequency_std_hz=float(std[0] / (2.0 * np.pi)),
        damping_std=float(std[1]),
        correlation=correlation,
        shape=chain.shape / largest * scale / scale[np.argmax(np.abs(chain.shape))],
        scaled_shape=chain.shape / largest * abs(largest),
        orders=tuple(orders[i] for i, _ in chain.members),
    )
    return replace(mode, remarks=remarks(mode))


def _spectrum(data: Sequence[Masked], dt_s: float, lowest_hz: float) -> FloatArray:
    """Return frequency in Hz and the mean spectral density of the scaled outputs, gaps bridged by straight lines."""
    from scipy.signal import welch

    n = min(math.ceil(8.0 / (lowest_hz * dt_s)), *(len(y) for y, _ in data))
    total, weight = 0.0, 0
    for y, valid in data:
        k = np.arange(len(y))
        whole = np.stack([np.interp(k, k[v], c[v]) for c, v in zip(y.T, valid.T, strict=True)], axis=1)
        f, density = welch(whole, 1.0 / dt_s, nperseg=n, axis=0)
        total, weight = total + len(y) * density.mean(axis=1), weight + len(y)
    return np.column_stack([f, total / weight])
