"""SRIVC: exact recovery for held and ramped inputs, a second implementation, errors against scatter, real flights."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter, lsim

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord
from testbench.estimators import srivc
from testbench.estimators.continuous import ContinuousTransferModel
from testbench.estimators.settings import Srivc
from testbench.estimators.transfer_function import question_poles
from testbench.logs.layout import ENVIRONMENT
from testbench.logs.read import read_records
from testbench.questions.identify.scenario import RecordDescription

DT = 0.1
A = np.array([1.0, 2.5, 6.25])  # wn 2.5 rad/s, zeta 0.5
B = np.array([-4.0, -6.0])
OMEGA = np.geomspace(0.2, 20.0, 30)


def record(y, valid=None, dt=DT, **u):
    names = (*u, *y)
    return FlightRecord(np.arange(len(next(iter(u.values())))) * dt, names, np.column_stack([*u.values(), *y.values()]),
                        "measured", valid=valid)  # fmt: skip


def response(u, hold="zoh", b=B, a=A, dt=DT):
    """Return y of the sampled system from rest; scipy's own discretisation, not the project's."""
    num, den, _ = cont2discrete((b, a), dt, hold)
    return lfilter(np.ravel(num), den, u)


def steps(rng, n, hold=4):
    return np.repeat(rng.choice([-1.0, 1.0], size=n // hold), hold)


def relative(found, true):
    return np.abs(np.asarray(found) - true).max() / np.abs(true).max()


def pole(model, output="q"):
    return max(model.poles()[output], key=lambda s: s.imag)


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_exact_data_are_recovered_whatever_the_initial_state(hold):
    rng = np.random.default_rng(1)
    records = []
    for n in (300, 200):
        u = np.concatenate([rng.standard_normal(40), steps(rng, n)])
        u = lfilter([0.4], [1.0, -0.6], u) if hold == "foh" else u
        records.append(record({"q": response(u, hold)[40:]}, de=u[40:]))
    model = srivc.estimate(records, ("de",), ("q",), Srivc(poles=(2,), zeros=(1,), hold=hold))
    assert model.status == "good"
    assert relative(model.poles()["q"], np.roots(A)) < 1e-10
    true = np.polyval(B, 1j * OMEGA) / np.polyval(A, 1j * OMEGA)
    assert relative(model.frequency_response(OMEGA)[:, 0, 0], true) < 1e-10
    for r in records:
        assert np.abs(model.simulate(r)[:, 0] - r["q"]).max() < 1e-10
    wrong = srivc.estimate(
        records, ("de",), ("q",), Srivc(poles=(2,), zeros=(1,), hold={"zoh": "foh", "foh": "zoh"}[hold])
    )
    assert relative(pole(wrong), pole(model)) > 1e-4  # the course between the samples matters


def test_inputs_share_a_denominator_each_with_its_delay():
    rng = np.random.default_rng(2)
    u = {"de_cmd": steps(rng, 400), "thr_cmd": steps(rng, 400, 5)}
    late = {name: np.concatenate([np.full(d, v[0]), v])[:400] for (name, v), d in zip(u.items(), (2, 0), strict=True)}
    y = response(late["de_cmd"]) + response(late["thr_cmd"], b=np.array([1.5]))
    r = record({"q": y}, **u)
    model = srivc.estimate(
        [r], tuple(u), ("q",), Srivc(poles=(2,), zeros=(1,), delay_samples=(0, 1, 2, 3)), validation=[r]
    )
    assert model.hold == ("zoh", "zoh")  # by their names
    assert np.allclose(model.delays_s, [[2 * DT, 0.0]])
    assert relative(model.denominators[0], A) < 1e-8
    assert relative(model.numerators[0], np.array([[0.0, *B], [0.0, 0.0, 1.5]])) < 1e-8


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_a_fractional_delay_is_found(hold):
    # a grid ten times as fine has the delay of 1.3 samples on it: 13 fine samples
    rng = np.random.default_rng(3)
    u = steps(rng, 300) if hold == "zoh" else lfilter([0.4], [1.0, -0.6], steps(rng, 300))
    fine = np.repeat(u, 10) if hold == "zoh" else np.interp(np.arange(3000) / 10.0, np.arange(300), u)
    y = response(np.concatenate([np.full(13, u[0]), fine])[:3000], hold, dt=DT / 10)
    r = record({"q": y[::10]}, de=u)
    model = srivc.estimate(
        [r],
        ("de",),
        ("q",),
        Srivc(poles=(2,), zeros=(1,), delay_samples=(0, 1, 2, 3), refine_delay=True, hold=hold),
        validation=[r],
    )
    assert model.delays_s[0, 0] == pytest.approx(1.3 * DT, rel=1e-6)
    assert relative(pole(model), np.roots(A)[0]) < 1e-6
    assert model.parameter_names[-1] == "q/de: delay_s"


def test_orders_and_delay_are_chosen_on_held_out_data():
    rng = np.random.default_rng(4)
    parts = []
    for n in (400, 200):
        u = steps(rng, n)
        y = response(np.concatenate([[u[0]], u])[:n])
        parts.append(record({"q": y + 0.05 * rng.standard_normal(n)}, de_cmd=u))
    model = srivc.estimate(
        parts[:1],
        ("de_cmd",),
        ("q",),
        Srivc(poles=(1, 2, 3), zeros=(0, 1, 2), delay_samples=(0, 1, 2)),
        validation=parts[1:],
    )
    assert model.diagnostics["structure"]["q"] == {"poles": 2, "zeros": 1}
    assert model.delays_s[0, 0] == pytest.approx(DT)
    assert set(model.diagnostics["fit_percent"]["q"]) == {"1/0", "1/1", "2/0", "2/1", "2/2", "3/0", "3/1", "3/2"}
    assert not any("favours" in s for s in model.advice)
    own = srivc.estimate(parts[:1], ("de_cmd",), ("q",), Srivc(poles=(1, 2), zeros=(0, 1)))
    assert any("favours more poles and zeros" in s for s in own.advice)


def test_samples_that_were_not_taken_do_not_count():
    rng = np.random.default_rng(5)
    u = steps(rng, 300)
    y = response(u)
    valid = np.ones((300, 2), bool)
    valid[rng.random(300) < 0.1, 1] = False  # dropouts
    valid[1::2, 1] = False  # and a sensor at half the rate
    held = np.where(valid[:, 1], y, 77.0)
    model = srivc.estimate([record({"q": held}, valid, de_cmd=u)], ("de_cmd",), ("q",), Srivc(poles=(2,), zeros=(1,)))
    assert relative(model.denominators[0], A) < 1e-8


def test_wrong_trim_values_are_taken_up_by_offset():
    rng = np.random.default_rng(6)
    records = []
    for level in (0.7, -0.4):
        u = steps(rng, 200)
        records.append(record({"q": response(u) + level}, de_cmd=u))
    model = srivc.estimate(records, ("de_cmd",), ("q",), Srivc(poles=(2,), zeros=(1,), offset=True))
    assert relative(model.denominators[0], A) < 1e-8
    assert np.abs(model.simulate(records[0])[:, 0] - records[0]["q"]).max() < 1e-8


def test_an_unstable_pole_is_found():
    rng = np.random.default_rng(7)
    a = np.poly([0.6, -3.0])  # grows by e^18 over the record
    u = steps(rng, 300)
    y, x = np.zeros(300), np.zeros(2)
    F, G, _, _, _ = cont2discrete((np.array([[0.6, 1.0], [0.0, -3.0]]), np.array([[0.0], [1.0]]), np.eye(2)[:1], 0), DT)
    gain = np.array([6.0, 3.0])  # feedback keeps it in bounds
    command = np.zeros(300)
    for k in range(300):
        y[k] = x[0]
        command[k] = 0.1 * u[k] - gain @ x
        x = F @ x + G[:, 0] * command[k]
    model = srivc.estimate([record({"q": y}, de_cmd=command)], ("de_cmd",), ("q",), Srivc(poles=(2,), zeros=(0,)))
    assert relative(model.denominators[0], a) < 1e-6
    assert np.abs(model.simulate(record({"q": y}, de_cmd=command))[:, 0] - y).max() < 1e-6 * np.abs(y).max()


def own_srivc(u, y, iterations=12):
    """SRIVC for two poles and one zero as its papers write it: normal equations, filters by scipy's lsim."""
    t = np.arange(u.size) * DT
    a, b = np.array([1.0, 2.0, 4.0]), np.zeros(2)

    def filtered(v, hold, x0=(0.0, 0.0)):
        F, G = np.array([[-a[1], -a[2]], [1.0, 0.0]]), np.array([[1.0], [0.0]])
        return lsim((F, G, np.eye(2), np.zeros((2, 1))), v, t, X0=x0, interp=hold == "foh")[1]

    for k in range(iterations):
        fu, fy = filtered(u, "zoh"), filtered(y, "foh")
        free = np.column_stack([filtered(0.0 * u, "zoh", x0)[:, 1] for x0 in np.eye(2)])
        forced = fu @ b
        model = forced + free @ np.linalg.lstsq(free, y - forced, rcond=None)[0]
        fx = fy if k == 0 else filtered(model, "foh")
        phi, zeta = np.hstack([-fy, fu, free]), np.hstack([-fx, fu, free])
        theta = np.linalg.solve(zeta.T @ phi, zeta.T @ (y - fy @ a[1:]))
        a, b = np.array([1.0, *theta[:2]]), theta[2:4]
    return np.concatenate([a[1:], b])


