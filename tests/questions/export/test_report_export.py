"""Models for other programs: whatever the estimator and the format, the response is the model's own."""

import json
import runpy

import numpy as np
import pytest

from testbench.core.errors import RecordError, WriteError
from testbench.core.record import FlightRecord
from testbench.estimators.continuous import ContinuousTransferModel
from testbench.estimators.state_space import StateSpaceModel
from testbench.estimators.transfer_function import TransferFunctionModel
from testbench.questions.export.ask import SUFFIXES, Matrices, export_model, export_record, load_matrices

pytestmark = pytest.mark.drawn

jsbsim = pytest.importorskip("jsbsim")

OMEGA = np.array([0.1, 0.7, 2.0, 5.0])
DT = 0.02


def state_space():
    turn = np.exp(-0.03) * np.array([[np.cos(0.08), np.sin(0.08), 0.0], [-np.sin(0.08), np.cos(0.08), 0.0], [0, 0, 0]])
    A = turn + np.diag([0.0, 0.0, 0.97])
    B, C = np.array([[0.1, 0.2], [-0.3, 0.0], [0.05, 0.1]]), np.array([[1.0, 0.0, 1.0], [0.5, -1.0, 0.3]])
    D = np.array([[0.0, 0.3], [0.0, 0.0]])
    return StateSpaceModel(
        method="dsr_e", inputs=("de", "dr"), outputs=("q", "alpha"), dt_s=DT, A=A, B=B, C=C, D=D, K=np.zeros((3, 2)),
        advice=("a doubt\nin two lines",),
    )  # fmt: skip


def discrete_transfer():
    return TransferFunctionModel(
        method="transfer_function", inputs=("de",), outputs=("q", "alpha"), dt_s=DT,
        numerators=np.array([[0.2, -0.15], [0.1, 0.0]]), denominators=np.array([[1.0, -1.8, 0.83], [1.0, -0.95, 0.0]]),
        delays=(0, 3),
    )  # fmt: skip


def continuous_transfer(delays=((0.06, 0.0), (0.06, 0.0))):
    return ContinuousTransferModel(
        method="srivc", inputs=("de", "dr"), outputs=("q", "alpha"), dt_s=DT,
        numerators=np.array([[[0.0, -8.0, -6.0], [0.0, 0.0, 2.0]], [[0.1, 0.0, -9.0], [0.0, 1.0, 0.0]]]),
        denominators=np.array([[1.0, 3.0, 9.0], [1.0, 2.5, 4.0]]), delays_s=np.array(delays), hold=("foh", "foh"),
    )  # fmt: skip


MODELS = {
    "state space": state_space,
    "discrete": discrete_transfer,
    "continuous": continuous_transfer,
    "delays": lambda: continuous_transfer(((0.06, 0.0), (0.0, 0.1))),
}


def written(tmp_path, model):
    path = tmp_path / "model.json"
    path.write_text(json.dumps(model.to_dict()))
    return load_matrices(path)


def response(m: Matrices) -> np.ndarray:
    """H (k, p, m) of the matrices with their dead times."""
    s = 1j * OMEGA
    z = np.exp(s * m.dt_s) if m.dt_s else s
    free = np.linalg.inv(z[:, None, None] * np.eye(len(m.A)) - m.A)
    return (m.C @ free @ m.B + m.D) * np.exp(-s[:, None, None] * m.delays_s)


@pytest.mark.parametrize("name", MODELS)
def test_matrices_have_the_response_of_the_model(tmp_path, name):
    model = MODELS[name]()
    np.testing.assert_allclose(response(written(tmp_path, model)), model.frequency_response(OMEGA), rtol=1e-9)


