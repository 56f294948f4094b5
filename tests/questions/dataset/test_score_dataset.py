"""Scores: perfect answers are perfect, known errors are told as they are, names by level; bad tables are refused."""

import csv
import json
import shutil

import numpy as np
import pytest
from commands import command
from drawn_sets import SMALL

import testbench as tb
from testbench.core.errors import RecordError
from testbench.questions.dataset.score import score_predictions

NAMES = SMALL.replace('title = "Small"', 'title = "Few"\ntask = "naming"').replace(
    '"transport_delay", "actuator_lag"', '"mass_error", "actuator_lag", "q_scale + V_lag"'
)


@pytest.fixture(scope="module")
def figures(tmp_path_factory):
    folder = tmp_path_factory.mktemp("figures")
    (folder / "small.toml").write_text(SMALL, encoding="utf-8")
    tb.draw_dataset(folder / "small.toml", folder / "set", runs=120, workers=1)
    return folder


@pytest.fixture(scope="module")
def names(tmp_path_factory):
    folder = tmp_path_factory.mktemp("names")
    (folder / "few.toml").write_text(NAMES, encoding="utf-8")
    tb.draw_dataset(folder / "few.toml", folder / "set", runs=120, workers=1)
    return folder


def truths(folder):
    """Return the test split with its labels, one flight of each draw."""
    test = tb.open_dataset(folder / "set", "test", truth="")
    return test.isel(flight=np.unique(test.draw.values, return_index=True)[1])


def test_a_tree_has_every_flight_once_in_its_split(figures):
    whole, tree = tb.open_dataset(figures / "set", truth=""), tb.open_datatree(figures / "set", truth="")
    assert list(tree.children) == ["train", "validation", "test"]
    flights = np.concatenate([part.flight.values for part in tree.children.values()])
    assert sorted(flights) == list(range(whole.sizes["flight"]))
    for name, part in tree.children.items():
        alone = tb.open_dataset(figures / "set", name, truth="")
        np.testing.assert_array_equal(part.readings.values, alone.readings.values)
        np.testing.assert_array_equal(part.truth.values, alone.truth.values)
        assert part["level"].attrs["names"] == whole.level.attrs["names"]


def table(path, heads, rows):
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([heads, *rows])
    return path


def scored(folder, path, **more):
    heads, rows, _ = score_predictions(folder / "set", path, **more)
    return [dict(zip(heads, row, strict=True)) for row in rows]


def test_known_errors_are_told_as_they_are(figures, tmp_path):
    """Answers off by 10 % of the rms where 5 % is stated are two stated errors off, and none lies within 95 %."""
    test = truths(figures)
    rows = []
    for level in (0, 1):
        of = test.isel(flight=np.flatnonzero(test.level.values == level))
        true = of.truth.sel(figure="M_q").values
        rms = float(np.sqrt(np.mean(true**2)))
        rows += [(d, "M_q", x + 0.1 * rms, 0.05 * rms) for d, x in zip(of.draw.values, true, strict=True)]
        rows += [(d, "M_de", x, 0.0) for d, x in zip(of.draw.values, of.truth.sel(figure="M_de").values, strict=True)]
    found = scored(figures, table(tmp_path / "a.csv", ("draw", "figure", "value", "std"), rows))
    assert {(r["level"], r["figure"]) for r in found} == {(v, f) for v in ("clean", "hidden") for f in ("M_q", "M_de")}
    for row in found:
        assert row["answered"] == row["draws"] != "0"
        off = row["figure"] == "M_q"
        assert float(row["median error, %"]) == pytest.approx(10.0 if off else 0.0, abs=1e-3)
        assert float(row["median error / std"]) == pytest.approx(2.0 if off else 0.0, abs=1e-3)
        assert row["truth within 95 %"].startswith("0 of" if off else f"{row['draws']} of")


def test_what_is_not_answered_counts_among_the_draws_alone(figures, tmp_path):
    draw = int(truths(figures).draw[0])
    found = scored(figures, table(tmp_path / "a.csv", ("draw", "figure", "value"), [(draw, "M_q", -1.0)]))
    assert sum(int(r["answered"]) for r in found) == 1
    assert sum(int(r["draws"]) for r in found) == truths(figures).sizes["flight"]
    assert found[0]["truth within 95 %"] == "", "no errors are stated"


