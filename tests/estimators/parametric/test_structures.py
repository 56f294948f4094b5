"""What every structure must do: exact derivatives, exact and Runge-Kutta responses that agree, settings refused."""

from dataclasses import dataclass

import numpy as np
import pytest
from parametric_cases import CASES, HFB, inputs, truth

from testbench.core.constants import G0_M_S2
from testbench.core.errors import ChannelError, EstimationError
from testbench.estimators.parametric.response import Sampling, _trajectory, respond, runge_kutta
from testbench.estimators.parametric.structure import LinearStructure, ModelStructure, Parameter
from testbench.estimators.parametric.structures import (
    STRUCTURES,
    Trim,
    aerodynamic_longitudinal,
    flexible,
    lateral_directional,
    lateral_per_speed,
    longitudinal,
    roll_yaw_rates,
    short_period,
)

EVERY = pytest.mark.parametrize("name", list(CASES))
LINEAR = [name for name, case in CASES.items() if isinstance(case.structure, LinearStructure)]


def test_every_structure_of_the_table_is_in_this_contract():
    assert set(CASES) == set(STRUCTURES)
    for name, family in STRUCTURES.items():
        assert family.description == family.description.strip() != ""
        assert CASES[name].structure.name == name


@EVERY
def test_true_values_name_every_free_parameter_that_is_not_zero(name):
    assert set(CASES[name].truth) <= set(CASES[name].structure.parameter_names)


@EVERY
def test_derivatives_by_complex_step_agree_with_central_differences(name):
    case = CASES[name]
    s, p, x, u = case.structure, truth(case), case.starts[1], inputs(case.structure, 20, 3)[7]
    exact = s.jacobians(x, u, p)
    at = [x, u, p]
    for which, (by_f, by_h) in enumerate(((exact.fx, exact.hx), (exact.fu, exact.hu), (exact.fp, exact.hp))):
        for j in range(at[which].size):
            step = 1e-5 * max(1.0, abs(at[which][j]))
            ends = []
            for sign in (1.0, -1.0):
                moved = [part.copy() for part in at]
                moved[which][j] += sign * step
                ends.append((s.derivative(*moved), s.output(*moved)))
            for k, column in enumerate((by_f[:, j], by_h[:, j])):
                difference = (ends[0][k] - ends[1][k]) / (2.0 * step)
                # rounding of the difference, 1e-16 |f| / step, and its third-order remainder
                assert column == pytest.approx(difference, rel=1e-6, abs=1e-9 * (1.0 + np.abs(ends[0][k]).max()))


@EVERY
def test_equations_hold_for_any_leading_axes(name):
    case = CASES[name]
    s, p, u = case.structure, truth(case), inputs(case.structure, 30, 4)
    x = case.starts[0] * (1.0 + 0.1 * np.random.default_rng(1).standard_normal((30, len(s.states))))
    for rows in ((30,), (5, 6)):
        at = x.reshape(*rows, -1), u.reshape(*rows, -1), np.broadcast_to(p, (*rows, p.size))
        f, h = s.derivative(*at).reshape(30, -1), s.output(*at).reshape(30, -1)
        for k in (0, 17):
            assert f[k] == pytest.approx(s.derivative(x[k], u[k], p), rel=1e-13, abs=1e-15)
            assert h[k] == pytest.approx(s.output(x[k], u[k], p), rel=1e-13, abs=1e-15)


@EVERY
@pytest.mark.parametrize("held", [False, True])
def test_sensitivities_agree_with_central_differences(name, held):
    case = CASES[name]
    s, p, x0, u = case.structure, truth(case), case.starts[0], inputs(case.structure, 120, 5)
    hold, free = np.full(u.shape[1], held), np.flatnonzero(s.free).tolist()
    exact = respond(s, p, free, u, Sampling(case.dt_s, hold), x0, biased=(0,))

    def outputs(params, start, shift):
        moved = u.copy()
        moved[:, 0] += shift
        return respond(s, params, (), moved, Sampling(case.dt_s, hold), start).y

    def check(column, plus, minus, step):
        difference = (plus - minus) / (2.0 * step)
        assert np.abs(column - difference).max() <= 1e-5 * np.abs(difference).max() + 1e-8 * np.abs(plus).max()

    for j, i in enumerate(free):
        step = 1e-4 * max(abs(p[i]), 0.1)
        e = step * np.eye(p.size)[i]
        check(exact.dparams[:, :, j], outputs(p + e, x0, 0.0), outputs(p - e, x0, 0.0), step)
    for j in range(x0.size):
        e = 1e-4 * np.eye(x0.size)[j]
        check(exact.dx0[:, :, j], outputs(p, x0 + e, 0.0), outputs(p, x0 - e, 0.0), 1e-4)
    check(exact.dbias[:, :, 0], outputs(p, x0, 1e-5), outputs(p, x0, -1e-5), 1e-5)


