"""A simulated flight as PX4 and ArduPilot log it: gusts, servos with delay, one IMU, a pitot tube.

The aircraft is the Taurus: servos with a lag of 30 ms and a rate limit, here behind a delay of 20 ms. The pilot flies
3-2-1-1 on the elevator, and doublets on aileron and rudder, hands off before and after; the logger rests between them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from writers import Samples, dataflash_of, quaternion, ulog_of

import testbench as tb
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.flight.air import Air, turbulence_rms

V_M_S, H_M = 14.0, 100.0
THROWS = {"de": np.radians(12.5), "da": np.radians(25.0), "dr": np.radians(25.0)}
DELAY_S, LAG_S = 0.02, 1.0 / 33.0
GUST_RMS_M_S = 0.15  # of the vertical component: light
LOOP_HZ = 50.0  # of the autopilot's loop, which holds its commands
LEAD_S, TAIL_S, REST_S = 3.0, 5.5, 8.0
IMU_M = (0.04, 0.0, -0.01)  # from the centre of gravity, forward, right, down
CHANNELS = ("V", "alpha", "p", "q", "r", "pdot", "qdot", "rdot", "phi", "theta", "psi", "ax", "ay", "az", "h", "hdot")
Steps = Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Piece:
    """A manoeuvre: control -> (duration s, level rad) one after another, from ``LEAD_S`` on; 0 s starts at once."""

    steps: Mapping[str, Steps]

    @property
    def duration_s(self) -> float:
        return LEAD_S + max(sum(d for d, _ in steps) for steps in self.steps.values()) + TAIL_S


def _multistep(sign: float, unit_s: float = 0.15, level: float = np.radians(2.2)) -> Steps:
    return [(n * unit_s, sign * s * level) for n, s in ((3, 1), (2, -1), (1, 1), (1, -1))]


def _doublet(level: float, wait_s: float = 0.0, half_s: float = 0.4) -> Steps:
    return [(wait_s, 0.0), (half_s, level), (half_s, -level)]


PIECES = (
    Piece({"de": _multistep(1.0)}),
    Piece({"de": _multistep(-1.0)}),
    Piece({"de": _multistep(1.0)}),
    Piece({"de": _multistep(-1.0)}),
    *2
    * (
        Piece({"da": _doublet(np.radians(2.2)), "dr": _doublet(np.radians(2.2), 1.2)}),
        Piece({"da": _doublet(np.radians(-2.2)), "dr": _doublet(np.radians(-2.2), 1.2)}),
    ),
)


@cache
def aircraft():
    return tb.load_aircraft("taurus")


@cache
def trimmed():
    return tb.trim(aircraft(), tb.FlightCondition(V_M_S, H_M))


@cache
def truth() -> dict[str, float]:
    """Derivative -> its value, of the aircraft linearised at the condition flown; and the servos' lags."""
    found = dimensional_derivatives(tb.linearise(aircraft(), trimmed()), trimmed())
    return {d.name: d.held for d in found} | {f"tau_{c}": LAG_S for c in THROWS}


@dataclass(frozen=True)
class Flown:
    """One piece: times (n,) s on the clock of the log, channels (n, ...), times of the loop (k,), commands (k,) rad."""

    t_s: np.ndarray
    x: Mapping[str, np.ndarray]
    loop_s: np.ndarray
    commands: Mapping[str, np.ndarray]


def _levels(steps: Steps, t: np.ndarray) -> np.ndarray:
    out, at = np.zeros(t.size), LEAD_S
    for duration, level in steps:
        out[(t >= at - 1e-9) & (t < at + duration - 1e-9)] = level
        at += duration
    return out


def fly(seed: int, gust_rms_m_s: float = GUST_RMS_M_S) -> list[Flown]:
    """Return the pieces of a flight; the seed is that of the gusts and of when the loop runs."""
    rng = np.random.default_rng([seed, 1])
    out, begin = [], 0.0
    trim = trimmed()
    for number, piece in enumerate(PIECES):
        n = round(piece.duration_s * trim.rate_hz)
        t = np.arange(n) / trim.rate_hz
        loop = np.arange(rng.uniform(0.0, 1.0 / LOOP_HZ), piece.duration_s, 1.0 / LOOP_HZ)
        asked = {name: _levels(steps, loop) for name, steps in piece.steps.items()}
        late = np.searchsorted(loop, t - DELAY_S, side="right") - 1
        u = np.column_stack([np.where(late < 0, 0.0, row[np.maximum(late, 0)]) for row in asked.values()])
        signal = tb.InputSignal(t, u, tuple(asked))
        air = Air(turbulence_rms_m_s=turbulence_rms(gust_rms_m_s, H_M), seed=int(rng.integers(2**31)))
        record = tb.fly(
            aircraft(), trim, tb.Manoeuvre(f"piece {number}", signal, settle_s=0.0), trim.rate_hz, CHANNELS, air
        )
        every = {name: trim.controls[name] + asked.get(name, np.zeros(loop.size)) for name in THROWS}
        out.append(Flown(begin + record.t_s, {c: record[c] for c in CHANNELS}, begin + loop, every))
        begin += piece.duration_s + REST_S
    return out


