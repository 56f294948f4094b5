"""The figure of the first screen: every model and mode is drawn, and a prediction that diverges stays on the axes."""

from dataclasses import replace

import numpy as np
import pytest

from testbench.page.draw import styled
from testbench.page.figure import DOTTED, Chart, Curve, Panel, line_look
from testbench.questions.run.figures import answer_plates

pytestmark = pytest.mark.drawn


def drawn(result, wide: bool = True):
    (plate,) = answer_plates(result)
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
    x = np.arange(3.0)
    looks = [{}, {"dash": DOTTED}, line_look(0), line_look(1)]
    curves = [Curve(x=x, y=x, name=str(k), **look) for k, look in enumerate(looks)]
    (shown,) = styled(Chart([[Panel(draws=curves)]])).legends
    dashes = [
        line.get_linestyle() if k < 2 else line._unscaled_dash_pattern for k, line in enumerate(shown.get_lines())
    ]
    assert dashes[0] == "-"
    assert dashes[1] == "--"
    assert dashes[2] != dashes[3]
