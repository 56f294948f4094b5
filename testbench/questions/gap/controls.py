"""Control flights: does the search find a gap where there is none, with these commands, these sensors and this air?

The thresholds hold if residuals are white in the air that was found, and if the library's tests are all the tests there
are. Control flights test the search itself. The believed aircraft, its coefficients drawn from their priors, flies the
measured commands through the same air; the believed sensors measure it; the whole search is made on these records. If k
of n control flights lie as far from noise as the measured ones, the probability of that without any effect is estimated
by (k + 1) / (n + 1), which never understates it on average (B. Phipson and G. K. Smyth, Statistical Applications in
Genetics and Molecular Biology 9, 2010, article 39).
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from hashlib import blake2b
from pathlib import Path

import numpy as np

from testbench import __version__
from testbench.core.door import read_bytes, read_text
from testbench.core.errors import LimitError, TrimError
from testbench.core.files import not_written
from testbench.core.record import FlightAborted, FlightRecord
from testbench.flight.air import Air, turbulence_rms
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.decide import Naming
from testbench.questions.gap.evidence.air import AirFound, listen
from testbench.questions.gap.evidence.commanded import surface_noise
from testbench.questions.gap.evidence.gusts import record_key
from testbench.questions.gap.search.parallel import Ahead
from testbench.questions.gap.starts import start_of

Search = Callable[[Sequence[FlightRecord], AirFound], Naming]
_CUT = 2.0  # standard deviations at which drawn coefficients are cut: beyond them a name is refused
_DRAWS = 10  # of coefficients that are tried until the believed aircraft survives the commands


@dataclass(frozen=True)
class Control:
    """One control flight through all of the commands, and what was said of it.

    Attributes:
        number: from 1 on; the seed of coefficients, air and noise.
        outcome: "no gap" is right; or "not flown", if no coefficients that were drawn survive the commands.
        names: the false names, if any.
        gain: largest fall of chi-square by an effect.
        chi2: weighted sum of squares left once coefficients are re-tuned, no effect added.
    """

    number: int
    outcome: str
    names: tuple[str, ...]
    gain: float
    chi2: float


@dataclass(frozen=True)
class Controls:
    """Control flights beside the measured ones.

    Attributes:
        flights: those that were asked for, in order.
        gain, chi2: the same of the measured records.
    """

    flights: tuple[Control, ...]
    gain: float
    chi2: float

    @property
    def flown(self) -> tuple[Control, ...]:
        """Those that could be flown."""
        return tuple(c for c in self.flights if c.outcome != "not flown")

    @property
    def called(self) -> int:
        """How many of them were called a gap."""
        return sum(c.outcome != "no gap" for c in self.flown)

    @property
    def by_gain(self) -> float:
        """Probability that an effect gains as much as here although there is none, estimated by the control flights."""
        return self._share([c.gain >= self.gain for c in self.flown])

    @property
    def by_misfit(self) -> float:
        """Probability that as much is left after re-tuning although nothing is missing."""
        return self._share([c.chi2 >= self.chi2 for c in self.flown])

    @staticmethod
    def _share(reached: Sequence[bool]) -> float:
        return (sum(reached) + 1) / (len(reached) + 1)

    @property
    def sentence(self) -> str:
        """What they say, in words."""
        n = len(self.flown)
        if n == 0:
            return "none of the control flights could be flown: the thresholds stand as computed"
        most, left = max(c.gain for c in self.flown), max(c.chi2 for c in self.flown)
        lost = len(self.flights) - n
        return (
            f"{'one control flight' if n == 1 else f'{n} control flights'} of the believed model (same commands, "
            f"sensors and air, no effect): the search calls {self.called or 'none'} a gap; effects gain at most "
            f"{most:.3g} there and {self.gain:.4g} here (estimated probability without an effect: {self.by_gain:.2g}); "
            f"chi-square after re-tuning is at most {left:.0f} there and {self.chi2:.0f} here ({self.by_misfit:.2g})"
            + (f"; {lost} more could not be flown" if lost else "")
        )


def fly_control(
    believed: Believed, air: AirFound, records: Sequence[FlightRecord], number: int
) -> list[FlightRecord] | None:
    """Return records that the believed sensors make of a flight without any effect.

    Sample times, commands and missing samples are those of ``records``. Coefficients are drawn from their priors, cut
    at two standard deviations. The turbulence has the rms and height of ``air``.

    Returns None if the believed aircraft does not survive the commands with any of ten draws of its coefficients.
    """
    priors = believed.priors_of(records)
    for attempt in range(_DRAWS):
        rng = np.random.default_rng(np.random.SeedSequence([number, attempt]))
        drawn = np.clip(rng.standard_normal(len(priors)), -_CUT, _CUT)
        nuisances = {n: 1.0 + s * float(z) for (n, s), z in zip(priors.items(), drawn, strict=True)}
        real = replace(believed, whiten=None).with_nuisances(nuisances)
        seeds = rng.integers(1, 2**31, size=(len(records), 2)).tolist()
        try:
            return [
                _measured(real, record, _air(air, of_air), noise)
                for record, (of_air, noise) in zip(records, seeds, strict=True)
            ]
        except (FlightAborted, LimitError, TrimError):
            continue
    return None


def _air(found: AirFound, seed: int) -> Air | None:
    if not found.moves:
        return None
    rms = turbulence_rms(found.rms_m_s, found.height_m)
    return Air(turbulence_rms_m_s=rms, height_m=found.height_m, seed=seed)


def _measured(real: Believed, record: FlightRecord, air: Air | None, seed: int) -> FlightRecord:
    """Return ``record`` with what the sensors of ``real`` read, in place of what was measured."""
    measured = real.at(record).suite.measure(real.flown(record, None, air), seed)
    surfaces = {f"{n}_cmd": s for n, s in surface_noise(record).items() if np.ptp(record[f"{n}_cmd"]) > 0.0}
    rng = np.random.default_rng([seed, 1])
    read = {
        n: record[n] + std * rng.standard_normal(len(record)) for n, std in surfaces.items()
    }  # as they are measured
    return record.with_columns({**{name: measured[name] for name in real.outputs}, **read})


def fly_controls(
    believed: Believed,
    records: Sequence[FlightRecord],
    air: AirFound,
    naming: Naming,
    count: int,
    search: Search,
    say: Callable[[str], None],
    file: Path | None = None,
) -> Controls:
    """Fly control flights and search each as the measured records were searched.

    Args:
        believed: the model as believed, before any air was found.
        records: the measured records that were named from.
        air: the air that was found.
        naming: what was found in the measured records.
        count: number of control flights.
        search: names the gap in records, given the air that was heard in them.
        say: called with a few words as each begins.
        file: keeps each as it ends, so that none is flown twice; those of other records or beliefs in it do no harm.

    Raises:
        RecordError: the file cannot be read.
        WriteError: it cannot be written.
    """
    log = _Log(file, _fingerprint(believed, records, air))
    known = log.read()
    tasks = {i: partial(_control, believed, records, air, search, i) for i in range(1, count + 1) if i not in known}
    with Ahead() as ahead:
        while tasks:
            ahead.begin_first(tasks)
            i = next(iter(tasks))
            say(f"control flight {i} of {count}, without any effect")
            known[i] = ahead.take(i, tasks.pop(i))
            log.add(known[i])
    return Controls(tuple(known[i] for i in range(1, count + 1)), largest_gain(naming), naming.chi2_tuned)


def largest_gain(naming: Naming) -> float:
    """Return the largest fall of chi-square by any effect that was flown; 0 if there is none."""
    return max((f.gain for f in naming.ranking if f.flown), default=0.0)


def _control(
    believed: Believed, records: Sequence[FlightRecord], air: AirFound, search: Search, number: int
) -> Control:
    flown = fly_control(believed, air, records, number)
    if flown is None:
        return Control(number, "not flown", (), 0.0, 0.0)
    found = search(flown, listen(believed, flown))
    return Control(number, found.outcome, found.names, largest_gain(found), found.chi2_tuned)


def without_false_alarms(naming: Naming, controls: Controls) -> Naming:
    """Return ``naming`` without names if any control flight, which holds no effect, gains as much."""
    reached = sum(c.gain >= controls.gain for c in controls.flown)
    if not naming.names or not reached:
        return naming
    title = naming.ranking[0].effect.title
    return replace(
        naming,
        outcome="no gap",
        names=(),
        sentence=f"no gap beyond what flights without one show: {title} gains {controls.gain:.4g}, and so much is "
        f"gained in {reached} of {len(controls.flown)} control flights without any effect",
    )


def _fingerprint(believed: Believed, records: Sequence[FlightRecord], air: AirFound) -> str:
    """Return a digest of all that control flights depend on."""
    a = believed.aircraft
    parts = [__version__, a.xml, repr((a.elastic, a.amendments, a.mass, a.limits, believed.suite, believed.condition))]
    parts += [] if a.adapter is None else [repr(a.adapter)]
    parts += [repr(starts)] if any(starts := [start_of(record) for record in records]) else []
    parts += [repr((believed.rate_hz, air.moves, air.rms_m_s, air.height_m)), *map(record_key, records)]
    return blake2b("\0".join(parts).encode(), digest_size=16).hexdigest()


@dataclass(frozen=True)
class _Log:
    """A file that holds control flights, one a line; those of other fingerprints are skipped."""

    file: Path | None
    key: str

    def read(self) -> dict[int, Control]:
        """Return the control flights of the fingerprint by number; a line that was cut off is left out.

        Raises:
            RecordError: the file cannot be read.
        """
        known: dict[int, Control] = {}
        if self.file is None or not self.file.exists():
            return known
        lines = read_text(self.file, "journal").splitlines()
        for line in lines:
            with contextlib.suppress(ValueError, TypeError):
                row = json.loads(line)
                if row.pop("of") == self.key:
                    known[row["number"]] = Control(**{**row, "names": tuple(row["names"])})
        return known

    def add(self, control: Control) -> None:
        """Write one more line.

        Raises:
            WriteError: the file cannot be written.
        """
        if self.file is None:
            return
        try:
            cut_off = self.file.exists() and not read_bytes(self.file, "journal").endswith(b"\n")
            with self.file.open("a", encoding="utf-8") as out:
                out.write("\n" * cut_off + json.dumps({"of": self.key, **asdict(control)}) + "\n")
        except OSError as error:
            law = "control flights must be kept in a file that can be written to"
            raise not_written(self.file, error, law) from error
