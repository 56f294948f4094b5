"""The recipe that a record's channels allow: a structure for each axis that was moved, else a model without one.

One good default: output error, which starts from equation error where all states were measured. Equation error and
filter error take the same lines. A constant that trim removal made redundant is fixed: if a state is not measured, its
trim value is not known, and shifting it does what one of the constants does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from testbench.core.channels import channel
from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.core.escape import one_line, toml_value
from testbench.core.record import FlightRecord, FloatArray
from testbench.inference.form import FORM_STD
from testbench.inference.instruments import sound
from testbench.logs.manoeuvres import SMALLEST
from testbench.logs.noise import is_noise, noise_of
from testbench.page.words import counted

AXES = {"longitudinal": ("de", "thr"), "lateral": ("da", "dr")}
"""Axis -> controls that excite it."""
_FLOW = {"longitudinal": "alpha", "lateral": "beta"}
"""Axis -> the state in which gusts act."""
_SUBSPACE = {"longitudinal": ("alpha", "q", "theta", "az"), "lateral": ("beta", "p", "r", "phi")}
_MOST_OUTPUTS = 3
_ORDERS = {"longitudinal": 2, "lateral": 4}
"""Axis -> states that its motion has: the short period; roll, spiral and Dutch roll. Pitch angle is one more."""
LAG_S, LAG_STD_S = 0.05, 0.03
"""What is believed of a servo's lag before the flight; judged, from 0.06 to 0.2 s for 60 deg. Lag and
delay, and lag and damping, are hard to tell apart: without this belief M_q and M_de are not decided."""
LATE_STD_S = 0.05
"""How late, or early, a surface may be logged against what it moves: other clocks, filters, and steps of which a log
does not say when they were between two samples. It is estimated about zero."""
Z_Q_STD_PER_V = 0.1
"""What is believed of Z_q over speed about zero: -rho S cbar CL_q / (4 m) is -0.08 for small models."""
LIFT_PER_V_1_S = 30.0
"""-Z_alpha over speed is rho V S CL_alpha / (2 m): 1 for an airliner, 6 for a model of 2 kg; above this none flies."""
ALPHA_RAD, ALPHA_STD_RAD = 0.05, 0.05
"""What is believed of the trimmed angle of attack where nothing tells it: 3 +- 3 deg; judged."""
Y_R_STD, Y_DR_STD_1_S = 0.02, 0.2
"""What is believed of Y_r and Y_dr over speed about zero: rho S b CY_r / (4 m) is 0.02 for small models, and
rho V S CY_dr / (2 m) is 0.3 for them and 0.03 for a light aeroplane; judged."""
ROLL_1_S = 60.0
"""-L_p is -rho V S b^2 Cl_p / (4 Ixx): 1 for an airliner, 10 to 30 for small models; above this none rolls; judged."""
WITHOUT_STRUCTURE = "no structure"
"""Begins what is said of a recipe whose model has no derivatives."""
_TURNED = (("q", "theta"), ("p", "phi"))
"""Rates and the angles that they turn, which tell what is left of the zero of the gyro: a manoeuvre that begins while
the one before dies away has no rest that it could be taken from."""
_SPEED_ERROR = 0.03  # of a measured airspeed
_STILL = {"V": 0.01}  # share of its size that a channel must move by, to be worth equations of its own


@dataclass(frozen=True)
class Recipe:
    """What to identify, and with what."""

    outputs: tuple[str, ...]  # channels
    # entries of ``[[identification.estimators]]``, with remarks
    estimators: tuple[tuple[tuple[str, ...], Mapping[str, Any]], ...]
    servos: tuple[str, ...] = ()  # commands before which a servo lies
    left_out: tuple[str, ...] = ()  # measured channels that nothing uses
    # whether the delays of servos are estimated, and their lags believed: where no vane was flown, as on autopilots.
    # With a flow angle measured the lag alone tells the rest.
    delays: bool = False
    # how far sound instruments of inputs and outputs may err, CHANNEL_KIND -> standard deviation
    instrument_std: Mapping[str, float] = field(default_factory=dict)


def propose(
    inputs: Sequence[str],
    records: Sequence[FlightRecord],
    rate_hz: float,
    imu_m: tuple[float, float, float] | None = None,
    fed_back: bool = False,
) -> Recipe | None:
    """Return the recipe for records of these inputs; None if nothing was measured that could be an output.

    Args:
        inputs: channels of the controls that were moved.
        records: of the manoeuvres; channels that hold samples in all of them were measured.
        rate_hz: of the records.
        imu_m: where the accelerometer sits from the centre of gravity, forward, right, down; None if not known.
        fed_back: whether the controls react to the motion: then output error is biased by gusts, filter error is not.
    """
    measured = measured_in(records)
    moving = [n for n in measured if any(_moves(r, n) for r in records)]
    outputs: list[str] = []
    estimators: list[tuple[tuple[str, ...], Mapping[str, Any]]] = []
    moved = {axis: [n for n in inputs if n.removesuffix("_cmd") in own] for axis, own in AXES.items()}
    vane = bool({"alpha", "beta"} & set(measured))
    speed = _speed(records) if "V" in measured else None
    several = sum(bool(names) for names in moved.values()) > 1
    for axis, make in (("longitudinal", _longitudinal), ("lateral", _lateral)):
        found = make(moving, speed, bool(_commanded(moved[axis]))) if moved[axis] else None
        if found is not None:
            remarks, own, settings = found
            settings = _of_inputs(settings, moved[axis])
            outputs += own
            if imu_m is not None and any("accelerometer_m" in text for text in remarks):
                remarks = tuple(t for t in remarks if "accelerometer_m" not in t)
                remarks = (*remarks, "the position of the accelerometer is that of the autopilot's settings")
                settings = {**settings, "accelerometer_m": [imu_m[0], imu_m[2]]}
            lags = [f"tau_{n.removesuffix('_cmd')}" for n in moved[axis] if n in _commanded(inputs)]
            lags = [] if vane else lags
            start = {**settings.get("start", {}), **dict.fromkeys(lags, LAG_S)}
            spread = {**settings.get("prior_std", {}), **dict.fromkeys(lags, LAG_STD_S)}
            if settings.get("short") and "alpha" not in measured:
                start["Z_q"], spread["Z_q"] = 0.0, float(f"{Z_Q_STD_PER_V * _speed(records):.2g}")
                remarks = (
                    *remarks,
                    "without alpha Z_q and Z_alpha are hard to separate: Z_q has a small prior, and Z_alpha",
                    "is below 0, as lift rises with alpha below the stall",
                )
                settings = {**settings, "bounds": {"Z_alpha": [float(f"{-LIFT_PER_V_1_S * _speed(records):.2g}"), 0.0]}}
            if spread:
                settings = {**settings, "start": start, "prior_std": spread}
            late = {n: LATE_STD_S for n in moved[axis] if n not in _commanded(inputs)}
            settings = {**settings, **({"late_std_s": late} if late else {})}
            bound = [rate for rate, angle in _TURNED if rate in own and angle in own]
            settings = {**settings, **({"output_biases": bound} if bound else {})}
            apart = {"inputs": moved[axis], "label": axis} if several else {}
            how: dict[str, Any] = {"method": "output_error"}
            if fed_back:
                how = {"method": "filter_error", "process_noise": [_FLOW[axis]]}
                remarks = (
                    *remarks,
                    "controls respond to the motion (closed loop): gusts, to which they respond, are estimated",
                )
            estimators.append((remarks, {**how, **settings, **apart}))
    if not estimators:
        for axis, names in _SUBSPACE.items():
            outputs += [n for n in names if n in moving][:_MOST_OUTPUTS] if moved[axis] else []
        if not outputs:
            return None
        horizon = int(np.clip(round(0.2 * rate_hz), 5, 20))
        remarks = (
            WITHOUT_STRUCTURE + ": its axis needs q with alpha, or with az and V; or p and r: a model without",
            "derivatives. Frequency responses with coherence and random error: testbench response THIS_FILE",
        )
        own_orders = [n + ("theta" in outputs) * (axis == "longitudinal") for axis, n in _ORDERS.items() if moved[axis]]
        order = max(sum(own_orders), len(outputs))
        estimators.append(
            (remarks, {"method": "dsr_e", "order": order, "past_horizon": horizon, "future_horizon": horizon})
        )
        return Recipe(tuple(outputs), tuple(estimators), (), _left(measured, inputs, outputs))
    left, used = _left(measured, inputs, outputs), dict.fromkeys([*inputs, *outputs])
    stds = {name: std for channel in used for name, std in sound(channel, 1.0 / rate_hz).items()}
    return Recipe(tuple(outputs), tuple(estimators), _commanded(inputs), left, not vane, stds)


def _moves(record: FlightRecord, name: str) -> bool:
    """Say whether a channel moves by more than a small share of its size, and is more than noise."""
    x = _taken(record, name)
    at = record.t_s[record.valid[:, record.channels.index(name)]]
    return bool(np.ptp(x) > _STILL.get(name, 0.0) * _size(record, name)) and not is_noise(x, noise_of(at, x))


def measured_in(records: Sequence[FlightRecord]) -> list[str]:
    """Return the channels that hold samples in every record."""
    return [n for n in records[0].channels if all(n in r and _taken(r, n).size for r in records)]


def _commanded(inputs: Sequence[str]) -> tuple[str, ...]:
    """Return the commands before which a servo lies."""
    return tuple(n for n in inputs if n.endswith("_cmd") and n != "thr_cmd")


def _taken(record: FlightRecord, name: str) -> FloatArray:
    return record[name][record.valid[:, record.channels.index(name)]]


def _speed(records: Sequence[FlightRecord]) -> float:
    return float(np.mean([np.mean(np.abs(_taken(record, "V"))) for record in records]))


def _size(record: FlightRecord, name: str) -> float:
    return abs(float(np.mean(_taken(record, name))))


def _left(measured: Sequence[str], inputs: Sequence[str], outputs: Sequence[str]) -> tuple[str, ...]:
    return tuple(n for n in measured if n not in (*inputs, *outputs))


_BIASES = (
    "gusts and the gyro's offset falsify trim values: every record has separate constants in place of those of trim"
)
_Found = tuple[tuple[str, ...], list[str], dict[str, Any]]


def _of_inputs(settings: Mapping[str, Any], inputs: Sequence[str]) -> dict[str, Any]:
    """Return settings without parameters of controls that were not moved, as the structure has none."""
    still = {c for axis in AXES.values() for c in axis} - {name.removesuffix("_cmd") for name in inputs}

    def has(name: str) -> bool:
        return name.partition("_")[2] not in still

    out = dict(settings)
    for key in ("start", "prior_std"):
        out |= {key: {n: x for n, x in settings[key].items() if has(n)}} if key in settings else {}
    if "fixed" in settings:
        out["fixed"] = [n for n in settings["fixed"] if has(n)]
    return out


def _longitudinal(measured: Sequence[str], speed: float | None, autopilot: bool) -> _Found | None:
    if "q" not in measured:
        return None
    has_alpha = "alpha" in measured
    whole = has_alpha and {"V", "theta"} <= set(measured)
    force = [] if has_alpha or "az" not in measured else ["az"]
    biases: list[str] = []
    if not has_alpha and not (speed and force):
        return None  # of q alone what alpha does shows too weakly to begin from nothing
    remarks, fixed = [], []
    if whole:
        outputs = ["V", "alpha", "q", "theta"]
        settings: dict[str, Any] = {"structure": "longitudinal"}
    elif speed:
        outputs = [n for n in ("alpha", "q", *force) if n in measured]
        settings = {"structure": "longitudinal", "short": True}
        missing = ", ".join(n for n in ("V", "alpha", "theta") if n not in measured)
        remarks.append(f"not measured, or did not move: {missing}; so alpha and q at constant speed")
    else:
        outputs = [n for n in ("alpha", "q") if n in measured]
        settings = {"structure": "short_period"}
        remarks.append("V was not measured: alpha and q at constant speed, Z derivatives per speed")
    if not has_alpha:
        fixed.append("Z_0")
        if autopilot and not whole and force:
            biases = outputs
            fixed.append("M_0")
            remarks.append(_BIASES)
        else:
            remarks.append("alpha was not measured: its trim value has the same influence as Z_0, so Z_0 stays zero")
        remarks.append("az is assumed at the centre of gravity: give accelerometer_m if it is not")
    return tuple(remarks), outputs, {**settings, **_constants(fixed, biases)}


def _constants(fixed: Sequence[str], biases: Sequence[str]) -> dict[str, list[str]]:
    """Return the settings for constants that stay zero, and outputs with a constant of their own in every record."""
    found = {"fixed": list(fixed), "output_biases": list(biases)}
    return {key: names for key, names in found.items() if names}


def _lateral(measured: Sequence[str], speed: float | None, autopilot: bool) -> _Found | None:
    if not {"p", "r"} <= set(measured):
        return None
    if not speed or not {"beta", "ay"} & set(measured):
        return _lateral_per_speed(measured, speed, autopilot)
    has_beta, has_phi = "beta" in measured, "phi" in measured
    force = [] if has_beta or "ay" not in measured else ["ay"]
    outputs = [n for n in ("beta", "p", "r", "phi", *force) if n in measured]
    remarks, fixed = [], []
    if autopilot and force:
        outputs = ["p", "r", *force]
        remarks += [
            "phi is not fitted: an autopilot integrates it from the gyro of p, with a lag and a slow drift",
            _BIASES,
            "ay is assumed at the centre of gravity: give accelerometer_m if it is not",
        ]
        return (
            tuple(remarks),
            outputs,
            {"structure": "lateral_directional", **_constants(["Y_0", "L_0", "N_0"], outputs)},
        )
    if not has_phi:
        remarks.append("phi was not measured: its trim value has the same influence as Y_0, so Y_0 stays zero")
        fixed.append("Y_0")
    if not has_beta:
        fixed.append("Y_0" if has_phi else "L_0")
        remarks.append(
            f"beta was not measured: its trim value has the same influence as {fixed[-1]}, so that stays zero"
        )
        remarks.append("ay is assumed at the centre of gravity: give accelerometer_m if it is not")
    return tuple(remarks), outputs, {"structure": "lateral_directional", **_constants(fixed, [])}


def _lateral_per_speed(measured: Sequence[str], speed: float | None, autopilot: bool) -> _Found:
    """Return what there is to identify of hidden sideslip, or of an airspeed that is not known."""
    has_beta, has_phi = "beta" in measured, "phi" in measured
    outputs = [n for n in ("beta", "p", "r", "phi") if n in measured]
    remarks, fixed = [], []
    start, spread = {}, {}
    if speed is None:
        remarks.append("V was not measured: Y derivatives per speed, and gravity over speed, g_V, is estimated")
    else:
        start["g_V"] = float(f"{G0_M_S2 / speed:.3g}")
        spread["g_V"] = float(f"{_SPEED_ERROR * start['g_V']:.1g}")
        remarks.append("Y derivatives per speed; g_V, gravity over speed, follows from V")
    if not has_phi:
        remarks.append(
            "phi was not measured: its trim value has the same influence as Y_0: Y_0 and theta_trim stay zero"
        )
        fixed += ["Y_0", "theta_trim"]
    if not has_beta:
        remarks += [
            (
                "beta was not measured: the influence of its trim value stays zero, and angle of attack, Y_r and "
                "Y_dr, which"
            ),
            (
                "p, r and phi do not separate from the others, have usual values as priors: give start and prior_std "
                "if known"
            ),
        ]
        fixed = list(dict.fromkeys([*fixed, "Y_0" if has_phi else "L_0"]))
        start |= {"alpha_trim": ALPHA_RAD, "Y_r": 0.0, "Y_dr": 0.0}
        spread |= {"alpha_trim": ALPHA_STD_RAD, "Y_r": Y_R_STD, "Y_dr": Y_DR_STD_1_S}
    settings: dict[str, Any] = {"start": start, "prior_std": spread} if spread else {}
    if autopilot:
        remarks.append("roll damping and a servo's lag are interchangeable: L_p has the prior of a wing")
        settings["bounds"] = {"L_p": [-ROLL_1_S, 0.0]}
    return tuple(remarks), outputs, {"structure": "lateral_per_speed", **_constants(fixed, []), **settings}


def lines(recipe: Recipe, inputs: Sequence[str]) -> list[str]:
    """Return the tables ``[identification]``, ``[[identification.estimators]]`` and ``[servo.NAME]`` as TOML lines."""
    out = ["", "[identification]", f"inputs = {toml_value(list(inputs))}", f"outputs = {toml_value(recipe.outputs)}"]
    if recipe.left_out:
        out.append(f"# measured, but not used below: {one_line(', '.join(recipe.left_out))}")
    for remarks, entry in recipe.estimators:
        out += ["", *(f"# {one_line(text)}" for text in remarks), "[[identification.estimators]]"]
        out += [f"{key} = {toml_value(value)}" for key, value in entry.items()]
        if entry["method"] == "output_error":
            out.append('# in turbulence: method = "filter_error"; quick and without start values: "equation_error"')
    if recipe.instrument_std:
        out += [
            "",
            "# Standard errors of sound instruments, included in the errors of derivatives. Assumed: enter your own.",
        ]
        out += ["[instrument_std]", *(f"{name} = {std:.2g}" for name, std in recipe.instrument_std.items())]
    out += ["", "# Variation of derivatives over 0.1 rad of alpha and over the share of dynamic pressure. Assumed."]
    out += ["[form_std]", *(f"{name} = {std:.2g}" for name, std in FORM_STD.items())]
    for name in recipe.servos:
        out += [
            "",
            "# A command was logged, not the surface. Where you know its servo, give lag_s, delay_s and",
            "# rate_limit_deg_s as numbers: estimating them reduces the accuracy of the damping.",
            *(
                [f"# The prior of the lag is {LAG_S:g} +- {LAG_STD_S:g} s: start and prior_std above."]
                if recipe.delays
                else []
            ),
            f"[servo.{name}]",
            'lag_s = "estimate"',
            *(['delay_s = "estimate"'] if recipe.delays else []),
        ]
    return out


# --- whether records support a recipe ---------------------------------------------------------------------------------


FEWEST = 50
"""Samples below which a record decides nothing; judged: five for each of the ten unknowns of the smallest structure."""
UNBROKEN = 5
"""Samples in a row that a control must have somewhere; judged: with fewer it was logged too slowly for the record."""


def moving(records: Sequence[FlightRecord], controls: Sequence[str]) -> list[str]:
    """Return the controls that move by more than a dead band in some record."""
    return [n for n in controls if any(_range(r, n) >= SMALLEST[channel(n).unit] for r in records)]


def why_not(record: FlightRecord, controls: Sequence[str]) -> str:
    """Return why nothing can be identified from a record, or "" if something may.

    Args:
        record: on one clock.
        controls: of it.
    """
    if not moving([record], controls):
        said = ", ".join(f"{n} by {_shown(n, _range(record, n))}" for n in controls)
        return f"no control moves ({said})"
    if len(record) < FEWEST:
        return f"it holds {len(record)} samples, and a model needs {FEWEST} at least"
    slow = too_slow(record, controls)
    if slow:
        longest = min(_longest(record, name) for name in slow)
        have = "has" if len(slow) == 1 else "have"
        return (
            f"{', '.join(slow)} {have} at most {counted(longest, 'sample')} in a row at {1.0 / record.dt_s:.3g} Hz: "
            "logged more slowly than the record"
        )
    return ""


def too_slow(record: FlightRecord, controls: Sequence[str]) -> list[str]:
    """Return the controls that move and were logged too slowly for the record's rate."""
    return [name for name in moving([record], controls) if _longest(record, name) < UNBROKEN]


