"""Small logs of a flight whose truth is known, written byte by byte after the formats' own descriptions."""

import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache

import h5py
import numpy as np

G0 = 9.80665
START_S = 12.5  # what the clock of the autopilot shows when the log begins


def elevator(t: np.ndarray) -> np.ndarray:
    """Nose-up command -1..1: a doublet at 5 s and a 3-2-1-1 at 20 s."""
    u = np.zeros_like(t)
    for start, end, sign in ((5, 6, 1), (6, 7, -1), (20, 21.5, 1), (21.5, 22.5, -1), (22.5, 23, 1), (23, 23.5, -1)):
        u[(t >= start) & (t < end)] = 0.2 * sign
    return u


def pitch_rate(t: np.ndarray) -> np.ndarray:
    return 0.1 * np.sin(2.0 * np.pi * 0.5 * t)


def attitude(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bank, pitch and heading, rad; the heading passes through 180 deg."""
    return 0.2 * np.sin(t), 0.1 + 0.05 * np.cos(t), 3.0 + 0.02 * t


def calm(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pitch rate, pitch angle and vertical specific force that have nothing to do with the elevator."""
    return pitch_rate(t), attitude(t)[1], np.full(t.size, -G0)


Z_ALPHA, M_ALPHA, M_Q, M_DE, SPEED, THROW = -2.0, -12.0, -2.5, -15.0, 18.0, np.radians(20.0)


@cache
def _flown() -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) and alpha, q, theta (n, 3) of a short period that the elevator drives, at 1 kHz from rest."""
    from scipy.linalg import expm

    dt = 1e-3
    held = np.zeros((4, 4))
    held[:3, :3] = np.array([[Z_ALPHA, 1.0, 0.0], [M_ALPHA, M_Q, 0.0], [0.0, 1.0, 0.0]]) * dt
    held[1, 3] = M_DE * dt
    F = expm(held)
    clock = np.arange(36_000) * dt
    x, u = np.zeros((clock.size, 3)), -THROW * elevator(clock)
    for k in range(clock.size - 1):
        x[k + 1] = F[:3, :3] @ x[k] + F[:3, 3] * u[k]
    return clock, x


def short_period(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same signals of a short period that the elevator drives."""
    clock, x = _flown()
    alpha, q, theta = (np.interp(t, clock, x[:, i]) for i in range(3))
    return q, 0.1 + theta, -G0 + SPEED * Z_ALPHA * alpha


Motion = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]


def quaternion(phi: np.ndarray, theta: np.ndarray, psi: np.ndarray) -> np.ndarray:
    c, s = [np.cos(a / 2) for a in (phi, theta, psi)], [np.sin(a / 2) for a in (phi, theta, psi)]
    return np.column_stack([
        c[0] * c[1] * c[2] + s[0] * s[1] * s[2],
        s[0] * c[1] * c[2] - c[0] * s[1] * s[2],
        c[0] * s[1] * c[2] + s[0] * c[1] * s[2],
        c[0] * c[1] * s[2] - s[0] * s[1] * c[2],
    ])  # fmt: skip


def _ulog_message(kind: bytes, body: bytes) -> bytes:
    return struct.pack("<H", len(body)) + kind + body


ULOG_TOPICS = (
    ("vehicle_angular_velocity", "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;", 250.0),
    ("vehicle_attitude", "uint64_t timestamp;uint64_t timestamp_sample;float[4] q;", 100.0),
    ("vehicle_acceleration", "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;", 100.0),
    ("airspeed_validated", "uint64_t timestamp;float true_airspeed_m_s;", 10.0),
    ("vehicle_torque_setpoint", "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;", 100.0),
)
Samples = tuple[str, str, np.ndarray, np.ndarray]
"""A topic ("#1" behind it for the second instance), its fields, times in s and (n, columns) values as 32-bit floats."""


