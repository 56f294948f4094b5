"""Records without quiet trim flight are cut into windows, each of which starts freely (multiple shooting).

H. G. Bock, Numerical treatment of inverse problems in chemical reaction kinetics, 1981; R. V. Jategaonkar, Flight
Vehicle System Identification, 2nd ed., 2015, section 9.5, for unstable aircraft. A window is a record of its own. It
begins with LEAD_S of flight that is flown but not compared, so that servos, links and sensors that lag have forgotten
where they began. Its start, constant offsets of its commands (thrust that wanders, a trim that is not known) and where
its surfaces were (a servo at its rate limit does not forget) are nuisances of its own (:mod:`.starts`), first
fitted to the believed model.

Records as they are searched: cut into windows that the believed aircraft survives, with starts that suit it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.stats import chi2

from testbench.core.channels import CONTROLS
from testbench.core.constants import DEG_RAD
from testbench.core.errors import LimitError, RecordError, Refusal, TrimError, located
from testbench.core.record import FlightAborted, FlightRecord
from testbench.inference.unknown import forced
from testbench.questions.gap.believed import NEAR, Believed
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.evidence.commanded import (
    LATERAL_CHANNELS,
    MOVED,
    begins_quietly,
    commands,
    freed,
    key_of_start,
    quiet_samples,
    starts_freely,
    surface_noise,
)
from testbench.questions.gap.flights import flights
from testbench.questions.gap.scenario import SHORTEST_S, Windows
from testbench.questions.gap.search.point import Point, retune
from testbench.questions.gap.starts import BEGAN, STATES, FreeStart, marked, record_key, start_of

LEAD_S = 0.5  # flown before a window is compared: four time constants of a servo of 8 rad/s
LONGEST_S = 10.0  # of a window where nothing is unstable: turbulence and thrust wander within longer ones
GROWTH = 30.0
"""By which the fastest unstable mode may grow within a window: what noise leaves of a start, some 0.1 deg, stays where
the aircraft is linear."""
_FROM_TRIM = {  # prior standard deviations: of a state that is measured, by what instruments may be biased; of others
    "V_m_s": (0.03, 0.06),  # of the airspeed
    "alpha": (2.0 * DEG_RAD, 4.0 * DEG_RAD),
    "beta": (2.0 * DEG_RAD, 4.0 * DEG_RAD),
    "p": (1.0 * DEG_RAD, 10.0 * DEG_RAD),
    "q": (1.0 * DEG_RAD, 10.0 * DEG_RAD),
    "r": (1.0 * DEG_RAD, 10.0 * DEG_RAD),
    "phi": (2.0 * DEG_RAD, 15.0 * DEG_RAD),
    "theta": (2.0 * DEG_RAD, 5.0 * DEG_RAD),
    "h_m": (10.0, 10.0),
}
_OFF_TRIM = {  # the same of a record that begins at trim, so near that the start is taken out to first order
    "V": 0.003, "u": 0.003, **dict.fromkeys(("w", "v", "alpha", "beta", "theta", "phi", "p", "q", "r"), 0.1 * DEG_RAD),
}  # fmt: skip
_ALONG_V = ("V", "u", "w", "v")  # velocities, whose deviations are shares of the airspeed
_OFFSETS = {"de": 3.0 * DEG_RAD, "da": 3.0 * DEG_RAD, "dr": 3.0 * DEG_RAD, "thr": 0.2}
_CHANNELS = {"V_m_s": "V", "h_m": "h"}
_OF_LATERAL = ("beta", "p", "r", "phi", "da", "dr")  # start parameters
_FITTED_S, _FEWEST = 0.2, 5  # straight lines through so much of a reading, and so many samples, say where it begins
_TURNS_DEG_S, _BANK_DEG, _ACCELERATES_1_S = 5.0, 15.0, 0.05  # beyond which quiet commands are not taken for trim
_MISFIT, _UNTRIMMED = 2.0, 10.0  # of the noise; chi-square from trim over that from another start
_UNTRIMMED_BESIDE = 1.5  # the same beside records that do not begin in quiet flight: nobody waited for trim
_FORETOLD = 1.1  # the same over that from the start which quiet flight tells, which knows nothing of the rest
_DRIFTS = 1e-6  # chance that noise of quiet flight at trim fits another start as well
_FEW_TIMES = 3.0  # of the noise that may be left from there
_STILL = 2.0  # standard deviations of chi-square that such flight in still air may leave beside the start that it tells
_STEP = 0.05  # of differences, in prior standard deviations
_HORIZONS_S = (1.5, 3.0, math.inf)
_ROUNDS, _FEW_ROUNDS = 8, 3
_AT_REST = 0.1  # of chi-square
_SHARES = (1.0, 0.4, 0.1)
_SURVIVES = (1.0, 0.5, 0.25, 0.0)  # of the way from what the first readings tell to a fitted start, tried in turn


@dataclass(frozen=True, eq=False)
class Cut:
    """Records as they are searched."""

    parts: Mapping[str, Mapping[str, FlightRecord]]  # record -> its windows by name; alone if it begins at trim
    whole: Mapping[str, FlightRecord]  # name -> record as it was given; one without quiet flight says so
    notes: tuple[str, ...]  # what was cut, in sentences

    @property
    def records(self) -> dict[str, FlightRecord]:
        """Name -> record that begins at trim, or window."""
        return {name: part for parts in self.parts.values() for name, part in parts.items()}

    def of(self, names: Iterable[str]) -> Cut:
        """Return some of the records alone."""
        return Cut({n: self.parts[n] for n in names}, {n: self.whole[n] for n in names}, self.notes)


def cut(believed: Believed, records: Mapping[str, FlightRecord], windows: Windows = "auto", share: float = 1.0) -> Cut:
    """Cut records into windows where that is wanted.

    Args:
        believed: whose unstable modes say how long windows may be.
        records: by name.
        windows: length of the windows of every record, s; "auto" cuts those alone that do not begin with quiet flight,
            or that cannot be flown from trim, "off" none.
        share: of the length that "auto" would choose; below 1 where the believed aircraft leaves its limits within it.

    Raises:
        RecordError: a record is shorter than one window, or a length makes no sense.
    """
    if windows == "off":
        return Cut({n: {n: r} for n, r in records.items()}, records, ())
    out: dict[str, Mapping[str, FlightRecord]] = {}
    whole: dict[str, FlightRecord] = {}
    notes: list[str] = []
    moving = {name: restless(record) for name, record in records.items() if not starts_freely(record)}
    quiet = {name: records[name] for name, why in moving.items() if not why and windows == "auto"}
    drifts = {name: drifting(believed, record) for name, record in quiet.items()}
    drifted = any(drifts.values())
    waited = not (drifted or any(moving.values()))
    for name, record in records.items():
        out[name], whole[name] = {name: record}, record
        if starts_freely(record):
            continue
        why_free = moving[name] or drifts.get(name, "")
        if not why_free and windows == "auto":
            why_free = untrimmed(believed, record, waited, drifted)
        if windows == "auto" and not why_free:
            continue
        with located(None, f"record '{name}'"):
            length_s, why = longest(believed, record) if windows == "auto" else (float(windows), "as wanted")
            if windows == "auto" and share < 1.0:
                length_s, why = (
                    max(share * length_s, SHORTEST_S),
                    "in longer ones the a-priori model leaves its limits",
                )
            whole[name] = freed(record, record_key(record), level(record))
            parts = _parts(whole[name], length_s)
        out[name] = {f"{name}, {part.t_s[0]:.4g} to {part.t_s[-1]:.4g} s": part for part in parts}
        each = (len(parts[0]) - round(LEAD_S / record.dt_s)) * record.dt_s
        into = f"is cut into {len(parts)} window{'s' if len(parts) > 1 else ''} of {each:.3g} s"
        because = f"{why_free}: it " if why_free else ""
        notes.append(f"'{name}' {because}{into} ({why}), each with a free initial state")
    return Cut(out, whole, tuple(notes))


def as_they_start(records: Mapping[str, FlightRecord]) -> dict[str, FlightRecord]:
    """Return records each of which says so if it does not begin in trimmed flight."""
    free = {n: not starts_freely(r) and restless(r) for n, r in records.items()}
    return {n: freed(r, record_key(r), level(r)) if free[n] else r for n, r in records.items()}


def restless(record: FlightRecord) -> str:
    """Return why a record does not begin in trimmed flight, in words; "" if it may.

    Turbulence moves an aircraft at trim, too: what it does within half a second is let pass.
    """
    if not begins_quietly(record):
        return "does not begin with quiet flight"
    n = quiet_samples(record)
    for name in ("p", "q", "r"):
        rate = float(np.mean(record[name][:n])) / DEG_RAD if name in record else 0.0
        if abs(rate) > _TURNS_DEG_S:
            return f"turns as it begins ({name} {rate:.3g} deg/s)"
    bank = float(np.mean(record["phi"][:n])) / DEG_RAD if "phi" in record else 0.0
    if abs(bank) > _BANK_DEG:
        return f"is banked as it begins ({bank:.3g} deg)"
    if "V" in record:
        V = record["V"][:n]
        slope = float(np.polyfit(np.arange(n) * record.dt_s, V, 1)[0]) / float(np.mean(V))
        if abs(slope) > _ACCELERATES_1_S:
            return f"changes its airspeed as it begins ({100.0 * slope:.2g} % per second)"
    return ""


def untrimmed(believed: Believed, record: FlightRecord, waited: bool = True, drifted: bool = False) -> str:
    """Return why a record with quiet commands is not to be flown from trim, in words; "" if it may be.

    A start is fitted to the whole record, with constant offsets of its commands: a control that is held in the midst of
    a manoeuvre rests, too. If a start at trim leaves ten times as much, the aircraft was not trimmed; 1.5 times as much
    if none ``waited`` for trim, as the records beside it show; 1.1 times if one of them ``drifted``, see
    :func:`drifting`. Nor was it if its commands, counted from trim, leave the range of a control. Turbulence and gaps
    in the model go on through the record: a free start leaves more of them.
    A believed aircraft that answers too much, or an unstable one, may leave its limits however well the true one was
    trimmed.
    """
    plain, free = replace(believed, whiten=None), freed(record, record_key(record), level(record))
    try:
        believed.check_commands(record)
        at_trim, samples = float(np.sum(plain.residuals(record) ** 2)), int(np.count_nonzero(believed.taken(record)))
        if at_trim < (_noise(samples) if drifted else _MISFIT * samples):
            return ""
        key = key_of_start(free)
        starts = _fitted(plain, {"": free}, {key: _guess(plain, free)}, math.inf, _FEW_ROUNDS)
        left = replace(plain, free_starts=starts).cost_of_start(free, starts[key].origin)
    except FlightAborted:
        return "cannot be flown from trim to its end"
    except LimitError:
        (names, u), controls = commands(record), believed.aircraft.controls
        swings = zip((controls[n] for n in names), np.ptp(u, axis=0), strict=True)
        beyond = any(swing > control.full - control.low for control, swing in swings)  # from wherever it is counted
        return "" if beyond else "commands more than a control has, if counted from trim"
    except Refusal:
        return ""
    if at_trim < (_FORETOLD if drifted else _UNTRIMMED if waited else _UNTRIMMED_BESIDE) * left:
        return ""
    return f"is not in trimmed flight as it begins (another start leaves {left / at_trim:.2g} of the misfit)"


def drifting(believed: Believed, record: FlightRecord) -> str:
    """Return that a record drifts as its commands rest, in words; "" if it may be in trimmed flight, or more is amiss.

    A phugoid or a Dutch roll that dies away shows in the quiet flight alone, of which another start leaves noise. The
    start that this tells then foretells the rest of the record better than trim does. A gap in the model does not show
    before the commands move. Turbulence leaves more than noise; and where the model leaves many times the noise of the
    rest, a start that it does not tell may lower it by chance.
    """
    plain, free = replace(believed, whiten=None), freed(record, record_key(record), level(record))
    try:
        at_trim, samples = float(np.sum(plain.residuals(record) ** 2)), int(np.count_nonzero(believed.taken(record)))
        if at_trim < _noise(samples):
            return ""
        key, quiet_s = key_of_start(free), quiet_samples(record) * record.dt_s
        quiet, beginning = (r.between(float(r.t_s[0]), float(r.t_s[0]) + quiet_s) for r in (record, free))
        guess = _guess(plain, free, offsets=False)
        told = _fitted(plain, {"": free}, {key: guess}, quiet_s, _FEW_ROUNDS)
        there = replace(plain, free_starts=told)
        rest, n = there.cost_of_start(beginning, told[key].origin), int(np.count_nonzero(plain.taken(quiet)))
        gain = float(np.sum(plain.residuals(quiet) ** 2)) - rest
        if gain < chi2.isf(_DRIFTS, guess.origin.size) or rest > n + _STILL * math.sqrt(2.0 * n):
            return ""
        left = there.cost_of_start(free, told[key].origin)
    except Refusal:
        return ""
    if at_trim < _FORETOLD * left or left > _FEW_TIMES * samples:
        return ""
    share = f"{left / at_trim:.2g} of the misfit"
    return f"is not in trimmed flight as it begins (its quiet flight has another initial state, which leaves {share})"


def _noise(samples: int) -> float:
    """Return the chi-square that noise of so many samples hardly exceeds."""
    return samples + CRITERIA.visible * math.sqrt(2.0 * samples)


def longest(believed: Believed, record: FlightRecord) -> tuple[float, str]:
    """Return how long a window may be, s, and why."""
    growing = float(max(0.0, *believed.at(record).linear.poles().real))
    if growing * LONGEST_S <= math.log(GROWTH):
        return LONGEST_S, "nothing grows much faster"
    length = max(math.log(GROWTH) / growing, SHORTEST_S)
    return length, f"its fastest unstable mode doubles in {math.log(2.0) / growing:.2g} s"


def level(record: FlightRecord) -> dict[str, float]:
    """Return control -> command from which deviations are taken: in quiet flight, or in the mean of the record."""
    names = [n for n in CONTROLS if f"{n}_cmd" in record]
    if not names:
        raise RecordError("a record of the gap workflow must hold a command such as de_cmd, got none")
    u = record.columns(f"{n}_cmd" for n in names)
    if not restless(record):
        u = u - commands(record)[1]
    return dict(zip(names, u.mean(axis=0).tolist(), strict=True))


def _parts(record: FlightRecord, length_s: float) -> list[FlightRecord]:
    """Return windows of equal length, none compared for more than ``length_s``."""
    if not length_s >= SHORTEST_S:
        raise RecordError(f"a window must be at least {SHORTEST_S:g} s long, got windows = {length_s:g}")
    lead = round(LEAD_S / record.dt_s)
    n = len(record) - lead
    if n * record.dt_s < SHORTEST_S:
        raise RecordError(
            f"a record must be at least {SHORTEST_S + LEAD_S:g} s long to start freely, got {record.duration_s:.2f} s"
        )
    count = max(1, math.ceil(n * record.dt_s / length_s - 1e-9))
    ends = np.linspace(lead, len(record), count + 1).round().astype(int)
    return [part_of(record, a - lead, b) for a, b in pairwise(ends.tolist())]


def part_of(record: FlightRecord, begin: int, end: int) -> FlightRecord:
    """Return the samples from ``begin`` to ``end`` of a record as a window that starts freely.

    Its first LEAD_S are flown and not compared.
    """
    compared = [i for i, c in enumerate(record.channels) if not c.endswith("_cmd")]
    rows = slice(begin, end)
    valid = record.valid[rows].copy()
    valid[: round(LEAD_S / record.dt_s), compared] = False
    part = replace(record, t_s=record.t_s[rows], data=record.data[rows], valid=valid)
    if (start := start_of(record)) is not None:
        part = marked(part, start.later(float(np.mean(part.t_s[[0, -1]]) - np.mean(record.t_s[[0, -1]]))))
    return freed(part, record_key(part), _level_of(record) if starts_freely(record) else level(record))


def _level_of(record: FlightRecord) -> dict[str, float]:
    names, u = commands(record)
    return dict(zip(names, (record.columns(f"{n}_cmd" for n in names) - u)[0].tolist(), strict=True))


def begin_freely(believed: Believed, records: Mapping[str, FlightRecord], along: Believed | None = None) -> Believed:
    """Return the belief with the starts of all records that start freely, fitted to them.

    Gauss-Newton on flown differences: readings less what the believed sensors would read, about their means. It begins
    at the starts that the belief has, or at the first readings if it has none or cannot be flown from there. ``along``
    is the model that they are fitted to; ``believed`` itself if not given.
    """
    own = {n: r for n, r in records.items() if starts_freely(r)}
    if not own:
        return believed
    plain = replace(along or believed, whiten=None)
    starts = {key_of_start(r): _guess(believed, r) for r in own.values()}
    known = believed.free_starts
    if all(k in known and known[k].names == s.names for k, s in starts.items()):
        with suppress(FlightAborted, LimitError, TrimError):
            here = {k: replace(s, origin=known[k].origin) for k, s in starts.items()}
            here = _fitted(plain, own, here, math.inf, _ROUNDS)
            # Where a poor model began, a better one may be caught: what is not noise is sought from the readings, too.
            there = replace(plain, free_starts=here)
            taken = {n: int(np.count_nonzero(there.taken(r))) for n, r in own.items()}
            costs = {n: there.cost_of_start(r, here[key_of_start(r)].origin) for n, r in own.items()}
            poor = {n: r for n, r in own.items() if costs[n] > _noise(taken[n])}
            with suppress(FlightAborted, LimitError, TrimError):
                anew = _from_readings(plain, poor, starts)
                for name, record in poor.items():
                    key = key_of_start(record)
                    if replace(plain, free_starts=anew).cost_of_start(record, anew[key].origin) < costs[name]:
                        here[key] = anew[key]
            return replace(believed, free_starts={**known, **here, **_linearised(plain, own, here)})
    starts = _from_readings(plain, own, starts)
    starts |= _linearised(plain, own, starts)
    return replace(believed, free_starts={**believed.free_starts, **starts})


def nearly_trimmed(believed: Believed, records: Iterable[FlightRecord]) -> Believed:
    """Return the belief that records which begin at trim may be off it by what no pilot or autopilot sees.

    A phugoid of a tenth of a degree, or the trim that wanders as a glider descends, is no gap. To first order, by the
    believed aircraft about trim.
    """
    out = {}
    for record in (r for r in records if not starts_freely(r)):
        there = believed.at(record)
        linear, outputs = there.linear, believed.outputs
        stds = {n: s * (there.condition.V_m_s if n in _ALONG_V else 1.0) for n, s in _OFF_TRIM.items()}
        names = tuple(n for n in linear.states if n in stds)
        impulse = np.zeros((len(record), 1))
        impulse[0] = 1.0 / record.dt_s  # the state is there from the next sample on
        columns = []
        for name in names:
            push = stds[name] * (np.array(linear.states) == name)
            columns.append(forced(linear, outputs, push, np.zeros(len(outputs)), impulse, record.dt_s)[:, :, 0])
        zero = np.zeros(len(names))
        std = np.array([stds[n] for n in names])
        out[record_key(record)] = FreeStart(names, zero, std, zero, np.stack(columns, axis=-1))
    return replace(believed, off_trim=out)


def begin_from(believed: Believed, whole: FlightRecord, part: FlightRecord, share: float) -> Believed:
    """Return the belief with the start of a part of a record that begins where the flight of the whole record is then.

    Its priors are ``share`` as wide as those of a window: the flight before it tells where it begins.
    """
    free, there = _guess(believed, part), believed.at(part)
    truth = believed.flown(whole)
    k, trim = int(np.searchsorted(whole.t_s, part.t_s[0] - 1e-9)), there.trimmed.state
    states = {n: _CHANNELS.get(n, n) for n in free.names if n in STATES}
    at = {n: float(truth[c][k]) - trim[c] for n, c in states.items()}
    begins = np.array([at.get(n, 0.0) for n in free.names])
    key = key_of_start(part)
    start = replace(free, centre=begins, origin=begins, std=share * free.std)
    known = _linearised(replace(believed, whiten=None), {"": part}, {key: start})
    return replace(believed, free_starts={**believed.free_starts, **known})


def _from_readings(
    plain: Believed, records: Mapping[str, FlightRecord], starts: Mapping[str, FreeStart]
) -> dict[str, FreeStart]:
    """Return starts fitted from where the first readings lie.

    What seems to begin well may leave the limits before it has been fitted: first the beginnings alone.
    """
    out = dict(starts)
    for horizon_s in _HORIZONS_S:
        out = _surviving(plain, _beginnings(records, horizon_s), starts, out)
        out = _fitted(plain, records, out, horizon_s, _ROUNDS)
    return out


def _beginnings(records: Mapping[str, FlightRecord], horizon_s: float) -> dict[str, FlightRecord]:
    """Return no more than ``horizon_s`` of each record."""
    return {n: r.between(float(r.t_s[0]), float(r.t_s[0]) + horizon_s) for n, r in records.items()}


def _surviving(
    believed: Believed,
    records: Mapping[str, FlightRecord],
    told: Mapping[str, FreeStart],
    fitted: Mapping[str, FreeStart],
) -> dict[str, FreeStart]:
    """Return the fitted starts, on the way back to those that the first readings told where they end in a limit.

    A model that is far off may be fitted to a beginning by what leads it away after that: 80 % more throttle.
    """
    out = dict(fitted)
    there = replace(believed, free_starts=out)
    tried = {}
    for name, record in records.items():
        at, first = (starts[key_of_start(record)].origin for starts in (fitted, told))
        tried[name] = [first + share * (at - first) for share in _SURVIVES]
    flights([there.wanted_to_read(records[n], x) for n, xs in tried.items() for x in xs])
    for name, record in records.items():
        key = key_of_start(record)
        costs = ((x, there.cost_of_start(record, x)) for x in tried[name])
        out[key] = replace(out[key], origin=next((x for x, cost in costs if math.isfinite(cost)), out[key].origin))
    return out


def _fitted(
    believed: Believed,
    records: Mapping[str, FlightRecord],
    starts: Mapping[str, FreeStart],
    horizon_s: float,
    rounds: int,
) -> dict[str, FreeStart]:
    """Return starts fitted to no more than ``horizon_s`` of each record, by so many rounds at most."""
    out = dict(starts)
    moving = _beginnings(records, horizon_s)
    far = moving  # whose last step was so long that tangents must be taken anew
    for _ in range(rounds):
        out |= _linearised(believed, far, out)
        moved, fallen = _improved(believed, moving, out)
        keys = {n: key_of_start(r) for n, r in moving.items()}
        steps = {n: np.abs(moved[k].origin - out[k].origin) / out[k].std for n, k in keys.items()}
        out |= moved
        moving = {n: r for n, r in moving.items() if fallen[n] > _AT_REST}
        far = {n: r for n, r in moving.items() if np.max(steps[n]) > NEAR}
        if not moving:
            break
    return out


def _guess(believed: Believed, record: FlightRecord, offsets: bool = True) -> FreeStart:
    """Return the start that the first readings of a record tell, without columns."""
    believed = believed.at(record)
    lateral = bool(LATERAL_CHANNELS & set(believed.outputs))
    states = [n for n in STATES if (lateral or n not in _OF_LATERAL) and (n != "h_m" or "h" in record)]
    controls = [c for c in believed.aircraft.controls if c in _OFFSETS and (lateral or c not in _OF_LATERAL)]
    controls = controls if offsets else []
    began = [c for c in controls if f"{c}_cmd" in record and c not in surface_noise(record)]
    began = [c for c in began if np.ptp(record[f"{c}_cmd"]) > MOVED]  # only then may it be elsewhere as a window begins
    origin, std = [], []
    for name in states:
        channel = _CHANNELS.get(name, name)
        measured, other = _FROM_TRIM[name]
        scale = believed.condition.V_m_s if name == "V_m_s" else 1.0
        here = channel in record
        begins = 0.0
        if here:  # what its sensor reads there, by a straight line, less what is believed of bias and scale
            n = min(max(_FEWEST, round(_FITTED_S / record.dt_s)), len(record))
            sensor = next((s for s in believed.suite.sensors if s.channel == channel), None)
            bias, gain = (0.0, 1.0) if sensor is None else (sensor.bias, sensor.scale)
            read = (float(np.polyfit(np.arange(n), record[channel][:n], 1)[1]) - bias) / gain
            begins = read - believed.trimmed.state[channel]
        origin.append(begins)
        std.append(scale * (measured if here else other))
    names = (*states, *controls, *(c + BEGAN for c in began))
    values = np.array([*origin, *(0.0 for _ in (*controls, *began))])
    stds = np.array([*std, *(_OFFSETS[c] for c in (*controls, *began))])
    return FreeStart(names, values, stds, values, np.zeros((len(record), len(believed.outputs), values.size)))


def _linearised(
    believed: Believed, records: Mapping[str, FlightRecord], starts: Mapping[str, FreeStart]
) -> dict[str, FreeStart]:
    """Return the starts with columns at their origins, by flown differences, all together."""
    with_starts = replace(believed, free_starts=starts)
    points = []
    for record in records.values():
        free = starts[key_of_start(record)]
        steps = _STEP * np.diag(free.std)
        points += [(record, x) for x in (free.origin, *(free.origin + s for s in steps))]
    flights([with_starts.wanted_to_read(r, x) for r, x in points])
    out = {}
    for name, record in records.items():
        key = key_of_start(record)
        free = starts[key]
        with located(None, f"record '{name}'"):
            here = with_starts.read_from(record, free.origin)
        columns = []
        for step in _STEP * np.diag(free.std):
            column = np.zeros_like(here)
            for sign in (1.0, -1.0):
                try:
                    column = sign * (with_starts.read_from(record, free.origin + sign * step) - here) / _STEP
                    break
                except Refusal:
                    continue
            columns.append(column)
        out[key] = replace(free, columns=np.stack(columns, axis=-1), known={})
    return out


def _improved(
    believed: Believed, records: Mapping[str, FlightRecord], starts: Mapping[str, FreeStart]
) -> tuple[dict[str, FreeStart], dict[str, float]]:
    """Return starts moved to where they suit better, and by how much chi-square fell in each record."""
    with_starts = replace(believed, free_starts=starts)
    tried, out, fallen = {}, {}, {}
    for name, record in records.items():
        x = starts[key_of_start(record)].origin
        step = with_starts.better_start(record, x) - x
        tried[name] = [x + share * step for share in _SHARES]
    flights([with_starts.wanted_to_read(records[n], x) for n, xs in tried.items() for x in xs])
    for name, record in records.items():
        free = starts[key_of_start(record)]
        before = with_starts.cost_of_start(record, free.origin)
        best, at = before, free.origin
        for x in tried[name]:
            now = with_starts.cost_of_start(record, x)
            if now < best:
                best, at = now, x
        fallen[name] = before - best
        out[key_of_start(record)] = replace(free, origin=at, known={})
    return out, fallen


SHARES = (1.0, 0.5, 0.25)  # of the length of windows that are tried, one after the other
STARTS_IN_TURN = 6  # rounds in which starts of windows and coefficients are fitted at most


def in_windows(
    believed: Believed,
    records: Mapping[str, FlightRecord],
    held_out: Mapping[str, FlightRecord],
    windows: Windows,
    say: Callable[[str], None],
) -> tuple[Believed, Cut, Cut]:
    """Return the belief with the starts of windows, and both kinds of records, cut where that is wanted.

    Where the believed aircraft leaves its limits in windows of a length that is left to us, they are made shorter.
    """
    for share in SHARES:
        both = cut(believed, {**records, **held_out}, windows, share)  # whether the pilot waited for trim shows in all
        if not both.notes:
            break
        given, others = both.of(records), both.of(held_out)
        say("fit where windows start")
        try:
            begun = _begun(believed, given.records, others.records)
            for record in (*given.records.values(), *others.records.values()):
                begun.predict(record)  # the re-tuned aircraft may survive where the believed one does not
            return begun, given, others
        except FlightAborted:
            if windows != "auto" or share == SHARES[-1]:
                raise
    return believed, both.of(records), both.of(held_out)


def _begun(believed: Believed, records: Mapping[str, FlightRecord], held_out: Mapping[str, FlightRecord]) -> Believed:
    """Return the belief with starts of windows, fitted to the re-tuned model in turn with its coefficients."""
    both, naming = {**records, **held_out}, tuple(records.values())
    out = begin_freely(believed, both)
    tuned = retune(Point.at(out, out, naming))
    for _ in range(STARTS_IN_TURN):
        out = begin_freely(out, both, out.with_nuisances(tuned.by_name))
        better = retune(Point.at(out, out, naming, tuned.nuisances))
        fallen, tuned = tuned.chi2 - better.chi2, better
        if fallen < 1.0:
            break
    return out
