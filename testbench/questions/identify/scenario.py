"""Descriptions of recorded flights: TOML in, frozen RecordDescription out, every fault of a file reported at once.

A description says where the files lie, which column is which channel in which unit, what each record is used for and
what is identified from it. It holds no code; a scenario's ``preparation`` and ``identification`` mean the same here.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field

from testbench.core.errors import nearest
from testbench.core.paths import find_scenario
from testbench.core.scenario.base import Preparation
from testbench.core.schema import Strict
from testbench.estimators.identification import Identification
from testbench.logs.layout import Recorded, Text


class Reference(Strict):
    """Printed results that a report shows beside what was found, and where they are printed.

    ``values`` are in SI units and radians; "wn_rad_s" and "zeta" are a mode's natural frequency and damping ratio.
    """

    source: Text
    values: Annotated[dict[str, float], Field(min_length=1)]


class RecordDescription(Recorded):
    """Recorded flights, and what is identified from them.

    Every record, and every segment of one, begins with ``trim_s`` of undisturbed flight, over which the bias "trim" of
    the preparation is taken.
    """

    preparation: Preparation = Preparation(bias="mean")
    identification: Identification
    reference: Reference | None = None

    @property
    def outputs(self) -> tuple[str, ...]:
        """The outputs to identify: those listed, else every channel that is not an input."""
        given = self.identification.outputs
        return given or tuple(name for name in self.channels if name not in self.identification.inputs)

    @property
    def reference_values(self) -> dict[str, float | str]:
        """The printed results by name, and under "source" where they are printed; empty if there are none."""
        return {} if self.reference is None else {"source": self.reference.source, **self.reference.values}

    def faults(self) -> list[str]:
        """Return what is wrong between parts of the description that are each right."""
        return [f"{self.file}, {fault}" for fault in _broken_laws(self)]

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """Read a description; ``path`` is a file, or a packaged one such as ``attas_short_period``.

        Raises:
            ScenarioError: the file breaks a law; the message lists every fault with file and key.
            RecordError: the file does not exist or cannot be read.
        """
        file = find_scenario(path)
        if not file.exists():
            packaged = find_scenario(Path("scenarios", "records", Path(path).name))
            file = packaged if packaged.exists() else file
        return super().load(file)


def _broken_laws(description: RecordDescription) -> Iterator[str]:
    """Yield what is wrong between the parts of a description that are each right: key, law, value."""
    records, channels = description.record, description.channels
    uses = [record.use for record in records]
    if "split" not in uses and not {"identification", "validation"} <= set(uses):
        yield "record: records must include use = 'identification' and 'validation', or one with use = 'split'"
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
    both = set(description.identification.inputs) & set(description.identification.outputs)
    if both:
        yield f"identification.outputs: an input cannot be an output too, got {', '.join(sorted(both))}"
    if not description.outputs:
        yield "identification.outputs: there must be an output, but every channel described is an input"
    if description.preparation.bias == "trim" and description.trim_s == 0.0:
        yield "trim_s: must be > 0 where preparation.bias = 'trim', got 0; give it, or take bias = 'mean' or 'trend'"
