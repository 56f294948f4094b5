"""Identify from recorded flights: read the records, run the estimators, judge the models."""

from __future__ import annotations

from pathlib import Path

from testbench.line import Flight, Keep, Report, identify_and_judge
from testbench.logs.plausible import questions_of
from testbench.logs.read import read_records
from testbench.questions.identify.scenario import RecordDescription
from testbench.questions.run.result import RunResult


def identify(
    description: RecordDescription,
    data_folder: Path | None = None,
    keep: Keep | None = None,
    progress: Report | None = None,
    strict: bool = False,
) -> RunResult:
    """Run the same estimators and evaluation on recorded flights.

    Args:
        description: which file, column and unit is which channel.
        data_folder: where the files lie, instead of the folder that the description names.
        keep: called with a name and each record as soon as it has been read.
        progress: called with a few words as each stage begins.
        strict: refuse records with values that are hardly meant (``questions`` of the result).

    Raises:
        TestbenchError: with the file and key of the description that it comes from.

    Example:
        >>> import testbench as tb
        >>> tb.identify(tb.load_description("attas_short_period"), data_folder).findings  # doctest: +SKIP
    """
    keep, say = keep or (lambda name, record: None), progress or (lambda text: None)
    say("read records")
    flights = [
        Flight(name, use, None, {"recorded": record}, description.trim_s)
        for name, use, record in read_records(description, data_folder)
    ]
    for flight in flights:
        keep(f"{flight.name}_recorded", flight.measured["recorded"])
    records = [(flight.name, flight.measured["recorded"]) for flight in flights]
    questions = questions_of(records, description.file, strict)
    cases = identify_and_judge(
        flights, ["recorded"], description.preparation, description.identification, description.file, say
    )
    return RunResult(
        description.name,
        description.title,
        description.question,
        description,
        0,
        tuple(flights),
        cases,
        reference=description.reference_values,
        questions=questions,
    )


def load_description(path: Path | str) -> RecordDescription:
    """Read a description of recorded flights; see :meth:`RecordDescription.load`.

    Example:
        >>> import testbench as tb
        >>> tb.load_description("attas_short_period").identification.inputs
        ('de',)
    """
    return RecordDescription.load(path)
