"""Logs of many writers, and what `testbench import` says of each first: ``make log-input-study ARGS=FOLDER``.

Writes results/logs/inputs.csv. Four kinds of input:

- written: one simulated flight (:mod:`flown_logs`, after a stand on the ground with a check of the elevator), as each
  writer of log_writers.toml puts it into a table: its names, units, signs, separators and clock; and as autopilots log
  it. The truth is known: every channel that is read must be the truth within 3 % and its noise, of a control that was
  logged as a part of full throw the sign; every channel that is wanted must be there. What is asked is answered as the
  questions say;
- foreign: files that are no logs, by their first bytes, and what the refusal must name;
- case: inputs that failed once (the folder ``cases`` beside the recorded flights), and what is right of them;
- public: logs that other people published, by log_inputs_public.csv, fetched into FOLDER at the developer's desk; no
  log is committed. Without FOLDER their rows stay as they are.

Columns: kind, input, source; wanted (:func:`judged`); what came out (kinds of flight, manoeuvres, channels, the first
question, or the refusal); right, "yes" or what is not.
"""

import re
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from flown_logs import DELAY_S, LAG_S, LOGS, THROWS, fly
from recorded import shared
from recordings import write_bag, write_tlog
from smallest import results, sized
from tables import read_rows, write_rows
from writers import quaternion

from testbench.core.constants import DEG_RAD, FT_M, G0_M_S2, KT_M_S
from testbench.core.errors import Refusal
from testbench.logs.sidpac import Told
from testbench.questions.importing.ask import Imported, import_log

TABLE = results("logs", "inputs.csv")
PUBLIC = Path(__file__).with_name("log_inputs_public.csv")
COLUMNS = ("kind", "input", "source", "wanted", "came_out", "right")
HZ = 50.0
STAND_S, GAP_S = 20.0, 10.0
_NOISE = {
    "V": 0.15,
    "alpha": 0.003,
    "p": 0.004,
    "q": 0.004,
    "r": 0.004,
    "phi": 0.003,
    "theta": 0.003,
    "psi": 0.005,
    "h": 0.3,
    "ax": 0.1,
    "ay": 0.1,
    "az": 0.1,
    "Vg": 0.1,
    "hdot": 0.1,
}
Flight = Mapping[str, np.ndarray]


def flight(seed: int = 1) -> Flight:
    """Return channel -> samples, in SI units, at HZ: a stand on the ground, a silence, and the pieces of a flight."""
    rng = np.random.default_rng(seed)
    parts: list[dict[str, np.ndarray]] = []
    t = np.arange(0.0, STAND_S, 1.0 / HZ)
    check = np.where((t > 8.0) & (t < 9.0), 0.1, np.where((t >= 9.0) & (t < 10.0), -0.1, 0.0))
    stand = dict.fromkeys((*_NOISE, "da", "dr"), 0.0 * t)
    parts.append({**stand, "t": t, "az": 0.0 * t - G0_M_S2, "h": 0.0 * t + 60.0, "de": check, "theta": 0.0 * t + 0.05})
    for piece in fly(seed):
        t = np.arange(piece.t_s[0], piece.t_s[-1], 1.0 / HZ)
        own = {n: np.interp(t, piece.t_s, np.unwrap(x) if n == "psi" else x) for n, x in piece.x.items() if n in _NOISE}
        own["Vg"] = own["V"] + 1.0
        for name, asked in piece.commands.items():
            fine = np.interp(piece.t_s - DELAY_S, piece.loop_s, asked)
            kept = np.exp(-(piece.t_s[1] - piece.t_s[0]) / LAG_S)
            for k in range(1, fine.size):
                fine[k] = kept * fine[k - 1] + (1.0 - kept) * fine[k]
            own[name] = np.interp(t, piece.t_s, fine)
        parts.append({**own, "t": t + STAND_S + GAP_S})
    out = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    out |= {name: out[name] + size * rng.standard_normal(out["t"].size) for name, size in _NOISE.items()}
    air = out["t"] > STAND_S
    out["V"] = np.where(air, out["V"], np.abs(out["V"]))
    out["thr"] = np.where(air, 0.4, 0.0)
    out["psi"] = np.mod(out["psi"] + 6.0, 2.0 * np.pi)
    out["north"], out["east"] = (np.cumsum(out["Vg"] * f(out["psi"])) / HZ for f in (np.cos, np.sin))
    turned = quaternion(
        out["phi"], -out["theta"], 0.5 * np.pi - out["psi"]
    )  # ROS: forward, left, up to east, north, up
    clock = [f"09:{int(t // 60):02d}:{t % 60:06.3f}" for t in out["t"]]
    out |= {f"q{axis}": turned[:, i] for i, axis in enumerate("wxyz")}
    out |= {"count": np.arange(out["t"].size), "lift_1": -out["az"] / G0_M_S2 - 1.0, "h_60": out["h"] - 60.0}
    out |= {"motor": 1200.0 + 300.0 * out["thr"], "day": np.array(clock), "date": np.array(["2024-05-04"] * len(clock))}
    out["second"] = np.array([f"2024-05-04 {at[:8]}" for at in clock])
    return out | {"stamp": np.array([f"2024-05-04 {at}" for at in clock])}


