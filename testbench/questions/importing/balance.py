"""The balance of an import: every signal of the log that is or could be a channel, and what became of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.core.record import FlightRecord, FloatArray
from testbench.logs.clocks import usual_step
from testbench.logs.names import meaning
from testbench.logs.signals import ZERO, Found, Log

UNKNOWN = "no rule assigns it to a channel"
_OUTAGE_S, _MISSED = 1.0, 5.0  # a silence of all channels this long, and of so many samples of the fastest
_ENOUGH = 0.5  # of the samples that its rate allows


@dataclass(frozen=True)
class Signal:
    """One signal of a log and its end.

    Args:
        source: topic and columns, as the log calls them.
        samples: how many the log holds.
        rate_hz: their usual rate; NaN if there are fewer than two.
        channel: the channel that it is or could be, "" if no rule knows it.
        kept: whether it is that channel in the record.
        record_rate_hz: rate of the record, 0 if it was left out.
        valid: share of the record's samples that were taken, 0 to 1.
        reason: why it was left out, or what of it was lost; "" if all of it was kept.
        lost: whether something was measured that the record does not hold, though nothing replaces it.
    """

    source: str
    samples: int
    rate_hz: float
    channel: str = ""
    kept: bool = False
    record_rate_hz: float = 0.0
    valid: float = 0.0
    reason: str = ""
    lost: bool = False


@dataclass(frozen=True)
class Balance:
    """What was found in a log, kept in the record and left out, and which of several sensors was read (``sensors``).

    ``disagree`` names pairs of sensors of which one must be wrong; ``outages`` are first and last time, s of the
    record, of each stretch in which nothing at all was logged.

    Example:
        >>> import testbench as tb
        >>> for signal in tb.import_log("flight.ulg").balance.left_out:  # doctest: +SKIP
        ...     print(signal.source, signal.channel, signal.reason)
    """

    signals: tuple[Signal, ...]
    sensors: tuple[str, ...] = ()
    disagree: tuple[str, ...] = ()
    outages: tuple[tuple[float, float], ...] = ()

    @property
    def kept(self) -> tuple[Signal, ...]:
        """The channels of the record, in its order."""
        return tuple(s for s in self.signals if s.kept)

    @property
    def left_out(self) -> tuple[Signal, ...]:
        """The signals that a rule knows as a channel and that are not in the record."""
        return tuple(s for s in self.signals if s.channel and not s.kept)

    @property
    def unknown(self) -> tuple[Signal, ...]:
        """The signals and topics that no rule knows."""
        return tuple(s for s in self.signals if not s.channel)

    @property
    def lost(self) -> tuple[Signal, ...]:
        """The signals of which something was measured that the record does not hold."""
        return tuple(s for s in self.signals if s.lost)


def balance_of(log: Log, found: Found, record: FlightRecord) -> Balance:
    """Return the balance: a row for each channel of ``record``, each signal left out and each topic not known.

    Args:
        log: what was read.
        found: the channels and what the rules passed over.
        record: the record that was made of the channels.
    """
    rate = float(record.provenance["rate_hz"])
    mapped = {c.name: c for c in found.channels}
    outages = _outages(found, record)
    out = []
    for i, name in enumerate(record.channels):
        c = mapped[name]
        valid = float(record.valid[:, i].mean())
        lost = _thin(c.t_s, c.step_s, record, valid, outages)
        out.append(Signal(c.source, c.t_s.size, c.rate_hz, name, True, rate, valid, lost, bool(lost)))
    for c in found.channels:
        if c.name not in record:
            short = f"no stretch between its gaps is long enough to be filtered for {rate:g} Hz"
            why = f"{short}; --rate {c.rate_hz:.3g} keeps it"
            out.append(Signal(c.source, c.t_s.size, c.rate_hz, c.name, reason=why, lost=True))
    for p in found.passed:
        lost_here = p.name not in record and not p.reason.startswith(ZERO)
        out.append(Signal(p.source, p.t_s.size, _rate(p.t_s), p.name, reason=p.reason, lost=lost_here))
    for name, reason in log.reasons.items():
        known = meaning(name)
        channel = known.channel if known else ""
        out.append(Signal(name, log.unread.get(name, 0), np.nan, channel, reason=reason, lost=True))
    used = {s.source.partition(".")[0] for s in out}
    for name, topic in log.topics.items():
        if name and name not in used:
            out.append(Signal(name, topic.t_s.size, _rate(topic.t_s), reason=UNKNOWN))
    rest = {name: count for name, count in log.unread.items() if name not in log.reasons}
    out += [Signal(name, count, np.nan, reason=UNKNOWN) for name, count in rest.items()]
    disagree = tuple(choice.doubt for choice in found.choices if choice.doubt)
    return Balance(tuple(out), tuple(choice.said for choice in found.choices), disagree, outages)


def _outages(found: Found, record: FlightRecord) -> tuple[tuple[float, float], ...]:
    """Return first and last time of each stretch of the record in which no channel has a sample, though all are due."""
    due = max(_OUTAGE_S, _MISSED * min(c.step_s for c in found.channels))
    t = record.t_s[record.valid.any(axis=1)]
    return tuple((float(t[i]), float(t[i + 1])) for i in np.flatnonzero(np.diff(t) > due))


def _thin(
    t: FloatArray, step: float, record: FlightRecord, valid: float, outages: Sequence[tuple[float, float]]
) -> str:
    """Say what of a kept channel was lost: it was logged, or would have been, more often than the record holds it.

    Outages of the whole log are said once, of all its channels.
    """
    out = sum(b - a for a, b in outages)
    span, own = float(record.t_s[-1] - record.t_s[0]), float(t[-1] - t[0])
    logged = min(1.0, max(0.0, own - out) / span if span else 1.0)
    expected = min(1.0, record.dt_s / step) * logged
    if valid >= _ENOUGH * expected:
        return ""
    return f"{100.0 * valid:.3g} % of its samples are in the record, the rest lies in gaps or between them"


def _rate(t: FloatArray) -> float:
    return 1.0 / usual_step(t) if t.size > 1 else float("nan")


def balance_rows(signals: Sequence[Signal]) -> list[tuple[str, ...]]:
    """Return a row of text per signal: channel, source, samples, rate in the log, share valid, reason."""
    return [
        (
            s.channel or "-",
            s.source,
            str(s.samples),
            f"{s.rate_hz:.3g} Hz" if np.isfinite(s.rate_hz) else "-",
            f"{100.0 * s.valid:.3g} % at {s.record_rate_hz:.4g} Hz" if s.kept else "left out",
            s.reason,
        )
        for s in signals
    ]
