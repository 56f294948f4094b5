"""Data sets: what is drawn, that a kill and other workers change no byte, splits that do not leak, and refusals."""

import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from commands import command
from drawn_sets import SMALL, StandIn
from killed import killed_at, shown, whole

import testbench as tb
from testbench.core.errors import DatasetError, DiskError, RecordError, ScenarioError
from testbench.core.paths import AIRCRAFT_MODELS
from testbench.core.scenario.inputs import Doublet
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.inputs import build
from testbench.questions.dataset import ask
from testbench.questions.dataset.flying import fly_part
from testbench.questions.dataset.layout import layout_of
from testbench.questions.dataset.scenario import DatasetScenario
from testbench.questions.dataset.store import damaged
from testbench.sensors.sensor import first_order_lag

FILES = (
    "flights.h5",
    "truth_test.h5",
    "dataset.json",
    "README.md",
    "README.html",
    "croissant.json",
    "checksums.sha256",
)


def file_of(folder, text=SMALL):
    path = folder / "small.toml"
    path.write_text(text, encoding="utf-8")
    return path


def bytes_of(folder):
    return {name: (Path(folder) / name).read_bytes() for name in FILES}


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    folder = tmp_path_factory.mktemp("small")
    tb.draw_dataset(file_of(folder), folder / "set", workers=1)
    return folder


def test_a_flight_is_what_fly_and_the_suite_make_of_its_draw(small):
    flights = tb.open_dataset(small / "set", truth="")
    first = int(np.flatnonzero((flights.level == 0) & (flights.manoeuvre == 0))[0])
    row = flights.isel(flight=first)
    taurus = tb.load_aircraft("taurus", "rigid")
    at = tb.trim(taurus, tb.FlightCondition(float(row.V_m_s), float(row.h_m)), 100.0)
    doublet = Doublet(signal="doublet", control="de", start_s=0.2, amplitude_deg=1.0, period_s=0.8)
    u = build([doublet], 3.0, 100.0)
    truth = tb.fly(taurus, at, tb.Manoeuvre("doublet", u, 1.0), 50.0)
    n = int(row.samples)
    assert n == 201
    assert np.isnan(row.readings.values[n:]).all()
    # single precision of condition and readings: 1e-6 of the values; q and theta have no lag, bias or noise here
    for name, lag in (("theta", 0.0), ("q", 0.005)):
        expected = first_order_lag(truth[name], 0.02, lag) if lag else truth[name]
        np.testing.assert_allclose(row.readings.sel(channel=name).values[:n], expected, atol=2e-6)
    derivative = {d.name: d.held for d in dimensional_derivatives(tb.linearise(taurus, at), at)}
    assert float(row.truth.sel(figure="M_alpha")) == pytest.approx(derivative["M_alpha"], rel=1e-5)
    poles = abs(tb.linearise(taurus, at).poles())
    assert np.abs(poles / float(row.truth.sel(figure="short period wn")) - 1.0).min() < 1e-2  # h and servos left out


def test_a_hidden_effect_changes_the_motion_and_not_the_command(tmp_path):
    """The same draws with and without an effect: commands agree to the bit, what the aircraft does does not."""
    text = SMALL.replace('["transport_delay", "actuator_lag", "q_scale"]', '["transport_delay"]')
    scenario = DatasetScenario.load(file_of(tmp_path, text))
    plain = scenario.changed(level=tuple(x.model_copy(update={"hidden": ()}) for x in scenario.level))
    layout = layout_of(scenario, 20)
    with_, without = (fly_part(s, layout, 0, 10).rows for s in (scenario, plain))
    hidden = with_["level"] == 1
    assert hidden.any()
    command, q = layout.channels.index("de_cmd"), layout.channels.index("q")
    np.testing.assert_allclose(  # single precision; the trims of both differ in the last digits
        with_["readings"][:, :, command], without["readings"][:, :, command], atol=1e-6
    )
    moved = np.nanmax(np.abs(with_["readings"][:, :, q] - without["readings"][:, :, q]), axis=1)
    assert (moved[hidden] > 0.01).all()
    assert (moved[~hidden] == 0.0).all()
    assert (with_["effect"][hidden, 0] == layout.effects.index("transport_delay")).all()
    size = with_["effect_size"][:, layout.sizes.index("transport_delay: delay_s")]
    assert ((size[hidden] > 0.03) & (size[hidden] < 0.12)).all()


