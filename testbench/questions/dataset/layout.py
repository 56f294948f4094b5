"""What a data set holds: its dimensions, its variables with their units, and which of them are labels."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from testbench.core.channels import channel
from testbench.core.errors import located
from testbench.flight import FlightCondition, linearise, trim
from testbench.questions.dataset.draws import aircraft_of
from testbench.questions.dataset.scenario import SPLITS, DatasetScenario
from testbench.questions.dataset.truths import true_figures
from testbench.questions.gap.sealed.cases import STRATA
from testbench.questions.gap.sealed.flights import LOG_HZ, SETTLE_S, manoeuvres, suite
from testbench.questions.gap.sealed.truths import KINDS, PARAMETER_ERRORS
from testbench.sensors import load_suite

WITHHELD = -2
"""An integer label of the test split, as the store has it; a number is NaN."""
NONE = -1
"""No hidden effect."""
MOST_HIDDEN = 2
NAMING_SETS = ("rich", "held_out")


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
    """Names along the dimensions of a data set.

    Attributes:
        task: "identification" or "naming".
        flights: in all.
        per_draw: flights of a draw.
        rate_hz, samples: of every record; shorter ones end in NaN.
        channels, units: that are recorded.
        validity: whether samples can be missing or held.
        levels: of difficulty, or strata.
        aircraft, manoeuvres: names.
        figures, figure_units: of the truth.
        effects: kinds of hidden effects that may be drawn.
        right: for each kind, the names of the library that are right, " | " between them.
        sizes: "kind: size" of every kind.
        sealed: number of draws that are sealed cases of the blind test.
    """

    task: str
    flights: int
    per_draw: int
    rate_hz: float
    samples: int
    channels: tuple[str, ...]
    units: tuple[str, ...]
    validity: bool
    levels: tuple[str, ...]
    aircraft: tuple[str, ...]
    manoeuvres: tuple[str, ...]
    figures: tuple[str, ...]
    figure_units: tuple[str, ...]
    effects: tuple[str, ...]
    right: tuple[str, ...]
    sizes: tuple[str, ...]
    sealed: int = 0

    @property
    def dims(self) -> dict[str, int]:
        """Size of every dimension."""
        out = {
            "flight": self.flights,
            "time": self.samples,
            "channel": len(self.channels),
            "figure": len(self.figures),
        }
        return {**out, "hidden": MOST_HIDDEN, "size": len(self.sizes)} if self.effects else out

    @property
    def draws(self) -> int:
        """Number of draws; the last may have fewer flights than the others."""
        return -(-self.flights // self.per_draw)

    @property
    def variables(self) -> tuple[Variable, ...]:
        """Every array of the store, the order in which they lie in it."""
        naming = self.task == "naming"
        level = "stratum of the blind test" if naming else "level of difficulty"
        out = [
            Variable("readings", ("flight", "time", "channel"), "<f4", "what the sensors show, SI; NaN behind the end"),
            Variable("draw", ("flight",), "<i4", "number of the draw: its flights share all but input, noise and air"),
            Variable("split", ("flight",), "<i1", "split of the draw", codes=SPLITS),
            Variable("level", ("flight",), "<i1", level, label=naming, codes=self.levels),
            Variable("aircraft", ("flight",), "<i1", "aircraft that is believed to fly", codes=self.aircraft),
            Variable("manoeuvre", ("flight",), "<i1", "manoeuvre that was commanded", codes=self.manoeuvres),
            Variable("samples", ("flight",), "<i4", "number of samples of the record"),
            Variable("V_m_s", ("flight",), "<f4", "airspeed at trim", "m/s"),
            Variable("h_m", ("flight",), "<f4", "height at trim", "m"),
            Variable("turbulence_rms_m_s", ("flight",), "<f4", "rms of the turbulence, each axis", "m/s", naming),
            Variable("truth", ("flight", "figure"), "<f8", "true figures of the aircraft that flew", label=True),
        ]
        if self.effects:
            words = f"kinds of the hidden effects, {NONE} for none"
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
    return _identification(scenario, flights) if scenario.strata is None else _naming(scenario, flights)


def _identification(scenario: DatasetScenario, flights: int) -> Layout:
    sensed = load_suite(str(scenario.suite))
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
    kinds = tuple(dict.fromkeys(k for level in scenario.level for k in level.hidden))
    longest = max(m.duration_s + m.settle_s for m in scenario.manoeuvre)
    return Layout(
        task="identification",
        flights=flights,
        per_draw=len(scenario.manoeuvre),
        rate_hz=rate,
        samples=round(longest * rate) + 1,
        channels=sensed.channels,
        units=tuple(channel(n).unit for n in sensed.channels),
        validity=any(s.dropout or s.rate_hz for s in sensed.sensors) or _drops(scenario),
        levels=tuple(x.name for x in scenario.level),
        aircraft=tuple(dict.fromkeys(label(n) for level in scenario.level for n in level.aircraft)),
        manoeuvres=tuple(m.name for m in scenario.manoeuvre),
        figures=tuple(figures),
        figure_units=tuple(figures.values()),
        **_of_kinds(kinds),
    )


def _drops(scenario: DatasetScenario) -> bool:
    """Say whether a level makes a sensor lose samples."""
    return any(key.endswith(".dropout") for level in scenario.level for key in level.vary)


def _naming(scenario: DatasetScenario, flights: int) -> Layout:
    assert scenario.strata is not None
    sets = [manoeuvres("taurus", which) for which in NAMING_SETS]
    names = tuple(n for _, each in sets for n in each)
    counts = STRATA if scenario.strata.sealed is None else scenario.strata.sealed
    sealed = sum(counts.values())
    longest = max(len(next(iter(signal.values()))) for signals, _ in sets for signal in signals)
    sensed = suite()
    return Layout(
        task="naming",
        flights=(sealed + -(-flights // len(names))) * len(names),  # of whole cases
        per_draw=len(names),
        rate_hz=LOG_HZ,
        samples=longest + round(SETTLE_S * LOG_HZ) + 1,
        channels=sensed.channels,
        units=tuple(channel(n).unit for n in sensed.channels),
        validity=False,
        levels=tuple(STRATA),
        aircraft=("eolo", "taurus"),
        manoeuvres=names,
        figures=tuple(PARAMETER_ERRORS),
        figure_units=("",) * len(PARAMETER_ERRORS),
        sealed=sealed,
        **_of_kinds(tuple(KINDS)),
    )


def _of_kinds(kinds: tuple[str, ...]) -> dict[str, Any]:
    """Return the names of kinds, of what is right for each, and of their sizes."""
    rng = np.random.default_rng(0)
    return {
        "effects": kinds,
        "right": tuple(" | ".join(KINDS[k].names) for k in kinds),
        "sizes": tuple(f"{k}: {size}" for k in kinds for size in KINDS[k].draw(rng)),
    }


def label(aircraft: str) -> str:
    """Return the name of an aircraft, without the folder that it lies in."""
    return Path(aircraft).name
