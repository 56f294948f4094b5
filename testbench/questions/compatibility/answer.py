"""The compatibility of recorded data in sentences: which instruments err, by how much."""

from __future__ import annotations

from testbench.estimators.coverage import approximate
from testbench.inference.instruments import EveryError
from testbench.page.words import Line, advice_lines, sentence, some
from testbench.questions.compatibility.ask import Compared
from testbench.questions.identify.instruments import agreement_in_words, error_in_words

_NAMED = 5  # errors in a sentence; the table has one row for each
_LOCAL_GRAVITY = 0.05  # m/s2: gravity at sea level lies between 9.780 and 9.832


def with_rivals(every: EveryError, name: str, size: float, std: float) -> str:
    """Return what an error means, and what those mean that would explain the records as well."""
    each = {name: (size, std), **every.rivals.get(name, {})}
    return " or else ".join(error_in_words(n, *of) for n, of in each.items())


def compatibility_answer(found: Compared) -> list[Line]:
    """Return what was found, in sentences."""
    agreed, every = found.agreed, found.every
    texts, surest = list(agreement_in_words(agreed)), dict[str, tuple[float, float]]()
    if every is not None and not (agreed.contradicted and agreed.fault):  # else all errors share a large one
        surest = dict(sorted(every.found.items(), key=lambda item: -abs(item[1][0]) / item[1][1]))
    if surest and every is not None:
        words = some((with_rivals(every, n, *size) for n, size in surest.items()), _NAMED)
        texts.insert(0 if not agreed.contradicted else len(texts), f"with all errors estimated at once, {words}")
    lines = [Line("finding" if k else "lead", sentence(text)) for k, text in enumerate(texts)]
    lines += advice_lines(approximate("data compatibility", "the errors'")) if surest else []
    small = [n for n, (x, _) in surest.items() if n in ("ax_bias", "ay_bias", "az_bias") and abs(x) < _LOCAL_GRAVITY]
    if small:
        lines.append(
            Line(
                "note",
                sentence(
                    f"{', '.join(small)} may be gravity: {found.gravity_m_s2:g} m/s2 was assumed, and gravity varies "
                    "by 0.05 m/s2 over the earth; give the local value"
                ),
            )
        )
    return lines
