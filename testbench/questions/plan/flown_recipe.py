"""How the runs of a card are identified: as its design says, else as the channels that were logged allow.

The estimator of a design comes from the file that the card names: structure, servos, held inputs and free offsets. It
is fitted to the log: a command stands for a deflection that was not logged, and outputs that are not there are left
out.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from testbench.core.constants import DEG_RAD
from testbench.core.door import read_toml
from testbench.core.errors import RecordError, located
from testbench.core.record import FlightRecord
from testbench.estimators.structured import Servo
from testbench.page.words import listed
from testbench.questions.identify.derivatives import servos_of
from testbench.questions.importing.recipe import measured_in, propose
from testbench.questions.plan.close import command_of
from testbench.questions.plan.result import Card, Plan

_BY_INPUT = ("servo", "delays_s", "late_std_s")  # settings of an estimator that stand under the name of an input
_INPUTS = ("inputs", "held", "input_biases")  # and those that list inputs
_OUTPUTS = ("output_biases", "output_trends")


@dataclass(frozen=True, eq=False)
class FlownRecipe:
    """What is identified from the runs of a card, and with what."""

    identification: Mapping[str, Any]  # the table ``identification`` of a description
    servo: Mapping[str, Any]  # the table ``servo`` of it: what is not known of servos
    channels: tuple[str, ...]  # of the records that it needs
    design: Path | None  # file of the design whose estimator it is; None if the channels decided
    missing: tuple[str, ...] = ()  # outputs that the design identifies from and the log does not hold
    notes: tuple[str, ...] = ()  # what was chosen or left out, in sentences


def design_file(plan: Plan, card: Card) -> Path | None:
    """Return the file of the design that a card names, from the working directory or from that of the plan up."""
    name = card.spec.design
    if name is None:
        return None
    near = plan.scenario.file
    folders = [Path(), *(near.resolve().parents if near is not None else ())]
    return next((path for folder in folders if (path := folder / name).is_file()), None)


def recipe_of(plan: Plan, card: Card, records: Sequence[FlightRecord]) -> FlownRecipe:
    """Return how the runs of a card are identified.

    Raises:
        RecordError: the logs hold nothing that a structure with derivatives could be identified from, or the design
            cannot be read.
    """
    measured = measured_in(records)
    design, notes = design_file(plan, card), []
    if design is not None:
        try:
            found = _designed(plan, card, design, measured)
        except (KeyError, TypeError, AttributeError) as error:
            raise RecordError(
                f"the table identification of '{design}', the design of card {card.number}, must be as `testbench "
                f"design` writes it, got {type(error).__name__}: {error}"
            ) from error
        if found is not None:
            return found
        notes.append(
            f"{design.name} names no estimator with a structure: the estimator follows from the logged channels"
        )
    elif card.spec.design is not None:
        notes.append(f"the design {card.spec.design} was not found: the estimator follows from the logged channels")
    return _proposed(plan, card, records, measured, tuple(notes))


def _designed(plan: Plan, card: Card, design: Path, measured: Sequence[str]) -> FlownRecipe | None:
    with located(f"card {card.number}", "design"):
        asked: dict[str, Any] = read_toml(design).get("identification", {})
    entry = next((e for e in asked.get("estimators", []) if "structure" in e), None)
    if entry is None:
        return None
    structures: dict[str, Any] = asked.get("structures", {})
    notes, renamed = [], {}
    for name in asked["inputs"]:
        control = name.removesuffix("_cmd")
        other = control if name.endswith("_cmd") else f"{control}_cmd"
        if name not in measured and other in measured:
            renamed[name] = other
            by = (
                "the deflection itself"
                if other == control
                else f"its command, through the servo of {plan.aircraft.name}"
            )
            notes.append(f"{name} was not logged: {by} drives the model")
    inputs = [renamed.get(n, n) for n in asked["inputs"]]
    wanted = list(
        entry.get("outputs") or asked.get("outputs") or structures.get(entry["structure"], {}).get("outputs", ())
    )
    outputs = [n for n in wanted if n in measured]
    missing = tuple(n for n in wanted if n not in measured)
    if not outputs or any(n not in measured for n in inputs):
        lost = [*missing, *(n for n in inputs if n not in measured)]
        raise RecordError(f"the log must hold what the design identifies from, got no {listed(lost)}")
    if missing:
        notes.append(f"{listed(missing)} {'was' if len(missing) == 1 else 'were'} not logged: identified without")
    adapted = _adapted({**entry, "outputs": outputs}, renamed)
    named = (
        {entry["structure"]: _driven(structures[entry["structure"]], renamed)}
        if entry["structure"] in structures
        else {}
    )
    table = {"inputs": inputs, **({"structures": named} if named else {}), "estimators": [adapted]}
    along = [n for n in ("V", "h", "qbar") if n in measured]
    return FlownRecipe(table, {}, tuple(dict.fromkeys([*inputs, *outputs, *along])), design, missing, tuple(notes))


def _adapted(entry: Mapping[str, Any], renamed: Mapping[str, str]) -> dict[str, Any]:
    """Return an estimator with its inputs renamed, and without offsets of outputs that are not there.

    A deflection needs no servo.
    """
    out = dict(entry)
    for key in _INPUTS:
        if key in out:
            out[key] = [renamed.get(n, n) for n in out[key]]
    for key in _OUTPUTS:
        if key in out:
            out[key] = [n for n in out[key] if n in out["outputs"]]
    for key in _BY_INPUT:
        if key in out:
            out[key] = {n: v for n, v in out[key].items() if n not in renamed}
    return out


def _driven(equations: Mapping[str, Any], renamed: Mapping[str, str]) -> dict[str, Any]:
    """Return equations as text that are driven by other channels."""

    def turned(text: Any) -> Any:
        if not isinstance(text, str):
            return text
        for old, new in renamed.items():
            text = re.sub(rf"\b{old}\b", new, text)
        return text

    out = dict(equations)
    for part in ("equations", "outputs", "definitions", "initial"):
        if part in out:
            out[part] = {name: turned(text) for name, text in out[part].items()}
    if "inputs" in out:
        out["inputs"] = [renamed.get(n, n) for n in out["inputs"]]
    return out


def _never_limited(card: Card, name: str, servo: Servo) -> bool:
    """Return whether a servo with a rate limit never meets it on a card: it is linear then.

    A lag moves the surface at (command - surface) / lag, and the two differ by at most the span of the command.
    """
    if servo.rate_limit_deg_s is None or not isinstance(servo.lag_s, float):
        return False
    u = card.signal.columns([name.removesuffix("_cmd")])
    return float(np.ptp(np.append(u, 0.0))) / servo.lag_s < servo.rate_limit_deg_s * DEG_RAD


def _proposed(
    plan: Plan, card: Card, records: Sequence[FlightRecord], measured: Sequence[str], notes: tuple[str, ...]
) -> FlownRecipe:
    commands = [command_of(records[0], control) for control in card.spec.controls]
    inputs = [c if c in measured else n for c, n in zip(card.spec.controls, commands, strict=True) if n is not None]
    recipe = propose(inputs, records, 1.0 / records[0].dt_s)
    entries = [] if recipe is None else [(said, entry) for said, entry in recipe.estimators if "structure" in entry]
    if recipe is None or not entries:
        need = {"longitudinal": "q, with alpha or with az and V", "lateral": "p, r and V"}[card.spec.plane]
        raise RecordError(
            f"derivatives of the {card.spec.plane} motion need {need} in the log, got "
            f"{listed([n for n in measured if n not in inputs])}"
        )
    said, entry = entries[0]
    known = servos_of(plan.aircraft, inputs)
    servo: dict[str, Any] = {name: {"lag_s": "estimate"} for name in recipe.servos if name not in known}
    servo |= {name: {"lag_s": s.lag_s} for name, s in known.items() if _never_limited(card, name, s)}
    table = {"inputs": inputs, "outputs": list(recipe.outputs), "estimators": [dict(entry)]}
    along = [n for n in ("V", "h", "qbar") if n in measured]
    channels = tuple(dict.fromkeys([*inputs, *recipe.outputs, *along]))
    return FlownRecipe(table, servo, channels, None, (), (*notes, *said))