def test_a_second_implementation_agrees():
    rng = np.random.default_rng(8)
    u = steps(rng, 300)
    y = response(u) + 0.2 * rng.standard_normal(300)
    model = srivc.estimate([record({"q": y}, de_cmd=u)], ("de_cmd",), ("q",), Srivc(poles=(2,), zeros=(1,)))
    assert np.abs(model.parameters - own_srivc(u, y)).max() < 1e-5  # both stop within 1e-6 standard errors


def scatter(seeds, noise, n=200):
    rng = np.random.default_rng(9)
    u = steps(rng, n, 5)
    y = response(u)
    found, stated, factors = [], [], []
    for _ in range(seeds):
        r = record({"q": y + noise(rng, n)}, de_cmd=u)
        model = srivc.estimate([r], ("de_cmd",), ("q",), Srivc(poles=(2,), zeros=(1,)))
        [mode] = model.modes()["q"]
        found.append([*model.parameters, mode.wn_rad_s, mode.zeta])
        stated.append([*model.standard_errors.values(), mode.wn_error_rad_s, mode.zeta_error])
        factors.append(model.diagnostics["error_factor"]["q"])
    return np.array(found), np.array(stated), np.array([*A[1:], *B, 2.5, 0.5]), np.array(factors)


@pytest.mark.slow
def test_standard_errors_are_the_scatter_and_intervals_cover():
    seeds = 200
    found, stated, true, _ = scatter(seeds, lambda rng, n: 0.2 * rng.standard_normal(n))
    ratio = np.std(found, axis=0, ddof=1) / np.mean(stated, axis=0)
    # A standard deviation from 200 seeds is known to 5 %: 0.2 is 4 sigma, times 6 figures: false alarm 4e-4.
    assert np.all(np.abs(ratio - 1.0) < 0.2)
    inside = np.abs(found - true) <= 1.96 * stated
    # Binomial(200, 0.95): 3 sigma is 4.6 %, 0.90 is 3.2 sigma; times 6 figures: false alarm 0.5 %.
    assert np.all(inside.mean(axis=0) > 0.90)
    bias = np.abs(found.mean(axis=0) - true)
    assert np.all(bias < 4.5 * np.std(found, axis=0) / np.sqrt(seeds))  # 7e-6 each; second-order bias lies below


