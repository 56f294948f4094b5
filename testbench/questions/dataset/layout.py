"""What a data set holds: its dimensions, its variables with their units, and which of them are labels."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from testbench.core.channels import channel
from testbench.core.errors import located
from testbench.effects import catalogue
from testbench.flight import FlightCondition, linearise, trim
from testbench.questions.dataset.draws import MOST_HIDDEN, aircraft_of, right_names, true_figures
from testbench.questions.dataset.scenario import SPLITS, DatasetScenario
from testbench.questions.gap.parts import part_names
from testbench.sensors import load_suite

WITHHELD = -2
"""An integer label of the test split, as the store has it; a number is NaN."""
NONE = -1
"""No hidden effect."""


@dataclass(frozen=True)
class Variable:
    """One array of the store; the first dimension is "flight". ``label`` if the test split withholds it."""

    name: str
    dims: tuple[str, ...]
    dtype: str
    words: str
    unit: str = ""
    label: bool = False
    codes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Layout:
    """Names along the dimensions of a data set."""

    task: str  # "identification" or "naming"
    flights: int  # in all
    per_draw: int  # flights of a draw
    # rate_hz, samples: of every record; shorter ones end in NaN
    rate_hz: float
    samples: int
    # channels, units: that are recorded
    channels: tuple[str, ...]
    units: tuple[str, ...]
    validity: bool  # whether samples can be missing or held
    levels: tuple[str, ...]  # of difficulty
    # aircraft, manoeuvres: names
    aircraft: tuple[str, ...]
    manoeuvres: tuple[str, ...]
    keys: tuple[str, ...]  # that levels vary, as a campaign does
    # figures, figure_units: of the truth
    figures: tuple[str, ...]
    figure_units: tuple[str, ...]
    effects: tuple[str, ...]  # that may be hidden, by their names in the library
    parts: tuple[str, ...]  # for each of them, the part of the aircraft that it acts in
    right: tuple[str, ...]  # for each of them, the names that are right, " | " between them
    sizes: tuple[str, ...]  # "effect: parameter" of every one

    @property
    def dims(self) -> dict[str, int]:
        """Size of every dimension."""
        out = {"flight": self.flights, "time": self.samples, "channel": len(self.channels), "figure": len(self.figures)}
        out |= {"key": len(self.keys)} if self.keys else {}
        return {**out, "hidden": MOST_HIDDEN, "size": len(self.sizes)} if self.effects else out

    @property
    def draws(self) -> int:
        """Number of draws; the last may have fewer flights than the others."""
        return -(-self.flights // self.per_draw)

    @property
    def variables(self) -> tuple[Variable, ...]:
        """Every array of the store, the order in which they lie in it."""
        naming = self.task == "naming"
        out = [
            Variable("readings", ("flight", "time", "channel"), "<f4", "what the sensors show, SI; NaN behind the end"),
            Variable("draw", ("flight",), "<i4", "number of the draw: its flights share all but input, noise and air"),
            Variable("split", ("flight",), "<i1", "split of the draw", codes=SPLITS),
            Variable("level", ("flight",), "<i1", "level of difficulty", label=naming, codes=self.levels),
            Variable("aircraft", ("flight",), "<i1", "aircraft of the a-priori model", codes=self.aircraft),
            Variable("manoeuvre", ("flight",), "<i1", "manoeuvre that was commanded", codes=self.manoeuvres),
            Variable("samples", ("flight",), "<i4", "number of samples of the record"),
            Variable("V_m_s", ("flight",), "<f4", "airspeed at trim", "m/s"),
            Variable("h_m", ("flight",), "<f4", "height at trim", "m"),
            Variable("turbulence_rms_m_s", ("flight",), "<f4", "rms of the turbulence, each axis", "m/s", naming),
            Variable("scale", ("flight",), "<f4", "factor on the inputs"),
            Variable("truth", ("flight", "figure"), "<f8", "true figures of the aircraft that flew", label=True),
        ]
        if self.keys:
            words = "what was drawn for each key, NaN if the level does not vary it"
            out.append(Variable("drawn", ("flight", "key"), "<f8", words, label=True))
        if self.effects:
            words = f"hidden effects, {NONE} for none"
            out += [
                Variable("effect", ("flight", "hidden"), "<i2", words, "", True, self.effects),
                Variable("effect_size", ("flight", "size"), "<f4", "sizes of hidden effects, NaN if none", "", True),
            ]
        if self.validity:
            out.insert(
                1, Variable("valid", ("flight", "time", "channel"), "|i1", "1 where a sample was taken, 0 if held")
            )
        return tuple(out)

    @property
    def row_bytes(self) -> int:
        """Bytes of one flight in the store."""
        return sum(self.bytes_of(v) for v in self.variables)

    def bytes_of(self, variable: Variable) -> int:
        """Return the bytes of one flight in one array."""
        return int(np.dtype(variable.dtype).itemsize * np.prod([self.dims[d] for d in variable.dims[1:]], dtype=int))

    def empty(self, count: int) -> dict[str, Any]:
        """Return arrays of so many flights, filled with NaN or NONE."""
        out = {}
        for v in self.variables:
            shape = (count, *(self.dims[d] for d in v.dims[1:]))
            out[v.name] = np.full(shape, np.nan if "f" in v.dtype else NONE, v.dtype)
        return out

    def to_json(self) -> str:
        """Return the layout as JSON."""
        return json.dumps(asdict(self))


def layout_of(scenario: DatasetScenario, flights: int) -> Layout:
    """Return the layout of a data set of so many drawn flights.

    Raises:
        TrimError: an aircraft has no trim in the middle of its conditions.
    """
    sensed = load_suite(scenario.suite)
    rate = scenario.samples_hz or sensed.rate_hz
    figures: dict[str, str] = {}
    for i, level in enumerate(scenario.level):
        for name in level.aircraft:
            aircraft = aircraft_of(name, level.wings)
            V = 0.5 * sum(level.speed_ratio) * aircraft.design_V_m_s
            with located(scenario.file, f"level[{i}]"):
                at = trim(aircraft, FlightCondition(V, 0.5 * sum(level.h_m)), scenario.simulation.rate_hz)
            found = true_figures(aircraft, linearise(aircraft, at), at)
            figures |= {name: unit for name, (_, unit) in found.items()}
    hidden = dict.fromkeys(k for level in scenario.level for entry in level.hidden for k in entry.split(" + "))
    known = catalogue(sensed) if hidden else {}
    longest = max(m.duration_s + m.settle_s for m in scenario.manoeuvre)
    return Layout(
        task=scenario.task,
        flights=flights,
        per_draw=len(scenario.manoeuvre),
        rate_hz=rate,
        samples=round(longest * rate) + 1,
        channels=sensed.channels,
        units=tuple(channel(n).unit for n in sensed.channels),
        validity=any(s.dropout or s.rate_hz for s in sensed.sensors)
        or any(key.endswith(".dropout") for level in scenario.level for key in level.vary),
        levels=tuple(x.name for x in scenario.level),
        aircraft=tuple(dict.fromkeys(label(n) for level in scenario.level for n in level.aircraft)),
        manoeuvres=tuple(m.name for m in scenario.manoeuvre),
        keys=tuple(dict.fromkeys(key for level in scenario.level for key in level.vary)),
        figures=tuple(figures),
        figure_units=tuple(figures.values()),
        effects=tuple(hidden),
        parts=tuple(part_names(known[k])[0] for k in hidden),
        right=tuple(" | ".join(right_names(k)) for k in hidden),
        sizes=tuple(f"{k}: {p.name}" for k in hidden for p in known[k].parameters),
    )


def label(aircraft: str) -> str:
    """Return the name of an aircraft, without the folder that it lies in."""
    return Path(aircraft).name
