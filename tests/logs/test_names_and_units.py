"""Headings of tables of many writers: which channel, which unit, which column of times; nothing guessed beyond them."""

from pathlib import Path

import numpy as np
import pytest

from testbench.core.channels import CHANNELS, UNITS
from testbench.core.errors import ScenarioError
from testbench.logs.catalogue import writer_of
from testbench.logs.names import clock_called, meaning, plain_unit, split_unit, time_unit
from testbench.logs.tables import Table
from testbench.questions.importing.ask import import_log


@pytest.mark.parametrize(
    ("heading", "stated", "channel", "unit"),
    [
        # JSBSim's own CSV
        ("Elevator Position", "deg", "de", "deg"), ("Q dot", "deg/s^2", "qdot", "deg/s2"),
        ("V_{Total}", "ft/s", "V", "ft/s"), ("q bar", "psf", "qbar", "psf"), ("Alpha", "deg", "alpha", "deg"),
        ("Aero V_{X Body}", "ft/s", "u", "ft/s"), ("Wind V_{North}", "ft/s", "wind_north", "ft/s"),
        ("Altitude ASL", "ft", "h", "ft"), ("Left Aileron Position", "deg", "da", "deg"),
        ("Elevator command", "deg", "de_cmd", "deg"), ("Aileron cmd [rad]", "", "da_cmd", "rad"),
        ("rudder_demand (deg)", "", "dr_cmd", "deg"), ("Throttle command", "%", "thr_cmd", "%"),
        # flight-test instrumentation
        ("Aileron position [deg]", "", "da", "deg"), ("Pitch attitude [deg]", "", "theta", "deg"),
        ("True heading [deg]", "", "psi", "deg"), ("Pressure altitude [ft]", "", "h", "ft"),
        # words joined by capitals
        ("RollRate [deg/s]", "", "p", "deg/s"), ("pitchRate (rad/s)", "", "q", "rad/s"), ("YawRate", "", "r", ""),
        ("TrueAirspeed [m/s]", "", "V", "m/s"), ("AngleOfAttack", "deg", "alpha", "deg"),
        ("AoA [deg]", "", "alpha", "deg"),
        ("ElevatorCmd [deg]", "", "de_cmd", "deg"),
        # properties of JSBSim and FlightGear
        ("/fdm/jsbsim/velocities/q-rad_sec", "", "q", "rad/s"), ("fcs/elevator-pos-rad", "", "de", "rad"),
        ("fcs/elevator-pos-deg", "", "de", "deg"), ("velocities/vt-fps", "", "V", "ft/s"),
        ("aero/qbar-psf", "", "qbar", "psf"), ("accelerations/qdot-rad_sec2", "", "qdot", "rad/s2"),
        ("attitude/theta-deg", "", "theta", "deg"), ("position/h-sl-ft", "", "h", "ft"),
        ("/orientation/pitch-rate-degps", "", "q", "deg/s"), ("/orientation/side-slip-deg", "", "beta", "deg"),
        # X-Plane's data output
        ("__Q,rad/s", "", "q", "rad/s"), ("alpha,__deg", "", "alpha", "deg"), ("Vtrue,_ktas", "", "V", "kt"),
        # units as suffixes and after slashes
        ("alpha_deg", "", "alpha", "deg"), ("alpha/deg", "", "alpha", "deg"), ("q_rad_s", "", "q", "rad/s"),
        ("q/(deg/s)", "", "q", "deg/s"), ("q [deg/s]", "", "q", "deg/s"), ("q / deg/s", "", "q", "deg/s"),
        ("de_cmd_deg", "", "de_cmd", "deg"), ("u_ft_s", "", "u", "ft/s"), ("V_kts", "", "V", "kt"),
        ("pitch_rate_dps", "", "q", "deg/s"), ("pitch-rate (deg/sec)", "", "q", "deg/s"),
        # units without their stroke, and abbreviations that have a unit
        ("p_degs", "", "p", "deg/s"), ("r [rads]", "", "r", "rad/s"), ("pitch_degs", "", "theta", "deg"),
        ("ax_mss", "", "ax", "m/s2"), ("az_ms2", "", "az", "m/s2"), ("TAS_ms", "", "V", "m/s"),
        ("TAS_kmh", "", "V", "km/h"), ("tas_km_h", "", "V", "km/h"), ("TAS (kn)", "", "V", "kt"),
        ("qdot_dps2", "", "qdot", "deg/s2"), ("baro_alt_m", "", "h", "m"), ("alt_ft", "", "h", "ft"),
        ("elev_cmd_deg", "", "de_cmd", "deg"), ("elevator_cmd_deg", "", "de_cmd", "deg"),
        ("AilCmd [deg]", "", "da_cmd", "deg"), ("rud_sp_rad", "", "dr_cmd", "rad"), ("thr_cmd_pct", "", "thr_cmd", "%"),
        ("elev_deg", "", "de", "deg"), ("ail_pos [deg]", "", "da", "deg"), ("rud_defl", "deg", "dr", "deg"),
        # paths in structures, and spellings of units
        ("flight.imu.q", "°/s", "q", "deg/s"), ("az", "m s-2", "az", "m/s2"), ("az", "m/s/s", "az", "m/s2"),
        ("V", "knots", "V", "kt"), ("qbar", "lb/ft^2", "qbar", "psf"), ("q", "degrees per second", "q", "deg/s"),
        ("thr [1]", "", "thr", "1"), ("q", "", "q", ""), ("q", "furlongs", "q", ""), ("thrust", "lbs", "thrust", "lbf"),
    ],
)  # fmt: skip
def test_headings_of_many_writers(heading, stated, channel, unit):
    assert meaning(heading, stated)[:3] == (channel, unit, 1.0)


