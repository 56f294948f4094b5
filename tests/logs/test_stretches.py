"""What kind of flight each stretch of a log is, by whatever it logs, and that nothing else is identified from."""

import io
import re

import numpy as np
import pytest
from rich.console import Console
from writers import DATAFLASH, START_S, dataflash_of, short_period, ulog_of

from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.core.errors import RecordError
from testbench.logs.noise import moves, noise_of
from testbench.questions.identify.logs import descriptions_of
from testbench.questions.importing.ask import import_log, write_import
from testbench.questions.importing.page import import_answer, print_import

RATE = 20.0


def kinds(found):
    """The kinds of a log one after the other, without repetitions."""
    each = [s.kind for s in found.stretches]
    return [kind for kind, before in zip(each, ["", *each], strict=False) if kind != before]


def of_kind(found, kind):
    return [(s.start_s, s.end_s) for s in found.stretches if s.kind == kind]


def flight(folder, columns=("V", "Vg", "h", "phi", "de", "q", "theta"), wind=0.0):
    """Parked with a check of the elevator, a taxi, a take-off, a climb, a turn, a doublet, a descent, a landing."""
    rng = np.random.default_rng(5)
    t = np.arange(0.0, 200.0, 1.0 / RATE)
    at = [0, 20, 30, 31, 40, 50, 55, 80, 81, 150, 160, 165, 200]
    Vg = np.interp(t, at, [0, 0, 0, 4, 4, 1.5, 18, 18, 20, 20, 14, 0, 0])
    air = np.interp(t, [0, 50, 55, 160, 165, 200], [0, 0, 1, 1, 0, 0])
    h = 100.0 + np.interp(t, [0, 54, 80, 140, 159, 200], [0, 0, 80, 80, 0, 0])
    phi = 30.0 * DEG_RAD * ((t > 90.0) & (t < 105.0))
    pulse = ((t >= 8.0) & (t < 9.0)) * 1.0 - ((t >= 9.0) & (t < 10.0))
    doublet = ((t >= 115.0) & (t < 116.0)) * 1.0 - ((t >= 116.0) & (t < 117.0))
    q = 0.3 * air * np.exp(-((t - 115.8) ** 2)) + 0.004 * rng.standard_normal(t.size)
    data = {
        "V": (Vg + wind) * 1.0 + 0.2 * rng.standard_normal(t.size),
        "Vg": np.abs(Vg + 0.05 * rng.standard_normal(t.size)),
        "h": h + 0.2 * rng.standard_normal(t.size),
        "phi": phi + 0.01 * rng.standard_normal(t.size),
        "de": 6.0 * DEG_RAD * (pulse + doublet),
        "q": q,
        "theta": 0.05 + np.cumsum(q) / RATE * 0.01,
    }
    path = folder / "flight.csv"
    table = np.column_stack([t, *(data[name] for name in columns)])
    np.savetxt(path, table, "%.5f", ",", header=",".join(["t", *columns]), comments="")
    return path


ORDER = ["parked", "control check", "parked", "taxi", "take-off roll", "climb", "cruise", "turn", "cruise",
         "manoeuvre", "cruise", "descent", "landing roll", "parked"]  # fmt: skip


@pytest.mark.parametrize("wind", [0.0, 7.0])
def test_a_flight_is_told_from_the_ground_before_and_after_it_also_in_a_wind(tmp_path, wind):
    found = import_log(flight(tmp_path, wind=wind))
    steady = ("cruise", "parked") if wind else ()  # the run that lifts off and the climb are not told apart exactly
    assert [kind for kind in kinds(found) if kind not in steady] == [kind for kind in ORDER if kind not in steady]
    ((start, end),) = of_kind(found, "turn")
    assert (start, end) == (pytest.approx(90.0, abs=2.0), pytest.approx(105.0, abs=2.0))
    check, doublet = found.search.manoeuvres
    assert check.cut_s is None
    assert "a check of controls on the ground" in check.reason
    assert doublet.cut_s is not None
    assert [name for own in found.members.values() for name in own] == ["01_de"]


def test_without_any_speed_an_aircraft_that_does_not_answer_and_rests_is_on_the_ground(tmp_path):
    found = import_log(flight(tmp_path, columns=("de", "q", "theta", "phi")))
    (start, end), *more = of_kind(found, "control check")
    assert not more
    assert start <= 8.0 < 10.0 <= end
    assert [m.cut_s is None for m in found.search.manoeuvres] == [True, False]
    assert "the aircraft does not respond to de: q moves no more than its noise" in found.search.manoeuvres[0].reason


