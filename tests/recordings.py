"""A flight as pymavlink and rosbags, the formats' own libraries, write it: telemetry (.tlog) and recordings of ROS."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from writers import quaternion

from testbench.core.constants import DEG_RAD, G0_M_S2

Flight = Mapping[str, np.ndarray]
"""Channel -> samples (n,), SI, at the times "t", s; surfaces as parts of full throw in ``parts_of``."""
SERVOS = {"da": (1, 4, 1.0), "de": (2, 19, -1.0), "dr": (4, 21, -1.0)}
"""Surface -> its output, SERVOn_FUNCTION, and the sign of the demand for it."""
_BOOT_S, _UNIX_S, _RADIO_S = 40.0, 1.7e9, 0.15


def write_px4_tlog(path: Path, f: Flight, parts: Mapping[str, np.ndarray]) -> Path:
    """Write a flight as a ground station logs what PX4 sends it: commands before the mixer, landed until 5 s."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    plane, out = dialect.MAVLink(None, srcSystem=1, srcComponent=1), []
    for i, t in enumerate(f["t"].tolist()):
        ms = round(1e3 * (t + _BOOT_S))
        x = {name: float(column[i]) for name, column in f.items() if column.dtype.kind == "f"}
        da, de, dr = parts["da"][i], parts["de"][i], parts["dr"][i]
        messages = [
            dialect.MAVLink_attitude_message(ms, x["phi"], x["theta"], 0.0, x["p"], x["q"], x["r"]),
            dialect.MAVLink_actuator_control_target_message(1000 * ms, 0, [da, -de, -dr, 0.5, 0, 0, 0, 0]),
        ]
        if i % 5 == 0:
            mode = 6 if t > 20.0 else 1  # OFFBOARD, MANUAL
            messages.append(dialect.MAVLink_heartbeat_message(1, 12, 1 | (0 if mode == 6 else 64), mode << 16, 4, 3))
            messages.append(dialect.MAVLink_extended_sys_state_message(0, 1 if t < 5.0 else 2))
            messages.append(dialect.MAVLink_vfr_hud_message(x["V"], x["Vg"], 0, 40, x["h"], x["hdot"]))
        out += [int(1e6 * (_UNIX_S + t)).to_bytes(8, "big") + message.pack(plane) for message in messages]
    path.write_bytes(b"".join(out))
    return path


