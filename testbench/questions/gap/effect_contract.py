"""What every effect must do, as laws: tests try them on the whole library, users on an effect of their own.

They are tried on the rigid EOLO at 16 m/s with the suite eolo_gap at 50 Hz, on records of 8 s: elevator doublets of two
sizes, an elevator sweep, and throttle with doublets and a pull-up.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from testbench.core.contract import Law, need, tried_on
from testbench.core.record import FlightRecord
from testbench.effects.base import LINK, Effect
from testbench.flight import FlightCondition, load_aircraft, trim
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.brought import load_effect
from testbench.questions.gap.name import Sought, name_effect
from testbench.sensors import load_suite

CONDITION = FlightCondition(16.0, 547.0)
RATE_HZ = 100.0
_LOG_HZ = 50.0
_SAMPLES = 400


@dataclass(frozen=True, eq=False)
class Trial:
    """An effect under trial."""

    effect: Effect  # under trial
    # values at which it vanishes; made of its parameters' ``none`` if not given
    zero: Mapping[str, float] | None = None
    # values that are put into data; seven tenths of the usual size if not given
    true: Mapping[str, float] | None = None

    @cached_property
    def believed(self) -> Believed:
        """What is believed to fly; its limits are wide, so that effects may take it far."""
        return believed()

    @property
    def usual(self) -> dict[str, float]:
        """The last of every parameter's starts."""
        return {p.name: p.starts[-1] for p in self.effect.parameters}

    @property
    def vanishing(self) -> Mapping[str, float] | None:
        """Values at which the effect vanishes; None if that depends on what is believed."""
        if self.zero is not None:
            return self.zero
        if all(p.none is None for p in self.effect.parameters):
            return None
        return {p.name: p.starts[0] if p.none is None else p.none for p in self.effect.parameters}

    @property
    def put_in(self) -> Mapping[str, float]:
        """Values that are put into data."""
        return self.true or {p.name: 0.7 * p.starts[0] + 0.3 * (p.none or 0.0) for p in self.effect.parameters}


def believed() -> Believed:
    """Return the rigid EOLO with wide limits and its sensors at 50 Hz, in the condition of the trials."""
    suite = replace(load_suite("eolo_gap"), rate_hz=_LOG_HZ)
    aircraft = load_aircraft("eolo", "rigid")
    wide = {**aircraft.limits, "V": (7.0, 40.0), "alpha": (-0.3, 0.4), "theta": (-1.2, 1.2)}
    return Believed(replace(aircraft, limits=wide), suite, CONDITION, RATE_HZ)


def commands() -> tuple[FlightRecord, ...]:
    """Return records that hold commands only: doublets of two sizes, a sweep, throttle with doublets and a pull-up."""
    t = np.arange(_SAMPLES) / _LOG_HZ
    de = np.zeros((3, _SAMPLES))
    thr = np.zeros((3, _SAMPLES))
    de[0] += 0.05 * ((t > 1.0) & (t < 1.3)) - 0.05 * ((t >= 1.3) & (t < 1.6))
    de[0] += 0.02 * ((t > 4.0) & (t < 4.3)) - 0.02 * ((t >= 4.3) & (t < 4.6))
    de[1] += 0.05 * np.sin(2 * np.pi * 0.5 * (np.exp(0.4 * (t - 1)) - 1) / 0.4) * ((t > 1.0) & (t < 7.9))
    thr[2] += 0.15 * ((t > 1.0) & (t < 4.0))
    de[2] += 0.05 * ((t > 2.0) & (t < 2.3)) - 0.05 * ((t >= 2.3) & (t < 2.6))
    de[2] -= 0.05 * np.sin(np.pi * (t - 5.0) / 1.5) * ((t > 5.0) & (t < 6.5))
    return tuple(
        FlightRecord(t_s=t, channels=("de_cmd", "thr_cmd"), data=np.column_stack([d, h]), kind="measured")
        for d, h in zip(de, thr, strict=True)
    )


def recorded(model: Believed, flown: tuple[FlightRecord, ...]) -> tuple[FlightRecord, ...]:
    """Return what the sensors of ``model`` would have read of these commands, without noise."""
    out = []
    for c in flown:
        data = np.column_stack([model.predict(c), c.data])
        out.append(FlightRecord(t_s=c.t_s, channels=(*model.outputs, *c.channels), data=data, kind="measured"))
    return tuple(out)


# --- the laws ---------------------------------------------------------------------------------------------------------


def it_says_in_words_what_it_is(t: Trial) -> None:
    """A name for results, a title for people, the physics in two sentences, what it may be taken for."""
    e = t.effect
    need(e.name.isidentifier(), f"name must be a short one without spaces, got '{e.name}'")
    need(bool(e.title), "title must say what it is called")
    need(e.physics.count(".") >= 2, f"physics must describe the mechanism in two sentences, got '{e.physics}'")
    need(bool(e.mistaken_for), "mistaken_for must name the effects that it cannot be distinguished from")
    need(bool(e.separated_by), "separated_by must name the flight or measurement that separates them")


