"""Fly a manoeuvre: JSBSim from trim to the end of the inputs, recorded as truth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from typing import Any, Self

import numpy as np

from testbench.aircraft import Aircraft
from testbench.aircraft.airframe import station_sources, with_stations
from testbench.core.channels import CHANNELS, CONTROLS, channel, station_channels
from testbench.core.constants import DEG_RAD, FT_M
from testbench.core.door import NUMBER, require_room
from testbench.core.errors import ChannelError, LimitError, nearest
from testbench.core.named import Named, obtain
from testbench.core.record import FlightAborted, FlightRecord, FloatArray
from testbench.core.scenario.inputs import Input
from testbench.flight.air import Air
from testbench.flight.condition import Start, TrimmedFlight
from testbench.flight.executive import Executive
from testbench.flight.recorder import Recorder
from testbench.flight.start import Beginning
from testbench.flight.trim import steady_wind
from testbench.inputs import build
from testbench.inputs.signal import InputSignal

_JSBSIM = version("jsbsim")  # asked once: the answer takes as long as a flight of some seconds


@dataclass(frozen=True)
class Manoeuvre:
    """Inputs flown from trim: ``settle_s`` of undisturbed flight, then the signal's clock starts.

    Example:
        >>> import testbench as tb
        >>> signal = tb.InputSignal([0.0, 0.01], [[0.0], [0.02]], ("de",))
        >>> tb.Manoeuvre("step", signal, settle_s=1.0).duration_s
        1.02
    """

    name: str
    signal: InputSignal
    settle_s: float = 2.0

    @classmethod
    def of(cls, name: str, inputs: Sequence[Input], duration_s: float, rate_hz: float, settle_s: float = 0.0) -> Self:
        """Return a manoeuvre from entries of a scenario, at the simulation rate.

        Raises:
            LimitError: an entry breaks its law.
        """
        return cls(name, build(inputs, duration_s, rate_hz), settle_s)

    @property
    def duration_s(self) -> float:
        """Length of the record, s."""
        return self.settle_s + self.signal.t_s.size * self.signal.dt_s


def stride(rate_hz: float, log_rate_hz: float) -> int:
    """Return how many simulation frames make one log interval.

    Raises:
        LimitError: the log rate does not divide the simulation rate.
    """
    ratio = rate_hz / log_rate_hz
    if ratio < 1.0 - 1e-9 or abs(ratio - round(ratio)) > 1e-6:
        near = sorted({rate_hz / math.ceil(max(ratio, 1.0)), rate_hz / max(math.floor(ratio), 1)})
        raise LimitError(
            f"a log rate must divide the simulation rate of {rate_hz:g} Hz, got {log_rate_hz:g} Hz; simulate at "
            f"{math.ceil(max(ratio, 1.0)) * log_rate_hz:g} Hz (simulation.rate_hz), or log at "
            f"{' or '.join(f'{n:g}' for n in near)} Hz"
        )
    return round(ratio)


def require_room_to_fly(duration_s: float, rate_hz: float, log_rate_hz: float) -> None:
    """Check that a flight's commands, and all its channels as logged, may be held in memory.

    Raises:
        SizeError: they take more than the limit of :mod:`testbench.core.door`.
    """
    require_room(
        f"a flight of {duration_s:g} s at {rate_hz:g} Hz, logged at {log_rate_hz:g} Hz,",
        NUMBER * duration_s * (rate_hz * len(CONTROLS) + log_rate_hz * len(CHANNELS)),
        "shorten it (duration_s, settle_s) or log it at a lower rate",
    )


def commands(aircraft: Aircraft, trimmed: TrimmedFlight, manoeuvre: Manoeuvre) -> FloatArray:
    """Return the absolute commands (frames + 1, controls of the signal) at every frame, trim included, SI.

    Raises:
        LimitError: a command leaves the range of its control; inputs are never clipped.
    """
    signal = manoeuvre.signal
    settle = round(manoeuvre.settle_s * trimmed.rate_hz)
    u = np.zeros((settle + signal.t_s.size + 1, len(signal.channels)))
    u[settle:-1] = signal.u
    u[-1] = signal.u[-1]
    for i, name in enumerate(signal.channels):
        if name not in aircraft.controls:
            raise LimitError(f"{aircraft.name} has no control '{name}'{nearest(name, aircraft.controls)}")
        u[:, i] += trimmed.controls[name]
        control = aircraft.controls[name]
        if not (control.low - 1e-9 <= u[:, i].min() and u[:, i].max() <= control.full + 1e-9):
            scale, unit = (100.0, "%") if name == "thr" else (1.0 / DEG_RAD, "deg")
            worst = u[np.argmax(np.abs(u[:, i] - 0.5 * (control.full + control.low))), i]
            raise LimitError(
                f"{control.low * scale:g} <= {name} <= {control.full * scale:g} {unit} must hold for {aircraft.name}, "
                f"got {worst * scale:.2f} {unit} ({trimmed.controls[name] * scale:.2f} at trim and "
                f"{(worst - trimmed.controls[name]) * scale:.2f} from the input); reduce the amplitude"
            )
    return u


def beginning_of(trimmed: TrimmedFlight, manoeuvre: Manoeuvre, start: Start | None) -> Beginning:
    """Return where a manoeuvre begins: at the trim, or off it with the controls where they are commanded first."""
    if start is None or manoeuvre.settle_s > 0.0:
        return Beginning(trimmed, start, trimmed.controls)
    moved = zip(manoeuvre.signal.channels, manoeuvre.signal.u[0].tolist(), strict=True)
    return Beginning(trimmed, start, {**trimmed.controls, **{n: trimmed.controls[n] + x for n, x in moved}})


def fly(
    aircraft: Named[Aircraft],
    trimmed: TrimmedFlight,
    manoeuvre: Manoeuvre,
    log_rate_hz: float,
    channels: Sequence[str] | None = None,
    air: Air | None = None,
    start: Start | None = None,
) -> FlightRecord:
    """Fly ``manoeuvre`` from ``trimmed`` and return the truth, logged every 1/``log_rate_hz`` s from t = 0.

    The servos take commands as running linearly from frame to frame: a step of the held signal is flown as a ramp over
    the frame before it (2 ms at 500 Hz), half a frame early in the mean.

    Args:
        aircraft: the aircraft that was trimmed.
        trimmed: where the flight starts; gives the simulation rate.
        manoeuvre: the inputs; the signal must be sampled at the simulation rate.
        log_rate_hz: must divide the simulation rate.
        channels: what is logged; every channel of the simulator and of the wing stations if not given.
        air: turbulence and gust; its steady wind must be the one that was trimmed in. If not given, the air keeps the
            steady wind of the trim, which is none unless ``trim`` was given one.
        start: how far from the trim the flight begins; its controls then begin where they are commanded first.

    Raises:
        LimitError: a rate, a command, the air or the start breaks its law.
        FlightAborted: the flight left the aircraft's limits or ceased to be finite; the error carries the record.

    Example:
        >>> import numpy as np
        >>> import testbench as tb
        >>> taurus = tb.load_aircraft("taurus")
        >>> trimmed = tb.trim(taurus, tb.FlightCondition(12.0, 100.0))
        >>> t = np.arange(round(5.0 * trimmed.rate_hz)) / trimmed.rate_hz
        >>> signal = tb.InputSignal(t, np.deg2rad(2.0) * (t < 1.0)[:, None], ("de",))
        >>> tb.fly(taurus, trimmed, tb.Manoeuvre("pulse", signal), log_rate_hz=60.0).kind
        'truth'
    """
    aircraft = obtain(Aircraft, aircraft)
    step, u, wind = checked(aircraft, trimmed, manoeuvre, log_rate_hz, air)
    fdm = Executive(aircraft, trimmed.rate_hz, trimmed.condition)
    beginning = beginning_of(trimmed, manoeuvre, start)
    beginning.put(fdm)

    names, wanted = logged_of(aircraft, fdm.channels, channels)
    first = np.array([beginning.controls[n] for n in manoeuvre.signal.channels])
    data, reason = _run(fdm, manoeuvre.signal.channels, first, u, step, names, wind)
    provenance = provenance_of(aircraft, trimmed, manoeuvre, air, start)
    record = truth_of(aircraft, data, names, wanted, log_rate_hz, provenance, reason)
    if record.reason:
        raise aborted(record, aircraft.name, manoeuvre.name, log_rate_hz)
    return record


def checked(
    aircraft: Aircraft, trimmed: TrimmedFlight, manoeuvre: Manoeuvre, log_rate_hz: float, air: Air | None
) -> tuple[int, FloatArray, FloatArray | None]:
    """Return what a flight is given, lawful: frames per row, absolute commands (frames + 1, controls), SI, and the
    velocity of the air (frames + 1, 3), m/s, or None if it does not change.

    Raises:
        LimitError: a rate, a command or the air breaks its law.
        SizeError: the flight takes more memory than the limit of :mod:`testbench.core.door`.
    """
    rate = trimmed.rate_hz
    if abs(manoeuvre.signal.dt_s * rate - 1.0) > 1e-6:
        raise LimitError(
            f"a signal must be sampled at the simulation rate of {rate:g} Hz, got {1 / manoeuvre.signal.dt_s:g} Hz"
        )
    step = stride(rate, log_rate_hz)
    require_room_to_fly(manoeuvre.duration_s, rate, log_rate_hz)
    u = commands(aircraft, trimmed, manoeuvre)
    return step, u, None if air is None else _moving_air(air, trimmed, u.shape[0], manoeuvre.settle_s)


def truth_of(
    aircraft: Aircraft,
    data: FloatArray,
    names: tuple[str, ...],
    wanted: Sequence[str] | None,
    log_rate_hz: float,
    provenance: Mapping[str, Any],
    reason: str,
) -> FlightRecord:
    """Return the record of a flight: the channels logged, wing stations made from them, and of all those wanted.

    Args:
        aircraft: what flew.
        data: (rows, names), SI.
        names: channels that were logged.
        wanted: channels of the record; all if None.
        log_rate_hz: rows per second.
        provenance: of the record.
        reason: why the flight ended before its time, or "". A flight ends where its first number is not finite.

    Raises:
        FlightAborted: it has no finite row.
    """
    finite = np.isfinite(data)
    if not finite.all():
        row, column = np.argwhere(~finite)[0]
        data, reason = data[:row], f"{names[column]} ceased to be a finite number"
        if not row:
            raise FlightAborted(
                f"{aircraft.name} must begin a flight with finite numbers, got {names[column]} that is none; give "
                "another condition or start",
                *(0.0, reason),
            )
    record = FlightRecord(
        t_s=np.arange(len(data)) / log_rate_hz,
        channels=names,
        data=data,
        kind="truth",
        provenance=provenance,
        outcome="aborted" if reason else "completed",
        reason=reason,
    )
    if aircraft.flown_stations() and (wanted is None or set(wanted) != set(names)):
        record = with_stations(record, aircraft.flown_stations(), aircraft.flown_modes())
    return record if wanted is None or tuple(wanted) == record.channels else record.select(wanted)


def aborted(record: FlightRecord, aircraft: str, manoeuvre: str, log_rate_hz: float) -> FlightAborted:
    """Return the error of a flight that left its limits, which carries its record."""
    time_s = len(record) / log_rate_hz
    said = (
        f"{aircraft} left its limits at t = {time_s:.2f} s of manoeuvre '{manoeuvre}': {record.reason}; "
        "reduce the amplitude or the duration of the input"
    )
    if len(record) <= 1:
        said = (
            f"{aircraft} is outside of its limits where manoeuvre '{manoeuvre}' begins: {record.reason}; give another "
            "condition, or other [limits] in an aircraft.toml"
        )
    return FlightAborted(said, time_s, record.reason, record)


def logged_of(
    aircraft: Aircraft, known: tuple[str, ...], channels: Sequence[str] | None
) -> tuple[tuple[str, ...], tuple[str, ...] | None]:
    """Return the channels of the simulator to log, and those wanted of the record (None: all, wing stations too).

    Args:
        aircraft: what flies.
        known: channels that the simulator has of it.
        channels: what is wanted; all if None.

    Raises:
        ChannelError: there is no such channel.
    """
    if channels is None:
        return known, None
    elastic = aircraft.flown_modes()
    of_stations = set(station_channels(len(aircraft.flown_stations()), elastic is not None))
    sources = station_sources(elastic) if of_stations & set(channels) else ()
    for c in channels:
        if c not in of_stations and c not in known:
            channel(c)
            raise ChannelError(f"{aircraft.name} has no channel '{c}' in flight; leave it out")
    return tuple(dict.fromkeys([*(c for c in channels if c not in of_stations), *sources])), tuple(channels)


def _moving_air(air: Air, trimmed: TrimmedFlight, n: int, settle_s: float) -> FloatArray | None:
    """Return the velocity of the air (n, 3), m/s, at every frame, or None if it is the trim's all the time.

    Raises:
        LimitError: the flight was trimmed in another steady wind.
    """
    was = steady_wind(trimmed)
    if not np.allclose(air.wind_m_s, was, rtol=0.0, atol=1e-9):
        raise LimitError(
            f"the steady wind must be the one of the trim, got {_triple(air.wind_m_s)} m/s north, east, down after a "
            f"trim in {_triple(was)}; call trim(..., air=air)"
        )
    return None if air.is_steady else air.velocities(n, trimmed.rate_hz, trimmed.condition, settle_s)


def _triple(values: Sequence[float]) -> str:
    return ", ".join(f"{v:g}" for v in values)


def _run(
    fdm: Executive,
    controls: Sequence[str],
    first: FloatArray,
    u: FloatArray,
    step: int,
    names: Sequence[str],
    wind: FloatArray | None,
) -> tuple[FloatArray, str]:
    """Run JSBSim with the commands ``u`` (frames + 1, controls), and log the channels ``names`` every ``step`` frames.

    ``first`` (controls,) is where the commands are before; ``wind`` is the velocity of the air (frames + 1, 3) north,
    east, down, m/s, or None if it does not change.

    Returns:
        The rows logged, SI, and why the flight ended before its time, or "". The row outside the limits is left out:
        it may hold NaN.
    """
    log = Recorder(fdm, names)
    rows = (u.shape[0] - 1) // step + 1
    taken = log.empty(rows)
    log.take(taken, 0)
    scale = np.array([fdm.aircraft.controls[n].scale for n in controls])
    columns = [column.tolist() for column in (u / scale).T]
    changed = np.any(np.diff(np.vstack([first, first, u[1:]]), axis=0) != 0.0, axis=1).tolist()
    writers = [fdm.command_nodes[n].set_double_value for n in controls]
    if wind is not None:  # written like the commands: nothing is added to the loop of a flight in steady air
        columns += [column.tolist() for column in (wind / FT_M).T]
        writers += [node.set_double_value for node in fdm.gust_nodes]
        changed = [True] * len(changed)
    run, take = fdm.fdm.run, log.take
    row = 1
    try:
        for row in range(1, rows):
            for frame in range((row - 1) * step + 1, row * step + 1):
                if changed[frame]:
                    for write, column in zip(writers, columns, strict=True):
                        write(column[frame])
                run()
            reason = take(taken, row)
            if reason:
                return log.si(taken, row), reason
    except RuntimeError as error:  # a function has no value there
        return log.si(taken, row), f"JSBSim stopped: {fdm.stopped(error)}"
    return log.si(taken, rows), ""


def provenance_of(
    aircraft: Aircraft, trimmed: TrimmedFlight, manoeuvre: Manoeuvre, air: Air | None = None, start: Start | None = None
) -> dict[str, Any]:
    """Return what the record of a flight says of where it comes from."""
    c = trimmed.condition
    out = {
        "aircraft": aircraft.name,
        "amendments": [a.name for a in aircraft.amendments],
        "V_m_s": c.V_m_s,
        "h_m": c.h_m,
        "gamma_rad": c.gamma_rad,
        "manoeuvre": manoeuvre.name,
        "settle_s": manoeuvre.settle_s,
        "simulation_rate_hz": trimmed.rate_hz,
        "jsbsim": _JSBSIM,
    }
    if start is not None:
        out["start"] = {n: x for n, x in asdict(start).items() if x}
    return out if air is None else out | {"air": air.as_provenance()}