# --- writers ----------------------------------------------------------------------------------------------------------

_DEG, _KT, _FT = 1.0 / DEG_RAD, 1.0 / KT_M_S, 1.0 / FT_M
_FACTORS = {
    "": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9, "deg": _DEG, "decideg": 10.0 * _DEG, "kt": _KT, "km/h": 3.6,
    "mph": 2.23694, "ft": _FT, "ft/min": 60.0 * _FT, "cm": 100.0, "cm/s": 100.0, "cm/s2": 100.0, "mm": 1e3, "%": 100.0,
    "g": 1.0 / G0_M_S2, "512 counts/g": 512.0 / G0_M_S2, "2048 counts/g": 2048.0 / G0_M_S2,
}  # fmt: skip
_OF_THROW = {"norm": (1.0, 0.0), "%": (100.0, 0.0), "stick": (500.0, 0.0), "pulse": (500.0, 1500.0)}
Column = Sequence[str]


@dataclass(frozen=True)
class Writer:
    """How one writer puts a flight into a table: log_writers.toml has them.

    Args:
        name: of the writer.
        file: what it calls the file.
        wanted: channels that must be read, with blanks between.
        columns: heading, channel of the flight, and its unit.
        sep: between cells.
        above: lines before the heading.
        vehicle: what must be recognised.
    """

    name: str
    file: str
    wanted: str
    columns: Sequence[Column]
    sep: str = ","
    above: str = ""
    vehicle: str = ""


WRITERS = [
    Writer(**row) for row in tomllib.loads((Path(__file__).with_name("log_writers.toml")).read_text("utf-8"))["writer"]
]


def in_unit(f: Flight, name: str, unit: str) -> np.ndarray:
    """Return a channel of the flight in the unit of a column."""
    sign, unit = (-1.0, unit[1:]) if unit.startswith("-") else (1.0, unit)
    if name in (*THROWS, "thr") and unit in _OF_THROW:
        factor, zero = _OF_THROW[unit]
        return zero + sign * factor / THROWS.get(name, 1.0) * f[name]
    return sign * _FACTORS[unit] * f[name]


def write(writer: Writer, f: Flight, folder: Path) -> Path:
    """Write a flight as a writer does; return the file."""
    cells = []
    for _, name, unit in writer.columns:
        values = f[name] if f[name].dtype.kind == "U" else in_unit(f, name, unit)
        text = [str(v) if isinstance(v, str) else f"{v:.10g}" for v in values.tolist()]
        cells.append([v.replace(".", ",") for v in text] if writer.sep == ";" else text)
    rows = [[heading for heading, _, _ in writer.columns], *zip(*cells, strict=True)]
    path = folder / writer.file
    path.write_text(writer.above + "\n".join(writer.sep.join(row) for row in rows) + "\n", encoding="utf-8")
    return path


