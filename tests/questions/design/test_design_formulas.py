"""Formulas of the design one by one: each against a value worked out another way."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import ValidationError

from testbench.core.record import FlightRecord
from testbench.design.candidates import _tidy
from testbench.design.identified import _product, _sum
from testbench.design.limits import Envelope
from testbench.design.problem import _flights
from testbench.design.realise import Errors, repeats
from testbench.flight import LinearModel
from testbench.information.aircraft_structure import felt_by
from testbench.page.tables import Column, Table
from testbench.questions.design import page
from testbench.questions.design.page import limit_symbol
from testbench.questions.design.pose import _input_rate
from testbench.questions.design.scenario import DesignLimits
from testbench.sensors.sensor import ROTATION, Sensor, lever


@pytest.mark.parametrize(
    ("suite_hz", "simulation_hz", "wanted_hz", "rate_hz"),
    [(8.0, 480.0, 200.0, 240.0), (8.0, 480.0, 240.0, 240.0), (100.0, 500.0, 101.0, 500.0), (50.0, 500.0, 1e4, 500.0)],
)
def test_inputs_have_the_lowest_rate_that_divides_and_is_divided(suite_hz, simulation_hz, wanted_hz, rate_hz):
    assert _input_rate(suite_hz, simulation_hz, wanted_hz) == rate_hz


def test_linear_accelerations_move_to_the_accelerometers_as_those_of_a_rigid_body():
    outputs = ("ax", "ay", "az", *ROTATION)
    rng = np.random.default_rng(2)
    C, D = rng.normal(size=(9, 4)), rng.normal(size=(9, 1))
    model = LinearModel(np.zeros((4, 4)), np.zeros((4, 1)), C, D, ("a", "b", "c", "d"), ("de",), outputs)
    place = (0.4, -0.3, 0.2)
    moved = felt_by([*(Sensor(n, position_m=place) for n in ("ax", "ay", "az")), Sensor("q")], model, {})
    for old, new in ((C, moved.C), (D, moved.D)):
        rotation = np.zeros((old.shape[1], 6))
        rotation[:, 3:] = old[6:].T  # products of rates are of second order
        np.testing.assert_allclose(new[:3], old[:3] + lever(rotation, place).T)
        np.testing.assert_allclose(new[3:], old[3:])


@pytest.mark.parametrize("key", ["load_factor", "alpha_deg"])
def test_a_band_of_limits_rises(key):
    assert getattr(DesignLimits(**{key: (-0.5, 2.0)}), key) == (-0.5, 2.0)
    for band in ((2.0, -0.5), (1.0, 1.0)):
        with pytest.raises(ValidationError, match=rf"{key}\s+Value error, low < high must hold"):
            DesignLimits(**{key: band})


def test_times_are_rounded_up_to_what_a_person_would_write():
    assert [_tidy(x) for x in (0.1, 0.1001, 0.0999, 1.0 / 3.0, 2.0)] == [0.1, 0.101, 0.1, 0.334, 2.0]


def test_a_row_of_terms_is_written_as_a_sum():
    assert _sum([{"": 1.0}, {"": 0.0}, {"": -2.0, "M_q": 1.0}], ["a", "b", "c"]).startswith("a + (")
    text = _sum([{"": 1.5}, {"M_q": 1.0}, {"": -2.0, "M_q": 3.0, "a*b": -1.0}], ["x", "y", "z"])
    values = {"x": 0.3, "y": -0.7, "z": 1.1, "M_q": 2.3, "a": 0.9, "b": -1.7}
    expected = 1.5 * 0.3 + 2.3 * -0.7 + (-2.0 + 3.0 * 2.3 - 0.9 * -1.7) * 1.1
    assert eval(text, {"__builtins__": {}}, values) == pytest.approx(expected)
    assert _sum([{"": 0.0}], ["x"]) == "0*x"
    assert _product(1.0, "M_q") == "M_q"


@pytest.mark.parametrize(
    ("cost", "off", "flights"),
    [(0.8, 0.0, 1), (1.5, 0.0, 3), (2.0, 0.0, 4), (1.5, 0.8, 7), (1.5, 1.0, 0), (np.inf, 0.0, 0)],
)
def test_flights_that_reach_the_wanted_errors_scatter_less_and_keep_what_they_are_off_by(cost, off, flights):
    """cost^2 / N + off^2 <= 1 in the worst target."""
    targets = SimpleNamespace(gradient=np.array([[1.0, 0.0], [0.0, 0.5]]))
    problem = SimpleNamespace(cost_of=lambda M: cost, known=None, targets=targets)
    design = SimpleNamespace(information=np.eye(2), off=np.array([off, 0.0]))
    assert _flights(problem, design) == flights
    if flights > 0:
        assert cost**2 / flights + off**2 <= 1.0 + 1e-9
        assert flights == 1 or cost**2 / (flights - 1) + off**2 > 1.0
    problem.known = np.eye(2)
    assert _flights(problem, design) == 0


def test_repeats_grow_with_the_flights_and_are_never_more_than_they():
    assert [repeats(n) for n in (1, 2)] == [1, 2]
    assert all(0 < repeats(n) <= n for n in range(1, 200))
    assert repeats(10_000) / 10_000 == pytest.approx(repeats(1000) / 1000, rel=0.01)
    assert repeats(10_000) < 10_000


def test_the_rate_of_a_servo_may_be_its_limit_and_no_more():
    t = np.arange(5.0)
    command = np.array([0.0, 0.25, -0.25, 0.125, 0.0])
    record = FlightRecord(t, ("de_cmd", "de"), np.column_stack([command, 0.0 * t]), "truth")
    for most, broken in ((1.0, 0), (0.99, 1)):  # 4 / s times 0.25 rad
        found = Envelope({}, {"de": (4.0, most)}, {}).broken(record)
        assert len(found) == broken
        assert all("at t = 1.00 s" in text for text in found)


def test_errors_over_no_flight_are_unknown_for_every_target():
    none = Errors(np.zeros((0, 3)), np.zeros((0, 3)), ("lost",))
    assert none.n == 0
    for found in (none.rms, none.bias):
        assert found.shape == (3,)
        assert np.isnan(found).all()
    some = Errors(np.array([[1.0, -2.0], [3.0, 2.0]] * 10), np.ones((20, 2)), ())
    np.testing.assert_allclose(some.bias, [2.0, 0.0])
    np.testing.assert_allclose(some.rms, [np.sqrt(5.0), 2.0])


def test_on_a_terminal_units_stand_beside_the_targets_and_no_cell_moves(monkeypatch):
    keys = ("target", "low", "median", "unit", "high", "wanted", "counts", "failed", "last")
    rows = (("M_q", 1, 2, "1/s", 3, 4, 5, 0, "x"), ("gain", 6, 7, "", 8, 9, 10, 0, "y"))
    whole = Table("realised", "t", "c", tuple(Column(k, k) for k in keys), rows)
    monkeypatch.setattr(page, "realised_table", lambda result: whole)
    short = page.short_realised(None)
    assert [c.key for c in short.columns] == ["target", "median", "last"]
    assert [tuple(row) for row in short.rows] == [("M_q, 1/s", 2, "x"), ("gain", 7, "y")]
    failed = replace(whole, rows=(("M_q", 1, 2, "1/s", 3, 4, 5, 2, "x"),))
    monkeypatch.setattr(page, "realised_table", lambda result: failed)
    assert [tuple(row) for row in page.short_realised(None).rows] == [("M_q, 1/s", 2, 2, "x")]


def test_limits_have_the_symbols_of_their_channels():
    assert limit_symbol("az") == "load factor"
    assert limit_symbol("") == "aborted"
    for kind in ("rate of ", "command of "):
        assert limit_symbol(f"{kind}de") == kind + limit_symbol("de")