def _lagged(x: np.ndarray, dt: float, lag_s: float) -> np.ndarray:
    from scipy.signal import lfilter

    a = np.exp(-dt / lag_s)
    return np.asarray(lfilter([1.0 - a], [1.0, -a], x - x[0])) + x[0]


def _filtered(x: np.ndarray, dt: float, cut_hz: float) -> np.ndarray:
    """The low pass of second order that autopilots put behind gyro and accelerometer."""
    from scipy.signal import butter, lfilter

    b, a = butter(2, 2.0 * cut_hz * dt)
    return np.asarray(lfilter(b, a, x - x[0])) + x[0]


@dataclass(frozen=True)
class Instruments:
    """What they add; figures are those of small MEMS units on an airframe that vibrates (estimates)."""

    gyro_hz: float = 40.0
    accelerometer_hz: float = 30.0
    gyro_noise: float = np.radians(0.3)
    gyro_bias: float = np.radians(0.2)
    accelerometer_noise: float = 0.25
    accelerometer_bias: float = 0.1
    speed_noise: float = 0.2
    speed_lag_s: float = 0.05
    speed_scale: float = 0.01
    attitude_lag_s: float = 0.02
    attitude_noise: float = np.radians(0.05)
    attitude_wander: float = np.radians(0.4)
    attitude_time_s: float = 20.0


