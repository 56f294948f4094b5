"""Aircraft outside of the testbench: as C and as units for co-simulation, flown beside JSBSim."""

import ctypes
import shutil
import subprocess
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from commands import ends
from side_by_side import with_sections

import testbench as tb
from testbench.aircraft import Amendment, Insert
from testbench.core.errors import LimitError
from testbench.core.escape import c_comment, c_identifier, c_string
from testbench.core.record import FlightRecord
from testbench.flight.batch import c99
from testbench.flight.batch.alone import Alone, alone
from testbench.flight.batch.check import TOLERANCE, difference, every_control
from testbench.flight.batch.fly import fly_jobs
from testbench.flight.batch.jobs import Job
from testbench.flight.condition import Start
from testbench.flight.simulate import checked
from testbench.questions.export.aircraft import export_aircraft

COMPILER = next((found for name in ("cc", "gcc", "clang") if (found := shutil.which(name))), None)
compiled_here = pytest.mark.skipif(COMPILER is None, reason="no C compiler is found")
CASES = {"taurus": (12.0, 100.0), "eolo": (16.0, 547.0), "c172p": (43.0, 1000.0)}
Values = Callable[[np.ndarray], np.ndarray]


@cache
def model_of(name: str) -> tuple[Alone, FlightRecord, np.ndarray, float]:
    """Return a model, 20 s of it by JSBSim in which every control moves, the inputs of each frame, and the log rate."""
    aircraft = tb.load_aircraft(f"jsbsim:{name}" if name == "c172p" else name)
    trimmed = tb.trim(aircraft, tb.FlightCondition(*CASES[name]))
    manoeuvre, log = every_control(aircraft, trimmed, 0.005), trimmed.rate_hz / round(trimmed.rate_hz / 50.0)
    model = alone(aircraft, trimmed)
    _, commands, _ = checked(aircraft, trimmed, manoeuvre, log, None)
    u = np.tile([x.at_trim for x in model.inputs], (len(commands), 1))
    names = [x.name for x in model.inputs]
    u[:, [names.index(f"{n}_cmd") for n in manoeuvre.signal.channels]] = commands
    return model, tb.fly(aircraft, trimmed, manoeuvre, log), u, log


def flown(model: Alone, truth: FlightRecord, u: np.ndarray, begin: np.ndarray, step: Values) -> tuple[float, str]:
    """Fly frame by frame; return the greatest difference from a record, of a channel's range, and its channel."""
    stride = (len(u) - 1) // (len(truth) - 1)
    rows = [begin, *(y for k, y in ((k, step(u[k])) for k in range(1, len(u))) if k % stride == 0)]
    names = [x.name for x in model.outputs]
    kept = tuple(n for n in truth.channels if n in names)
    data = np.array(rows)[: len(truth), [names.index(n) for n in kept]]
    beside = FlightRecord(truth.t_s, kept, np.column_stack([truth[n] for n in kept]), truth.kind)
    return difference(FlightRecord(truth.t_s, kept, data, truth.kind), beside)


class Compiled:
    """A model in C: functions of arrays."""

    def __init__(self, model: Alone, folder: Path) -> None:
        for end, text in zip("hc", c99.c_files(model, "plane"), strict=True):
            (folder / f"plane.{end}").write_text(text)
        words = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O1", "-fPIC", "-shared", "plane.c", "-lm"]
        subprocess.run([COMPILER, *words, "-o", "plane.so"], cwd=folder, check=True)
        self._library = ctypes.CDLL(str(folder / "plane.so"))
        self._state, self._y = np.zeros(model.program.scratch), np.zeros(len(model.outputs))

    def call(self, name: str, *arrays: np.ndarray) -> np.ndarray:
        """Call a function and return the outputs."""
        given = [np.ascontiguousarray(x, float) for x in arrays]
        for function, xs in ((name, (self._state, *given)), ("outputs", (self._state, self._y))):
            getattr(self._library, f"plane_{function}")(*(ctypes.c_void_p(x.ctypes.data) for x in xs))
        return self._y.copy()


@compiled_here
@pytest.mark.parametrize("name", CASES)
def test_c_flies_as_jsbsim_does(name, tmp_path):
    model, truth, u, _ = model_of(name)
    plane = Compiled(model, tmp_path)
    worst, channel = flown(model, truth, u, plane.call("init"), lambda row: plane.call("step", row))
    assert worst < TOLERANCE, channel
    assert {"V", "alpha", "q", "h", "de"} < {x.name for x in model.outputs}
    assert (name == "eolo") == ("eta_8" in {x.name for x in model.outputs})


@compiled_here
@pytest.mark.parametrize("name", ["taurus", "eolo"])
def test_c_begins_off_the_trim_where_the_batch_does(name, tmp_path):
    model, _, u, log = model_of(name)
    off = Start(V_m_s=0.5, theta=0.02, phi=-0.03, q=0.01)
    t = np.arange(round(5.0 * model.trimmed.rate_hz)) / model.trimmed.rate_hz
    still = tb.InputSignal(t, np.zeros((t.size, 1)), ("de",))
    job = Job(model.aircraft, model.trimmed, tb.Manoeuvre("still", still, 0.0), log, start=off)
    (truth,) = fly_jobs([job], "batch")
    at = job.beginning.placed
    plane = Compiled(model, tmp_path)
    plane.call("init")
    placed = plane.call("place", u[0], np.array([at.h_m, at.phi, at.theta, 0.0, *at.uvw_m_s, *at.pqr]))
    frames = round(model.trimmed.rate_hz / log) * (len(truth) - 1)
    worst, channel = flown(model, truth, np.tile(u[0], (frames + 1, 1)), placed, lambda row: plane.call("step", row))
    assert worst < 3.0 * TOLERANCE, channel  # modes are brought to rest by as many rounds, but from elsewhere


