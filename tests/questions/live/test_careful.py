"""What a run says by filter error, beside the flight: right where least squares is biased, and gone with the flight."""

import os
import time
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from scipy.signal import cont2discrete

from testbench.core.record import FlightRecord
from testbench.estimators.parametric.recursive_fourier import InFlight
from testbench.estimators.parametric.structures.settings import Trim
from testbench.estimators.settings import RecursiveFourier
from testbench.questions.live.belief import Expected, structure_of
from testbench.questions.live.careful import Beside, Careful, Run, identified, without_known
from testbench.questions.live.stream import line_of, recorded

DT = 0.02
TRUE = {"Z_alpha": -54.0, "M_alpha": -43.0, "M_q": -11.0, "M_de": -64.0}
SAID = Careful("longitudinal", (0,), 0.0)


@cache
def expected():
    structure = structure_of("longitudinal", Trim(12.0, 0.1, 0.1), ("de",))
    at = np.array([TRUE.get(name, 0.0) for name in structure.parameter_names])
    return Expected(structure, at, np.zeros((0, at.size)), DT)


def flown(seed=0, vane=0.0044, gusts=(0.008, 0.15), known=None, ratio=1.0, offset=0.0):
    """A 3-2-1-1 of the elevator in gusts that turn the flow, and pitch; a vane with noise."""
    rng, n = np.random.default_rng(seed), 600
    s = expected().structure.matrices(expected().params)
    A, B, *_ = cont2discrete((s.A, np.hstack([s.B, np.eye(2)]), np.zeros((0, 2)), np.zeros((0, 3))), DT)
    u, x = np.zeros(n), np.zeros((n, 2))
    for begin, end, sign in ((50, 95, 1.0), (95, 125, -1.0), (125, 140, 1.0), (140, 155, -1.0)):
        u[begin:end] = sign * np.radians(3.0)
    known = np.zeros((n, 2)) if known is None else known
    for k in range(n - 1):
        push = np.concatenate([[0.5 * (u[k] + u[k + 1])], 0.5 * (known[k] + known[k + 1])])
        x[k + 1] = A @ x[k] + B @ push + np.sqrt(DT) * np.array(gusts) * rng.standard_normal(2)
    y = x + np.array([vane, 0.004 * (vane > 0.0)]) * rng.standard_normal((n, 2)) + offset
    record = FlightRecord(DT * np.arange(n), ("alpha", "q", "de"), np.column_stack([y, u]), "measured")
    return Run(0, 0.0, 12.0, record, known, np.full(n, ratio), False), x


def by_least_squares(runs):
    fit = InFlight(expected().structure, RecursiveFourier(band_hz=(0.1, 2.0), step_hz=0.04), DT)
    for run in runs:
        fit.begin()
        fit.add(run.record)
    return fit


def test_the_noise_of_a_vane_biases_least_squares_and_not_the_careful_estimate():
    runs = [flown(seed=seed)[0] for seed in range(3)]
    crude = dict(zip(by_least_squares(runs).names, by_least_squares(runs).fit().step, strict=True))
    start = replace(expected(), params=1.3 * expected().params)
    found = identified(start, runs, SAID)
    assert found.why == ""
    std = np.sqrt(np.diag(found.covariance))
    for name, value, error in zip(found.names, found.values, std, strict=True):
        if name in TRUE:
            assert abs(value - TRUE[name]) < 3.0 * error, name
            assert error < 0.08 * abs(TRUE[name]), name
    careful = dict(zip(found.names, found.values, strict=True))
    for name in ("M_q", "M_de"):
        assert abs(crude[name] / TRUE[name] - 1.0) > 0.25, name
        assert abs(careful[name] / TRUE[name] - 1.0) < 0.1, name


def test_what_turns_the_states_beside_the_equations_is_taken_out_exactly():
    t = DT * np.arange(600)
    known = np.column_stack([0.1 * np.sin(t), 0.5 * np.cos(2.0 * t)])
    known -= known[0]
    (run, _), (_, alone) = flown(vane=0.0, gusts=(0.0, 0.0), known=known), flown(vane=0.0, gusts=(0.0, 0.0))
    left = without_known(expected(), run, run.ratio)
    assert left.data[:, :2] == pytest.approx(alone, abs=1e-12)


def test_derivatives_are_given_at_the_trim_whatever_the_speed_of_the_run():
    run, _ = flown(seed=4)
    slow, fast = (
        identified(expected(), [run], SAID),
        identified(expected(), [replace(run, ratio=1.25 * run.ratio)], SAID),
    )
    by = dict(zip(slow.names, np.array(slow.values) / np.array(fast.values), strict=True))
    assert by["M_alpha"] == pytest.approx(1.25**2, rel=1e-6)
    assert by["M_q"] == pytest.approx(1.25, rel=1e-6)
    assert by["Z_alpha"] == pytest.approx(1.25, rel=1e-6)  # of force over airspeed


def test_offsets_of_readings_change_nothing():
    one, other = (identified(expected(), [flown(seed=2, offset=x)[0]], SAID) for x in (0.0, 0.05))
    assert one.values == pytest.approx(other.values, rel=2e-3)


