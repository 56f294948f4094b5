"""The estimators of a scenario: one class per method."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from testbench.schema import Strict


class DsrE(Strict):
    """Subspace identification DSR_e of the EOLO paper; order chosen from the singular values if not given."""

    method: Literal["dsr_e"]
    label: str | None = None
    order: Annotated[int, Field(ge=1)] | None = None
    past_horizon: Annotated[int, Field(ge=1)]
    future_horizon: Annotated[int, Field(ge=2)]
    direct_feedthrough: bool = False


class TransferFunctions(Strict):
    """One least-squares transfer function per output; the number of zeros is chosen on the validation part."""

    method: Literal["transfer_function"]
    label: str | None = None
    poles: Annotated[int, Field(ge=1)]
    zeros: Annotated[tuple[int, ...], Field(min_length=1, strict=False)]

    @model_validator(mode="after")
    def _proper(self) -> TransferFunctions:
        if not all(0 <= z < self.poles for z in self.zeros):
            raise ValueError(
                f"0 <= zeros < poles = {self.poles} must hold for every entry of zeros, got {list(self.zeros)}"
            )
        return self


def estimator_name(spec: DsrE | TransferFunctions) -> str:
    """Return the label of an estimator in tables, or its method if it has none."""
    return spec.label or spec.method


Estimator = Annotated[DsrE | TransferFunctions, Field(discriminator="method")]
