"""What naming says where nothing but a few effects may explain records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from testbench.core.record import FlightRecord
from testbench.effects import Effect
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.explain import Explanation, Naming
from testbench.questions.gap.name import name_effect


def weighed(believed: Believed, records: Sequence[FlightRecord], *effects: Effect) -> Naming:
    """Return what is named among some effects."""
    return name_effect(believed, records, effects={e.name: e for e in effects}, pairs=False)


def fits(believed: Believed, records: Sequence[FlightRecord], *effects: Effect) -> list[Explanation | None]:
    """Return the fit of each effect; None of one that cannot be seen or flown."""
    found = {f.effect.name: f for f in weighed(believed, records, *effects).ranking}
    return [found.get(e.name) for e in effects]


def check_sizes(found: Explanation | None, true: Mapping[str, float], share: float) -> None:
    """Sizes are right to a share of them, or to two errors: what records hardly tell is drawn to its prior."""
    assert found is not None
    off = {n: abs(found.values[n] - x) / max(share * abs(x), 2.0 * found.errors[n]) for n, x in true.items()}
    assert max(off.values()) < 1.0, (found.size, true)
