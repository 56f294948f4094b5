"""Small pages of the kinds that nothing in results/ holds: of logs, of real records, of a campaign after its flights.

    python tests/studies/made_pages.py FOLDER

Each takes a few seconds to a minute. Those of real records are left out where tests/recorded.py finds no records.
"""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

import testbench.cli as cli
from testbench.core.record import FlightRecord
from testbench.questions.gap.ask import run_flights
from testbench.questions.gap.evidence.commanded import quiet_samples
from testbench.questions.gap.page import gap_page
from testbench.questions.gap.records import Flights
from testbench.questions.plan.close_page import close_page
from testbench.questions.plan.verdicts import judge

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from smallest import sized

for room in ("questions/gap", "questions/plan"):
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / room))


def say(*words: object) -> None:
    """Run a command in this process."""
    with mock.patch.object(sys, "argv", ["testbench", *map(str, words)]):
        try:
            cli.main()
        except SystemExit as end:
            if end.code:
                raise


def log(folder: Path) -> None:
    """What a PX4 log holds, and derivatives of it."""
    from flown_logs import px4_log

    file = folder / "px4.ulg"
    file.write_bytes(px4_log(1))
    say("import", file, "-o", folder / "imported", "--throw", "de=12.5", "--throw", "da=25", "--throw", "dr=25")
    say("identify", folder / "imported" / "px4_longitudinal.toml", "--aircraft", "taurus", "-o", folder)


def ten_minutes(folder: Path) -> None:
    """What a record of ten minutes at 100 Hz holds: twelve channels."""
    t, rng = np.arange(60_000) / 100.0, np.random.default_rng(0)
    names = ("de", "da", "dr", "V", "alpha", "q", "az", "theta", "p", "r", "phi", "h")
    data = [0.1 * np.sin(0.1 * (k + 1) * t) + 0.01 * rng.standard_normal(t.size) for k in range(len(names))]
    data[names.index("V")] += 20.0
    data[names.index("h")] += 300.0
    file = folder / "ten_minutes.nc"
    FlightRecord(t, names, np.column_stack(data), "measured").save(file)
    say("import", file, "-o", folder / "ten_minutes")


def pooled(folder: Path) -> None:
    """Three days pooled."""
    from pooled_logs import write_day

    given = folder / "given"
    given.mkdir(exist_ok=True)
    days = [
        write_day(given, f"day{k}", V, m, 0.08 * m / 1.8, seed=k)
        for k, (V, m) in enumerate(((12, 1.8), (15, 2.2), (19, 1.8)))
    ]
    say("identify", *days, "-o", folder)


def amended(folder: Path) -> None:
    """Derivatives of a flight of the Taurus set against its model."""
    from taurus_logs import write_log

    given = folder / "given"
    given.mkdir(exist_ok=True)
    say("identify", write_log(given, "taurus_day", 14.0, 1.2), "--aircraft", "taurus", "-o", folder)


def gap(folder: Path) -> None:
    """What a model of printed derivatives lacks beside a real record, searched over the whole library."""
    from real_aircraft import HFB_RHO, altitude_m, believe, fine_noise, hfb320, hfb320_record
    from recorded import flight_data

    record = hfb320_record(flight_data())
    V = float(record["V"][: quiet_samples(record)].mean())
    believed = believe(hfb320(folder / "given" / "hfb320"), record, fine_noise(record), V, altitude_m(HFB_RHO))
    flights = Flights(believed, {"3211": record}, {}, ("the derivatives are those printed by Jategaonkar",))
    gap_page(run_flights("hfb320", flights)).write(folder / "gap_hfb320")


def close(folder: Path) -> None:
    """A small campaign after its flights; the promises of its second design are broken."""
    from flown_campaign import flown_campaign, promise_of

    given = folder / "given" / "campaign"
    given.mkdir(parents=True)
    _, _, closed, cards, _ = flown_campaign(given)
    cards[-1] = replace(cards[-1], promise=promise_of(cards[-1].card, 0.003))
    close_page(judge(closed, cards)).write(folder / "close_campaign")


MADE: tuple[Callable[[Path], None], ...] = (log, ten_minutes, pooled, amended, gap, close)


def main(folder: Path) -> None:
    """Make all of them."""
    folder.mkdir(parents=True, exist_ok=True)
    for make in MADE[: sized(None, 1)]:
        try:
            make(folder)
        except pytest.skip.Exception as why:
            print(f"left out: {why}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