def write_tlog(path: Path, f: Flight, parts: Mapping[str, np.ndarray], seed: int = 1) -> Path:
    """Write a flight as a ground station logs what ArduPlane sends it.

    Attitude and servos at the rate of the flight, the rest at a fifth of it; the radio takes 0.15 s and up to 0.1 s
    more; the ground station's own heartbeats lie between.
    """
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    rng = np.random.default_rng(seed)
    plane, ground = dialect.MAVLink(None, srcSystem=7, srcComponent=1), dialect.MAVLink(None, srcSystem=255)
    out: list[tuple[float, bytes]] = []
    last = 0.0

    def send(t: float, link, message) -> None:
        nonlocal last
        last = max(last, _UNIX_S + t + _RADIO_S + rng.uniform(0.0, 0.1))
        out.append((last, message.pack(link)))

    send(0.0, ground, dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    send(0.0, plane, dialect.MAVLink_statustext_message(6, b"ArduPlane V4.5.7"))
    for output, function, _ in SERVOS.values():
        for key, value in (("FUNCTION", function), ("MIN", 1000), ("TRIM", 1500), ("MAX", 2000)):
            name = f"SERVO{output}_{key}".encode()
            send(0.0, plane, dialect.MAVLink_param_value_message(name, float(value), 9, 12, 0))
    for i, t in enumerate(f["t"].tolist()):
        x = {name: float(column[i]) for name, column in f.items() if column.dtype.kind == "f"}
        ms = round(1e3 * (t + _BOOT_S))
        angles = (x["phi"], x["theta"], (x["psi"] + np.pi) % (2.0 * np.pi) - np.pi)
        send(t, plane, dialect.MAVLink_attitude_message(ms, *angles, x["p"], x["q"], x["r"]))
        pulses = [1500] * 8
        for name, (output, _, sign) in SERVOS.items():
            pulses[output - 1] = round(1500 + 500 * sign * float(parts[name][i]))
        send(t, plane, dialect.MAVLink_servo_output_raw_message(1000 * ms, 0, *pulses))
        forces = [round(1e3 * x[n] / G0_M_S2) for n in ("ax", "ay", "az")]
        rates = [round(1e3 * x[n]) for n in "pqr"]
        send(t, plane, dialect.MAVLink_raw_imu_message(1000 * ms, *forces, *rates, 0, 0, 0))
        if i % 5 == 0:
            send(t, plane, dialect.MAVLink_heartbeat_message(1, 3, 81, 5, 4, 3))
            send(t, plane, dialect.MAVLink_vfr_hud_message(x["V"], x["Vg"], 0, 40, x["h"], x["hdot"]))
            send(t, plane, dialect.MAVLink_aoa_ssa_message(1000 * ms, x["alpha"] / DEG_RAD, 0.0))
    path.write_bytes(b"".join(int(1e6 * t).to_bytes(8, "big") + packet for t, packet in out))
    return path


def write_bag(path: Path, f: Flight) -> Path:
    """Write a flight as mavros publishes it, axes forward, left, up: a bag of ROS, or MCAP or SQLite of ROS 2."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    first = path.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if first else Stores.ROS2_HUMBLE)
    hud = "std_msgs/Header header\nfloat32 airspeed\nfloat32 groundspeed\nint16 heading\nfloat32 throttle\n"
    store.register(get_types_from_msg(f"{hud}float32 altitude\nfloat32 climb", "mavros_msgs/msg/VFR_HUD"))
    of = store.types
    Header, Time = of["std_msgs/msg/Header"], of["builtin_interfaces/msg/Time"]
    q = quaternion(f["phi"], -f["theta"], 0.5 * np.pi - f["psi"])
    covariance = np.zeros(9)
    numbered = {"seq": 0} if first else {}
    target = path if first else path.with_suffix("")
    plugin = StoragePlugin.MCAP if path.suffix == ".mcap" else StoragePlugin.SQLITE3
    writer = Writer1(path) if first else Writer2(target, version=9, storage_plugin=plugin)
    write = store.serialize_ros1 if first else store.serialize_cdr
    with writer:
        imu = writer.add_connection("/mavros/imu/data", "sensor_msgs/msg/Imu", typestore=store)
        shown = writer.add_connection("/mavros/vfr_hud", "mavros_msgs/msg/VFR_HUD", typestore=store)
        told = writer.add_connection("/rosout_text", "std_msgs/msg/String", typestore=store)
        for i, t in enumerate(f["t"].tolist()):
            ns = round(1e9 * (_UNIX_S + t))
            header = Header(stamp=Time(sec=ns // 10**9, nanosec=ns % 10**9), frame_id="base_link", **numbered)
            vector = of["geometry_msgs/msg/Vector3"]
            message = of["sensor_msgs/msg/Imu"](
                header,
                of["geometry_msgs/msg/Quaternion"](q[i, 1], q[i, 2], q[i, 3], q[i, 0]),
                covariance,
                vector(f["p"][i], -f["q"][i], -f["r"][i]),
                covariance,
                vector(f["ax"][i], -f["ay"][i], -f["az"][i]),
                covariance,
            )
            late = ns + 3_000_000  # a recorder writes when a message comes
            writer.write(imu, late, write(message, imu.msgtype))
            if i % 5 == 0:
                row = (f["V"][i], f["Vg"][i], 0, 0.4, f["h"][i], f["hdot"][i])
                writer.write(shown, late, write(of["mavros_msgs/msg/VFR_HUD"](header, *row), shown.msgtype))
            if i % 50 == 0:
                writer.write(told, late, write(of["std_msgs/msg/String"]("alive"), told.msgtype))
    return path if first else next(target.glob(f"*{path.suffix}"))