@pytest.mark.parametrize(
    ("heading", "stated", "channel", "unit", "sign"),
    [
        ("__alt,ftmsl", "", "h", "ft", 1.0),
        ("/velocities/vertical-speed-fps", "", "hdot", "ft/s", 1.0),
        ("fcs/elevator-cmd-norm", "", "de_cmd", "norm", 1.0),
        ("fcs/elevator-pos-norm", "", "de", "norm", 1.0),
        ("elevator", "%", "de", "%", 1.0),
        ("VSpd", "fpm", "hdot", "ft/min", 1.0),
        ("AltMSL", "ft msl", "h", "ft", 1.0),
        ("<VDown>", "m/s", "hdot", "m/s", -1.0),
    ],
)
def test_what_a_writer_gives_in_its_own_unit_and_sign(heading, stated, channel, unit, sign):
    assert meaning(heading, stated)[:3] == (channel, unit, sign)


@pytest.mark.parametrize(
    ("writer", "heading", "channel", "unit", "scale", "offset"),
    [
        ("X-Plane", "hding,_true", "psi", "deg", 1.0, 0.0),
        ("X-Plane", "Gload,norml", "az", "g", -1.0, 0.0),
        ("X-Plane", "_elev,yoke1", "de_cmd", "norm", -1.0, 0.0),
        ("X-Plane", "ailrn,_surf", "da", "norm", 1.0, 0.0),
        ("X-Plane", "ruddr,yoke1", "dr_cmd", "norm", -1.0, 0.0),
        ("FlightGear", "/controls/flight/rudder", "dr_cmd", "norm", -1.0, 0.0),
        ("FlightGear", "/surface-positions/rudder-pos-norm", "dr", "norm", -1.0, 0.0),
        ("FlightGear", "/accelerations/pilot/z-accel-fps_sec", "az", "ft/s2", 1.0, 0.0),
        ("Garmin", "NormAc", "az", "g", -1.0, -1.0),
    ],
)
def test_what_a_writer_of_the_catalogue_means_by_a_column(writer, heading, channel, unit, scale, offset):
    by = {"X-Plane": "_real,_time", "FlightGear": "/orientation/roll-deg", "Garmin": "Lcl Time"}[writer]
    names = (by, heading, "AltMSL")
    table = Table(Path("a.csv"), names, ("",) * 3, (np.arange(3.0),) * 3)
    found = writer_of(table)
    assert found.title.startswith(writer)
    assert found.meanings(table)[1][:4] == (channel, unit, scale, offset)


