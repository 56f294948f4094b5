"""Formulas of the gap workflow one by one: each against a value worked out another way."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm
from studies.blind import truths as boom_module
from studies.blind.servos import backlash, reluctant
from studies.blind.truths import RATE_HZ, boom

from testbench.core.constants import LBF_N
from testbench.core.record import FlightRecord
from testbench.effects import EFFECTS
from testbench.flight import FlightCondition, load_aircraft
from testbench.flight.air import turbulence_rms
from testbench.flight.executive import Executive
from testbench.questions.gap import figures, windows
from testbench.questions.gap.evidence.gust_filter import _felt
from testbench.questions.gap.new import shared_with
from testbench.questions.gap.open_set import accelerations
from testbench.questions.gap.starts import Directions

RNG = np.random.default_rng(12)


def test_a_boom_is_stepped_exactly_for_a_load_held_over_a_frame(monkeypatch):
    monkeypatch.setattr(boom_module, "load_aircraft", lambda *_: SimpleNamespace(design_V_m_s=20.0))
    f_hz, zeta, dt = 6.0, 0.07, 1.0 / RATE_HZ
    written = str(boom({"f_hz": f_hz, "zeta": zeta, "Cm": 0.1}, "any").changes)
    w = 2.0 * np.pi * f_hz
    exact = expm(np.array([[0.0, 1.0], [-(w**2), -2.0 * zeta * w]]) * dt)
    numbers = [float(x) for x in re.findall(r"<value>([^<]*)</value>", written)]
    for entry in exact.ravel():
        assert min(abs(np.array(numbers) - entry)) < 1e-9 * max(abs(entry), 1.0), entry


def test_a_unit_of_a_coefficient_accelerates_along_and_across_the_wind():
    n = SimpleNamespace
    alpha, m, S, qbar, b, c = 0.2, 3.0, 1.1, 150.0, 3.0, 0.4
    mass = n(mass_kg=m, Ixx=1.0, Iyy=2.0, Izz=2.5, Ixz=0.0)
    aircraft = n(mass=mass, geometry=n(S_m2=S, b_m=b, cbar_m=c))
    there = n(trimmed=n(alpha=alpha), aircraft=aircraft, condition=n(V_m_s=20.0, qbar_Pa=qbar))
    per = qbar * S / m
    drag, lift, side = (accelerations(there, name) for name in ("CD", "CL", "CY"))
    assert (drag["V"], lift["V"]) == pytest.approx((-per, 0.0))
    assert (drag["alpha"], lift["alpha"], side["beta"]) == pytest.approx((0.0, -per / 20.0, per / 20.0))
    assert (lift["u"], lift["w"]) == pytest.approx((per * np.sin(alpha), -per * np.cos(alpha)))
    moments = [accelerations(there, name)[rate] for name, rate in (("Cl", "p"), ("Cm", "q"), ("Cn", "r"))]
    assert moments == pytest.approx([qbar * S * b, qbar * S * c / 2.0, qbar * S * b / 2.5])


def test_turbulence_is_felt_along_the_body_axes_with_drydens_transverse_filter():
    theta = np.array([0.0, 0.3])
    E = _felt(("u", "v", "w", "q"), 50.0, theta)
    u, v, w = turbulence_rms(1.0, 50.0)
    lateral = np.array([np.sqrt(3.0), 1.0 - np.sqrt(3.0)])
    np.testing.assert_allclose(E[0], [[u, 0, 0, 0, 0], [0, *(v * lateral), 0, 0], [0, 0, 0, *(w * lateral)], [0] * 5])
    wind = E[0][[0, 2]]
    turned = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]]) @ wind
    np.testing.assert_allclose(E[1][[0, 2]], turned)
    np.testing.assert_allclose(E[1][1], E[0][1])


def test_a_free_start_takes_out_of_residuals_what_its_covariance_whitens():
    G = RNG.normal(size=(30, 3)) * [3.0, 1.0, 0.1]
    U, s, Vt = np.linalg.svd(G, full_matrices=False)
    found, r = Directions(U, s, Vt), RNG.normal(size=(15, 2))
    Q = np.linalg.inv(np.eye(30) + G @ G.T)
    values, vectors = np.linalg.eigh(Q)
    root = (vectors * np.sqrt(values)) @ vectors.T
    np.testing.assert_allclose(found.taken_out(r), (root @ r.ravel()).reshape(15, 2), rtol=1e-9, atol=1e-12)
    assert found.lost == pytest.approx(np.trace(np.eye(30) - Q))
    np.testing.assert_allclose(found.best(r), np.linalg.solve(G.T @ G + np.eye(3), G.T @ r.ravel()), rtol=1e-9)
    far = 1e3 * G @ np.ones(3)
    assert np.max(np.abs(found.best(far.reshape(15, 2)))) < np.max(
        np.abs(np.linalg.solve(G.T @ G + np.eye(3), G.T @ far))
    )


def test_play_and_a_reluctant_servo_follow_what_exceeds_their_band():
    u = np.array([0.0, 0.1, 0.4, 0.4, 0.3, -0.2, -0.2])
    np.testing.assert_allclose(backlash(0.2)(u, 0.01), [0.0, 0.0, 0.3, 0.3, 0.3, -0.1, -0.1], atol=1e-12)
    step = np.r_[0.0, np.full(4000, 0.5)]
    for sign in (1.0, -1.0):
        out = reluctant(20.0, 0.1)(sign * step, 0.005)
        assert out[-1] == pytest.approx(sign * 0.4)  # it stops where the error is the band
        k = np.arange(200, 260)
        np.testing.assert_allclose(np.diff(np.log(0.4 - sign * out[20:40])), -20.0 * 0.005, rtol=0.01)
        assert np.all(np.abs(out[k]) <= 0.4)
    assert not np.any(reluctant(20.0, 0.1)(0.09 * np.sin(np.arange(300.0)), 0.005) - 0.0)


def record(sha: str | None, span: tuple[float, float] | None) -> FlightRecord:
    of = {} if sha is None else {"sha256": sha, "cut_from_record_s": span}
    return FlightRecord(np.arange(3.0), ("q",), np.zeros((3, 1)), "measured", provenance=of)


def test_what_two_records_share_of_one_log_is_counted_in_its_seconds():
    records = {"a": record("x", (0.0, 10.0)), "b": record("x", (7.5, 20.0)), "c": record("x", (10.0, 12.0)),
               "d": record("y", (0.0, 10.0)), "e": record(None, None)}  # fmt: skip
    assert "it shares 2.5 s of its log with 'b', where" in shared_with("a", records)
    assert "it shares 2.5 s of its log with 'a', 2 s of its log with 'c', where" in shared_with("b", records)
    assert shared_with("d", records) == ""
    assert shared_with("e", records) == ""


@pytest.mark.parametrize("scale", [0.7, 1.3])
def test_a_foreign_model_accelerates_by_the_thrust_that_a_scale_adds(scale):
    """m (udot' - udot) = (s - 1) T in body axes, at one state and one throttle; the F-16's thrust is along its nose."""
    aircraft = load_aircraft("jsbsim:f16")
    stronger, _ = EFFECTS["thrust_scale"].amend(aircraft, None, {"scale": scale})
    at, thrust = [], 0.0
    for each in (aircraft, stronger):
        fdm = Executive(each, each.rate_hz, FlightCondition(150.0, 1000.0))
        fdm.command({"thr": 0.4})
        fdm.place(1000.0, 0.05, 0.0, (150.0, 0.0, 7.5))
        fdm.evaluate(to_rest=True)
        at.append(fdm.get("accelerations/udot-ft_sec2"))
        thrust, slugs = fdm.get("forces/fbx-prop-lbs"), fdm.get("inertia/mass-slugs")
    assert thrust * LBF_N > 5000.0
    assert slugs * (at[1] - at[0]) == pytest.approx((scale - 1.0) * thrust, rel=1e-6)


def test_a_reading_leaves_no_start_less_sure_than_none():
    for name, (measured, other) in windows._FROM_TRIM.items():
        assert 0.0 < measured <= other, name


def test_a_history_shows_predictions_in_the_unit_of_its_axis():
    """Angles in degrees, speeds in m/s: the believed model's line and the amended one's, sample by sample."""
    outputs = ("q", "V")
    record = FlightRecord(0.02 * np.arange(50), outputs, RNG.normal(size=(50, 2)), "measured")
    before, after, energies = RNG.normal(size=(50, 2)), RNG.normal(size=(50, 2)), np.ones(2)
    shrink = SimpleNamespace(
        record=record, before=before, after=after, energy_before=energies, energy_after=energies, manoeuvre="again"
    )
    result = SimpleNamespace(finding=SimpleNamespace(believed=SimpleNamespace(outputs=outputs)))
    panels = figures._history_plate(result, shrink, 1).make(True).axes[:2]
    for i, (axes, factor) in enumerate(zip(panels, (180.0 / np.pi, 1.0), strict=True)):
        drawn = [np.asarray(line.get_ydata()) for line in axes.lines]
        for wanted in (before, after):
            same = [y for y in drawn if y.shape == (50,) and np.allclose(y, factor * wanted[:, i], rtol=1e-12)]
            assert len(same) == 1
