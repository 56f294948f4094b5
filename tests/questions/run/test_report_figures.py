"""What the figures draw: the right numbers in the right units, at any width, always the same bytes."""

import math
import subprocess
import sys
from dataclasses import replace

import matplotlib
import numpy as np
import pytest

from testbench.inputs.signal import energy_spectrum
from testbench.page.draw import envelope, spread, styled
from testbench.page.figure import Chart, Panel, Plate, grid, rows_of
from testbench.questions.run.figures import (
    _worst,
    bode_plates,
    history_plates,
    input_plates,
    plates,
    singular_value_plates,
)

pytestmark = pytest.mark.drawn

DEG = 180.0 / np.pi


def axes_of(plate: Plate, wide: bool = True) -> list:
    return plate.make(wide).axes


def titled(plate: Plate, text: str):
    return next(a for a in axes_of(plate) if text in a.get_title(loc="left"))


def ylabelled(plate: Plate, text: str) -> list:
    return [a for a in axes_of(plate) if a.get_ylabel() == text]


def test_every_plate_of_a_simulated_run_is_there_once(result) -> None:
    names = [p.name for p in plates(result)]
    assert names == ["answer", "input_de", "time_histories", "singular_values", "bode_de", "poles"]


@pytest.mark.parametrize("wide", [True, False])
def test_all_plates_draw_at_both_widths(result, wide: bool) -> None:
    for plate in plates(result):
        drawing = plate.draw(wide, png=False)
        assert drawing.svg.startswith("<svg")
        assert "</svg>" in drawing.svg
        assert drawing.png == b""
        assert plate.caption.endswith(".")


def test_drawing_leaves_matplotlib_as_it_was(result) -> None:
    before = matplotlib.rcParams.copy()  # not dict(): that would resolve the backend and import pyplot
    singular_value_plates(result)[0].draw()
    assert matplotlib.rcParams.copy() == before


def test_report_imports_matplotlib_only_when_it_draws() -> None:
    code = "import sys, testbench.page; sys.exit('matplotlib' in sys.modules or 'jinja2' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_time_histories_show_degrees_measured_and_predicted(result) -> None:
    panel = ylabelled(history_plates(result)[0], "Δq, deg/s")[0]
    measured, without_alpha, with_alpha = (line.get_ydata() for line in panel.lines)
    q = result.flights[0].truth["q"] * DEG
    np.testing.assert_allclose(measured, q, atol=1e-12)
    np.testing.assert_allclose(without_alpha, 1.25 * q, atol=1e-12)
    np.testing.assert_allclose(with_alpha, 0.9 * q, atol=1e-12)


def test_an_output_that_a_suite_lacks_has_one_prediction(result) -> None:
    panel = ylabelled(history_plates(result)[0], "Δα, deg")[0]
    assert len(panel.lines) == 2


