"""Structures from a scenario's entry: the factory's own, for the channels and the trim of the records."""

import numpy as np
import pytest

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord
from testbench.estimators.parametric.structures import Trim, longitudinal
from testbench.estimators.parametric.structures.build import build
from testbench.estimators.settings import EquationErrorEntry, OutputErrorEntry
from testbench.estimators.structured import AirframeConstants

ALL = ("V", "alpha", "q", "theta", "beta", "p", "r", "phi")
AIRFRAME = AirframeConstants(
    mass_kg=7472.0,
    S_m2_per_kg=4.028e-3,
    S_cbar_over_Iyy_1_per_kg_m=8.0027e-4,
    cbar_m=2.43,
    V0_m_s=104.67,
    rho_kg_m3=0.792,
)


def record(**removed):
    provenance = {"prepared": {"removed": removed}} if removed else {}
    return FlightRecord(np.arange(3) * 0.1, ("de",), np.zeros((3, 1)), "measured", provenance=provenance)


def entry(structure="longitudinal", **settings):
    return OutputErrorEntry(method="output_error", structure=structure, **settings)


def test_the_trim_is_the_mean_of_what_was_removed():
    made = build(entry(), ("de",), ("V", "q"), [record(V=14.0, alpha=0.1, theta=0.06), record(V=16.0, alpha=0.12)])
    assert (made.trim.V, made.trim.theta) == (15.0, 0.06)
    assert made.trim.alpha == pytest.approx(0.11)
    expected = longitudinal(Trim(15.0, 0.11, 0.06), outputs=("V", "q"))
    for one, other in zip(made.matrices(made.values), expected.matrices(expected.values), strict=True):
        assert np.allclose(one, other, rtol=1e-12)


def test_a_trim_that_is_given_wins_and_level_flight_is_assumed_without_theta():
    made = build(entry(V_m_s=20.0, alpha_deg=3.0), ("de",), ("q",), [record(V=14.0, alpha=0.2)])
    assert (made.trim.V, made.trim.alpha) == (20.0, pytest.approx(np.radians(3.0)))
    assert made.trim.theta == made.trim.alpha
    only_theta = build(entry(V_m_s=20.0), ("de",), ("q",), [record(theta=0.05)])
    assert only_theta.trim.alpha == only_theta.trim.theta == 0.05


def test_a_trim_speed_must_be_known():
    with pytest.raises(EstimationError, match="needs the trim speed: give V_m_s"):
        build(entry(), ("de",), ("q",), [record()])


@pytest.mark.parametrize(
    ("structure", "settings", "inputs", "states", "outputs"),
    [
        ("short_period", {}, ("de_cmd",), ("alpha", "q"), ("alpha", "q")),
        ("longitudinal", {"V_m_s": 15.0}, ("de", "thr"), ("V", "alpha", "q", "theta"), ("V", "alpha", "q", "theta")),
        ("longitudinal", {"V_m_s": 15.0, "short": True}, ("de",), ("alpha", "q"), ("alpha", "q")),
        (
            "flexible",
            {"V_m_s": 15.0, "modes_hz": (4.0,)},
            ("de",),
            ("V", "alpha", "q", "theta", "eta_1", "etadot_1"),
            ("V", "alpha", "q", "theta"),
        ),
        (
            "flexible",
            {"V_m_s": 15.0, "modes_hz": (4.0,), "short": True},
            ("de",),
            ("alpha", "q", "eta_1", "etadot_1"),
            ("alpha", "q"),
        ),
        ("lateral_directional", {"V_m_s": 15.0}, ("da", "dr"), ("beta", "p", "r", "phi"), ("beta", "p", "r", "phi")),
        ("roll_yaw_rates", {}, ("da", "dr", "beta"), ("p", "r"), ("p", "r")),
        (
            "aerodynamic_longitudinal",
            {"airframe": AIRFRAME},
            ("de", "thrust"),
            ("V", "alpha", "theta", "q"),
            ("V", "alpha", "q", "theta"),
        ),
    ],
)
def test_every_structure_is_built_with_the_outputs_that_it_has(structure, settings, inputs, states, outputs):
    made = build(entry(structure, **settings), inputs, ALL, [record()])
    assert made.name == structure
    assert made.states == states
    assert made.outputs == outputs
    assert set(made.inputs) == set(inputs)


def test_outputs_that_are_named_are_taken_and_others_are_refused():
    made = build(entry(V_m_s=15.0, outputs=("q", "az")), ("de",), ("q",), [record()])
    assert made.outputs == ("q", "az")
    with pytest.raises(EstimationError, match="must be one of"):
        build(entry(V_m_s=15.0, outputs=("beta",)), ("de",), ("q",), [record()])
    with pytest.raises(EstimationError, match=r"has outputs V, alpha, q, .* but the identification senses beta, p"):
        build(entry(V_m_s=15.0), ("de",), ("beta", "p"), [record()])


def test_inputs_that_the_structure_needs_must_be_inputs():
    with pytest.raises(EstimationError, match="has one input, got de, thr"):
        build(entry("short_period"), ("de", "thr"), ("q",), [record()])
    with pytest.raises(EstimationError, match=r"is driven by .*thrust.* name them there"):
        build(entry("aerodynamic_longitudinal", airframe=AIRFRAME), ("de",), ("q",), [record()])


def test_parameters_are_started_fixed_bounded_and_believed():
    spec = entry(
        V_m_s=15.0,
        start={"M_q": -3.0, "X_q": 0.5},
        fixed=("M_0",),
        bounds={"M_alpha": (-50.0, 0.0)},
        prior_std={"Z_q": 2.0},
    )
    parameters = {p.name: p for p in build(spec, ("de",), ("q",), [record()]).parameters}
    assert (parameters["M_q"].value, parameters["M_q"].free) == (-3.0, True)
    assert (parameters["X_q"].value, parameters["X_q"].free) == (0.5, False)
    assert not parameters["M_0"].free
    assert (parameters["M_alpha"].low, parameters["M_alpha"].high) == (-50.0, 0.0)
    assert parameters["Z_q"].prior_std == 2.0
    only = EquationErrorEntry(method="equation_error", structure="longitudinal", V_m_s=15.0, free=("M_q",))
    assert [p.name for p in build(only, ("de",), ("q",), [record()]).parameters if p.free] == ["M_q"]
    with pytest.raises(EstimationError, match="did you mean 'M_q'"):
        build(entry(V_m_s=15.0, start={"M_qq": 1.0}), ("de",), ("q",), [record()])
