"""The response of a plan's manoeuvres by hand: limits in SI, factors on amplitudes, rates, bands and roughness."""

from types import SimpleNamespace

import numpy as np
import pytest

from testbench.core.constants import DEG_RAD
from testbench.core.errors import EstimationError, LimitError
from testbench.core.record import FlightRecord
from testbench.design.candidates import scaled
from testbench.design.limits import Limits
from testbench.information.targets import needed_parameters
from testbench.inputs import InputSignal
from testbench.questions.plan import repeats, response
from testbench.questions.plan.response import Flown, limits_of, log_rate_of, relative_spread
from testbench.questions.plan.scenario import PlanLimits, PlannedManoeuvre
from testbench.sensors import Sensor, SensorSuite

ENTRIES = [
    {"signal": "doublet", "control": "de", "amplitude_deg": 3.0, "period_s": 1.0},
    {"signal": "doublet", "control": "thr", "amplitude_percent": 20.0, "period_s": 1.0},
]


def stub(**values):
    return SimpleNamespace(**values)


def test_limits_become_those_of_a_flight_in_radians():
    stops = {"de": stub(low=-0.3, full=0.2), "da": stub(low=-0.1, full=0.4)}
    given = PlanLimits(
        deflection_deg={"da": 6.0}, rate_deg_s={"de": 90.0}, load_factor=(0.0, 2.0), alpha_deg=(-4.0, 8.0),
        beta_deg=5.0, speed_change_m_s=3.0, height_change_m=40.0, pitch_change_deg=20.0, bank_deg=30.0, V_min_m_s=9.0,
        V_max_m_s=25.0,
    )  # fmt: skip
    assert limits_of(given, stub(controls=stops), 30.0) == Limits(
        deflection={"de": 0.3, "da": 6.0 * DEG_RAD}, rate={"de": 90.0 * DEG_RAD}, load_factor=(0.0, 2.0),
        alpha=(-4.0 * DEG_RAD, 8.0 * DEG_RAD), beta=5.0 * DEG_RAD, speed_change_m_s=3.0, height_change_m=40.0,
        pitch_change=20.0 * DEG_RAD, bank=30.0 * DEG_RAD, V_max_m_s=25.0, V_min_m_s=9.0,
        throw={"de": (-0.3, 0.2), "da": (-0.1, 0.4)},
    )  # fmt: skip
    assert limits_of(given, stub(controls=stops), 18.0).V_max_m_s == 18.0  # what sets in first
    bare = limits_of(PlanLimits(), stub(controls=stops), None)
    assert (bare.V_max_m_s, bare.alpha, bare.beta) == (None, None, None)


def test_amplitudes_are_scaled_in_their_unit_and_rates_divide_that_of_the_simulator():
    inputs = PlannedManoeuvre(name="m", duration_s=5.0, repeats=1, input=ENTRIES).input
    de, thr = scaled(inputs, 0.25)
    assert (de.amplitude_deg, thr.amplitude_percent) == (0.75, 5.0)
    assert scaled(inputs, 1.0 / 3.0)[1].amplitude_percent == 6.666667
    assert [log_rate_of(rate) for rate in (50.0, 100.0, 120.0, 400.0, 401.0)] == [50.0, 100.0, 60.0, 100.0, 80.2]


def test_a_coefficient_s_own_uncertainty_counts_before_the_general_one():
    aircraft = stub(uncertainty={"Cm_alpha": 0.3, "CL_q": 0.2, "CD_de": 0.4, "Cn_r": 0.1, "Cl_p": 0.6, "CY_beta": 0.7})
    names = ("M_alpha", "Z_q", "X_de", "N_r", "L_p", "Y_beta", "M_q", "Z_alpha")
    assert relative_spread(names, aircraft, 0.05).tolist() == [0.3, 0.2, 0.4, 0.1, 0.6, 0.7, 0.05, 0.05]