def coloured(rng, n):
    return lfilter([0.08], [1.0, -0.9], rng.standard_normal(n + 50))[50:]


def test_coloured_residuals_raise_the_standard_errors():
    found, stated, _, factors = scatter(60, coloured, n=400)
    assert np.all(factors > 1.5)
    ratio = np.std(found, axis=0, ddof=1) / np.mean(stated, axis=0)
    # A standard deviation from 60 seeds is known to 9 %; measured over 200 seeds the errors are 2 to 13 % too small at
    # 400 samples. 0.5 is 4 sigma beyond that; uncorrected errors are short by a factor 2.3.
    assert np.all(np.abs(ratio - 1.0) < 0.5)


@pytest.mark.slow
def test_intervals_cover_under_coloured_noise():
    found, stated, true, _ = scatter(400, coloured, n=1000)
    inside = np.abs(found - true) <= 1.96 * stated
    # Binomial(400, 0.95): 4 sigma is 4.4 % (measured over 200 seeds: 0.955 to 0.975)
    assert np.all(inside.mean(axis=0) > 0.90)
    assert np.all(inside.mean(axis=0) < 0.995)


def test_poles_that_the_data_do_not_decide_are_questioned():
    rng = np.random.default_rng(10)
    n, t = 600, np.arange(600) * DT
    u = sum(np.sin(w * t + 3.0 * i) for i, w in enumerate((0.2, 0.4, 0.6, 0.8)))  # nothing beyond 1 rad/s
    y = response(u, "foh") + 0.02 * rng.standard_normal(n)
    model = srivc.estimate([record({"q": y}, de=u)], ("de",), ("q",), Srivc(poles=(2,), zeros=(1,)))
    sizes = np.abs(np.concatenate(list(model.poles().values())))
    low, high = model.diagnostics["excited_band_rad_s"]
    assert 0.0 < low < 0.25  # 99 % of the energy; a record of 60 s leaks by some 0.1 rad/s
    assert 0.75 < high < 1.2
    assert np.all(sizes > high)
    assert any("lie outside the band" in s for s in model.advice)
    fast = srivc.estimate(
        [record({"q": u + 0.3 * rng.standard_normal(n)}, de=u)], ("de",), ("q",), Srivc(poles=(1,), zeros=(0,))
    )
    assert np.abs(fast.poles()["q"][0]) > 0.5 * np.pi / DT
    assert any("above half the Nyquist frequency" in s for s in fast.advice)
    one = [record({"q": u}, de=np.sin(0.8 * t))]
    [sentence] = question_poles("q", np.array([0.75]), np.array([0.5]), one, ("de",))
    assert "within 30 % of the peak of the spectrum of de (0.80 rad/s)" in sentence
    assert not question_poles("q", np.array([0.75]), np.array([0.01]), one, ("de",))  # these data decide


