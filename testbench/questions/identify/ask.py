"""Identify from recorded flights: read the records, run the estimators, judge the models."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from testbench.core.advice import doubt
from testbench.core.blas import on_one_thread
from testbench.core.errors import located
from testbench.core.named import Named, obtain
from testbench.estimators.cells import FailedCell
from testbench.flight import load_aircraft
from testbench.inference.instruments import agreement, taken_for_sure, without_errors
from testbench.line import RECORDED, Flight, Keep, Report, identify_and_judge
from testbench.logs.plausible import questions_of
from testbench.logs.read import read_records
from testbench.questions.identify.answer import ignored_servos, limits_met, notes_of, simulated_in_words
from testbench.questions.identify.derivatives import before, found_derivatives, scaling_of, servos_of
from testbench.questions.identify.flown import flown_condition
from testbench.questions.identify.instruments import doubts_of, in_doubt, taken_in_words, widened
from testbench.questions.identify.mend import Believed, flown_again, in_doubt_of_all, mended_cases, without
from testbench.questions.identify.result import Identified
from testbench.questions.identify.scenario import RecordDescription
from testbench.questions.identify.unpredicted import missed

_ESTIMATED = 3.0  # standard errors that an error must be to be taken out of the records


@on_one_thread
def identify(
    description: Named[RecordDescription],
    data_folder: Path | None = None,
    keep: Keep | None = None,
    progress: Report | None = None,
    strict: bool = False,
    again: int | None = 0,
) -> Identified:
    """Run the same estimators and evaluation on recorded flights, once their instruments are compared.

    Where kinematics contradict an instrument that the models use, no derivative is called determined; if its error is
    known well, the derivatives without it stand beside.

    Args:
        description: which file, column and unit is which channel.
        data_folder: where the files lie, instead of the folder that the description names.
        keep: called with a name and each record as soon as it has been read.
        progress: called with a few words as each stage begins.
        strict: refuse records with implausible values (``questions`` of the result).
        again: how many flights of each model by output error are identified again, to see whether its errors hold;
            None: as many as a second allows.

    Raises:
        TestbenchError: with the file and key of the description that it comes from. An estimator that gives no model is
            an entry of ``failed`` with its reason; only if none gives one it is an error.

    Example:
        >>> import testbench as tb
        >>> tb.identify(tb.load_description("attas_short_period"), data_folder).findings  # doctest: +SKIP
    """
    description = obtain(RecordDescription, description)
    say = progress or (lambda text: None)
    found = _identified(description, data_folder, keep or (lambda name, record: None), say, strict, again)
    fault = None if found.instruments is None else found.instruments.fault
    if not found.contradicted or fault is None or fault.name in description.correct:
        return found
    if not abs(fault.estimate) > _ESTIMATED * fault.std:
        return found
    say("identify once more without the error of the instrument")
    right = _identified(without(description, fault), data_folder, lambda name, record: None, lambda text: None, False)
    return replace(found, corrected=tuple(widened(fault, found.derivatives, right.derivatives)))


def _identified(
    description: RecordDescription,
    data_folder: Path | None,
    keep: Keep,
    say: Report,
    strict: bool,
    again: int | None = 0,
) -> Identified:
    """Return what is identified of the records as they are; no derivative is determined where kinematics contradict."""
    say("read records")
    read = [(n, use, without_errors(r, description.correct)) for n, use, r in read_records(description, data_folder)]
    for name, _, record in read:
        keep(f"{name}_recorded", record)
    say("compare the instruments with one another")
    known_std = description.instrument_std  # where nobody says how far they may err, they are taken as they read
    instruments = agreement([record for _, _, record in read], known_std)
    taken = taken_for_sure(instruments) if known_std else {}
    flights = [
        Flight(name, use, None, {RECORDED: without_errors(record, taken)}, description.trim_s)
        for name, use, record in read
    ]
    with located(description.file, "aircraft"):
        aircraft = None if description.aircraft is None else load_aircraft(description.aircraft)
    inputs = description.identification.inputs
    servos = {} if aircraft is None else servos_of(aircraft, inputs)
    records = [(flight.name, flight.measured[RECORDED]) for flight in flights]
    met = limits_met(servos, description.believes(servos), [record for _, record in records])
    questions = questions_of(records, description.file, strict)
    failed: list[FailedCell] = []
    asked = description.changed(identification=description.asked_of(servos))
    cases = identify_and_judge(flights, asked, say, causes=True, failed=failed)
    say("try remedies of the fit")
    cases, replaced, cured, rivals = mended_cases(cases, instruments.gusts_felt)
    flown = flown_condition(description, cases[0].identification, aircraft, getattr(cases[0].estimator, "V_m_s", None))
    reflights = flown_again(cases, replaced, again, say)
    if not instruments.contradicted:
        believed = Believed(instruments, taken, description, flown.V_m_s or math.nan)
        cases = tuple(in_doubt_of_all(case, believed, rivals.get(i, ())) for i, case in enumerate(cases))
    known = None if aircraft is None else before(aircraft, flown)
    say("judge the derivatives")
    derivatives = found_derivatives(
        cases, known, scaling_of(flown, known), description.simulated_errors, replaced, reflights
    )
    found = Identified(
        description.name,
        description.title,
        description.question,
        description,
        0,
        tuple(flights),
        cases,
        failed=tuple(failed),
        reference=description.reference_values,
        derivatives=derivatives,
        before=known,
        flown=flown,
        notes=(
            *simulated_in_words(description, derivatives),
            *notes_of(description, cases, servos),
            *dict.fromkeys(
                f"flight only: of the log {text}"
                for _, record in records
                if (text := record.provenance.get("recorded", {}).get("not_flown"))
            ),
            *taken_in_words(instruments, taken),
            *cured,
            *(known.notes if known else ()),
            *flown.notes,
        ),
        doubts=(
            *(
                doubt("servo_ignored", f"{name}: the command is used as the surface, as if there were no servo")
                for name in ignored_servos(cases)
            ),
            *(doubt("rate_limit_met", text) for text in met),
        ),
        questions=questions,
        missed=missed(cases, inputs, {d.case for d in derivatives if d.determined}),
        instruments=instruments,
        replaced=replaced,
        again=reflights,
    )
    if not found.contradicted:
        return found
    doubts = (*found.doubts, *doubts_of(instruments))
    return replace(found, derivatives=in_doubt(derivatives, found.contradicted), doubts=doubts)


def load_description(path: Path | str) -> RecordDescription:
    """Read a description of recorded flights; see :meth:`RecordDescription.load`.

    Example:
        >>> import testbench as tb
        >>> tb.load_description("attas_short_period").identification.inputs
        ('de',)
    """
    return obtain(RecordDescription, path)
