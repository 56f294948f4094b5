"""The user's own flight, flown again with truths drawn from the priors: what are stated probabilities worth here?

The believed aircraft, its coefficients drawn from their priors, with nothing or with an effect of the library in it,
flies the measured commands through the same air; the believed sensors measure it; the same question is asked about
these records (:mod:`testbench.inference.calibrate`).

A file that keeps flights again, so that none is flown and asked about twice; and one that keeps the fits of a search,
so that one that was interrupted goes on where it stood.
"""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from hashlib import blake2b
from itertools import count, takewhile
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from scipy.signal import lfilter

from testbench import __version__
from testbench.core.door import read_bytes, read_text, sha256
from testbench.core.errors import LimitError, ModelError, TrimError
from testbench.core.files import not_written
from testbench.core.paths import PACKAGE
from testbench.core.record import FlightAborted, FlightRecord
from testbench.effects import Effect
from testbench.flight.air import Air, turbulence_rms
from testbench.inference.calibrate import Reliability, Trial, calibrate
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.evidence.air import AirFound, listen
from testbench.questions.gap.evidence.commanded import surface_noise
from testbench.questions.gap.explain import P_EFFECT, P_NOTHING, Naming
from testbench.questions.gap.name import is_scale, size_of
from testbench.questions.gap.starts import record_key, start_of

Made = TypeVar("Made")


@dataclass(frozen=True)
class Journal:
    """A file of JSON values, such as flights again, one a line by their numbers; those of other keys are skipped."""

    file: Path | None
    key: str

    def rows(self, of: Callable[..., Made]) -> list[Made]:
        """Return the first rows of the fingerprint in their order, each made by ``of`` from its values.

        A line that was cut off is left out.
        """
        known: dict[int, Made] = {}
        if self.file is None or not self.file.exists():
            return []
        lines = read_text(self.file, "journal").splitlines()
        for line in lines:
            with contextlib.suppress(ValueError, TypeError, KeyError):
                row = json.loads(line)
                if row.pop("of") == self.key:
                    number = row.pop("number")
                    known[number] = of(**row)
        return [known[i] for i in takewhile(known.__contains__, count())]

    def write(self, values: Sequence[Mapping[str, Any]], first: int) -> None:
        """Write more lines, the first of this number."""
        if self.file is None or not values:
            return
        rows = [{"of": self.key, "number": n, **one} for n, one in enumerate(values, first)]
        try:
            cut_off = self.file.exists() and not read_bytes(self.file, "journal").endswith(b"\n")
            with self.file.open("a", encoding="utf-8") as out:
                out.write("\n" * cut_off + "".join(json.dumps(row) + "\n" for row in rows))
        except OSError as error:
            law = "flights again, and fits, must be kept in a file that can be written to"
            raise not_written(self.file, error, law) from error


class KeptFits:
    """A file that holds the fits of a search, those that came to rest together on a line: a ``Keeper`` of them.

    Each line names all groups before its own, so that a search that goes another way finds none. Fits that share how
    far any of them came are taken together or not at all: what they find would be another in its last digits.

    Args:
        file: of the search; None keeps nothing.
        key: fingerprint of all that the search depends on.
        say: called with a few words if there is something to go on with.

    Raises:
        RecordError: the file cannot be read.
    """

    def __init__(self, file: Path | None, key: str, say: Callable[[str], None]) -> None:
        self._journal, self._before, self._number = Journal(file, key), "", 0
        self._rows: list[dict[str, Any]] = self._journal.rows(dict)
        if self._rows:
            fits = sum(len(row["fits"]["fits"]) for row in self._rows)
            say(f"continue with {fits} fits of the search that was interrupted")

    def known(self, group: str) -> Any:
        """Return what is kept of the group that comes next, or None."""
        here, self._before = self._before, self._named(group)
        row = self._rows[self._number] if self._number < len(self._rows) else None
        if row is not None and row["group"] == self._before:
            self._number += 1
            return row["fits"]
        self._rows, self._before = self._rows[: self._number], here
        return None

    def keep(self, group: str, content: Any) -> None:
        """Write a group that is at rest."""
        self._before = self._named(group)
        self._journal.write([{"group": self._before, "fits": content}], self._number)
        self._number += 1

    def _named(self, group: str) -> str:
        return blake2b(f"{self._before}\0{group}".encode(), digest_size=16).hexdigest()


Ask = Callable[[Sequence[FlightRecord], AirFound], Naming]
CUT = 2.0  # standard deviations at which what is drawn is cut
DRAWS = 50  # of truths that are tried until one survives the commands
SEED = 1


