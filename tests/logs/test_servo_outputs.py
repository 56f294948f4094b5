"""What drives which surface, by the log's own settings: servo pulses of ArduPilot, servos and torques of PX4."""

import os
from pathlib import Path

import numpy as np
import pytest
from writers import DATAFLASH, dataflash_of, ulog_of

from testbench.core.constants import DEG_RAD
from testbench.questions.importing.ask import import_log

SHARED = Path(__file__).resolve().parents[3] / "shared"
CASES = Path(os.environ.get("TESTBENCH_FLIGHT_DATA", SHARED / "flight_data")).parent / "cases"
THROW = dict.fromkeys(("de", "da", "dr"), 20.0 * DEG_RAD)
T = np.arange(500) / 50.0
UP = 0.3 * np.sin(2.0 * T)  # demands, parts of full: nose up, right wing down, nose right
RIGHT = 0.4 * np.sin(3.0 * T + 0.5)
YAW = 0.2 * np.cos(2.5 * T)
THRUST = 0.5 + 0.2 * np.sin(T)
WHOLE = 0.6 / 400.0 * 20.0 * DEG_RAD  # pulses are whole microseconds: half of one, and the last bit


def pulse(demand, low=1000.0, trim=1500.0, high=2000.0, turned=False):
    """The pulse for a demand of -1 to 1, as ArduPilot makes it."""
    demand = -demand if turned else demand
    return trim + np.where(demand > 0.0, demand * (high - trim), demand * (trim - low))


def settings(i, function, low=1000, trim=1500, high=2000, turned=False):
    return {f"SERVO{i}_FUNCTION": function, f"SERVO{i}_MIN": low, f"SERVO{i}_TRIM": trim, f"SERVO{i}_MAX": high,
            f"SERVO{i}_REVERSED": int(turned)}  # fmt: skip


def log_of(outputs, more=(), **extra):
    """A log of pulses: output -> (function, demand, how the servo is set)."""
    columns = 14 if max(outputs) <= 14 else 4
    first, name = (1, "RCOU") if columns == 14 else (15, "RCO2")
    known = dict(extra)
    rows = np.full((T.size, columns), 1500.0)
    for i, (function, demand, how) in outputs.items():
        known |= settings(i, function, **how)
        rows[:, i - first] = np.rint(pulse(demand, **how))
    formats = [*(f for f in DATAFLASH if f[1] in ("PARM", "MSG")),
               (140, name, "Q" + "H" * columns, "TimeUS," + ",".join(f"C{first + i}" for i in range(columns))),
               *(f for f, _ in more)]  # fmt: skip
    messages = [("MSG", (0, b"ArduPlane V4.5.7")), *(("PARM", (0, k.encode(), float(v))) for k, v in known.items())]
    data = [(1e6 * t, name, (int(1e6 * t), *map(int, row))) for t, row in zip(T, rows, strict=True)]
    data += [(row[0], f[1], row) for f, part in more for row in part]
    return dataflash_of(formats, [*messages, *((kind, row) for _, kind, row in sorted(data, key=lambda d: d[0]))])


def read(tmp_path, content, name="f.bin", **kwargs):
    path = tmp_path / name
    path.write_bytes(content)
    found = import_log(path, rate_hz=50.0, throw_rad=THROW, **kwargs)
    return found, {c.name: c for c in found.channels}


def close(channel, expected, tolerance=WHOLE):
    return np.max(np.abs(channel.values - expected)) < tolerance


PLAIN = {"low": 1100, "trim": 1500, "high": 1900}
TURNED = {**PLAIN, "turned": True}
OFF = {"low": 1050, "trim": 1420, "high": 1990}
EL, AIL, RUD = UP, RIGHT, YAW
AIRFRAMES = {
    "surfaces of their own": {1: (4, AIL, PLAIN), 2: (19, EL, PLAIN), 4: (21, RUD, PLAIN)},
    "reversed servos": {1: (4, AIL, TURNED), 2: (19, EL, TURNED), 4: (21, RUD, TURNED)},
    "trim off centre": {1: (4, AIL, OFF), 2: (19, EL, {**OFF, "turned": True}), 4: (21, RUD, OFF)},
    "two elevators, two ailerons": {
        1: (4, AIL, PLAIN), 2: (19, EL, PLAIN), 4: (21, RUD, PLAIN), 5: (4, AIL, TURNED),
        6: (19, EL, {**OFF, "turned": True}),
    },
    "elevons": {3: (77, EL - AIL, PLAIN), 5: (78, EL + AIL, TURNED), 4: (21, RUD, OFF)},
    "V-tail": {1: (4, AIL, PLAIN), 2: (79, EL + RUD, TURNED), 4: (80, EL - RUD, OFF)},
    "flaperons with flaps": {
        1: (24, AIL + 0.25, PLAIN), 5: (25, AIL - 0.25, TURNED), 2: (19, EL, PLAIN), 4: (21, RUD, OFF),
    },
    "outputs above the fourteenth": {15: (4, AIL, PLAIN), 16: (19, EL, TURNED), 18: (21, RUD, OFF)},
    "split elevons": {
        1: (16, EL - AIL + np.maximum(-RUD, 0.0), PLAIN), 2: (86, EL - AIL - np.maximum(-RUD, 0.0), TURNED),
        5: (17, EL + AIL + np.maximum(RUD, 0.0), OFF), 6: (87, EL + AIL - np.maximum(RUD, 0.0), PLAIN),
    },
}  # fmt: skip