def ulog_of(topics: Sequence[Samples], settings: Mapping[str, float] | None = None) -> bytes:
    """A PX4 log of any topics: header, flag bits, formats, settings, subscriptions, then data in the order of time.

    Sensors are read 3 ms before they are published.
    """
    out = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", int(START_S * 1e6))]
    out.append(_ulog_message(b"B", bytes(40)))
    key = b"char[3] sys_name"
    out.append(_ulog_message(b"I", bytes([len(key)]) + key + b"PX4"))
    formats = {name.partition("#")[0]: fields for name, fields, _, _ in topics}
    out += [_ulog_message(b"F", f"{name}:{fields}".encode()) for name, fields in formats.items()]
    for name, value in (settings or {}).items():
        key = f"{'int32_t' if isinstance(value, int) else 'float'} {name}".encode()
        body = struct.pack("<i" if isinstance(value, int) else "<f", value)
        out.append(_ulog_message(b"P", bytes([len(key)]) + key + body))
    samples = []
    for i, (name, fields, times, values) in enumerate(topics):
        topic, _, instance = name.partition("#")
        out.append(_ulog_message(b"A", struct.pack("<BH", int(instance or 0), i) + topic.encode()))
        sampled = "timestamp_sample" in fields
        for at, row in zip(times, values, strict=True):
            clock = round((START_S + at) * 1e6)
            head = struct.pack("<QQ", clock + 3000, clock) if sampled else struct.pack("<Q", clock)
            body = struct.pack("<H", i) + head + row.astype("<f4").tobytes()
            samples.append((clock + 3000 * sampled, i, _ulog_message(b"D", body)))
    return b"".join([*out, *(message for _, _, message in sorted(samples))])


def ulog(duration_s: float = 35.0, gap: tuple[float, float] | None = None, motion: Motion = calm) -> bytes:
    """A PX4 log of a flight; nothing is logged in ``gap``."""
    topics = []
    for name, fields, rate in ULOG_TOPICS:
        t = np.arange(int(duration_s * rate)) / rate
        if gap is not None:
            t = t[(t < gap[0]) | (t >= gap[1])]
        (q, theta, az), (phi, _, psi) = motion(t), attitude(t)
        values = {
            "vehicle_angular_velocity": np.column_stack([0.01 * t, q, -0.02 * t]),
            "vehicle_attitude": quaternion(phi, theta, psi),
            "vehicle_acceleration": np.column_stack([0.3 + 0 * t, 0.1 + 0 * t, az]),
            "airspeed_validated": (18.0 + 0.1 * t)[:, None],
            "vehicle_torque_setpoint": np.column_stack([0 * t, elevator(t), 0 * t]),
        }[name]
        topics.append((name, fields, t, values))
    return ulog_of(topics)


