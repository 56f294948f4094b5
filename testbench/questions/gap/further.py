"""Further effects of one control's path, sought only where the search points to that path.

Each control can have a dozen servo effects. In the library they would be things that every record may be mistaken for,
each of which costs a search. So the library holds the plain ones of aileron, rudder and thrust, and those that are
like them but for their form wait until one of the plain ones comes nearest, or a force or moment follows the control.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from testbench.core.record import FlightRecord
from testbench.effects import Effect, left_out
from testbench.effects.servo import PLACES, WORDS
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.decide import Naming, Rest, judged, score
from testbench.questions.gap.open_set import FirstLook
from testbench.questions.gap.search.name import name_effect

SURFACES = ("da", "dr")  # the elevator's are in the library
CONTROLS = (*SURFACES, "thr")
STRANGERS = 5  # effects of other parts that come nearest and are compared with those of the path


def pointed_to(naming: Naming, first: FirstLook) -> str:
    """Return the control to whose path a search points, "" if there is none.

    A name that puts two effects of one path together is a form of a third one. Where nothing is named, the effect that
    comes nearest points to its path, and else the surest term of forces and moments that holds an aileron or rudder;
    where none does, one that holds the throttle.
    """
    best = naming.best
    near = best if best is not None else next((f for f in naming.ranking if f.significant and f.flown), None)
    if (best is None and naming.outcome != "unexplained") or (best is not None and not best.effect.parts):
        return ""
    places = set() if near is None else {e.place for e in near.effect.singles}
    for control in CONTROLS:
        if places == {PLACES[control]}:
            return control
    if best is not None:
        return ""
    moved = [next((c for c in CONTROLS if c in f.term.quantities), "") for f in first.terms]
    return next((c for c in moved if c in SURFACES), "thr" if "thr" in moved else "")


def named_in_path(
    naming: Naming,
    rest: Rest | None,
    first: FirstLook,
    believed: Believed,
    records: Sequence[FlightRecord],
    held_out: Sequence[FlightRecord],
    known: Mapping[str, Effect],
    more: Mapping[str, Effect],
    say: Callable[[str], None],
) -> tuple[Naming, Rest | None]:
    """Return ``naming`` and ``rest``, or what further effects of the path that it points to explain.

    Args:
        naming: by the library.
        rest: what another effect would explain beside what is named.
        first: what forces and moments say.
        believed: the model in the air that was found.
        records: those that are named from.
        held_out: those that judge.
        known: the library.
        more: further effects, by name; those of other controls are not sought.
        say: called with a few words as each stage begins.
    """
    control = pointed_to(naming, first)
    place = PLACES.get(control, "")
    further = {n: e for n, e in more.items() if e.place == place and n not in known}
    gone = left_out(further, believed.aircraft, believed.suite)
    further = {n: e for n, e in further.items() if n not in gone}
    if not further:
        return naming, rest
    say(f"seek further effects of the {WORDS[control]}'s path")
    own = {n: e for n, e in known.items() if e.place == place}
    near = {e.name: e for f in naming.ranking[:STRANGERS] for e in f.effect.singles if e.name in known}
    found = name_effect(believed, records, say, {**near, **own, **further})
    found, left = judged(found, believed, records, held_out, {**known, **further})
    if not found.names:
        return naming, rest
    seen = {f.effect.name for f in found.ranking}
    others = [f for f in naming.ranking if f.effect.name not in seen]
    ranking = tuple(sorted((*found.ranking, *others), key=lambda f: -score(f, found.samples)))
    return replace(found, ranking=ranking, rejected={**naming.rejected, **found.rejected}), left
