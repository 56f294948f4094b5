"""PX4 logs (ULog) read with pyulog, and how PX4's topics become channels.

Format: PX4 guide, "ULog File Format". Frames: body forward-right-down, attitude quaternion (w, x, y, z) from it to
north-east-down; sign of torque commands right-handed about those axes (PX4 guide, messages; from memory).
"""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import Any

import numpy as np

from testbench.core.errors import RecordError
from testbench.core.record import FloatArray
from testbench.logs.signals import BROKEN, NEEDS_LOGS, Log, Rule, Topic, make_topic, scaled
from testbench.logs.ulog_messages import intact_messages

MAGIC = b"ULog\x01\x12\x35"
_AT_IMU = "the inertial unit sits at the centre of gravity"
_COMMAND = "PX4 normalises commands to -1..1; positive turns right-handed about the body axis"


def _roll(w: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    return np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))


def _pitch(w: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    return np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))


def _yaw(w: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    return np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _vector(names: str, topic: str, field: str, said: str, assumed: str = "") -> list[Rule]:
    return [Rule(n, topic, (f"{field}[{i}]",), scaled(1.0), said, assumed) for i, n in enumerate(names.split())]


def _rules() -> tuple[Rule, ...]:
    q = tuple(f"q[{i}]" for i in range(4))
    rules = _vector("p q r", "vehicle_angular_velocity", "xyz", "rad/s, as logged")
    rules += [
        Rule(n, "vehicle_attitude", (f,), scaled(1.0), "rad/s, as logged")
        for n, f in (("p", "rollspeed"), ("q", "pitchspeed"), ("r", "yawspeed"))
    ]
    rules += _vector("p q r", "sensor_combined", "gyro_rad", "rad/s, as logged")
    rules += _vector("pdot qdot rdot", "vehicle_angular_acceleration", "xyz", "rad/s2, as logged, filtered by PX4")
    rules += _vector("pdot qdot rdot", "vehicle_angular_velocity", "xyz_derivative", "rad/s2, filtered by PX4")
    for name, angle in (("phi", _roll), ("theta", _pitch), ("psi", _yaw)):
        rules.append(Rule(name, "vehicle_attitude", q, angle, "Euler angle (3-2-1) of the quaternion"))
    rules += _vector("ax ay az", "vehicle_acceleration", "xyz", "m/s2, as logged", _AT_IMU)
    rules += _vector("ax ay az", "sensor_combined", "accelerometer_m_s2", "m/s2, as logged", _AT_IMU)
    one = scaled(1.0)
    minus = scaled(-1.0)
    rules += [
        Rule("V", "airspeed_validated", ("true_airspeed_m_s",), one, "true airspeed, m/s"),
        Rule("V", "airspeed", ("true_airspeed_m_s",), one, "true airspeed, m/s"),
        Rule("qbar", "differential_pressure", ("differential_pressure_pa",), one, "Pa", "incompressible: qbar is it"),
        Rule("qbar", "differential_pressure", ("differential_pressure_filtered_pa",), one, "Pa, filtered by PX4",
             "incompressible: qbar is it"),
        Rule("h", "vehicle_air_data", ("baro_alt_meter",), one, "m, barometric"),
        Rule("h", "vehicle_global_position", ("alt",), one, "m above sea level"),
        Rule("hdot", "vehicle_local_position", ("vz",), minus, "m/s, minus the velocity downwards"),
        Rule("Vg", "vehicle_local_position", ("vx", "vy"), np.hypot, "m/s, length of the horizontal velocity"),
        Rule("north", "vehicle_local_position", ("x",), one, "m, from the local origin"),
        Rule("east", "vehicle_local_position", ("y",), one, "m, from the local origin"),
    ]  # fmt: skip
    for topic in ("wind", "wind_estimate"):
        for name, column in (("wind_north", "windspeed_north"), ("wind_east", "windspeed_east")):
            rules.append(Rule(name, topic, (column,), one, "m/s, estimated by PX4"))
    torque, old = "vehicle_torque_setpoint", "actuator_controls_0"
    for i, (name, turn) in enumerate((("da_cmd", one), ("de_cmd", minus), ("dr_cmd", minus))):
        axis = ("roll", "pitch", "yaw")[i]
        said = f"{'' if turn is one else 'minus '}the normalised {axis} command times full throw"
        rules.append(Rule(name, torque, (f"xyz[{i}]",), turn, said, _COMMAND))
        rules.append(Rule(name, old, (f"control[{i}]",), turn, said, _COMMAND))
    rules += [
        Rule("thr_cmd", "vehicle_thrust_setpoint", ("xyz[0]",), one, "normalised thrust command along body x",
             "throttle is the thrust command"),
        Rule("thr_cmd", old, ("control[3]",), one, "normalised thrust command", "throttle is the thrust command"),
    ]  # fmt: skip
    return tuple(rules)


RULES = _rules()


def read_ulog(path: Path | str) -> Log:
    """Read a PX4 log.

    If a topic says when its sensor was read (timestamp_sample), that time is taken, because topics are published later.
    Damaged messages are left out before pyulog sees them, because it follows a damaged length past good ones.

    Raises:
        RecordError: pyulog is not installed, or the file is no ULog or holds nothing that can be read.
    """
    path = Path(path)
    try:
        from pyulog import ULog
        from pyulog.core import ULogException
    except ImportError as error:
        raise RecordError(f"'{path}' cannot be read: PX4 logs {NEEDS_LOGS.format(package='pyulog')}") from error
    whole = path.read_bytes()
    if not whole.startswith(MAGIC):
        raise RecordError(f"'{path}' must be a PX4 log, but it does not begin as one (ULog and its version)")
    clean, damage = intact_messages(whole)
    said = io.StringIO()
    reader = ULog(None)
    with contextlib.redirect_stdout(said):
        try:
            reader._load_file(io.BytesIO(clean), None)  # not through __init__: what was read before a fault can be kept
        except ULogException as error:
            raise RecordError(f"'{path}' must be a readable PX4 log, got: {error}") from error
        except BROKEN as error:
            damage.append(f"the file is damaged so that reading broke off ({type(error).__name__})")
            reader._data_list = [ULog.Data(s) for s in reader._subscriptions.values() if s.buffer]
    if reader.file_corruption or said.getvalue():
        damage.append("messages that could not be read were left out")
    topics, lost = _topics(reader)
    if not topics:
        raise RecordError(
            f"'{path}' must hold logged samples, but none could be saved: "
            f"{'; '.join(damage) or 'it ends after its definitions'}"
        )
    end = max(float(topic.t_s[-1]) for topic in topics.values())
    if damage:
        damage[-1] += f"; saved: {len(topics)} topics up to t = {end:.3f} s of the log's clock"
    drops = [d.duration for d in reader.dropouts]
    if drops:
        lost.append(f"the logger itself reports {len(drops)} dropouts, the longest {max(drops)} ms")
    parameters = {k: float(v) for k, v in reader.initial_parameters.items() if isinstance(v, int | float)}
    facts = {key: str(reader.msg_info_dict[key]) for key in ("sys_name", "ver_hw", "ver_sw") if key in
             reader.msg_info_dict}  # fmt: skip
    return Log(path, "PX4 ULog", topics, facts, parameters, (*damage, *lost))


def _topics(reader: Any) -> tuple[dict[str, Topic], list[str]]:
    topics: dict[str, Topic] = {}
    said = []
    for item in reader.data_list:
        name = item.name + (f"#{item.multi_id}" if item.multi_id else "")
        columns = {key: np.asarray(values) for key, values in item.data.items()}
        clock = columns.pop("timestamp", None)
        sampled = columns.pop("timestamp_sample", None)
        if clock is None or clock.size == 0:
            continue
        if sampled is not None and np.all(sampled > 0) and np.all(sampled <= clock):
            clock = sampled
        topic, lost = make_topic(name, clock.astype(np.float64) * 1e-6, columns)
        if lost:
            said.append(lost)
        if topic.t_s.size:
            topics[name] = topic
    return topics, said
