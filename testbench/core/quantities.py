"""The table of quantities: what a key of a file measures, in which unit, and what it can physically be.

Ranges are wide, from an insect to an airliner and from a kite to a rocket: they refuse nonsense, not the unusual. A law
of one class of files that is tighter stands in that class. Every number of every schema has its row here, by the whole
key or by its end, which names the unit.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple


class Quantity(NamedTuple):
    """What a number of a file is: its unit ("1": none), and the least and the most that it can be."""

    unit: str
    low: float
    high: float


_ANY = 1e12
"""Bound of what can be anything: coefficients, drawn values of any key, properties of a model."""
_LONGEST_S = 36000.0
OF_ITS_CHANNEL = "of its channel"
_SEED = 2**63 - 1  # the largest whole number of TOML

_ROWS: dict[tuple[float, float, str], str] = {
    # by unit, at the end of the key
    (-1000.0, 1000.0, "m"): "m",
    (-500.0, 30000.0, "m"): "h_m heights_m lowest_m highest_m field_m release_m height_change_m",
    (0.0, 1e5, "m"): "length_m width_m height_m size_m",
    (1e-3, 1000.0, "m"): "chord_m span_m b_m cbar_m diameter_m pitch_m step_m length_unit_m",
    (-1e4, 1e4, "1/m"): "curvature_1_m",
    (1e-5, 1e4, "m2"): "S_m2",
    (-1000.0, 1000.0, "m/s"): "m_s",
    (0.1, 1000.0, "m/s"): "V_m_s V0_m_s speeds_m_s V_min_m_s V_max_m_s",
    (0.0, 100.0, "m/s"): "rms_m_s wind_m_s gust_m_s",
    (0.0, _LONGEST_S, "s"): "s",
    (1e-3, _LONGEST_S, "s"): "duration_s",
    (1e-5, _LONGEST_S, "s"): "step_s prbs_s gbn_s sweep_s period_s width_s",
    (0.0, 60.0, "s"): "lag_s delay_s delays_s jitter_s rise_s time_s",
    (-1e3, 1e3, "s"): "gain_s",
    (-1e5, 1e5, "s"): "clock_offset_s",
    (-1e15, 1e15, "s"): "zero_s segments",
    (0.0, 1e7, "s"): "flown_at_s drift_time_s limit_s",
    (0.0, 1e5, "ms"): "ms",
    (0.0, 1e4, "us"): "us",
    (1e-5, 20000.0, "Hz"): "hz rate_hz",
    (1e-6, 1e6, "rad/s"): "rad_s",
    (1e-3, 1e6, "deg/s"): "deg_s",
    (-360.0, 360.0, "deg"): "deg",
    (-1000.0, 1000.0, "rad"): "rad",
    (1e-9, 1e6, "kg"): "kg",
    (-1e6, 1e6, "kg"): "load_kg",
    (0.0, 1e6, "kg"): "tail_kg",
    (0.0, 1e5, "kg/m"): "kg_per_m",
    (1e-15, 1e9, "kg m2"): "kg_m2",
    (-1e9, 1e9, "kg m2"): "Ixz_kg_m2",
    (0.0, 1e9, "kg m2"): "roll_inertia_kg_m2",
    (1e-6, 20.0, "kg/m3"): "kg_m3",
    (0.01, 20.0, "kg/l"): "kg_l",
    (1e-9, 1e9, "1/(kg m)"): "S_cbar_over_Iyy_1_per_kg_m",
    (1e-6, 1e4, "m2/kg"): "S_m2_per_kg",
    (-1e6, 1e6, "rad/s2/N"): "rad_s2_per_N",
    (1e-6, 1e7, "N"): "N",
    (0.0, 1e9, "W"): "W",
    (1e-6, 1e9, "W h"): "Wh",
    (0.1, 500.0, "MJ/kg"): "MJ_kg",
    (-100.0, 100.0, "degC"): "degC",
    (0.0, 1e4, "%"): "percent accuracies",
    (-1e4, 1e4, "%"): "amplitude_percent",
    (-1e5, 1e5, "1e-6"): "ppm",
    (0.0, 1e9, "EUR"): "price_eur",
    (0.0, 1e9, "g"): "mass_g",
    (1e-6, 1e6, "1/min"): "per_min",
    (1e-3, 100.0, "1/rad"): "slope_1_rad",
    # without a unit
    (0, _SEED, "1"): "seed",
    (0, 100_000_000, "1"): "runs flights sealed block minimum skip_rows column minus_column",
    (0, 100_000, "1"): (
        "repeats bits bootstrap draws realise seeds first stride periods decimate future_horizon past_horizon "
        "max_iterations passes substeps starts mode switch_channel switch_option"
    ),
    (0, 1000, "1"): "order least_orders poles zeros accelerometers strain_gauges",
    (0.0, 10_000.0, "samples"): "delay_samples",
    (0.0, 10.0, "1"): "CD0 CD0_added zeta",
    (-100.0, 100.0, "1"): (
        "CL effectiveness alpha beta kappa static_cp static_cp_alpha static_cp_beta2 upwash cross_axis speed_ratio "
        "load_factor noise"
    ),
    (-1e4, 1e4, "1"): "scale",
    (-1e9, 1e9, "1"): "offset gain pattern powers weights share windows stabiliser drives limits half_width",
    (0.0, 1.0, "1"): (
        "centre_of_mass gyration chord_fraction elastic_axis downwash dropout span_from span_to switching "
        "section_thickness confidence level identification_fraction test train validation"
    ),
    (0.0, 1e9, OF_ITS_CHANNEL): "noise_std noise_density bias_walk drift_std quantum",
    (-1e9, 1e9, OF_ITS_CHANNEL): "bias bias_rate",
    (-100.0, 100.0, "its own"): "correct",
    (-_ANY, _ANY, "its own"): (
        "among bounds constants declare effect_eta effect_etadot errors fixed_process_noise force force_eta "
        "force_etadot force_rotary grid high initial initial_std low mean measurement_noise median parameter_drift "
        "parameters prior_std process_noise set sigma start std uncertainty value values"
    ),
}  # fmt: skip
QUANTITIES = {key: Quantity(unit, low, high) for (low, high, unit), keys in _ROWS.items() for key in keys.split()}
"""Key of a file, or the end of one -> what it measures."""

OF_CHANNELS = {
    "rad": 10.0, "rad/s": 1000.0, "rad/s2": 1e5, "m": 30000.0, "m/s": 1000.0, "m/s2": 1e4, "N": 1e7, "Pa": 1e6,
    "1": 1000.0, "1/s": 1e5, "1/s2": 1e8,
}  # fmt: skip
"""SI unit of a channel -> the most that its signal, and so its noise or bias, can be."""


@cache
def quantity(key: str) -> Quantity | None:
    """Return the row of a key: that of the whole key, else that of its longest end; None without one.

    Example:
        >>> quantity("design_V_m_s")
        Quantity(unit='m/s', low=0.1, high=1000.0)
    """
    words = key.split("_")
    return next((q for i in range(len(words)) if (q := QUANTITIES.get("_".join(words[i:])))), None)


def bound(schema: Any, of: Quantity) -> None:
    """Put the range of a quantity on every number of a pydantic core schema, in place; tighter laws of it stay."""
    if isinstance(schema, tuple):  # a choice of a union with its label
        schema = schema[0]
    if schema["type"] in ("float", "int"):
        number = float if schema["type"] == "float" else int
        if of.low > schema.get("gt", -float("inf")):
            schema.pop("gt", None)
            schema["ge"] = max(number(of.low), schema.get("ge", number(of.low)))
        if of.high < schema.get("lt", float("inf")):
            schema.pop("lt", None)
            schema["le"] = min(number(of.high), schema.get("le", number(of.high)))
    inner = [schema[part] for part in ("schema", "values_schema", "lax_schema", "strict_schema") if part in schema]
    if schema["type"] in ("tuple", "union"):
        inner += schema["items_schema" if schema["type"] == "tuple" else "choices"]
    if schema["type"] == "tagged-union":
        inner += schema["choices"].values()
    for part in inner:
        bound(part, of)
