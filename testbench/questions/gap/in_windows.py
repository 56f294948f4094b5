"""Records as they are searched: cut into windows that the believed aircraft survives, with starts that suit it."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from testbench.core.record import FlightAborted, FlightRecord
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.search.hypothesis import Hypothesis
from testbench.questions.gap.search.retune import retune
from testbench.questions.gap.window_length import Windows
from testbench.questions.gap.windows import Cut, begin_freely, cut

SHARES = (1.0, 0.5, 0.25)
"""Of the length of windows that are tried, one after the other."""
STARTS_IN_TURN = 6
"""Rounds in which starts of windows and coefficients are fitted at most."""


def in_windows(
    believed: Believed,
    records: Mapping[str, FlightRecord],
    held_out: Mapping[str, FlightRecord],
    windows: Windows,
    say: Callable[[str], None],
) -> tuple[Believed, Cut, Cut]:
    """Return the belief with the starts of windows, and both kinds of records, cut where that is wanted.

    Where the believed aircraft leaves its limits in windows of a length that is left to us, they are made shorter.

    Raises:
        FlightAborted, LimitError, TrimError: it does in the shortest ones, too.
    """
    for share in SHARES:
        given, others = (cut(believed, x, windows, share) for x in (records, held_out))
        if not given.notes and not others.notes:
            break
        say("fit where windows start")
        try:
            begun = _begun(believed, given.records, others.records)
            for record in (*given.records.values(), *others.records.values()):
                begun.predict(record)  # the re-tuned aircraft may survive where the believed one does not
            return begun, given, others
        except FlightAborted:
            if windows != "auto" or share == SHARES[-1]:
                raise
    return believed, given, others


def _begun(believed: Believed, records: Mapping[str, FlightRecord], held_out: Mapping[str, FlightRecord]) -> Believed:
    """Return the belief with starts of windows, fitted to the re-tuned model in turn with its coefficients."""
    both, naming = {**records, **held_out}, tuple(records.values())
    out = begin_freely(believed, both)
    tuned = retune(Hypothesis.at(out, out, naming))
    for _ in range(STARTS_IN_TURN):
        out = begin_freely(out, both, out.with_nuisances(tuned.by_name))
        better = retune(Hypothesis.at(out, out, naming, tuned.nuisances))
        fallen, tuned = tuned.chi2 - better.chi2, better
        if fallen < 1.0:
            break
    return out