@pytest.mark.parametrize("name", AIRFRAMES)
def test_surfaces_of_ardupilot_follow_the_settings(tmp_path, name):
    _, by_name = read(tmp_path, log_of(AIRFRAMES[name]))
    full = THROW["de"]
    assert close(by_name["de_cmd"], -full * EL)  # nose up is trailing edge up
    assert close(by_name["da_cmd"], full * AIL)
    assert close(by_name["dr_cmd"], -full * RUD, 2.0 * WHOLE)
    assert not any("no setting states this" in by_name[f"{s}_cmd"].assumed for s in ("de", "da", "dr"))


def test_elevons_of_the_case_of_record(tmp_path):
    path = CASES / "bin_elevons" / "elevon.bin"
    if not path.is_file():
        pytest.skip("the case is not here")
    by_name = {c.name: c for c in import_log(path).channels}
    t = by_name["de_cmd"].t_s - by_name["de_cmd"].t_s[0]
    rolled = (t > 8.01) & (t < 9.99)
    assert np.max(np.abs(by_name["de_cmd"].values[rolled])) == 0.0
    sizes = np.abs(by_name["da_cmd"].values[rolled])
    assert np.count_nonzero(np.isclose(sizes, 5.0 * DEG_RAD)) >= sizes.size - 1  # it passes zero as it turns round
    assert np.max(np.abs(by_name["da_cmd"].values[(t < 7.99) | (t > 10.01)])) == 0.0
    assert np.isclose(np.max(np.abs(by_name["de_cmd"].values)), 3.0 * DEG_RAD)
    assert "dr_cmd" not in by_name  # output 4 is switched off: it is not taken for a rudder
    assert by_name["de_cmd"].said.startswith("half the sum of the elevons: servo 1")


def thrust(tmp_path, outputs, **extra):
    return read(tmp_path, log_of(outputs, **extra))[1]["thr_cmd"].values


def test_throttles_single_twin_reversed_and_with_reverse_thrust(tmp_path):
    low = {"low": 1000, "trim": 1000, "high": 2000}
    assert np.max(np.abs(thrust(tmp_path, {3: (70, THRUST, low)}) - THRUST)) < 6e-4
    twin = {3: (73, THRUST - 0.1, low), 5: (74, THRUST + 0.1, low)}
    assert np.max(np.abs(thrust(tmp_path, twin) - THRUST)) < 6e-4
    turned = {"low": 1000, "trim": 2000, "high": 2000, "turned": True}  # full at the low end
    assert np.max(np.abs(thrust(tmp_path, {3: (70, THRUST, turned)}) - THRUST)) < 6e-4
    both = {"low": 1000, "trim": 1500, "high": 2000}
    assert np.max(np.abs(thrust(tmp_path, {3: (70, THRUST - 0.5, both)}, THR_MIN=-100) - (THRUST - 0.5))) < 2e-3


def aetr():
    parts = zip(T, 4500 * AIL, 4500 * EL, 100 * THRUST, 4500 * RUD, strict=True)
    rows = [(int(1e6 * t), *(round(float(x)) for x in row)) for t, *row in parts]
    return (150, "AETR", "Qhhhh", "TimeUS,Ail,Elev,Thr,Rudd"), rows


