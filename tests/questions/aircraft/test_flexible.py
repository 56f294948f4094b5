"""The command ``testbench aircraft flexible``: known answers back, what comes out flies, what is said of bad files."""

import importlib.util
import re
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from commands import command, ends

from testbench.aircraft.model import MassProperties
from testbench.aircraft.strips.fit import fit_strips, helmbold
from testbench.aircraft.strips.flexible import make_flexible
from testbench.aircraft.strips.ground_test import read_ground_test
from testbench.aircraft.strips.loads import Shape
from testbench.core.constants import DEG_RAD
from testbench.core.paths import AIRCRAFT_MODELS, SCENARIOS
from testbench.flight import FlightCondition, linearise, load_aircraft, trim
from testbench.flight.batch.jobs import Job
from testbench.flight.executive import Executive
from testbench.flight.simulate import Manoeuvre
from testbench.inputs import InputSignal
from testbench.line import fly_and_measure
from testbench.questions.aircraft.contract import aircraft_laws
from testbench.questions.aircraft.flexible import add_ground_test
from testbench.questions.aircraft.flexible.ask import own_derivatives

EXAMPLES = SCENARIOS / "ground_tests"
PLAN_FORM = """
[wing]
span_m = 4.0
root_chord_m = {root!r}
tip_chord_m = {tip!r}
x_m = 0.022
[tail]
span_m = 0.5
root_chord_m = 0.1412
tip_chord_m = 0.0988
x_m = -1.05
[fin]
span_m = 0.25
root_chord_m = 0.30
tip_chord_m = 0.18
x_m = -1.05
[strips]
own_derivatives = false
elastic_axis = 0.35
lift_slope_1_rad = 5.65
tail_lift_slope_1_rad = 3.3
fin_lift_slope_1_rad = 2.8
downwash = 0.35
elevator_effectiveness = 0.55
rudder_effectiveness = 0.5
fin_height_m = 0.08
dihedral_deg = 4.0
CL = 0.69
zero_lift_deg = {zero!r}
aileron = {{ inner_m = 1.2, outer_m = 1.9, effectiveness = 0.4 }}
"""
MASS = """
[mass]
evidence = "assumed"
wing_kg = 3.0
centre_of_mass = 0.42
gyration = 0.27
tail_kg = 0.35
tail_roll_inertia_kg_m2 = 0.006
tail_mass_height_m = 0.036
"""
HEAD = 'source = "eolo"\nevidence = "computed"\nnormalisation = "given"\n'