@dataclass(frozen=True, eq=False)
class Reflown:
    """A flight that is flown again with truths drawn from the priors."""

    believed: Believed  # the model as believed, before any air was found
    records: Sequence[FlightRecord]  # the measured records that were named from
    air: AirFound  # the air that was found
    effects: Mapping[str, Effect] = field(default_factory=dict)  # the library that was sought in, by name

    @property
    def fingerprint(self) -> str:
        """A digest of all that flights again depend on."""
        b, air, a = self.believed, self.air, self.believed.aircraft
        parts = [__version__, a.xml, repr((a.elastic, a.amendments, a.mass, a.limits, b.suite, b.condition))]
        parts += [] if a.adapter is None else [repr(a.adapter)]
        parts += [repr(starts)] if any(starts := [start_of(record) for record in self.records]) else []
        parts += [repr(sorted(b.colour.items()))] if b.colour else []
        parts += [repr((b.rate_hz, air.moves, air.rms_m_s, air.height_m)), *map(record_key, self.records)]
        return blake2b("\0".join(parts).encode(), digest_size=16).hexdigest()

    def times(self, trials: int, ask: Ask, say: Callable[[str], None], file: Path | None = None) -> Reliability:
        """Fly it so often, and ask about each flight as about the measured ones.

        The file keeps each as it ends, so that none is flown twice; those of other records or beliefs in it do no harm.
        """
        log = Journal(file, self.fingerprint)
        kept = log.rows(Trial)
        done = len(kept)

        def draw(rng: np.random.Generator) -> tuple[str, list[FlightRecord]]:
            say(f"flight again {done + 1} of {trials}, with a truth drawn from the priors")
            return self.drawn(rng)

        def asked(flown: Sequence[FlightRecord]) -> Mapping[str, float]:
            return ask(flown, listen(self.believed, flown)).weighed.stated

        found = Reliability(())
        for found in calibrate(draw, asked, trials, SEED, kept):
            log.write([asdict(trial) for trial in found.trials[done:]], done)
            done = len(found.trials)
        return found

    def drawn(self, rng: np.random.Generator) -> tuple[str, list[FlightRecord]]:
        """Draw a truth and return its name and what the believed sensors read of it.

        Sample times, commands and missing samples are those of ``records``. Coefficients and sizes are drawn from their
        priors, cut at two standard deviations. The turbulence has the rms and height of ``air``.
        """
        priors = self.believed.priors_of(self.records)
        possible = [e for e in self.effects.values() if e.met is None and e.over_time is None]
        for _ in range(DRAWS):
            drawn = np.clip(rng.standard_normal(len(priors)), -CUT, CUT)
            real = replace(self.believed, whiten=None)
            real = real.with_nuisances({n: 1.0 + s * float(z) for (n, s), z in zip(priors.items(), drawn, strict=True)})
            name = "nothing"
            if possible and rng.random() > P_NOTHING / (P_NOTHING + P_EFFECT):
                effect = possible[int(rng.integers(len(possible)))]
                name, real = effect.name, real.with_effect(effect, sizes_of(effect, rng))
            seeds = rng.integers(1, 2**31, size=(len(self.records), 2)).tolist()
            try:
                both = zip(self.records, seeds, strict=True)
                return name, [_measured(real, r, _air(self.air, of_air), noise) for r, (of_air, noise) in both]
            except (FlightAborted, LimitError, ModelError, TrimError):
                continue
        raise TrimError(f"of {DRAWS} truths that were drawn from the priors one must fly the commands, got none")


def search_key(flown: Reflown, more: object) -> str:
    """Return a digest of all that the fits of a search depend on, the code of effects of one's own among it."""
    effects = flown.effects.values()
    code = (getattr(getattr(e.amend, "func", e.amend), "__code__", None) for e in effects)
    files = sorted({Path(c.co_filename).resolve() for c in code if c is not None})
    own = [sha256(f, "python") for f in files if PACKAGE not in f.parents and f.is_file()]
    parts = [flown.fingerprint, repr([(e.name, e.parameters) for e in effects]), *own, repr(more)]
    return blake2b("\0".join(parts).encode(), digest_size=16).hexdigest()


def sizes_of(effect: Effect, rng: np.random.Generator) -> dict[str, float]:
    """Return sizes of an effect drawn from their priors, within their bounds."""
    out = {}
    for p in effect.parameters:
        prior = size_of(p.name, p, p.starts[0])
        if is_scale(p):
            ln = prior.value + prior.prior_std * float(np.clip(rng.standard_normal(), -CUT, CUT))
            out[p.name] = float(np.exp(np.clip(ln, prior.low, prior.high)))
            continue
        size = prior.value + prior.prior_std * float(np.clip(rng.standard_normal(), -CUT, CUT))
        if p.none is not None and p.none in (p.low, p.high):  # it has one sign only
            size = prior.value + abs(size - prior.value) * (1.0 if p.none == p.low else -1.0)
        out[p.name] = float(np.clip(size, 0.98 * p.low + 0.02 * prior.value, 0.98 * p.high + 0.02 * prior.value))
    return out


def _air(found: AirFound, seed: int) -> Air | None:
    if not found.moves:
        return None
    rms = turbulence_rms(found.rms_m_s, found.height_m)
    return Air(turbulence_rms_m_s=rms, height_m=found.height_m, seed=seed)


def _measured(real: Believed, record: FlightRecord, air: Air | None, seed: int) -> FlightRecord:
    """Return ``record`` with what the sensors of ``real`` read, in place of what was measured."""
    truth = real.flown(record, None, air)
    measured = real.at(record).suite.measure(truth, seed)
    if real.colours.any():  # noise that is as coloured as it is believed to be
        exact = real.at(record).suite.without_errors().measure(truth, seed)
        for n, a in zip(real.outputs, real.colours.tolist(), strict=True):
            noise = np.nan_to_num(measured[n] - exact[n])
            scaled = np.r_[noise[:1], math.sqrt(1.0 - a**2) * noise[1:]]
            measured = measured.with_columns({n: exact[n] + lfilter([1.0], [1.0, -a], scaled)})
    surfaces = {f"{n}_cmd": s for n, s in surface_noise(record).items() if np.ptp(record[f"{n}_cmd"]) > 0.0}
    rng = np.random.default_rng([seed, 1])
    read = {n: record[n] + std * rng.standard_normal(len(record)) for n, std in surfaces.items()}  # as measured
    return record.with_columns({**{name: measured[name] for name in real.outputs}, **read})
