"""Tables of X-Plane, Piccolo, Garmin and of writers that state no unit: their names, units, signs and full throws."""

import numpy as np
import pytest
from test_import_that_failed_once import failed_once

from testbench.core.constants import DEG_RAD, FT_M, G0_M_S2, KT_M_S
from testbench.core.errors import RecordError
from testbench.questions.importing.ask import import_log, parse_throws

T = np.arange(0.0, 12.0, 0.02)
PULSE = 0.12 * ((T > 3.0) & (T < 4.0)) - 0.12 * ((T > 4.0) & (T < 5.0))  # part of full throw, nose up first
PITCH = 0.05 + 0.1 * np.sin(T)
RATE = 0.1 * np.cos(T)
HEADING = np.mod(350.0 + 3.0 * T, 360.0)  # deg


def text(path, columns, separator=",", above=""):
    rows = [[x if isinstance(x, str) else f"{x:.9g}" for x in row] for row in zip(*columns.values(), strict=True)]
    path.write_text(above + "\n".join(separator.join(row) for row in ([*columns], *rows)) + "\n")
    return path


XPLANE = {"   _real,_time ": 500.0 + T, "    _elev,yoke1 ": PULSE, "    elev,_surf ": PULSE,
          "   ruddr,yoke1 ": 0.5 * PULSE,
          "    ___Q,rad/s ": RATE, "   __alt,ftmsl ": 3000.0 + T, "   Gload,norml ": 1.0 + PULSE,
          "   hding,_true ": HEADING}  # fmt: skip


def test_x_plane_s_parts_of_full_throw_load_factor_and_height(tmp_path):
    found = import_log(text(tmp_path / "Data.txt", XPLANE, "|"), throw_rad={"de": 25.0 * DEG_RAD})
    record = found.record
    np.testing.assert_allclose(record["de_cmd"], -25.0 * DEG_RAD * PULSE, atol=1e-8)
    np.testing.assert_allclose(record["de"], record["de_cmd"], atol=1e-12)
    np.testing.assert_allclose(record["dr_cmd"], -12.5 * DEG_RAD * PULSE, atol=1e-8)
    np.testing.assert_allclose(record["az"], -G0_M_S2 * (1.0 + PULSE), atol=1e-7)
    np.testing.assert_allclose(record["h"], FT_M * (3000.0 + T), rtol=1e-8)
    np.testing.assert_allclose(record["psi"] - record["psi"][0], 3.0 * DEG_RAD * T, atol=1e-6)
    assumed = {c.name: c.assumed for c in found.channels}
    assert "as given" in assumed["de"]
    assert "25 deg (assumed" in assumed["dr_cmd"]


@pytest.mark.parametrize(("name", "sign"), [("/fdm/jsbsim/fcs/elevator-cmd-norm", 1.0), ("elevator cmd [%]", 100.0)])
def test_parts_of_full_throw_by_their_unit(name, sign, tmp_path):
    path = text(tmp_path / "f.csv", {"time": T, name: sign * PULSE, "q [rad/s]": RATE})
    record = import_log(path, throw_rad=parse_throws(["de=-20"])).record
    np.testing.assert_allclose(record["de_cmd"], -20.0 * DEG_RAD * PULSE, atol=1e-8)


def test_a_surface_without_unit_is_a_part_of_full_throw_where_a_throw_is_given(tmp_path):
    path = text(tmp_path / "f.csv", {"time": T, "elevator": 8.0 * PULSE, "q": RATE})
    found = import_log(path)
    assert "--throw de=25 reads 'elevator' as parts of a full throw of 25 deg" in " ".join(found.asked)
    told = import_log(path, throw_rad={"de": 25.0 * DEG_RAD})
    np.testing.assert_allclose(told.record["de"], 25.0 * DEG_RAD * 8.0 * PULSE, atol=1e-8)
    assert not told.asked


def test_piccolo_s_names_in_angle_brackets(tmp_path):
    columns = {"<Clock>[ms]": 1000.0 * T, "<Pitch>[rad]": PITCH, "<Q>[rad/s]": RATE, "<VDown>[m/s]": RATE,
               "<Zaccel>[m/s/s]": -9.8 - RATE, "<Surface0>[rad]": PULSE}  # fmt: skip
    record = import_log(text(tmp_path / "flight.log", columns, " ")).record
    assert set(record.channels) == {"theta", "q", "hdot", "az"}  # which surface is Surface0 stands in no log
    np.testing.assert_allclose(record["hdot"], -RATE, atol=1e-8)
    assert record.duration_s == pytest.approx(T[-1])
    (tmp_path / "model.log").write_text('<fdm_config name="a">\n<metrics></metrics>\n')
    with pytest.raises(RecordError, match="it is XML"):
        import_log(tmp_path / "model.log")