def it_names_where_it_acts(t: Trial) -> None:
    """The part of aircraft or sensor, and how far up the path from forces to the pilot's command."""
    need(bool(t.effect.place), "place must name the part of aircraft or sensor that it acts in")
    need(t.effect.upstream in range(LINK + 1), f"upstream must be one of FORCES ... LINK, got {t.effect.upstream}")


def its_parameters_have_units_and_start_within_their_bounds(t: Trial) -> None:
    """Bounds are physical; the value without effect, if there is one, lies within them."""
    need(bool(t.effect.parameters), "parameters must name what a fit estimates, got none")
    for p in t.effect.parameters:
        need(bool(p.unit), f"'{p.name}' must have a unit, '1' if it has none")
        need(bool(p.starts), f"'{p.name}' must have a start")
        for s in p.starts:
            need(p.low < s < p.high, f"starts of '{p.name}' must lie between {p.low:g} and {p.high:g}, got {s:g}")
        need(
            p.none is None or p.low <= p.none <= p.high, f"none of '{p.name}' must lie within its bounds, got {p.none}"
        )


def it_changes_aircraft_or_sensors_and_leaves_what_it_was_given(t: Trial) -> None:
    """Neither argument is changed; what comes back, or the condition flown, differs and has a trim."""
    suite = load_suite("eolo_full") if t.effect.name == "steady_wind" else t.believed.suite
    aircraft, values = t.believed.aircraft, t.usual
    before = aircraft.model_xml(500.0, 150.0, 16.0)
    amended, sensors = t.effect.amend(aircraft, suite, values)
    need(aircraft.model_xml(500.0, 150.0, 16.0) == before, "amend must not change the aircraft that it is given")
    after = amended.model_xml(500.0, 150.0, 16.0), sensors
    moved = CONDITION if t.effect.elsewhere is None else t.effect.elsewhere(CONDITION, values)
    need((*after, moved) != (before, suite, CONDITION), f"amend must change aircraft or sensors at {values}")
    off = float(np.max(np.abs(trim(amended, moved).residual)))
    need(off < 1e-9, f"the amended aircraft must have a trim, got a residual of {off:.2g}")


def it_flies_at_its_usual_size(t: Trial) -> None:
    """The amended aircraft flies the doublets, and its sensors read finite numbers."""
    read = t.believed.with_effect(t.effect, t.usual).predict(commands()[0])
    need(bool(np.isfinite(read).all()), "what the sensors read of the amended aircraft must be finite")


def without_size_it_changes_nothing(t: Trial) -> None:
    """Up to one part in 1e6 of what the motion spans: terms of size zero round, and modes without effect still move."""
    if t.vanishing is None:
        return
    record = commands()[0]
    plain, same = t.believed.predict(record), t.believed.with_effect(t.effect, t.vanishing).predict(record)
    most = float(np.max(np.abs(same - plain) / np.ptp(plain, axis=0)))
    need(most < 1e-6, f"at {dict(t.vanishing)} nothing must change, got {most:.2g} of what the motion spans")


def it_goes_from_process_to_process(t: Trial) -> None:
    """The search sends what it found between processes: functions must stand at the top of their file."""
    again = pickle.loads(pickle.dumps(t.effect))
    need(again.name == t.effect.name, "a copy from another process must be the same effect")


def it_is_found_again_in_data_that_it_made(t: Trial) -> None:
    """From noise-free records with the effect in them, fitting it leaves no more than a fiftieth of the gap."""
    records = recorded(t.believed.with_effect(t.effect, t.put_in), commands())
    naming = name_effect(t.believed, records, Sought({t.effect.name: t.effect}, pairs=False))
    if t.effect.name in naming.rejected:
        return  # these flights do not show it, which is no fault of the effect
    found = next((f for f in naming.ranking if not f.coefficients), None)
    need(found is not None, "something on the way to its best fit must fly")
    if found is not None:
        left = f"{naming.chi2_believed:.4g} to {found.chi2:.4g} of chi-square with {dict(found.values)}"
        need(
            found.chi2 < max(0.02 * naming.chi2_believed, 1.0),
            f"the fit must close the gap that {dict(t.put_in)} makes, got {left}",
        )


Check = Callable[[Trial], None]
OF_WORDS: tuple[Check, ...] = (
    it_says_in_words_what_it_is,
    it_names_where_it_acts,
    its_parameters_have_units_and_start_within_their_bounds,
)
"""What every effect must say."""
OF_AIRCRAFT: tuple[Check, ...] = (
    it_changes_aircraft_or_sensors_and_leaves_what_it_was_given,
    it_flies_at_its_usual_size,
    without_size_it_changes_nothing,
    it_goes_from_process_to_process,
)
"""What every effect of an aircraft or its sensors must do; a gust is of one record's air."""
LAWS: tuple[Check, ...] = (*OF_WORDS, *OF_AIRCRAFT, it_is_found_again_in_data_that_it_made)
"""What an effect that is brought must do."""


# --- the command ------------------------------------------------------------------------------------------------------


def tried(path: Path, attribute: str) -> Iterator[Law]:
    """Yield every law and whether it holds, for the effect of that name in a user's file."""
    yield from tried_on(Trial(load_effect(path, attribute)), LAWS, path)
