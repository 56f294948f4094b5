"""What the gap workflow found: before and after on held-out manoeuvres, where the cause sits, the answer in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from testbench.core.constants import DEG_RAD, G0_M_S2, KT_M_S
from testbench.core.record import FlightRecord, FloatArray
from testbench.flight.batch.jobs import Tally
from testbench.inference.calibrate import Reliability
from testbench.inference.instruments import Agreement
from testbench.page.words import listed
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.criteria import CRITERIA
from testbench.questions.gap.drive import SurfacePath
from testbench.questions.gap.evidence.air import AirFound
from testbench.questions.gap.evidence.check import HeldOutFlight
from testbench.questions.gap.evidence.locate import Lacking, RegionMap, ResidualMap, Structure
from testbench.questions.gap.evidence.noise_found import NoiseFound
from testbench.questions.gap.explain import Naming, percent
from testbench.questions.gap.onset import Begun
from testbench.questions.gap.parts import Part, parts_of
from testbench.questions.identify.instruments import agreement_in_words

# By so much a simulator may err in the short period and after a power change, in roll and yaw response and in a steady
# sideslip, 14 CFR 60, appendix A, table A2A; the pitch angle's tolerance is taken for the angle of attack.
TOLERANCE = {
    "theta": 1.5 * DEG_RAD,
    "alpha": 1.5 * DEG_RAD,
    "q": 2.0 * DEG_RAD,
    "az": 0.10 * G0_M_S2,
    "V": 3.0 * KT_M_S,
    "beta": 1.0 * DEG_RAD,
    "phi": 2.0 * DEG_RAD,
    "p": 2.0 * DEG_RAD,
    "r": 2.0 * DEG_RAD,
}
_ALLOWED = (
    "than the tolerance of a flight simulator for training (1.5 deg, 2 deg/s, 0.10 g, 3 kt, 2 deg of bank, 1 deg of "
    "sideslip: 14 CFR 60, table A2A)"
)


@dataclass(frozen=True, eq=False)
class Shrink:
    """One held-out manoeuvre before and after the amendment; residuals in units of the noise."""

    manoeuvre: str  #: name
    record: FlightRecord  #: the measured record
    #: before, after: (n, p) predictions of the believed and of the amended model, offset to the record's mean
    before: FloatArray
    after: FloatArray
    #: energy_before, energy_after: (p,) mean squared residual per channel, 1 is the noise floor
    energy_before: FloatArray
    energy_after: FloatArray
    taken: FloatArray  #: (p,) number of samples that were taken

    @property
    def visible(self) -> bool:
        """True if the excess before stands four standard deviations above what noise alone scatters by."""
        scatter = np.sqrt(np.sum(2.0 / np.maximum(self.taken, 1.0)))
        return float(np.sum(self.energy_before - 1.0)) > CRITERIA.visible * scatter

    @property
    def removed(self) -> float:
        """Share of the excess energy over the noise floor that the amendment removed, all channels together."""
        excess = float(np.sum(self.energy_before - 1.0))
        return 1.0 - float(np.sum(self.energy_after - 1.0)) / excess if excess > 0.0 else 0.0


@dataclass(frozen=True)
class Verdict:
    """Where the cause sits; what it is stands in the naming."""

    parts: tuple[Part, ...]  #: where it may sit; none if nothing is called
    probability: float  #: that all that is missing acts there
    any: bool = False  #: True if it sits in one of the parts, and not in all of them
    nearest: str = ""  #: part of the nearest effect, in words, where nothing is called

    @property
    def sentences(self) -> tuple[str, ...]:
        """The verdict in words: where, how probable, and what to check on the ground."""
        sure = percent(self.probability)
        if not self.parts:
            near = f"the nearest effect acts in {self.nearest}, which is the right part with {sure}"
            return (f"its place is not known: {near}",)
        checks = tuple(f"check on the ground, {p.name}: {p.ground_check}" for p in self.parts)
        return (f"where to look: {self.where}; probability of that place: {sure}", *checks)

    @property
    def where(self) -> str:
        """The parts in words."""
        names = [p.name for p in self.parts]
        return " or ".join(names) if self.any else listed(names)


def verdict_of(naming: Naming) -> Verdict | None:
    """Return where the cause sits; None if there is no gap, no effect came near, or a term was named."""
    fits = {f.effect.name: f for f in naming.ranking}
    named = [fits[n].effect for n in naming.names]
    if naming.outcome in ("partial", "unexplained"):
        near = [f.effect for f in naming.ranking if f.effect.name not in naming.weighed.terms][:1]
        if not near:
            return None
        names = [p.name for p in parts_of(near)]
        return Verdict((), naming.weighed.part(names), nearest=listed(names))
    if not named or any(e.name in naming.weighed.terms for e in named):
        return None
    parts = parts_of(named)
    return Verdict(parts, naming.weighed.part([p.name for p in parts]), any=len(named) > 1 and len(parts) > 1)


@dataclass(frozen=True, eq=False)
class GapFinding:
    """What the gap workflow found, where the residual sits, and what the amendment does on held-out manoeuvres.

    Attributes:
        believed: what was believed, with the air that was found.
        amended: the same with what was named.
        maps: where the residual of the believed model sits, one per manoeuvre that was used to name.
        naming: the outcome.
        shrink: before and after, one per held-out manoeuvre.
        air: what the residuals say of the air.
        noise: how large the noise of the sensors is, where that was found; None where it is known.
        regions: where in the flight envelope the residual of the believed model sits.
        lacks: accelerations that the believed model lacks, of the manoeuvres with the largest residuals.
        next_flight: the manoeuvre that would tell the rest apart, in words; "" if nothing is left to tell apart.
        check: what the instruments say of each other, or None if that was not asked.
        errors: channel -> largest error of the believed model over all records, about its mean in each, SI.
        left: where the residuals of ``amended`` are not white, if an effect is named in still air; None if they may be
            noise.
        again: what stated probabilities are worth here, if the flights were flown again with drawn truths.
        windows: how records without quiet flight were cut, a sentence for each.
        begun: what begins or ends in flight, if anything seems to.
        tally: by what the believed and the amended model were flown through every record.
        paths: from commands to surfaces that are recorded: what is known of each.
        held_out: how different the flights held out are from those used.
    """

    believed: Believed
    amended: Believed
    maps: tuple[ResidualMap, ...]
    naming: Naming
    shrink: tuple[Shrink, ...]
    air: AirFound
    regions: tuple[RegionMap, ...] = ()
    lacks: tuple[Lacking, ...] = ()
    next_flight: str = ""
    check: Agreement | None = None
    errors: Mapping[str, float] = field(default_factory=dict)
    left: Structure | None = None
    again: Reliability | None = None
    tally: Tally | None = None
    windows: tuple[str, ...] = ()
    begun: Begun | None = None
    paths: tuple[SurfacePath, ...] = ()
    held_out: tuple[HeldOutFlight, ...] = ()
    noise: NoiseFound | None = None

    @property
    def changed(self) -> bool:
        """True if ``amended`` is another model than ``believed``: something comes near, or coefficients are off."""
        return self.amended is not self.believed

    @property
    def verdict(self) -> Verdict | None:
        """Where the cause sits, and how probable that is; None where there is no gap."""
        return verdict_of(self.naming)

    @property
    def sentences(self) -> tuple[str, ...]:
        """The answer in words."""
        out = [self.naming.sentence, *([self.begun.sentence] if self.begun is not None else [])]
        out += [p.sentence for p in self.paths]
        verdict = self.verdict
        out += [] if verdict is None else verdict.sentences
        out += [self.naming.probabilities, *self._evidence(), *([self.next_flight] if self.next_flight else [])]
        for s in self.shrink if self.changed else ():
            k = int(np.argmax(s.energy_before))
            gone = (
                f"{100 * s.removed:.1f} % of the excess is removed" if s.visible else "the excess is too small to judge"
            )
            out.append(
                f"held-out {s.manoeuvre}: the mean squared residual is {s.energy_before.mean():.3g} before and "
                f"{s.energy_after.mean():.3g} after, where the noise is 1 (largest in {self.believed.outputs[k]}: "
                f"{s.energy_before[k]:.3g} and {s.energy_after[k]:.3g}); {gone}"
            )
        out += [h.sentence for h in self.held_out] if self.changed else []
        if self.naming.outcome != "no gap":
            out += [m.sentence for m in self.maps]
            out += [max(self.regions, key=lambda r: r.contrast).sentence] if self.regions else []
        news = agreement_in_words(self.check) if self.check is not None and self.check.contradicted else ()
        again = () if self.again is None else (self.again.sentence(max(self.naming.weighed.stated.values())),)
        noise = (self.noise.sentence,) if self.noise is not None and self.noise.sentence else ()
        return (*out, *noise, *self.windows, *again, self.air.sentence, *news)

    @property
    def immaterial(self) -> bool:
        """True if what was named changes no channel of a held-out manoeuvre by as much as TOLERANCE.

        By so much a flight simulator for training may err. A channel without a tolerance must change by less than its
        noise; surfaces do not count, as what they do to the aircraft does. If nothing is named, but something is
        missing, this is True if the believed model errs by less than TOLERANCE in every record. False of windows:
        starts that are fitted hide how far it would go astray.
        """
        if self.windows or self.begun is not None:
            return False
        judged = [i for i, n in enumerate(self.believed.outputs) if n in TOLERANCE]
        if self.naming.best is None:
            errors = [(self.errors.get(self.believed.outputs[i], np.inf), i) for i in judged]
            small = all(e < TOLERANCE[self.believed.outputs[i]] for e, i in errors)
            return self.naming.outcome != "no gap" and bool(judged) and small
        if not self.shrink or self.naming.best.effect.met is not None:  # a gust is of no other manoeuvre's air
            return False
        noise = zip(self.believed.outputs, self.believed.noise_std, strict=True)
        limits = np.array([np.inf if n in self.believed.surfaces else TOLERANCE.get(n, s) for n, s in noise])
        moved = [np.abs(s.after - s.before).max(axis=0) for s in self.shrink]
        return bool(judged) and bool(np.all(np.max(moved, axis=0) < limits))

    def _evidence(self) -> list[str]:
        best = self.naming.best
        if best is None:
            judged = ", ".join(n for n in self.believed.outputs if n in TOLERANCE)
            words = (
                f"real but immaterial: in {judged} of these records the error of the a-priori model is less {_ALLOWED}"
            )
            return [words] if self.immaterial else []
        out = [] if self.left is None else [self.left.sentence]
        if self.immaterial:
            words = f"real but immaterial: in the held-out manoeuvres it changes every channel by less {_ALLOWED}"
            if not set(self.believed.outputs) <= {*TOLERANCE, *self.believed.surfaces}:
                words += "; a channel for which no tolerance is given changes by less than its noise"
            out.append(words)
        if best.effect.met is not None:
            out.append(
                "it was in the air of that manoeuvre alone; the gain in held-out manoeuvres comes from the re-tuned "
                f"coefficients. It could be mistaken for {best.effect.mistaken_for}. To separate them: "
                f"{best.effect.separated_by}"
            )
        return out