def test_a_deflection_rate_beyond_its_limit_is_told_with_its_time_from_the_start_of_the_input():
    t, dt = 0.01 * np.arange(300), 0.01
    de = np.clip((t - 1.5) * 1.0, 0.0, 0.1)  # 1 rad/s from 1.5 s on
    record = FlightRecord(t, ("de", "da"), np.column_stack([de, 0.0 * de]), "truth")
    spec = stub(controls=("de", "da"), settle_s=1.0)
    assert record.dt_s == pytest.approx(dt)
    slow = Limits(deflection={}, rate={"de": 0.5, "da": 0.1})
    told = "the rate of de passes 28.6 deg/s at t = 0.51 s (extreme 57.3 deg/s)"
    assert response._too_fast(record, spec, slow) == [told]
    assert response._too_fast(record, spec, Limits(deflection={}, rate={"de": 1.1})) == []


def test_bisection_finds_the_largest_factor_of_64ths_and_refuses_below_a_twentieth(monkeypatch):
    flown = []

    def fly_at(together, tasks, factors):
        flown.append(len(tasks))
        return [t.error if t.error else Flown(None, factor, ("met",) if factor > t.most else ())
                for t, factor in zip(tasks, factors, strict=True)]  # fmt: skip

    monkeypatch.setattr(response, "fly_at", fly_at)
    monkeypatch.setattr(response, "_still", lambda together, task, met: ("still", met))
    refused, broken = LimitError("beyond the stop"), EstimationError("no flight")
    tasks = [stub(most=m, error=None) for m in (2.0, 0.4, 0.07, 0.05, 0.0)]
    tasks += [stub(most=0.0, error=e) for e in (refused, broken)]
    found = response.fly_within(None, tasks, scale=True)
    assert [(w.factor, w.flown.record, w.met) for w in found[:5]] == [
        (1.0, 1.0, ()), (25 / 64, 25 / 64, ("met",)), (4 / 64, 4 / 64, ("met",)), (0.0, 1.0, ("met",)),
        (0.0, 1.0, ("met",)),
    ]  # fmt: skip
    assert found[5:] == [("still", ("beyond the stop",)), broken]
    assert flown == [7, *[5] * 6]
    assert [w.factor for w in response.fly_within(None, tasks[:3], scale=False)] == [1.0, 0.0, 0.0]


def test_the_band_is_the_root_of_three_variances_and_its_input_that_of_the_flight(monkeypatch):
    given = {}

    def respond(structure, params, free, u, sampling, start):
        given.update(u=u.copy(), dt=sampling.dt_s)
        dparams = np.zeros((6, 4, 2))
        dparams[:, 1, 0], dparams[:, 1, 1] = 3.0, 2.0  # alpha
        return stub(dparams=dparams)

    structure = stub(states=("w", "q"), true=np.array([2.0, -4.0]))
    monkeypatch.setattr(response, "aircraft_structure", lambda *args: structure)
    monkeypatch.setattr(response, "parameter_names", lambda *args: ("M_alpha", "M_q"))
    monkeypatch.setattr(response, "respond", respond)
    signal = InputSignal([0.0, 0.1, 0.2], [[1.0], [2.0], [3.0]], ("de",))
    flown = stub(record=stub(t_s=0.1 * np.arange(6), dt_s=0.1), signal=signal)
    spec = stub(plane="longitudinal", controls=("de",), settle_s=0.2)
    point = stub(model=stub(commands=lambda controls: ("de_cmd",)), V_m_s=20.0, trimmed=stub(alpha=0.05))
    aircraft = stub(uncertainty={"Cm_q": 0.5})
    suite = stub(noise_std={"alpha": 0.6, "q": 0.3})
    monkeypatch.setattr(response, "elastic_modes", lambda aircraft, plane: ())
    band = response.expected_band(
        stub(uncertainty_percent=10.0), aircraft, suite, point, spec, flown, {"alpha": 0.8, "V": 2.0}
    )
    np.testing.assert_array_equal(given["u"][:, 0], [0.0, 0.0, 1.0, 2.0, 3.0, 0.0])
    assert given["dt"] == pytest.approx(0.1)
    by_derivatives = (3.0 * 0.1 * 2.0) ** 2 + (2.0 * 0.5 * 4.0) ** 2
    np.testing.assert_allclose(band["alpha"], 1.96 * np.sqrt(by_derivatives + 0.6**2 + 0.8**2))
    np.testing.assert_allclose(band["q"], 1.96 * 0.3)
    np.testing.assert_allclose(band["V"], 1.96 * 2.0)
    assert list(band) == ["V", "alpha", "q", "az"]