def test_demands_are_read_where_no_pulses_are_and_through_the_gain_of_the_mixer(tmp_path):
    rest = {9: (0, 0.0 * T, PLAIN)}
    _, plain = read(tmp_path, log_of(rest, [aetr()], SERVO2_FUNCTION=19, SERVO1_FUNCTION=4, SERVO4_FUNCTION=21)
                    .replace(b"RCOU", b"XXXX"))  # fmt: skip
    assert close(plain["de_cmd"], -THROW["de"] * EL, 1e-4)
    _, mixed = read(tmp_path, log_of(rest, [aetr()], SERVO1_FUNCTION=77, SERVO2_FUNCTION=78, MIXING_GAIN=0.8)
                    .replace(b"RCOU", b"XXXX"))  # fmt: skip
    assert close(mixed["de_cmd"], -0.8 * THROW["de"] * EL, 1e-4)
    assert close(mixed["da_cmd"], 0.8 * THROW["da"] * AIL, 1e-4)
    assert "MIXING_GAIN, 0.8" in mixed["da_cmd"].said
    assert close(mixed["thr_cmd"], THRUST, 0.006)


def test_pulses_count_before_demands_where_their_function_is_known(tmp_path):
    _, by_name = read(tmp_path, log_of({2: (19, EL, PLAIN)}, [aetr()], SERVO1_FUNCTION=0))
    assert by_name["de_cmd"].source == "RCOU.C2"
    assert by_name["da_cmd"].source == "AETR.Ail"


def test_an_output_without_pulses_is_no_deflection(tmp_path):
    content = log_of({2: (19, EL, PLAIN)})
    first = int(np.rint(pulse(EL, **PLAIN))[0])
    head = b"\xa3\x95" + bytes([140]) + (0).to_bytes(8, "little") + (1500).to_bytes(2, "little")
    assert head + first.to_bytes(2, "little") in content
    _, by_name = read(tmp_path, content.replace(head + first.to_bytes(2, "little"), head + bytes(2)))
    assert by_name["de_cmd"].t_s[0] == pytest.approx(0.02)
    assert np.max(np.abs(by_name["de_cmd"].values)) < 0.31 * THROW["de"]


def test_a_surface_beside_the_mixed_ones_is_said(tmp_path):
    _, by_name = read(tmp_path, log_of({1: (77, EL, PLAIN), 2: (78, EL, PLAIN), 5: (19, EL, PLAIN)}))
    assert by_name["de_cmd"].said.startswith("elevator: servo 5")
    assert "also has: half the sum of the elevons" in by_name["de_cmd"].assumed


def test_a_servo_setting_changed_in_flight_is_said(tmp_path):
    more = [((134, "PARM", "QNf", "TimeUS,Name,Value"), [(2_000_000, b"SERVO2_TRIM", 1510.0)])]
    found, by_name = read(tmp_path, log_of({2: (19, EL, PLAIN)}, more))
    assert any("SERVO2_TRIM was changed" in text and "1510" in text for text in found.log.notes)
    assert "centre 1510 us" in by_name["de_cmd"].said


# PX4 --------------------------------------------------------------------------------------------------------------

FLOATS = "uint64_t timestamp;uint64_t timestamp_sample;float[{}] {};"
FINE = 3e-7
TORQUES = np.column_stack([AIL, EL, RUD])


def px4(tmp_path, servos=None, surfaces=(), torques=TORQUES, servo_step=1, more=(), **extra):
    topics = [("vehicle_angular_velocity", FLOATS.format(3, "xyz"), T, TORQUES)]
    if torques is not None:
        topics.append(("vehicle_torque_setpoint", FLOATS.format(3, "xyz"), T, torques))
    if servos is not None:
        unused = [np.full(T.size, np.nan)] * (8 - len(servos))
        values = np.column_stack([*servos, *unused])[::servo_step]
        topics.append(("actuator_servos", FLOATS.format(8, "control"), T[::servo_step], values))
    known = dict(extra)
    for i, (kind, *torque) in enumerate(surfaces):
        known[f"CA_SV_CS{i}_TYPE"] = kind
        known |= {f"CA_SV_CS{i}_TRQ_{axis}": float(value) for axis, value in zip("RPY", torque, strict=False)}
    if surfaces:
        known["CA_SV_CS_COUNT"] = len(surfaces)
    return read(tmp_path, ulog_of([*topics, *more], known), "f.ulg")


