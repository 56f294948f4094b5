"""Methods that are scored on data sets as an example: two of identification, one of naming.

``stepwise``: the pitching moment from the rates, term by term (:mod:`stepwise_regression`).
``output_error``: the testbench's own, on the longitudinal structure. Both are given the elevator behind the servo that
is believed, V, alpha, q and theta of the four flights of a draw, with the lags of the instruments made equal.

``Classifier``: principal components of what the records of a case differ by from those of training cases without any
effect, and one hidden layer of 64 tanh units before a softmax (D. E. Rumelhart, G. E. Hinton, R. J. Williams, Nature
323, 1986), trained by Adam (D. P. Kingma, J. Ba, ICLR 2015) on all training cases at once.
"""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from stepwise_regression import stepwise

import testbench as tb
from testbench.core.errors import Refusal
from testbench.core.record import FlightRecord
from testbench.estimators.prepare import prepare
from testbench.estimators.regression.global_model import factors, polynomial_terms
from testbench.estimators.regression.smoothing import SineSeries
from testbench.sensors.sensor import first_order_lag

SERVO_LAG = {"eolo": 50.0, "taurus": 33.0}  # corner of the believed elevator servo, rad/s
OUTPUTS = ("V", "alpha", "q", "theta")
LAGS = {s.channel: s.lag_s for s in tb.load_suite("eolo_gap").sensors if s.channel in OUTPUTS}
FINE = 20  # steps within a sample
AHEAD = 5  # of them: the simulated servo answers to a command within the frame of 10 ms in which it is given
FIGURES = ("M_alpha", "M_q", "M_de")
Answer = tuple[int, str, float, float]
"""Draw, figure, value, stated error."""


def records_of(flights: Any, draw: int) -> list[FlightRecord]:
    """Return the flights of a draw as deviations from trim, with the elevator behind the believed servo.

    The lags of the instruments, which their data sheets tell, are made equal: each channel passes those of the others,
    the elevator all of them. For linear motion that changes nothing else.
    """
    of = flights.isel(flight=np.flatnonzero(flights.draw.values == draw))
    servo = 1.0 / SERVO_LAG[flights.aircraft.attrs["names"][int(of.aircraft[0])]]
    dt = float(of.time[1])
    out = []
    for k in range(of.sizes["flight"]):
        x = of.isel(flight=k, time=slice(int(of.samples[k]))).readings
        command = np.repeat(x.sel(channel="de_cmd").values.astype(float), FINE)  # held until the next sample
        columns = [_behind(x.sel(channel=n).values.astype(float), dt, {**LAGS, n: 0.0}.values()) for n in OUTPUTS]
        command = np.concatenate([command[AHEAD:], np.repeat(command[-1:], AHEAD)])
        columns.append(_behind(command, dt / FINE, [servo, *LAGS.values()])[::FINE])
        record = FlightRecord(np.arange(len(x)) * dt, (*OUTPUTS, "de"), np.column_stack(columns), "measured")
        out.append(prepare(record, bias="trim", trim_s=2.0))
    return out


def _behind(x: Any, dt: float, lags: Iterable[float]) -> Any:
    for lag in lags:
        x = first_order_lag(x, dt, lag) if lag > 0.0 else x
    return x


def by_output_error(flights: Any, draw: int) -> Iterator[Answer]:
    """Yield what output error finds; nothing where it fails or says itself that its model must not be used."""
    try:
        model = tb.estimate("output_error", records_of(flights, draw), ["de"], list(OUTPUTS), structure="longitudinal")
    except Refusal:
        return
    if model.status == "wrong":
        return
    for name in FIGURES:
        yield draw, name, model.values[name], model.standard_errors[name]


def by_stepwise(flights: Any, draw: int) -> Iterator[Answer]:
    """Yield what stepwise regression finds; a term that is not chosen is 0 with no error that could be stated."""
    signals, parts = ("alpha", "q", "de", "V"), []
    terms = polynomial_terms(signals, 2)
    for record in records_of(flights, draw):
        series = {n: SineSeries.of(record[n], record.dt_s).smoothed() for n in ("alpha", "q", "V")}
        columns = {n: series[n].values if n in series else record[n] for n in signals}
        made = [np.prod([columns[n] ** power for n, power in factors(term)], axis=0) for term in terms]
        parts.append((np.column_stack(made), series["q"].derivative))
    chosen, found = stepwise(parts)
    if found is None:
        return
    known = {terms[c]: (found.params[i], found.std[i]) for i, c in enumerate(chosen)}
    for name in FIGURES:
        value, std = known.get(name.removeprefix("M_"), (0.0, 0.0))
        yield draw, name, float(value), float(std)


class Classifier:
    """A small neural classifier of cases.

    Args:
        names: (k,) classes.
        features: (n, f) of the training cases.
        labels: (n,) class of each.
        held: features and labels of the validation cases: training stops where their likelihood is best.
        hidden: units.
        seed: of the first weights.
    """

    def __init__(
        self, names: list[str], features: Any, labels: Any, held: tuple[Any, Any], hidden: int = 64, seed: int = 0
    ) -> None:
        self.names = names
        rng = np.random.default_rng(seed)
        f, k = features.shape[1], len(names)
        w = [
            rng.standard_normal((f, hidden)) / np.sqrt(f), np.zeros(hidden),
            rng.standard_normal((hidden, k)) / np.sqrt(hidden), np.zeros(k),
        ]  # fmt: skip
        target = np.eye(k)[labels]
        mean, square = [np.zeros_like(x) for x in w], [np.zeros_like(x) for x in w]
        best, self.weights = np.inf, w
        for step in range(1, 1501):
            h = np.tanh(features @ w[0] + w[1])
            p = _softmax(h @ w[2] + w[3])
            back = (p - target) / len(features)
            inner = back @ w[2].T * (1.0 - h**2)
            gradient = [features.T @ inner + 1e-3 * w[0], inner.sum(0), h.T @ back + 1e-3 * w[2], back.sum(0)]
            for i, g in enumerate(gradient):
                mean[i] = 0.9 * mean[i] + 0.1 * g
                square[i] = 0.999 * square[i] + 0.001 * g**2
                w[i] = w[i] - 3e-3 * (mean[i] / (1 - 0.9**step)) / (np.sqrt(square[i] / (1 - 0.999**step)) + 1e-8)
            if step % 20 == 0:
                loss = -np.mean(np.log(self._of(w, held[0])[np.arange(len(held[1])), held[1]] + 1e-12))
                if loss < best:
                    best, self.weights = loss, [x.copy() for x in w]

    def probabilities(self, features: Any) -> Any:
        """Return (n, k) probabilities."""
        return self._of(self.weights, features)

    @staticmethod
    def _of(w: list[Any], features: Any) -> Any:
        return _softmax(np.tanh(features @ w[0] + w[1]) @ w[2] + w[3])


def _softmax(x: Any) -> Any:
    e = np.exp(x - x.max(axis=1, keepdims=True))
    return e / e.sum(axis=1, keepdims=True)