def test_two_checks_of_controls_on_the_ground_are_no_flight_and_are_not_identified(tmp_path):
    """7 derivatives were "weak", where nothing but the elevator had moved."""
    rng = np.random.default_rng(4)
    t = np.arange(0.0, 30.0, 0.02)
    command_deg = sum(10.0 * ((t >= a) & (t < a + 1.0)) - 10.0 * ((t >= a + 1.0) & (t < a + 2.0)) for a in (5.0, 15.0))
    sizes = (0.5, 0.15, 0.02, 0.05, 0.03, 0.1)
    still = np.array([0.0, 0.0, 1.0, -9.81, 0.077, 580.0]) + sizes * rng.standard_normal((t.size, 6))
    head = "t [s],elevator command [deg],alpha [deg],q [deg/s],theta [deg],az [m/s2],groundspeed [m/s],h [m]"
    path = tmp_path / "parked.csv"
    np.savetxt(path, np.column_stack([t, command_deg, still]), "%.6f", ",", header=head, comments="")
    found = import_log(path)
    assert set(kinds(found)) == {"parked", "control check"}
    assert found.members == {}
    (why,) = found.unusable
    assert "the ground speed is 0.07" in why
    assert "the aircraft does not respond to de_cmd" in why
    with pytest.raises(RecordError, match="it contains no flight"):
        descriptions_of(path, tmp_path)


def copter():
    """A log of an ArduCopter without settings of its servos, as old ones are: outputs 1 to 4 drive motors."""
    formats = (*DATAFLASH, (137, "MODE", "QBBB", "TimeUS,Mode,ModeNum,Rsn"), (138, "BARO", "Qf", "TimeUS,Alt"))
    out = [(0, ("MSG", (0, b"Frame: QUAD"))), (0, ("MSG", (0, b"ArduCopter V3.4.4")))]
    for k in range(600):
        us = round((START_S + k / 20.0) * 1e6)
        swing = 100.0 * np.sin(0.3 * k)
        out.append((us, ("IMU", (us, 0, 0.01, 0.2 * np.sin(0.3 * k), 0.0, 0.1, 0.1, -9.8))))
        out.append((us, ("RCOU", (us, *(round(1500 + sign * swing) for sign in (1, -1, 1, -1))))))
        out.append((us, ("BARO", (us, 20.0 if 100 < k < 500 else 0.0))))
        if k in (0, 300):
            out.append((us, ("MODE", (us, 5 * (k == 300), 5 * (k == 300), 0))))
    return dataflash_of(formats, [message for _, message in sorted(out, key=lambda item: item[0])])


def test_motors_of_a_copter_are_no_surfaces_and_its_firmware_is_not_its_first_message(tmp_path):
    (tmp_path / "c.bin").write_bytes(copter())
    found = import_log(tmp_path / "c.bin")
    assert found.log.facts["software"] == "ArduCopter V3.4.4"
    assert found.log.vehicle == "rotorcraft"
    assert not {"de_cmd", "da_cmd", "dr_cmd"} & set(found.record.channels)
    assert set(kinds(found)) == {"parked", "climb", "flight", "descent"}
    assert [m.said for m in found.log.modes] == ["STABILIZE (stabilised)", "LOITER (stabilised)"]
    (why,) = found.unusable
    assert "the log is of a rotorcraft: it has no control surface of a fixed wing" in why


def test_a_quadplane_hovers_in_its_modes_of_lift_and_is_identified_from_its_wing_only(tmp_path):
    formats = (*DATAFLASH, (137, "MODE", "QBBB", "TimeUS,Mode,ModeNum,Rsn"), (138, "BARO", "Qf", "TimeUS,Alt"),
               (139, "GPS", "Qf", "TimeUS,Spd"))  # fmt: skip
    out = [(0, ("MSG", (0, b"ArduPlane V4.5.7"))), (0, ("PARM", (0, b"Q_ENABLE", 1.0)))]
    for k in range(1200):
        t = k / 20.0
        us = round((START_S + t) * 1e6)
        out.append((us, ("IMU", (us, 0, 0.01, 0.1 * np.sin(0.3 * k), 0.0, 0.1, 0.1, -9.8))))
        out.append((us, ("BARO", (us, float(np.interp(t, [0, 10, 15, 60], [0, 0, 20, 20]))))))
        out.append((us, ("GPS", (us, float(np.interp(t, [0, 30, 33, 60], [0.1, 0.1, 16, 16]))))))
        if k in (0, 640):
            out.append((us, ("MODE", (us, 18 if k == 0 else 10, 18 if k == 0 else 10, 0))))
    messages = [message for _, message in sorted(out, key=lambda item: item[0])]
    (tmp_path / "q.bin").write_bytes(dataflash_of(formats, messages))
    found = import_log(tmp_path / "q.bin")
    assert found.log.facts["vehicle"] == "QuadPlane, lift motors (Q_ENABLE)"
    assert [(s.kind, s.mode) for s in found.stretches] == [
        ("parked", "QHOVER (stabilised)"),
        ("hover", "QHOVER (stabilised)"),
        ("cruise", "AUTO (automatic)"),
    ]
    ((start, end),) = of_kind(found, "cruise")
    assert (start, end) == (pytest.approx(32.0, abs=1.0), pytest.approx(59.95))