@pytest.mark.parametrize("name", MODELS)
def test_python_control_gets_a_module_that_is_the_model(tmp_path, name):
    model = MODELS[name]()
    path = export_model(written(tmp_path, model), "control", tmp_path / "m.py")
    system = runpy.run_path(str(path))["system"]
    assert (system.input_labels, system.output_labels) == (list(model.inputs), list(model.outputs))
    got = np.moveaxis(system.frequency_response(OMEGA).frdata, 2, 0)
    np.testing.assert_allclose(got, model.frequency_response(OMEGA), rtol=1e-6, atol=1e-9)  # Pade at w tau <= 0.5


def test_tables_and_matrices_are_read_back_by_the_programs_they_are_for(tmp_path):
    import h5netcdf
    import pandas as pd
    from scipy.io import loadmat

    m = written(tmp_path, state_space())
    made = {to: export_model(m, to, tmp_path / f"x{suffix}") for to, suffix in SUFFIXES.items() if to != "parquet"}
    frame = pd.read_csv(made["csv"])
    entry = frame[(frame.matrix == "B") & (frame.row == "x2") & (frame.column == "de")]
    assert entry["value"].tolist() == [-0.3]
    back = loadmat(made["mat"], squeeze_me=True)
    np.testing.assert_array_equal(back["A"], m.A)
    assert list(back["inputs"]) == ["de", "dr"]
    assert back["dt"] == DT
    with h5netcdf.File(made["netcdf"]) as file:
        np.testing.assert_array_equal(file["C"][()], m.C)
        assert file.attrs["outputs"] == "q alpha"
    plain = json.loads(made["json"].read_text())
    np.testing.assert_array_equal(plain["D"], m.D)
    assert plain["units"] == {"de": "rad", "dr": "rad", "q": "rad/s", "alpha": "rad"}
    again = tmp_path / "again.mat"
    assert export_model(m, "mat", again).read_bytes() == made["mat"].read_bytes()
    pytest.importorskip("pyarrow")
    rows = pd.read_parquet(export_model(m, "parquet", tmp_path / "x.parquet"))
    pd.testing.assert_frame_equal(rows.replace("", np.nan), frame, check_dtype=False)


FLIGHT_MODEL = """<?xml version="1.0"?>
<fdm_config name="nothing" version="2.0" release="ALPHA">
 <fileheader><author>none</author><description>carries a system</description></fileheader>
 <metrics><wingarea unit="M2">1</wingarea><wingspan unit="M">1</wingspan><chord unit="M">1</chord></metrics>
 <mass_balance><ixx unit="KG*M2">1</ixx><iyy unit="KG*M2">1</iyy><izz unit="KG*M2">1</izz>
  <emptywt unit="KG">1</emptywt><location name="CG" unit="M"><x>0</x><y>0</y><z>0</z></location></mass_balance>
 <ground_reactions/><propulsion/><flight_control name="f"/><aerodynamics/>
 {system}
</fdm_config>
"""


@pytest.mark.parametrize("name", MODELS)
def test_jsbsim_flies_the_model(tmp_path, name):
    """Against the matrices' own steps at 1 kHz; Tustin's rule and a delay of whole frames are right to 1 % there."""
    m = written(tmp_path, MODELS[name]())
    text = export_model(m, "jsbsim", tmp_path / "m.xml").read_text()
    folder = tmp_path / "aircraft" / "nothing"
    folder.mkdir(parents=True)
    (folder / "nothing.xml").write_text(FLIGHT_MODEL.format(system=text[text.index("<system") :]))
    fdm = jsbsim.FGFDMExec(str(tmp_path), None)
    fdm.set_debug_level(0)
    fdm.set_aircraft_path("aircraft")
    rate = 1000.0
    fdm.set_dt(1.0 / rate)  # before loading: the filters take it then
    assert fdm.load_model("nothing")
    fdm["ic/h-sl-ft"] = 10_000.0
    fdm.run_ic()
    t = np.arange(1500) / rate
    u = np.column_stack([np.where(t >= 0.1 * (j + 1), 0.1, 0.0) for j in range(len(m.inputs))])
    got = np.empty((t.size, len(m.outputs)))
    for k, row in enumerate(u):
        for j, channel in enumerate(m.inputs):
            fdm[f"identified/input/{channel}"] = float(row[j])
        fdm.run()
        got[k] = [fdm[f"identified/output/{o}"] for o in m.outputs]
    expected = stepped(m, u, t)
    size = np.abs(expected).max(axis=0)
    assert np.all(size > 1e-3)
    assert np.all(np.abs(got - expected)[5:].mean(axis=0) < 0.01 * size)