def test_roughness_is_the_rms_about_trim_in_the_turbulence_above_the_field():
    asked = []

    def job(task, signal, channels, air):
        asked.append((signal, channels, air))

    t, shown = 0.01 * np.arange(4), response.SHOWN["longitudinal"]
    rough = FlightRecord(t, shown, np.outer([1.0, -1.0, 1.0, -1.0], [0.3, 0.2, 0.1, 0.4]) + 7.0, "truth")
    state = dict.fromkeys(shown, 7.0)
    flier = stub(fly=lambda jobs: [rough])
    together = stub(job=job, signal=lambda task, factor: factor, flier=flier, aircraft=stub(name="a"))
    point = stub(h_m=350.0, label="20 m/s, 350 m", trimmed=stub(state=state))
    task = stub(point=point, spec=stub(plane="longitudinal", name="m"))
    scenario = stub(turbulence_rms_m_s=1.2, seed=4, timing=stub(field_m=50.0))
    (found,) = response.roughness(together, scenario, [task])
    assert found == {n: pytest.approx(s) for n, s in zip(shown, (0.3, 0.2, 0.1, 0.4), strict=True)}
    ((signal, channels, air),) = asked
    assert (signal, channels, air.height_m) == (0.0, shown, 300.0)
    assert response.roughness(together, stub(turbulence_rms_m_s=0.0), [task, task]) == [{}, {}]


def test_repeats_are_asked_of_the_sensors_that_count_with_all_that_moves_free(monkeypatch):
    given = {}

    def seen_by(sensors, aircraft, trimmed, model, plane, commands, free):
        given.update(shown=[s.channel for s in sensors], free=free)
        return stub(true=np.full(len(free), -2.0), moved=np.array([s.channel != "beta" for s in sensors]))

    def experiment(structure, sensors, dt_s, samples, stride):
        given.update(dt=dt_s, samples=samples, stride=stride)
        return stub(information=lambda u: given.update(u=u))

    monkeypatch.setattr(repeats, "seen_by", seen_by)
    monkeypatch.setattr(repeats, "Experiment", experiment)
    monkeypatch.setattr(repeats, "accuracy", lambda information: stub(std=np.full(len(given["free"]), 0.3)))
    wanted = {"Q3_de": 5.0, "M_eta5": 20.0, "omega_12": 15.0}
    spec = PlannedManoeuvre(name="m", duration_s=4.0, settle_s=1.0, accuracy_percent=wanted, input=ENTRIES[:1])
    sensors = (
        Sensor("alpha", noise_std=0.1), Sensor("q", quantum=0.01), Sensor("theta"), Sensor("beta", noise_std=0.1),
        Sensor("az", noise_std=0.1, position_m=(0.1, 0.0, 0.0)),
    )  # fmt: skip
    point = stub(
        model=stub(commands=lambda controls: controls, outputs=("alpha", "q", "theta", "beta", "az")), trimmed=None
    )
    count, reached = repeats.reach(None, point, spec, spec.input, SensorSuite("s", "", 20.0, sensors))
    assert given["shown"] == ["alpha", "q", "az"]
    assert given["free"][-1] == "M_eta5"  # wanted, and nothing that moves with the mode
    assert given["free"][:-1] == needed_parameters("longitudinal", ("de",), True, [3, 5, 12])
    assert (given["dt"], given["samples"], given["stride"]) == (pytest.approx(1.0 / 60.0), 100, 3)
    flown = repeats.commanded(spec.input, 4.0, 60.0, None).u[:, 0]
    np.testing.assert_array_equal(given["u"][:, 0], [*np.zeros(60), *flown[:240]])
    assert [r.one for r in reached] == pytest.approx([0.15] * 3)
    assert [r.needed for r in reached] == [9, 1, 1]
    assert count == 9


def test_modes_are_read_off_the_names_of_their_parameters():
    names = dict.fromkeys(("omega_2", "zeta_11", "Z_eta4", "Q7_eta3", "M_alpha", "Q5_de"), 0.1)
    assert repeats._numbers(names) == {2, 11, 4, 3}
