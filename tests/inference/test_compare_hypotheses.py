"""Hypotheses about a servo and a pitching aircraft: named, sized and weighed whatever the noise, and calibrated."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import cont2discrete, lfilter, ss2tf
from scipy.stats import norm

from testbench.core.errors import EstimationError, RecordError
from testbench.core.record import FlightRecord
from testbench.flight.linear_model import LinearModel
from testbench.inference.calibrate import Reliability, Trial, calibrate
from testbench.inference.evidence import Fitting, compare_hypotheses
from testbench.inference.fit import Data, Fit, Hypothesis
from testbench.inference.parameters import Noise, Parameter
from testbench.inference.unknown import pulses

DT = 0.02
A = np.array([[-2.0, 1.0], [-30.0, -3.0]])
B = np.array([[-0.2], [-40.0]])
NOISE = Noise({"alpha": 2e-3, "q": 5e-3})
T = np.arange(400) * DT
COMMAND = 0.05 * (((T > 1) & (T < 1.7)) * 1.0 - ((T >= 1.7) & (T < 2.2)) + ((T > 4) & (T < 4.3)))


@cache
def flown(lag_s=0.0, delay_s=0.0, M_q=1.0, M_alpha=1.0, bend=0.0):
    """Return alpha and q of a short period behind a servo; ``bend`` makes the damping grow with alpha."""
    u = np.interp(T - delay_s, T, COMMAND, left=0.0)
    if lag_s > 0.0:
        a = np.exp(-DT / lag_s)
        v = np.zeros_like(u)
        for i in range(1, len(u)):
            v[i] = a * v[i - 1] + (1.0 - a) * u[i]
        u = v
    F = A * [[1.0, 1.0], [M_alpha, M_q]]
    if bend:
        x, y = np.zeros(2), np.zeros((len(T), 2))
        for i in range(len(T)):
            y[i] = x
            for _ in range(4):
                x = x + 0.25 * DT * (F @ x + B[:, 0] * u[i] - [0.0, bend * x[0] * x[1]])
        return y
    of_each = [ss2tf(*cont2discrete((F, B, np.eye(2)[[i]], np.zeros((1, 1))), DT)[:4]) for i in range(2)]
    return np.column_stack([lfilter(num[0], den, u) for num, den in of_each])


def record(y, rng, scale=1.0):
    std = np.array(list(NOISE.std.values()))
    data = y + scale * std * rng.standard_normal(y.shape)
    return FlightRecord(T, ("alpha", "q"), data, "measured")


KNOWN = (Parameter("M_q", "aircraft", 1.0, 0.1), Parameter("M_alpha", "aircraft", 1.0, 0.1))


def hypothesis(name, *more):
    return Hypothesis(name, (*KNOWN, *more), lambda r, v: flown(**v))


NOTHING = hypothesis("nothing")
LAG = hypothesis("lag", Parameter("lag_s", "effect", 0.05, 0.05, "s", 0.0, 0.5))
DELAY = hypothesis("delay", Parameter("delay_s", "effect", 0.05, 0.05, "s", 0.0, 0.5))
MODEL = LinearModel(A, B, np.eye(2), np.zeros((2, 1)), ("alpha", "q"), ("de",), ("alpha", "q"))


def unknown(r):
    return pulses(MODEL, ("alpha", "q"), 20.0, r)


def asked(truth, scale, seed, **more):
    rng = np.random.default_rng(seed)
    records = [record(flown(**truth), rng, scale) for _ in range(2)]
    return compare_hypotheses(records, [NOTHING, LAG, DELAY], NOISE, unknown, **more)


@pytest.mark.parametrize("scale", [0.7, 1.0, 1.4])
def test_names_and_sizes_do_not_move_with_the_noise(scale):
    for truth, name in (
        ({"lag_s": 0.08, "M_q": 1.1}, "lag"),
        ({"delay_s": 0.07}, "delay"),
        ({"M_alpha": 0.93}, "nothing"),
    ):
        found = asked(truth, scale, 3)
        assert found.best.name == name
        assert found.best.probability > 0.9
        assert found.best.posterior.p_whole > 0.5
        assert found.credible()[0] == name
        for channel in NOISE.channels:
            value, error = found.noise[channel]
            assert abs(value - scale) < 4.0 * error
            assert error < 0.05
        for parameter, true in truth.items():
            value, error = found.best.posterior[parameter]
            assert abs(value - true) < 4.0 * error


def test_what_no_hypothesis_describes_is_a_part_and_no_name():
    found = asked({"bend": 60.0}, 1.0, 4)
    assert found.best.posterior.p_whole < 0.01
    assert found.best.posterior.kappa > 1e-3
    alone = compare_hypotheses(
        [record(flown(bend=60.0), np.random.default_rng(4)) for _ in range(2)], [NOTHING, LAG, DELAY], NOISE
    )
    assert alone.best.posterior.whiteness < 1e-6
    assert "coloured" in alone.best.posterior.doubts[0]
    assert asked({}, 1.0, 4).best.posterior.whiteness > 1e-3


def test_a_law_whose_form_is_not_quite_right_may_leave_as_much_as_its_form_error_allows():
    """A servo of two lags is called one of one lag: partial if its form is taken for exact, the whole story if not."""
    u = COMMAND
    for lag_s in (0.08, 0.03):
        a = np.exp(-DT / lag_s)
        u = lfilter([1.0 - a], [1.0, -a], u)
    of_each = [ss2tf(*cont2discrete((A, B, np.eye(2)[[i]], np.zeros((1, 1))), DT)[:4]) for i in range(2)]
    two = np.column_stack([lfilter(num[0], den, u) for num, den in of_each])
    rng = np.random.default_rng(12)
    records = [record(two, rng) for _ in range(3)]
    exact = compare_hypotheses(records, [NOTHING, LAG], NOISE, unknown)["lag"].posterior

    def form(r, v):
        return 0.2 * (flown(**v) - flown(**{**v, "lag_s": 0.0}))

    loose = compare_hypotheses(records, [NOTHING, replace(LAG, form=form)], NOISE, unknown)["lag"].posterior
    assert exact.p_whole < 0.01
    assert loose.p_whole > 0.5
    assert loose.errors[-1] > exact.errors[-1]


def test_tangents_that_are_known_and_flights_together_change_nothing():
    """Slopes in place of differences, and a caller who flies ahead, give the same posterior."""
    records = [record(flown(lag_s=0.08), np.random.default_rng(3))]
    ahead = []

    def slopes(r):
        return {"M_q": (flown(M_q=1.001) - flown(M_q=0.999)) / 2e-3}

    quick = replace(LAG, slopes=slopes, begin={"lag_s": 0.07})
    plain, other = (
        compare_hypotheses(records, [h], NOISE, unknown, fitting=Fitting(ahead=ahead.append)).best.posterior
        for h in (LAG, quick)
    )
    assert np.allclose(plain.values, other.values, atol=0.1 * plain.errors)
    assert plain.log_evidence == pytest.approx(other.log_evidence, abs=0.1)
    assert ("lag", 0.07) in [(asked.name, values["lag_s"]) for some in ahead for asked, values in some]
    assert all("M_alpha" in values for some in ahead for _, values in some)


def test_records_that_are_held_out_judge():
    held_out = [record(flown(lag_s=0.08), np.random.default_rng(9))]
    found = asked({"lag_s": 0.08}, 1.0, 3, held_out=held_out)
    assert found["lag"].held_out > found["delay"].held_out > 0.0
    assert found["nothing"].held_out == 0.0
    assert found["delay"].difference < -3.0 * found["delay"].difference_error
    assert [name in found._repr_html_() for name in ("lag", "delay", "held out", "stall")] == [True, True, True, False]


@pytest.mark.parametrize(("colour", "least", "most"), [(0.0, 0.91, 0.99), (0.8, 0.77, 0.97)], ids=["white", "coloured"])
def test_errors_hold_the_truth_where_what_is_left_is_no_white_noise_too(colour, least, most):
    """White errors of noise of this colour are three times too small, and two of them hold the truth in half of cases.

    Of 120 parameters of 40 records 95 % +- 2 % would be held by chance.
    """
    t = np.arange(1200) * 0.05
    shapes = np.column_stack([np.sin(0.7 * t), np.cos(1.3 * t), np.sign(np.sin(0.4 * t))])
    parameters = tuple(Parameter(n, "aircraft", 0.0, 10.0) for n in "abc")
    straight = Hypothesis("straight", parameters, lambda _, v: (shapes @ list(v.values()))[:, None])
    other = Hypothesis("other", parameters[:2], lambda _, v: (shapes[:, :2] @ list(v.values()))[:, None])
    far, misfit, named = [], [], []
    for seed in range(40):
        noise = lfilter([1.0], [1.0, -colour], np.random.default_rng(seed).standard_normal(1250))[50:]
        y = shapes[:, :2] @ [1.0, -2.0] + noise * (1.0 - colour**2) ** 0.5
        r = FlightRecord(t, ("q",), y[:, None], "measured")
        found = compare_hypotheses([r], [other, straight], Noise({"q": 1.0}, "simulated"))
        posterior = found["straight"].posterior
        misfit.append(posterior.misfit)
        far += [abs(posterior[n][0] - true) / posterior[n][1] for n, true in zip("abc", (1.0, -2.0, 0.0), strict=True)]
        named.append(found["straight"].probability)
    assert least < np.mean(np.array(far) < 2.0) < most
    assert (np.median(misfit) < 1.2) == (colour == 0.0)
    assert (np.array(named) > 0.9).sum() <= 2  # what is not there; 9 without the misfit of coloured noise


def test_the_evidence_of_one_parameter_is_that_of_quadrature_also_where_it_is_skewed():
    """A size that enters by its square: the posterior is far from Gaussian, and importance sampling corrects it."""
    t = np.arange(50) * DT
    rng = np.random.default_rng(1)
    for true in (0.02, 0.4):
        y = true**2 + 0.05 * rng.standard_normal(50)
        r = FlightRecord(t, ("q",), y[:, None], "measured")
        squared = Hypothesis(
            "squared", (Parameter("x", "effect", 0.3, 0.3, "1", 0.0, 2.0),), lambda _, v: np.full((50, 1), v["x"] ** 2)
        )
        found = compare_hypotheses([r], [squared], Noise({"q": 0.05}, "simulated"))
        top = float(np.sum(norm.logpdf(y, true**2, 0.05)))

        def density(x, y=y, top=top):
            return np.exp(np.sum(norm.logpdf(y, x**2, 0.05)) - top) * norm.pdf(x, 0.3, 0.3) / norm.sf(-1.0)

        truth = np.log(quad(density, 0.0, 2.0, points=[true], limit=200)[0]) + top
        assert found.best.log_evidence == pytest.approx(truth, abs=0.15)
        assert found.best.posterior.effective > 0.2


def test_stated_probabilities_are_kept():
    """Truths from the priors, noise from its prior: 120 flights again.

    Of exact probabilities p, the number of right answers differs from sum p by less than 3.3 sqrt(sum p (1 - p)) but
    once in a thousand.
    """
    small = [
        Hypothesis("nothing", (), lambda r, v: np.zeros((len(r), 1))),
        Hypothesis("slope", (Parameter("a", "effect", 0.0, 0.02),), lambda r, v: v["a"] * r.t_s[:, None]),
        Hypothesis("wave", (Parameter("a", "effect", 0.0, 0.02),), lambda r, v: v["a"] * np.sin(5.0 * r.t_s)[:, None]),
    ]
    t = np.arange(60) * DT
    blank = FlightRecord(t, ("q",), np.zeros((60, 1)), "measured")

    def draw(rng):
        truth = small[int(rng.integers(3))]
        y = truth.predict(blank, {p.name: rng.normal(p.value, p.prior_std) for p in truth.parameters})
        scale = np.exp(0.3 * rng.standard_normal())
        return truth.name, FlightRecord(t, ("q",), y + scale * 0.01 * rng.standard_normal(y.shape), "measured")

    def ask(measured):
        return {row.name: row.probability for row in compare_hypotheses([measured], small, Noise({"q": 0.01})).rows}

    *_, found = calibrate(draw, ask, 120, 5)
    stated = np.array([t.stated[t.called] for t in found.trials])
    right = np.array([t.called == t.truth for t in found.trials])
    assert abs(np.sum(right - stated)) < 3.3 * np.sqrt(np.sum(stated * (1.0 - stated)))
    assert 0.5 < stated.mean() < 0.95
    assert sum(s.lowest <= s.mean <= s.highest for s in found.curve()) >= len(found.curve()) - 1
    assert set(found.power()) == {"nothing", "slope", "wave"}
    *_, again = calibrate(draw, ask, 20, 5, kept=found.trials[:15])
    assert again.trials == found.trials[:20]


def test_reliability_in_words():
    trials = [Trial("a", {"a": 0.95, "b": 0.05})] * 9 + [Trial("b", {"a": 0.95, "b": 0.05})]
    found = Reliability(tuple(trials))
    assert found.sentence(0.93) == "answers stated with 90 to 99 % were right in 9 of 10 flights again"
    assert found.sentence(0.3).startswith("of 10 flights again none")
    power = found.power()
    assert {n: (p.flights, p.sure) for n, p in power.items()} == {"a": (9, 1.0), "b": (1, 0.0)}
    assert found.calibration_error == pytest.approx(0.05)


def test_bad_questions_are_one_sentence():
    measured = record(flown(), np.random.default_rng(0))
    with pytest.raises(EstimationError, match="names that differ, got lag, lag"):
        compare_hypotheses([measured], [LAG, LAG], NOISE)
    with pytest.raises(RecordError, match="one without theta"):
        compare_hypotheses([measured], [LAG], Noise({"theta": 0.1}))
    truth = FlightRecord(T, ("alpha", "q"), flown(), "truth")
    with pytest.raises(RecordError, match="of kind 'truth'"):
        compare_hypotheses([truth], [LAG], NOISE)
    wrong = Hypothesis("short", (), lambda r, v: np.zeros((3, 2)))
    with pytest.raises(EstimationError, match=r"'short' must predict \(400, 2\)"):
        compare_hypotheses([measured], [wrong], NOISE)
    with pytest.raises(EstimationError, match="prior_std of 'a'"):
        Parameter("a", "effect", 0.0, 0.0)
    with pytest.raises(EstimationError, match="above 0 and finite"):
        Noise({"q": 0.0})


class Kept:
    """A keeper in memory, of JSON text."""

    def __init__(self, groups=()):
        self.groups, self.new = dict(groups), {}

    def known(self, group):
        return json.loads(self.groups[group]) if group in self.groups else None

    def keep(self, group, content):
        self.new[group] = json.dumps(content)


def test_fits_that_are_kept_are_those_that_were_made():
    t = np.arange(200) * 0.05
    q = 0.3 * np.sin(2.0 * t) + 0.01 * np.random.default_rng(3).standard_normal(t.size)
    record = FlightRecord(t, ("q",), q[:, None], "measured")

    def sine(values):
        return values["a"] * np.sin(values["w"] * t)[:, None]

    a, w = Parameter("a", "effect", 0.0, 1.0), Parameter("w", "effect", 2.1, 0.5, high=9.0)
    some = [
        Hypothesis("line", (a,), lambda r, values: values["a"] * t[:, None]),
        Hypothesis("sine", (a, w), lambda r, values: sine(values), begin={"a": 0.2}, more=({"a": 0.1, "w": 8.0},)),
    ]
    noise = Noise({"q": 0.01})

    def rows(keeper):
        found = compare_hypotheses([record], some, noise, fitting=Fitting(0, keeper=keeper)).rows
        return [(r.name, r.probability, r.log_evidence, r.difference_error, r.posterior.values.tolist(),
                 r.posterior.covariance.tolist(), r.posterior.noise, r.posterior.doubts) for r in found]  # fmt: skip

    first = Kept()
    whole = rows(None)
    assert rows(first) == whole
    lost = {"log_evidence": float("nan")}  # of a fit that ended where it cannot fly nothing else is kept, or asked
    found = Fit.again(json.loads(json.dumps(lost)), some[1], Data([record], noise))
    assert found.told().keys() == lost.keys()
    assert not found.log_evidence > -np.inf
    again = Kept(first.new)
    assert rows(again) == whole
    assert again.new == {}


@pytest.mark.parametrize(
    ("besides", "begun"), [(0.0, [[8.0, 1.7]]), (0.3, [[8.0, 1.7], [8.3, 2.4], [2.2]])], ids=["whole", "part"]
)
def test_further_beginnings_are_tried_while_something_is_left_and_not_where_a_fit_came_by(besides, begun):
    t = np.arange(200) * 0.05
    q = 0.3 * np.sin(2.0 * t) + besides * np.exp(-((t - 5.0) ** 2)) + 0.01 * np.random.default_rng(3).normal(size=200)
    w = Parameter("w", "effect", 5.0, 3.0, high=20.0)
    hats = np.maximum(0.0, 1.0 - np.abs(t[:, None] - np.arange(0.0, 10.5, 0.5)) / 0.5)[:, None, :]

    def sine(name, *beginnings):
        first, *more = ({"w": x} for x in beginnings)
        return Hypothesis(name, (w,), lambda r, x: 0.3 * np.sin(x["w"] * t)[:, None], begin=first, more=more)

    class Begun(Kept):
        def known(self, group):
            self.new.setdefault("begun", []).append([float(x) for x in re.findall(r"\('w', ([\d.]+)\)\]", group)])

        def keep(self, group, content):
            pass

    nothing = Hypothesis("nothing", (), lambda r, x: np.zeros((200, 1)))
    some = [nothing, sine("far", 8.0, 8.3, 2.2), sine("near", 1.7, 2.4, 1.9)]  # 1.9 lies between 1.7 and the best, 2.0
    keeper = Begun()
    found = compare_hypotheses(
        [FlightRecord(t, ("q",), q[:, None], "measured")], some, Noise({"q": 0.01}), lambda r: hats,
        fitting=Fitting(0, keeper=keeper),
    )  # fmt: skip
    assert [some for some in keeper.new["begun"] if some] == begun
    assert found["near"].posterior["w"][0] == pytest.approx(2.0, abs=0.03)
    assert found["far"].posterior["w"][0] == pytest.approx(2.0 if besides else 8.0, abs=0.03)


def test_a_beginning_that_cannot_be_predicted_is_passed_over_unless_it_is_the_only_one():
    t = np.arange(200) * 0.05
    record = FlightRecord(
        t, ("q",), 0.2 * t[:, None] + 0.01 * np.random.default_rng(5).normal(size=(200, 1)), "measured"
    )
    a = Parameter("a", "effect", 0.0, 1.0)

    def line(*beginnings):
        first, *more = ({"a": x} for x in beginnings)
        return Hypothesis(
            "line", (a,), lambda r, x: np.where(abs(x["a"]) > 2.0, np.nan, x["a"] * t)[:, None], begin=first, more=more
        )

    for beginnings in ((0.1,), (0.1, 3.0), (3.0, 0.1)):
        found = compare_hypotheses([record], [line(*beginnings)], Noise({"q": 0.01}), lambda r: np.ones((200, 1, 1)))
        assert found.best.posterior["a"][0] == pytest.approx(0.2, abs=0.01)
    with pytest.raises(EstimationError, match="'line' must predict numbers where its fit begins, got none from"):
        compare_hypotheses([record], [line(3.0)], Noise({"q": 0.01}))
