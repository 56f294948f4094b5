"""Judging an identified model: predicted against measured outputs, and its poles and response against true ones."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from testbench.core.blas import on_one_thread
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.core.relative import percent_in_words
from testbench.evaluation.metrics import BodeError, bode_error, fit_percent, mrse_percent

if TYPE_CHECKING:
    from testbench.estimators.model import IdentifiedModel
    from testbench.evaluation.derivatives import ParameterEstimate
    from testbench.evaluation.modes import PoleMatch

__all__ = ["BodeError", "Evaluation", "Scores", "TrueSystem", "bode_error", "evaluate", "fit_percent", "mrse_percent"]

ComplexArray = NDArray[np.complex128]

# Judgement, not statistics: where a model stops being useful for simulation and control design.
GOOD_MRSE_PERCENT = 20.0
USELESS_MRSE_PERCENT = 100.0
AS_SMALL = 1.5
"""Error on validation over error on identification up to which a model predicts as well as it was fitted."""
CLOSE_WN_PERCENT = 5.0
CLOSE_ZETA = 0.05
CLOSE_DB = 1.0
WRONG_PERCENT, WRONG_ERRORS = 10.0, 4.0
"""Error of an excited mode or a parameter, and of a parameter in standard errors as well, beyond which it is wrong."""


@dataclass(frozen=True, eq=False)
class Scores:
    """How a model predicts one data set, all its records taken together.

    Attributes:
        mrse_percent: (p,) relative squared error per output (EOLO paper, equation 4).
        fit_percent: (p,) 100 (1 - ||y - yhat|| / ||y - mean(y)||) per output.
        predictions: one (n, p) array per record, from the record's inputs alone.
        noise_percent: (p,) MRSE that a perfect model would get because of the measurement noise; None if unknown.
        rms_error: (p,) root mean square of y - yhat, SI; None if unknown.
        mrse_mean: mean of ``mrse_percent`` (the paper's MRSE of all outputs).

    Without records the figures are NaN and :attr:`Evaluation.verdicts` says so.
    """

    mrse_percent: FloatArray
    fit_percent: FloatArray
    predictions: tuple[FloatArray, ...]
    noise_percent: FloatArray | None = None
    rms_error: FloatArray | None = None

    @property
    def mrse_mean(self) -> float:
        """Mean of the outputs' relative squared errors, percent."""
        return float(np.mean(self.mrse_percent))


@dataclass(frozen=True, eq=False)
class TrueSystem:
    """What is known of the system that a model is to be.

    Attributes:
        poles: mode name -> continuous pole, rad/s.
        response: of the system from the model's inputs to its outputs, (k, p, m) at ``omega`` or a function that
            returns it, SI units; None if it is not compared. The model is a discrete one: see
            :func:`bode.zero_order_hold`.
        omega: (k,) frequencies, rad/s, where the responses are compared; those above the model's Nyquist frequency
            are left out.
        parameters: parameter name -> true value, for models with named parameters; None if none is known.
        excited: names of the modes that the records show; all of them if None.

    Example:
        >>> import testbench as tb
        >>> tb.TrueSystem({"short period": -2.0 + 4.2j}).poles["short period"].imag
        4.2
    """

    poles: Mapping[str, complex] = field(default_factory=dict)
    response: Callable[[FloatArray], ComplexArray] | ComplexArray | None = None
    omega: FloatArray | None = None
    parameters: Mapping[str, float] | None = None
    excited: Collection[str] | None = None


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Figures of merit of one model.

    Attributes:
        outputs: (p,) outputs of the model, the order of all arrays.
        identification: scores on the records that it was identified from.
        validation: scores on records that it has not seen.
        poles: one match per mode and set of poles; empty if no true poles were given.
        bode: errors of the frequency response over ``omega_rad_s``, or None.
        omega_rad_s: frequencies that were compared: those asked for, up to the model's Nyquist frequency.
        unstable: poles of the model with positive real part, rad/s, upper half plane.
        parameters: of a model with named parameters; empty for others.
        excited: names of the modes that the records show; all if None.
    """

    outputs: tuple[str, ...]
    identification: Scores
    validation: Scores
    poles: tuple[PoleMatch, ...] = ()
    bode: BodeError | None = None
    omega_rad_s: FloatArray | None = None
    unstable: tuple[complex, ...] = ()
    parameters: tuple[ParameterEstimate, ...] = ()
    excited: Collection[str] | None = None

    @property
    def wrong(self) -> tuple[str, ...] | None:
        """What the truth shows to be wrong, in words; None where it is not known.

        Of parameters with standard errors those that are off by more than ``WRONG_PERCENT`` and ``WRONG_ERRORS`` of
        them; of other models the excited modes that are not found or off by more than ``WRONG_PERCENT``.
        """
        known = [(p, p.deviations, p.value / p.true - 1.0) for p in self.parameters if p.free and p.true]
        stated = [(p.name, abs(errors), 100.0 * abs(off)) for p, errors, off in known if errors is not None]
        if stated:
            return tuple(
                f"{name} is {off:.0f} % off, {errors:.2g} of its standard errors"
                for name, errors, off in stated
                if off > WRONG_PERCENT and errors > WRONG_ERRORS
            )
        from testbench.evaluation.modes import words_of

        best: dict[str, PoleMatch] = {}
        for m in self.poles:  # a mode is found if the poles of any output have it
            if m.true and (self.excited is None or m.name in self.excited):
                best[m.name] = min(best.get(m.name, m), m, key=lambda match: match.off)
        far = [m for m in best.values() if 100.0 * m.off > WRONG_PERCENT]
        if not best:
            return None
        return tuple(
            f"{words_of(m.name)} is {'not found' if m.found is None else f'{100.0 * m.off:.0f} % off'}" for m in far
        )

    @property
    def untested(self) -> tuple[str, ...]:
        """Outputs that move too little in the validation records to test a model: the error there is what the fit left.

        Their relative error says nothing of the model.
        """
        left, here = self.identification, self.validation
        if left.rms_error is None or here.rms_error is None:
            return ()
        quiet = (
            (here.mrse_percent > GOOD_MRSE_PERCENT)
            & (left.mrse_percent <= GOOD_MRSE_PERCENT)
            & (here.rms_error <= AS_SMALL * left.rms_error)
        )
        return tuple(name for name, own in zip(self.outputs, quiet, strict=True) if own)

    @property
    def verdicts(self) -> tuple[str, ...]:
        """The figures in sentences, made from them each time."""
        out = [
            _prediction_verdict("identification", self.outputs, self.identification),
            _prediction_verdict("validation", self.outputs, self.validation, self.untested),
        ]
        out += [_pole_verdict(match) for match in self.poles]
        if self.bode is not None and self.omega_rad_s is not None:
            out.append(_bode_verdict(self.outputs, self.bode, self.omega_rad_s))
        if self.unstable:
            listed = ", ".join(f"{s.real:.3g}{s.imag:+.3g}j" if s.imag else f"{s.real:.3g}" for s in self.unstable)
            out.append(
                f"the model is unstable (poles at {listed} rad/s): beyond the records its predictions diverge, and "
                "within them the estimated initial state holds them near the data"
            )
        return tuple(out)


@on_one_thread
def evaluate(
    model: IdentifiedModel,
    identification_records: Sequence[FlightRecord],
    validation_records: Sequence[FlightRecord],
    truth: TrueSystem | None = None,
    noise_std: Mapping[str, float] | None = None,
) -> Evaluation:
    """Judge a model on the records that it was identified from and on others, and against the truth where it is known.

    Args:
        model: what an estimator returned.
        identification_records: prepared records that it was identified from.
        validation_records: prepared records that it has not seen; may be empty.
        truth: what is known of the system.
        noise_std: output -> standard deviation of one sample, SI, where it is known.

    Raises:
        EstimationError: no identification record, or a true response without ``omega`` or of a wrong shape.
        ChannelError: a record lacks a channel of the model.
        RecordError: a record's sample time is not the model's.

    Example:
        >>> import testbench as tb
        >>> scores = tb.evaluate(model, [record], [held_out])  # doctest: +SKIP
        >>> scores.validation.mrse_percent  # doctest: +SKIP
    """
    if not identification_records:
        raise EstimationError("an evaluation needs the records that the model was identified from, got none")
    truth = truth or TrueSystem()
    sets = model.poles()
    matches: list[PoleMatch] = []
    if truth.poles:
        from testbench.evaluation.modes import match_poles

        for names, poles in sets.items():
            matches += match_poles(poles, truth.poles, names)
    bode, compared = None, None
    if truth.response is not None:
        bode, compared = _compare_responses(model, truth.response, truth.omega)
    unstable = {complex(s) for poles in sets.values() for s in poles if s.real > 0.0 and s.imag >= 0.0}
    return Evaluation(
        outputs=model.outputs,
        identification=_score(model, identification_records, noise_std, model.simulate),
        validation=_score(model, validation_records, noise_std, getattr(model, "predict", model.simulate)),
        poles=tuple(matches),
        bode=bode,
        omega_rad_s=compared,
        unstable=tuple(sorted(unstable, key=abs)),
        parameters=_parameters(model, truth.parameters),
        excited=truth.excited,
    )


def _parameters(model: IdentifiedModel, truth: Mapping[str, float] | None) -> tuple[ParameterEstimate, ...]:
    from testbench.estimators.parametric.model import ParametricModel

    if not isinstance(model, ParametricModel):
        return ()
    from testbench.evaluation.derivatives import parameter_estimates

    return parameter_estimates(model, truth)


def _score(
    model: IdentifiedModel,
    records: Sequence[FlightRecord],
    noise_std: Mapping[str, float] | None,
    predicted: Callable[[FlightRecord], FloatArray],
) -> Scores:
    p = len(model.outputs)
    if not records:
        return Scores(np.full(p, np.nan), np.full(p, np.nan), ())
    parts = [record.select(model.outputs) for record in records]
    # an unstable model may overflow: that becomes an infinite error, not a warning
    with np.errstate(over="ignore", invalid="ignore"):
        predictions = tuple(np.asarray(predicted(record), dtype=np.float64) for record in records)
    y, yhat = np.vstack([part.data for part in parts]), np.vstack(predictions)
    valid = np.vstack([part.valid for part in parts])
    noise = None
    if noise_std is not None:
        std = np.array([noise_std[o] for o in model.outputs])
        size = np.sqrt(np.sum(np.where(valid, y, 0.0) ** 2, axis=0))
        noise = 100.0 * std * np.sqrt(valid.sum(axis=0)) / np.maximum(size, 1e-300)
    with np.errstate(over="ignore", invalid="ignore"):
        squares = np.sum(np.where(valid, y - yhat, 0.0) ** 2, axis=0)
    rms = np.sqrt(squares / np.maximum(valid.sum(axis=0), 1))
    return Scores(mrse_percent(y, yhat, valid), fit_percent(y, yhat, valid), predictions, noise, rms)


def _compare_responses(
    model: IdentifiedModel, true_response: Callable[[FloatArray], ComplexArray] | ComplexArray, omega: FloatArray | None
) -> tuple[BodeError, FloatArray]:
    if omega is None:
        raise EstimationError("comparing frequency responses needs the frequencies omega, got none")
    omega = np.atleast_1d(np.asarray(omega, dtype=np.float64))
    true = np.asarray(true_response(omega) if callable(true_response) else true_response)
    below = omega <= np.pi / model.dt_s
    shape = (omega.size, len(model.outputs), len(model.inputs))
    if true.shape != shape or not below.any():
        raise EstimationError(
            f"the true response must have shape (frequencies, outputs, inputs) = {shape} and a frequency below the "
            f"model's Nyquist frequency {np.pi / model.dt_s:.4g} rad/s, got shape {true.shape} and "
            f"{int(below.sum())} such frequencies"
        )
    return bode_error(model.frequency_response(omega[below]), true[below]), omega[below]


def _prediction_verdict(name: str, outputs: Sequence[str], scores: Scores, untested: Sequence[str] = ()) -> str:
    if not scores.predictions:
        return f"{name}: no records, so the prediction of the model is unknown"
    errors = dict(zip(outputs, scores.mrse_percent.tolist(), strict=True))
    overflow = [o for o, e in errors.items() if not np.isfinite(e)]
    if overflow:
        return f"{name}: the prediction of {', '.join(overflow)} diverges; the model does not predict"
    listed = ", ".join(f"{o} {percent_in_words(e)}" for o, e in errors.items())
    judged = {o: e for o, e in errors.items() if o not in untested}
    good = [o for o, e in judged.items() if e <= GOOD_MRSE_PERCENT]
    useless = [o for o, e in judged.items() if e >= USELESS_MRSE_PERCENT]
    if not judged:
        word = ""
    elif useless:
        word = f"{', '.join(useless)} no better than predicting no motion at all"
    elif len(good) == len(judged):
        word = f"{'all outputs' if not untested else ', '.join(good)} predicted well"
    else:
        word = f"{', '.join(o for o in judged if o not in good)} predicted in part only"
    if untested:
        few = (
            f"{', '.join(untested)} {'errs' if len(untested) == 1 else 'err'} there no more than in the fit, and "
            f"{'moves' if len(untested) == 1 else 'move'} too little to test it"
        )
        word = f"{word}; {few}" if word else few
    return f"{name}: MRSE {percent_in_words(scores.mrse_mean)} ({listed}): {word}"


def _pole_verdict(match: PoleMatch) -> str:
    where = f" ({match.outputs})" if match.outputs else ""
    if match.found is None or match.wn_error_percent is None or match.zeta_error is None:
        if match.found is not None:
            return f"{match.name}{where}: found at {abs(match.found):.3g} rad/s, true pole at the origin"
        near = f"{match.true.real:.3g} 1/s" if _real(match.true) else f"{abs(match.true):.3g} rad/s"
        return f"{match.name}{where}: not found; no pole of the model lies near {near}"
    close = abs(match.wn_error_percent) <= CLOSE_WN_PERCENT and abs(match.zeta_error) <= CLOSE_ZETA
    word = "found" if close else "found, with an error"
    if _real(match.true) and _real(match.found):
        return f"{match.name}{where}: {word}; {match.found.real:.3g} 1/s ({match.wn_error_percent:+.2g} %)"
    return (
        f"{match.name}{where}: {word}; wn {abs(match.found):.3g} rad/s "
        f"({match.wn_error_percent:+.2g} %), zeta off by {match.zeta_error:+.2g}"
    )


def _real(pole: complex) -> bool:
    return pole.imag == 0.0 and pole.real != 0.0


def _bode_verdict(outputs: Sequence[str], bode: BodeError, omega: FloatArray) -> str:
    listed = ", ".join(f"{o} {e:.2g} dB" for o, e in zip(outputs, bode.magnitude_db.tolist(), strict=True))
    word = "within" if np.all(bode.magnitude_db <= CLOSE_DB) else "not within"
    return (
        f"frequency response from {omega.min():.3g} to {omega.max():.3g} rad/s: {word} {CLOSE_DB:g} dB ({listed}, rms)"
    )