@dataclass(frozen=True, eq=False, kw_only=True)
class AsNonlinear(ModelStructure):
    """The equations of a linear structure, without anyone knowing that they are linear."""

    inner: LinearStructure

    def derivative(self, x, u, params):
        return self.inner.derivative(x, u, params)

    def output(self, x, u, params):
        return self.inner.output(x, u, params)


def disguised(s: LinearStructure) -> AsNonlinear:
    return AsNonlinear(
        name=s.name, states=s.states, inputs=s.inputs, outputs=s.outputs, parameters=s.parameters, inner=s
    )


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", LINEAR)
@pytest.mark.parametrize("held", [False, True])
def test_exact_and_runge_kutta_responses_of_the_same_equations_agree(name, held):
    case = CASES[name]
    s, p, x0, u = case.structure, truth(case), case.starts[0], inputs(case.structure, 150, 6)
    hold, free = np.full(u.shape[1], held), np.flatnonzero(s.free).tolist()
    exact = respond(s, p, free, u, Sampling(case.dt_s, hold), x0, biased=(0,))
    stepped = respond(disguised(s), p, free, u, Sampling(case.dt_s, hold, 8), x0, biased=(0,))
    for one, other in zip(exact, stepped, strict=True):
        # 8 steps of fourth order per sample of at most 0.4 rad of the fastest mode: (0.4 / 8)^4 / 120 = 5e-8 a sample
        assert one == pytest.approx(other, rel=1e-5, abs=1e-6 * np.abs(other).max())


def test_trajectory_found_at_once_is_the_one_run_sample_by_sample():
    case = CASES["aerodynamic_longitudinal"]
    s, p, u = case.structure, truth(case), inputs(case.structure, 600, 7)
    du = np.diff(u, axis=0, append=u[-1:])
    slow = np.tile(case.starts[0], (600, 1))
    for k in range(599):
        slow[k + 1] = runge_kutta(s, slow[k], u[k], du[k], p, case.dt_s, 2)
    off = slow * (1.0 + 0.1 * np.random.default_rng(3).standard_normal(slow.shape))
    off[0] = slow[0]
    lost = np.full_like(off, np.nan)
    lost[0] = slow[0]
    sampling = Sampling(case.dt_s, np.zeros(u.shape[1], bool), 2)
    for start in (case.starts[0], off, lost):
        x, transition = _trajectory(s, p, u, du, sampling, start)
        assert np.abs(x - slow).max(axis=0) == pytest.approx(0.0, abs=1e-9)
        assert transition.shape == (600, 4, 4)


def test_a_response_that_diverges_says_so_by_not_being_finite():
    case = CASES["aerodynamic_longitudinal"]
    wild = truth(case) * np.where(np.array(case.structure.parameter_names) == "Cm_alpha", -400.0, 1.0)
    r = respond(
        case.structure, wild, (0,), inputs(case.structure, 600, 7), Sampling(0.1, np.zeros(2, bool)), case.starts[0]
    )
    assert not np.isfinite(r.y).all()
    short = CASES["short_period"]
    p = truth(short).copy()
    p[list(short.structure.parameter_names).index("M_alpha")] = 1e9
    r = respond(
        short.structure, p, (0,), inputs(short.structure, 50, 7), Sampling(0.04, np.zeros(1, bool)), short.starts[0]
    )
    assert not np.isfinite(r.y).all()


