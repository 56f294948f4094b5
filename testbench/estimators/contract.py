"""The laws of estimators and of structures; `testbench check FILE.py:NAME` tries them one by one.

Estimators are tried on records of a light, slow aircraft with held inputs, linear and sampled at 10 Hz: a short period
of 3.5 rad/s and a phugoid of 1.2 rad/s, damped, so that short records show both. Its channels are ``de`` (input),
``theta``, ``q``, ``alpha`` and ``V``.
"""

from __future__ import annotations

import json
import math
import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import cont2discrete

from testbench.core import bring
from testbench.core.advice import status_of
from testbench.core.channels import CHANNELS
from testbench.core.constants import DEG_RAD
from testbench.core.contract import Law, LawError, need, tried_on
from testbench.core.errors import ChannelError, EstimationError, Refusal, nearest
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators import estimate
from testbench.estimators.brought import FOLDER, is_text, text_file
from testbench.estimators.equations import read_equations
from testbench.estimators.model import ComplexArray, IdentifiedModel
from testbench.estimators.parametric import output_error
from testbench.estimators.parametric.structure import ModelStructure
from testbench.estimators.parametric.structures import Trim, longitudinal
from testbench.estimators.parametric.structures.written import written
from testbench.estimators.settings import OutputError

DT = 0.1
_GROWN = 5.0  # exponent to which an unstable structure may grow in its flight
INPUTS = ("de",)
OUTPUTS = ("theta", "q", "alpha", "V")
V0, ALPHA0 = 10.0, 0.06
DERIVATIVES = {
    "X_V": -1.6,
    "X_alpha": 3.0,
    "X_de": -0.5,
    "Z_V": -2.0,
    "Z_alpha": -20.0,
    "Z_q": -0.5,
    "Z_de": -1.5,
    "M_V": 0.02,
    "M_alpha": -9.0,
    "M_q": -1.8,
    "M_de": -8.0,
}
STRUCTURE = longitudinal(Trim(V0, ALPHA0, ALPHA0), outputs=OUTPUTS).with_parameters(DERIVATIVES)
MATRICES = STRUCTURE.matrices(STRUCTURE.values)
A_S, B_S, C = MATRICES.A, MATRICES.B, MATRICES.C
A, B = cont2discrete((A_S, B_S, np.eye(4), np.zeros((4, 1))), DT)[:2]
POLES: ComplexArray = np.linalg.eigvals(A_S).astype(np.complex128)
BUILT = {
    "structure": "longitudinal",
    "V_m_s": V0,
    "alpha_deg": ALPHA0 / DEG_RAD,
    "theta_deg": ALPHA0 / DEG_RAD,
    "held": ("de",),
}
"""How an entry describes the structure of that aircraft."""


