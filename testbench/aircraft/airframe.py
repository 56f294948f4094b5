"""Motion and strain of any wing station, from the rigid motion and the modal states of a record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from testbench.aircraft.elastic import ElasticModel
from testbench.core.channels import modal_channels, station_channels
from testbench.core.errors import ModelError
from testbench.core.record import FlightRecord, FloatArray

RIGID_SOURCES = ("az", "p", "q", "r", "pdot", "qdot", "rdot")


@dataclass(frozen=True)
class WingStation:
    """A place on the wing where instruments may sit."""

    y_m: float  # station, positive on the right wing
    x_m: float  # distance ahead of the elastic axis
    height_m: float  # of the upper skin above the neutral axis, for strain gauges


def station_sources(elastic: ElasticModel | None) -> tuple[str, ...]:
    """Return the channels that those of the wing stations are computed from."""
    return (*RIGID_SOURCES, *modal_channels(len(elastic) if elastic else 0))


def with_stations(record: FlightRecord, stations: Sequence[WingStation], elastic: ElasticModel | None) -> FlightRecord:
    """Return the record with acceleration and, on flexible wings, strain of every wing station.

    Raises:
        ModelError: a station lies beyond the last one of the mode shapes, or a mode has no shape.
        ChannelError: the record lacks a channel of :func:`station_sources`.
    """
    columns = [wing_acceleration(record, elastic, s.y_m, s.x_m) for s in stations]
    if elastic is not None:
        columns += [wing_strain(record, elastic, s.y_m, s.height_m) for s in stations]
    names = station_channels(len(stations), elastic is not None)
    data = np.column_stack([record.data, *columns])
    valid = np.ones(data.shape, bool)
    return replace(record, channels=(*record.channels, *names), data=data, valid=valid)


def station_rows(
    stations: Sequence[WingStation], elastic: ElasticModel | None
) -> tuple[tuple[str, ...], tuple[dict[str, float], ...]]:
    """Return the names of the station channels and, for small motion about steady flight, their weights on channels."""
    rows: list[dict[str, float]] = []
    count = len(elastic) if elastic else 0
    for s in stations:
        row = {"az": 1.0, "pdot": s.y_m, "qdot": -s.x_m}
        if elastic is not None:
            weights = mode_at(elastic, "bend_m", s.y_m) + s.x_m * mode_at(elastic, "twist_rad", s.y_m)
            row |= {f"etaddot_{i + 1}": -float(weights[i]) for i in range(count)}
        rows.append(row)
    if elastic is not None:
        for s in stations:
            curvature = mode_at(elastic, "curvature_1_m", s.y_m)
            rows.append({f"eta_{i + 1}": -s.height_m * float(curvature[i]) for i in range(count)})
    return station_channels(len(stations), elastic is not None), tuple(rows)


def wing_acceleration(record: FlightRecord, elastic: ElasticModel | None, y_m: float, x_m: float = 0.0) -> FloatArray:
    """Return the specific force along body z, (n,) in m/s2, that an accelerometer on the wing reads.

        az_P = az_CG + y pdot - x qdot + r (p x + q y) - sum_i (+-) (bend_i(y) + x twist_i(y)) eta_i''

    the modal displacement being positive up and z down; on the left wing asymmetric modes count with a minus. The
    wing is taken to lie in the plane z = 0, and ``x_m`` counts from the centre of gravity as well as from the elastic
    axis, which lie within some centimetres of each other on EOLO.

    Args:
        record: with az, p, q, r, pdot, qdot and, for a flexible aircraft, etaddot of every mode.
        elastic: the modes, or None for rigid wings.
        y_m: station, positive on the right wing.
        x_m: distance ahead of the elastic axis.

    Raises:
        ModelError: the station lies beyond the last one of the mode shapes, or a mode has no shape.
        ChannelError: the record lacks a channel.
    """
    p, q, r, pdot, qdot = (record[name] for name in ("p", "q", "r", "pdot", "qdot"))
    rigid = record["az"] + y_m * pdot - x_m * qdot + r * (p * x_m + q * y_m)
    if elastic is None:
        return np.asarray(rigid)
    weights = mode_at(elastic, "bend_m", y_m) + x_m * mode_at(elastic, "twist_rad", y_m)
    accelerations = record.columns(f"etaddot_{i}" for i in range(1, len(elastic) + 1))
    return np.asarray(rigid - accelerations @ weights)


def wing_strain(record: FlightRecord, elastic: ElasticModel, y_m: float, height_m: float) -> FloatArray:
    """Return the bending strain (n,) of the skin ``height_m`` above the neutral axis at ``y_m``: -height w''(y).

    Strain in flight counts from the unloaded wing; the modes carry the load beyond that of free fall, so that level
    flight shows as a steady compression of the upper skin.

    Raises:
        ModelError: as :func:`wing_acceleration`.
        ChannelError: the record lacks eta of a mode.
    """
    curvature = record.columns(f"eta_{i}" for i in range(1, len(elastic) + 1)) @ mode_at(elastic, "curvature_1_m", y_m)
    return np.asarray(-height_m * curvature)


def mode_at(elastic: ElasticModel, quantity: str, y_m: float) -> FloatArray:
    """Return a quantity of WingShape at ``y_m``, one value per mode (k,), by cubic interpolation between stations.

    Raises:
        ModelError: the station lies beyond the last one, or a mode has no shape.
    """
    stations = tuple(elastic.stations_m)
    if not stations or abs(y_m) > stations[-1] + 1e-9:
        reach = f"0 to {stations[-1]:g} m" if stations else "none"
        raise ModelError(f"a wing station must lie within those of the mode shapes ({reach}), got y = {y_m:g} m")
    out = []
    for mode in elastic.modes:
        if mode.shape is None:
            raise ModelError(f"every mode must have a shape along the wing, got none for '{mode.name}'")
        value = _interpolated(stations, tuple(getattr(mode.shape, quantity)), abs(y_m))
        out.append(value if mode.symmetry == "symmetric" or y_m >= 0.0 else -value)
    return np.array(out)


@lru_cache(maxsize=4096)  # stations and shapes are the same in every flight of a campaign
def _interpolated(stations: tuple[float, ...], values: tuple[float, ...], y_m: float) -> float:
    from scipy.interpolate import CubicSpline

    return float(CubicSpline(stations, values)(y_m))