def test_accelerometers_read_what_moving_them_off_the_centre_adds():
    base = {"trim": Trim(20.0, 0.1, 0.05), "outputs": ("ax", "az", "qdot")}
    at_cg, off = longitudinal(**base), longitudinal(**base, accelerometer=(0.4, -0.3))
    p = np.random.default_rng(2).standard_normal(len(at_cg.parameters))
    x, u = np.array([0.5, 0.02, 0.1, 0.03]), np.array([0.04])
    one, other = at_cg.output(x, u, p), off.output(x, u, p)
    assert other - one == pytest.approx([-0.3 * one[2], -0.4 * one[2], 0.0])
    base = {"trim": Trim(20.0, 0.1, 0.05), "outputs": ("ay", "pdot", "rdot")}
    at_cg, off = lateral_directional(**base), lateral_directional(**base, accelerometer=(0.4, -0.3))
    p = np.random.default_rng(2).standard_normal(len(at_cg.parameters))
    one, other = at_cg.output(x, np.ones(2), p), off.output(x, np.ones(2), p)
    assert other[0] - one[0] == pytest.approx(0.4 * one[2] + 0.3 * one[1])


def test_lateral_motion_per_speed_is_that_of_a_known_speed():
    V, alpha, theta = 20.0, 0.06, 0.04
    known = lateral_directional(Trim(V, alpha, theta), outputs=("beta", "p", "r", "phi")).with_parameters(
        {"Y_r": 0.5, "Y_dr": 3.0}
    )
    values = dict(zip(known.parameter_names, known.values, strict=True))
    per = {n: v / V if n[0] == "Y" else v for n, v in values.items() if n not in ("Y_p",)}
    per |= {"alpha_trim": np.sin(alpha), "theta_trim": np.tan(theta), "g_V": 9.80665 * np.cos(theta) / V}
    per["Y_r"] += 1.0 - np.cos(alpha)  # which it has for one
    other = lateral_per_speed().with_parameters(per)
    for one, two in zip(known.matrices(known.values), other.matrices(other.values), strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-12, atol=1e-15)


def test_longitudinal_equations_linearise_the_nonlinear_ones():
    """Dimensional derivatives from the coefficients by hand, against the linearised nonlinear structure."""
    case = CASES["aerodynamic_longitudinal"]
    nonlinear, p, v = case.structure, truth(case), case.truth
    a, V, alpha = HFB, 104.0, 0.115
    de, T = 0.0, 11500.0
    # theta for which the flight is steady along the path does not exist in general: linearise where it is, forces kept
    theta = 0.10
    x, u = np.array([V, alpha, theta, 0.0]), np.array([de, T])
    j = nonlinear.jacobians(x, u, p)
    S = 0.5 * a.rho_kg_m3 * a.S_m2_per_kg
    CD = v["CD_0"] + v["CD_V"] * V / a.V0_m_s + v["CD_alpha"] * alpha
    sigma = alpha + a.thrust_angle_rad
    Vdot_V = -S * (2.0 * V * CD + V**2 * v["CD_V"] / a.V0_m_s)
    Vdot_alpha = -S * V**2 * v["CD_alpha"] - T / a.mass_kg * np.sin(sigma) + G0_M_S2 * np.cos(alpha - theta)
    qdot_q = 0.5 * a.rho_kg_m3 * a.S_cbar_over_Iyy_1_per_kg_m * V**2 * v["Cm_q"] * a.cbar_m / (2.0 * a.V0_m_s)
    assert j.fx[0, 0] == pytest.approx(Vdot_V, rel=1e-12)
    assert j.fx[0, 1] == pytest.approx(Vdot_alpha, rel=1e-12)
    assert j.fx[0, 2] == pytest.approx(-G0_M_S2 * np.cos(alpha - theta), rel=1e-12)
    assert j.fx[3, 3] == pytest.approx(qdot_q, rel=1e-12)
    assert j.fu[3, 1] == pytest.approx(a.thrust_moment_rad_s2_per_N, rel=1e-12)


