"""The envelope: which speeds fly, modes named and followed, onset of instability, derivatives."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from testbench.aircraft.elastic import with_wake
from testbench.core.errors import ModelError, TrimError
from testbench.core.paths import aircraft_names
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.evaluation.envelope import Envelope, _followed, _varied, fly_envelope
from testbench.evaluation.modes import follow, longitudinal_modes, name_modes, poles_of, spectrum
from testbench.flight import FlightCondition, LinearModel, linearise, load_aircraft, trim
from testbench.questions.aircraft.ask import SpeedRange, speed_range, survey

LATERAL = ("v", "p", "r", "phi")


def pair(wn: float, zeta: float) -> np.ndarray:
    """Oscillator of position and velocity."""
    return np.array([[0.0, 1.0], [-(wn**2), -2.0 * zeta * wn]])


def system(states: tuple[str, ...], *blocks: tuple[tuple[str, ...], np.ndarray]) -> LinearModel:
    """Return a model of uncoupled blocks, each on its own states."""
    A = np.zeros((len(states), len(states)))
    for names, block in blocks:
        rows = [states.index(n) for n in names]
        A[np.ix_(rows, rows)] = block
    n = len(states)
    return LinearModel(A, np.zeros((n, 1)), np.zeros((1, n)), np.zeros((1, 1)), states, ("de",), ("q",))


def lateral(dutch: np.ndarray, roll: np.ndarray) -> LinearModel:
    return system(LATERAL, (("v", "r"), dutch), (("phi", "p"), roll))


# --- naming -----------------------------------------------------------------------------------------------------------


def named(model: LinearModel, motion: str = "lateral-directional", elastic: dict[int, str] | None = None):
    found = spectrum(model, motion, elastic or {})
    return {name: poles_of(found, owned) for name, owned in name_modes(found, elastic or {}).items()}


def test_dutch_roll_roll_and_spiral_are_told_apart():
    modes = named(lateral(pair(2.0, 0.1), np.diag([-0.01, -8.0])))
    assert modes["Dutch roll"] == (pytest.approx(complex(-0.2, 2.0 * np.sqrt(0.99))),)
    assert modes["roll"] == (pytest.approx(-8.0),)
    assert modes["spiral"] == (pytest.approx(-0.01),)


def test_roll_and_spiral_joined_in_one_pair_are_not_taken_for_the_dutch_roll():
    modes = named(lateral(pair(1.0, 0.1), pair(3.0, 0.5)))
    assert abs(modes["Dutch roll"][0]) == pytest.approx(1.0)
    assert abs(modes["roll"][0]) == pytest.approx(3.0) == abs(modes["spiral"][0])


def test_an_overdamped_dutch_roll_keeps_both_roots():
    modes = named(lateral(np.diag([-1.0, -3.0]), np.diag([0.02, -9.0])))
    assert sorted(s.real for s in modes["Dutch roll"]) == pytest.approx([-3.0, -1.0])
    assert modes["spiral"] == (pytest.approx(0.02),)


def test_phugoid_and_short_period_are_told_by_their_shape_whichever_is_faster():
    """Speed and pitch against heave and pitch rate: as of models whose propeller damps the speed more than the wing."""
    states = ("u", "w", "q", "theta")
    fast = system(states, (("u", "theta"), np.diag([-65.0, -0.2])), (("w", "q"), pair(3.0, 0.5)))
    modes = named(fast, "longitudinal")
    assert sorted(s.real for s in modes["phugoid"]) == pytest.approx([-65.0, -0.2])
    assert abs(modes["short period"][0]) == pytest.approx(3.0)
    overdamped = system(states, (("u", "theta"), np.diag([-4.0, -0.2])), (("w", "q"), np.diag([-1.0, -9.0])))
    assert set(longitudinal_modes(overdamped, {})) == {
        f"{mode}, {root} root" for mode in ("phugoid", "short period") for root in ("slow", "fast")
    }
    assert longitudinal_modes(overdamped, {})["short period, slow root"] == pytest.approx(-1.0)
    # Statically unstable: roots of w and q on both sides of the pair of speed and pitch, which stays together.
    unstable = system(states, (("u", "theta"), pair(1.5, 0.66)), (("w", "q"), np.diag([0.7, -65.0])))
    assert set(longitudinal_modes(unstable, {})) == {"phugoid", "short period, slow root", "short period, fast root"}


def test_elastic_modes_are_named_by_their_own_states():
    states = (*LATERAL, "eta_2", "etadot_2", "eta_5", "etadot_5")
    blocks = [(("v", "r"), pair(2.0, 0.1)), (("phi", "p"), np.diag([-0.01, -8.0]))]
    slow_second = [(("eta_2", "etadot_2"), pair(30.0, 0.02)), (("eta_5", "etadot_5"), pair(10.0, 0.02))]
    modes = named(system(states, *blocks, *slow_second), elastic={2: "bending", 5: "torsion"})
    assert abs(modes["bending"][0]) == pytest.approx(30.0)
    assert abs(modes["torsion"][0]) == pytest.approx(10.0)
    with pytest.raises(ModelError, match="eigenvalues"):
        name_modes(spectrum(system(states, *blocks), "lateral-directional", {2: "bending"}), {})


def test_names_of_the_aircraft_agree_with_those_of_the_identification(eolo, eolo_trim):
    model = linearise(eolo, eolo_trim)
    elastic = {i: m.name for i, m in enumerate(eolo.elastic.modes, 1) if m.symmetry == "symmetric"}
    expected = longitudinal_modes(model, elastic)
    for name, poles in named(model, "longitudinal", elastic).items():
        if name in expected:
            assert poles == (pytest.approx(expected[name]),)
    assert set(elastic.values()) <= set(expected)


# --- following --------------------------------------------------------------------------------------------------------


def test_names_follow_the_motion_through_a_crossing_of_frequencies():
    states = (*LATERAL, "eta_1", "etadot_1", "eta_2", "etadot_2")
    elastic = {1: "falling", 2: "rising"}

    def at(x: float) -> LinearModel:
        T = np.eye(4) + 0.05 * np.arange(16.0).reshape(4, 4) / 16.0  # couples the coordinates, not the modes
        A = np.zeros((4, 4))
        A[:2, :2], A[2:, 2:] = pair(30.0 - 10.0 * x, 0.02), pair(20.0 + 10.0 * x, 0.04)
        rigid = [(("v", "r"), pair(2.0, 0.1)), (("phi", "p"), np.diag([-0.01, -8.0]))]
        return system(states, *rigid, (states[4:], np.linalg.solve(T, A @ T)))

    found = [spectrum(at(x), "lateral-directional", elastic) for x in np.linspace(0.0, 1.0, 12)]
    owners = name_modes(found[0], elastic)
    for before, after in pairwise(found):
        owners = follow(before, owners, after)
    assert abs(poles_of(found[-1], owners["falling"])[0]) == pytest.approx(20.0)
    assert abs(poles_of(found[-1], owners["rising"])[0]) == pytest.approx(30.0)


def test_modes_are_followed_from_the_middle_to_both_ends():
    """Each of three modes keeps its eigenvector; their frequencies change places between the ends."""
    elastic = {1: "a", 2: "b", 3: "c"}
    states = (*LATERAL, *(f"{kind}_{i}" for kind in ("eta", "etadot") for i in elastic))
    turn = [np.array([[np.cos(x), np.sin(x)], [-np.sin(x), np.cos(x)]]) for x in np.linspace(-1.2, 1.2, 13)]
    frequencies = {1: lambda k: 20.0 + 0.5 * k, 2: lambda k: 26.0 - 0.5 * k, 3: lambda k: 40.0}

    def at(k: int):
        T = np.eye(6)  # the states of modes 1 and 2 turn into each other, both ways from the middle
        for first in (0, 3):
            T[np.ix_([first, first + 1], [first, first + 1])] = turn[k]
        A = np.zeros((6, 6))
        for i, wn in frequencies.items():
            A[np.ix_([i - 1, i + 2], [i - 1, i + 2])] = pair(wn(k), 0.02)
        rigid = [(("v", "r"), pair(2.0, 0.1)), (("phi", "p"), np.diag([-0.01, -8.0]))]
        return spectrum(system(states, *rigid, (states[4:], T.T @ A @ T)), "lateral-directional", elastic)

    found = [at(k) for k in range(13)]
    for start in (5, 6, 7):
        owners = _followed(found, elastic, start)
        for k, owned in enumerate(owners):
            for i, name in elastic.items():
                assert abs(poles_of(found[k], owned[name])[0]) == pytest.approx(frequencies[i](k)), (start, k, name)


def test_a_pair_that_splits_into_real_roots_and_joins_again_keeps_its_name():
    damping = [0.8, 0.95, 1.05, 1.3, 1.05, 0.95]
    found = [
        spectrum(lateral(pair(2.0, z), np.diag([-0.01, -30.0])), "lateral-directional", {}) for z in damping
    ]  # fmt: skip
    owners = name_modes(found[0], {})
    counts = []
    for before, after in pairwise(found):
        owners = follow(before, owners, after)
        counts.append(len(poles_of(after, owners["Dutch roll"])))
        assert np.prod(poles_of(after, owners["Dutch roll"])).real == pytest.approx(4.0) or counts[-1] == 1
        assert poles_of(after, owners["spiral"]) == (pytest.approx(-0.01),)
    assert counts == [1, 2, 2, 2, 1]


@pytest.fixture(scope="module", params=aircraft_names())
def flown(request):
    aircraft = load_aircraft(request.param)
    V = aircraft.design_V_m_s
    return fly_envelope(aircraft, [*np.linspace(0.95 * V, 1.2 * V, 6), V, V])


def test_every_pole_has_one_name_at_every_speed(flown):
    for model, poles in zip(flown.models, flown.poles, strict=True):
        for motion, symmetry in (("longitudinal", "symmetric"), ("lateral-directional", "asymmetric")):
            modes = flown.aircraft.elastic.modes if flown.aircraft.elastic else ()
            members = {i: m.name for i, m in enumerate(modes, 1) if m.symmetry == symmetry}
            every = spectrum(model, motion, members).poles
            mine = [s for n, found in poles.items() if flown.motion[n] == motion for s in found]
            both = sorted([*mine, *(s.conjugate() for s in mine if s.imag > 1e-9)], key=lambda s: (s.real, s.imag))
            # Where two modes share a joined pair (roll and spiral) it is listed under both names.
            assert len(both) >= every.size
            assert max(np.min(np.abs(every - s)) for s in both) < 1e-9
            assert max(np.min(np.abs(np.array(both) - s)) for s in every) < 1e-9
    assert {"phugoid", "short period", "Dutch roll", "roll", "spiral"} <= set(flown.motion)


def test_speeds_are_sorted_once_each_and_the_design_speed_found(flown):
    assert list(flown.speeds) == sorted(set(flown.speeds))
    assert flown.speeds[flown.design] == flown.aircraft.design_V_m_s
    f, zeta = flown.history("short period")
    assert f.shape == zeta.shape == (len(flown.speeds), 2)
    assert np.isfinite(f[:, 0]).all()


# --- onset ------------------------------------------------------------------------------------------------------------


def made_of(taurus, *poles: complex) -> Envelope:
    """Return an envelope at 10, 12, 14 ... m/s of one elastic mode with these poles."""
    speeds = tuple(10.0 + 2.0 * k for k in range(len(poles)))
    found = tuple({"bending": (s,)} for s in poles)
    return Envelope(taurus, 0.0, speeds, (), (), found, {"bending": "longitudinal"}, {"bending": 1})


def test_onset_of_flutter_is_interpolated_in_damping(taurus):
    wn = 10.0
    s = [complex(-z * wn, wn * np.sqrt(1.0 - z * z)) for z in (0.05, 0.03, -0.01)]
    onset = made_of(taurus, *s).onset("bending")
    assert onset.V_m_s == pytest.approx(12.0 + 2.0 * 0.03 / 0.04)
    assert onset.f_hz == pytest.approx(wn / (2.0 * np.pi))
    assert onset.kind == "flutter"
    assert "unstable from 13.5 m/s (flutter at 1.59 Hz)" in onset.sentence


def test_an_onset_has_the_band_of_what_moves_it_and_that_of_air_that_lags(taurus):
    """Priors that move the onset from 13.5 to 13 and to 14 m/s make a deviation of 0.7 m/s."""

    def column(*zetas: float) -> list[complex]:
        return [complex(-10.0 * z, 10.0) for z in zetas]

    flown = np.array([column(0.05, 0.03, -0.01), column(0.05, 0.02, -0.02), column(0.05, 0.03, 0.0)]).T
    lagging = np.array([column(0.06, 0.05, 0.04)]).T
    envelope = replace(made_of(taurus, *flown[:, 0]), varied={"bending": (flown, lagging)})
    onset = envelope.onset("bending")
    moved = (12.0 + 2.0 * 0.02 / 0.04, 14.0)
    assert onset.std_m_s == pytest.approx(np.hypot(*(V - onset.V_m_s for V in moved)), rel=1e-2)
    assert onset.wake.V_m_s is None
    assert "unstable from 13.5 ± 0.71 m/s (flutter at 1.59 Hz), in the quasi-steady air that flies; in air that" in (
        onset.sentence
    )
    assert onset.sentence.endswith("in air that lags none up to 14 m/s")


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_what_priors_move_is_what_another_aircraft_has(eolo, share):
    """The linear model that is varied is that of modes with these numbers; the lift of the rigid aircraft stays."""
    elastic, q, V = eolo.elastic, 200.0, 19.0
    n = len(elastic)
    states = tuple(f"{kind}_{i + 1}" for kind in ("eta", "etadot") for i in range(n))

    def matrix(modes):
        K, D, _ = modes.matrices(q, V)
        return np.block([[np.zeros((n, n)), np.eye(n)], [-K, -D]])

    found = list(_varied(matrix(elastic), states, elastic))
    assert len(found) == 3 * n + 1
    for A, _, modes in found:
        expected = np.linalg.eigvals(with_wake(matrix(modes), states, modes, q, V, share))
        moved = np.linalg.eigvals(with_wake(A, states, modes, q, V, share))
        assert np.sort_complex(moved) == pytest.approx(np.sort_complex(expected), rel=1e-6, abs=1e-6)


def test_onset_tells_divergence_stability_and_instability_from_the_start(taurus):
    diverging = made_of(taurus, -0.3 + 0j, 0.1 + 0j).onset("bending")
    assert (diverging.kind, diverging.V_m_s) == ("divergence", pytest.approx(11.5))
    stable = made_of(taurus, -0.3 + 5j, -0.1 + 5j).onset("bending")
    assert stable.V_m_s is None
    assert stable.sentence == "bending: none up to 12 m/s"
    early = made_of(taurus, 0.3 + 5j, -0.1 + 5j).onset("bending")
    assert early.at_start
    assert "already at 10 m/s" in early.sentence


# --- speeds -----------------------------------------------------------------------------------------------------------


def test_the_range_ends_where_trim_fails_or_the_limits_do(taurus):
    found = speed_range(taurus)
    low, high = taurus.limits["V"]
    assert low <= found.slowest < taurus.design_V_m_s < found.fastest <= high
    for V in (found.slowest, found.fastest):
        assert np.max(np.abs(trim(taurus, FlightCondition(V, taurus.design_h_m)).residual)) < 1e-9
    for refused in found.beyond:
        near = min(abs(refused.V_m_s - found.slowest), abs(refused.V_m_s - found.fastest))
        assert near == pytest.approx(found.step_m_s)
        with pytest.raises(TrimError):
            trim(taurus, FlightCondition(refused.V_m_s, taurus.design_h_m))


@pytest.mark.parametrize(("low", "high"), [(9.7, 26.2), (150.0, 260.0), (9.8, 10.0), (7.3, 41.9)])
def test_tabled_speeds_are_round_and_about_ten(low, high):
    V = SpeedRange(low, high, 0.1).tabled()
    assert (V[0], V[-1]) == (low, high)
    assert 9 <= len(V) <= 26
    assert min(np.diff(V)) > 0.0
    assert np.ptp(np.diff(V[1:-1])) < 1e-6


def test_speeds_that_cannot_be_flown_are_listed_with_the_reason(taurus):
    found = fly_envelope(taurus, [12.0, 100.0])
    assert found.speeds == (12.0,)
    assert [u.V_m_s for u in found.untrimmed] == [100.0]
    assert "100 m/s" in found.untrimmed[0].reason
    with pytest.raises(TrimError, match="must trim at one speed at least"):
        fly_envelope(taurus, [100.0])


def test_an_aircraft_that_flies_at_no_speed_is_refused(taurus):
    fixed = replace(taurus, controls={n: replace(c, full=1e-6) if n == "de" else c for n, c in taurus.controls.items()})
    with pytest.raises(TrimError, match="must trim at a speed within its limits"):
        speed_range(fixed)


@pytest.mark.slow
def test_a_survey_leaves_out_and_names_the_responses_that_cannot_be_flown(eolo):
    weak = replace(eolo, limits={**eolo.limits, "alpha": (eolo.limits["alpha"][0], 0.1)})
    found = survey(weak, "eolo")
    assert found.range.slowest <= eolo.design_V_m_s
    assert set(found.tabled) | set(found.responses) <= set(found.envelope.speeds)
    refused = {u.V_m_s for u in found.untrimmed}
    assert refused >= {u.V_m_s for u in found.range.beyond}
    assert set(found.responses) | (refused & {13.0, 16.0, 19.0, 22.0, 25.0}) == {13.0, 16.0, 19.0, 22.0, 25.0}
    assert len(found.responses) < 5  # 13 m/s needs more angle of attack than that


# --- derivatives ------------------------------------------------------------------------------------------------------


def test_derivatives_are_those_of_the_coefficients(taurus, taurus_trim):
    found = {d.name: d for d in dimensional_derivatives(linearise(taurus, taurus_trim), taurus_trim)}
    g, m, V = taurus.geometry, taurus.mass, 12.0
    c = taurus.coefficient
    qS = taurus_trim.state["qbar"] * g.S_m2
    drag = taurus_trim.state["thrust"] * np.cos(taurus_trim.alpha)  # against the flight: part of it is side force
    # Longitudinal ones feed back through alphadot, by a few per cent; JSBSim's inertias are off by 1e-4.
    expected = {
        "M_de": (qS * g.cbar_m * c("Cm_de") / m.Iyy, 0.05),
        "M_alpha": (qS * g.cbar_m * c("Cm_alpha") / m.Iyy, 0.05),
        "Z_de": (-qS * c("CL_de") / m.mass_kg, 0.05),
        "Y_beta": ((qS * c("CY_beta") - drag) / m.mass_kg, 1e-3),
        "Y_beta/V": ((qS * c("CY_beta") - drag) / m.mass_kg / V, 1e-3),
        "Y_r": (qS * g.b_m / (2.0 * V) * c("CY_r") / m.mass_kg, 1e-3),
        "L_p": (qS * g.b_m**2 / (2.0 * V) * c("Cl_p") / m.Ixx, 1e-3),
        "L_da": (qS * g.b_m * c("Cl_da") / m.Ixx, 1e-3),
    }
    for name, (value, tolerance) in expected.items():
        assert found[name].held == pytest.approx(value, rel=tolerance), name
        assert found[name].static is None
    assert found["M_q"].held < 0.0
    assert found["L_p"].held < 0.0
    assert found["X_thr"].held > 0.0


def test_frozen_modes_fly_like_rigid_wings_and_following_ones_do_not(eolo, eolo_trim):
    held = {d.name: d for d in dimensional_derivatives(linearise(eolo, eolo_trim), eolo_trim)}
    rigid = eolo.with_rigid_wings()
    at = trim(rigid, eolo_trim.condition)
    stiff = {d.name: d.held for d in dimensional_derivatives(linearise(rigid, at), at)}
    # The flexible aircraft trims at another alpha: derivatives of a linear lift curve differ by its cosine and drag.
    for name in ("M_alpha", "M_q", "M_de", "L_p", "L_da", "N_r"):
        assert held[name].held == pytest.approx(stiff[name], rel=0.03), name
    assert held["Z_alpha"].static != pytest.approx(held["Z_alpha"].held, rel=1e-3)
    assert held["M_q"].unit == "1/s"