class _Reader:
    """Reads a flight at any times, with errors that are drawn once for the flight."""

    def __init__(self, flown: Sequence[Flown], rng: np.random.Generator, own: Instruments) -> None:
        self.flown, self.rng, self.own = flown, rng, own
        self.gyro, self.accelerometer = (
            own.gyro_bias * rng.standard_normal(3),
            own.accelerometer_bias * rng.standard_normal(3),
        )
        self.scale = 1.0 + own.speed_scale * rng.standard_normal()

    def times(self, rate_hz: float, jitter_s: float) -> list[np.ndarray]:
        """Times at which a message is taken in each piece: late by up to ``jitter_s``."""
        out = []
        for f in self.flown:
            t = np.arange(f.t_s[0] + self.rng.uniform(0.0, 1.0 / rate_hz), f.t_s[-1] - jitter_s, 1.0 / rate_hz)
            out.append(np.round(t + self.rng.uniform(0.0, jitter_s, t.size), 6))
        return out

    def read(self, make, times: Sequence[np.ndarray]) -> np.ndarray:
        rows = []
        for f, at in zip(self.flown, times, strict=True):
            columns = make(f.x, f.t_s[1] - f.t_s[0])
            rows.append(np.column_stack([np.interp(at, f.t_s, c) for c in columns]))
        return np.vstack(rows)

    def rates(self, times: Sequence[np.ndarray]) -> np.ndarray:
        clean = self.read(lambda x, dt: [_filtered(x[n], dt, self.own.gyro_hz) for n in "pqr"], times)
        return clean + self.gyro + self.own.gyro_noise * self.rng.standard_normal(clean.shape)

    def forces(self, times: Sequence[np.ndarray]) -> np.ndarray:
        def make(x, dt):
            w, wdot = (np.column_stack([x[n + s] for n in "pqr"]) for s in ("", "dot"))
            at = np.column_stack([x["ax"], x["ay"], x["az"]]) + np.cross(wdot, IMU_M) + np.cross(w, np.cross(w, IMU_M))
            return [_filtered(at[:, i], dt, self.own.accelerometer_hz) for i in range(3)]

        clean = self.read(make, times)
        return clean + self.accelerometer + self.own.accelerometer_noise * self.rng.standard_normal(clean.shape)

    def attitude(self, times: Sequence[np.ndarray]) -> np.ndarray:
        own = self.own
        names = ("phi", "theta", "psi")
        clean = self.read(lambda x, dt: [_lagged(np.unwrap(x[n]), dt, own.attitude_lag_s) for n in names], times)
        t = np.concatenate(times)
        wander = np.empty(clean.shape)
        value = own.attitude_wander * self.rng.standard_normal(3)
        for k, step in enumerate(np.diff(t, prepend=t[0])):
            a = np.exp(-step / own.attitude_time_s)
            value = a * value + own.attitude_wander * np.sqrt(1.0 - a * a) * self.rng.standard_normal(3)
            wander[k] = value
        return clean + wander + own.attitude_noise * self.rng.standard_normal(clean.shape)

    def speed(self, times: Sequence[np.ndarray]) -> np.ndarray:
        clean = self.read(lambda x, dt: [_lagged(x["V"], dt, self.own.speed_lag_s)], times)
        return self.scale * clean + self.own.speed_noise * self.rng.standard_normal(clean.shape)

    def height(self, times: Sequence[np.ndarray]) -> np.ndarray:
        clean = self.read(lambda x, dt: [x["h"]], times)
        return clean + 0.3 * self.rng.standard_normal(clean.shape)

    def commands(self, late_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Times (n,) at which the loop's commands are logged, and fractions of full throw (n, 3) of de, da, dr."""
        t = np.concatenate([f.loop_s for f in self.flown])
        t = np.round(t + self.rng.uniform(0.0, late_s, t.size), 6)
        return t, np.column_stack([np.concatenate([f.commands[n] for f in self.flown]) / THROWS[n] for n in THROWS])


PX4_SETTINGS: dict[str, float] = {
    "CA_AIRFRAME": 1, "CA_SV_CS_COUNT": 4,
    "CA_SV_CS0_TYPE": 1, "CA_SV_CS0_TRQ_R": -0.5, "CA_SV_CS1_TYPE": 2, "CA_SV_CS1_TRQ_R": 0.5,
    "CA_SV_CS2_TYPE": 3, "CA_SV_CS2_TRQ_P": 1.0, "CA_SV_CS3_TYPE": 4, "CA_SV_CS3_TRQ_Y": 1.0,
    "EKF2_IMU_POS_X": IMU_M[0], "EKF2_IMU_POS_Y": IMU_M[1], "EKF2_IMU_POS_Z": IMU_M[2],
    "IMU_GYRO_CUTOFF": 40.0, "IMU_ACCEL_CUTOFF": 30.0,
}  # fmt: skip


def px4_log(seed: int, flown: Sequence[Flown] | None = None, own: Instruments = Instruments()) -> bytes:
    """A PX4 log of a flight, servos by control allocation: left and right aileron, elevator, rudder."""
    reader = _Reader(flown or fly(seed), np.random.default_rng([seed, 2]), own)
    at = {name: reader.times(rate, 1e-3) for name, rate in (("rates", 100.0), ("forces", 100.0), ("attitude", 50.0),
                                                            ("speed", 10.0), ("height", 20.0))}  # fmt: skip
    all_at = {name: np.concatenate(times) for name, times in at.items()}
    logged, (de, da, dr) = (lambda found: (found[0], found[1].T))(reader.commands(1e-3))
    servos = np.column_stack([-da, da, -de, -dr, *[np.full(de.size, np.nan)] * 4])
    phi, theta, psi = reader.attitude(at["attitude"]).T
    stamp, sampled = "uint64_t timestamp;", "uint64_t timestamp;uint64_t timestamp_sample;"
    topics: list[Samples] = [
        ("vehicle_angular_velocity", f"{sampled}float[3] xyz;", all_at["rates"], reader.rates(at["rates"])),
        ("vehicle_acceleration", f"{sampled}float[3] xyz;", all_at["forces"], reader.forces(at["forces"])),
        ("vehicle_attitude", f"{sampled}float[4] q;", all_at["attitude"], quaternion(phi, theta, psi)),
        ("airspeed_validated", f"{stamp}float true_airspeed_m_s;", all_at["speed"], reader.speed(at["speed"])),
        ("vehicle_air_data", f"{stamp}float baro_alt_meter;", all_at["height"], reader.height(at["height"])),
        ("actuator_servos", f"{stamp}float[8] control;", logged, servos),
    ]
    return ulog_of(topics, PX4_SETTINGS)


ARDUPILOT = (
    (130, "IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    (131, "ATT", "QccC", "TimeUS,Roll,Pitch,Yaw"),
    (132, "ARSP", "QBf", "TimeUS,I,Airspeed"),
    (133, "RCOU", "QHHHH", "TimeUS,C1,C2,C3,C4"),
    (134, "PARM", "QNf", "TimeUS,Name,Value"),
    (135, "MSG", "QZ", "TimeUS,Message"),
    (136, "BARO", "QBf", "TimeUS,I,Alt"),
    (137, "UNIT", "QbZ", "TimeUS,Id,Label"),
    (138, "MULT", "Qbd", "TimeUS,Id,Mult"),
    (139, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds"),
)
_UNITS = {
    "s": "s",
    "E": "rad/s",
    "o": "m/s/s",
    "d": "deg",
    "h": "degheading",
    "n": "m/s",
    "Y": "us",
    "#": "instance",
    "m": "m",
}
_FMTU = {
    130: ("s#EEEooo", "F-000000"),
    131: ("sddh", "FBBB"),
    132: ("s#n", "F-0"),
    133: ("sYYYY", "F----"),
    136: ("s#m", "F-0"),
}
ARDUPILOT_SETTINGS: dict[str, float] = {
    **{f"SERVO{i}_{key}": value for i in (1, 2, 4) for key, value in (("MIN", 1000), ("TRIM", 1500), ("MAX", 2000))},
    "SERVO1_FUNCTION": 4, "SERVO2_FUNCTION": 19, "SERVO2_REVERSED": 1, "SERVO4_FUNCTION": 21,
    "INS_POS1_X": IMU_M[0], "INS_POS1_Y": IMU_M[1], "INS_POS1_Z": IMU_M[2],
    "INS_GYRO_FILTER": 20.0, "INS_ACCEL_FILTER": 20.0, "SCHED_LOOP_RATE": LOOP_HZ,
}  # fmt: skip


def ardupilot_log(seed: int, flown: Sequence[Flown] | None = None, own: Instruments | None = None) -> bytes:
    """An ArduPilot log of a flight, with the servos' functions, one of them reversed, and the units of its columns."""
    own = own or Instruments(gyro_hz=20.0, accelerometer_hz=20.0)
    reader = _Reader(flown or fly(seed), np.random.default_rng([seed, 3]), own)
    messages: list[tuple[float, str, Sequence[object]]] = [(-9.0, "MSG", (0, b"ArduPlane V4.5.7"))]
    messages += [(-8.0, "UNIT", (0, ord(key), unit.encode())) for key, unit in _UNITS.items()]
    messages += [
        (-8.0, "MULT", (0, ord(key), value)) for key, value in (("-", 0.0), ("0", 1.0), ("B", 0.01), ("F", 1e-6))
    ]
    messages += [
        (-7.0, "FMTU", (0, kind, units.encode(), factors.encode())) for kind, (units, factors) in _FMTU.items()
    ]
    messages += [(-6.0, "PARM", (0, name.encode(), value)) for name, value in ARDUPILOT_SETTINGS.items()]

    def put(name: str, t: np.ndarray, rows) -> None:
        messages.extend((float(at), name, (round((12.5 + at) * 1e6), *row)) for at, row in zip(t, rows, strict=True))

    at = reader.times(50.0, 2e-3)
    put("IMU", np.concatenate(at), [(0, *map(float, row)) for row in np.hstack([reader.rates(at), reader.forces(at)])])
    at = reader.times(50.0, 2e-3)
    angles = np.degrees(reader.attitude(at))
    put(
        "ATT",
        np.concatenate(at),
        [(round(100 * a), round(100 * b), round(100 * (c % 360.0)) % 36000) for a, b, c in angles],
    )
    at = reader.times(10.0, 2e-3)
    put("ARSP", np.concatenate(at), [(0, float(v)) for v in reader.speed(at)[:, 0]])
    at = reader.times(10.0, 2e-3)
    put("BARO", np.concatenate(at), [(0, float(h)) for h in reader.height(at)[:, 0]])
    t, parts = reader.commands(2e-3)
    pulses = [(round(1500 + 500 * da), round(1500 + 500 * de), 1400, round(1500 - 500 * dr)) for de, da, dr in parts]
    put("RCOU", t, pulses)
    return dataflash_of(ARDUPILOT, [(name, row) for _, name, row in sorted(messages, key=lambda m: m[0])])


LOGS = {"px4": ("flight.ulg", px4_log), "ardupilot": ("flight.bin", ardupilot_log)}