def script(path: Path) -> ModuleType:
    """Import a script by its path."""
    spec = importlib.util.spec_from_file_location(f"script_{path.parent.name}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def rigid_eolo(folder: Path) -> Path:
    """Write eolo without its modes and wing stations; return its folder."""
    out = folder / "aircraft" / "stiff"
    shutil.copytree(AIRCRAFT_MODELS / "eolo", out)
    path = out / "aircraft.toml"
    text = re.split(r"^\[elastic\]$", path.read_text(encoding="utf-8"), flags=re.MULTILINE)[0]
    text = re.sub(r"^wing_station = \[.*?^\]\n", "", text, flags=re.MULTILINE | re.DOTALL)
    path.write_text(re.sub(r"^eta = .*\n", "", text, flags=re.MULTILINE), encoding="utf-8")
    return out


def entry(mode: tuple[str, float, float], shape: Shape, mass: float | None, rows: str) -> str:
    """Return one [[mode]] of a file."""
    name, f_hz, zeta = mode
    text = f'[[mode]]\nname = "{name}"\nf_hz = {f_hz}\nzeta = {zeta}\n'
    text += f'symmetry = "{"symmetric" if shape.symmetric else "asymmetric"}"\n' + rows
    text += "" if mass is None else f"mass_kg_m2 = {mass!r}\n"
    keys = ("up", "pitch") if shape.symmetric else ("side", "roll", "yaw")
    for key in keys:
        unit = "m" if key in ("up", "side") else "rad"
        text += f"tail_{key}_{unit} = {float(getattr(shape, f'tail_{key}'))!r}\n"
    return text


def eolo_test(folder: Path, derive: ModuleType, masses: bool = True) -> Path:
    """Write eolo's own modes at its strips, one CSV file per mode, with all that its strips are made of."""
    shapes, generalised, _ = derive.modes()
    text = HEAD
    for i, (row, shape, mass) in enumerate(zip(derive.GROUND_TEST, shapes, generalised, strict=True), 1):
        columns = np.column_stack([derive.WING.y, shape.bend, shape.twist, shape.curvature])
        lines = [",".join(repr(float(v)) for v in line) for line in columns]
        (folder / f"mode_{i}.csv").write_text(
            "\n".join(["y_m,bend_m,twist_rad,curvature_1_m", *lines]) + "\n", encoding="utf-8"
        )
        rows = f'csv = "mode_{i}.csv"\nunit = "given"\n'
        text += entry((row[2], row[3], row[4]), shape, mass if masses else None, rows)
    root = derive.WING.root_chord_m
    text += PLAN_FORM.format(root=root, tip=root * derive.TAPER, zero=float(np.degrees(0.30 / 5.65)))
    path = folder / "eolo_modes.toml"
    path.write_text(text + ("" if masses else MASS), encoding="utf-8")
    return path


GUIDE = Path(__file__).resolve().parents[3] / "docs" / "guides" / "flexible_aircraft.md"


@pytest.fixture(scope="module")
def derive():
    return script(AIRCRAFT_MODELS / "eolo" / "derive.py")


@pytest.fixture(scope="module")
def stiff(tmp_path_factory):
    return rigid_eolo(tmp_path_factory.mktemp("stiff"))


@pytest.fixture(scope="module")
def soft(tmp_path_factory):
    """Taurus with the modes of the example."""
    out = tmp_path_factory.mktemp("soft") / "aircraft" / "soft"
    return add_ground_test("taurus", EXAMPLES / "taurus.toml", out)


def test_eolos_own_modes_give_back_the_coefficients_that_its_file_holds(derive, stiff, tmp_path):
    """To the last digit: every force, effect, mass, shape and station of aircraft.toml."""
    test = read_ground_test(eolo_test(tmp_path, derive))
    made = make_flexible(load_aircraft(stiff), test, {})
    text = made.aircraft.elastic.toml(lambda value: f"{value:.5g}")
    held = (AIRCRAFT_MODELS / "eolo" / "aircraft.toml").read_text(encoding="utf-8")
    assert numbers(tomllib.loads(text)) == numbers({"elastic": tomllib.loads(held)["elastic"]})


def numbers(value):
    """A file's content with numbers of 5 digits, and with what is nothing (1e-9 of a coefficient) as 0."""
    if isinstance(value, dict):
        return {k: numbers(v) for k, v in value.items()}
    if isinstance(value, list):
        return [numbers(v) for v in value]
    return 0.0 if isinstance(value, (int, float)) and abs(value) < 1e-7 else value


def test_eolos_generalised_masses_follow_from_where_its_mass_sits(derive, stiff, tmp_path):
    """Without masses in the file: shapes and a distribution of mass, the fuselage moved by momentum."""
    _, masses, _ = derive.modes()
    whole = MassProperties(derive.mass, derive.Ixx, derive.Iyy, 3.96, 0.0)  # as published; JSBSim's slug is 1e-4 off
    aircraft = replace(load_aircraft(stiff), mass=whole)
    made = make_flexible(aircraft, read_ground_test(eolo_test(tmp_path, derive, masses=False)), {})
    assert [m.mass_kg_m2 for m in made.aircraft.elastic.modes] == pytest.approx(masses, rel=1e-6)
    assert {o.mass for o in made.origins} == {"from the distribution of mass, which is assumed"}


@pytest.mark.slow
def test_a_ground_test_at_nine_stations_gives_eolos_flutter_within_half_a_m_s(derive, stiff, tmp_path):
    """As it would be brought: few stations and digits, the drawing's plan form, the aircraft's own derivatives."""
    shapes, masses, _ = derive.modes()
    y = np.linspace(0.0, 2.0, 9)
    text = f"{HEAD}stations_m = {y.tolist()}\n"
    for row, shape, mass in zip(derive.GROUND_TEST, shapes, masses, strict=True):
        at = {key: np.interp(y, derive.WING.y, v) for key, v in (("bend_m", shape.bend), ("twist_rad", shape.twist))}
        at = {key: np.where(y == 0.0, v if shape.symmetric else 0.0, v) for key, v in at.items()}
        lists = "".join(f"{key} = [{', '.join(f'{x:.3g}' for x in v)}]\n" for key, v in at.items())
        text += entry((row[2], row[3], row[4]), shape, float(f"{mass:.3g}"), lists)
    path = tmp_path / "modes.toml"
    path.write_text(text, encoding="utf-8")
    found = add_ground_test(stiff, path, tmp_path / "soft")
    onsets = [found.survey.envelope.onset(n) for n in found.survey.envelope.elastic]
    first = min((o for o in onsets if o.V_m_s is not None), key=lambda o: o.V_m_s)
    assert first.V_m_s == pytest.approx(20.3, abs=0.5)
    assert first.name.startswith("1st symmetric wing torsion")
    made, eolo = found.made.strips, derive.MODEL.wing.lift_slope
    assert made.symmetric.wing.lift_slope == pytest.approx(eolo, rel=0.02)
    assert made.asymmetric.wing.lift_slope == pytest.approx(eolo, rel=0.02)


@pytest.mark.parametrize("name", ["taurus", "eolo"])
def test_strips_give_the_aircrafts_own_derivatives(name):
    aircraft = load_aircraft(name, "rigid")
    own = own_derivatives(aircraft)
    fitted = fit_strips(aircraft, read_ground_test(EXAMPLES / "taurus.toml").content, own)
    matched = {"CL_alpha", "CL_0", "Cm_de", "Cl_p", "Cl_beta", "Cl_da", "Cn_dr"}
    by_strips = {c.name: c.strips for c in fitted.compared}
    for derivative in matched:
        assert by_strips[derivative] == pytest.approx(own[derivative], rel=1e-9)
        assert own[derivative] == pytest.approx(aircraft.coefficient(derivative.replace("_0", "0")), rel=1e-4)
    assert sum(c.source.startswith("the aircraft's own") for c in fitted.constants) == len(matched)


def test_without_derivatives_the_slopes_are_helmbolds():
    """Slender wings: pi A / 2; wide ones: 2 pi."""
    assert helmbold(1e-4) == pytest.approx(0.5e-4 * np.pi, rel=1e-3)
    assert helmbold(1e6) == pytest.approx(2.0 * np.pi, rel=1e-5)
    assert helmbold(18.91) == pytest.approx(5.65, abs=5e-3)  # SOURCES.md of eolo
    fitted = fit_strips(load_aircraft("taurus"), read_ground_test(EXAMPLES / "taurus.toml").content, {})
    ratio = 1.27 / 0.221
    assert fitted.symmetric.wing.lift_slope == fitted.asymmetric.wing.lift_slope == pytest.approx(helmbold(ratio))


# --- what comes out flies ---------------------------------------------------------------------------------------------


def test_the_file_holds_the_modes_that_were_made_and_says_where_they_come_from(soft):
    loaded = load_aircraft(soft.folder)
    for read, made in zip(loaded.elastic.modes, soft.made.aircraft.elastic.modes, strict=True):
        assert (read.name, read.f_hz, read.zeta, read.symmetry) == (made.name, made.f_hz, made.zeta, made.symmetry)
        for table in ("force", "force_eta", "force_etadot", "effect_eta", "effect_etadot"):
            assert getattr(read, table) == pytest.approx(getattr(made, table), rel=1e-4)
        assert read.shape.bend_m == pytest.approx(made.shape.bend_m, rel=1e-4)
    assert loaded.wing_stations == soft.made.aircraft.wing_stations
    assert loaded.rate_hz == 400.0
    assert loaded.limits["eta"] == (-3.0, 3.0)
    text = (soft.folder / "aircraft.toml").read_text(encoding="utf-8")
    rigid = (AIRCRAFT_MODELS / "taurus" / "aircraft.toml").read_text(encoding="utf-8")
    kept = [line for line in rigid.splitlines() if line.startswith("#")]
    assert [line for line in kept if line not in text] == []
    for said in ("the aircraft's own CL_alpha", "Helmbold's formula", "assumed: 60 % of the half span", "derive.py"):
        assert said in " ".join(text.replace("\n# ", " ").replace("\n#  ", " ").split())
    assert (soft.folder / "ground_test" / "taurus_shapes.csv").is_file()


def test_the_flexible_aircraft_keeps_the_laws_of_aircraft_and_flutters_where_its_poles_say(soft):
    loaded = load_aircraft(soft.folder)
    assert [law.sentence for law in aircraft_laws(loaded) if not law.holds] == []
    onset = next(o for o in map(soft.survey.envelope.onset, soft.survey.envelope.elastic) if o.V_m_s is not None)
    assert (onset.name, onset.kind) == ("1st wing torsion", "flutter")
    for V, grows in ((onset.V_m_s - 0.5, False), (onset.V_m_s + 0.5, True)):
        poles = linearise(loaded, trim(loaded, FlightCondition(V, loaded.design_h_m))).poles()
        assert (np.max(poles[poles.imag > 30.0].real) > 0.0) == grows
        trimmed = trim(loaded, FlightCondition(V, loaded.design_h_m))
        t = np.arange(round(2.0 * loaded.rate_hz)) / loaded.rate_hz
        u = np.where((t > 0.1) & (t < 0.13), 1.0 * DEG_RAD, 0.0)[:, None]
        signal = InputSignal(t, u, ("de",))
        flown = fly_and_measure(Job(loaded, trimmed, Manoeuvre("pulse", signal, 0.0), loaded.rate_hz)).flown
        eta = np.abs(np.diff(flown["eta_2"]))
        late, early = (eta[round(a * 400.0) : round((a + 0.4) * 400.0)].max() for a in (1.5, 0.5))
        assert (late > early) == grows


def test_wings_have_accelerometers_and_strain_gauges_that_feel_the_modes(soft):
    loaded = load_aircraft(soft.folder)
    trimmed = trim(loaded, FlightCondition(12.0, 100.0))
    t = np.arange(400) / 400.0
    u = np.where(t > 0.2, 1.0 * DEG_RAD, 0.0)[:, None]
    step = Manoeuvre("step", InputSignal(t, u, ("de",)), 0.0)
    flown = fly_and_measure(Job(loaded, trimmed, step, 400.0)).flown
    tip, root = flown["az_wing_11"], flown["az_wing_6"]
    assert np.std(tip - flown["az"]) > 3.0 * np.std(root - flown["az"]) > 0.0
    assert np.ptp(flown["strain_wing_6"]) > np.ptp(flown["strain_wing_11"])


def test_in_air_that_is_almost_none_the_modes_ring_as_on_the_ground(soft):
    """At 60 km the air has 1/4000 of its density; falling for 0.4 s, a mode feels nothing of it."""
    loaded = load_aircraft(soft.folder)
    fdm = Executive(loaded, loaded.rate_hz, FlightCondition(0.5, 100.0))
    fdm.place(60000.0, 0.0, 0.0, (0.5, 0.0, 0.0))
    fdm.set("modal/static-ic", 0.0)
    for i in (1, 2):
        fdm.set(f"modal/eta-{i}", 0.01)
    fdm.evaluate()
    nodes = [fdm.node(f"modal/{kind}-{i}") for kind in ("eta", "etadot") for i in (1, 2)]
    rows = []
    for _ in range(round(0.4 * loaded.rate_hz)):
        fdm.fdm.run()
        rows.append([n.get_double_value() for n in nodes])
    x = np.array(rows)
    step = np.linalg.lstsq(x[:-1], x[1:], rcond=None)[0]
    s = np.log(np.linalg.eigvals(step).astype(complex)) * loaded.rate_hz
    s = np.sort_complex(s[s.imag > 0.0])
    s = s[np.argsort(np.abs(s))]
    assert np.abs(s) / (2.0 * np.pi) == pytest.approx([9.0, 20.0], rel=1e-3)
    assert -s.real / np.abs(s) == pytest.approx([0.02, 0.02], rel=2e-2)


@pytest.mark.slow
def test_a_sailplane_that_comes_with_jsbsim_gets_a_wing_that_bends(tmp_path):
    done = command(
        "aircraft", "flexible", "jsbsim:SGS", EXAMPLES / "sailplane.toml", "-o", "aircraft/soft", cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert "No elastic mode becomes unstable up to" in done.stdout
    loaded = load_aircraft(tmp_path / "aircraft" / "soft")
    assert [(m.name, m.f_hz) for m in loaded.elastic.modes] == [("1st wing bending", 3.0)]
    rigid = load_aircraft("jsbsim:SGS")
    condition = FlightCondition(rigid.design_V_m_s, rigid.design_h_m)
    bent, straight = trim(loaded, condition), trim(rigid, condition)
    assert 0.05 < bent.state["eta_1"] < 2.0  # chords of one metre at the tip, up
    assert bent.alpha != straight.alpha
    again = command(
        "aircraft", "flexible", "jsbsim:SGS", EXAMPLES / "sailplane.toml", "-o", "aircraft/soft", cwd=tmp_path
    )
    assert again.returncode == 0, again.stderr  # what the command made it may make again
    shown = command("aircraft", "aircraft/soft", cwd=tmp_path)
    assert shown.returncode == 0, shown.stderr


@pytest.mark.parametrize("name", ["taurus", "jsbsim:SGS"])
def test_every_coefficient_of_a_mode_acts_in_the_model_that_flies(name, tmp_path):
    """Modal accelerations of JSBSim by differences, against the coefficients, on a model of ours and a foreign one."""
    text = (EXAMPLES / "sailplane.toml").read_text(encoding="utf-8")
    (tmp_path / "sailplane_shapes.csv").write_bytes((EXAMPLES / "sailplane_shapes.csv").read_bytes())
    text = text.replace('symmetry = "symmetric"', 'symmetry = "symmetric"\ntail_up_m = 0.1\ntail_pitch_rad = -0.04')
    second = text[text.index("[[mode]]") : text.index("[wing]")].replace("f_hz = 3.0", "f_hz = 6.0")
    second = second.replace("symmetric", "asymmetric").replace(
        "tail_up_m = 0.1", "tail_side_m = 0.1\ntail_yaw_rad = 0.05"
    )
    second = second.replace("tail_pitch_rad = -0.04", "tail_roll_rad = 0.2\nbend_m = [0.0, 0.1, 0.4, 1.0]")
    text = text.replace("[wing]", f"{second}\n[wing]", 1).replace(
        'shapes = "s', 'stations_m = [0, 0.2, 0.4, 0.6]\nshapes = "s'
    )
    if name == "taurus":  # its own plan form and masses
        text = text[: text.index("[wing]")] + "[mass]" + GOOD[GOOD.index("\n[mass]") + len("\n[mass]") :]
        text = text.replace('shapes = "sailplane_shapes.csv"\n', "").replace(
            'symmetry = "symmetric"', 'symmetry = "symmetric"\nbend_m = [0.0, 0.1, 0.4, 1.0]'
        )
    path = tmp_path / "modes.toml"
    path.write_text(text, encoding="utf-8")
    rigid = load_aircraft(name)
    made = make_flexible(rigid, read_ground_test(path), own_derivatives(rigid)).aircraft
    trimmed = trim(made, FlightCondition(made.design_V_m_s, made.design_h_m))
    model = linearise(made, trimmed)
    g, V, qbar = made.geometry, trimmed.condition.V_m_s, trimmed.state["qbar"]
    row = {s: k for k, s in enumerate(model.states)}
    for i, mode in enumerate(made.elastic.modes, 1):
        gain = qbar * g.S_m2 * g.cbar_m / mode.mass_kg_m2
        A = model.A[row[f"etadot_{i}"]]
        for control in ("de", "da", "dr"):
            exact = gain * mode.force.get(control, 0.0)
            assert model.B[row[f"etadot_{i}"], model.inputs.index(control)] == pytest.approx(exact, rel=1e-4, abs=1e-4)
        for rate, length in (("p", g.b_m), ("q", g.cbar_m), ("r", g.b_m)):
            exact = gain * mode.force.get(rate, 0.0) * length / (2.0 * V)
            assert A[row[rate]] == pytest.approx(exact, rel=1e-4, abs=1e-4)
        assert A[row["v"]] * V == pytest.approx(gain * mode.force.get("beta", 0.0), rel=1e-4, abs=1e-4)
        assert A[row[f"eta_{i}"]] == pytest.approx(gain * mode.force_eta[i] - mode.omega_rad_s**2, rel=1e-4)
    assert made.elastic.modes[0].force["de"] != 0.0
    assert all(made.elastic.modes[1].force[n] != 0.0 for n in ("da", "dr", "beta", "p", "r"))


@pytest.mark.slow
def test_the_ground_test_of_the_guide_flies_and_is_found_again_from_an_empty_folder(tmp_path):
    text = GUIDE.read_text(encoding="utf-8")
    for name, content in re.findall(r"^```\w+\n# (\S+)\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL):
        (tmp_path / name).write_text(content, encoding="utf-8")
    lines = re.search(r"^```sh\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)[1].splitlines()
    assert len(lines) == 4
    for line in lines:
        done = command(*line.split()[1:], cwd=tmp_path)
        assert done.returncode == 0, done.stderr + done.stdout
    for mode in ("1st wing bending", "1st wing torsion"):
        found = re.search(rf"{mode}: the linear model .*? the MAC of the shapes is (\S+)\.", done.stdout)
        assert float(found[1]) > 0.99
    assert (tmp_path / "results" / "aircraft_soft" / "figures" / "mode_shapes.png").is_file()


def test_the_examples_hold_what_their_script_derives():
    for path, text in script(EXAMPLES / "derive.py").files().items():
        assert path.read_text(encoding="utf-8") == text, "run scenarios/ground_tests/derive.py --write"


# --- bad files --------------------------------------------------------------------------------------------------------

GOOD = (
    HEAD
    + "stations_m = [0.0, 0.2, 0.4, 0.6]\n"
    + '[[mode]]\nname = "bending"\nf_hz = 9.0\nzeta = 0.02\nsymmetry = "symmetric"\n'
    + "bend_m = [0.0, 0.1, 0.4, 1.0]\n"
    + '[[mode]]\nname = "torsion"\nf_hz = 20.0\nzeta = 0.02\nsymmetry = "symmetric"\n'
    + "twist_rad = [0.0, 0.4, 0.8, 1.0]\n"
    + MASS.replace("3.0", "0.36").replace("0.35", "0.08").replace("0.006", "0.0")
)
FAULTS = {
    "a shape of another length": ("[0.0, 0.1, 0.4, 1.0]", "[0.0, 0.1, 1.0]", "mode[0].bend_m", "got 3 for 4"),
    "stations that fall": ("0.2, 0.4, 0.6]", "0.4, 0.3, 0.6]", "stations_m", "must rise"),
    "a station beyond the tip": ("0.4, 0.6]", "0.4, 0.8]", "stations_m", "the half span, must hold, got 0.8 m"),
    "negative damping": ("zeta = 0.02", "zeta = -0.02", "mode[0].zeta", "greater than 0"),
    "frequencies that fall": ("f_hz = 20.0", "f_hz = 8.0", "mode[1].f_hz", "8 Hz after 9 Hz; put the modes in order"),
    "a frequency twice": ("f_hz = 20.0", "f_hz = 9.0", "mode[1].f_hz", "give each mode once"),
    "an unknown symmetry": ('symmetry = "symmetric"', 'symmetry = "odd"', "mode[0].symmetry", "must be one of"),
    "an unknown key": ("f_hz = 20.0", "f_hz = 20.0\nmass_kg = 1.0", "mode[1].mass_kg", "did you mean 'mass_kg_m2'"),
    "no mass": (GOOD[GOOD.index("\n[mass]") :], "", "mode[0].mass_kg_m2", "is required"),
    "a mass beside mass-normalised shapes": (
        'normalisation = "given"', 'normalisation = "mass"', "mode[0].mass_kg_m2", "1 kg m2"
    ),
    "a tail that cannot move so": ("twist_rad", "tail_roll_rad = 0.1\ntwist_rad", "mode[1].tail_roll_rad", "must be 0"),
    "an asymmetric shape that heaves": (
        'symmetry = "symmetric"\nbend_m = [0.0', 'symmetry = "asymmetric"\nbend_m = [0.5', "mode[0].bend_m", "at y = 0"
    ),
    "nothing that moves": ("[0.0, 0.1, 0.4, 1.0]", "[0.0, 0.0, 0.0, 0.0]", "mode[0]", "something must move"),
    "no shape": ("bend_m = [0.0, 0.1, 0.4, 1.0]\n", "", "mode[0]", "a shape along the wing is required"),
    "a wing as heavy as the aircraft": ("wing_kg = 0.36", "wing_kg = 1.9", "mass.wing_kg", "1.8 kg"),
    "too much inertia": ("tail_kg = 0.08", "tail_kg = 0.6", "mass.wing_kg", "Iyy = 0.07"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_faulty_file_is_told_in_one_message_with_file_and_key(fault, tmp_path, monkeypatch, capsys):
    before, after, key, said = FAULTS[fault]
    path = tmp_path / "modes.toml"
    assert before in GOOD
    text = GOOD.replace(before, after, 1)
    if fault == "a mass beside mass-normalised shapes":
        text = text.replace("f_hz = 9.0", "f_hz = 9.0\nmass_kg_m2 = 1.0")
    if fault == "no mass":
        text = text.replace("f_hz = 20.0", "f_hz = 20.0\nmass_kg_m2 = 1.0")
    path.write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    status, lines = ends(monkeypatch, capsys, "aircraft", "flexible", "taurus", path)
    assert status == 2
    assert len(lines) == 1, lines
    assert f"{path}, {key}: " in lines[0]
    assert said in lines[0]
    assert not (tmp_path / "aircraft").exists()


CSV = "y_m,bend_m_1,twist_rad_2\n0,0,0\n0.2,0.1,0.4\n0.4,0.4,0.8\n0.6,1,1\n"
IN_CSV = re.sub(r"^(bend_m|twist_rad|stations_m) = .*\n", "", GOOD, flags=re.MULTILINE).replace(
    HEAD, f'{HEAD}shapes = "shapes.csv"\n'
)
CSV_FAULTS = {
    "a hole": ("0.4,0.4,0.8", "0.4,,0.8", "row 4, bend_m_1", "must be a number, got nothing"),
    "no number": ("0.4,0.4,0.8", "0.4,0.4,nan", "row 4, twist_rad_2", "got 'nan'"),
    "a short row": ("0.4,0.4,0.8", "0.4,0.4", "row 4", "must have 3 values, got 2"),
    "an unknown column": ("twist_rad_2", "twist_deg_2", "column twist_deg_2", "did you mean 'twist_rad_2'"),
    "no stations": ("y_m", "x_m", "first row", "y_m among them"),
}


@pytest.mark.parametrize("fault", CSV_FAULTS)
def test_a_faulty_csv_file_is_told_with_its_row(fault, tmp_path, monkeypatch, capsys):
    before, after, key, said = CSV_FAULTS[fault]
    (tmp_path / "modes.toml").write_text(IN_CSV, encoding="utf-8")
    (tmp_path / "shapes.csv").write_text(CSV.replace(before, after), encoding="utf-8")
    status, lines = ends(
        monkeypatch, capsys, "aircraft", "flexible", "taurus", tmp_path / "modes.toml", "-o", tmp_path / "o"
    )
    assert status == 2
    assert f"{tmp_path / 'shapes.csv'}, {key}: " in " ".join(lines)
    assert said in " ".join(lines)


def test_check_tells_modes_that_are_alike_and_passes_the_examples(derive, tmp_path, monkeypatch, capsys):
    (tmp_path / "alike.toml").write_text(GOOD.replace("twist_rad = [0.0, 0.4", "bend_m = [0.0, 0.15"), encoding="utf-8")
    status, lines = ends(monkeypatch, capsys, "check", tmp_path / "alike.toml")
    assert status == 2
    assert "'bending' and 'torsion' have different shapes" in lines[0]
    eolo = eolo_test(tmp_path, derive)
    status, lines = ends(monkeypatch, capsys, "check", eolo, "ground_tests/taurus", "ground_tests/sailplane")
    assert (status, lines) == (0, [])


def test_files_that_are_missing_are_told_with_the_key_that_names_them(tmp_path, monkeypatch, capsys):
    (tmp_path / "modes.toml").write_text(IN_CSV, encoding="utf-8")
    status, lines = ends(monkeypatch, capsys, "aircraft", "flexible", "taurus", tmp_path / "modes.toml")
    assert status == 2
    assert len(lines) == 1
    assert f"'{tmp_path / 'shapes.csv'}', got: No such file" in lines[0]
    assert f"({tmp_path / 'modes.toml'}, shapes)" in lines[0]
    (tmp_path / "modes.toml").write_text(GOOD, encoding="utf-8")
    status, lines = ends(monkeypatch, capsys, "aircraft", "flexible", "jsbsim:c172p", tmp_path / "modes.toml")
    assert status == 2
    assert "the plan form of the wing must be known" in lines[-1]
    assert f"({tmp_path / 'modes.toml'}, wing)" in lines[-1]


def test_one_wide_csv_file_and_lists_in_the_toml_are_the_same(tmp_path):
    (tmp_path / "lists.toml").write_text(GOOD, encoding="utf-8")
    (tmp_path / "wide.toml").write_text(IN_CSV, encoding="utf-8")
    (tmp_path / "shapes.csv").write_text(f"# by hand\n{CSV}", encoding="utf-8")
    taurus = load_aircraft("taurus")
    first, second = (make_flexible(taurus, read_ground_test(tmp_path / f"{n}.toml"), {}) for n in ("lists", "wide"))
    assert first.aircraft.elastic == second.aircraft.elastic
    assert [n for n in first.notes if "without twist" in n] == ["bending came without twist: none is assumed"]


def test_mass_normalised_shapes_are_those_of_one_kg_m2(tmp_path):
    """A shape divided by the root of its mass, with normalisation "mass", is the same mode."""
    scale = float(1.0 / np.sqrt(0.02))
    one = GOOD.replace("f_hz = 9.0", "f_hz = 9.0\nmass_kg_m2 = 0.02").replace(
        "f_hz = 20.0", "f_hz = 20.0\nmass_kg_m2 = 0.02"
    )
    other = GOOD.replace('"given"', '"mass"')
    for row in ("0.0, 0.1, 0.4, 1.0", "0.0, 0.4, 0.8, 1.0"):
        other = other.replace(f"[{row}]", str([scale * float(v) for v in row.split(",")]))
    found = []
    for name, text in (("one", one), ("other", other)):
        (tmp_path / f"{name}.toml").write_text(text, encoding="utf-8")
        found.append(make_flexible(load_aircraft("taurus"), read_ground_test(tmp_path / f"{name}.toml"), {}))
    for a, b in zip(*(f.aircraft.elastic.modes for f in found), strict=True):
        assert a.mass_kg_m2 == pytest.approx(b.mass_kg_m2, rel=1e-12)
        assert a.force == pytest.approx(b.force, rel=1e-12)


def test_an_aircraft_that_is_flexible_already_and_a_folder_of_somebody_else_are_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    status, lines = ends(monkeypatch, capsys, "aircraft", "flexible", "eolo", EXAMPLES / "taurus.toml")
    assert status == 2
    assert len(lines) == 1
    assert f"{AIRCRAFT_MODELS / 'eolo' / 'aircraft.toml'}, elastic: " in lines[0]
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "aircraft.toml").write_text("mine", encoding="utf-8")
    status, lines = ends(monkeypatch, capsys, "aircraft", "flexible", "taurus", EXAMPLES / "taurus.toml", "-o", "mine")
    assert status == 2
    assert "no manifest lists 'mine/aircraft.toml'" in lines[0]
    assert [p.read_text() for p in (tmp_path / "mine").iterdir()] == ["mine"]


def test_a_model_without_the_axes_of_the_wind_is_refused(tmp_path):
    from testbench.core.errors import ModelError

    taurus = load_aircraft("taurus")
    body = replace(taurus, xml=taurus.xml.replace('axis name="LIFT"', 'axis name="NORMAL"'))
    with pytest.raises(ModelError, match="has no LIFT"):
        make_flexible(body, read_ground_test(EXAMPLES / "taurus.toml"), {})