def test_more_poles_than_the_data_hold_are_reported():
    rng = np.random.default_rng(11)
    u = steps(rng, 300)
    r = record({"q": response(u)}, de_cmd=u)
    model = srivc.estimate([r], ("de_cmd",), ("q",), Srivc(poles=(4,), zeros=(3,)))
    assert any("rank deficient" in s or "did not converge" in s for s in model.advice)
    assert np.abs(model.simulate(r)[:, 0] - r["q"]).max() < 1e-6


def test_units_and_order_of_channels_do_not_matter():
    rng = np.random.default_rng(12)
    u = steps(rng, 300)
    r = record({"q": response(u) + 0.1 * rng.standard_normal(300), "alpha": response(u, b=np.array([3.0]))}, de_cmd=u)
    model = srivc.estimate([r], ("de_cmd",), ("q", "alpha"), Srivc(poles=(2,), zeros=(1,)))
    scaled = r.with_columns({"q": 1e3 * r["q"]}).select(("alpha", "de_cmd", "q"))
    other = srivc.estimate([scaled], ("de_cmd",), ("q", "alpha"), Srivc(poles=(2,), zeros=(1,)))
    assert relative(other.poles()["q"], model.poles()["q"]) < 1e-9
    assert relative(other.numerators[0], 1e3 * model.numerators[0]) < 1e-8
    assert np.array_equal(other.poles()["alpha"], model.poles()["alpha"])


