"""Whether each control of some records turns the aircraft the way in which the believed one turns.

A log that counts a control the other way, or a model that does, is no effect that is to be named: every hypothesis
would be fitted about the wrong model. The moment that a control makes about its own axis is told by the errors of
forces and moments at every sample (:mod:`.felt`), regressed on what the coefficients of that moment contribute.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.core.errors import RecordError, Refusal
from testbench.core.record import FlightRecord
from testbench.effects.servo import WORDS
from testbench.logs.plausible import questions_of, refusal
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.evidence.felt import Felt, felt
from testbench.questions.gap.evidence.motion import smooth

_TOGETHER_S = 0.5
OWN_MOMENTS = {"de": "Cm_de", "da": "Cl_da", "dr": "Cn_dr"}


@dataclass(frozen=True)
class Turned:
    """What records say of a control: the moment about its own axis, as a multiple of the believed one.

    Attributes:
        control: de, da or dr.
        factor: 1 as believed, about -1 where the signs differ.
        error: its standard error.
    """

    control: str
    factor: float
    error: float

    @property
    def reversed(self) -> bool:
        """True if records and belief count the control in opposite ways."""
        return self.factor < min(CRITERIA.reversed, -CRITERIA.sure * self.error)


def check_signs(believed: Believed, records: Mapping[str, FlightRecord]) -> None:
    """Check that every control that moves turns the aircraft as it turns the believed one.

    Args:
        believed: model and sensors.
        records: by name; those that do not begin with quiet flight say so.

    Raises:
        RecordError: one turns it the other way, or values that are hardly meant say so.
    """
    try:
        found = turned(felt(believed, records, copies=0))
    except Refusal:  # without forces and moments nothing is known of signs
        return
    asked = questions_of(records.items()) if any(t.reversed for t in found) else ()
    if asked:  # values in another unit are the cause
        raise RecordError(refusal("the records", asked))
    for one in (t for t in found if t.reversed):
        word = WORDS[one.control]
        raise RecordError(
            f"the {word} of the records must turn the aircraft the way in which the believed one turns, got a moment "
            f"by {one.control} of {one.factor:.2f} times the believed {OWN_MOMENTS[one.control]}: one of them counts "
            f"the {word} the other way. In a log, turn its sign where it is described (testbench import LOG "
            f"--describe; scale = -1) and import it again; in the model, turn {OWN_MOMENTS[one.control]}"
        )


def turned(flights: Sequence[Felt]) -> list[Turned]:
    """Return what records say of each control whose own moment they hold."""
    return [t for c, own in OWN_MOMENTS.items() if (t := _turned(flights, c, own)) is not None]


def _turned(flights: Sequence[Felt], control: str, own: str) -> Turned | None:
    """Regress the error of a moment on what its coefficients contribute, each record about its own mean.

    Errors of neighbouring samples are alike: the covariance is that of sums over half a second (K.-Y. Liang and S. L.
    Zeger, Biometrika 73, 1986).
    """
    coefficient = own.split("_")[0]
    about = [f for f in flights if coefficient in f.coefficients and own in f.tuned]
    names = [n for n in about[0].tuned if n.split("_")[0] == coefficient] if about else []
    at = names.index(own) if names else 0
    rows, errors, ends = [], [], [0]
    for f in about:
        k = f.coefficients.index(coefficient)
        dt_s = f.motion.record.dt_s  # the motion is smoothed, so that all that it is compared with has to be
        x, y = np.column_stack([smooth(f.tuned[n][:, k], dt_s) for n in names]), smooth(f.errors[0][:, k], dt_s)
        rows.append(x - x.mean(axis=0))
        errors.append(y - y.mean())
        together = max(1, round(_TOGETHER_S / dt_s))
        ends += [*range(ends[-1] + together, ends[-1] + y.size - together + 1, together), ends[-1] + y.size]
    if not rows or not np.any(np.concatenate(rows)[:, at]):
        return None
    X, y = np.concatenate(rows), np.concatenate(errors)
    size = np.maximum(np.linalg.norm(X, axis=0), np.finfo(float).tiny)
    inverse = np.linalg.pinv(X / size)
    changes = inverse @ y
    scores = np.add.reduceat(inverse * (y - (X / size) @ changes), ends[:-1], axis=1)
    return Turned(control, 1.0 + float(changes[at] / size[at]), float(np.linalg.norm(scores[at]) / size[at]))