PX4_AIRFRAMES = {
    "surfaces of their own": (
        (-AIL, AIL, EL, RUD),
        ((1, -0.5, 0.0, 0.0), (2, 0.5, 0.0, 0.0), (3, 0.0, 1.0, 0.0), (4, 0.0, 0.0, 1.0)),
    ),
    "elevons": ((EL - AIL, EL + AIL, RUD), ((5, -0.5, 0.5, 0.0), (6, 0.5, 0.5, 0.0), (4, 0.0, 0.0, 1.0))),
    "V-tail": ((AIL, EL + RUD, EL - RUD), ((15, 1.0, 0.0, 0.0), (7, 0.0, 0.5, 0.5), (8, 0.0, 0.5, -0.5))),
    "V-tail and ailerons of custom type": (
        (EL - RUD, -AIL, EL + RUD, AIL),
        ((12, 0.0, 0.4, -0.3), (12, -0.2, 0.0, 0.0), (12, 0.0, 0.4, 0.3), (12, 0.2, 0.0, 0.0)),
    ),
    "two elevators of unequal power": (
        (AIL, 1.5 * EL, 0.5 * EL, RUD),
        ((15, 1.0, 0.0, 0.0), (3, 0.0, 0.5, 0.0), (3, 0.0, 0.5, 0.0), (4, 0.0, 0.0, 1.0)),
    ),
    "flaps between the surfaces": (
        (0.7 + 0.0 * T, -AIL, AIL, EL, RUD),
        ((9, 0.0, 0.0, 0.0), (1, -0.5, 0.0, 0.0), (2, 0.5, 0.0, 0.0), (3, 0.0, 1.0, 0.0), (4, 0.0, 0.0, 1.0)),
    ),
    "types without torques": ((EL - AIL, EL + AIL, RUD), ((5,), (6,), (4,))),
}


@pytest.mark.parametrize("name", PX4_AIRFRAMES)
def test_surfaces_of_px4_follow_the_allocation(tmp_path, name):
    servos, surfaces = PX4_AIRFRAMES[name]
    found, by_name = px4(tmp_path, servos, surfaces)
    full = THROW["de"]
    assert close(by_name["de_cmd"], -full * EL, FINE)
    assert close(by_name["da_cmd"], full * AIL, FINE)
    assert close(by_name["dr_cmd"], -full * RUD, FINE)
    assert all(by_name[f"{s}_cmd"].source.startswith("actuator_servos.") for s in ("de", "da", "dr"))
    assert "commands of surfaces are servo outputs, mixed by the log's own CA_SV_CS settings" in found.log.notes


def test_servos_logged_slowly_or_without_settings_leave_it_to_the_torques(tmp_path):
    servos, surfaces = PX4_AIRFRAMES["elevons"]
    for found, by_name in (
        px4(tmp_path, servos, surfaces, servo_step=5),
        px4(tmp_path, servos),
        px4(tmp_path, servos, surfaces, CA_AIRFRAME=4),
        px4(tmp_path),
    ):
        assert by_name["de_cmd"].source == "vehicle_torque_setpoint.xyz[1]"
        assert close(by_name["de_cmd"], -THROW["de"] * EL, FINE)
        assert not any("servo outputs, mixed" in text for text in found.log.notes)
    slow, _ = px4(tmp_path, servos, surfaces, servo_step=5)
    assert any("actuator_servos" in text and "10 Hz only" in text for text in slow.log.notes)
    none, _ = px4(tmp_path, servos)
    assert any("actuator_servos is not read" in text for text in none.log.notes)


def test_the_commands_of_older_px4_are_read(tmp_path):
    control = np.column_stack([AIL, EL, RUD, THRUST])
    fields = "uint64_t timestamp;uint64_t timestamp_sample;float[4] control;"
    first = ("actuator_controls_0", fields, T, control)
    _, by_name = px4(tmp_path, torques=None, more=[first])
    assert close(by_name["da_cmd"], THROW["da"] * AIL, FINE)
    assert close(by_name["thr_cmd"], THRUST, 1e-6)
    assert "the mixer after it, which is not in the log" in by_name["da_cmd"].assumed
    second = ("actuator_controls_1", fields, T, -control)
    _, wing = px4(tmp_path, torques=None, more=[first, second], VT_TYPE=2)
    assert close(wing["da_cmd"], -THROW["da"] * AIL, FINE)


def test_a_vtol_is_read_by_the_commands_of_its_wing(tmp_path):
    wing = ("vehicle_torque_setpoint#1", FLOATS.format(3, "xyz"), T, -TORQUES)
    _, by_name = px4(tmp_path, more=[wing], CA_AIRFRAME=2)
    assert by_name["de_cmd"].source == "vehicle_torque_setpoint#1.xyz[1]"
    _, plane = px4(tmp_path, more=[wing], CA_AIRFRAME=1)
    assert plane["de_cmd"].source == "vehicle_torque_setpoint.xyz[1]"
