"""The figure of the first screen: every model and mode is drawn, and a prediction that diverges stays on the axes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib import rc_context

from testbench.page.plot import INK, line_handles, style
from testbench.questions.run.answer_figures import answer_plates

pytestmark = pytest.mark.drawn


def drawn(result, wide: bool = True):
    (plate,) = answer_plates(result)
    with rc_context(style()):
        return plate, plate.make(wide)


def signs(axes) -> list[np.ndarray]:
    """Return x of the lines that are drawn as signs."""
    return [np.asarray(line.get_xdata()) for line in axes.lines if line.get_marker() not in ("None", "")]


@pytest.mark.parametrize("wide", [True, False])
def test_each_model_and_each_mode_has_its_sign(result, wide: bool) -> None:
    plate, figure = drawn(result, wide)
    errors, modes = figure.axes
    assert plate.name == "answer"
    assert [len(x) for x in signs(errors)] == [2, 3]  # without and with alpha
    np.testing.assert_allclose(signs(errors)[0], 25.0, rtol=1e-9)  # the models err by a quarter and by a tenth
    np.testing.assert_allclose(signs(errors)[1], 10.0, rtol=1e-9)
    assert [float(x[0]) for x in signs(modes)] == [
        e.snr_db[e.best_sensor] for e in sorted(result.truth.excitation, key=lambda e: abs(e.pole))
    ]
    assert modes.get_yticklabels()[2].get_text() == "1st symmetric wing\nbending"


def test_recorded_flights_have_no_modes_and_no_models_no_figure(make_result) -> None:
    plate, figure = drawn(make_result(truth=None))
    assert len(figure.axes) == 1
    assert "Modes" not in plate.caption
    assert answer_plates(make_result(cases=())) == []


def test_a_prediction_that_diverges_is_drawn_at_the_edge(make_result) -> None:
    case = make_result().cases[0]
    validation = replace(case.evaluation.validation, mrse_percent=np.array([np.nan, 1e9]))
    case = replace(case, evaluation=replace(case.evaluation, validation=validation))
    _, figure = drawn(make_result(cases=(case,)))
    (x,) = signs(figure.axes[0])
    assert x.tolist() == [1000.0, 1000.0]
    assert figure.axes[0].get_xlim()[1] == 1000.0


def test_lines_of_a_legend_keep_their_dash() -> None:
    handles = line_handles(["a", "b"], [("flown", INK), ("limit", INK, ":")])
    assert [h.get_linestyle() for h in handles[:2]] == ["-", ":"]
    assert handles[2].get_linestyle() != handles[3].get_linestyle()
