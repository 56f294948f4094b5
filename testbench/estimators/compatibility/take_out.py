"""Records with the errors of their instruments taken out, and records rebuilt from rates and accelerations.

What the kinematics say about the instruments of records: each error with its significance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from testbench.core.advice import Advised, as_json
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.compatibility.fit import Stretch, stretch
from testbench.estimators.parametric.kinematics import ACCELEROMETERS, KinematicStructure
from testbench.estimators.parametric.response import Sampling, respond

# --- what the kinematics say about the instruments of records ---------------------------------------------------------


INSTRUMENT_ERROR = "instrument_error"
"""The code of the advice that names one error."""


@dataclass(frozen=True)
class InstrumentError:
    """One error of an instrument, or one component of the wind.

    Attributes:
        name: channel and kind, e.g. ``alpha_scale``.
        estimate: SI; a scale is 1 for none, everything else 0.
        standard_error: corrected for residuals that are not white.
        significance: deviation from none over standard error.
        words: what it means.
        alternatives: other errors that would explain the data as well, in words.
    """

    name: str
    estimate: float
    standard_error: float
    significance: float
    words: str
    alternatives: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class DataCompatibility(Advised):
    """What the kinematics say about the instruments of one or several records.

    Attributes:
        structure: the kinematics with which the records were compared.
        errors: those that are significant; ``covariance`` (k, k) in their order.
        tested: every error that the data can tell, all estimated together.
        not_identifiable: error -> why these data do not tell it.
        reconstructed: the records as the kinematics rebuild them from the corrected rates and accelerations; channels
            that the kinematics do not know are as they were.
        residual_before, residual_after: output -> rms of measured minus rebuilt, SI, all records; before with no error
            allowed for, after with ``errors``.
        settings, diagnostics: the settings, and how the search went.
        advice: the errors found and what is doubtful, see :mod:`testbench.core.advice`; ``status`` follows from it.
    """

    structure: KinematicStructure
    errors: tuple[InstrumentError, ...]
    covariance: FloatArray
    tested: tuple[InstrumentError, ...]
    not_identifiable: Mapping[str, str]
    reconstructed: tuple[FlightRecord, ...]
    residual_before: Mapping[str, float]
    residual_after: Mapping[str, float]
    settings: Mapping[str, Any] = field(default_factory=dict)
    diagnostics: Mapping[str, Any] = field(default_factory=dict)
    advice: tuple[str, ...] = ()

    @property
    def values(self) -> dict[str, float]:
        """Significant error -> estimate, SI."""
        return {e.name: e.estimate for e in self.errors}

    def to_dict(self) -> dict[str, Any]:
        """Return everything but the records as JSON values."""

        def table(rows: Sequence[InstrumentError]) -> list[dict[str, Any]]:
            return [{**vars(e), "alternatives": list(e.alternatives)} for e in rows]

        return {
            "motion": self.structure.motion,
            "inputs": list(self.structure.inputs),
            "outputs": list(self.structure.outputs),
            "errors": table(self.errors),
            "covariance": self.covariance.tolist(),
            "tested": table(self.tested),
            "not_identifiable": dict(self.not_identifiable),
            "residual_before": dict(self.residual_before),
            "residual_after": dict(self.residual_after),
            "settings": dict(self.settings),
            "diagnostics": dict(self.diagnostics),
            "status": self.status,
            "advice": as_json(self.advice),
        }


# --- records with the errors of their instruments taken out, and records rebuilt from rates and accelerations ---------


def correct(record: FlightRecord, result: DataCompatibility) -> FlightRecord:
    """Return a record with the significant errors taken out, still of kind "measured".

    Of y(t) = scale x(t - delay) + bias, lagged by tau, what is returned is

        x(t) = (y(t + delay) + tau ydot(t + delay) - bias) / scale,

    with accelerations moved to the CG where the result knows positions. Samples
    that a delay leaves without a source at an end of the record are held and marked not valid. A lag is inverted with
    the derivative over one time constant, to first order: noise grows. Wind is no error of an instrument: nothing is
    taken out for it. ``provenance`` holds what was done under "corrected".

    Args:
        record: measured by the same instruments; the result's own or another one. Channels it lacks are left out.
        result: what :func:`estimate` found.

    Raises:
        ChannelError: accelerations are to be moved, and the record lacks the rates for it.
        RecordError: the record is not sampled uniformly.
    """
    values, structure = result.values, result.structure
    moved = _at_cg(record, structure, values) if structure.positions_m else {}
    others = {n: v for n, v in values.items() if n.rpartition("_")[0] not in moved}
    out = taken_out(record.with_columns(moved) if moved else record, others)
    if out is record:
        return record
    done = {"errors": dict(values), "accelerations_at_cg": bool(structure.positions_m)}
    return replace(out, provenance={**record.provenance, "corrected": done})


def taken_out(record: FlightRecord, values: Mapping[str, float]) -> FlightRecord:
    """Return a record without the errors ``values`` (CHANNEL_KIND -> size), see :func:`correct`.

    Raises:
        RecordError: the record is not sampled uniformly.
    """
    columns: dict[str, FloatArray] = {}
    valid = record.valid.copy()
    for name in dict.fromkeys(n.rpartition("_")[0] for n in values):
        if name not in record:
            continue
        y = record[name].copy()
        i = record.channels.index(name)
        delay, lag = values.get(f"{name}_delay", 0.0), values.get(f"{name}_lag", 0.0)
        if lag > 0.0:
            reach = max(1, round(0.5 * lag / record.dt_s))
            before, after = np.maximum(np.arange(y.size) - reach, 0), np.minimum(np.arange(y.size) + reach, y.size - 1)
            y = y + lag * (y[after] - y[before]) / ((after - before) * record.dt_s)
        if delay:
            t = record.t_s - record.t_s[0]
            y = np.interp(t + delay, t, y)
            source = np.clip(np.rint((t + delay) / record.dt_s).astype(int), 0, y.size - 1)
            valid[:, i] = valid[source, i] & (t + delay >= 0.0) & (t + delay <= t[-1] + 1e-9)
        columns[name] = (y - values.get(f"{name}_bias", 0.0)) / values.get(f"{name}_scale", 1.0)
    if not columns:
        return record
    out = replace(record.with_columns(columns), valid=valid)
    return replace(out, provenance={**record.provenance, "corrected": {"errors": dict(values)}})


def _at_cg(record: FlightRecord, structure: KinematicStructure, values: Mapping[str, float]) -> dict[str, FloatArray]:
    u = stretch(record, structure).u
    true = structure.at_cg(u, parameters(structure, values))
    return {n: true[:, structure.inputs.index(n)] for n in ACCELEROMETERS if n in structure.inputs}


def parameters(structure: KinematicStructure, values: Mapping[str, float]) -> FloatArray:
    """Return the parameter vector (k,) of errors by name; none where not named."""
    out = structure.values.copy()
    for i, name in enumerate(structure.parameter_names):
        out[i] = values.get(name, out[i])
    return out


def rebuild(
    record: FlightRecord, s: Stretch, structure: KinematicStructure, values: Mapping[str, float], x0: FloatArray
) -> FlightRecord:
    """Return the record with inputs corrected and outputs as the kinematics rebuild them, of kind "measured" still.

    Args:
        record: as measured.
        s: the same, as the search saw it.
        structure: the kinematics.
        values: errors by name.
        x0: initial state (n,).
    """
    driving = {f"{n}_{kind}" for n in structure.inputs for kind in ("bias", "scale")}
    driving |= {"wind_north", "wind_east", "wind_down"}
    p = parameters(structure, {n: v for n, v in values.items() if n in driving})
    held = np.zeros(len(structure.inputs), bool)
    y = respond(structure, p, (), s.u, Sampling(record.dt_s, held), x0).y
    true = structure.at_cg(s.u, p)
    columns = {n: true[:, i] for i, n in enumerate(structure.inputs) if n in record}
    columns |= {n: y[:, i] for i, n in enumerate(structure.outputs)}
    if "psi" in columns:
        columns["psi"] = np.mod(columns["psi"], 2.0 * np.pi)
    out = record.with_columns(columns)
    rebuilt = np.array([n in structure.outputs for n in out.channels])
    note = {"kinematics": structure.motion, "errors": dict(values), "outputs": list(structure.outputs)}
    return replace(out, valid=out.valid | rebuilt, provenance={**record.provenance, "reconstructed": note})
