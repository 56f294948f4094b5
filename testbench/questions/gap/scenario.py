"""Gap scenarios: what is believed, and the measured records, real or made from a hidden truth."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal, cast

from pydantic import Field, model_validator

from testbench.core.errors import RecordError, Refusal
from testbench.core.scenario.base import Condition, FlownAt, Manoeuvre, SuiteName
from testbench.core.schema import NonNegative, Strict
from testbench.questions.hidden import Hidden
from testbench.sensors import SensorSuite, load_suite

Windows = float | Literal["auto", "off"]
"""Length of the windows, s; "auto" cuts what does not begin with quiet flight, by the fastest unstable mode."""
SHORTEST_S = 2.0  # of a window: about one short period, without which its coefficients do not show beside a free start


def windows_of(text: str | None) -> Windows | None:
    """Return what is wanted of windows; None if nothing is.

    Raises:
        RecordError: it is no length, nor "auto" or "off".
    """
    if text is None or text in ("auto", "off"):
        return cast(Windows | None, text)
    try:
        length_s = float(text)
    except ValueError:
        length_s = math.nan
    if not SHORTEST_S <= length_s < math.inf:
        raise RecordError(f"--windows must be auto, off, or a length of at least {SHORTEST_S:g} s, got '{text}'")
    return length_s


Drive = Literal["command", "surface", "both"]
"""What drives: "both" are commands, and recorded surfaces where no command is recorded."""


class Loaded(Strict):
    """What the aircraft carried in one flight beyond what is believed of it, on the centre line, and when that was.

    ``load_kg`` is negative where it carried less, fuel that was burnt for one. ``load_aft_m`` is behind the believed
    centre of gravity. ``flown_at_s`` is how long after take-off the record begins: battery and fuel were emptier then.
    """

    load_kg: float = 0.0
    load_aft_m: float = 0.0
    flown_at_s: NonNegative | None = None


class MeasuredFile(Loaded):
    """A measured record on disk (NetCDF, as written by the testbench), relative to the scenario file.

    ``condition`` is what it started from where that is not the scenario's; "recorded": its quiet flight tells.
    """

    name: str
    file: str
    use: Literal["naming", "held_out"]
    condition: Condition | Literal["recorded"] | None = None


class GapManoeuvre(Manoeuvre, Loaded):
    """A manoeuvre that makes a record; ``condition`` is its initial condition if that is not the scenario's."""

    condition: Condition | None = None


class GapScenario(FlownAt):
    """A gap case. Either ``measured`` lists records, or ``manoeuvre`` and ``hidden`` define simulated ones.

    ``hidden`` says what really flies; the search is not told.

    Of the manoeuvres, those for "identification" are used to name the effect, those for "validation" are held out.

    ``effects`` are searched in place of the whole library, ``more_effects`` beside it, or beside those: names of the
    library, or ``FILE.py:NAME`` for effects that are brought.

    ``windows = "auto"`` cuts records that do not begin with quiet trim flight into windows, each of which starts
    freely; a number cuts every record into windows of so many seconds; "off" cuts none, and refuses records without
    quiet flight.

    ``drive`` "both": commands drive the believed model, and recorded surfaces where no command is recorded; where both
    are, the path between them is judged by itself first, and restricts the search. "surface": recorded surfaces drive
    wherever there are some, and effects between command and surface are not sought. "command": recorded surfaces are
    not looked at.
    """

    unnamed: ClassVar[str] = "gap"

    suite: SuiteName
    manoeuvre: Annotated[tuple[GapManoeuvre, ...], Field(strict=False)] = ()
    hidden: Hidden | None = None
    measured: Annotated[tuple[MeasuredFile, ...], Field(strict=False)] = ()
    effects: Annotated[tuple[str, ...], Field(strict=False, min_length=1)] | None = None
    more_effects: Annotated[tuple[str, ...], Field(strict=False)] = ()
    windows: Literal["auto", "off"] | Annotated[float, Field(strict=False, ge=SHORTEST_S)] = "auto"
    drive: Drive = "both"

    def faults(self) -> list[str]:
        """Return what is wrong with effects and what moves, as far as texts tell; no effect is run."""
        if not (self.effects or self.more_effects or self.hidden or self.manoeuvre):
            return []
        from testbench.questions.gap.brought import faults

        try:
            suite = load_suite(self.suite)
        except Refusal:
            suite = None  # which is said where the suite is needed
        keys = {"effects": self.effects or (), "more_effects": self.more_effects}
        found = [f"{key}: {fault}" for key, names in keys.items() for fault in faults(names, suite, self.file)]
        if suite is not None:
            found += self._not_recorded(suite)
        if self.hidden is not None and suite is not None:
            found += self.hidden.faults(self, suite, [m.name for m in self.manoeuvre])
        return [f"{self.file}, {fault}" if self.file else fault for fault in found]

    def _not_recorded(self, suite: SensorSuite) -> list[str]:
        """Return which controls move that no sensor records, whose influence would look like a missing effect.

        Also a rate of the suite that does not divide that of the simulation.
        """
        from testbench.flight.simulate import stride

        recorded = {channel.removesuffix("_cmd") for channel in suite.channels}
        found: list[str] = []
        if self.manoeuvre and self.simulation.rate_hz is not None:
            try:
                stride(self.simulation.rate_hz, suite.rate_hz)
            except Refusal as refused:
                found.append(f"simulation.rate_hz: {refused}")
        found += [
            f"manoeuvre '{m.name}', input: a control that moves must be recorded, but '{self.suite}' has no sensor of "
            f"{name} or {name}_cmd; add a command_log of {name}_cmd to the suite, or move another control"
            for m in self.manoeuvre
            for name in sorted({i.control for i in m.input} - recorded)
        ]
        return found

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
