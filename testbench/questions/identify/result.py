"""What is found in recorded flights: models as of a run, and the derivatives with what was believed before."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from testbench.core.advice import Advice
from testbench.inference.instruments import Agreement
from testbench.inference.reflown import Reflown
from testbench.questions.identify.derivatives import Before, FoundDerivative
from testbench.questions.identify.flown import FlownCondition
from testbench.questions.identify.instruments import contradiction
from testbench.questions.identify.unpredicted import Missed
from testbench.questions.run.result import RunResult


@dataclass(frozen=True, eq=False)
class Identified(RunResult, page="testbench.questions.identify.page:identify_page"):
    """What identification from recorded flights found.

    Attributes:
        derivatives: of every model with a structure.
        before: the aircraft that the description names, at the condition of the records; None without one.
        flown: the condition of the records, and what coefficients refer to.
        notes: what was assumed, left out or recognised, in sentences.
        doubts: what may make the derivatives wrong, in sentences.
        instruments: what kinematics say of the records, before any aerodynamics.
        corrected: the same derivatives with the error of the instrument that is named taken out of the records; none if
            all agree or none is named.
        missed: models with derivatives that do not predict their validation records, and why.
        replaced: cases that were asked for and whose fit a cure mends, which the case before them holds.
        again: case -> what flights of its model are identified as; empty if none were asked for.
    """

    derivatives: tuple[FoundDerivative, ...] = ()
    before: Before | None = None
    flown: FlownCondition | None = None
    notes: tuple[str, ...] = ()
    doubts: tuple[Advice, ...] = ()
    missed: tuple[Missed, ...] = ()
    replaced: frozenset[int] = frozenset()
    again: Mapping[int, Reflown] = field(default_factory=dict)
    instruments: Agreement | None = None
    corrected: tuple[FoundDerivative, ...] = ()

    @property
    def contradicted(self) -> str:
        """Channel that the models use and that kinematics contradict; "" if there is none."""
        used = {n for case in self.cases for n in (*case.model.inputs, *case.model.outputs)}
        return "" if self.instruments is None else contradiction(self.instruments, sorted(used))
