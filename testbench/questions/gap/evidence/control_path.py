"""What records tell of the path from the command of a control to its surface, where that is recorded.

Where commands drive the believed model, a recorded surface is a channel as all others are: servo, linkage and feedback
of the model say where it stands, and explanations are weighed by it as by any other reading. Where the surface drives
the model, nothing that lies before it is seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.core.record import FlightRecord
from testbench.effects import SERVOS
from testbench.effects.feedback import FED_TO
from testbench.effects.servo import WORDS
from testbench.questions.gap.believed import Believed
from testbench.questions.gap.explain import Naming, percent

# Behind the recorded surface, too: it may work better or worse, or stand elsewhere than it reads.
_BEHIND = ("gain", "offset", "curved linkage")


@dataclass(frozen=True)
class SurfacePath:
    """The path of one control whose surface is recorded.

    Attributes:
        control: "de", "da" or "dr".
        why: why it is not seen; "" if it is.
        probability: that something of it is among what the model lacks.
        believed, nearest: rms that the believed model, and what comes nearest, leave of the surface, over its noise.
    """

    control: str
    why: str = ""
    probability: float = 0.0
    believed: float = 1.0
    nearest: float = 1.0

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the library's effects that act in it; where it is not seen, those that do not show."""
        kinds = [kind for kind, control in SERVOS if control == self.control and not (self.why and kind in _BEHIND)]
        clock = ("clock_offset",) if self.why and self.control == "de" else ()
        return (*(SERVOS[kind, self.control].name for kind in kinds), *FED_TO[self.control], *clock)

    @property
    def sentence(self) -> str:
        """What is known of it, in words."""
        word = WORDS[self.control]
        if self.why:
            return (
                f"the path of the {word} could not be seen: {self.why}, so what was recorded of the {word} itself "
                "drives the model. Lag, rate limit, delay, dead band and play of its servo, and what is fed back or "
                "joined to its command, do not show in these records and are not sought"
            )
        return (
            f"the path of the {word}: the believed model leaves {self.believed:.3g} times the noise of the recorded "
            f"surface, what comes nearest {self.nearest:.3g} times; probability that something is missing between its "
            f"command and surface: {percent(self.probability)}"
        )


def paths_seen(
    believed: Believed, nearest: Believed, naming: Naming, records: Sequence[FlightRecord]
) -> tuple[SurfacePath, ...]:
    """Return what was found of the path of every surface that is compared.

    Args:
        believed: model, re-tuned or not.
        nearest: the same with what was named.
        naming: the explanations.
        records: measured, that they were weighed by.

    Raises:
        FlightAborted, LimitError: a model cannot fly the measured commands.
    """
    if not believed.surfaces:
        return ()
    counts = np.sum([believed.taken(r).sum(axis=0) for r in records], axis=0)
    left = []
    for model in (replace(m, whiten=None) for m in (believed, nearest)):  # no gust moves a surface
        squares = np.sum([np.sum(model.residuals(r) ** 2, axis=0) for r in records], axis=0)
        left.append(np.sqrt(squares / np.maximum(counts, 1)))
    out = []
    for control in believed.surfaces:
        here, path = believed.outputs.index(control), SurfacePath(control)
        sure = naming.weighed.holds(path.effects)
        out.append(replace(path, probability=sure, believed=float(left[0][here]), nearest=float(left[1][here])))
    return tuple(out)
