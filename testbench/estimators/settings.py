"""The settings of the methods, one class each: what a method takes, with the limits and the defaults.

An entry ``identification.estimators`` of a scenario is such a class; where a method fits a structure, the class whose
name ends in Entry, which names the structure besides. Every reading of a scenario imports this module, so it imports
nothing that takes time.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from testbench.core.bring import short
from testbench.core.errors import EstimationError
from testbench.core.schema import Band, Names, NonNegative, Positive, Strict, parse
from testbench.estimators.structured import Fitted, Structured

Count = Annotated[int, Field(ge=1)]
Horizon = Annotated[int, Field(ge=2)]
Offset = Literal["none", "offset", "trend"]
Hold = Literal["zoh", "foh"]


class Settings(Strict):
    """The settings of all methods: the name in :data:`testbench.estimators.METHODS`, and a label in tables.

    Made in Python, settings that break a law raise one EstimationError, with every fault in words.
    """

    method: str
    label: str | None = None

    @property
    def shown(self) -> str:
        """The label in tables, or the method if there is none; of a method that is brought, file and function."""
        return self.label or short(self.method)

    def __init__(self, **given: Any) -> None:
        try:
            super().__init__(**given)
        except ValidationError:
            faults = parse(type(self), given, None)[1]
            raise EstimationError(f"settings of {type(self).__name__}: " + "; ".join(faults)) from None

    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]  # a file's entries are made without it


class DsrE(Settings):
    """Subspace identification DSR_e.

    Attributes:
        past_horizon: J in samples. (A - K C)^J must be negligible, while J (m + p) unknowns per output have to stay
            well below the number of samples.
        future_horizon: L in samples. L times the sample time should reach a good part of the fastest mode's time
            constant: over a shorter time the states' contributions differ by less than the noise.
        order: number of states; chosen from the singular values if not given.
        direct_feedthrough: estimate D; zero if not.
        variant: "original" projects the future inputs out, as Di Ruscio does; "eolo" takes the oblique projection as
            the EOLO paper writes it, which band-limited inputs break; it is compared with the original one.
        offset: "none", "offset" or "trend": constants, or constants and linear trends, of all channels and records
            that are estimated along; the model itself is of the deviations from them.
        decimate: stride of the low-passed samples that A and C are identified from, or "auto": to ten times the
            bandwidth of the inputs. The horizons of A and C count those samples; the model has the records' rate.
        stable: move poles outside the unit circle to their mirror image 1/z* inside.
        closed_loop: keep B of the deterministic problem, which feedback does not bias (D must be zero), instead of
            that of the free run, whose errors then correlate with the inputs.
    """

    method: Literal["dsr_e"] = "dsr_e"
    past_horizon: Count
    future_horizon: Horizon
    order: Count | None = None
    direct_feedthrough: bool = False
    variant: Literal["original", "eolo"] = "original"
    offset: Offset = "none"
    decimate: Count | Literal["auto"] = 1
    stable: bool = False
    closed_loop: bool = False

    @model_validator(mode="after")
    def _without_feedthrough(self) -> DsrE:
        if self.variant == "eolo" and self.direct_feedthrough:
            raise ValueError("variant 'eolo' has D = 0, got direct_feedthrough = true")
        return self


class Subspace(Settings):
    """Any other subspace method; horizons count samples of the rate at which A is identified.

    Attributes:
        past_horizon: J.
        future_horizon: L.
        order: number of states; chosen from the singular values if not given.
        direct_feedthrough: estimate D; zero if not.
        offset: as of :class:`DsrE`.
        decimate: stride of the samples that A and C are identified from, or "auto": 1 unless the inputs excite only a
            small part of the band.
        stable: move poles outside the unit circle to their mirror image 1/z* inside.
        closed_loop: take B and D from the regression on states and innovations, which feedback does not bias, instead
            of the free run, whose errors then correlate with the inputs; "ssarx" and "pbsid_opt" only, not decimated.
        bootstrap: number of replicas (0: none) of the residuals of the free run, drawn in blocks of J + L samples,
            from which deviations of poles and frequency response are taken; for open loop.
        seed: of the bootstrap.
    """

    method: Literal["moesp", "n4sid", "cva", "dsr", "ssarx", "pbsid_opt"]
    past_horizon: Count
    future_horizon: Horizon
    order: Count | None = None
    direct_feedthrough: bool = False
    offset: Offset = "none"
    decimate: Count | Literal["auto"] = "auto"
    stable: bool = False
    closed_loop: bool = False
    bootstrap: Annotated[int, Field(ge=0)] = 0
    seed: Annotated[int, Field(ge=0)] = 0

    @model_validator(mode="after")
    def _possible(self) -> Subspace:
        if self.bootstrap == 1:
            raise ValueError("bootstrap must be 0 or at least 2 replicas, got 1")
        if self.closed_loop and (self.method not in ("ssarx", "pbsid_opt") or self.decimate not in ("auto", 1)):
            raise ValueError(
                f"closed_loop needs ssarx or pbsid_opt without decimation, got '{self.method}' with decimate = "
                f"{self.decimate}"
            )
        return self


class TransferFunctions(Settings):
    """One least-squares transfer function per output, chosen among candidates on the validation part.

    Attributes:
        poles: n of each transfer function, or candidates.
        zeros: candidates nz; of several numbers of poles each takes those below it.
        delay_samples: candidates d.
    """

    method: Literal["transfer_function"] = "transfer_function"
    poles: Count | Annotated[tuple[Count, ...], Field(min_length=1, strict=False)]
    zeros: Annotated[tuple[int, ...], Field(min_length=1, strict=False)]
    delay_samples: Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=1, strict=False)] = (0,)

    @model_validator(mode="after")
    def _proper(self) -> TransferFunctions:
        if isinstance(self.poles, int) and not all(0 <= z < self.poles for z in self.zeros):
            raise ValueError(
                f"0 <= zeros < poles = {self.poles} must hold for every entry of zeros, got {list(self.zeros)}"
            )
        if not isinstance(self.poles, int) and not 0 <= min(self.zeros) < max(self.poles):
            raise ValueError(f"0 <= zeros < poles must hold, got {list(self.zeros)} of {list(self.poles)} poles")
        return self


class Srivc(Settings):
    """Continuous-time transfer functions by refined instrumental variables; orders and delay chosen on held-out data.

    Attributes:
        poles: candidates n.
        zeros: candidates nz of every numerator; those above a candidate's n are left out.
        delay_samples: candidates of each input's delay, in samples, whole or not.
        refine_delay: estimate each delay, from the best candidate on, with the coefficients.
        hold: how inputs run between samples, of all or by input; if not given, commands are held, and deflections that
            the records show to step from sample to sample; others run linearly.
        offset: fit a constant per record, for trim values that are not exact.
    """

    method: Literal["srivc"] = "srivc"
    poles: Annotated[tuple[Count, ...], Field(min_length=1, strict=False)]
    zeros: Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=1, strict=False)]
    delay_samples: Annotated[tuple[NonNegative, ...], Field(min_length=1, strict=False)] = (0.0,)
    refine_delay: bool = False
    hold: Hold | dict[str, Hold] | None = None
    offset: bool = False

    @model_validator(mode="after")
    def _proper(self) -> Srivc:
        if min(self.zeros) > max(self.poles):
            raise ValueError(f"some zeros <= poles must hold, got zeros {list(self.zeros)}, poles {list(self.poles)}")
        return self


class LowOrder(Settings):
    """A low-order equivalent model with delay of a frequency response.

    Attributes:
        poles: n of each denominator.
        zeros: number of zeros, 0 <= nz <= n, for all outputs or by output.
        delay: fit one delay for each pair of output and input.
        common: one denominator for all outputs, not one each.
        weighting: of the misfit: "loes" as in flying-qualities work, or "likelihood" by the response's random error.
        band_hz: frequencies used; all if not given.
        hold: how inputs run between samples, of all or by input; if not given, commands are held, and deflections that
            the records show to step from sample to sample; others run linearly.
    """

    method: Literal["equivalent"] = "equivalent"
    poles: Count
    zeros: Annotated[int, Field(ge=0)] | dict[str, Annotated[int, Field(ge=0)]]
    delay: bool = True
    common: bool = True
    weighting: Literal["loes", "likelihood"] = "likelihood"
    band_hz: Band | None = None
    hold: Hold | dict[str, Hold] | None = None

    @model_validator(mode="after")
    def _proper(self) -> LowOrder:
        most = self.zeros if isinstance(self.zeros, int) else max(self.zeros.values(), default=0)
        if not most <= self.poles:
            raise ValueError(f"zeros <= poles = {self.poles} must hold, got {self.zeros}")
        return self


class Equivalent(LowOrder):
    """A low-order equivalent model with delay, fitted to the frequency response from windows of these lengths."""

    window_s: Annotated[tuple[Positive, ...], Field(min_length=1, strict=False)]


class Refinement(Settings):
    """A discrete state-space model by prediction errors, started from another model.

    Attributes:
        disturbances: estimate K; without, K = 0 and the free run is fitted (output error).
        direct_feedthrough: estimate D; if not given, where the start has one.
        offsets: a constant of its own for every output and record; the model does not hold them.
        max_iterations: Gauss-Newton steps per round.
    """

    method: Literal["prediction_error"] = "prediction_error"
    disturbances: bool = True
    direct_feedthrough: bool | None = None
    offsets: bool = False
    max_iterations: Count = 20


class PredictionError(Refinement):
    """A discrete state-space model by prediction errors, started from a subspace estimate.

    Attributes:
        start: subspace method of the start, with its ``order`` and its horizons, samples.
    """

    start: Literal["dsr_e", "moesp", "n4sid", "cva", "dsr", "ssarx", "pbsid_opt"] = "cva"
    order: Count
    past_horizon: Count
    future_horizon: Horizon
    direct_feedthrough: bool = False


class EquationError(Fitted, Settings):
    """Least squares on the state equations of a structure; all its states measured.

    Attributes:
        cutoff_hz: of the smoothing; chosen from each record if not given.
    """

    method: Literal["equation_error"] = "equation_error"
    cutoff_hz: Positive | None = None


class RecursiveFourier(Fitted, Settings):
    """Least squares on the state equations in real time, on transforms over a band; all its states measured.

    Attributes:
        band_hz: should hold the modes and nothing that the structure lacks.
        step_hz: distance of the lines.
        update_s: time between estimates, counted back from the last sample of each record.
        forgetting: weight of a sample against the next; the memory is dt / (1 - forgetting).
    """

    method: Literal["recursive_fourier"] = "recursive_fourier"
    band_hz: Band = (0.1, 2.0)
    step_hz: Positive = 0.04
    update_s: Positive = 1.0
    forgetting: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0


class Simulated(Fitted, Settings):
    """What methods share that compare simulated with measured outputs.

    They start from the values of the structure (and of ``start``) or, where all states are measured, from those of
    equation error, whichever follow the records better.

    Attributes:
        initial_states: "free" estimates one per record; "record" takes the first sample of the channels of that name,
            "zero" takes trim.
        output_biases: outputs with a constant of their own in every record.
        output_trends: outputs with a line of their own in every record.
        input_biases: inputs with a constant error of their own in every record.
        late_std_s: input -> standard deviation of how late, or early, it may act against the time that is logged;
            estimated in every record, with this prior about zero.
        max_iterations: Gauss-Newton steps per round.
        substeps: Runge-Kutta steps per sample of a nonlinear structure.
    """

    initial_states: Literal["free", "record", "zero"] = "free"
    output_biases: Names = ()
    output_trends: Names = ()
    input_biases: Names = ()
    late_std_s: dict[str, Positive] = {}
    max_iterations: Count = 50
    substeps: Count = 1


class OutputError(Simulated):
    """Maximum likelihood for measurement noise only.

    Attributes:
        noise: "diagonal" or "full" covariance of the residuals.
        starts: how many start points; the best end wins. The structure's own values and those of equation error come
            first, the better at the head; others scatter by half of the values, or over finite bounds. If not given:
            one, and if its fit looks bad others (filter error's too) until two have ended at the least cost.
        seed: of the start points.
    """

    method: Literal["output_error"] = "output_error"
    noise: Literal["diagonal", "full"] = "diagonal"
    starts: Count | None = None
    seed: Annotated[int, Field(ge=0)] = 0


ProcessNoiseModel = Literal["auto", "none", "diagonal", "full", "gust"]


class FilterError(Simulated):
    """Maximum likelihood for process noise (turbulence) and measurement noise.

    Attributes:
        process_noise: states whose process noise is estimated; if not given, all that ``fixed_process_noise`` does not
            name, but for those of servos.
        process_noise_model: "none", "diagonal" (each state by itself), "full" (the states together), "gust" (of first
            order, in the flow angle; see ``kalman.gust``), or "auto": the likelihood chooses among them, between none
            and diagonal if states are named (see ``kalman.forms``).
        fixed_process_noise: state -> known process noise, unit of the state per square root of a second.
        against_none: test whether there is any process noise, by a second fit without it; it changes nothing of a
            single form that is asked for.
    """

    method: Literal["filter_error"] = "filter_error"
    process_noise: Names | None = None
    process_noise_model: ProcessNoiseModel = "auto"
    fixed_process_noise: dict[str, NonNegative] = {}
    against_none: bool = True


class ExtendedFilter(Fitted, Settings):
    """Parameters as states of an extended Kalman filter; noise in SI units.

    Attributes:
        measurement_noise: output -> standard deviation; those not named from third differences of the record.
        process_noise: state -> process noise, unit of the state per square root of a second; 0 where not named.
        parameter_drift: free parameter -> random walk, unit per square root of a second; constant where not named.
        initial_std: state or free parameter -> standard deviation of its prior at the start. By default that of the
            parameter; without one, wide enough to move the outputs by as much as they move.
        substeps: Runge-Kutta steps per sample.
        smooth: also estimate along each record from all of it (Rauch, Tung and Striebel).
        passes: how often the filter runs over the records; 1 is the filter as it would run in flight. Each further pass
            starts near where the last one ended, and takes measurement noise that is not named from its innovations:
            a single pass from wide priors linearises at points far off, and its errors come out too small. Parameters
            that drift get one pass.
    """

    method: Literal["ekf"] = "ekf"
    measurement_noise: dict[str, Positive] = {}
    process_noise: dict[str, NonNegative] = {}
    parameter_drift: dict[str, NonNegative] = {}
    initial_std: dict[str, Positive] = {}
    substeps: Count = 1
    smooth: bool = False
    passes: Count = 3


class UnscentedFilter(ExtendedFilter):
    """Parameters as states of an unscented Kalman filter, its sigma points spread by alpha, beta and kappa.

    Attributes:
        alpha: spread of the sigma points.
        beta: 2 for Gaussian distributions.
        kappa: second spread; s + kappa > 0 for s states and parameters.
    """

    method: Literal["ukf"] = "ukf"  # type: ignore[assignment]
    alpha: Annotated[float, Field(gt=0.0, le=1.0)] = 0.1
    beta: float = 2.0
    kappa: float = 0.0


# --- entries of a scenario: the settings, and the structure that the method fits --------------------------------------


class EquationErrorEntry(Structured, EquationError):
    """Least squares on the state equations of a structure; all its states measured."""


class RecursiveFourierEntry(Structured, RecursiveFourier):
    """Least squares on the state equations of a structure in real time, on transforms over a band."""


class OutputErrorEntry(Structured, OutputError):
    """A structure by maximum likelihood for measurement noise only."""


class FilterErrorEntry(Structured, FilterError):
    """A structure by maximum likelihood for process noise (turbulence) and measurement noise."""


class ExtendedFilterEntry(Structured, ExtendedFilter):
    """A structure's parameters as states of an extended Kalman filter; noise in SI units."""


class UnscentedFilterEntry(Structured, UnscentedFilter):
    """A structure's parameters as states of an unscented Kalman filter; noise in SI units."""
