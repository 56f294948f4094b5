"""The model structure that an estimator of a scenario fits, and what is free, fixed or believed of its parameters."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, ValidationInfo, model_validator

from testbench.core.bring import is_brought
from testbench.core.errors import nearest
from testbench.core.schema import Names, NonNegative, Pair, Positive, Strict
from testbench.estimators import brought
from testbench.estimators.equations import Equations


class AirframeConstants(Strict):
    """Known data of aircraft and air for a nonlinear aerodynamic structure."""

    mass_kg: Positive
    S_m2_per_kg: Positive
    S_cbar_over_Iyy_1_per_kg_m: Positive
    cbar_m: Positive
    V0_m_s: Positive
    rho_kg_m3: Positive
    thrust_angle_rad: float = 0.0
    thrust_moment_rad_s2_per_N: float = 0.0


STRUCTURE_NAMES = (
    "short_period",
    "longitudinal",
    "flexible",
    "lateral_directional",
    "lateral_per_speed",
    "roll_yaw_rates",
    "aerodynamic_longitudinal",
)
"""Packaged structures; any other is in ``identification.structures``, or brought: ``FILE.toml``, ``FILE.py:NAME``."""


_PER_SPEED = {"short_period": "Z", "lateral_per_speed": "Y"}


def per_speed(structure: str, axis: str) -> bool:
    """Return whether the derivatives of a force or moment (X, Y, Z, L, M, N) are per airspeed in a structure."""
    return _PER_SPEED.get(structure) == axis


def _known_structure(name: str, info: ValidationInfo) -> str:
    if is_brought(name):
        return brought.structure(name, info)
    if brought.is_text(name):
        return brought.written(name, info)
    if info.data.get("equations") is None and name not in STRUCTURE_NAMES:
        known = (*STRUCTURE_NAMES, *(info.context or {}).get("structures", ()))
        raise ValueError(f"must be one of {', '.join(known)}, got '{name}'{nearest(name, known)}")
    return name


class Servo(Strict):
    """The servo between a command and its surface: first-order lag or second order, delay and rate limit.

    ``lag_s`` and ``delay_s`` may be "estimate": they are parameters of the structure then. ``ignore`` takes the command
    for the surface, knowingly.
    """

    lag_s: Positive | Literal["estimate"] | None = None
    delay_s: NonNegative | Literal["estimate"] = 0.0
    rate_limit_deg_s: Positive | None = None
    wn_rad_s: Positive | None = None
    zeta: Positive | None = None
    ignore: bool = False

    @model_validator(mode="after")
    def _one_kind(self) -> Servo:
        if (self.wn_rad_s is None) != (self.zeta is None):
            raise ValueError("wn_rad_s and zeta of a servo go together, got one of them")
        if self.wn_rad_s is not None and self.lag_s is not None:
            raise ValueError("a servo has either lag_s or wn_rad_s and zeta, got both")
        if self.rate_limit_deg_s is not None and self.lag_s is None:
            raise ValueError('rate_limit_deg_s of a servo goes with lag_s, got none; give its lag, or "estimate"')
        told = self.lag_s is not None or self.wn_rad_s is not None or self.delay_s != 0.0
        if told == self.ignore:
            raise ValueError("a servo needs lag_s, wn_rad_s with zeta, or delay_s; or ignore = true and none of them")
        return self


class Fitted(Strict):
    """What every method takes that fits a structure: known delays of the inputs, s, and which inputs are held.

    If ``held`` is not given, commands are held between samples, and other inputs that the records show to be; the rest
    run along straight lines.
    """

    delays_s: dict[str, NonNegative] = {}
    held: Names | None = None


class Structured(Fitted):
    """A structure by name, its settings and its parameters.

    ``structure`` is packaged, or the user's own: a name in ``identification.structures``, whose table is then
    ``equations`` here, "my_structure.toml" or "my_structure.py:make".

    ``outputs`` are those of the scenario that the structure has, unless they are named here. Trim values (``V_m_s``,
    ``alpha_deg``, ``theta_deg``) are those that were removed from the records as trim, unless they are given. ``free``
    names the only parameters that are estimated; ``fixed`` holds some of them. ``inputs`` are those of the scenario
    that drive the structure, all unless they are named here. ``servo`` lies between inputs that are commands and their
    surfaces. With ``choose`` the records choose, by evidence, which of the free parameters are estimated; the others
    are held at their ``start``, or at zero where none is given.
    """

    equations: Equations | None = None
    structure: Annotated[str, AfterValidator(_known_structure)]
    inputs: Names = ()
    outputs: Names = ()
    start: dict[str, float] = {}
    fixed: Names = ()
    free: Annotated[tuple[str, ...], Field(min_length=1, strict=False)] | None = None
    bounds: dict[str, Pair] = {}
    prior_std: dict[str, Positive] = {}
    V_m_s: Positive | None = None
    alpha_deg: float | None = None
    theta_deg: float | None = None
    short: bool = False
    accelerometer_m: Pair = (0.0, 0.0)
    modes_hz: Annotated[tuple[Positive, ...], Field(strict=False)] = ()
    airframe: AirframeConstants | None = None
    servo: dict[str, Servo] = {}
    choose: bool = False

    @model_validator(mode="after")
    def _settings_of_the_structure(self) -> Structured:
        if (self.structure == "flexible") != bool(self.modes_hz):
            raise ValueError(
                "structure 'flexible' and modes_hz (start values of the modes' frequencies) go together, got "
                f"structure '{self.structure}' and modes_hz {list(self.modes_hz)}"
            )
        if (self.structure == "aerodynamic_longitudinal") != (self.airframe is not None):
            raise ValueError(
                "structure 'aerodynamic_longitudinal' and the table airframe go together, got structure "
                f"'{self.structure}' {'with' if self.airframe else 'without'} it"
            )
        if self.short and self.structure not in ("longitudinal", "flexible"):
            raise ValueError(f"short (alpha and q alone) belongs to longitudinal and flexible, got '{self.structure}'")
        return self