@compiled_here
@pytest.mark.parametrize("version", [2, 3])
def test_a_unit_flies_as_jsbsim_does_in_a_master(version, tmp_path):
    fmpy = pytest.importorskip("fmpy", reason="fmpy is not installed")
    from fmpy.validation import validate_fmu

    model, truth, u, _ = model_of("taurus")
    (file,) = export_aircraft(model.aircraft, f"fmu{version}", tmp_path, model.trimmed.condition)
    assert validate_fmu(str(file)) == []
    found = fmpy.read_model_description(str(file))
    by_name = {v.name: v for v in found.modelVariables}
    assert [v.name for v in found.modelVariables if v.causality == "input"] == [x.name for x in model.inputs]
    assert {x.name: x.unit for x in model.outputs}.items() <= {n: v.unit for n, v in by_name.items()}.items()
    unit = fmpy.instantiate_fmu(fmpy.extract(str(file), str(tmp_path / "out")), found, "CoSimulation")
    read, write = (unit.getReal, unit.setReal) if version == 2 else (unit.getFloat64, unit.setFloat64)
    ins, outs = ([by_name[x.name].valueReference for x in of] for of in (model.inputs, model.outputs))
    time, dt = [0.0], model.dt_s

    def step(row):
        write(ins, list(row))
        unit.doStep(currentCommunicationPoint=time[0], communicationStepSize=dt)
        time[0] += dt
        return np.array(read(outs))

    def begin():
        if version == 2:
            unit.setupExperiment(startTime=0.0)
        unit.enterInitializationMode()
        unit.exitInitializationMode()
        return np.array(read(outs))

    worst, channel = flown(model, truth, u, begin(), step)
    assert worst < TOLERANCE, channel
    state, there = (unit.getFMUstate if version == 2 else unit.getFMUState)(), time[0]
    first = step(u[1])
    (unit.setFMUstate if version == 2 else unit.setFMUState)(state)
    time[0] = there
    np.testing.assert_array_equal(step(u[1]), first)
    (unit.freeFMUstate if version == 2 else unit.freeFMUState)(state)
    unit.reset()
    write([by_name["h_start"].valueReference], [300.0])
    assert begin()[[x.name for x in model.outputs].index("h")] == pytest.approx(300.0, abs=1e-6)
    unit.terminate()
    unit.freeInstance()


def test_a_unit_without_a_compiler_holds_its_source_and_says_so(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PATH", str(tmp_path))
    status, said = ends(monkeypatch, capsys, "export", "aircraft", "taurus", "--to", "fmu3", "-o", tmp_path)
    assert (status, said) == (0, ["note: the unit holds its source alone, as no C compiler is found"])
    with zipfile.ZipFile(tmp_path / "taurus" / "taurus_fmu3.fmu") as unit:
        assert "sources/taurus.c" in unit.namelist()
        assert not [name for name in unit.namelist() if name.startswith("binaries/")]


def test_licence_author_and_changes_stand_in_the_code(taurus):
    changed = taurus.amended(Amendment("tail", "heavier */ tail", (Insert("mass_balance", "<property>a</property>"),)))
    for aircraft, licence in ((changed, "MIT"), (tb.load_aircraft("jsbsim:c172p"), "none is stated")):
        said = "\n".join(c99.provenance(aircraft))
        assert f"Licence of the model: {licence}" in said
    assert "This model is not to be sold." in said
    assert c_comment("Changed: tail, heavier */ tail") == "Changed: tail, heavier * / tail"


def test_texts_do_not_become_code():
    for hostile in ("*/ int x; /*", "a\n#define b", '"; system("x"); //', "??/", "\\", "jsbsim:c172p", "2 b", "é", ""):
        assert "*/" not in c_comment(hostile)
        assert "\n" not in c_comment(hostile)
        assert c_identifier(hostile).isidentifier()
        assert c_identifier(hostile).isascii()
        inside = c_string(hostile)[1:-1].replace("\\\\", "").replace('\\"', "").replace("\\?", "")
        assert not set('"\\?\n') & set(inside)


def test_what_jsbsim_alone_flies_is_refused_with_the_reason(taurus, tmp_path):
    gust = (
        "<pure_gain name='x'><input>simulation/frame</input><gain>1e-6</gain><output>atmosphere/gust-down-fps</output>"
    )
    aircraft = with_sections(taurus, f"<system name='x'><channel name='x'>{gust}</pure_gain></channel></system>")
    with pytest.raises(LimitError, match=r"taurus must be translated .* but it reads simulation/frame"):
        export_aircraft(aircraft, "c", tmp_path, tb.FlightCondition(12.0, 100.0))
    assert not list(tmp_path.iterdir())
