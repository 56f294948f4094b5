"""What a design found: the designs as flown, ranked, and what stands in the way of more accuracy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.record import FloatArray
from testbench.core.scenario.air import AirSpec
from testbench.evaluation.envelope import Onset
from testbench.flight import LinearModel, TrimmedFlight
from testbench.flight.batch.jobs import Tally
from testbench.inputs.signal import energy_spectrum
from testbench.page.shown import Shown
from testbench.questions.design.draws import Draws, OverDraws
from testbench.questions.design.elsewhere import Elsewhere
from testbench.questions.design.flown import Envelope, Flown
from testbench.questions.design.identified import Identified
from testbench.questions.design.known import Known, total_errors
from testbench.questions.design.limits import Limits
from testbench.questions.design.obstacles import Obstacles
from testbench.questions.design.problem import Design, Problem
from testbench.questions.design.realise import Realised
from testbench.questions.design.scenario import DesignScenario
from testbench.questions.design.spectral_energy import SpectralEnergy
from testbench.sensors import SensorSuite


@dataclass(frozen=True, eq=False)
class Ranked:
    """One design as it was flown, what it does to the modes, over the drawn aircraft if there are any, and realised."""

    flown: Flown
    energy: SpectralEnergy
    over: OverDraws | None = None
    realised: Realised | None = None

    @property
    def design(self) -> Design:
        """The design at its flown amplitude."""
        return self.flown.design

    @property
    def errors(self) -> FloatArray:
        """(t,) the errors to plan with: realised where they contradict the promised ones."""
        return self.design.errors if self.realised is None else self.realised.headline


@dataclass(frozen=True, eq=False)
class DesignResult(Shown, page="testbench.questions.design.page:design_page"):
    """Everything a design found.

    Attributes:
        scenario: what was asked.
        aircraft, trimmed, linear: what is flown.
        problem: what was optimised.
        modes: name -> pole of all modes of the plane.
        screened: how many candidates, and how long that took in s.
        families: family -> (candidates, lowest cost, best signal-to-noise ratio of the worst mode, dB).
        ranking: designs flown and admissible, best first.
        rejected: designs that kept breaking a limit.
        shortest: the shortest input that reaches the wanted accuracy, as flown, or None.
        others: further suite -> standard errors that it would give the best design.
        obstacles: what prevents more accuracy.
        onsets: elastic modes that become unstable at some speed.
        draws: the aircraft drawn by the stated uncertainty; None if none are asked for.
        tally: by what all flights were flown.
        identified: the estimator of the scenarios that it writes.
        air: in which designs were realised; None if they were not.
        elsewhere: the best design where the aircraft is another than believed.
        nominal: of a robust design, the index in the ranking of the one that the believed aircraft alone would get.
        known: what earlier flights gave; None without them.
    """

    scenario: DesignScenario
    aircraft: Aircraft
    trimmed: TrimmedFlight
    linear: LinearModel
    suite: SensorSuite
    problem: Problem
    modes: Mapping[str, complex]
    limits: Limits
    envelope: Envelope
    screened: tuple[int, float]
    families: Mapping[str, tuple[int, float, float]]
    ranking: tuple[Ranked, ...]
    rejected: tuple[Flown, ...]
    shortest: Ranked | None
    others: Mapping[str, FloatArray]
    obstacles: Obstacles
    onsets: tuple[Onset, ...]
    draws: Draws | None = None
    tally: Tally | None = None
    identified: Identified | None = None
    air: AirSpec | None = None
    elsewhere: tuple[Elsewhere, ...] = ()
    nominal: int | None = None
    known: Known | None = None

    @property
    def name(self) -> str:
        """Names the results folder."""
        return self.scenario.name

    @property
    def best(self) -> Ranked:
        """The best design."""
        return self.ranking[0]

    def total(self, entry: Ranked) -> FloatArray:
        """Return the errors (t,) to plan with after a flight of a design, what was known before included."""
        return total_errors(self.problem, entry.design, entry.errors)

    def spectrum(self, design: Design, omega: FloatArray) -> FloatArray:
        """Return the energy spectral density of a design's commands, all controls together; (k,)."""
        return np.asarray(energy_spectrum(design.u, 1.0 / self.problem.rate_hz, omega).sum(axis=1))