def test_workers_and_parts_change_no_byte(small, monkeypatch):
    monkeypatch.setattr(ask, "_MOST_PER_PART", 7)
    tb.draw_dataset(small / "small.toml", small / "again", workers=2)
    assert bytes_of(small / "again") == bytes_of(small / "set")


def test_a_larger_set_begins_with_the_same_draws(small):
    tb.draw_dataset(small / "small.toml", small / "longer", runs=70, workers=1)
    a, b = (tb.open_dataset(small / n, truth="") for n in ("set", "longer"))
    assert b.sizes["flight"] == 70
    np.testing.assert_array_equal(a.readings, b.readings[:60])
    np.testing.assert_array_equal(a.truth, b.truth[:60])


_KILLED = """
import sys
from testbench.questions.dataset import ask
ask._MOST_PER_PART = 3
ask.draw_dataset(sys.argv[1], sys.argv[2], workers=2)
"""


@pytest.mark.slow
def test_a_killed_process_loses_a_part_at_most_and_the_bytes_stay(small):
    """Killed again and again, as soon as the journal has grown, the set becomes the same."""
    folder, kills = small / "killed", 0
    journal = folder / ".testbench" / "new" / ".drawing" / "parts.jsonl"
    before = 0
    for _ in range(40):
        process = subprocess.Popen([sys.executable, "-c", _KILLED, small / "small.toml", folder])
        while process.poll() is None:
            if journal.exists() and journal.stat().st_size > before:
                before = journal.stat().st_size
                if kills < 3:
                    os.kill(process.pid, signal.SIGKILL)
                    kills += 1
                    process.wait()
                    with journal.open("ab") as file:
                        file.write(b'{"part": 3, "dra')  # half a line, as a kill may leave it
                    before = journal.stat().st_size
            time.sleep(0.005)
        if process.returncode == 0:
            break
    assert kills == 3
    ours, whole = bytes_of(folder), bytes_of(small / "set")
    assert [name for name in FILES if ours[name] != whole[name]] == []
    assert sorted(p.name for p in (folder / ".testbench").iterdir()) == ["lock", "manifest.json"]


def test_a_kill_at_any_change_of_the_disk_leaves_no_set_or_a_whole_one(small, monkeypatch):
    monkeypatch.setattr(ask, "_MOST_PER_PART", 2)
    here = {"runs": 4, "workers": 1}
    complete = shown(tb.draw_dataset(small / "small.toml", small / "of_four", **here).folder)
    sums = (small / "of_four" / "checksums.sha256").read_bytes()
    for step in (2, 5, 8, 12, 16, 19, 22, 25):
        folder = small / f"killed_{step}"
        assert killed_at(step, lambda folder=folder: tb.draw_dataset(small / "small.toml", folder, **here)), step
        assert shown(folder) in (set(), complete)
        drawn = tb.draw_dataset(small / "small.toml", folder, **here)
        assert drawn.folder == folder
        assert (shown(folder), whole(folder)) == (complete, True)
        assert (folder / "checksums.sha256").read_bytes() == sums
        assert not list(damaged(folder))


def test_no_draw_and_no_equal_condition_lies_in_two_splits(small):
    flights = tb.open_dataset(small / "set")
    split, draw = flights.split.values, flights.draw.values
    assert {*split} == {0, 1, 2}
    for number in {*draw}:
        assert len({*split[draw == number]}) == 1
    text = SMALL.replace("[1.0, 1.2]", "[1.1, 1.1]").replace("[100.0, 300.0]", "[200.0, 200.0]")
    text = text[: text.index('[[level]]\nname = "hidden"')]
    scenario = DatasetScenario.load(file_of(small, text))
    rows = fly_part(scenario, layout_of(scenario, 24), 0, 12).rows
    assert len({*rows["split"]}) == 1, "draws that are equal but for their noise lie in one split"
    file_of(small)


def test_labels_of_the_test_split_are_in_their_own_file_alone(small):
    public = tb.open_dataset(small / "set")
    test = public.split.values == 2
    assert np.isnan(public.truth.values[test]).all()
    assert (public.effect.values[test] == -2).all()
    assert np.isfinite(public.truth.sel(figure="M_q").values[~test]).all()
    known = tb.open_dataset(small / "set", truth="")
    assert np.isfinite(known.truth.sel(figure="M_q").values).all()
    assert (known.effect.values >= -1).all()


