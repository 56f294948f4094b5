"""What naming says where nothing but a few effects may explain records, and fits of effects without a comparison."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from testbench.core.record import FlightRecord
from testbench.effects import Effect
from testbench.inference.evidence import Fitting, compare_hypotheses
from testbench.questions.gap.ask import GapResult
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.explain import Explanation, Naming
from testbench.questions.gap.export import amended_files
from testbench.questions.gap.name import Sought, _Asker, _split, name_effect
from testbench.questions.gap.search.gust_search import sought


def weighed(believed: Believed, records: Sequence[FlightRecord], *effects: Effect) -> Naming:
    """Return what is named among some effects."""
    return name_effect(believed, records, Sought({e.name: e for e in effects}, pairs=False))


def fits(believed: Believed, records: Sequence[FlightRecord], *effects: Effect) -> list[Explanation | None]:
    """Return the fit of each effect, as naming begins it; None of one that cannot be seen or flown.

    Nothing else is fitted: neither "nothing" nor coefficients, which take as long as the effect and are weighed in
    other tests.
    """
    asker = _Asker(believed, tuple(records), "simulated")
    near = {one.effect.name: one for one in asker.near([sought(asker.tuned, e) for e in effects])}
    asked = {n: h for n, one in near.items() if (h := asker.effect(one)) is not None}
    if not asked:
        return [None] * len(effects)
    found = compare_hypotheses(
        records, list(asked.values()), asker.noise, asker.unknown, fitting=Fitting(0, asker.ahead)
    )
    out = []
    for effect in effects:
        if effect.name not in asked:
            out.append(None)
            continue
        row, effect = found[effect.name], near[effect.name].effect
        values, errors, nuisances, spread = _split(effect, row)
        there = asker.tuned.moved(believed.with_effect(effect, values), asker.tuned.vector(nuisances))
        left = np.inf if there is None else there.chi2
        of_comparison = 0.0, 0.0, row.probability, 0.0, row.posterior.kappa
        out.append(Explanation(effect, values, errors, nuisances, spread, left, *of_comparison))
    return out


def check_sizes(found: Explanation | None, true: Mapping[str, float], share: float) -> None:
    """Sizes are right to a share of them, or to two errors: what records hardly tell is drawn to its prior."""
    assert found is not None
    off = {n: abs(found.values[n] - x) / max(share * abs(x), 2.0 * found.errors[n]) for n, x in true.items()}
    assert max(off.values()) < 1.0, (found.size, true)


def write_amended(result: GapResult, folder: Path) -> list[Path]:
    """Write what was named as the page of a result does; return the paths."""
    files = amended_files(result)
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    return [folder / name for name in files]
