"""What a search for modes found, and what is known of the aircraft beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from testbench.core.record import FlightRecord
from testbench.estimators.operational import Onset, OperationalModes
from testbench.estimators.operational.onset import RISK
from testbench.evaluation.operational import ModeMatch, TrueMode
from testbench.page.shown import Shown


@dataclass(frozen=True, eq=False)
class ModesResult(Shown, page="testbench.questions.modes.page:modes_page"):
    """The modes that were found, and what is known of the aircraft.

    Attributes:
        name, title, question: for the report.
        found: modes with errors; of the fastest speed where the records have several.
        records: name -> record that they come from.
        source: text of the scenario or description, empty for bare records.
        true: the linear model's oscillatory modes; empty for recorded flights.
        matches: found and true modes that stand for each other; empty for recorded flights.
        corners_hz: frequencies V / (2 pi L) at which the spectra of the turbulence u, v, w bend; empty if not known.
        stations_m: place of each channel along the wing, None where it has none.
        at: speed -> modes found there, None where none were; empty where all records have one speed.
        onset: of flutter, as flights at several speeds tell it; None with one speed, or where too little was found.
        risk: at which the next speed is cleared.
    """

    name: str
    title: str
    question: str
    found: OperationalModes
    records: Mapping[str, FlightRecord]
    source: str = ""
    true: tuple[TrueMode, ...] = ()
    matches: tuple[ModeMatch, ...] = ()
    corners_hz: tuple[float, ...] = ()
    stations_m: tuple[float | None, ...] = ()
    at: Mapping[float, OperationalModes | None] = field(default_factory=dict)
    onset: Onset | None = None
    risk: float = RISK

    @property
    def cleared_m_s(self) -> float:
        """The speed that may be flown next, at most; the fastest one flown where nothing beyond is cleared."""
        return max(self.at) if self.onset is None else self.onset.cleared(self.risk)