def test_a_mode_without_forces_is_the_rigid_aircraft():
    settings = {"trim": Trim(16.0, 0.1), "outputs": ("q", "alpha", "az"), "states": ("alpha", "q")}
    rigid, elastic = longitudinal(**settings), flexible(**settings, wn_rad_s=(30.0,))
    still = elastic.with_parameters({"Q1_alpha": 0.0, "Q1_q": 0.0, "Q1_de": 0.0})
    u, hold = inputs(rigid, 100, 8), np.zeros(1, bool)
    one = respond(rigid, rigid.values, (), u, Sampling(0.01, hold), np.zeros(2)).y
    assert respond(still, still.values, (), u, Sampling(0.01, hold), np.zeros(4)).y == pytest.approx(one, abs=1e-12)


def test_polynomial_terms_multiply_their_variables():
    s = aerodynamic_longitudinal(
        HFB, terms={"CD": ("0",), "CL": ("0", "alpha*alpha", "alpha*q"), "Cm": ("0", "alpha*de", "V*de")}
    )
    assert s.parameter_names == ("CD_0", "CL_0", "CL_alpha_alpha", "CL_alpha_q", "Cm_0", "Cm_alpha_de", "Cm_V_de")
    p = np.array([0.1, 0.2, 3.0, 40.0, 0.01, 0.5, 0.25])
    V, alpha, q, de = 100.0, 0.1, 0.2, -0.05
    q_hat = q * HFB.cbar_m / (2.0 * HFB.V0_m_s)
    Cm = 0.01 + 0.5 * alpha * de + 0.25 * V / HFB.V0_m_s * de
    f = s.derivative(np.array([V, alpha, 0.08, q]), np.array([de, 0.0]), p)
    assert f[3] == pytest.approx(HFB.S_cbar_over_Iyy_1_per_kg_m * 0.5 * HFB.rho_kg_m3 * V**2 * Cm, rel=1e-13)
    CL = 0.2 + 3.0 * alpha**2 + 40.0 * alpha * q_hat
    turn = -HFB.S_m2_per_kg * 0.5 * HFB.rho_kg_m3 * V**2 * CL + G0_M_S2 * np.cos(alpha - 0.08)
    assert f[1] == pytest.approx(q + turn / V, rel=1e-13)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: short_period(("alpha", "theta")), "output of structure 'short_period'"),
        (lambda: short_period(()), "needs outputs"),
        (lambda: short_period(("q", "q")), "outputs that differ"),
        (lambda: short_period().with_parameters({"M_alfa": 1.0}), "M_alpha"),
        (lambda: longitudinal(Trim(15.0), states=("alpha", "q"), outputs=("ax",)), "ax"),
        (lambda: longitudinal(Trim(15.0), states=("alpha", "theta")), "states of structure"),
        (lambda: longitudinal(Trim(0.0)), "V > 0"),
        (lambda: lateral_directional(Trim(-3.0)), "V > 0"),
        (lambda: roll_yaw_rates(("beta",)), "output of structure"),
        (lambda: flexible(Trim(16.0), wn_rad_s=()), "frequency > 0"),
        (lambda: flexible(Trim(16.0), wn_rad_s=(20.0,), outputs=("alpha",)), "no output depends on elastic mode 1"),
        (lambda: aerodynamic_longitudinal(HFB, terms={"CD": ("0",)}), "CD, CL and Cm"),
        (lambda: aerodynamic_longitudinal(HFB, terms={"CD": ("0",), "CL": ("beta",), "Cm": ("0",)}), "a term of CL"),
        (lambda: Trim(np.nan), "finite"),
        (lambda: Parameter("M_q", 1.0, low=2.0), "low <= value <= high"),
        (lambda: Parameter("M_q", 1.0, prior_std=0.0), "prior_std > 0"),
    ],
)
def test_settings_that_make_no_sense_are_refused(make, words):
    with pytest.raises(EstimationError, match=words):
        make()


def test_an_unknown_input_channel_is_refused():
    with pytest.raises(ChannelError, match="elevatr"):
        short_period(control="elevatr")


def test_commands_name_parameters_without_their_suffix():
    assert "M_de" in short_period(control="de_cmd").parameter_names
    assert "Z_thr" in longitudinal(Trim(15.0), controls=("de_cmd", "thr_cmd")).parameter_names
