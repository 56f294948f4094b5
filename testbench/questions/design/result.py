"""What a design found: the designs as flown, ranked, and what stands in the way of more accuracy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.record import FloatArray
from testbench.core.scenario.air import AirSpec
from testbench.design.amplitude import Ensemble, Flown
from testbench.design.ensemble import Draws, Member
from testbench.design.limits import Envelope
from testbench.design.problem import Design, ModeBands, Obstacles, Problem, SpectralEnergy, total_errors
from testbench.design.realise import Elsewhere
from testbench.flight.batch.jobs import Tally
from testbench.inputs.signal import energy_spectrum
from testbench.page.shown import Shown
from testbench.questions.design.known import Known
from testbench.questions.design.scenario import DesignScenario


@dataclass(frozen=True, eq=False)
class DesignResult(Shown, page="testbench.questions.design.page:design_page"):
    """Everything a design found.

    Attributes:
        scenario: what was asked.
        believed: the believed aircraft, and what was optimised.
        ensemble: what amplitudes were chosen for: draws, air, sensors and estimator.
        screened: how many candidates, and how long that took in s.
        families: family -> (candidates, lowest cost, best signal-to-noise ratio of the worst mode, dB).
        ranking: designs flown and admissible, best first.
        rejected: designs that kept breaking a limit.
        shortest: the shortest input that reaches the wanted accuracy, as flown, or None.
        others: further suite -> standard errors that it would give the best design.
        obstacles: what prevents more accuracy.
        elsewhere: the best design where the aircraft is another than believed.
        nominal: of a robust design, the index in the ranking of the one that the believed aircraft alone would get.
        known: what earlier flights gave; None without them.
    """

    scenario: DesignScenario
    believed: Member
    ensemble: Ensemble
    screened: tuple[int, float]
    families: Mapping[str, tuple[int, float, float]]
    ranking: tuple[Flown, ...]
    rejected: tuple[Flown, ...]
    shortest: Flown | None
    others: Mapping[str, FloatArray]
    obstacles: Obstacles
    elsewhere: tuple[Elsewhere, ...] = ()
    nominal: int | None = None
    known: Known | None = None

    @property
    def name(self) -> str:
        """Names the results folder."""
        return self.scenario.name

    @property
    def aircraft(self) -> Aircraft:
        """What is believed to fly."""
        return self.believed.aircraft

    @property
    def problem(self) -> Problem:
        """What was optimised."""
        return self.believed.problem

    @property
    def modes(self) -> Mapping[str, complex]:
        """Name -> pole of all modes of the plane."""
        return self.believed.modes

    @property
    def envelope(self) -> Envelope:
        """The limits."""
        return self.problem.envelope

    @property
    def draws(self) -> Draws | None:
        """The aircraft drawn by the stated uncertainty; None if none are asked for."""
        return self.ensemble.draws

    @property
    def air(self) -> AirSpec | None:
        """In which designs were realised; None if they were not."""
        return self.ensemble.range_.air if self.scenario.realise else None

    @property
    def tally(self) -> Tally:
        """By what all flights were flown."""
        return self.ensemble.range_.flier.tally

    @property
    def best(self) -> Flown:
        """The best design."""
        return self.ranking[0]

    @cached_property
    def _bands(self) -> ModeBands:
        assert self.problem.bands is not None
        return replace(self.problem.bands, modes=dict(self.modes))  # of all modes, targets or not

    def energy(self, design: Design) -> SpectralEnergy:
        """Return what a design does to all modes of the plane."""
        return self._bands.analyse(design.u)

    def total(self, entry: Flown) -> FloatArray:
        """Return the errors (t,) to plan with after a flight of a design, what was known before included."""
        return total_errors(self.problem, entry.design, entry.errors)

    def spectrum(self, design: Design, omega: FloatArray) -> FloatArray:
        """Return the energy spectral density of a design's commands, all controls together; (k,)."""
        return np.asarray(energy_spectrum(design.u, 1.0 / self.problem.rate_hz, omega).sum(axis=1))