def test_px4_says_itself_when_it_has_landed_and_in_which_mode_it_flies(tmp_path):
    t = np.arange(0.0, 35.0, 0.02)
    slow = np.arange(0.0, 35.0, 0.5)
    q, _, az = short_period(t)
    up = np.where((t >= 5.0) & (t < 6.0), 0.2, np.where((t >= 6.0) & (t < 7.0), -0.2, 0.0))
    stamp = "uint64_t timestamp;"
    topics = [
        ("vehicle_angular_velocity", f"{stamp}float[3] xyz;", t, np.column_stack([0 * t, q, 0.01 * t])),
        ("vehicle_acceleration", f"{stamp}float[3] xyz;", t, np.column_stack([0 * t, 0 * t, az])),
        ("vehicle_torque_setpoint", f"{stamp}float[3] xyz;", t, np.column_stack([0 * t, up, 0 * t])),
        ("vehicle_land_detected", f"{stamp}float landed;", slow, 1.0 * (slow < 12.0)[:, None]),
        ("vehicle_status", f"{stamp}float nav_state;", slow, np.where(slow < 20.0, 0.0, 3.0)[:, None]),
    ]
    (tmp_path / "f.ulg").write_bytes(ulog_of(topics, {"CA_AIRFRAME": 1}))
    found = import_log(tmp_path / "f.ulg")
    assert [(s.kind, s.mode) for s in found.stretches] == [
        ("parked", "MANUAL (manual)"),
        ("control check", "MANUAL (manual)"),
        ("parked", "MANUAL (manual)"),
        ("flight", "MANUAL (manual)"),
        ("flight", "AUTO_MISSION (automatic)"),
    ]
    (check,) = found.search.manoeuvres
    assert "the autopilot reports a landing" in check.reason


def test_velocities_along_the_body_axes_give_airspeed_and_flow_angles(tmp_path):
    t = np.arange(0.0, 20.0, 0.05)
    alpha, beta, V = 0.05 + 0.02 * np.sin(t), 0.03 * np.cos(t), 20.0 + np.sin(0.5 * t)
    u, v, w = V * np.cos(beta) * np.cos(alpha), V * np.sin(beta), V * np.cos(beta) * np.sin(alpha)
    head = "t,u [m/s],v [m/s],w [m/s]"
    np.savetxt(tmp_path / "f.csv", np.column_stack([t, u, v, w]), "%.9f", ",", header=head, comments="")
    record = import_log(tmp_path / "f.csv").record
    for name, expected in (("V", V), ("alpha", alpha), ("beta", beta)):
        np.testing.assert_allclose(record[name], expected, atol=1e-8)


def test_import_shows_a_timeline_and_identify_says_that_it_uses_flight_only(tmp_path):
    path = flight(tmp_path)
    found = import_log(path)
    out = io.StringIO()
    print_import(found, Console(file=out, width=200))
    line = next(text for text in out.getvalue().splitlines() if text.startswith("0 s |"))
    assert line.index("k") < line.index("t") < line.index("/") < line.index("u") < line.index("M") < line.index("\\")
    said = [text for _, text in import_answer(found) if "are flight on a wing" in text]
    assert said
    assert "control check" in said[0]
    (description,) = (p for p in write_import(found, tmp_path / "again") if p.suffix == ".toml")
    assert f"# Flight only: {said[0]}" in description.read_text(encoding="utf-8")