def stepped(m: Matrices, u: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Outputs (n, p) by superposition of the steps of each input, each at its own dead time."""
    from scipy.linalg import expm, logm

    if m.dt_s:
        both = np.block([[m.A, m.B], [np.zeros((m.B.shape[1], len(m.A))), np.eye(m.B.shape[1])]])
        inner = np.real(logm(both)) / m.dt_s
        A, B = inner[: len(m.A), : len(m.A)], inner[: len(m.A), len(m.A) :]
    else:
        A, B = m.A, m.B
    dt = float(t[1])
    n, p = len(A), len(m.outputs)
    out = np.zeros((t.size, p))
    for j in range(u.shape[1]):
        held = np.zeros((n + 1, n + 1))
        held[:n, :n], held[:n, n] = A * dt, B[:, j] * dt
        F = expm(held)
        for i in range(p):
            late = round(m.delays_s[i, j] / dt)
            v = np.concatenate([np.zeros(late), u[: t.size - late, j]])
            x = np.zeros(n)
            for k in range(t.size):
                out[k, i] += m.C[i] @ x + m.D[i, j] * v[k]
                x = F[:n, :n] @ x + F[:n, n] * v[k]
    return out


def test_poles_without_counterpart_and_twins_are_refused_for_jsbsim(tmp_path):
    m = written(tmp_path, state_space())
    flipped = Matrices(**{**vars(m), "A": np.diag([-0.3, 0.5, 0.6])})
    with pytest.raises(RecordError, match=r"one at z = -0\.3; lower its order"):
        export_model(flipped, "jsbsim", tmp_path / "x.xml")
    twins = Matrices(**{**vars(m), "A": np.array([[0.9, 1.0, 0.0], [0.0, 0.9, 1.0], [0.0, 0.0, 0.9]])})
    with pytest.raises(RecordError, match="but some coincide"):
        export_model(twins, "jsbsim", tmp_path / "x.xml")


@pytest.mark.parametrize(
    ("content", "law"),
    [
        ("", "damaged or none"),
        ("[1, 2]", "matrices or transfer functions"),
        ('{"H": 1}', "matrices or transfer functions"),
        ('{"A": [[1]]}', "complete model file"),
        ('{"A": [[1]], "B": [[1]], "C": [[1]], "D": [[1, 2]], "inputs": ["de"], "outputs": ["q"]}', "complete model"),
    ],
)
def test_what_is_no_model_is_said(tmp_path, content, law):
    path = tmp_path / "m.json"
    path.write_text(content)
    with pytest.raises(RecordError, match=law) as error:
        load_matrices(path)
    assert "m.json" in str(error.value)


def test_records_go_to_the_formats_of_records(tmp_path):
    record = FlightRecord(np.arange(5.0), ("q",), np.zeros((5, 1)), "measured")
    path = record.save(tmp_path / "r.nc")
    assert [export_record(path, to).name for to in ("csv", "mat")] == ["r.csv", "r.mat"]
    assert export_record(path, "netcdf", tmp_path / "copy.nc").read_bytes()
    with pytest.raises(RecordError, match="written over itself"):
        export_record(path, "netcdf")
    (tmp_path / "mine.csv").write_text("mine")
    with pytest.raises(WriteError, match="no manifest lists"):
        export_record(path, "csv", tmp_path / "mine.csv")
    assert (tmp_path / "mine.csv").read_text() == "mine"
    with pytest.raises(RecordError, match="records go to csv"):
        export_record(path, "jsbsim")