def citation(f: Flight, folder: Path) -> Path:
    """The structure of structures of the Cessna Citation II of TU Delft and NLR: data, units, description of each."""
    from scipy.io import savemat

    air = f["t"] > STAND_S
    held = {
        "time": (f["t"], "sec"),
        "Dadc1_tas": (f["V"] * _KT, "kts"),
        "Dadc1_alt": (f["h"] * _FT, "ft"),
        "vane_AOA": (f["alpha"] * _DEG, "deg"),
        "Ahrs1_Pitch": (f["theta"] * _DEG, "deg"),
        "Ahrs1_Roll": (f["phi"] * _DEG, "deg"),
        "Ahrs1_bPitchRate": (f["q"] * _DEG, "deg/s"),
        "Ahrs1_bRollRate": (f["p"] * _DEG, "deg/s"),
        "Ahrs1_bYawRate": (f["r"] * _DEG, "deg/s"),
        "delta_e": (f["de"] * _DEG, "deg"),
        "delta_a": (f["da"] * _DEG, "deg"),
        "delta_r": (f["dr"] * _DEG, "deg"),
    }
    data = {k: {"data": x[air], "units": unit, "description": k.replace("_", " ")} for k, (x, unit) in held.items()}
    path = folder / "FTISxprt-20200306.mat"
    savemat(path, {"flightdata": data})
    return path


def topics_of_ros(f: Flight, folder: Path) -> Path:
    """A folder of topics as ALFA has it: one file each, every one with a clock of its own, 5 to 50 Hz."""
    own = folder / "flight_2018-07-18"
    own.mkdir()
    imu = next(w for w in WRITERS if w.name == "ROS, rostopic echo -p").columns
    hud = [
        ["field.airspeed", "V", ""],
        ["field.groundspeed", "Vg", ""],
        ["field.altitude", "h", ""],
        ["field.climb", "hdot", ""],
    ]
    pitch = [["field.commanded", "theta", "deg"], ["field.measured", "theta", "deg"]]
    stamp = ["%time", "t", "ns"]
    for name, columns, every in (
        ("imu-data", imu, 1),
        ("vfr_hud", [stamp, *hud], 10),
        ("nav_info-pitch", [stamp, *pitch], 2),
    ):
        write(
            Writer("", f"flight_2018-07-18-mavros-{name}.csv", "", columns), {k: x[::every] for k, x in f.items()}, own
        )
    return own


def autopilot(kind: str) -> Callable[[Flight, Path], Path]:
    """Return what writes the log of an autopilot, byte by byte after its format's own description."""

    def make(_: Flight, folder: Path) -> Path:
        name, log = LOGS[kind]
        (folder / name).write_bytes(log(1))
        return folder / name

    return make


def telemetry(f: Flight, folder: Path) -> Path:
    """Telemetry of MAVLink as pymavlink encodes it."""
    return write_tlog(folder / "flight.tlog", f, {name: f[name] / throw for name, throw in THROWS.items()})


def recording(name: str, f: Flight, folder: Path) -> Path:
    """A recording of ROS as rosbags writes it."""
    return write_bag(folder / name, f)


OTHERS: tuple[tuple[str, Callable[[Flight, Path], Path], str], ...] = (
    ("Citation II, TU Delft", citation, "V alpha theta phi p q r h de da dr"),
    ("ROS, a folder of topics", topics_of_ros, "phi theta psi p q r ax ay az V Vg h hdot"),
    ("PX4, ULog", autopilot("px4"), "p q r ax ay az phi theta psi V h de_cmd da_cmd dr_cmd"),
    ("ArduPilot, DataFlash", autopilot("ardupilot"), "p q r ax ay az phi theta psi V h de_cmd da_cmd dr_cmd"),
    ("MAVLink, telemetry (pymavlink)", telemetry, "p q r ax ay az phi theta psi V h alpha de_cmd da_cmd dr_cmd"),
    *(
        (f"{what} (rosbags)", partial(recording, name), "phi theta psi p q r ax ay az V Vg h hdot")
        for what, name in (("ROS, bag", "a.bag"), ("ROS 2, MCAP", "a.mcap"), ("ROS 2, SQLite", "a.db3"))
    ),
)


