"""Descriptions of recorded flights: TOML files read as frozen RecordDescription objects, all faults reported at once.

A description says where the files lie, which column is which channel in which unit, what each record is used for and
what is identified from it. It holds no code; a scenario's ``preparation`` and ``identification`` mean the same here.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, ClassVar, Self

from pydantic import Field

from testbench.core.paths import find_scenario
from testbench.core.scenario.base import Preparation
from testbench.core.schema import Strict
from testbench.estimators.identification import Identification
from testbench.logs.layout import Recorded, Text


class Reference(Strict):
    """Printed results that a report shows beside those found, and where they are printed.

    ``values`` are in SI units and radians; "wn_rad_s" and "zeta" are a mode's natural frequency and damping ratio.
    """

    source: Text
    values: Annotated[dict[str, float], Field(min_length=1)]


class RecordDescription(Recorded):
    """Recorded flights, and what to identify from them.

    Every record, and every segment of one, begins with ``trim_s`` of undisturbed flight, over which the bias "trim" of
    the preparation is taken.
    """

    checked_by: ClassVar[str] = "testbench.questions.identify.check:check"

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
