"""Descriptions of recorded flights: TOML files read as frozen RecordDescription objects, all faults reported at once.

A description says where the files lie, which column is which channel in which unit, what each record is used for and
what is identified from it. It holds no code; a scenario's ``preparation`` and ``identification`` mean the same here.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field

from testbench.core.errors import ScenarioError
from testbench.core.paths import find_scenario
from testbench.core.scenario.base import AircraftName, Preparation
from testbench.core.schema import Positive, Strict
from testbench.estimators.identification import Identification
from testbench.estimators.structured import Servo, Structured
from testbench.logs.layout import Recorded, Text
from testbench.pooling import TrendVariable


class Reference(Strict):
    """Printed results that a report compares with its own, and their source.

    ``values`` are in SI units and radians; "wn_rad_s" and "zeta" are a mode's natural frequency and damping ratio.
    """

    source: Text
    values: Annotated[dict[str, float], Field(min_length=1)]


class ReferenceLengths(Strict):
    """Area, span and chord that coefficients refer to, of an aircraft without a model."""

    S_m2: Positive
    b_m: Positive
    cbar_m: Positive


class SimulatedErrors(Strict):
    """Standard errors of simulated flights like the recorded ones, biases included.

    ``errors`` are those of all records together, by derivative, in SI units. ``source`` says which flights they are.
    `testbench plan close` writes them. They take the place of those that an estimator states where they are larger.
    ``flights`` is how many flights of the nonlinear aircraft, in its air and through its sensors, they are of: what the
    form of a linear model hides and what colours its residuals is in them. 0: in none.
    """

    source: Text
    flights: Annotated[int, Field(ge=0)] = 0
    errors: Annotated[dict[str, Positive], Field(min_length=1)]


class Pooling(Strict):
    """How several records, or several descriptions, are pooled to one set of coefficients.

    ``each`` identifies every record (with use "identification" or "split") by itself and pools them. ``prior`` is
    "aircraft", "handbook" or a file. ``trend`` is the variable that coefficients may be linear in. ``method`` is the
    estimator whose derivatives are pooled; else those of the first in the list that are not to be rejected.
    """

    each: bool = False
    prior: Text | None = None
    trend: TrendVariable = "auto"
    method: Text | None = None


STATED_STD = 0.2
"""Share of its value by which the lag that an aircraft states may be off: load and voltage; judged."""


def believed(estimator: Structured, servos: Mapping[str, Servo]) -> Structured:
    """Return the estimator with the stated lags as start of those that it estimates, and in place of its priors.

    Import writes a prior without knowing the aircraft; what the aircraft states counts more. Where no prior was asked
    for, none is taken: the servo that flew may be another.
    """
    start, spread = dict(estimator.start), dict(estimator.prior_std)
    for name, servo in servos.items():
        if name in estimator.servo and estimator.servo[name].lag_s == "estimate" and isinstance(servo.lag_s, float):
            tau = f"tau_{name.removesuffix('_cmd')}"
            start[tau] = servo.lag_s
            if tau in spread:
                spread[tau] = STATED_STD * servo.lag_s
    return estimator.model_copy(update={"start": start, "prior_std": spread})


class RecordDescription(Recorded):
    """Recorded flights, and what to identify from them.

    Every record, and every segment of one, begins with ``trim_s`` of undisturbed flight, over which the bias "trim" of
    the preparation is taken. ``aircraft`` is a model of what flew: it gives the derivatives that were believed before,
    mass and geometry for coefficients, and servos. Where there is none, ``geometry`` and ``condition`` give those for
    coefficients. ``correct`` are errors of instruments that are taken out of the records before all else: q_scale =
    -0.15, az_place = 0.25 (m ahead), alpha_lag and q_late (s). ``instrument_std`` are standard deviations of these if
    the instruments are sound, alpha_scale = 0.03: what they do to the derivatives is in their errors then. ``form_std``
    says how far derivatives vary over what was flown, which is estimated beside those at trim: by which share over 0.1
    rad of ``alpha``, and over the share of dynamic pressure (``qbar``).

    ``servo`` says what lies between a command and its surface, for
    every estimator of a structure that does not say so itself. ``simulated_errors`` are what simulated flights say of
    the errors.
    """

    checked_by: ClassVar[str] = "testbench.questions.identify.check:check"

    preparation: Preparation = Preparation(bias="mean")
    identification: Identification
    aircraft: AircraftName | None = None
    servo: dict[str, Servo] = {}
    geometry: ReferenceLengths | None = None
    pool: Pooling = Pooling()
    reference: Reference | None = None
    simulated_errors: SimulatedErrors | None = None
    correct: dict[str, float] = {}
    instrument_std: dict[str, Positive] = {}
    form_std: dict[Literal["alpha", "qbar"], Positive] = {}

    @property
    def outputs(self) -> tuple[str, ...]:
        """The outputs to identify: those listed, else every channel that is not an input."""
        given = self.identification.outputs
        return given or tuple(name for name in self.channels if name not in self.identification.inputs)

    def asked_of(self, servos: Mapping[str, Servo]) -> Identification:
        """Return the identification with ``servos`` at every estimator of a structure that says nothing of its own.

        Where a lag is to be estimated, that of ``servos`` is its start, and its prior if it has one (:func:`believed`).
        """
        given = {**servos, **self.servo}
        estimators = tuple(
            believed(
                e.model_copy(update={"servo": {**{n: s for n, s in given.items() if n not in e.delays_s}, **e.servo}}),
                servos,
            )
            if isinstance(e, Structured)
            else e
            for e in self.identification.estimators
        )
        return self.identification.model_copy(update={"estimators": estimators})

    def choosing(self) -> Self:
        """Return the same description, in which the records choose what is estimated of every structure.

        Raises:
            ScenarioError: no estimator fits a structure.
        """
        entries = self.identification.estimators
        if not any(isinstance(e, Structured) for e in entries):
            fitted = "an estimator that fits a structure must be among identification.estimators, for its parameters "
            methods = ", ".join(e.method for e in entries)
            raise ScenarioError([f"{self.file}: {fitted}to be chosen among, got {methods}"])
        some = tuple(e.model_copy(update={"choose": True}) if isinstance(e, Structured) else e for e in entries)
        return self.changed(identification=self.identification.model_copy(update={"estimators": some}))

    def believes(self, servos: Mapping[str, Servo]) -> tuple[str, ...]:
        """Return the commands whose lag is to be estimated though ``servos`` state it."""
        asked = [*(e.servo for e in self.identification.estimators if isinstance(e, Structured)), self.servo]
        return tuple(n for n in servos if any(n in own and own[n].lag_s == "estimate" for own in asked))

    @property
    def reference_values(self) -> dict[str, float | str]:
        """The printed results by name, and under "source" where they are printed; empty if there are none."""
        return {} if self.reference is None else {"source": self.reference.source, **self.reference.values}

    @property
    def known_errors(self) -> Mapping[str, float]:
        """The errors that simulated flights show, by derivative; empty if nobody said."""
        return {} if self.simulated_errors is None else self.simulated_errors.errors

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """Read a description; ``path`` is a file, or a packaged one such as ``attas_short_period``.

        Raises:
            ScenarioError: the file breaks a law; the message lists every fault with file and key.
            RecordError: the file does not exist or cannot be read.
        """
        file = find_scenario(path)
        if not file.exists():
            packaged = find_scenario(Path("scenarios", "records", Path(path).name))
            file = packaged if packaged.exists() else file
        return super().load(file)