def test_garmin_s_row_of_units_stands_above_the_names(tmp_path):
    t = np.arange(40)
    columns = {"  Lcl Date": ["2024-05-04"] * 40, " Lcl Time": [f"09:12:{i:02d}" for i in t], " AltMSL": 350.0 + t,
               " TAS": 100.0 + 0.1 * t, " VSpd": 600.0 + t, " Pitch": 2.0 + np.sin(t), " HDG": 10.0 + t,
               " E1 CHT1": 300.0 + t}  # fmt: skip
    above = '#airframe_info, log_version="1.00",\n#yyy-mm-dd, hh:mm:ss, ft msl, kt, fpm, deg, deg, deg F\n'
    found = import_log(text(tmp_path / "log.csv", columns, ",", above))
    record = found.record
    assert set(record.channels) == {"h", "V", "hdot", "theta", "psi"}
    assert record["h"][0] == pytest.approx(350.0 * FT_M)
    assert record["V"][0] == pytest.approx(100.0 * KT_M_S)
    assert record["hdot"][0] == pytest.approx(600.0 * FT_M / 60.0)
    assert not any(c.assumed for c in found.channels)


def test_a_heading_to_359_and_the_slope_of_pitch_leave_no_doubt_of_degrees(tmp_path):
    columns = {"time": T, "heading": HEADING, "pitch": PITCH, "p": 0.3 * RATE / DEG_RAD, "q": RATE / DEG_RAD}
    found = import_log(text(tmp_path / "f.csv", columns))
    np.testing.assert_allclose(found.record["q"], RATE, atol=1e-7)
    np.testing.assert_allclose(found.record["p"], 0.3 * RATE, atol=1e-7)  # rates of one table are in one unit
    np.testing.assert_allclose(np.diff(found.record["psi"]), 0.06 * DEG_RAD, atol=1e-6)
    said = " ".join(found.log.notes)
    assert "psi is taken in deg" in said
    assert "p is taken in deg/s" in said
    assert "q is taken in deg/s" in said
    assert not found.asked
    radians = import_log(text(tmp_path / "g.csv", {"time": T, "heading": DEG_RAD * HEADING, "pitch": PITCH, "q": RATE}))
    np.testing.assert_allclose(radians.record["q"], RATE, atol=1e-7)
    assert not radians.log.notes


@pytest.mark.parametrize(
    ("case", "channels"),
    [
        ("csv_mavlogdump/input.csv", "p q r ax ay az"),
        ("csv_ulog2csv/vehicle_attitude_0.csv", "phi theta psi"),
        ("csv_ulog2csv/vehicle_angular_velocity_0.csv", "p q r"),
        ("csv_ros_quaternion/input.csv", "phi theta psi p q r ax ay az"),
        ("log_angle_brackets/input.log", "phi theta p q r V ax ay az de"),
        ("txt_xplane/input.txt", "V de de_cmd q p r theta phi psi alpha h az thr"),
    ],
)
def test_the_inputs_that_failed(case, channels):
    assert import_log(failed_once(case)).record.channels == tuple(channels.split())


@pytest.mark.parametrize(("way", "asked"), [(1.0, False), (-1.0, True)])
def test_a_full_throw_whose_sign_the_motion_contradicts_is_asked(way, asked, tmp_path):
    q = np.zeros(T.size)
    for i in range(T.size - 1):  # qdot = -3 q - 20 de, de up to 3 deg; X-Plane's yoke counts nose up
        q[i + 1] = q[i] + 0.02 * (-3.0 * q[i] + 20.0 * way * 25.0 * DEG_RAD * PULSE[i])
    columns = {"_real,_time": T, "elev,yoke1": PULSE, "___Q,rad/s": q + 1e-4 * np.sin(40.0 * T)}
    path = text(tmp_path / "Data.txt", columns, "|")
    found = import_log(path, throw_rad={"de": 25.0 * DEG_RAD})
    assert ("--throw de=-25" in " ".join(found.asked)) == asked
    turned = import_log(path, throw_rad={"de": -25.0 * DEG_RAD})
    assert ("--throw de=-25" in " ".join(turned.asked)) != asked
