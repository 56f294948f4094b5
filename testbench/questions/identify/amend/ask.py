"""Write identified derivatives into the user's aircraft, look whether it has them, and fly the records through both."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.blas import on_one_thread
from testbench.core.errors import EstimationError, Refusal, ScenarioError
from testbench.core.escape import markdown_cell, markdown_table
from testbench.core.words import with_error
from testbench.estimators.identification import estimator_name
from testbench.estimators.parametric.model import ParametricModel
from testbench.flight import FlightCondition, TrimmedFlight, load_aircraft, trim
from testbench.line import Report
from testbench.questions.identify.amend.choose import aims_of, chosen_case, servo_aims
from testbench.questions.identify.amend.conditions import Told, together
from testbench.questions.identify.amend.folder import (
    SOURCES,
    aircraft_files,
    base_texts,
    folder_of,
    write_folder,
)
from testbench.questions.identify.amend.reach import (
    REACHED_BY,
    coefficient_errors,
    derivatives_of,
    reached,
    with_lag,
)
from testbench.questions.identify.amend.replay import replays
from testbench.questions.identify.amend.result import Aim, Amended, Coefficient, Replay, ServoAim
from testbench.questions.identify.ask import without
from testbench.questions.identify.before import Before, servos_of
from testbench.questions.identify.instruments import agreement_in_words
from testbench.questions.identify.result import Identified
from testbench.questions.identify.scenario import RecordDescription

_FAR = 0.01
"""Distance from an aim, relative to it, from which it is said; judged."""


@dataclass(frozen=True, eq=False)
class _Part:
    """What one identification gives to the aircraft."""

    found: Identified
    known: Before
    index: int
    rule: str
    aims: tuple[Aim, ...]
    servos: tuple[ServoAim, ...]
    notes: tuple[str, ...]
    doubts: tuple[str, ...]
    others: tuple[tuple[Identified, int], ...]

    @property
    def condition(self) -> FlightCondition:
        return self.known.condition

    @property
    def label(self) -> str:
        """The model, in words."""
        case = self.found.cases[self.index]
        return f"{estimator_name(case.estimator)}, structure {self.structure}"

    @property
    def structure(self) -> str:
        model = self.found.cases[self.index].model
        assert isinstance(model, ParametricModel)
        return model.structure.meaning


@on_one_thread
def amend(found: Sequence[Identified], name: str, progress: Report | None = None) -> dict[str, Amended]:
    """Write the derivatives that were identified into a new aircraft.

    Args:
        found: identifications with one and the same aircraft, such as that of the longitudinal and of the lateral
            motion of one log.
        name: of the new aircraft, which goes to ``aircraft/NAME``, or a path.
        progress: called with a few words as each stage begins.

    Returns:
        Name of the identification -> its part; those that gave nothing are left out, and said in the notes.

    Raises:
        ScenarioError: an identification has no aircraft, or they have several.
        EstimationError: kinematics contradict an instrument, no derivative is to be believed, or none is one that an
            aircraft has.
        WriteError: the folder has an aircraft that the testbench did not write, or cannot be written to.
        TrimError, ModelError: the aircraft cannot be trimmed there, or cannot take what is to be written.

    Example:
        >>> import testbench as tb
        >>> found = tb.identify(tb.load_description("flight/flight_longitudinal.toml"))  # doctest: +SKIP
        >>> tb.amend([found], "mine")[found.name].written  # doctest: +SKIP
    """
    say = progress or (lambda text: None)
    named = check_aircraft(found)
    folder = folder_of(name, named)
    for each in found:
        check_instruments(each)
    parts, refused = _parts(found)
    base = parts[0].known.aircraft
    new, coefficients = base, dict[str, float]()
    say("reach the derivatives")
    for part in parts:
        targets = {a.name: a.aimed for a in part.aims if a.aimed is not None}
        new, added = reached(new, part.condition, part.structure, targets)
        for key, value in added.items():
            coefficients[key] = coefficients.get(key, 0.0) + value
        for servo in part.servos:
            new = with_lag(new, servo.control, servo.lag_s)
    text, sources = base_texts(named)
    lags = {s.control: s.lag_s for p in parts for s in p.servos} if base.adapter is not None else {}
    files = aircraft_files(
        new, folder.name, text, f"derivatives of {', '.join(p.found.name for p in parts)}", "", lags,
        _deviations(parts, new),
    )  # fmt: skip
    say("load and linearise the amended aircraft")
    with tempfile.TemporaryDirectory() as place:
        write_folder(files, Path(place) / folder.name)
        loaded = load_aircraft(Path(place) / folder.name)
    parts = [_with_reached(p, loaded) for p in parts]
    changed = tuple(
        Coefficient(key, value, _number(base, key), _number(loaded, key)) for key, value in coefficients.items()
    )
    origin = _origin(folder.name, base, parts, changed, sources)
    write_folder({**files, SOURCES: origin}, folder)
    out = {}
    for part in parts:
        say(f"fly the records of {part.found.name} through both")
        own = {a.name.partition("_")[2] for a in part.aims if a.aimed is not None}
        out[part.found.name] = Amended(
            folder.name,
            folder,
            base,
            loaded,
            part.label,
            part.rule,
            part.condition.V_m_s,
            part.condition.h_m,
            part.aims,
            part.servos,
            tuple(c for c in changed if c.name.partition("_")[2] in own),
            tuple(_flown(part, base, loaded)),
            part.notes,
            (*part.doubts, *refused),
        )
    return out


def _flown(part: _Part, old: Aircraft, new: Aircraft) -> Iterator[Replay]:
    """Yield the records of all conditions that a part speaks for, through both aircraft."""
    outputs = part.found.cases[part.index].model.outputs
    for found, index in ((part.found, part.index), *part.others):
        case = found.cases[index]
        if case.model.outputs == outputs and found.before is not None:
            yield from replays(case, _names(found), old, new, found.before.condition)


def check_aircraft(found: Sequence[Identified]) -> str:
    """Return the aircraft that all identifications name, as it is resolved.

    Raises:
        ScenarioError: one names none, or they name several.
        EstimationError: it has no trim at the condition of the records.
    """
    named = [f.source.aircraft for f in found]
    for f, name in zip(found, named, strict=True):
        if name is None:
            raise ScenarioError([no_aircraft(f.name)])
    if len(set(named)) > 1:
        raise ScenarioError([f"one aircraft is amended at a time, got {', '.join(sorted(set(map(str, named))))}"])
    for f in found:
        if f.before is not None and not f.before.derivatives:
            raise EstimationError(f"an aircraft is amended where it flies, but {f.before.notes[-1]}")
    return str(named[0])


def check_instruments(found: Identified) -> None:
    """Refuse derivatives from an instrument that kinematics contradict.

    Raises:
        EstimationError: names the instrument, its error, and how to take it out of the records.
    """
    if found.instruments is None or not found.contradicted:
        return
    assert isinstance(found.source, RecordDescription)
    fault, where = found.instruments.fault, found.source.file
    if fault is None:
        raise EstimationError(
            f"an aircraft is amended by instruments that agree, but of {found.name} "
            f"{agreement_in_words(found.instruments)[0]}; mend the instruments, or leave the channel out of the outputs"
        )
    size = without(found.source, fault).correct[fault.name]
    raise EstimationError(
        f"an aircraft is amended by instruments that agree, but of {found.name} "
        f"{agreement_in_words(found.instruments)[0]}; mend the instrument, or put this into {where} before its first "
        f"table, which takes the error out of the records: correct = {{ {fault.name} = {size:.4g} }}"
    )


def no_aircraft(name: str) -> str:
    """Return what is said where there is nothing to amend."""
    return f'an aircraft is amended, but {name} names none: give --aircraft, or aircraft = "..." in the description'


def _parts(found: Sequence[Identified]) -> tuple[list[_Part], list[str]]:
    """Return what each identification gives, and why others give nothing.

    Raises:
        EstimationError: none gives anything.
    """
    parts: list[_Part] = []
    errors: list[EstimationError] = []
    told, rules = [], dict[str, str]()
    for f in found:
        try:
            index, rules[f.name] = chosen_case(f)
        except EstimationError as error:
            errors.append(error)
            continue
        told.append(Told(f, index))
    for f, index, doubts, others in together(told):
        assert f.before is not None
        try:
            aims, contradicted = aims_of(f, index)
            servos, left = servo_aims(f, index)
        except EstimationError as error:
            errors.append(error)
            continue
        parts.append(_Part(f, f.before, index, rules[f.name], aims, servos, left, (*doubts, *contradicted), others))
    if not parts:
        raise errors[0]
    return parts, [f"nothing of another motion is written: {e.message}" for e in errors]


def _with_reached(part: _Part, loaded: Aircraft) -> _Part:
    """Return a part with what the aircraft has, and what is said of what is far from its aim and of the equilibrium."""
    trimmed = trim(loaded, part.condition)
    has = derivatives_of(loaded, trimmed, part.structure)
    aims = tuple(replace(a, reached=has[a.name]) for a in part.aims)
    own = servos_of(loaded, [f"{s.control}_cmd" for s in part.servos])
    lags = {n.removesuffix("_cmd"): s.lag_s for n, s in own.items()}
    servos = tuple(replace(s, reached_s=_float(lags.get(s.control))) for s in part.servos)
    far = [
        f"{a.name} is {a.reached:.4g}, not {a.aimed:.4g}: increments of coefficients by the linearised model do not "
        "reach it; the aerodynamics of the model bends about this trim"
        for a in aims
        if a.off is not None
        and a.off > _FAR
        and a.aimed is not None
        and abs((a.reached or 0.0) - a.aimed) > 0.1 * a.std
    ]
    notes = (*part.notes, _trim_note(part, trimmed))
    return replace(part, aims=aims, servos=servos, notes=notes, doubts=(*part.doubts, *far))


def _float(value: object) -> float | None:
    return value if isinstance(value, float) else None


def _names(found: Identified) -> list[tuple[str, str]]:
    """Return name and use of the records of a case: those to identify on, then those to judge on."""
    split = [f.name for f in found.flights if f.use == "split"]
    fit = [f.name for f in found.flights if f.use == "identification"]
    judge = [f.name for f in found.flights if f.use == "validation"]
    return [*((n, "identification") for n in (*fit, *split)), *((n, "validation") for n in (*judge, *split))]


def _trim_note(part: _Part, trimmed: TrimmedFlight) -> str:
    """Say that the equilibrium is left as it was, beside what was recorded of it."""
    records = part.found.cases[part.index].identification
    said = []
    for name in ("alpha", "de"):
        values = [
            float(r.provenance["prepared"]["removed"][name])
            for r in records
            if name in r and name in r.provenance.get("prepared", {}).get("removed", {})
        ]
        if values and name in trimmed.state:
            degrees = np.degrees([float(np.mean(values)), float(trimmed.state[name])])
            said.append(f"{name} {degrees[0]:.1f} deg in the records and {degrees[1]:.1f} deg in the aircraft")
    beside = f": {', '.join(said)}" if said else ""
    return (
        f"the equilibrium at {part.condition.V_m_s:.4g} m/s stays what it was, since derivatives say nothing of it"
        f"{beside}"
    )


def _number(aircraft: Aircraft, name: str) -> float | None:
    try:
        return aircraft.coefficient(name)
    except Refusal:
        return None


def _deviations(parts: Sequence[_Part], new: Aircraft) -> dict[str, float]:
    """Return coefficient -> relative standard deviation of those that are stated and that the flight told."""
    out = {}
    for part in parts:
        errors = coefficient_errors(new, part.condition, part.structure)
        for a in part.aims:
            key = REACHED_BY.get((a.name[0], a.name[2:]), "")
            value = _number(new, key) if key in new.uncertainty else None
            if a.aimed is not None and value:
                out[key] = max(a.std * errors[a.name] / abs(value), 1e-6)
    return out


def _origin(
    name: str,
    base: Aircraft,
    parts: Sequence[_Part],
    changed: Sequence[Coefficient],
    sources: str,
) -> str:
    """Return SOURCES.md: what changed, by which flight, and what the sources of the aircraft before say."""
    lines = [
        f"# {markdown_cell(name)}: sources",
        "",
        f"{base.name}, amended by derivatives that were identified from recorded flights. Where it differs from "
        f"{base.name} is in the tables; all else is {base.name}'s.",
    ]
    for part in parts:
        files = dict.fromkeys(
            (str(r.provenance.get("file", "?")), str(r.provenance.get("sha256", "?")))
            for f in part.found.flights
            for r in f.measured.values()
        )
        lines += [
            "",
            f"## {markdown_cell(f'{part.found.name}: {part.found.title}')}",
            "",
            f"Model: {part.label}. Condition: {part.condition}. Records:",
            "",
            *(f"- {markdown_cell(file)}, SHA-256 {digest}" for file, digest in files),
            "",
            *markdown_table(
                ("derivative", "before", "identified", "written", "reached", "unit", "remark"),
                [
                    (
                        a.name, f"{a.before:.5g}", with_error(a.identified, a.std),
                        "left" if a.aimed is None else f"{a.aimed:.5g}",
                        "" if a.reached is None else f"{a.reached:.5g}", a.unit, a.why,
                    )
                    for a in part.aims
                ],
            ),
        ]  # fmt: skip
        if part.servos:
            lines += ["", *(f"- servo of {s.control}: a lag of {s.lag_s:.4g} s" for s in part.servos)]
        lines += ["", *(f"- {markdown_cell(text)}" for text in (*part.doubts, *part.notes))]
    lines += [
        "",
        "## Coefficients",
        "",
        "Per rad, or per p b/2V, q c/2V, r b/2V; what is added vanishes at the trim of the condition above.",
        "",
        *markdown_table(
            ("coefficient", "before", "after", "added"),
            [
                (c.name, *("" if v is None else f"{v:.6g}" for v in (c.before, c.after)), f"{c.added:.6g}")
                for c in changed
            ],
        ),
    ]
    if sources:
        lines += ["", f"# {base.name}: sources, as they were", "", re.sub(r"^#", "##", sources, flags=re.MULTILINE)]
    return "\n".join(lines).rstrip() + "\n"
