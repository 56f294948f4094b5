"""The condition that records were flown at, and the mass, inertia and geometry that coefficients refer to."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.aircraft import Aircraft
from testbench.aircraft.model import Geometry, MassProperties
from testbench.aircraft.seams import INERTIAS
from testbench.core.atmosphere import air_density
from testbench.core.record import FlightRecord
from testbench.evaluation.coefficients import PartialMass
from testbench.logs.layout import RecordCondition
from testbench.questions.identify.scenario import RecordDescription

_ZERO_C_K = 273.15
_FAR = 0.1  # share by which a given airspeed may differ from the recorded one before that is said; judged
_SPREAD = 1.1  # ratio of dynamic pressures up to which records are of one condition; judged


@dataclass(frozen=True)
class FlownCondition:
    """Where records were flown, and what coefficients refer to."""

    # V_m_s, qbar_Pa: true airspeed and dynamic pressure; None if neither recorded nor given
    V_m_s: float | None
    qbar_Pa: float | None
    # h_m, alpha_rad: height and angle of attack; None if not known
    h_m: float | None
    alpha_rad: float | None
    geometry: Geometry | None  # reference area and lengths; None if nobody gave them
    mass: PartialMass  # of the records; what is not known is None
    notes: tuple[str, ...] = ()  # what was assumed, in sentences
    doubts: tuple[str, ...] = ()  # what may make coefficients wrong, in sentences

    @property
    def at(self) -> dict[str, float]:
        """Variable of a trend -> value, SI, of what is known."""
        found = {"V": self.V_m_s, "qbar": self.qbar_Pa, "alpha": self.alpha_rad, "mass": self.mass.mass_kg}
        return {name: value for name, value in found.items() if value is not None}


def flown_condition(
    description: RecordDescription,
    records: Sequence[FlightRecord],
    aircraft: Aircraft | None,
    V_of_estimator: float | None = None,
) -> FlownCondition:
    """Return the condition of the records that a model was identified from.

    Airspeed: given, else recorded, else that of the estimator. Dynamic pressure: of the given density, else recorded,
    else of the height. Mass and inertia: given, else the aircraft's.

    Args:
        description: what gives conditions.
        records: prepared, in the order of the description's, those of use "identification" first.
        aircraft: that the description names.
        V_of_estimator: ``V_m_s`` of its settings.
    """
    used = [r for use in ("identification", "split") for r in description.record if r.use == use for _ in r.parts]
    single = [
        _single(spec.condition.within(description.condition), record, V_of_estimator)
        for spec, record in zip(used, records, strict=True)
    ]
    notes = list(dict.fromkeys(text for one in single for text in one.notes))
    doubts = []
    pressures = [one.qbar_Pa for one in single if one.qbar_Pa is not None]
    if pressures and max(pressures) > _SPREAD * min(pressures):
        doubts.append(
            f"one model was fitted to records at dynamic pressures from {min(pressures):.4g} to {max(pressures):.4g} "
            "Pa, although its derivatives are proportional to that pressure; identify each separately and pool them "
            "(each = true under [pool], or --each)"
        )
    masses = [one.mass for one in single]
    if len(set(masses)) > 1:
        doubts.append(
            "one model was fitted to records of different mass or inertia, and the mean is used for coefficients; "
            "identify each separately and pool them (each = true under [pool], or --each)"
        )
    mean = PartialMass(**{n: _mean(getattr(m, n) for m in masses) for n in ("mass_kg", *INERTIAS)})
    mass, said = _completed(mean, aircraft)
    geometry = aircraft.geometry if aircraft is not None else None
    if description.geometry is not None:
        g = description.geometry
        geometry = Geometry(g.S_m2, g.b_m, g.cbar_m)
    return FlownCondition(
        _mean(one.V_m_s for one in single),
        _mean(one.qbar_Pa for one in single),
        _mean(one.h_m for one in single),
        _mean(one.alpha_rad for one in single),
        geometry,
        mass,
        (*notes, *said),
        tuple(doubts),
    )


def _single(given: RecordCondition, record: FlightRecord, V_of_estimator: float | None) -> FlownCondition:
    V, notes = as_flown("V", record), []
    if given.V_m_s is not None:
        if V is not None and abs(V - given.V_m_s) > _FAR * given.V_m_s:
            notes.append(f"the given airspeed of {given.V_m_s:.4g} m/s is taken, though {V:.4g} m/s were recorded")
        V = given.V_m_s
    V = V_of_estimator if V is None else V
    h = as_flown("h", record) if given.h_m is None else given.h_m
    qbar = as_flown("qbar", record)
    if given.density_kg_m3 is not None and V is not None:
        qbar = 0.5 * given.density_kg_m3 * V**2
    elif V is not None and h is not None and (qbar is None or given.temperature_degC is not None or given.V_m_s):
        temperature = None if given.temperature_degC is None else given.temperature_degC + _ZERO_C_K
        qbar = 0.5 * air_density(h, temperature) * V**2
    mass = PartialMass(given.mass_kg, given.Ixx_kg_m2, given.Iyy_kg_m2, given.Izz_kg_m2, given.Ixz_kg_m2)
    return FlownCondition(V, qbar, h, as_flown("alpha", record), None, mass, tuple(notes))


def _completed(given: PartialMass, aircraft: Aircraft | None) -> tuple[PartialMass, list[str]]:
    """Return mass and inertia with the aircraft's where they are not given, and what that assumes."""
    if aircraft is None:
        return given, []
    own: MassProperties = aircraft.mass
    values = {n: getattr(own, n) if getattr(given, n) is None else getattr(given, n) for n in ("mass_kg", *INERTIAS)}
    notes = []
    if given.mass_kg is not None and given.mass_kg != own.mass_kg and given.Ixx is given.Iyy is given.Izz is None:
        notes.append(
            f"the mass is {given.mass_kg:g} kg and {aircraft.name} has {own.mass_kg:g} kg, but no inertia is given: "
            f"that of {aircraft.name} is taken, as if the added mass were at the centre of gravity"
        )
    return PartialMass(**values), notes


def as_flown(name: str, record: FlightRecord) -> float | None:
    """Return the mean of a channel as flown: what was removed as trim, and what was left."""
    if name not in record:
        return None
    removed = record.provenance.get("prepared", {}).get("removed", {}).get(name, 0.0)
    return float(removed + np.mean(record[name]))


def _mean(values: Iterable[float | None]) -> float | None:
    found = [v for v in values if v is not None]
    return float(np.mean(found)) if found else None
