"""Gap scenarios: what is believed, and the measured records, real or made from a hidden truth."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from testbench.core.scenario.base import FlownAt, Manoeuvre, SuiteName
from testbench.core.schema import Strict
from testbench.questions.gap.hidden.kinds import Hidden


class MeasuredFile(Strict):
    """A measured record on disk (NetCDF, as written by the testbench), relative to the scenario file."""

    name: str
    file: str
    use: Literal["naming", "held_out"]


class GapScenario(FlownAt):
    """A gap case. Either ``measured`` lists records, or ``manoeuvre`` and ``hidden`` make them.

    Of the manoeuvres, those for "identification" are used to name the effect, those for "validation" are held out.
    """

    unnamed: ClassVar[str] = "gap"

    suite: SuiteName
    manoeuvre: Annotated[tuple[Manoeuvre, ...], Field(strict=False)] = ()
    hidden: Hidden | None = None
    measured: Annotated[tuple[MeasuredFile, ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _one_source_with_both_uses(self) -> GapScenario:
        made = bool(self.manoeuvre), self.hidden is not None
        if any(made) if self.measured else not all(made):
            raise ValueError(
                "either 'measured' must list records, or 'manoeuvre' and 'hidden' must say how to make them; got "
                + (", ".join(n for n in ("measured", "manoeuvre", "hidden") if getattr(self, n)) or "none of them")
            )
        uses = {m.use for m in self.measured} | {m.use for m in self.manoeuvre}
        if not (uses & {"naming", "identification"} and uses & {"held_out", "validation"}) or "split" in uses:
            raise ValueError("records must serve both naming (identification) and judging (validation, held out)")
        return self
