"""What is said of a decision, in words; what decides is in decide.py."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from testbench.effects.servo import WORDS
from testbench.questions.gap.evidence.control_path import JudgedPath
from testbench.questions.gap.evidence.locate import Structure
from testbench.questions.gap.priors import deviations_of
from testbench.questions.gap.search.fit import EffectFit


def no_gap(chi2_tuned: float, samples: int) -> str:
    """No effect gains more than noise would, and what is left is noise."""
    return (
        f"no gap: no effect of the library gains more than noise would, and what is left is noise "
        f"(chi-square {chi2_tuned:.0f} over {samples} samples)"
    )


def nothing_explains(chi2_tuned: float, samples: int) -> str:
    """More than noise is left, and no effect explains any of it."""
    return (
        f"unexplained: the residual exceeds the noise (chi-square {chi2_tuned:.0f} over {samples} samples), "
        "but no effect of the library explains any of it"
    )


def strained(best: EffectFit, priors: Mapping[str, float] | None = None) -> str:
    """The best effect needs nuisances that are farther off than is believed of them (``priors``)."""
    priors = deviations_of(None) if priors is None else priors
    off = sorted(((abs(f - 1.0) / priors[n], n, f) for n, f in best.nuisances.items()), reverse=True)
    told = [o for o in off if o[0] > 0.5 * off[0][0]][:3]
    stretched = ", ".join(f"{n} {f:.3g} times the believed value ({z:.1f} standard deviations)" for z, n, f in told)
    return (
        f"unexplained: {best.effect.title} ({best.size}) comes nearest, but it needs coefficients that lie "
        f"farther off than is believed of them: {stretched}"
    )


def beyond(best: EffectFit) -> str:
    """The records ask for more of the best effect than there can be."""
    return (
        f"unexplained: {best.effect.title} ({best.size}) comes nearest, but the records ask for more of it than is "
        f"physically possible: {', '.join(best.beyond)} lies at the end of its range"
    )


def too_little(best: EffectFit) -> str:
    """The best effect explains too small a share of the excess."""
    part = f"only {100 * best.share:.0f} % of the excess" if np.isfinite(best.share) else "too little of the residual"
    return f"unexplained: {best.effect.title} comes nearest, but it explains {part}"


def leaves_far_more(best: EffectFit, left: float) -> str:
    """The best effect leaves ``left`` of chi-square above the noise."""
    return (
        f"unexplained: {best.effect.title} comes nearest, but chi-square exceeds the noise by "
        f"{best.gain + left:.0f}, and this effect leaves {left:.0f} of that: the true effect is a relative of it, or "
        "another effect acts beside it"
    )


def leaves_structure(best: EffectFit, left: Structure) -> str:
    """The best effect leaves more in one band of one channel than its form may."""
    low, high = left.band_Hz
    return (
        f"unexplained: {best.effect.title} ({best.size}) comes nearest and lowers chi-square by {best.gain:.0f}, but "
        f"leaves {left.excess:.0f} above the noise in {left.channel} between {low:g} and {high:g} Hz alone: the true "
        "effect is a relative of it, or another effect acts beside it"
    )


def too_many(fits: Sequence[EffectFit]) -> str:
    """So many effects come near that no set of them is an answer."""
    near = ", ".join(f.effect.title for f in fits)
    return f"unexplained: {len(fits)} effects come near, and these data do not tell them apart: {near}"


def company(fits: Sequence[EffectFit]) -> str:
    """Several effects are needed, and which of them they are, in different parts, is not told."""
    near = _sized(fits, "; or ")
    return (
        f"unexplained: no single effect explains it, and several that act in different parts do so together as well as "
        f"each other: {near}. One effect that the library does not hold could look the same"
    )


def in_common(alone: EffectFit) -> str:
    """One effect is all that several sets, which are not told apart, have in common."""
    return (
        f"{alone.effect.title}: {alone.size}; it explains {100 * alone.share:.1f} % of the excess over noise. The "
        f"rest is due either to its form or to one of several other effects, which these data cannot tell apart"
    )


def one_of(fits: Sequence[EffectFit]) -> str:
    """One of several, the best first."""
    told = "; ".join(f"{f.effect.title}, {f.size} (gain {f.gain:.4g})" for f in fits)
    return (
        f"one of these, which these data cannot tell apart: {told}. What separates them: {fits[0].effect.separated_by}"
    )


def named(best: EffectFit, leaves_noise: bool) -> str:
    """One effect is named."""
    explained = "what is left is noise"
    if np.isfinite(best.share):
        explained = f"it explains {100 * best.share:.1f} % of the excess over noise"
    if not leaves_noise and not best.scatter_s:
        explained += "; it leaves more than noise: its form is not quite right, or the true effect is a relative of it"
    return f"{best.effect.title}: {best.size}; {explained}"


def refuted(fits: Sequence[EffectFit], raised: Sequence[float]) -> str:
    """On held-out manoeuvres every name raises chi-square, by ``raised``."""
    titles, each = [f.effect.title for f in fits], ", ".join(f"{r:.4g}" for r in raised)
    return (
        f"unexplained: {' or '.join(titles)} would fit, but the manoeuvres held out refute "
        f"{'them all: there each' if titles[1:] else 'it: there it'} raises chi-square, by {each} "
        "against the model without it"
    )


def refuted_but(kept: Sequence[EffectFit], out: Sequence[EffectFit]) -> str:
    """On held-out manoeuvres some of several names are refuted."""
    told = _sized(kept)
    head = "one of these, which these data cannot tell apart: " if len(kept) > 1 else ""
    titles = " and ".join(f.effect.title for f in out)
    return f"{head}{told}; the manoeuvres held out refute {titles}, which would fit as well"


def remainder(best: EffectFit, title: str, gain: float) -> str:
    """Another effect would explain more of what the best one leaves than its form may leave."""
    return (
        f"unexplained: {best.effect.title} ({best.size}) comes nearest and lowers chi-square by {best.gain:.4g}, but "
        f"{title} beside it would explain another {gain:.3g}, more than its form may leave: the true effect is a "
        "relative of it, or there are several"
    )


def imitates(gone: Sequence[EffectFit], kept: Sequence[EffectFit], paths: Sequence[JudgedPath]) -> str:
    """Names are refuted that explain nothing where the surfaces of ``paths`` drive; ``kept`` are the other names."""
    why = (
        f"{' and '.join(f'{f.effect.title} ({f.size})' for f in gone)} would explain the flights as commanded, but "
        f"nothing where recorded surfaces drive the model: {_differ(paths)}, and that is what it imitates"
    )
    told = _sized(kept)
    return f"{told}; {why}" if kept else f"unexplained: {why}"


def path_alone(paths: Sequence[JudgedPath]) -> str:
    """Paths differ by what no effect that was searched is."""
    return (
        f"unexplained: {_differ(paths)}, and no effect that was searched does that; what it does to the motion is "
        "within what coefficients can imitate"
    )


def _sized(fits: Sequence[EffectFit], between: str = "; ") -> str:
    return between.join(f"{f.effect.title}, {f.size}" for f in fits)


def _differ(paths: Sequence[JudgedPath]) -> str:
    told = ((WORDS[p.control], " beside ".join(t.words for t in p.terms)) for p in paths)
    return " and ".join(f"the {word}'s recorded surface shows {terms}" for word, terms in told)


def gust_beside_command(gust: EffectFit, part: float, kept: Sequence[EffectFit]) -> str:
    """A gust that blows while a command is out may leave a ``part`` of what it gains; ``kept`` are the other names."""
    why = (
        f"{gust.effect.title} ({gust.size}) comes nearest, but a command is out at that time, and up to "
        f"{100.0 * part:.3g} % of what it explains may be left around it: an answer to the command that the library "
        f"does not hold could look the same. Fly the manoeuvre again: a gust does not come twice"
    )
    told = _sized(kept)
    return f"{told}; {why}" if kept else f"unexplained: {why}"