def test_two_effects_are_hidden_together_and_each_has_its_size(names):
    flights = tb.open_dataset(names / "set", truth="")
    kinds, both = flights.effect.attrs["names"], flights.effect.values[:, 1] >= 0
    assert {tuple(kinds[k] for k in row) for row in flights.effect.values[both]} == {("q_scale", "V_lag")}
    sizes = flights.effect_size.sel(size=["q_scale: scale", "V_lag: lag_s"]).values
    assert np.isfinite(sizes[both]).all()
    assert np.isnan(sizes[flights.effect.values[:, 0] < 0]).all()
    parts = json.loads((names / "set" / "dataset.json").read_text("utf-8"))["layout"]["parts"]
    assert dict(zip(kinds, parts, strict=True))["V_lag"] == "V sensor"


def test_a_level_is_no_feature_of_the_test_split_where_effects_are_named(names):
    test = tb.open_dataset(names / "set", "test")
    assert (test.level.values == -2).all()
    assert np.isnan(test.turbulence_rms_m_s.values).all()
    assert (tb.open_dataset(names / "set", "train").level.values >= 0).all()


def test_names_are_judged_as_the_blind_test_judges(names, tmp_path):
    test = truths(names)
    kinds = test.effect.attrs["names"]
    rows = []
    for draw, of in zip(test.draw.values, test.effect.values, strict=True):
        said = " + ".join(kinds[k] for k in of if k >= 0)
        rows.append((draw, said.replace("mass_error", "payload") or "no gap"))  # the flights do not tell the two apart
    found = {r["level"]: r for r in scored(names, table(tmp_path / "a.csv", ("draw", "said"), rows))}
    assert found["hidden"]["right"] == found["hidden"]["cases"] != "0"
    assert found["clean"]["no gap"] == found["clean"]["cases"] != "0"
    wrong = [(draw, "steady_wind | ground_effect") for draw, _ in rows]
    found = scored(names, table(tmp_path / "b.csv", ("draw", "said"), wrong))
    assert all(r["wrong"] == r["cases"] for r in found)


def test_a_contest_withholds_the_truth(figures, tmp_path):
    shutil.copytree(figures / "set", tmp_path / "given")
    (tmp_path / "given" / "truth_test.h5").rename(tmp_path / "kept.h5")
    (tmp_path / "given" / "dataset.json").unlink()
    draw = int(truths(figures).draw[0])
    answers = table(tmp_path / "a.csv", ("draw", "figure", "value"), [(draw, "M_q", -1.0)])
    done = command("dataset", "score", tmp_path / "given", answers)
    assert done.returncode == 2
    assert "whoever holds them can score" in done.stderr
    done = command(
        "dataset", "score", tmp_path / "given", answers, "--truth", tmp_path / "kept.h5", "-o", tmp_path / "s.csv"
    )
    assert done.returncode == 0, done.stderr
    assert "M_q" in done.stdout
    assert (tmp_path / "s.csv").read_text("utf-8").startswith("level,figure,draws,answered")
    assert command("dataset", "check", tmp_path / "given").returncode == 0


@pytest.mark.parametrize(
    ("heads", "row", "said"),
    [
        (("draw", "figure"), ("{}", "M_q"), "it lacks value"),
        (("draw", "figure", "value"), ("{}", "M_Q", "1"), "line 2: unknown figure 'M_Q'; did you mean 'M_q'?"),
        (("draw", "figure", "value"), ("{}", "M_q", "nan"), "line 2: value must be a finite number, got 'nan'"),
        (("draw", "figure", "value", "std"), ("{}", "M_q", "1", "-2"), "line 2: std >= 0 must hold, got -2"),
        (("draw", "figure", "value"), ("9999", "M_q", "1"), "line 2: draw must be one of the test split, got '9999'"),
    ],
)
def test_tables_with_faults_are_refused(figures, tmp_path, heads, row, said):
    draw = str(int(truths(figures).draw[0]))
    path = table(tmp_path / "a.csv", heads, [[x.format(draw) for x in row]])
    with pytest.raises(RecordError) as error:
        score_predictions(figures / "set", path)
    assert said in str(error.value)


def test_an_empty_table_and_a_twice_answered_figure_are_refused(figures, tmp_path):
    for content, said in (("", "must be a table of answers"), ("draw,figure,value\n", "no line below its heads")):
        (tmp_path / "e.csv").write_text(content, encoding="utf-8")
        with pytest.raises(RecordError, match=said):
            score_predictions(figures / "set", tmp_path / "e.csv")
    draw = int(truths(figures).draw[0])
    path = table(tmp_path / "t.csv", ("draw", "figure", "value"), [(draw, "M_q", 1.0)] * 2)
    with pytest.raises(RecordError, match="line 3: a figure of a draw must be answered once"):
        score_predictions(figures / "set", path)