def test_of_a_control_that_has_not_moved_nothing_is_known_and_the_rest_is():
    structure = structure_of("lateral", Trim(12.0, 0.1, 0.1), ("da", "dr"))
    at = {"Y_beta": -9.0, "L_beta": -15.0, "L_p": -12.0, "L_da": 59.0, "N_beta": 10.0, "N_r": -1.9, "N_da": -5.0,
          "N_dr": -30.0}  # fmt: skip
    here = Expected(structure, np.array([at.get(n, 0.0) for n in structure.parameter_names]), np.zeros((0, 1)), DT)
    rng, n = np.random.default_rng(0), 700
    s = structure.matrices(here.params)
    A, B, *_ = cont2discrete((s.A, np.hstack([s.B, np.eye(4)]), np.zeros((0, 4)), np.zeros((0, 6))), DT)
    u, x = np.zeros((n, 2)), np.zeros((n, 4))
    u[50:110, 0], u[110:170, 0] = 0.05, -0.05
    for k in range(n - 1):
        shaken = np.sqrt(DT) * np.array([0.02, 0.3, 0.1, 0.0]) * rng.standard_normal(4)
        x[k + 1] = A @ x[k] + B @ np.concatenate([0.5 * (u[k] + u[k + 1]), np.zeros(4)]) + shaken
    y = np.hstack([x + 0.003 * rng.standard_normal((n, 4)), u])
    record = FlightRecord(DT * np.arange(n), (*structure.states, "da", "dr"), y, "measured")
    run = Run(0, 0.0, 12.0, record, np.zeros((n, 4)), np.ones(n), False)
    assert "da" in run.moved
    assert "dr" not in run.moved
    found = identified(here, [run], replace(SAID, plane="lateral"))
    std = dict(zip(found.names, np.sqrt(np.diag(found.covariance)), strict=True))
    value = dict(zip(found.names, found.values, strict=True))
    assert std["N_dr"] > 1e6
    assert abs(value["L_da"] - 59.0) < 3.0 * std["L_da"] < 59.0
    fit = InFlight(structure, RecursiveFourier(band_hz=(0.1, 2.0), step_hz=0.04), DT)
    fit.begin()
    fit.add(record)
    crude = dict(zip(fit.names, np.sqrt(np.diag(fit.fit().corrected)), strict=True))
    assert crude["N_dr"] > 1e6
    assert crude["L_da"] < 59.0


def test_records_that_say_nothing_give_a_reason():
    run, _ = flown()
    still = replace(run, record=replace(run.record, data=np.zeros_like(run.record.data)))
    assert identified(expected(), [still], SAID).why


def test_what_stands_in_for_records_is_what_is_known_of_them():
    fit = by_least_squares([flown(seed=1)[0], flown(seed=2)[0]])
    alone = by_least_squares([flown(seed=2)[0]]).fit()
    n = len(fit.names)
    values, P = np.arange(1.0, n + 1.0), np.diag(np.arange(1.0, n + 1.0)) + 0.1
    fit.take_instead((0,), values, P)
    both = fit.fit()
    along = fit.fit_along(np.ones((2, 1)), np.zeros(n), np.full(n, 1e-9))
    assert along.step == pytest.approx(both.step, rel=1e-6)
    fit.take_instead((0,), values, 1e12 * P)
    assert fit.fit().step == pytest.approx(alone.step, rel=1e-4)
    fit.take_instead((0, 1), values, P)
    assert fit.fit().step == pytest.approx(values)
    assert fit.fit().corrected == pytest.approx(P)


def test_what_is_found_narrows_what_is_expected():
    params = expected().params
    wide = replace(expected(), directions=np.diag(0.3 * np.abs(params))[params != 0.0])
    at = np.flatnonzero(params != 0.0)
    same = wide.given(at, params[at], 1e6 * np.eye(at.size))
    assert same.params == pytest.approx(params)
    near = wide.given(at, 1.2 * params[at], 1e-9 * np.eye(at.size))
    assert near.params[at] == pytest.approx(1.2 * params[at], rel=0.02)
    spread = np.sqrt(np.diag(near.directions.T @ near.directions))[at]
    assert np.all(spread < 0.06 * np.abs(params[at]))


def test_a_line_of_a_recording_is_the_estimate_again(tmp_path):
    found = Careful("lateral", (1, 2), 3.25, ("L_p",), (-1.5,), ((0.01,),))
    (tmp_path / "stream.jsonl").write_text(line_of(found))
    assert list(recorded(tmp_path / "stream.jsonl")) == [found]


def _slowly(seconds):
    time.sleep(seconds)
    return replace(SAID, why=str(os.nice(0)))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are forked")
def test_the_process_beside_is_not_waited_for_has_low_priority_and_goes_with_the_flight():
    with Beside() as beside:
        beside.begin("one", partial(_slowly, 0.0))
        assert int(beside.take(True).why) >= 10
        beside.begin("one", partial(_slowly, 60.0))
        begun = time.monotonic()
        assert beside.take(False) is None
        assert time.monotonic() - begun < 0.2
        pid = beside._child.process.pid
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are forked")
def test_a_task_that_fails_is_lost_and_the_next_one_is_done():
    with Beside() as beside:
        beside.begin("one", partial(_slowly, "no time"))
        beside.begin("two", partial(_slowly, 0.0))
        assert beside.take(True).plane == "longitudinal"
        assert beside.take(True) is None