def test_a_diverging_prediction_does_not_squash_the_measured_one(result) -> None:
    first = result.cases[0]
    wild = np.full_like(first.evaluation.identification.predictions[0], np.inf)
    wild[: len(wild) // 2] = np.nan
    scores = replace(first.evaluation.identification, predictions=(wild,), mrse_percent=np.full(2, np.inf))
    broken = replace(first, evaluation=replace(first.evaluation, identification=scores))
    plate = history_plates(replace(result, cases=(broken, *result.cases[1:])))[0]
    panel = ylabelled(plate, "Δq, deg/s")[0]
    q = result.flights[0].truth["q"] * DEG
    low, high = panel.get_ylim()
    assert high - low < 3.0 * np.ptp(q)
    assert low < q.min() < q.max() < high
    assert "</svg>" in plate.draw(png=False).svg


def test_many_records_are_spread_over_several_plates(make_result) -> None:
    base = make_result()
    first = base.cases[0]
    scores = first.evaluation.identification
    many = replace(
        first,
        identification=first.identification * 5,
        evaluation=replace(first.evaluation, identification=replace(scores, predictions=scores.predictions * 5)),
    )
    found = history_plates(replace(base, cases=(many,), flights=base.flights * 5))
    assert [p.name for p in found] == ["time_histories_1", "time_histories_2"]
    assert all("</svg>" in p.draw(wide, png=False).svg for p in found for wide in (True, False))


def test_of_many_records_the_worst_predicted_are_drawn(make_result) -> None:
    base = make_result()
    first = base.cases[0]
    scores = first.evaluation.identification
    good, bad = scores.predictions[0], scores.predictions[0] + 1.0
    count, drawn = 40, {3, 8, 11, 12, 20, 27, 30, 38, 39}
    predictions = tuple(bad if i in drawn else good for i in range(count))
    many = replace(
        first,
        identification=first.identification[:1] * count,
        evaluation=replace(first.evaluation, identification=replace(scores, predictions=predictions)),
    )
    assert _worst(many, "identification") == sorted(drawn)
    found = history_plates(replace(base, cases=(many,), flights=base.flights * count))
    total = count + len(first.validation)
    assert all(f"Of {total} records" in plate.caption and "predicts worst" in plate.caption for plate in found)
    assert len(found) == math.ceil((len(drawn) + len(first.validation)) / 3)
    assert not any("predicts worst" in plate.caption for plate in history_plates(base))


def test_the_spectrum_is_that_of_the_input_in_degrees(result) -> None:
    panel = ylabelled(input_plates(result)[0], "energy density, (deg s)²")[0]
    line = next(x for x in panel.lines if x.get_label() == "identification")
    omega, energy = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
    u = result.flights[0].truth["de"]
    np.testing.assert_allclose(energy, energy_spectrum(u * DEG, 0.05, omega)[:, 0], rtol=1e-12)


def test_the_spectrum_names_every_mode_the_sampling_limit_and_the_95_percent_frequency(result) -> None:
    panel = ylabelled(input_plates(result)[0], "energy density, (deg s)²")[0]
    words = [" ".join(text.get_text().split()) for text in panel.texts]
    for name in ("phugoid 0.500 rad/s", "short period 4.47 rad/s", "1st symmetric wing bending 26.0 rad/s"):
        assert name in words
    assert "sampling limit 62.8 rad/s" in words  # pi / 0.05 s
    assert any(w.startswith("95 % below") for w in words)
    assert len(panel.patches) == 2  # bands of the two rigid modes, none of the elastic one


def test_bode_magnitude_is_in_shown_units_and_phases_share_a_sheet(result) -> None:
    plate = bode_plates(result)[0]
    magnitude = titled(plate, "q / δe, magnitude")
    true, found, _ = (line.get_ydata()[0] for line in magnitude.lines[:3])
    assert magnitude.get_ylabel() == "(deg/s)/deg"
    assert true == pytest.approx(2.0)
    assert found == pytest.approx(2.5)
    phases = [line.get_ydata()[0] for line in titled(plate, "q / δe, phase").lines[:3]]
    assert np.ptp(phases) == pytest.approx(0.0)
    assert abs(phases[0]) == pytest.approx(180.0)


def test_without_truth_the_models_are_drawn_alone(make_result) -> None:
    bare = make_result(truth=None)
    assert len(titled(bode_plates(bare)[0], "q / δe, magnitude").lines) == 2
    assert "true" not in bode_plates(bare)[0].caption
    assert [p.name for p in plates(bare)][-1] == "poles"


def test_singular_values_mark_the_chosen_order(result) -> None:
    panel = titled(singular_value_plates(result)[0], "eolo_alpha: order 2")
    kept, left_out = (line for line in panel.lines if line.get_marker() == "o")
    assert kept.get_ydata().tolist() == [90.0, 20.0]
    assert left_out.get_ydata().tolist() == [1.1, 0.9, 0.8]


def test_models_without_singular_values_have_no_such_plate(make_result) -> None:
    base = make_result()
    cases = tuple(replace(c, model=replace(c.model, diagnostics={})) for c in base.cases)
    assert singular_value_plates(replace(base, cases=cases)) == []


def test_spread_labels_keep_their_distance_and_stay_inside() -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        sizes = rng.uniform(0.01, 0.1, 8)
        places = np.array(spread(np.sort(rng.uniform(0.0, 1.0, 8)).tolist(), sizes.tolist()))
        gaps = np.diff(places) - 0.5 * (sizes[1:] + sizes[:-1])
        assert gaps.min() >= -1e-12
        assert places[0] - 0.5 * sizes[0] >= -1e-12
        assert places[-1] + 0.5 * sizes[-1] <= 1.0 + 1e-12


def test_spread_leaves_labels_that_do_not_meet_where_they_are() -> None:
    assert spread([0.2, 0.5, 0.8], [0.1, 0.1, 0.1]) == [0.2, 0.5, 0.8]


def test_the_envelope_keeps_ends_and_extremes_in_order() -> None:
    t = np.arange(10_007) * 0.01
    y = np.sin(t) + 0.1 * np.random.default_rng(0).standard_normal(t.size)
    y[5003] = 9.0
    short_t, short_y = envelope(t, y, bins=300)
    assert short_t.size <= 2 * 300 + 34  # two a stretch, and a rest shorter than one stretch of 34
    assert (short_t[0], short_t[-1]) == (t[0], t[-1])
    assert np.all(np.diff(short_t) > 0.0)
    assert short_y.max() == 9.0
    assert short_y.min() == y.min()


def test_the_envelope_leaves_a_short_signal_alone() -> None:
    t = np.arange(50.0)
    assert envelope(t, t)[0] is t


def test_figures_have_the_width_of_the_page() -> None:
    chart = Chart([[Panel(draws=())]])
    assert [styled(chart, wide).get_size_inches()[0] for wide in (True, False)] == [8.6, 3.75]


def test_rows_are_equally_long() -> None:
    assert [len(row) for row in rows_of(list(range(7)), 3)] == [3, 3, 1]
    assert [len(row) for row in rows_of(list(range(4)), 3)] == [2, 2]


def test_a_title_is_cut_and_notes_are_left_out_where_there_is_no_room() -> None:
    long = "a title far too long for a panel of an inch and a half, whatever the size of its letters and lines"
    for count, shown in ((20, 0), (1, 1)):
        panel = Panel(draws=(), title=long, notes=[("MRSE, %", "k"), *[("12.3", "k")] * count])
        axes = styled(grid([panel] * 4, 4)).axes[0]
        assert axes.get_title(loc="left").endswith("…")
        assert len(axes.artists) == shown
