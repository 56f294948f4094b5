"""The estimators of a scenario: one class per method."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from testbench.core.schema import NonNegative, Positive, Strict
from testbench.estimators.structured import Structured

Count = Annotated[int, Field(ge=1)]
Horizon = Annotated[int, Field(ge=2)]
Names = Annotated[tuple[str, ...], Field(strict=False)]


class _Method(Strict):
    label: str | None = None


class DsrE(_Method):
    """Subspace identification DSR_e; order chosen from the singular values if not given.

    ``variant`` "original" projects the future inputs out, as Di Ruscio does; "eolo" takes the oblique projection as the
    EOLO paper writes it, which band-limited inputs break.
    """

    method: Literal["dsr_e"]
    order: Count | None = None
    past_horizon: Count
    future_horizon: Horizon
    direct_feedthrough: bool = False
    variant: Literal["original", "eolo"] = "original"
    offset: Literal["none", "offset", "trend"] = "none"
    decimate: Count | Literal["auto"] = 1
    stable: bool = False
    closed_loop: bool = False


class Subspace(_Method):
    """Any other subspace method; horizons count samples of the rate that A is identified at."""

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


class TransferFunctions(_Method):
    """One least-squares transfer function per output; the number of zeros is chosen on the validation part."""

    method: Literal["transfer_function"]
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


class Srivc(_Method):
    """Continuous-time transfer functions by refined instrumental variables; orders and delay chosen on held-out data.

    ``hold`` says how inputs run between samples; if not given, commands are held and deflections run linearly.
    """

    method: Literal["srivc"]
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


class Equivalent(_Method):
    """A low-order equivalent model with delay, fitted to the frequency response from windows of these lengths.

    ``hold`` says how inputs run between samples; if not given, commands are held and deflections run linearly.
    """

    method: Literal["equivalent"]
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


class PredictionError(_Method):
    """A discrete state-space model by prediction errors, started from a subspace estimate."""

    method: Literal["prediction_error"]
    start: Literal["dsr_e", "moesp", "n4sid", "cva", "dsr", "ssarx", "pbsid_opt"] = "cva"
    order: Count
    past_horizon: Count
    future_horizon: Horizon
    disturbances: bool = True
    direct_feedthrough: bool = False
    offsets: bool = False
    max_iterations: Count = 20


class EquationError(_Method, Structured):
    """Least squares on the state equations of a structure; all its states measured."""

    method: Literal["equation_error"]
    cutoff_hz: Positive | None = None


class _Simulated(_Method, Structured):
    """What methods share that compare simulated with measured outputs.

    They start from equation error where all states are measured, but for the parameters that ``start`` names.
    """

    initial_states: Literal["free", "record", "zero"] = "free"
    output_biases: Names = ()
    output_trends: Names = ()
    input_biases: Names = ()
    max_iterations: Count = 50


class OutputError(_Simulated):
    """Maximum likelihood for measurement noise only."""

    method: Literal["output_error"]
    noise: Literal["diagonal", "full"] = "diagonal"
    starts: Count = 1
    seed: Annotated[int, Field(ge=0)] = 0


class FilterError(_Simulated):
    """Maximum likelihood for process noise (turbulence) and measurement noise.

    ``process_noise`` names the states whose process noise is estimated; all if not given.
    """

    method: Literal["filter_error"]
    process_noise: Names | None = None
    fixed_process_noise: dict[str, NonNegative] = {}


class KalmanFilter(_Method, Structured):
    """Parameters as states of an extended or unscented Kalman filter; noise in SI units."""

    method: Literal["ekf", "ukf"]
    measurement_noise: dict[str, Positive] = {}
    process_noise: dict[str, NonNegative] = {}
    parameter_drift: dict[str, NonNegative] = {}
    initial_std: dict[str, Positive] = {}


Estimator = Annotated[
    DsrE
    | Subspace
    | TransferFunctions
    | Srivc
    | Equivalent
    | PredictionError
    | EquationError
    | OutputError
    | FilterError
    | KalmanFilter,
    Field(discriminator="method"),
]


def estimator_name(spec: Any) -> str:
    """Return the label of an estimator in tables, or its method if it has none."""
    return str(spec.label or spec.method)


class Identification(Strict):
    """Which measured channels are inputs and outputs, and which estimators run on them.

    ``outputs`` left empty means every channel of the suite that is not a control.
    """

    inputs: Annotated[tuple[str, ...], Field(min_length=1, strict=False)]
    outputs: Annotated[tuple[str, ...], Field(strict=False)] = ()
    estimators: Annotated[tuple[Estimator, ...], Field(min_length=1, strict=False)]