def compared(found: Imported, f: Flight, wanted: Sequence[str], kept: float = 0.03) -> list[str]:
    """Return what is not right of the channels that were read, one a sentence."""
    out = [f"{name} is not read" for name in wanted if name not in found.record]
    before = 0.0 if found.record.duration_s > f["t"][-1] - STAND_S else STAND_S + GAP_S  # some write the flight alone
    for c in found.channels:
        name = c.name.removesuffix("_cmd")
        if name not in f:
            continue
        t = c.t_s - float(found.record.provenance["clock_zero_s"]) + before
        x, y = np.interp(t, f["t"], np.unwrap(f[name]) if name == "psi" else f[name]), c.values
        air = t > STAND_S + GAP_S
        x, y = x[air], y[air]
        if name in ("north", "east"):  # which count from anywhere
            x, y = np.diff(x), np.diff(y)
        if name == "psi":
            turned = np.exp(1j * (y - x))
            y = x + np.angle(turned / np.mean(turned))
        slope = float(np.vdot(x - x.mean(), y - y.mean()) / max(np.vdot(x - x.mean(), x - x.mean()), 1e-300))
        part = "full command is" in c.assumed  # of full throw, which the file does not say
        room = kept * max(float(np.std(x)), abs(float(np.mean(x)))) + 3.0 * _NOISE.get(name, 0.01)
        if slope <= 0.0 if part else float(np.std(y - x)) > room or abs(float(np.mean(y - x))) > room:
            out.append(f"{c.name} is {slope:.3g} times the truth")
    return out


def answered(asked: Sequence[str]) -> dict[str, Any]:
    """Return what a user gives who does what the questions say first: ``throw_rad``, ``told``."""
    throw_rad, units, axes = dict[str, float](), dict[str, str](), None
    for text in asked:
        option = re.search(r"--(throw|unit|axes) (?:(\w+)=)?([-\w./]+)", text)
        if option is None:
            continue
        verb, name, value = option.groups()
        if verb == "axes":
            axes = value.rstrip(")")
        elif verb == "unit":
            units[name] = value
        else:
            throw_rad[name] = float(np.copysign(THROWS[name], float(value)))
    out: dict[str, Any] = {"throw_rad": throw_rad} if throw_rad else {}
    return out | ({"told": Told(axes, units)} if axes or units else {})


def judged(wanted: str, look: Callable[[], Imported]) -> tuple[str, list[str]]:
    """Return what came out of a log, in words, and what of it is not as wanted.

    Args:
        wanted: clauses with semicolons between: "channels p q", "not w", "kinds parked, cruise", "flies", "stands",
            "vehicle rotorcraft", "manoeuvres 2", "cuts 1", "recipe", "no recipe", "quiet" (no question),
            "asked PATTERN", "said PATTERN", "refused PATTERN".
        look: imports the log.
    """
    from testbench.questions.importing.page import import_answer

    clauses = [clause.strip().partition(" ")[::2] for clause in wanted.split(";") if clause.strip()]
    try:
        found = look()
    except Refusal as error:
        pattern = next((rest for verb, rest in clauses if verb == "refused"), None)
        right = pattern is not None and re.search(pattern, error.message)
        return f"refused: {error.message}", [] if right else ["refused"]
    kinds = {s.kind for s in found.stretches}
    text = " ".join([text for _, text in import_answer(found)] + [*found.log.notes, *found.log.assumed])
    usable = sum(m.cut_s is not None for m in found.search.manoeuvres)
    flown = any(s.flown for s in found.stretches)
    wrong = []
    for verb, rest in clauses:
        right = {
            "channels": lambda rest=rest: set(rest.split()) <= set(found.record.channels),
            "not": lambda rest=rest: rest != "recipe" and not set(rest.split()) & set(found.record.channels),
            "kinds": lambda rest=rest: kinds == set(rest.split(", ")),
            "flies": lambda rest=rest: flown,
            "stands": lambda rest=rest: not flown,
            "vehicle": lambda rest=rest: found.log.vehicle == rest,
            "manoeuvres": lambda rest=rest: len(found.search.manoeuvres) == int(rest),
            "cuts": lambda rest=rest: usable == int(rest),
            "recipe": lambda rest=rest: bool(found.members),
            "no": lambda rest=rest: not found.members,
            "quiet": lambda rest=rest: not found.asked,
            "asked": lambda rest=rest: re.search(rest, " ".join(found.asked)),
            "said": lambda rest=rest: re.search(rest, text),
            "refused": lambda rest=rest: False,
        }[verb]()
        wrong += [] if right else [f"{verb} {rest}".strip()]
    first = f"; asked: {found.asked[0]}" if found.asked else ""
    came = (
        f"{found.log.vehicle + ', ' if found.log.vehicle else ''}{', '.join(sorted(kinds))}; "
        f"{len(found.search.manoeuvres)} manoeuvres, {usable} cut; {' '.join(found.record.channels)}{first}"
    )
    return came, wrong


