"""Estimators: measured records in, identified model out; one file per method, one row per method in :data:`METHODS`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from testbench.core.advice import ranked
from testbench.core.blas import on_one_thread
from testbench.core.bring import is_brought
from testbench.core.bring import whose as whose_code
from testbench.core.errors import EstimationError, nearest
from testbench.core.named import Named, obtain_all
from testbench.core.record import FlightRecord
from testbench.core.schema import parse
from testbench.estimators import brought
from testbench.estimators.brought import OwnMethod, is_text, place
from testbench.estimators.settings import (
    DsrE,
    EquationErrorEntry,
    Equivalent,
    ExtendedFilterEntry,
    FilterErrorEntry,
    OutputErrorEntry,
    PredictionError,
    RecursiveFourierEntry,
    Settings,
    Srivc,
    Subspace,
    TransferFunctions,
    UnscentedFilterEntry,
)
from testbench.estimators.structured import Structured

if TYPE_CHECKING:
    from testbench.estimators.model import IdentifiedModel

__all__ = ["METHODS", "Method", "estimate"]

NEEDS = {
    "inputs held": "the model is discrete: its inputs are held between samples",
    "one input": "a single input channel",
    "all states": "every state of the structure is a channel of the records",
    "structure": "equations with named parameters",
    "validation": "records kept back, by which it chooses among the candidates of its structure",
}
"""What a method may need, in words. All need one sample time; samples that were not taken do not count."""

GIVES = {
    "poles": "continuous-time poles, and the frequency response",
    "transfer functions": "numerators and denominators, one per output",
    "derivatives": "values of the structure's parameters",
    "errors": "standard errors of what it gives",
    "errors (bootstrap)": "standard errors of poles and frequency response, if replicas are asked for",
}
"""What a method may give, in words."""


@dataclass(frozen=True)
class Method:
    """A method of estimation."""

    words: str  #: what it is
    settings: type[Settings]  #: class of its settings: the entry in a scenario, the limits and the defaults
    #: "module:name" below ``testbench.estimators``, imported when it is first called. It takes ``(records, inputs,
    #: outputs, settings)``, or ``(records, structure, settings)`` if the settings name a structure.
    function: str
    needs: tuple[str, ...] = ()  #: what it needs, names from :data:`NEEDS`
    gives: tuple[str, ...] = ("poles",)  #: what it gives, names from :data:`GIVES`

    def load(self) -> Callable[..., IdentifiedModel]:
        """Return the function, imported."""
        module, _, name = self.function.partition(":")
        function: Callable[..., IdentifiedModel] = getattr(import_module(f"testbench.estimators.{module}"), name)
        return function


_FAMILY: tuple[Any, ...] = (Subspace, "subspace.family:estimate", ("inputs held",), ("poles", "errors (bootstrap)"))
_PARAMETERS = ("derivatives", "poles", "errors")


class Methods(dict[str, Method]):
    """Method name in a scenario -> what it is, its settings, its function, what it needs and gives.

    Example:
        >>> import testbench as tb
        >>> tb.METHODS["output_error"].words
        'a model structure by maximum likelihood for measurement noise'
        >>> tb.METHODS["output_error"].gives
        ('derivatives', 'poles', 'errors')
    """


METHODS = Methods(
    {
        "dsr_e": Method(
            "subspace identification DSR_E: one state-space model from all inputs to all outputs",
            DsrE,
            "subspace.dsr_e:estimate",
            ("inputs held",),
        ),
        "moesp": Method("subspace identification PO-MOESP: orthogonal projection on past inputs and outputs", *_FAMILY),
        "n4sid": Method("subspace identification N4SID: oblique projection on past inputs and outputs", *_FAMILY),
        "cva": Method("subspace identification CVA: canonical correlations of past and future", *_FAMILY),
        "dsr": Method("subspace identification DSR: Di Ruscio's deterministic and stochastic realisation", *_FAMILY),
        "ssarx": Method(
            "subspace identification SSARX: a long ARX predictor first; consistent in closed loop", *_FAMILY
        ),
        "pbsid_opt": Method(
            "subspace identification PBSID-opt: states from a long ARX predictor; consistent in closed loop", *_FAMILY
        ),
        "prediction_error": Method(
            "discrete state-space model by prediction errors, started from a subspace estimate",
            PredictionError,
            "prediction_error:estimate",
            ("inputs held",),
            ("poles", "errors"),
        ),
        "transfer_function": Method(
            "least squares (ARX): one transfer function per output, from one input",
            TransferFunctions,
            "transfer_function:estimate",
            ("inputs held", "one input", "validation"),
            ("transfer functions", "poles", "errors"),
        ),
        "srivc": Method(
            "continuous-time transfer functions by refined instrumental variables",
            Srivc,
            "srivc:estimate",
            ("validation",),
            ("transfer functions", "poles", "errors"),
        ),
        "equivalent": Method(
            "low-order equivalent model with delay, fitted to the frequency response",
            Equivalent,
            "frequency.equivalent:estimate",
            (),
            ("transfer functions", "poles", "errors"),
        ),
        "equation_error": Method(
            "a model structure by least squares on its state equations",
            EquationErrorEntry,
            "parametric.equation_error:estimate",
            ("structure", "all states"),
            _PARAMETERS,
        ),
        "recursive_fourier": Method(
            "a model structure in real time, by least squares on recursive Fourier transforms over a band",
            RecursiveFourierEntry,
            "parametric.recursive_fourier:estimate",
            ("structure", "all states"),
            _PARAMETERS,
        ),
        "output_error": Method(
            "a model structure by maximum likelihood for measurement noise",
            OutputErrorEntry,
            "parametric.output_error:estimate",
            ("structure",),
            _PARAMETERS,
        ),
        "filter_error": Method(
            "a model structure by maximum likelihood for process and measurement noise (turbulence)",
            FilterErrorEntry,
            "parametric.filter_error:estimate",
            ("structure",),
            _PARAMETERS,
        ),
        "ekf": Method(
            "a model structure by an extended Kalman filter with its parameters as states",
            ExtendedFilterEntry,
            "parametric.kalman.ekf:estimate",
            ("structure",),
            _PARAMETERS,
        ),
        "ukf": Method(
            "a model structure by an unscented Kalman filter with its parameters as states",
            UnscentedFilterEntry,
            "parametric.kalman.ukf:estimate",
            ("structure",),
            _PARAMETERS,
        ),
    }
)


@on_one_thread
def estimate(
    method: str | Settings,
    records: Sequence[Named[FlightRecord]],
    inputs: Sequence[str],
    outputs: Sequence[str],
    validation: Sequence[Named[FlightRecord]] = (),
    **settings: Any,
) -> IdentifiedModel:
    """Identify a model by a method of :data:`METHODS`, or by your own.

    Args:
        method: a name, with its settings as keywords; or an entry ``identification.estimators`` of a scenario.
        records: measured records to identify from, as deviations from trim (see ``prepare``).
        inputs: (m,) input channels.
        outputs: (p,) output channels.
        validation: measured records by which a method may choose its structure.
        settings: settings of the method: the fields of its settings class, which has the defaults.

    Raises:
        EstimationError: the data cannot support the estimate, the method is not in :data:`METHODS`, or a setting
            breaks a law of its class.
        ChannelError: a record lacks a channel.

    Example:
        >>> import testbench as tb
        >>> tb.estimate("dsr_e", [record], ["de_cmd"], ["q"], past_horizon=20, future_horizon=20)  # doctest: +SKIP
        >>> tb.estimate("my_method.py:estimate", [record], ["de_cmd"], ["q"])  # doctest: +SKIP
    """
    flown, held = obtain_all(FlightRecord, records), obtain_all(FlightRecord, validation)
    entry: Any = settings_of(method, settings)
    if not outputs:
        raise EstimationError("an estimate needs at least one output channel, got none; name outputs or add sensors")
    if isinstance(entry, OwnMethod):
        return brought.run(entry, flown, inputs, outputs, held)
    row = _row(entry.method)
    if isinstance(entry, Structured):
        from testbench.estimators.parametric.accuracy import chosen
        from testbench.estimators.parametric.servo import by_surfaces, in_front
        from testbench.estimators.parametric.starts import of_servos, started
        from testbench.estimators.parametric.structures.written import Written

        entry = of_servos(entry)
        structure: Any = started(entry, flown, inputs, outputs)
        run: Any = row.load()

        def fit(of: Any) -> Any:
            """Fit a structure by the method of the entry."""
            known = in_front(of) and of.limited and not of.unknown
            return by_surfaces(flown, of, entry, run) if known else run(flown, of, entry)

        if entry.choose:
            law = structure.base if in_front(structure) else structure
            may = [n for n in law.parameter_names if n not in law.trim_constants]
            model = chosen(structure, {n: entry.start.get(n, 0.0) for n in may}, flown, fit)
        else:
            model = fit(structure)
        whose = {"structure": whose_code(*place(entry.structure))} if is_brought(entry.structure) else {}
        if is_text(entry.structure):
            path = Path(entry.structure)
            whose = {"structure": whose_code(path, path.stem)}
        model = replace(model, provenance=whose) if whose else model
        law = structure.base if in_front(structure) else structure
        doubts = law.doubts(flown) if isinstance(law, Written) else ()
        if doubts:
            model = replace(model, advice=ranked((*model.advice, *doubts)))
        return model
    judged = {"validation": held} if "validation" in row.needs else {}
    return row.load()(flown, inputs, outputs, entry, **judged)


def settings_of(method: str | Settings, given: dict[str, Any]) -> Settings:
    """Return the settings of a method, from its name and keywords, checked as an entry of a scenario is.

    Raises:
        EstimationError: the method is not in :data:`METHODS`, or a setting breaks a law; all faults are listed.
    """
    if isinstance(method, str) and is_brought(method):
        return brought.of_python(method, given)
    if isinstance(method, OwnMethod):
        return method
    if isinstance(method, str):
        entry, faults = parse(_row(method).settings, {"method": method, **given}, None)
    else:
        _row(str(getattr(method, "method", method)))
        entry, faults = (parse(type(method), {**dict(method), **given}, None)) if given else (method, [])
    if entry is None or faults:
        raise EstimationError(f"settings of {method}: " + "; ".join(faults))
    return entry


def _row(method: str) -> Method:
    if method not in METHODS:
        raise EstimationError(f"the method must be one of the table, got '{method}'{nearest(method, METHODS)}")
    return METHODS[method]