def test_noise_quantisation_and_true_rate_are_found_and_motion_is_what_exceeds_them():
    rng = np.random.default_rng(2)
    t = np.arange(0.0, 60.0, 0.02)
    white = 0.15 * rng.standard_normal(t.size)
    quiet = noise_of(t, white)
    assert quiet.std == pytest.approx(0.15, rel=0.1)
    assert quiet.step == 0.0
    assert not moves(white, 50.0, quiet)
    coarse = np.round(white / 0.1) * 0.1
    assert noise_of(t, coarse).step == pytest.approx(0.1)
    repeated = np.repeat(rng.standard_normal(t.size // 5), 5)
    assert noise_of(t, repeated).rate_hz == pytest.approx(10.0, rel=0.01)
    for moved in (white + 1.0 * ((t > 20.0) & (t < 22.0)), white + 0.05 * t):
        assert moves(moved, 50.0, noise_of(t, moved))


def stalled(folder, alpha_s=14.0 * DEG_RAD, vane=True, noise=1.0, seed=3):
    """A small aircraft in one plane: a pull-up, a gentle one, and a full pull that stalls it if ``alpha_s`` is low.

    Attached lift is a straight line; beyond ``alpha_s`` the flow separates, and the wing is a flat plate.
    """
    rng, dt = np.random.default_rng(seed), 0.01
    m, S, rho, J = 2.0, 0.4, 1.2, 0.12
    V, path, theta, q, h = 16.0, 0.0, 0.05, 0.0, 200.0
    rows = []
    for t in np.arange(0.0, 80.0, dt).tolist():
        pull = 0.02 * (10.0 < t < 12.0) - 0.02 * (12.0 < t < 14.0)
        pull += np.interp(t, [30.0, 45.0, 48.0, 50.0], [0.0, 0.30, 0.30, 0.0])
        alpha = theta - path
        lost = 1.0 / (1.0 + np.exp(-(alpha - alpha_s) / 0.02))
        CL = (0.3 + 4.5 * alpha) * (1.0 - lost) + lost * 0.9 * np.sin(2.0 * alpha)
        CD = 0.03 + 0.05 * CL**2 + lost * 1.8 * np.sin(alpha) ** 2
        qbar = 0.5 * rho * V**2
        rows.append((t, V, alpha, q, theta, -qbar * S / m * (CL * np.cos(alpha) + CD * np.sin(alpha)), h,
                     V * np.sin(path), -pull))  # fmt: skip
        Cm = 0.02 - 0.45 * alpha - 12.0 * q * 0.1 / V + pull
        thrust = 3.0 if t < 28.0 else 1.0
        V += dt * (thrust * np.cos(alpha) / m - qbar * S * CD / m - G0_M_S2 * np.sin(path))
        path += dt * ((qbar * S * CL + thrust * np.sin(alpha)) / (m * V) - G0_M_S2 * np.cos(path) / V)
        q += dt * qbar * S * 0.2 * Cm / J
        theta, h = theta + dt * q, h + dt * V * np.sin(path)
    x = np.array(rows)[::2]
    sizes = noise * np.array([0.0, 0.2, 0.005, 0.005, 0.004, 0.3, 0.3, 0.1, 0.0])
    x += sizes * rng.standard_normal(x.shape)
    names = ["t", "V", "alpha", "q", "theta", "az", "h", "hdot", "de"]
    kept = [i for i, name in enumerate(names) if vane or name != "alpha"]
    path = folder / "stall.csv"
    units = dict(zip(names, ("s", "m/s", "rad", "rad/s", "rad", "m/s2", "m", "m/s", "rad"), strict=True))
    header = ",".join(f"{names[i]} [{units[names[i]]}]" for i in kept)
    np.savetxt(path, x[:, kept], "%.6g", ",", header=header, comments="")
    return path, x[:, 0], np.array(rows)[::2, 2]


@pytest.mark.parametrize("vane", [True, False])
def test_a_stall_is_named_where_lift_grows_no_more(tmp_path, vane):
    path, t, alpha = stalled(tmp_path, vane=vane)
    found = import_log(path)
    spans = of_kind(found, "stall")
    assert spans
    inside = np.zeros(t.size, bool)
    for low, high in spans:
        inside |= (t >= low) & (t < high)
    assert np.mean(alpha[inside] > 12.0 * DEG_RAD) > 0.9
    assert np.mean(inside[alpha > 17.0 * DEG_RAD]) > 0.9
    why = next(s.why for s in found.stretches if s.kind == "stall")
    assert float(re.search(r"beyond ([\d.]+) deg", why)[1]) == pytest.approx(14.0, abs=2.0)
    assert not any(m.cut_s and m.cut_s[0] < high and m.cut_s[1] > low for m in found.search.manoeuvres
                   for low, high in spans)  # fmt: skip
    assert any("stall" in text for _, text in import_answer(found))


@pytest.mark.parametrize("seed", range(6))
def test_a_pull_up_without_a_stall_is_none(tmp_path, seed):
    path, _, alpha = stalled(tmp_path, alpha_s=1.0, vane=bool(seed % 2), noise=2.0, seed=seed)
    assert np.max(alpha) > 20.0 * DEG_RAD
    assert "stall" not in kinds(import_log(path))
