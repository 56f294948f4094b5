"""A file that keeps flights again, so that none is flown and asked about twice."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from hashlib import blake2b
from itertools import count, takewhile
from pathlib import Path

from testbench import __version__
from testbench.core.door import read_bytes, read_text
from testbench.core.files import not_written
from testbench.core.record import FlightRecord
from testbench.inference.calibrate import Trial
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.air import AirFound
from testbench.questions.gap.evidence.gusts import record_key
from testbench.questions.gap.starts import start_of


def fingerprint(believed: Believed, records: Sequence[FlightRecord], air: AirFound) -> str:
    """Return a digest of all that flights again depend on."""
    a = believed.aircraft
    parts = [__version__, a.xml, repr((a.elastic, a.amendments, a.mass, a.limits, believed.suite, believed.condition))]
    parts += [] if a.adapter is None else [repr(a.adapter)]
    parts += [repr(starts)] if any(starts := [start_of(record) for record in records]) else []
    parts += [repr((believed.rate_hz, air.moves, air.rms_m_s, air.height_m)), *map(record_key, records)]
    return blake2b("\0".join(parts).encode(), digest_size=16).hexdigest()


@dataclass(frozen=True)
class Kept:
    """A file that holds flights again, one a line; those of other fingerprints are skipped."""

    file: Path | None
    key: str

    def read(self) -> list[Trial]:
        """Return the first flights of the fingerprint in their order; a line that was cut off is left out.

        Raises:
            RecordError: the file cannot be read.
        """
        known: dict[int, Trial] = {}
        if self.file is None or not self.file.exists():
            return []
        lines = read_text(self.file, "journal").splitlines()
        for line in lines:
            with contextlib.suppress(ValueError, TypeError, KeyError):
                row = json.loads(line)
                if row.pop("of") == self.key:
                    number = row.pop("number")
                    known[number] = Trial(**row)
        return [known[i] for i in takewhile(known.__contains__, count())]

    def add(self, trials: Sequence[Trial], first: int) -> None:
        """Write more lines, the first of this number.

        Raises:
            WriteError: the file cannot be written.
        """
        if self.file is None or not trials:
            return
        rows = [{"of": self.key, "number": n, **asdict(trial)} for n, trial in enumerate(trials, first)]
        try:
            cut_off = self.file.exists() and not read_bytes(self.file, "journal").endswith(b"\n")
            with self.file.open("a", encoding="utf-8") as out:
                out.write("\n" * cut_off + "".join(json.dumps(row) + "\n" for row in rows))
        except OSError as error:
            law = "flights again must be kept in a file that can be written to"
            raise not_written(self.file, error, law) from error
