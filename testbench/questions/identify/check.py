"""What can be checked in a description of recorded flights before the files are read."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

from testbench.core.errors import nearest
from testbench.estimators import METHODS
from testbench.inference.instruments import KINDS
from testbench.questions.identify.scenario import RecordDescription


def check(description: RecordDescription) -> list[str]:
    """Return what is wrong between parts of a description that are each right."""
    return [f"{description.file}, {fault}" for fault in _broken_laws(description)]


def _broken_laws(description: RecordDescription) -> Iterator[str]:
    """Yield what is wrong between the parts of a description that are each right: key, law, value."""
    records, channels = description.record, description.channels
    uses = [record.use for record in records]
    if not {"split", "identification"} & set(uses):
        yield "record: records must include use = 'identification', or one with use = 'split'"
    judged = [
        e.method
        for e in description.identification.estimators
        if e.method in METHODS and "validation" in METHODS[e.method].needs
    ]
    if judged and not {"split", "validation"} & set(uses):
        yield (
            f"record: {', '.join(dict.fromkeys(judged))} chooses by records that are kept back: records must include "
            "use = 'validation', or one with use = 'split'"
        )
    for what, names in (("record", [part for record in records for part in record.parts]), ("channel", channels)):
        for name in sorted({name for name in names if list(names).count(name) > 1}):
            yield f"{what}: names must differ (segments are named NAME_1, NAME_2), got '{name}' more than once"
    pieces = [(record, *piece) for record in records for piece in (record.segments or ((-float("inf"), float("inf")),))]
    for (first, start, end), (second, other_start, other_end) in combinations(pieces, 2):
        same = (first.file, first.variable) == (second.file, second.variable)
        if same and start <= other_end and other_start <= end:
            yield (
                f"record.segments: no sample may be used twice, but '{first.name}' ({first.use}) and '{second.name}' "
                f"({second.use}) overlap in {first.file}; give segments apart from each other"
            )
    for key in ("inputs", "outputs"):
        for name in getattr(description.identification, key):
            if name not in channels:
                hint = nearest(name, channels)
                yield f"identification.{key}: must be among the channels described, got '{name}'{hint}"
    for name in description.servo:
        if name not in description.identification.inputs:
            hint = nearest(name, description.identification.inputs)
            yield f"servo.{name}: a servo belongs to one of identification.inputs, got '{name}'{hint}"
    for key, errors in (("correct", description.correct), ("instrument_std", description.instrument_std)):
        for name, size in errors.items():
            channel, _, kind = name.rpartition("_")
            if channel not in channels or kind not in KINDS:
                yield (
                    f"{key}.{name}: must be CHANNEL_KIND, of a channel described and a kind among {', '.join(KINDS)}, "
                    f"got '{name}'"
                )
            elif kind == "scale" and size <= -1.0:
                yield f"{key}.{name}: must be > -1, the share that is read too much, got {size:g}"
    both = set(description.identification.inputs) & set(description.identification.outputs)
    if both:
        yield f"identification.outputs: an input cannot be an output too, got {', '.join(sorted(both))}"
    if not description.outputs:
        yield "identification.outputs: there must be an output, but every channel described is an input"
    if description.preparation.bias == "trim" and description.trim_s == 0.0:
        yield "trim_s: must be > 0 where preparation.bias = 'trim', got 0; give it, or take bias = 'mean' or 'trend'"