def test_xarray_opens_the_store_by_itself(small):
    flights = xr.open_dataset(small / "set" / "flights.h5")
    pitch_rate = flights.readings.sel(channel="q")[flights.split == 0]
    assert pitch_rate.shape == (int((flights.split == 0).sum()), 251)
    assert flights.level.attrs["names"] == ["clean", "hidden"]


def test_a_loader_gets_every_flight_of_a_split(small):
    """PyTorch's loader where it is installed; else one that asks a data set for the same: length, items, batches."""
    train = tb.FlightSamples(small / "set", "train")
    try:
        from torch.utils.data import DataLoader
    except ImportError:
        DataLoader = StandIn
    batches = list(DataLoader(train, batch_size=8, shuffle=True))
    assert sum(len(readings) for readings, _ in batches) == len(train) > 20
    readings, truth = batches[0]
    assert tuple(readings.shape[1:]) == (251, 7)
    assert tuple(truth.shape) == (8, len(tb.open_dataset(small / "set").figure))


def test_samples_are_read_anew_by_other_processes(small):
    import pickle

    train = tb.FlightSamples(small / "set", "train")
    readings, _ = train[3]
    assert len(pickle.dumps(train)) < 100_000
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(train))[3][0], readings)


def test_catalogues_of_data_sets_read_what_it_is(small):
    card = json.loads((small / "set" / "croissant.json").read_text(encoding="utf-8"))
    (store,) = card["distribution"]
    content = (small / "set" / store["contentUrl"]).read_bytes()
    assert hashlib.sha256(content).hexdigest() == store["sha256"]
    assert {v["name"] for v in card["variableMeasured"]} >= {"readings", "truth", "split"}
    croissant = pytest.importorskip("mlcroissant")  # the library of who wrote the format
    assert croissant.Dataset(jsonld=str(small / "set" / "croissant.json")).metadata.license


def test_checksums_tell_a_changed_byte(small):
    assert list(damaged(small / "set")) == []
    path = small / "again_damaged"
    tb.draw_dataset(small / "small.toml", path, runs=4, workers=1)
    with (path / "flights.h5").open("r+b") as file:
        file.seek(-5, 2)
        file.write(b"\x01")
    done = command("dataset", "check", path)
    assert done.returncode == 3
    assert "flights.h5 does not" in done.stderr


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("speed_ratio", "speed_ration", "unknown key 'speed_ration'; did you mean 'speed_ratio'?"),
        ('"transport_delay"', '"transport_dealy"', "unknown effect 'transport_dealy'; did you mean 'transport_delay'?"),
        ('"q_scale"', '"thrust_fade"', "thrust_fade grows over hours of a flight"),
        ('"q_scale"', '"q_scale + V_lag + az_lag"', "at most 2 effects can act together, got 3"),
        ('"coefficient.Cm_alpha"', '"coefficient.Cm_alhpa"', "did you mean 'Cm_alpha'?"),
        ('"coefficient.Cm_alpha"', '"condition.V_m_s"', "condition, air and inputs are drawn by the keys of the level"),
        ("samples_hz = 50.0", "samples_hz = 30.0", "samples_hz must divide the frames of taurus"),
        ("[100.0, 300.0]", "[300.0, 100.0]", "h_m: low <= high must hold"),
        ('suite = "eolo_gap"\n', "", "suite: the key is required and missing"),
    ],
)  # fmt: skip
def test_faults_are_told_before_anything_is_flown(tmp_path, old, new, said):
    assert old in SMALL
    with pytest.raises(ScenarioError) as error:
        DatasetScenario.load(file_of(tmp_path, SMALL.replace(old, new)))
    assert said in str(error.value)


def test_draws_that_cannot_fly_are_drawn_again_and_counted(tmp_path):
    text = SMALL.replace("speed_ratio = [1.0, 1.2]", "speed_ratio = [0.6, 1.2]")
    drawn = tb.draw_dataset(file_of(tmp_path, text), tmp_path / "set", workers=1)
    assert sum(drawn.again.values()) > 0
    assert f"Attempts that could not fly: {sum(drawn.again.values())}." in (drawn.folder / "README.md").read_text(
        "utf-8"
    )
    assert float(tb.open_dataset(drawn.folder).V_m_s.min()) > 7.0


