"""Sixty values and files that make no sense, each of which must be refused in one line."""

import os
import re
from collections.abc import Callable
from pathlib import Path

from fuzz.kinds import examples

from testbench.core.paths import SCENARIOS
from testbench.questions.files import load

VALUES: tuple[tuple[str, str, str], ...] = (
    # kind of file, key, value
    ("scenario", "V_m_s", "1e30"),
    ("scenario", "V_m_s", "0.0"),
    ("scenario", "V_m_s", "-16.0"),
    ("scenario", "V_m_s", "nan"),
    ("scenario", "h_m", "1e308"),
    ("scenario", "h_m", "-9000.0"),
    ("scenario", "duration_s", "1e7"),
    ("scenario", "duration_s", "1e308"),
    ("scenario", "duration_s", "0.0"),
    ("scenario", "seed", "-1"),
    ("./taurus_doublet", "log_rate_hz", "1e9"),
    ("scenario", "amplitude_deg", "1e6"),
    ("scenario", "step_s", "1e-12"),
    ("scenario", "suites", '["../../../dev/zero"]'),
    ("scenario", "title", '"a\\u0000b"'),
    ("design/taurus_short_period", "duration_s", "1e308"),
    ("design/taurus_short_period", "duration_s", "36000.0"),
    ("design/taurus_short_period", "deflection_deg", "{ de = 4000.0 }"),
    ("design/taurus_short_period", "load_factor", "[-1e9, 1e9]"),
    ("compare/eolo_alpha", "seeds", "1000000000"),
    ("campaign/taurus_scatter", "runs", "10000000000"),
    ("gap/nothing", "h_m", "1e308"),
    ("gap/slow_servo", "lag_rad_s", "1e12"),
    ("plan/taurus_63", "speeds_m_s", "[1e30]"),
    ("plan/taurus_63", "heights_m", "[1e308]"),
    ("plan/taurus_63", "capacity_Wh", "1e30"),
    ("modes/eolo_turbulence", "turbulence_rms_m_s", "1e9"),
    ("dataset/identification", "scale", "[1e308, 1e308]"),
    ("dataset/identification", "flights", "100000000000"),
    ("suite", "noise_std", "9e18"),
    ("suite", "noise_std", "-1.0"),
    ("suite", "lag_s", "5e4"),
    ("suite", "rate_hz", "1e9"),
    ("suite", "rate_hz", "0.0"),
    ("suite", "part", '""'),
    ("aircraft", "design_V_m_s", "1e30"),
    ("aircraft", "design_h_m", "1e308"),
    ("aircraft", "f_hz", "1e9"),
    ("aircraft", "zeta", "5.0"),
    ("aircraft", "mass_kg_m2", "1e300"),
    ("aircraft", "stations_m", "[0.0, 0.5, 0.25]"),
    ("aircraft", "rate_hz", "1e12"),
    ("aircraft", "full_deflection_deg", "1e9"),
    ("aircraft", "model", '"/dev/zero"'),
    ("geometry", "tip_chord_m", "1e-9"),
    ("geometry", "span_m", "1e9"),
    ("geometry", "mass_kg", "1e30"),
    ("geometry", "sweep_deg", "90.0"),
    ("geometry", "x_m", "1e12"),
    ("geometry", "cg_m", "[1e300, 0.0, 0.0]"),
    ("geometry", "Ixx_kg_m2", "1e300"),
    ("ground test", "f_hz", "1e9"),
    ("ground test", "zeta", "1.0"),
    ("structure", "value", "1e300"),
    ("project", "speeds_m_s", "[1e30]"),
    ("project", "h_m", "1e308"),
    ("masses beside AVL", "mass_kg", "1e30"),
    ("prior", "std", "1e300"),
    ("prior", "percent", "-5.0"),
)
CONTROL = 'command = "\u0130"'


def _set(text: str, key: str, value: str) -> str:
    """Return TOML with another value of the first key of that name, which must be there."""
    number = r"\"[^\"\n]*\"|\[[^\n]*\]|\{[^\n{}]*\}|[^\s,}\]#]+"
    changed, times = re.subn(rf"(?<![\w.]){key} = ({number})", lambda _: f"{key} = {value}", text, count=1)
    assert times == 1, f"{key} is not in the file"
    return changed


def _value(kind: str, key: str, value: str, place: Path) -> Callable[[Path], object]:
    if "/" in kind:
        text = _set((SCENARIOS / f"{kind}.toml").read_text(encoding="utf-8"), key, value)

        def of_question(folder: Path) -> object:
            (folder / "q.toml").write_text(text, encoding="utf-8")
            return load(folder / "q.toml")

        return of_question
    example = examples(place)[kind]
    text = example.content.decode()
    return lambda folder: example.tried(_set(text, key, value).encode(), folder)


def _file(kind: str, make: Callable[[Path], object], place: Path) -> Callable[[Path], object]:
    example = examples(place)[kind]

    def case(folder: Path) -> object:
        make(folder / example.name)
        return example.read(folder / example.name)

    return case


def _huge(path: Path) -> None:
    path.touch()
    os.truncate(path, 10**12)


def cases(place: Path) -> dict[str, Callable[[Path], object]]:
    """Return name -> a case that must be refused, given an empty folder."""
    out = {f"{kind} {key} = {value}": _value(kind, key, value, place) for kind, key, value in VALUES}
    aircraft = examples(place)["aircraft"]
    controls = aircraft.content.decode().replace("[controls.da]", f"[controls.da]\n{CONTROL}", 1)
    assert CONTROL in controls
    out["aircraft controls.da.command = I with a dot"] = lambda folder: aircraft.tried(controls.encode(), folder)
    out["geometry a link to /dev/zero"] = _file("geometry", lambda p: p.symlink_to("/dev/zero"), place)
    out["geometry a pipe"] = _file("geometry", os.mkfifo, place)
    out["model a terabyte"] = _file("model", _huge, place)
    out["JSON without end"] = _file("model", lambda p: p.write_text("[" * 10**6), place)
    out["XML without end"] = _file("JSBSim model", lambda p: p.write_text("<a>" * 10**5), place)
    return out
