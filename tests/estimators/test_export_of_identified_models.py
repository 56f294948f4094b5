"""From the record of each aircraft to its model in other programs: `testbench identify`, then `testbench export`."""

import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from plain_fits import plain_fits
from scipy.io import loadmat

import testbench.cli as cli
from testbench.core.channels import channel
from testbench.core.store import ResultFolder
from testbench.page.page import record_keeper
from testbench.questions.identify import ask
from testbench.questions.identify.ask import identify
from testbench.questions.run.ask import run
from testbench.questions.run.scenario import Scenario

jsbsim = pytest.importorskip("jsbsim")

# suite, airspeed, height, elevator's amplitude (deg) and step (s)
AIRCRAFT = {
    "eolo": ("eolo_alpha", 16.0, 547.0, 2.0, 0.3),
    "taurus": ("eolo_alpha", 12.0, 100.0, 0.5, 0.2),
    "b1": ("b1_alpha", 200.6, 1524.0, 1.0, 0.5),
}
SCENARIO = """title = "{name}"
aircraft = "{name}"
wings = "rigid"
seed = 5
suites = ["{suite}"]
condition = {{ V_m_s = {V}, h_m = {h} }}
simulation = {{ rate_hz = 400.0 }}
[[manoeuvre]]
name = "3211"
use = "identification"
duration_s = 10.0
input = [{{ signal = "3211", control = "de", amplitude_deg = {size}, step_s = {step} }}]
[[manoeuvre]]
name = "doublet"
use = "validation"
duration_s = 6.0
input = [{{ signal = "doublet", control = "de", amplitude_deg = {size}, period_s = 2.0 }}]
[preparation]
bias = "trim"
[identification]
inputs = ["de"]
[[identification.estimators]]
method = "equation_error"
structure = "longitudinal"
"""
DESCRIPTION = """title = "{name}, as recorded"
source = "a simulated flight"
rights = "free"
folder = "records"
trim_s = 0.9
time = {{ column = "t" }}
record = [
  {{ name = "3211", file = "3211_{suite}.nc", use = "identification" }},
  {{ name = "doublet", file = "doublet_{suite}.nc", use = "validation" }},
]
channel = [{channels}]
[preparation]
bias = "trim"
[identification]
inputs = ["de"]
outputs = ["V", "alpha", "q", "theta"]
[[identification.estimators]]
method = "output_error"
structure = "longitudinal"
[[identification.estimators]]
method = "equation_error"
structure = "short_period"
[[identification.estimators]]
method = "transfer_function"
poles = 5
zeros = [4, 4, 4, 4]
"""


@pytest.fixture(scope="module", params=["taurus", *(pytest.param(n, marks=pytest.mark.slow) for n in ("eolo", "b1"))])
def identified(request, tmp_path_factory):
    """Two records of one aircraft, flown in the simulator; then its models, by the command line and by the library."""
    name = request.param
    suite, V, h, size, step = AIRCRAFT[name]
    folder = tmp_path_factory.mktemp(name)
    scenario = folder / "flights.toml"
    scenario.write_text(SCENARIO.format(name=name, suite=suite, V=V, h=h, size=size, step=step), encoding="utf-8")
    with ResultFolder(folder) as place:
        simulated = run(Scenario.load(scenario), None, record_keeper(place), causes=False)
    names = ("de", "V", "alpha", "q", "theta")
    channels = ", ".join(f'{{ name = "{n}", column = "{n}", unit = "{channel(n).unit}" }}' for n in names)
    file = folder / f"{name}_recorded.toml"
    file.write_text(DESCRIPTION.format(name=name, suite=suite, channels=channels), encoding="utf-8")
    found = []

    def kept(*words, **more):
        found.append(identify(*words, **more))
        return found[-1]

    with plain_fits(), pytest.MonkeyPatch.context() as patch:  # remedies and figures take longest
        patch.setattr(ask, "identify", kept)
        patch.setattr("testbench.questions.run.page.plates", lambda result: [])
        assert status(patch, "identify", file, "-o", folder / "results") == 0
    return SimpleNamespace(
        models=folder / "results" / file.stem / "models",
        cases={c.model.method: c.model for c in found[0].cases},
        truth=simulated.truth,
        aircraft=simulated.truth.aircraft,
    )


def status(patch, *words):
    patch.setattr(sys, "argv", ["testbench", *map(str, words)])
    try:
        cli.main()
    except SystemExit as end:
        return end.code or 0
    return 0


@pytest.fixture
def export(identified, monkeypatch, capsys):
    """Export a model of the aircraft and return its file, or the one line of an error and its exit status."""

    def do(method, to):
        capsys.readouterr()
        code = status(monkeypatch, "export", identified.models / f"{method}.json", "--to", to)
        said = capsys.readouterr()
        if code:
            return code, said.err.splitlines()
        return identified.models / said.out.strip().removeprefix("Written: ").rpartition("/")[2]

    return do