def test_a_writer_of_ones_own_lies_beside_the_log_and_a_wrong_one_is_said(tmp_path):
    (tmp_path / "writers").mkdir()
    own = tmp_path / "writers" / "mine.toml"
    own.write_text(
        'title = "my logger"\nsource = "me"\ncolumns = ["A0", "G1"]\nignore = ["q"]\n'
        '[time]\ncolumn = "ticks"\nunit = "ms"\n'
        '[[channel]]\nname = "q"\ncolumn = "G1"\nunit = "deg/s"\nscale = -0.1\n', encoding="utf-8"
    )  # fmt: skip
    t = np.arange(200)
    rows = np.column_stack([20 * t, 9.0 + 0 * t, 30.0 * np.sin(0.1 * t), 7.0 + t])
    path = tmp_path / "log.csv"
    np.savetxt(path, rows, "%.6f", ",", header="ticks,A0,G1,q", comments="")
    found = import_log(path)
    assert "as my logger writes it" in found.log.kind
    assert found.record.channels == ("q",)
    np.testing.assert_allclose(found.record["q"], np.radians(-3.0 * np.sin(0.1 * t)), atol=1e-6)
    assert found.record.duration_s == pytest.approx(3.98)
    other = tmp_path / "other"
    (other / "writers").mkdir(parents=True)
    (other / "writers" / "mine.toml").write_text(
        own.read_text(encoding="utf-8").replace("deg/s", "m"), encoding="utf-8"
    )
    (other / "log.csv").write_bytes(path.read_bytes())
    with pytest.raises(ScenarioError, match=r"channel\[0\].*measured in rad/s or deg/s or rpm, got unit 'm'"):
        import_log(other / "log.csv")


@pytest.mark.parametrize(
    "heading",
    ["Q(1)_{LOCAL}", "Q_{inertial}", "V_{Inertial}", "q_s", "V_s", "UBody", "y[1]", "q[2]", "Vind,_kias",
     "Elevator Command", "RollRateCmd", "PitchRateSp",
     "Elevator command [kg]", "velocities/vc-kts", "fcs/right-aileron-pos-rad", "",
     "flight.y", "elev", "elev_m", "elev [m]", "ail_cmd", "rud", "ias_kmh", "V_mss", "ax_ms"],
)  # fmt: skip
def test_what_is_no_channel_stays_none(heading):
    assert meaning(heading) is None


@pytest.mark.parametrize(
    ("heading", "channel"),
    [("α", "alpha"), ("β [°]", "beta"), ("θ", "theta"), ("ψ (deg)", "psi"), ("ϕ", "phi"), ("δe", "de"), ("δ_a", "da"),
     ("δr [rad]", "dr")],
)  # fmt: skip
def test_symbols_in_greek_letters(heading, channel):
    found = meaning(heading)
    assert found is not None
    assert found.channel == channel


def test_every_channel_is_found_under_its_own_name_in_each_of_its_units():
    for name, channel in CHANNELS.items():
        for unit in UNITS.get(channel.unit, {channel.unit: 1.0}):
            assert meaning(f"{name} [{unit}]")[:3] == (name, unit, 1.0)
            assert meaning(name, unit)[:3] == (name, unit, 1.0)


@pytest.mark.parametrize(
    ("heading", "unit"),
    [("Time", ""), ("TimeUS", "us"), ("time_us", "us"), ("t_ms", "ms"), ("timestamp (ms)", "ms"), ("t / s", "s"),
     ("Timestamp_ns", "ns"), ("time_boot_ms", "ms"), ("/fdm/jsbsim/simulation/sim-time-sec", "s"), ("flight.t", ""),
     ("_real,_time", ""), ("/sim/time/elapsed-sec", "s"), ("Zeit [s]", "s"), ("times", "")],
)  # fmt: skip
def test_columns_of_times_and_the_unit_in_their_name(heading, unit):
    assert clock_called(heading) == (True, unit)


@pytest.mark.parametrize("heading", ["t_alpha", "timestamp_sample", "clock", "", "theta", "t_5", "flight_time_left"])
def test_what_is_no_column_of_times(heading):
    assert clock_called(heading) == (False, "")


@pytest.mark.parametrize(
    ("stated", "unit"),
    [("seconds", "s"), ("nanoseconds since 2024-05-01 12:00:00", "ns"), ("days since 1970-01-01", "d"), ("µs", "us"),
     ("[ms]", "ms"), ("fortnights", ""), ("", "")],
)  # fmt: skip
def test_units_of_time(stated, unit):
    assert time_unit(stated) == unit


def test_units_and_their_brackets():
    assert split_unit("V_{Total} (ft/s)") == ("V_{Total}", "ft/s")
    assert split_unit("Q(1)") == ("Q(1)", "")
    assert split_unit("q") == ("q", "")
    assert plain_unit("rad s^-1") == "rad/s"
    assert plain_unit("lb") == "lbf"
    assert plain_unit("stone") == ""
