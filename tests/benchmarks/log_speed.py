"""Time and memory of reading long autopilot logs: this package beside pymavlink and pyulog.

Run as a script; writes results/benchmarks/logs.csv. Two logs of 200 MB go into a temporary folder: an ArduPilot log
(three inertial units, attitude, servos, two filter cores and other messages at 400 Hz, air data and GPS slower) and a
PX4 log (angular velocity, acceleration, attitude, torque set-points, servos and other topics at 400 to 800 Hz). Each
reader runs in a process of its own. The time is the processor's, because machines are shared; it includes opening the
file, not importing Python modules. The memory is the peak of the process. The peers read what this package reads: the
same messages or topics, into columns. The laws: below 20 s and 1 GB for reading and for the channels.
"""

import argparse
import json
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from clock import since
from smallest import results, sized
from tables import write_rows

OUT = results("benchmarks", "logs.csv")
MOST_S, MOST_MB = 20.0, 1000.0
BLOCK = 40  # fast steps, 2.5 ms each, for one slow one
_CODES = {
    "Q": "<u8",
    "B": "u1",
    "f": "<f4",
    "h": "<i2",
    "H": "<u2",
    "c": "<i2",
    "C": "<u2",
    "e": "<i4",
    "L": "<i4",
    "I": "<u4",
    "b": "i1",
}
_DATAFLASH = (
    (130, "IMU", "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"),
    (131, "ATT", "QccccCCCCB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF"),
    (132, "RCOU", "QHHHHHHHHHHHHHH", "TimeUS," + ",".join(f"C{i}" for i in range(1, 15))),
    (133, "AETR", "Qhhhhh", "TimeUS,Ail,Elev,Thr,Rudd,Flap"),
    (134, "XKF1", "QBccCfffffffccce", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH"),
    (135, "PIDP", "QffffffffffB", "TimeUS,Tar,Act,Err,P,I,D,FF,DFF,Dmod,SRate,Flags"),
    (136, "ARSP", "QBffcffBBfB", "TimeUS,I,Airspeed,DiffPress,Temp,RawPress,Offset,U,H,Hp,Pri"),
    (137, "GPS", "QBLLeffff", "TimeUS,I,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw"),
)  # fmt: skip
_FAST = (("IMU", 3), ("ATT", 1), ("RCOU", 1), ("AETR", 1), ("XKF1", 2), ("PIDP", 1))
_SLOW = (("ARSP", 1), ("GPS", 1))
_ULOG = (
    ("vehicle_angular_velocity",
     "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;float[3] xyz_derivative;", 2),
    ("vehicle_acceleration", "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;", 1),
    ("sensor_combined", "uint64_t timestamp;float[3] gyro_rad;uint32_t gyro_integral_dt;"
     "int32_t accelerometer_timestamp_relative;float[3] accelerometer_m_s2;uint32_t accelerometer_integral_dt;", 1),
    ("vehicle_attitude", "uint64_t timestamp;uint64_t timestamp_sample;float[4] q;float[4] delta_q_reset;"
     "uint8_t quat_reset_counter;uint8_t[7] _padding0;", 1),
    ("vehicle_torque_setpoint", "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;", 1),
    ("actuator_servos", "uint64_t timestamp;uint64_t timestamp_sample;float[8] control;", 1),
    ("rate_ctrl_status", "uint64_t timestamp;float rollspeed_integ;float pitchspeed_integ;float yawspeed_integ;", 1),
    ("actuator_motors", "uint64_t timestamp;uint64_t timestamp_sample;float[12] control;uint16_t reversible_flags;", 1),
)  # fmt: skip
_ULOG_SLOW = (("airspeed_validated", "uint64_t timestamp;float true_airspeed_m_s;", 1),)
_NUMPY = {"uint64_t": "<u8", "float": "<f4", "uint32_t": "<u4", "int32_t": "<i4", "uint16_t": "<u2", "uint8_t": "u1"}


def _filled(block: np.ndarray, kind: np.dtype, rng: np.random.Generator) -> None:
    """Put noise into the numbers of a message, so that no two are alike, as in a log."""
    for name in kind.names or ():
        column = block[name]
        if column.dtype.kind == "f":
            column[...] = 0.1 * rng.standard_normal(column.shape)
        elif name.startswith("C") and column.dtype == "<u2":
            column[...] = rng.integers(1100, 1900, column.shape)


def write_dataflash(path: Path, megabytes: float) -> None:
    """Write an ArduPilot log of about that size."""
    kinds = {}
    head = [
        struct.pack("<2sBBB4s16s64s", b"\xa3\x95", 128, 128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    ]
    for number, name, codes, columns in _DATAFLASH:
        fields = [("head", "V2"), ("kind", "u1"), *zip(columns.split(","), (_CODES[c] for c in codes), strict=True)]
        kinds[name] = (number, np.dtype(fields))
        head.append(struct.pack("<2sBBB4s16s64s", b"\xa3\x95", 128, number, kinds[name][1].itemsize, name.encode(),
                                codes.encode(), columns.encode()))  # fmt: skip
    step = np.dtype([(name, kinds[name][1], (n,)) for name, n in _FAST])
    block = np.zeros(1, np.dtype([("fast", step, (BLOCK,)), *((name, kinds[name][1], (n,)) for name, n in _SLOW)]))
    rng = np.random.default_rng(3)
    for part, names in ((block["fast"], _FAST), (block, _SLOW)):
        for name, n in names:
            part[name]["head"] = np.void(b"\xa3\x95")
            part[name]["kind"] = kinds[name][0]
            if n > 1:
                part[name]["I" if name == "IMU" else "C"] = np.arange(n)
    with path.open("wb") as file:
        file.write(b"".join(head))
        for i in range(int(megabytes * 1e6 / block.itemsize)):
            t = np.uint64(10_000_000 + 2500 * (BLOCK * i + np.arange(BLOCK)))
            for part, names, at in ((block["fast"][0], _FAST, t[:, None]), (block[0], _SLOW, t[0])):
                for name, _ in names:
                    _filled(part[name], kinds[name][1], rng)
                    part[name]["TimeUS"] = at
                    if name == "IMU":
                        part[name]["GH"] = part[name]["AH"] = 1
                    elif name == "ARSP":
                        part[name]["Airspeed"] += 20.0
            file.write(block.tobytes())


def write_ulog(path: Path, megabytes: float) -> None:
    """Write a PX4 log of about that size."""

    def message(kind: bytes, body: bytes) -> bytes:
        return struct.pack("<H", len(body)) + kind + body

    head = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 10_000_000), message(b"B", bytes(40))]
    kinds, names = {}, (*_ULOG, *_ULOG_SLOW)
    for number, (name, text, _) in enumerate(names):
        head.append(message(b"F", f"{name}:{text}".encode()))
        fields: list[tuple] = [("size", "<u2"), ("kind", "S1"), ("number", "<u2")]
        for part in text.strip(";").split(";"):
            kind, label = part.split()
            base, _, count = kind.rstrip("]").partition("[")
            if not label.startswith("_padding"):
                fields.append((label, _NUMPY[base], (int(count),)) if count else (label, _NUMPY[base]))
        kinds[name] = (number, np.dtype(fields))
    key = b"int32_t CA_SV_CS0_TYPE"
    head.append(message(b"P", bytes([len(key)]) + key + struct.pack("<i", 3)))
    head += [message(b"A", struct.pack("<BH", 0, number) + name.encode()) for number, (name, _, _) in enumerate(names)]
    step = np.dtype([(name, kinds[name][1], (n,)) for name, _, n in _ULOG])
    slow = [(name, kinds[name][1], (n,)) for name, _, n in _ULOG_SLOW]
    block = np.zeros(1, np.dtype([("fast", step, (BLOCK,)), *slow]))
    rng = np.random.default_rng(3)
    for part, some in ((block["fast"], _ULOG), (block, _ULOG_SLOW)):
        for name, _, _ in some:
            number, kind = kinds[name]
            part[name]["size"], part[name]["kind"], part[name]["number"] = kind.itemsize - 3, b"D", number
    with path.open("wb") as file:
        file.write(b"".join(head))
        for i in range(int(megabytes * 1e6 / block.itemsize)):
            t = 10_000_000 + 2500 * (BLOCK * i + np.arange(BLOCK))
            for part, some, at in ((block["fast"][0], _ULOG, t[:, None]), (block[0], _ULOG_SLOW, t[0])):
                for name, _, n in some:
                    _filled(part[name], kinds[name][1], rng)
                    part[name]["timestamp"] = at + (2500 // n) * np.arange(n) + 100
                    if "timestamp_sample" in (kinds[name][1].names or ()):
                        part[name]["timestamp_sample"] = part[name]["timestamp"] - 50
            file.write(block.tobytes())


def read_ours(path: str) -> int:
    """Read a log; return how many numbers its topics hold."""
    from testbench.questions.importing.ask import read_log

    log, _ = read_log(path)
    return sum(len(topic.columns) * topic.t_s.size for topic in log.topics.values())


def read_channels(path: str) -> int:
    """Import a log; return the samples of its record."""
    from testbench.questions.importing.ask import import_log

    return int(import_log(path).record.data.size)


def read_pymavlink(path: str) -> int:
    """Read the messages that this package reads into columns, as its examples do."""
    from pymavlink import DFReader

    from testbench.logs.ardupilot import COLUMNS

    reader = DFReader.DFReader_binary(path, zero_time_base=True)
    columns: dict[str, list[list[float]]] = {}
    while (message := reader.recv_match(type=[*COLUMNS], strict=True)) is not None:
        name = message.get_type()
        names = [n for n in message.get_fieldnames() if n in COLUMNS[name] or n == "TimeUS"]
        for column, key in zip(columns.setdefault(name, [[] for _ in names]), names, strict=True):
            column.append(getattr(message, key))
    return sum(np.array(column).size for kept in columns.values() for column in kept)


def read_pyulog(path: str) -> int:
    """Read the topics that this package reads."""
    from pyulog import ULog

    from testbench.logs.px4 import COLUMNS

    return sum(len(d.data) * len(d.data["timestamp"]) for d in ULog(path, [*COLUMNS]).data_list)


READERS = {"testbench": read_ours, "testbench, with channels": read_channels, "pymavlink": read_pymavlink,
           "pyulog": read_pyulog}  # fmt: skip


def peak_mb() -> float:
    """Return the most memory that this process has had, MB."""
    words = Path("/proc/self/status").read_text().split()
    return int(words[words.index("VmHWM:") + 1]) / 1e3


def one(reader: str, path: str) -> None:
    """Time a reader in this process; print seconds, megabytes at the peak and before, and what it read."""
    if reader == "pymavlink":
        from pymavlink import DFReader  # noqa: F401
    elif reader == "pyulog":
        import pyulog  # noqa: F401
    else:
        import testbench.questions.importing.ask  # noqa: F401
    before, start = peak_mb(), time.process_time()
    held = READERS[reader](path)
    print(json.dumps([since(start), peak_mb(), before, held]))


def measured(reader: str, path: Path) -> list[float]:
    """Return what :func:`one` prints, from a process of its own."""
    done = subprocess.run(
        [sys.executable, __file__, "--one", reader, str(path)], capture_output=True, text=True, check=True
    )
    return [float(value) for value in json.loads(done.stdout.splitlines()[-1])]


def main(words: Sequence[str] | None = None) -> None:
    """Write the logs, time the readers, write the table; end with an error where a law is broken."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--one", nargs=2)
    parser.add_argument("--megabytes", type=float, default=sized(200.0, 1.0))
    parser.add_argument("--peers", action=argparse.BooleanOptionalAction, default=True)
    given = parser.parse_args(words)
    if given.one:
        one(*given.one)
        return
    rows, broken = [], []
    with tempfile.TemporaryDirectory() as folder:
        for name, writer, peer in (("flight.bin", write_dataflash, "pymavlink"), ("flight.ulg", write_ulog, "pyulog")):
            path = Path(folder) / name
            writer(path, given.megabytes)
            size = path.stat().st_size / 1e6
            for reader in ("testbench", "testbench, with channels", *((peer,) if given.peers else ())):
                seconds, peak, before, held = measured(reader, path)
                rows.append(
                    (name, f"{size:.0f}", reader, f"{seconds:.2f}", f"{peak:.0f}", f"{before:.0f}", f"{held:.0f}")
                )
                print(*rows[-1], sep="  ", flush=True)
                if reader.startswith("testbench") and (seconds > MOST_S or peak > MOST_MB):
                    law = f"{MOST_S:g} s and {MOST_MB:g} MB is the law"
                    broken.append(f"{reader}: {name} took {seconds:.1f} s and {peak:.0f} MB, {law}")
            path.unlink()
    write_rows(OUT, ("log", "size_MB", "reader", "time_s", "peak_MB", "before_MB", "numbers"), rows)
    if broken:
        raise SystemExit("; ".join(broken))


if __name__ == "__main__":
    main()