CASES: Mapping[str, str] = {
    "bin_elevons/elevon.bin": "channels de_cmd da_cmd q az; cuts 1; flies",
    "bin_first_imu_dead/imu.bin": "channels p q ax az de_cmd; said IMU#1; cuts 1",
    "csv_command_named_surface/input.csv": "channels de q alpha; said A command|a command; cuts 2",
    "csv_crash_unit_in_header/input.csv": "kinds cruise, crash; asked damaged, or not flight; not thr",
    "csv_mavlogdump/input.csv": "channels p q r ax ay az",
    "csv_of_jsbsim/out.csv": "channels de q qdot V qbar alpha; cuts 1",
    "csv_parked/input.csv": "stands; channels Vg; kinds parked, control check; no recipe; said does not answer",
    "csv_ros_quaternion/input.csv": "channels phi theta psi p q r ax ay az; not w",
    "csv_semicolon_decimal_comma/eu.csv": "channels de q; cuts 1; quiet",
    "csv_timestamp_in_us/us.csv": "channels de q; cuts 1; said us, which makes 50 Hz",
    "csv_ulog2csv/vehicle_attitude_0.csv": "channels phi theta psi",
    "csv_ulog2csv": "channels phi theta psi p q r",
    "log_angle_brackets/input.log": "channels phi theta p q r V ax ay az de",
    "mat_second_rate/rates.mat": "channels de q alpha; cuts 1",
    "mat_structures/a.mat": "channels q",
    "mat_structures/b.mat": "channels de q; cuts 1",
    "mat_structures/c.mat": "refused y\\[1\\], y\\[2\\].*--describe",
    "netcdf_datetime/dt.nc": "channels de q; cuts 1",
    "text_header_with_units/u.txt": "channels de q; cuts 1; quiet",
    "txt_xplane/input.txt": "channels de de_cmd q alpha V h az; cuts 1",
    "ulog_two_step_clock/even.ulg": "channels q de_cmd; cuts 1; quiet",
    "ulog_two_step_clock/two_step.ulg": "channels q de_cmd; cuts 1; quiet",
    "hostile/gzip.nc": "refused ",
    "hostile/sparse.nc": "refused ",
    "hostile/flip_unit.mat": "channels q",
    "hostile/bomb.mat": "refused ",
    "science3/clean.csv": "channels de q V alpha theta az; quiet; recipe",
    "science3/lever.csv": "channels de q V theta az; quiet; recipe",
}
"""Inputs that failed once, and what is right of them; by the READMEs beside them."""
_BLACKBOX = b"H Product:Blackbox flight data recorder by Nicholas Sherlock\nH Data version:2\n"
FOREIGN: Mapping[str, tuple[bytes, str]] = {
    "flight.bbl": (_BLACKBOX, "must hold 4 whole frames"),
    "LOG00001.TXT": (_BLACKBOX, "must hold 4 whole frames"),
    "flight.mcap": (b"\x89MCAP0\r\n\x01" + bytes(40), "damaged"),
    "flight.bag": (b"#ROSBAG V2.0\n" + bytes(60), "damaged"),
    "flight.db3": (b"SQLite format 3\x00" + bytes(60), "damaged"),
    "flight.tlog": (b"\x00\x05\xd0\x11\x22\x33\x44\x55\xfd\x1c\x00\x00" + bytes(60), "heartbeat of a vehicle"),
    "flight.igc": (b"AXXX001\r\nHFDTE040524\r\nB0912014807000N01130000EA0035000360\r\n" * 3, "IGC"),
    "flight.gpx": (b'<?xml version="1.0"?>\n<gpx version="1.1"><trk></trk></gpx>\n', "XML|GPX"),
    "flight.nmea": (b"$GPRMC,091201.00,A,4807.000,N,01130.000,E,10.0,90.0,040524,,*00\r\n" * 3, "NMEA"),
    "flight.xlsx": (b"PK\x03\x04" + bytes(26) + b"[Content_Types].xml xl/workbook.xml", "Excel"),
    "flight.json": (b'{"time": [0, 1], "q": [0.1, 0.2]}', "JSON"),
    "flight.ubx": (b"\xb5b\x01\x07\x5c\x00" + bytes(96), "u-blox|UBX"),
    "flight.fit": (b"\x0e\x10\xd9\x07\x00\x00\x00\x00.FIT" + bytes(40), "FIT"),
}
"""Files of formats that are not read, or of which only the head is left: first bytes, what the refusal must name."""


