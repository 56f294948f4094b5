"""The best stations along the wing: where accelerometers and strain gauges tell most about the modes.

Sensors with independent noise and an unknown offset each add up in the Fisher information, M = M_0 + sum_i M_i, so
that M_i is computed once per station and kind, and every set costs one sum. The set is built by adding the sensor that
helps most, one at a time, and then exchanging single sensors for better ones until no exchange helps (V. V. Fedorov,
Theory of Optimal Experiments, 1972; D. C. Kammer, Journal of Guidance 14(2), 1991). If there are few sets, all are
tried.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import comb

import numpy as np

from testbench.aircraft.airframe import WingStation, station_rows
from testbench.core.errors import ModelError, ScenarioError
from testbench.core.record import FloatArray
from testbench.core.scenario.base import Manoeuvre
from testbench.information.fisher import accuracy, cost
from testbench.information.targets import Targets
from testbench.questions.compare.prediction import Known, experiment_of, in_percent, sensor_parts, targets_of
from testbench.questions.compare.scenario import Placement
from testbench.sensors import Sensor, SensorSuite, load_suite

Cost = Callable[[FloatArray], float]
_TRIED = 2000  # sets that are all tried: about a second


@dataclass(frozen=True)
class Spot:
    """One candidate: a kind of sensor at a station."""

    kind: str
    y_m: float

    @property
    def words(self) -> str:
        """Kind and station."""
        return f"{self.kind} at {self.y_m:+.2f} m".replace("-", "−")


@dataclass(frozen=True, eq=False)
class Placed:
    """The best stations."""

    asked: Placement  # what was asked
    base: str  # the suite that they are added to
    spots: tuple[Spot, ...]  # chosen, in the order of their gain
    candidates: Mapping[Spot, float]  # all candidates, with the criterion that each reaches alone
    path: tuple[float, ...]  # criterion after each sensor of ``spots``, the first without any
    # (t,) quantities; ``before`` and ``after``: their standard errors (percent; absolute for damping ratios) without
    # and with the chosen sensors
    names: tuple[str, ...]
    before: FloatArray
    after: FloatArray
    exchanged: int  # how many exchanges followed the greedy choice
    sets: int  # how many sets there are
    all_tried: bool  # whether every one of them was tried, so that this is the best of all


def place(
    known: Known,
    asked: Placement,
    base: SensorSuite,
    sensors: Sequence[Sensor],
    manoeuvre: Manoeuvre,
    templates: Mapping[str, Sensor],
) -> Placed:
    """Return the best stations for sensors along the wing.

    Args:
        known: the aircraft, with the modes of the placement among its unknowns.
        asked: how many of which kind, for which modes.
        base: the suite that they are added to.
        sensors: the sensors of that suite that are used.
        manoeuvre: the input.
        templates: kind ("accelerometer", "strain gauge") -> a sensor whose noise, lag and rate every candidate has.

    Raises:
        ModelError: the aircraft has no wing stations, or rigid wings where strain is asked for.
    """
    spots, parts, base_part, aims = informations(known, asked, base, sensors, manoeuvre, templates)

    def value(M: FloatArray) -> float:
        """Return the criterion of an information matrix."""
        return cost(M, aims.gradient, asked.criterion)

    groups = _groups(asked, spots)
    sets = math.prod(comb(len(members), count) for members, count in groups)
    chosen, swaps = best_set(base_part, parts, groups, value)
    if sets <= _TRIED:
        chosen, _ = brute_force(base_part, parts, groups, value)
    total, path, order = base_part, [value(base_part)], []
    remaining = list(chosen)
    while remaining:  # in the order of their gain
        k = min(remaining, key=lambda i: value(total + parts[i]))
        remaining.remove(k)
        total = total + parts[k]
        order.append(spots[k])
        path.append(value(total))
    before, after = (aims.errors(accuracy(M)) * in_percent(aims) for M in (base_part, total))
    alone = {spot: value(base_part + part) for spot, part in zip(spots, parts, strict=True)}
    best = sets <= _TRIED
    return Placed(asked, base.name, tuple(order), alone, tuple(path), aims.names, before, after, swaps, sets, best)


def informations(
    known: Known,
    asked: Placement,
    base: SensorSuite,
    sensors: Sequence[Sensor],
    manoeuvre: Manoeuvre,
    templates: Mapping[str, Sensor],
) -> tuple[list[Spot], list[FloatArray], FloatArray, Targets]:
    """Return the candidates, the information (k, k) that each adds, that of the suite alone, and the targets."""
    elastic = known.aircraft.flown_modes()
    stations = candidate_stations(known, asked)
    names, rows = station_rows(stations, elastic)
    linear = known.linear
    weights = np.array([[row.get(c, 0.0) for c in linear.outputs] for row in rows])
    of_stations = ("az_wing_", "strain_wing_")
    keep = [k for k, name in enumerate(linear.outputs) if not name.startswith(of_stations)]
    model = replace(
        linear,
        C=np.vstack([linear.C[keep], weights @ linear.C]),
        D=np.vstack([linear.D[keep], weights @ linear.D]),
        outputs=(*(linear.outputs[k] for k in keep), *names),
    )
    wing = replace(known, linear=model, aircraft=replace(known.aircraft, wing_stations=tuple(stations)))
    spots, found = [], []
    for i, station in enumerate(stations, 1):
        for kind, channel in (("accelerometer", f"az_wing_{i}"), ("strain gauge", f"strain_wing_{i}")):
            if kind in templates:
                spots.append(Spot(kind, round(station.y_m, 9)))
                found.append(replace(templates[kind], channel=channel, position_m=(0.0, 0.0, 0.0)))
    experiment, u = experiment_of(wing, found, base.rate_hz, manoeuvre)
    own, u0 = experiment_of(known, sensors, base.rate_hz, manoeuvre)
    aims = targets_of(known, own.structure, (0.01 * asked.wn_percent, asked.zeta))
    return spots, list(sensor_parts(experiment, u)), own.information(u0), aims


def candidate_stations(known: Known, asked: Placement) -> tuple[WingStation, ...]:
    """Return the stations that may hold a sensor.

    Between the stations that the aircraft lists, the skin's height is interpolated; sensors sit on the elastic axis.

    Raises:
        ModelError: the aircraft's wing is rigid or has no stations.
    """
    elastic, listed = known.aircraft.flown_modes(), known.aircraft.flown_stations()
    if elastic is None or not listed:
        raise ModelError(f"{known.aircraft.name} must have flexible wings with stations to place sensors on")
    if asked.stations == "listed":
        return listed
    tip = elastic.stations_m[-1]
    half = [k * asked.step_m for k in range(int(tip / asked.step_m + 1e-9) + 1)]
    at = sorted({abs(s.y_m): s.height_m for s in listed}.items())
    y, height = np.array(at).T
    return tuple(
        WingStation(side, 0.0, float(np.interp(abs(side), y, height)))
        for side in [*(-v for v in reversed(half[1:])), *half]
    )


def best_set(
    base: FloatArray, parts: Sequence[FloatArray], groups: Sequence[tuple[Sequence[int], int]], value: Cost
) -> tuple[tuple[int, ...], int]:
    """Return the members of the best set, greedy with exchanges, and how many exchanges were made.

    Args:
        base: information of what is there anyway.
        parts: information of each candidate.
        groups: (candidates, how many of them) per kind.
        value: what is made small.
    """
    chosen: list[int] = []
    room = {g: count for g, (_, count) in enumerate(groups)}
    owner = {k: g for g, (members, _) in enumerate(groups) for k in members}
    total = base
    while any(room.values()):
        free = [k for k in owner if k not in chosen and room[owner[k]] > 0]
        # a start without any information costs inf whatever is added: then the largest trace wins
        k = min(free, key=lambda i: (value(total + parts[i]), -float(np.trace(parts[i]))))
        chosen.append(k)
        room[owner[k]] -= 1
        total = total + parts[k]
    now, swaps = value(total), 0
    while True:
        moves = [
            (value(total - parts[a] + parts[b]), a, b) for a in chosen for b in groups[owner[a]][0] if b not in chosen
        ]
        if not moves:
            break
        least, a, b = min(moves)
        if not least < now * (1.0 - 1e-9):
            break
        chosen[chosen.index(a)] = b
        total, now, swaps = total - parts[a] + parts[b], least, swaps + 1
    return tuple(chosen), swaps


def brute_force(
    base: FloatArray, parts: Sequence[FloatArray], groups: Sequence[tuple[Sequence[int], int]], value: Cost
) -> tuple[tuple[int, ...], float]:
    """Return the best set of all and its criterion, every set tried."""
    sets: list[tuple[int, ...]] = [()]
    for members, count in groups:
        sets = [(*s, *more) for s in sets for more in combinations(members, count)]
    costs = [value(base + np.sum([parts[k] for k in s], axis=0)) for s in sets]
    k = int(np.argmin(costs))
    return sets[k], costs[k]


def _groups(asked: Placement, spots: Sequence[Spot]) -> list[tuple[list[int], int]]:
    counts = {"accelerometer": asked.accelerometers, "strain gauge": asked.strain_gauges}
    out = []
    for kind, count in counts.items():
        members = [k for k, s in enumerate(spots) if s.kind == kind]
        if count > len(members):
            raise ModelError(f"there must be at least {count} stations for {kind}s, got {len(members)}; lower step_m")
        if count:
            out.append((members, count))
    return out


def templates(asked: Placement) -> dict[str, Sensor]:
    """Return kind -> the sensor that every candidate is like.

    Raises:
        ScenarioError: a suite has no such sensor.
    """
    out = {}
    for kind, count, name, prefix in (
        ("accelerometer", asked.accelerometers, asked.accelerometer_suite, "az_wing_"),
        ("strain gauge", asked.strain_gauges, asked.strain_suite, "strain_wing_"),
    ):
        if not count:
            continue
        found = [s for s in load_suite(name).sensors if s.channel.startswith(prefix)]
        if not found:
            raise ScenarioError(f"suite '{name}' must hold an {kind} on the wing ({prefix}1, ...), it has none")
        out[kind] = found[0]
    return out
