"""The settings of the methods, one class each: an entry ``identification.estimators`` of a scenario, and the defaults.

Every reading of a scenario imports this module, so it imports nothing that takes time.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from testbench.core.bring import short
from testbench.core.schema import NonNegative, Positive, Strict
from testbench.estimators.structured import Structured

Count = Annotated[int, Field(ge=1)]
Horizon = Annotated[int, Field(ge=2)]
Names = Annotated[tuple[str, ...], Field(strict=False)]


class Settings(Strict):
    """The settings of all methods: the name in :data:`testbench.estimators.METHODS`, and a label in tables."""

    method: str
    label: str | None = None

    @property
    def shown(self) -> str:
        """The label in tables, or the method if there is none; of a method that is brought, file and function."""
        return self.label or short(self.method)


class DsrE(Settings):
    """Subspace identification DSR_e; order chosen from the singular values if not given.

    ``variant`` "original" projects the future inputs out, as Di Ruscio does; "eolo" takes the oblique projection as the
    EOLO paper writes it, which band-limited inputs break.
    """

    method: Literal["dsr_e"] = "dsr_e"
    order: Count | None = None
    past_horizon: Count
    future_horizon: Horizon
    direct_feedthrough: bool = False
    variant: Literal["original", "eolo"] = "original"
    offset: Literal["none", "offset", "trend"] = "none"
    decimate: Count | Literal["auto"] = 1
    stable: bool = False
    closed_loop: bool = False


class Subspace(Settings):
    """Any other subspace method; horizons count samples of the rate at which A is identified."""

    method: Literal["moesp", "n4sid", "cva", "dsr", "ssarx", "pbsid_opt"]
    order: Count | None = None
    past_horizon: Count
    future_horizon: Horizon
    direct_feedthrough: bool = False
    offset: Literal["none", "offset", "trend"] = "none"
    decimate: Count | Literal["auto"] = "auto"
    stable: bool = False
    closed_loop: bool = False
    bootstrap: Annotated[int, Field(ge=0)] = 0
    seed: Annotated[int, Field(ge=0)] = 0


class TransferFunctions(Settings):
    """One least-squares transfer function per output; the number of zeros is chosen on the validation part."""

    method: Literal["transfer_function"] = "transfer_function"
    poles: Count
    zeros: Annotated[tuple[int, ...], Field(min_length=1, strict=False)]
    delay_samples: Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=1, strict=False)] = (0,)

    @model_validator(mode="after")
    def _proper(self) -> TransferFunctions:
        if not all(0 <= z < self.poles for z in self.zeros):
            raise ValueError(
                f"0 <= zeros < poles = {self.poles} must hold for every entry of zeros, got {list(self.zeros)}"
            )
        return self


class Srivc(Settings):
    """Continuous-time transfer functions by refined instrumental variables; orders and delay chosen on held-out data.

    ``hold`` says how inputs run between samples; if not given, commands are held, and deflections that the records show
    to step from sample to sample; others run linearly.
    """

    method: Literal["srivc"] = "srivc"
    poles: Annotated[tuple[Count, ...], Field(min_length=1, strict=False)]
    zeros: Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=1, strict=False)]
    delay_samples: Annotated[tuple[NonNegative, ...], Field(min_length=1, strict=False)] = (0.0,)
    refine_delay: bool = False
    hold: Literal["zoh", "foh"] | None = None
    offset: bool = False

    @model_validator(mode="after")
    def _proper(self) -> Srivc:
        if min(self.zeros) >= max(self.poles):
            raise ValueError(f"some zeros < poles must hold, got zeros {list(self.zeros)} and poles {list(self.poles)}")
        return self


class Equivalent(Settings):
    """A low-order equivalent model with delay, fitted to the frequency response from windows of these lengths.

    ``hold`` says how inputs run between samples; if not given, commands are held, and deflections that the records show
    to step from sample to sample; others run linearly.
    """

    method: Literal["equivalent"] = "equivalent"
    window_s: Annotated[tuple[Positive, ...], Field(min_length=1, strict=False)]
    poles: Count
    zeros: Annotated[int, Field(ge=0)]
    delay: bool = True
    common: bool = True
    weighting: Literal["loes", "likelihood"] = "likelihood"
    band_hz: Annotated[tuple[Positive, Positive], Field(strict=False)] | None = None
    hold: Literal["zoh", "foh"] | None = None

    @model_validator(mode="after")
    def _proper(self) -> Equivalent:
        if not self.zeros < self.poles:
            raise ValueError(f"zeros < poles = {self.poles} must hold, got {self.zeros}")
        if self.band_hz is not None and not self.band_hz[0] < self.band_hz[1]:
            raise ValueError(f"band_hz must rise, got {list(self.band_hz)}")
        return self


class PredictionError(Settings):
    """A discrete state-space model by prediction errors, started from a subspace estimate."""

    method: Literal["prediction_error"] = "prediction_error"
    start: Literal["dsr_e", "moesp", "n4sid", "cva", "dsr", "ssarx", "pbsid_opt"] = "cva"
    order: Count
    past_horizon: Count
    future_horizon: Horizon
    disturbances: bool = True
    direct_feedthrough: bool = False
    offsets: bool = False
    max_iterations: Count = 20


class EquationError(Settings, Structured):
    """Least squares on the state equations of a structure; all its states measured."""

    method: Literal["equation_error"] = "equation_error"
    cutoff_hz: Positive | None = None


class RecursiveFourier(Settings, Structured):
    """Least squares on the state equations in real time, on transforms over a band; all its states measured.

    The band should hold the modes and nothing that the structure lacks. ``forgetting`` weighs a sample against the
    next; its memory is dt / (1 - forgetting).
    """

    method: Literal["recursive_fourier"] = "recursive_fourier"
    band_hz: Annotated[tuple[Positive, Positive], Field(strict=False)] = (0.1, 2.0)
    step_hz: Positive = 0.04
    update_s: Positive = 1.0
    forgetting: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0

    @model_validator(mode="after")
    def _band(self) -> RecursiveFourier:
        if not self.band_hz[0] < self.band_hz[1]:
            raise ValueError(f"band_hz must rise, got {list(self.band_hz)}")
        return self


class _Simulated(Settings, Structured):
    """What methods share that compare simulated with measured outputs.

    They start from the values of the structure (and of ``start``) or, where all states are measured, from those of
    equation error, whichever follow the records better.
    """

    initial_states: Literal["free", "record", "zero"] = "free"
    output_biases: Names = ()
    output_trends: Names = ()
    input_biases: Names = ()
    max_iterations: Count = 50
    substeps: Count = 1


class OutputError(_Simulated):
    """Maximum likelihood for measurement noise only.

    ``starts``: how many start points; if not given one, and others where its fit looks bad. ``late_std_s``: input ->
    standard deviation of how late, or early, it may act against the time that is logged, which is then estimated.
    """

    method: Literal["output_error"] = "output_error"
    noise: Literal["diagonal", "full"] = "diagonal"
    late_std_s: dict[str, Positive] = {}
    starts: Count | None = None
    seed: Annotated[int, Field(ge=0)] = 0


ProcessNoiseModel = Literal["auto", "none", "diagonal", "full", "gust"]


class FilterError(_Simulated):
    """Maximum likelihood for process noise (turbulence) and measurement noise.

    ``process_noise`` names the states whose process noise is estimated; all if not given. ``process_noise_model`` says
    what form it has: "none", "diagonal" (each state by itself), "full" (the states together), "gust" (of first order,
    in the flow angle), or "auto": the likelihood chooses. ``against_none`` tests whether there is any process noise, by
    a second fit without it; it changes nothing of a single form that is asked for.
    """

    method: Literal["filter_error"] = "filter_error"
    process_noise: Names | None = None
    process_noise_model: ProcessNoiseModel = "auto"
    fixed_process_noise: dict[str, NonNegative] = {}
    against_none: bool = True


class ExtendedFilter(Settings, Structured):
    """Parameters as states of an extended Kalman filter; noise in SI units."""

    method: Literal["ekf"] = "ekf"
    measurement_noise: dict[str, Positive] = {}
    process_noise: dict[str, NonNegative] = {}
    parameter_drift: dict[str, NonNegative] = {}
    initial_std: dict[str, Positive] = {}
    substeps: Count = 1
    smooth: bool = False
    passes: Count = 3


class UnscentedFilter(ExtendedFilter):
    """Parameters as states of an unscented Kalman filter, its sigma points spread by alpha, beta and kappa."""

    method: Literal["ukf"] = "ukf"  # type: ignore[assignment]
    alpha: Annotated[float, Field(gt=0.0, le=1.0)] = 0.1
    beta: float = 2.0
    kappa: float = 0.0