def test_refusals_say_law_value_and_fix():
    rng = np.random.default_rng(13)
    u = steps(rng, 40)
    r = record({"q": response(u)}, de_cmd=u)
    with pytest.raises(EstimationError, match=r"some zeros <= poles must hold, got zeros \[3\], poles \[2\]"):
        srivc.estimate([r], ("de_cmd",), ("q",), Srivc(poles=(2,), zeros=(3,)))
    with pytest.raises(EstimationError, match="at least twice as many samples as its 24 unknowns, got 40"):
        srivc.estimate([r], ("de_cmd",), ("q",), Srivc(poles=(8,), zeros=(7,)))
    with pytest.raises(EstimationError, match=r"delay_samples\[0\]: must be 0 to 10000 samples, got -1"):
        srivc.estimate([r], ("de_cmd",), ("q",), Srivc(poles=(2,), zeros=(1,), delay_samples=(-1,)))
    with pytest.raises(EstimationError, match="must be one of zoh, foh, got 'soh'"):
        srivc.estimate([r], ("de_cmd",), ("q",), Srivc(poles=(2,), zeros=(1,), hold="soh"))
    with pytest.raises(EstimationError, match="hold must name inputs only, got 'de'; valid: de_cmd"):
        srivc.estimate([r], ("de_cmd",), ("q",), Srivc(poles=(2,), zeros=(1,), hold={"de": "zoh"}))
    with pytest.raises(EstimationError, match="output 'q' must move"):
        srivc.estimate([record({"q": 0.0 * u}, de_cmd=u)], ("de_cmd",), ("q",), Srivc(poles=(2,), zeros=(1,)))
    with pytest.raises(EstimationError, match="covariance must be finite and of shape"):
        ContinuousTransferModel(
            method="srivc",
            inputs=("de",),
            outputs=("q",),
            dt_s=DT,
            numerators=np.zeros((1, 1, 3)),
            denominators=A[None],
            delays_s=np.zeros((1, 1)),
            hold=("zoh",),
            parameter_names=("a",),
            parameters=np.ones(1),
            covariance=np.ones((2, 2)),
        )


def test_export():
    rng = np.random.default_rng(14)
    u = steps(rng, 300)
    y = response(np.concatenate([[u[0]], u])[:300]) + 0.05 * rng.standard_normal(300)
    r = record({"q": y, "alpha": 0.5 * y}, de_cmd=u)
    model = srivc.estimate([r], ("de_cmd",), ("q", "alpha"), Srivc(poles=(2, 1), zeros=(0, 1), delay_samples=(1,)))
    system = model.to_control()
    assert system.input_labels == ["de_cmd"]
    assert system.output_labels == ["q", "alpha"]
    omega = np.geomspace(0.2, 10.0, 20)  # w tau up to 1
    assert relative(model.frequency_response(omega), np.moveaxis(system(1j * omega), 2, 0)) < 1e-6
    back = json.loads(json.dumps(model.to_dict()))
    assert back["delays_s"] == [[DT], [DT]]
    assert back["parameters"]["q: a1"] == model.denominators[0][1]
    # Monte Carlo over the covariance: the errors of wn and zeta are first order, 4000 draws know them to 1.1 %
    rows = [model.parameter_names.index(f"q: a{k}") for k in (1, 2)]
    draws = rng.multivariate_normal(model.parameters[rows], model.covariance[np.ix_(rows, rows)], size=4000)
    wn = np.sqrt(draws[:, 1])
    [mode] = model.modes()["q"]
    assert np.std(wn) == pytest.approx(mode.wn_error_rad_s, rel=0.06)
    assert np.std(0.5 * draws[:, 0] / wn) == pytest.approx(mode.zeta_error, rel=0.06)


def test_attas_short_period():
    folder = Path(os.environ.get(ENVIRONMENT) or Path(__file__).resolve().parents[3] / "shared" / "flight_data")
    description = RecordDescription.load("attas_short_period")
    absent = [r.file for r in description.record if not (folder / r.file).is_file()]
    if absent:
        pytest.skip(f"recorded flights are missing: {', '.join(absent)} in '{folder}'; set {ENVIRONMENT}")
    flights = [r for _, _, r in read_records(description, folder)]
    mean = [r.with_columns({c: r[c] - r[c].mean() for c in r.channels}) for r in flights]
    model = srivc.estimate(mean, ("de",), ("alpha", "q"), Srivc(poles=(2,), zeros=(1,)))
    for modes in model.modes().values():
        [mode] = modes
        # printed output-error estimate: 2.53 rad/s and 0.493; measured: 2.521 and 0.487 (alpha), 2.529 and 0.498 (q)
        assert mode.wn_rad_s == pytest.approx(2.53, rel=0.03)
        assert mode.zeta == pytest.approx(0.493, abs=0.02)
        assert 0.005 < mode.wn_error_rad_s < 0.05
    assert any("residuals are coloured" in s for s in model.advice)