def flight(seed: int, n: int = 300, noise: float = 0.0, longer: int = 1) -> FlightRecord:
    """Return a measured record of n samples; ``noise`` is its share of each output's standard deviation."""
    rng = np.random.default_rng(seed)
    n = longer * n
    u = 0.05 * np.repeat(rng.standard_normal((n // 3 + 1, 1)), 3, axis=0)[:n]
    x, y = 0.1 * rng.standard_normal(4), np.empty((n, 4))
    for k in range(n):
        y[k] = C @ x
        x = A @ x + B @ u[k]
    y = y + noise * y.std(axis=0) * rng.standard_normal(y.shape)
    return FlightRecord(np.arange(n, dtype=np.float64) * DT, (*INPUTS, *OUTPUTS), np.hstack([u, y]), "measured")


def true_response(omega: FloatArray, continuous: bool) -> ComplexArray:
    """Return the aircraft's response (k, 4, 1), or with the hold of its sampled input, which discrete models hold."""
    s, (F, G) = (1j * omega, (A_S, B_S)) if continuous else (np.exp(1j * omega * DT), (A, B))
    out: ComplexArray = C @ np.linalg.solve(s[:, None, None] * np.eye(4) - F, G.astype(complex))
    return out


def off(poles: ComplexArray, true: ComplexArray = POLES) -> float:
    """Return the largest distance of paired poles over the largest of them."""
    a, b = _sorted(poles), _sorted(true)
    return math.inf if a.shape != b.shape else float(np.abs(a - b).max() / np.abs(b).max())


def _sorted(s: ComplexArray) -> ComplexArray:
    s = np.asarray(s, np.complex128)
    return s[np.lexsort((np.round(s.imag, 7), np.round(s.real, 7)))]


@dataclass(frozen=True)
class Trial:
    """An estimator under trial."""

    method: str  # its name, packaged or ``FILE.py:NAME``
    settings: Mapping[str, Any] = field(default_factory=dict)  # with which it is tried
    # largest relative error of the frequency response, and of an unseen flight, on records without noise
    exact: float = 0.05
    outputs: tuple[str, ...] = OUTPUTS  # (p,) of the aircraft's
    longer: int = 1  # factor on the length of the records
    band_rad_s: tuple[float, float] = (0.6, 20.0)  # frequencies at which the response is judged

    def flights(self, *lengths: int, noise: float = 0.0) -> list[FlightRecord]:
        """Return one record per length."""
        return [flight(1 + i, n, noise, self.longer) for i, n in enumerate(lengths)]

    def run(self, records: Sequence[FlightRecord], outputs: Sequence[str] | None = None) -> IdentifiedModel:
        """Return the model of these records; another flight is kept back for validation."""
        names = self.outputs if outputs is None else outputs
        return estimate(self.method, records, INPUTS, names, [flight(99)], **self.settings)


# --- the laws ---------------------------------------------------------------------------------------------------------


def exact_data_are_recovered(t: Trial) -> None:
    """Records without noise give the aircraft's response and predict a flight that was not seen."""
    model = t.run(t.flights(300, 200))
    rows = [OUTPUTS.index(name) for name in t.outputs]
    omega = np.geomspace(*t.band_rad_s, 40)
    expected = true_response(omega, model.continuous)[:, rows]
    found = model.frequency_response(omega)
    need(found.shape == expected.shape, f"the response must have shape {expected.shape}, got {found.shape}")
    error = float((np.abs(found - expected).max(axis=(0, 2)) / np.abs(expected).max(axis=(0, 2))).max())
    need(error < t.exact, f"the response must be within {t.exact:g} of the largest, got {error:.2g}")
    unseen = flight(3)
    y = unseen.columns(t.outputs)
    error = float((np.abs(model.simulate(unseen) - y).max(axis=0) / np.abs(y).max(axis=0)).max())
    need(error < 2.0 * t.exact, f"an unseen flight must be predicted within {2.0 * t.exact:g}, got {error:.2g}")


def a_model_is_complete(t: Trial) -> None:
    """Channels, sample time, simulation, poles by outputs, status with advice."""
    (record,) = t.flights(300, noise=0.05)
    model = t.run([record])
    need(model.inputs == INPUTS, f"inputs must be {INPUTS}, got {model.inputs}")
    need(model.outputs == t.outputs, f"outputs must be {t.outputs}, got {model.outputs}")
    need(math.isclose(model.dt_s, DT, rel_tol=1e-6), f"dt_s must be {DT}, got {model.dt_s}")
    shape = model.simulate(record).shape
    need(shape == (len(record), len(t.outputs)), f"simulate must return {(len(record), len(t.outputs))}, got {shape}")
    names = ", ".join(model.poles())
    need(names == ", ".join(t.outputs), f"poles must be named by the outputs {', '.join(t.outputs)}, got {names}")
    status = status_of(model.advice)
    need(model.status == status, f"status must be that of the advice, '{status}', got '{model.status}'")


def records_stay_as_they_are(t: Trial) -> None:
    """What is given is not changed."""
    (record,) = t.flights(200, noise=0.05)
    before = record.data.tobytes(), record.valid.tobytes()
    t.run([record])
    need((record.data.tobytes(), record.valid.tobytes()) == before, "records must stay as they are, got other bytes")


def the_same_records_give_the_same_bytes(t: Trial) -> None:
    """Nothing is drawn without a seed, nothing kept from the last call."""
    records = t.flights(200, 140, noise=0.05)
    one, other = (pickle.dumps(t.run(records).to_dict()) for _ in range(2))
    need(one == other, "two runs must give the same model, got two")


def a_model_is_written_as_json(t: Trial) -> None:
    """``to_dict`` holds JSON values, without infinities."""
    content = t.run(t.flights(200, noise=0.05)).to_dict()
    try:
        json.dumps(content, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise LawError(f"to_dict must hold JSON values, got: {error}") from error


def a_model_survives_pickling(t: Trial) -> None:
    """Campaigns send models from process to process."""
    (record,) = t.flights(200, noise=0.05)
    model = t.run([record])
    again = pickle.loads(pickle.dumps(model))
    need(np.array_equal(again.simulate(record), model.simulate(record)), "a pickled model must simulate the same")


def several_records_are_taken(t: Trial) -> None:
    """Records of different lengths; the order does not matter beyond 10 %."""
    records = t.flights(200, 140, noise=0.05)
    omega = np.geomspace(*t.band_rad_s, 20)
    a, b = (t.run(part).frequency_response(omega) for part in (records, records[::-1]))
    apart = float((np.abs(a - b).max(axis=(0, 2)) / np.abs(a).max(axis=(0, 2))).max())
    need(apart < 0.1, f"the order of records must not matter, got responses {apart:.2g} apart")


def samples_that_were_not_taken_do_not_count(t: Trial) -> None:
    """Invalid samples hold the value before: they must not move the model, unless such records are refused in words."""
    (clean,) = t.flights(300)
    valid, data = np.ones(clean.data.shape, bool), clean.data.copy()
    for row, column in ((40, 1), (41, 1), (120, 2), (200, 3), (201, 4)):
        valid[row, column], data[row, column] = False, data[row - 1, column]
    try:
        model = t.run([replace(clean, data=data, valid=valid)])
    except EstimationError as error:
        _in_words(error)
        return
    rows = [OUTPUTS.index(name) for name in t.outputs]
    omega = np.geomspace(*t.band_rad_s, 40)
    expected = true_response(omega, model.continuous)[:, rows]
    error_of = np.abs(model.frequency_response(omega) - expected).max(axis=(0, 2))
    worst = float((error_of / np.abs(expected).max(axis=(0, 2))).max())
    need(worst < 3.0 * t.exact, f"samples that were not taken must not count, got an error of {worst:.2g}")


def truth_is_refused(t: Trial) -> None:
    """An estimator that sees the simulation's truth shows nothing."""
    _refused(t, [replace(flight(1), kind="truth")], EstimationError, "a truth record")


def no_excitation_is_refused(t: Trial) -> None:
    """An input that never moves shows nothing."""
    record = flight(1)
    _refused(t, [record.with_columns({"de": np.full(len(record), 0.02)})], EstimationError, "an input that never moves")


def too_little_data_are_refused(t: Trial) -> None:
    """No record, or four samples."""
    _refused(t, [], EstimationError, "no record")
    _refused(t, [flight(1).between(0.0, 0.4)], EstimationError, "four samples")


def missing_channels_are_refused(t: Trial) -> None:
    """A record without an output, and records of two sample times."""
    _refused(t, [flight(1).select((*INPUTS, *t.outputs[1:]))], ChannelError, f"a record without '{t.outputs[0]}'")
    _refused(t, [flight(1), flight(2).decimate(2)], EstimationError, "records of two sample times")


def _refused(t: Trial, records: Sequence[FlightRecord], kind: type[Refusal], what: str) -> None:
    try:
        t.run(records)
    except bring.BroughtCodeError as error:
        _in_words(error)
    except kind:
        return
    except Refusal as error:
        raise LawError(f"{what} must be refused by {kind.__name__}, got {type(error).__name__}: {error}") from error
    raise LawError(f"{what} must be refused by {kind.__name__}, got a model; check_records does it")


def _in_words(error: EstimationError) -> None:
    if isinstance(error, bring.BroughtCodeError):
        raise LawError(f"an EstimationError must say what is wrong with the data, got: {error}") from error


LAWS: tuple[Callable[[Trial], None], ...] = (
    exact_data_are_recovered,
    a_model_is_complete,
    records_stay_as_they_are,
    the_same_records_give_the_same_bytes,
    a_model_is_written_as_json,
    a_model_survives_pickling,
    several_records_are_taken,
    samples_that_were_not_taken_do_not_count,
    truth_is_refused,
    no_excitation_is_refused,
    too_little_data_are_refused,
    missing_channels_are_refused,
)
"""The laws of estimators."""


# --- structures -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Make:
    """A structure under trial: its file and function, and the channels that it is asked for."""

    path: Path
    attribute: str
    inputs: tuple[str, ...] = INPUTS
    outputs: tuple[str, ...] = OUTPUTS

    def made(self) -> ModelStructure:
        """Return what the function makes for the aircraft's channels and trim."""
        make: Callable[..., ModelStructure] = bring.load(self.path, self.attribute)
        return make(self.inputs, self.outputs, Trim(V0, ALPHA0, ALPHA0))

    def start(self, s: ModelStructure) -> tuple[FloatArray, FloatArray]:
        """Return the state (n,) and input (m,) that its flight begins at."""
        return np.zeros(len(s.states)), np.zeros(len(s.inputs))


_LEVEL = {"V": V0, "u": V0, "qbar": 61.0, "alpha": ALPHA0, "theta": ALPHA0, "h": 100.0, "thr": 0.5, "thr_cmd": 0.5}
_LEVEL |= {"w": ALPHA0 * V0, "thrust": 5.0, "motor_speed": 300.0}
"""Channels in level flight, SI units; all others are zero."""


@dataclass(frozen=True)
class Text(Make):
    """A structure of equations as text under trial: all its outputs, from level flight."""

    def made(self) -> ModelStructure:
        """Return the structure with every output that it can have."""
        equations = read_equations(self.path)
        return written(equations, self.path.stem, equations.possible_outputs, Trim(V0, ALPHA0, ALPHA0))

    def start(self, s: ModelStructure) -> tuple[FloatArray, FloatArray]:
        """Return the states where ``initial`` says that they begin in level flight, else zero, and level inputs."""
        row = np.array([[_LEVEL.get(name, 0.0) for name in CHANNELS]])
        level = FlightRecord(np.zeros(1), tuple(CHANNELS), row, "measured")
        return s.initial_state(level, measured=False), np.array([_LEVEL.get(name, 0.0) for name in s.inputs])


def a_structure_is_made(m: Make) -> None:
    """A ModelStructure of the channels that are there, with something free."""
    made = m.made()
    need(isinstance(made, ModelStructure), f"a ModelStructure must be returned, got {type(made).__name__}")
    for have, given in ((made.inputs, m.inputs), (made.outputs, m.outputs)):
        among, got = ", ".join(given), ", ".join(have) or "none"
        need(bool(have) and set(have) <= set(given), f"channels must be among {among}, got {got}")
    need(bool(made.free.any()), "a parameter must be free, got none")


def equations_have_their_shapes(m: Make) -> None:
    """Derivative (..., n) and output (..., p), for any leading axes and for complex numbers."""
    s = m.made()
    n, k, p = len(s.states), len(s.inputs), len(s.outputs)
    x0, u0 = m.start(s)
    for lead in ((), (3,), (2, 3)):
        x, u = np.full((*lead, n), x0 + 0.01 + 0j), np.full((*lead, k), u0 + 0.02 + 0j)
        params = np.broadcast_to(s.values + 0j, (*lead, len(s.parameters)))
        xdot, y = np.asarray(s.derivative(x, u, params)), np.asarray(s.output(x, u, params))
        need(xdot.shape == (*lead, n), f"derivative must have shape {(*lead, n)}, got {xdot.shape}")
        need(y.shape == (*lead, p), f"output must have shape {(*lead, p)}, got {y.shape}")
        need(bool(np.all(np.isfinite(xdot)) and np.all(np.isfinite(y))), "equations must give finite numbers")


def complex_steps_are_derivatives(m: Make) -> None:
    """Derivatives by the complex step equal differences: no abs, no comparison, no real part inside."""
    s = m.made()
    x0, u0 = m.start(s)
    x, u = x0 + 0.01, u0 + 0.02
    for i, name in enumerate(s.parameter_names):
        h = 1e-4 * max(abs(s.values[i]), 1e-2)
        step = np.eye(len(s.parameters))[i]
        for what, f in (("derivative", s.derivative), ("output", s.output)):
            exact = np.imag(f(x + 0j, u + 0j, s.values + 1e-30j * step)) / 1e-30
            near = (f(x, u, s.values + h * step) - f(x, u, s.values - h * step)) / (2.0 * h)
            close = np.allclose(exact, near, rtol=1e-4, atol=1e-6 * (1.0 + np.abs(near).max()))
            need(close, f"{what} must hold for complex numbers, got another slope by '{name}'")


def its_parameters_are_recovered(m: Make) -> None:
    """Output error finds the start values again from a flight that the structure itself flew, begun 5 % off."""
    s = m.made()
    rng = np.random.default_rng(1)
    n, dt = 400, 0.02
    x, level = m.start(s)
    growth = float(np.linalg.eigvals(s.jacobians(x, level, s.values).fx).real.max())
    if growth * n * dt > _GROWN:  # of an unstable one, a flight that is still near its start
        n = max(4 * round(_GROWN / growth / dt / 4), 80)
    u = level + 0.05 * np.repeat(rng.standard_normal((n // 4, len(s.inputs))), 4, axis=0)
    y = np.empty((n, len(s.outputs)))
    for k in range(n):
        y[k] = s.output(x, u[k], s.values)
        k1 = s.derivative(x, u[k], s.values)
        k2 = s.derivative(x + 0.5 * dt * k1, u[k], s.values)
        k3 = s.derivative(x + 0.5 * dt * k2, u[k], s.values)
        x = x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + s.derivative(x + dt * k3, u[k], s.values))
    need(bool(np.all(np.isfinite(y))), "start values must give a flight that stays finite for 8 s")
    seconds = np.arange(n, dtype=np.float64) * dt
    rest = [name for name in CHANNELS if name not in (*s.inputs, *s.outputs)]  # the start may ask for some
    columns = np.hstack([u, y, np.tile([_LEVEL.get(name, 0.0) for name in rest], (n, 1))])
    record = FlightRecord(seconds, (*s.inputs, *s.outputs, *rest), columns, "measured")
    start = {p.name: float(np.clip(1.05 * p.value, p.low, p.high)) for p in s.parameters if p.free}
    model = output_error.estimate([record], s.with_parameters(start), OutputError(initial_states="zero", held=s.inputs))
    for p in s.parameters:
        size = max(abs(p.value), 1e-3)
        got = model.values[p.name]
        need(abs(got - p.value) < 0.02 * size, f"'{p.name}' must be found again at {p.value:g}, got {got:g}")


def a_structure_survives_pickling(m: Make) -> None:
    """Campaigns send structures from process to process."""
    s = m.made()
    again = pickle.loads(pickle.dumps(s))
    need(again.parameter_names == s.parameter_names, "a pickled structure must have the same parameters")


STRUCTURE_LAWS: tuple[Callable[[Make], None], ...] = (
    a_structure_is_made,
    equations_have_their_shapes,
    complex_steps_are_derivatives,
    its_parameters_are_recovered,
    a_structure_survives_pickling,
)
"""The laws of structures."""


# --- the command ------------------------------------------------------------------------------------------------------


def tried(name: str) -> Iterator[Law]:
    """Yield every law and whether it holds, for what a user brings: ``FILE.py:NAME`` or ``FILE.toml``.

    A function whose first argument is ``records`` is tried as an estimator, one of (inputs, outputs, trim) as a
    structure. A table ``CHECK`` in the file says with what an estimator is tried: "settings", "exact" (largest relative
    error on records without noise; 0.05 if not given) and "outputs" (of theta, q, alpha, V; all if not given).

    Raises:
        ScenarioError: the file is not found, cannot be run or lacks the name.
        EstimationError: it is neither, or CHECK has another key.
    """
    if is_text(name):
        path = text_file(name, None)
        s = Text(path, "").made()
        yield from tried_on(Text(path, "", s.inputs, s.outputs), STRUCTURE_LAWS, path)
        return
    path, attribute = bring.find(name, None, FOLDER)
    what = bring.load(path, attribute)
    kind = kind_of(what)
    if kind == "structure":
        yield from tried_on(Make(path, attribute), STRUCTURE_LAWS, path)
        return
    if not kind:
        raise EstimationError(
            f"'{bring.short(name)}' must be an estimator (records, inputs, outputs, settings, validation=()) or a "
            f"structure's function (inputs, outputs, trim), got {type(what).__name__} "
            f"({', '.join(_arguments(what)[:3])})"
        )
    yield from tried_on(Trial(f"{path}:{attribute}", **_check_table(path)), LAWS, path)


def kind_of(what: object) -> str:
    """Return "estimator" or "structure", as the first argument of a function tells; "" if it is neither."""
    return {"records": "estimator", "inputs": "structure"}.get(next(iter(_arguments(what)), ""), "")


def _arguments(what: object) -> tuple[str, ...]:
    return tuple(getattr(getattr(what, "__code__", None), "co_varnames", ()))


def _check_table(path: Path) -> dict[str, Any]:
    if "CHECK" not in bring.declared(path).names:
        return {}
    table = dict(bring.load(path, "CHECK"))
    known = ("settings", "exact", "outputs")
    for key in table:
        if key not in known:
            raise EstimationError(f"CHECK of {path.name} has no key '{key}'{nearest(key, known)}")
    if "outputs" in table:
        table["outputs"] = tuple(table["outputs"])
    return table
