"""Data compatibility of recorded flights: which instrument to look at first, and what all of them may err by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from testbench.core.constants import G0_M_S2
from testbench.core.record import FlightRecord
from testbench.inference.instruments import Agreement, EveryError, agreement, every_error, without_errors


@dataclass(frozen=True, eq=False)
class Compared:
    """What kinematics say of the instruments of records."""

    agreed: Agreement  #: whether they agree, and which single error would explain that they do not
    every: EveryError | None  #: all errors estimated together; None where no channel is foretold by others
    corrected: tuple[FlightRecord, ...]  #: the records without the errors that were found
    gravity_m_s2: float  #: that was assumed


def compatibility(records: Sequence[FlightRecord], gravity_m_s2: float = G0_M_S2) -> Compared:
    """Compare the instruments of measured records with one another by rigid-body kinematics, without aerodynamics.

    Args:
        records: of one flight or of several by the same instruments, not as deviations from trim.
        gravity_m_s2: at the place of the flight; an error of it shows as a bias of the accelerometers.

    Raises:
        EstimationError: gravity is not a number above 0.
        RecordError: a record is not sampled uniformly.
    """
    every = every_error(records, gravity_m_s2)
    agreed = agreement(records, gravity_m_s2=gravity_m_s2)
    found = {} if every is None else every.sizes
    return Compared(agreed, every, tuple(without_errors(r, found) for r in records), gravity_m_s2)