def written_rows(f: Flight, folder: Path) -> Iterator[dict[str, str]]:
    """Yield a row per writer, and per format that is not read."""
    jobs = [(w.name, lambda at, w=w: write(w, f, at), w.wanted, w.vehicle) for w in WRITERS]
    jobs += [(name, lambda at, make=make: make(f, at), wanted, "") for name, make, wanted in OTHERS]
    for name, make, wanted, vehicle in sized(jobs, jobs[:2]):
        place = folder / re.sub(r"\W+", "_", name)
        place.mkdir()
        path = make(place)
        said = f"channels {wanted}, equal to the truth" + (f"; vehicle {vehicle}" if vehicle else "; flies")
        try:
            found = import_log(path)
            wrong = compared(found, f, wanted.split())
            if wrong and (given := answered(found.asked)):
                found = import_log(path, **given)
                wrong = compared(found, f, wanted.split())
                said += f"; as the questions say: {', '.join(given)}"
        except Refusal as error:
            yield row("written", path.name, name, said, f"refused: {error.message}", ["refused"])
            continue
        flies = any(s.flown or s.kind == "hover" for s in found.stretches)
        wrong += [f"vehicle '{found.log.vehicle}'"] if vehicle and vehicle != found.log.vehicle else []
        wrong += [] if flies else ["nothing flies"]
        yield row("written", path.name, name, said, judged("", lambda found=found: found)[0], wrong)
    for name, (content, words) in sized(list(FOREIGN.items()), []):
        path = folder / name
        path.write_bytes(content)
        yield row(
            "foreign",
            name,
            "first bytes of the format",
            f"refused {words}",
            *judged(f"refused {words}", lambda path=path: import_log(path)),
        )


def row(kind: str, name: str, source: str, wanted: str, came_out: str, wrong: Sequence[str]) -> dict[str, str]:
    """Return a row of the table; the folder of the machine is left out of what the program said."""
    came_out = re.sub(r"'(?:/[^/']+)+/", "'", came_out)
    return dict(zip(COLUMNS, (kind, name, source, wanted, came_out, "; ".join(wrong) or "yes"), strict=True))


def case_rows() -> Iterator[dict[str, str]]:
    """Yield a row per input that failed once; none where they are absent."""
    held = {path.relative_to(path.parents[1]).as_posix(): path for path in shared("cases")}
    held |= {path.parent.name: path.parent for path in shared("cases")}
    for name, wanted in sized(list(CASES.items()), []):
        if name in held:
            yield row(
                "case",
                name,
                "inputs that failed once",
                wanted,
                *judged(wanted, lambda name=name: import_log(held[name])),
            )


def public_rows(folder: Path) -> Iterator[dict[str, str]]:
    """Yield a row per public log: of one that does not lie in the folder as it was."""
    before = {r["input"]: r for r in read_rows(TABLE) if r["kind"] == "public"}
    for each in read_rows(PUBLIC):
        path, wanted = folder / each["file"], each["wanted"]
        if path.exists():
            look = partial(import_log, path)
            yield row("public", each["file"], each["source"], wanted, *judged(wanted, look))
        elif each["file"] in before:
            yield before[each["file"]]


def main(argv: Sequence[str]) -> None:
    with TemporaryDirectory() as scratch:
        rows = [*written_rows(flight(), Path(scratch)), *case_rows()]
    if argv:
        rows += public_rows(Path(argv[0]))
    else:  # public logs as they were when the folder was at hand
        rows += [r for r in read_rows(TABLE) if r["kind"] == "public"]
    write_rows(TABLE, COLUMNS, rows)
    right = sum(r["right"] == "yes" for r in rows)
    print(f"{right} of {len(rows)} right ({100.0 * right / len(rows):.0f} %)")
    for r in rows:
        if r["right"] != "yes":
            print(f"  {r['kind']} {r['input']} ({r['source']}): {r['right']}; {r['came_out'][:200]}")


if __name__ == "__main__":
    main(sys.argv[1:])