def test_matrices_in_json_and_mat_are_those_of_the_model(identified, export):
    model = identified.cases["output_error"]
    linear = model.linear()
    found = json.loads(export("output_error", "json").read_text(encoding="utf-8"))
    mat = loadmat(export("output_error", "mat"), squeeze_me=True)
    for key in "ABCD":
        np.testing.assert_allclose(found[key], getattr(linear, key), rtol=1e-12)
        np.testing.assert_allclose(np.reshape(mat[key], np.shape(found[key])), found[key], rtol=1e-15)
    assert (found["inputs"], found["outputs"]) == (["de"], ["V", "alpha", "q", "theta"])
    assert found["units"] == {"de": "rad", "V": "m/s", "alpha": "rad", "q": "rad/s", "theta": "rad"}
    assert (found["time"], found["dt_s"], found["delays_s"]) == ("continuous", 0.0, [[0.0]] * 4)
    assert list(mat["outputs"]) == found["outputs"]
    # and the model is one of this aircraft: the stiffness of its short period, a pair or two real roots, to a factor of
    # two (one short manoeuvre in noise; how well it is estimated is asked elsewhere)
    true = [abs(pole) for name, pole in identified.truth.modes.items() if name.startswith("short period")]
    fast = sorted(abs(np.linalg.eigvals(np.array(found["A"]))))[-2:]
    assert 0.5 < np.prod(fast) / (true[0] ** 2 if len(true) == 1 else np.prod(true)) < 2.0


def test_jsbsim_steps_as_the_matrices_do(identified, export, tmp_path):
    """The filters at 1 kHz against the exact step of the matrices; Tustin's rule is right to 1 % there."""
    from scipy.linalg import expm

    text = export("output_error", "jsbsim").read_text(encoding="utf-8")
    (tmp_path / "bare").mkdir()
    (tmp_path / "bare" / "bare.xml").write_text(
        '<?xml version="1.0"?>\n<fdm_config name="bare" version="2.0"><fileheader/><metrics>'
        '<wingarea unit="M2">1</wingarea><wingspan unit="M">1</wingspan><chord unit="M">1</chord></metrics>'
        '<mass_balance><ixx unit="KG*M2">1</ixx><iyy unit="KG*M2">1</iyy><izz unit="KG*M2">1</izz>'
        '<emptywt unit="KG">1</emptywt><location name="CG" unit="M"><x>0</x><y>0</y><z>0</z></location></mass_balance>'
        f'<ground_reactions/><propulsion/><flight_control name="f"/><aerodynamics/>{text[text.index("<system") :]}'
        "</fdm_config>\n"
    )
    fdm = jsbsim.FGFDMExec(str(tmp_path), None)
    fdm.set_debug_level(0)
    fdm.set_aircraft_path(".")
    rate, count = 1000.0, 1500
    fdm.set_dt(1.0 / rate)
    assert fdm.load_model("bare")
    fdm["ic/h-sl-ft"] = 10_000.0
    fdm.run_ic()
    linear = identified.cases["output_error"].linear()
    n = len(linear.A)
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n:] = linear.A, linear.B
    step = expm(block / rate)
    x, got, expected = np.zeros(n), [], []
    for _ in range(count):
        fdm["identified/input/de"] = 0.02
        fdm.run()
        got.append([fdm[f"identified/output/{o}"] for o in ("V", "alpha", "q", "theta")])
        expected.append(linear.C @ x + linear.D[:, 0] * 0.02)
        x = step[:n, :n] @ x + step[:n, n] * 0.02
    got, expected = np.array(got), np.array(expected)
    size = np.abs(expected).max(axis=0)
    assert np.all(size > 1e-4)
    assert np.all(np.abs(got - expected)[5:].mean(axis=0) < 0.01 * size)


def test_a_model_without_a_form_in_jsbsim_is_one_line(identified, export):
    """A discrete model with a pole on the negative real axis, as too high an order in noise gives; here put there."""
    poles = identified.models / "transfer_function.json"
    content = json.loads(poles.read_text(encoding="utf-8"))
    first = content["outputs"][0]
    content["denominators"][first] = np.poly([0.9, 0.8, 0.7, 0.6, -0.5]).tolist()
    poles.write_text(json.dumps(content), encoding="utf-8")
    code, said = export("transfer_function", "jsbsim")
    assert (code, len(said)) == (2, 1)
    assert "must have a counterpart in continuous time" in said[0]
    assert "export it to control or mat instead" in said[0]
    assert export("transfer_function", "mat").is_file()