def test_a_set_whose_draws_mostly_fail_is_refused_with_the_reason(tmp_path):
    text = SMALL.replace("amplitude_deg = 1.0", "amplitude_deg = 12.0")
    with pytest.raises(DatasetError, match=r"the flight left the limits of the aircraft|LimitError"):
        tb.draw_dataset(file_of(tmp_path, text), tmp_path / "set", workers=1)


def test_another_set_in_the_folder_and_a_folder_in_use_are_refused(small, tmp_path):
    with pytest.raises(DatasetError, match=r"holds another one \(layout differs\)"):
        tb.draw_dataset(small / "small.toml", small / "set", runs=20, workers=1)
    (tmp_path / "notes.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(DatasetError, match=r"a folder of its own, but .* holds notes.txt"):
        tb.draw_dataset(small / "small.toml", tmp_path, workers=1)
    assert tb.draw_dataset(small / "small.toml", small / "set").flown == 0


def test_an_own_aircraft_is_known_by_name_and_hash_and_not_by_its_place(small, tmp_path):
    shutil.copytree(AIRCRAFT_MODELS / "taurus", tmp_path / "mine")
    text = SMALL.replace('["taurus"]', '["./mine"]')
    drawn = tb.draw_dataset(file_of(tmp_path, text), tmp_path / "set", runs=12, workers=1)
    for name in ("dataset.json", "README.md"):
        assert str(tmp_path) not in (drawn.folder / name).read_text("utf-8")
    assert "mine" in tb.open_dataset(drawn.folder).aircraft.attrs["names"]
    model = tmp_path / "mine" / "taurus.xml"
    changed = model.read_text("utf-8").replace('"M">1.27</wingspan>', '"M">1.28</wingspan>')
    model.write_text(changed, encoding="utf-8")
    with pytest.raises(DatasetError, match=r"holds another one \(models differs\)"):
        tb.draw_dataset(tmp_path / "small.toml", tmp_path / "set", runs=12, workers=1)


def test_an_interrupt_keeps_what_is_finished_and_ends_with_130(small):
    """As Ctrl-C does: the signal goes to the command alone, whose workers end with it."""
    folder = small / "interrupted"
    code = (
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from testbench.questions.dataset "
        "import ask; ask._MOST_PER_PART = 1; from testbench.cli import main; main()"
    )
    words = ["dataset", small / "small.toml", "--out", folder, "--runs", "2000", "--workers", "2"]
    process = subprocess.Popen([sys.executable, "-c", code, *words], stderr=subprocess.PIPE, text=True)
    journal = folder / ".testbench" / "new" / ".drawing" / "parts.jsonl"
    while not (journal.exists() and journal.stat().st_size) and process.poll() is None:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate()
    assert process.returncode == 130, said
    assert "finished results are kept; the same command continues" in said
    assert "Traceback" not in said
    with pytest.raises(DatasetError, match="is not complete"):
        tb.open_dataset(folder)


def test_a_disk_without_room_is_told_before_anything_is_flown(small, tmp_path):
    from test_full_disk import with_room

    said = with_room(200_000, lambda: tb.draw_dataset(small / "small.toml", tmp_path / "set", workers=1))
    assert said[0] == DiskError.exit_status
    assert not (tmp_path / "set").exists()


def test_what_is_no_data_set_is_refused(tmp_path, small):
    with pytest.raises(RecordError, match=r"has no flights\.h5"):
        tb.open_dataset(tmp_path)
    with pytest.raises(ScenarioError, match="did you mean 'train'"):
        tb.open_dataset(small / "set", "trian")
    with pytest.raises(DatasetError, match="no variable 'truht'; did you mean 'truth'"):
        tb.FlightSamples(small / "set", "train", "truht")
    (small / "empty").mkdir()
    (small / "empty" / "flights.h5").write_bytes(b"")
    (small / "empty" / "checksums.sha256").write_text("", encoding="utf-8")
    with pytest.raises(RecordError, match="must be the store of a data set"):
        tb.open_dataset(small / "empty")
