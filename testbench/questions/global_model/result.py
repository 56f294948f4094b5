"""What a global model is: functions, the domain that they hold in, and how flights that were held out follow them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from testbench.aircraft import Aircraft
from testbench.estimators.regression.global_model import GlobalModel
from testbench.page.shown import Shown
from testbench.questions.global_model.coefficients import FeltFlight


@dataclass(frozen=True)
class HeldOut:
    """How one coefficient of the flights that were held out follows its function."""

    coefficient: str  #: which
    span: float  #: its range in the flights of the fit, between the quantiles 0.01 and 0.99
    fitted: float  #: root mean square of felt less function in the flights of the fit
    missed: float  #: the same in those held out
    believed: float  #: felt less the believed model in those held out
    r2: float  #: share of the energy of the coefficient about its mean that the function explains there
    inside: float  #: share of their samples in the flown domain of the fit


@dataclass(frozen=True, eq=False)
class GlobalFound(Shown, page="testbench.questions.global_model.page:global_page"):
    """A global model and what it was made from.

    Attributes:
        aircraft: the believed model.
        model: the functions and their domain.
        flights: coefficients felt along every flight.
        held: a row per coefficient.
        V_ref_m_s: airspeed that V_rel = V / V_ref - 1 refers to.
        cutoff_hz: of the filter that all channels went through.
        instrument_std: errors of instruments that are counted, CHANNEL_KIND -> standard deviation.
        notes: sentences.
        new: the aircraft that has the functions, and its folder; None if none was asked for.
    """

    aircraft: Aircraft
    model: GlobalModel
    flights: tuple[FeltFlight, ...]
    held: tuple[HeldOut, ...]
    V_ref_m_s: float
    cutoff_hz: float
    instrument_std: dict[str, float]
    notes: tuple[str, ...] = ()
    new: tuple[Aircraft, Path] | None = None

    def of_use(self, use: str) -> list[FeltFlight]:
        """Return the flights of "identification" or "validation"."""
        return [f for f in self.flights if f.use == use]