def too_few(records: Sequence[FlightRecord], recipe: Recipe, inputs: Sequence[str]) -> str:
    """Return why a recipe's model without a structure cannot be made of records, or "" if it can.

    Args:
        records: that the model is identified from: of one that is split, the first part.
        recipe: of them.
        inputs: of the model.
    """
    from testbench.estimators.subspace.dsr_e import shortage

    settings = next((entry for _, entry in recipe.estimators if entry["method"] == "dsr_e"), None)
    if settings is None:
        return ""
    good = [np.asarray(r.select([*inputs, *recipe.outputs]).valid.all(axis=1)) for r in records]
    L = settings["future_horizon"]
    short = shortage(good, len(inputs), len(recipe.outputs), settings["past_horizon"], L)
    if short is None:
        return ""
    return (
        f"a model of {', '.join(recipe.outputs)} without a structure takes {short[1]} stretches of samples that follow "
        f"each other, and {counted(short[0], 'stretch', 'stretches')} of {L} samples or more could be identified from; "
        "fly longer, or log faster"
    )


def _longest(record: FlightRecord, name: str) -> int:
    """Return the longest stretch of valid samples of a channel."""
    edges = np.flatnonzero(np.diff(np.r_[0, record.valid[:, record.channels.index(name)].astype(int), 0]))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


def _range(record: FlightRecord, name: str) -> float:
    values = record[name][record.valid[:, record.channels.index(name)]]
    return float(np.ptp(values)) if values.size else 0.0


def _shown(name: str, value: float) -> str:
    return f"{value / DEG_RAD:.2g} deg" if channel(name).unit == "rad" else f"{100.0 * value:.2g} %"