DATAFLASH = (
    (130, "IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    (131, "ATT", "QccC", "TimeUS,Roll,Pitch,Yaw"),
    (132, "ARSP", "Qff", "TimeUS,Airspeed,DiffPress"),
    (133, "RCOU", "QHHHH", "TimeUS,C1,C2,C3,C4"),
    (134, "PARM", "QNf", "TimeUS,Name,Value"),
    (135, "MSG", "QZ", "TimeUS,Message"),
    (136, "POWR", "Qf", "TimeUS,Vcc"),
)
_CODES = {"Q": "Q", "f": "f", "B": "B", "b": "b", "h": "h", "H": "H", "c": "h", "C": "H", "e": "i", "L": "i", "d": "d",
          "N": "16s", "Z": "64s"}  # fmt: skip
SERVO = {"SERVO2_FUNCTION": 19, "SERVO2_MIN": 1100, "SERVO2_TRIM": 1500, "SERVO2_MAX": 1900, "SERVO2_REVERSED": 1}


def _dataflash_messages(duration_s: float, motion: Motion) -> list[tuple[str, Sequence[object]]]:
    out: list[tuple[float, str, Sequence[object]]] = [(-2.0, "MSG", (0, b"ArduPlane V4.5.7"))]
    out += [(-1.0, "PARM", (0, name.encode(), value)) for name, value in SERVO.items()]
    for rate, names in ((100.0, ("IMU0", "IMU1", "RCOU")), (50.0, ("ATT",)), (10.0, ("ARSP", "POWR"))):
        times = np.arange(int(duration_s * rate)) / rate
        for t, up, q, pitch, az in zip(times, elevator(times), *motion(times), strict=True):
            us = round((START_S + t) * 1e6)
            phi, _, psi = (np.degrees(float(a)) for a in attitude(t))
            theta = np.degrees(pitch)
            rows: dict[str, Sequence[object]] = {
                "IMU0": (us, 0, 0.01 * t, q, -0.02 * t, 0.3, 0.1, az),
                "IMU1": (us, 1, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0),
                "RCOU": (us, 1500, round(1500 - 400 * float(up)), 1300, 1500),
                "ATT": (us, round(100 * phi), round(100 * theta), round(100 * (psi % 360.0))),
                "ARSP": (us, 18.0 + 0.1 * t, 200.0),
                "POWR": (us, 5.0),
            }
            out += [(float(t), name.rstrip("01"), rows[name]) for name in names]
    return [(name, row) for _, name, row in sorted(out, key=lambda item: item[0])]


Format = tuple[int, str, str, str]
"""Number, name, codes and columns of a type of message."""


def dataflash_of(formats: Sequence[Format], messages: Iterable[tuple[str, Sequence[object]]]) -> bytes:
    """A binary ArduPilot log of any messages: FMT messages, then data."""
    head, out = b"\xa3\x95", []
    kinds = {name: (kind, "<" + "".join(_CODES[c] for c in layout)) for kind, name, layout, _ in formats}

    def fmt(kind: int, length: int, name: str, layout: str, columns: str) -> bytes:
        body = struct.pack("<BB4s16s64s", kind, length, name.encode(), layout.encode(), columns.encode())
        return head + b"\x80" + body

    out.append(fmt(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"))
    out += [
        fmt(kind, 3 + struct.calcsize(kinds[name][1]), name, layout, columns) for kind, name, layout, columns in formats
    ]
    for name, row in messages:
        kind, codes = kinds[name]
        out.append(head + bytes([kind]) + struct.pack(codes, *row))
    return b"".join(out)


def dataflash_bin(duration_s: float = 35.0, motion: Motion = calm) -> bytes:
    """A binary ArduPilot log of a flight."""
    return dataflash_of(DATAFLASH, _dataflash_messages(duration_s, motion))


def dataflash_log(duration_s: float = 35.0, motion: Motion = calm) -> str:
    """The same log as text, as ArduPilot's ground stations write it."""
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    lines += [f"FMT, {kind}, 50, {name}, {layout}, {columns}" for kind, name, layout, columns in DATAFLASH]
    layouts = {name: layout for _, name, layout, _ in DATAFLASH}
    for name, row in _dataflash_messages(duration_s, motion):
        cells = []
        for value, code in zip(row, layouts[name], strict=True):
            if isinstance(value, bytes):
                cells.append(value.decode())
            else:
                cells.append(f"{float(value) / 100:.2f}" if code in "cC" else f"{float(value):.9g}" if code == "f"  # type: ignore[arg-type]
                             else str(value))  # fmt: skip
        lines.append(", ".join([name, *cells]))
    return "\n".join(lines) + "\n"


def write_73(path, content):
    """Write variables as MATLAB's -v7.3 does: transposed arrays, text as codes, references for cells and arrays."""
    with h5py.File(path, "w", userblock_size=512) as file:
        references = file.create_group("#refs#")

        def put(group, name, value):
            if isinstance(value, dict):
                inner = group.create_group(name)
                inner.attrs["MATLAB_class"] = np.bytes_("struct")
                for key, part in value.items():
                    put(inner, key, part)
            elif isinstance(value, str):
                codes = np.array([[ord(c)] for c in value], np.uint16)
                group.create_dataset(name, data=codes).attrs["MATLAB_class"] = np.bytes_("char")
            elif isinstance(value, np.ndarray) and value.dtype.names:
                inner = group.create_group(name)
                inner.attrs["MATLAB_class"] = np.bytes_("struct")
                for key in value.dtype.names:
                    inner.create_dataset(key, data=refer([row[key] for row in value[0]]), dtype=h5py.ref_dtype)
            elif isinstance(value, np.ndarray) and value.dtype == object:
                made = group.create_dataset(name, data=refer(list(value[0])), dtype=h5py.ref_dtype)
                made.attrs["MATLAB_class"] = np.bytes_("cell")
            else:
                numbers = np.atleast_2d(value)
                numbers = numbers if np.ndim(value) > 1 else numbers.T  # vectors are columns
                group.create_dataset(name, data=numbers.T).attrs["MATLAB_class"] = np.bytes_("double")

        def refer(items):
            out = np.empty((len(items), 1), h5py.ref_dtype)
            for i, item in enumerate(items):
                name = str(len(references))
                put(references, name, item)
                out[i, 0] = references[name].ref
            return out

        for name, value in content.items():
            put(file, name, value)
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64, HDF5 schema 1.00 .".ljust(124) + b"\x00\x02IM")
