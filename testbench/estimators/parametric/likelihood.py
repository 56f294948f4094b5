"""The output-error cost of a set of records as a function of parameters, initial states, offsets and input biases."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.hold import held as which_held
from testbench.estimators.hold import said_of_hold
from testbench.estimators.parametric.gauss_newton import Problem, Sensitivities, believed_alone, in_blocks, reduced
from testbench.estimators.parametric.model import ParametricModel, named, output_offsets
from testbench.estimators.parametric.response import Sampling, delayed, later, respond, responses
from testbench.estimators.parametric.structure import ModelStructure
from testbench.estimators.settings import OutputError, Simulated
from testbench.estimators.structured import Fitted

_EXACT = 1e-12  # residuals below this share of an output's size are rounding
_LATE_STEP = 0.05  # of a sample, over which the derivative by an input's lateness is taken
_KEPT = 8_000_000  # sensitivities of a point, in numbers, that are kept for when it is asked for again


@dataclass(frozen=True, eq=False)
class Stretch:
    """One record, as the search uses it: inputs (N, m), outputs (N, p), which of them count, offsets (N, p, b)."""

    u: FloatArray
    y: FloatArray
    valid: NDArray[np.bool_]
    offsets: FloatArray
    x0: FloatArray


class Nuisances(NamedTuple):
    """What belongs to one record: initial state, empty unless estimated, output offsets, input biases, lateness, s."""

    initial: FloatArray
    offsets: FloatArray
    biases: FloatArray
    late_s: FloatArray


class Layout(NamedTuple):
    """Which entries of the search point are what: f parameters first, then the nuisances of every record.

    ``states`` are those whose initial values may be estimated: all but the followers, which come last. ``late`` are the
    inputs whose time against the outputs is unknown, with ``late_std_s`` the standard deviations of its prior.
    """

    chosen: NDArray[np.intp]
    free_states: bool
    biased_inputs: tuple[int, ...]
    states: int
    offsets: int
    late: tuple[int, ...] = ()
    late_std_s: tuple[float, ...] = ()

    @property
    def initial(self) -> int:
        """Number of initial states that are estimated per record."""
        return self.states if self.free_states else 0

    @property
    def per_record(self) -> int:
        """Number of nuisances of one record."""
        return self.initial + self.offsets + len(self.biased_inputs) + len(self.late)

    def nuisances(self, record: int) -> slice:
        """Return where those of a record are."""
        start = self.chosen.size + record * self.per_record
        return slice(start, start + self.per_record)

    def felt(self, record: int) -> NDArray[np.intp]:
        """Return the unknowns that a record feels: the parameters, then its own nuisances."""
        own = self.nuisances(record)
        return np.concatenate([np.arange(self.chosen.size), np.arange(own.start, own.stop)])

    def split(self, point: FloatArray, record: int) -> Nuisances:
        """Return what of the search point belongs to one record."""
        sizes = [self.initial, self.offsets, len(self.biased_inputs)]
        return Nuisances(*np.split(point[self.nuisances(record)], np.cumsum(sizes)))

    def begin(self, initial: FloatArray, x0: FloatArray) -> FloatArray:
        """Return the initial state (n,): the values estimated, then those of ``x0`` (n,) that are not."""
        return np.concatenate([initial, x0[initial.size :]])

    def embedded(self, covariance: FloatArray, k: int) -> FloatArray:
        """Return the (k, k) covariance of all parameters from that of the free ones (f, f); fixed ones have zero."""
        out = np.zeros((k, k))
        out[np.ix_(self.chosen, self.chosen)] = covariance
        return out


def held_inputs(
    inputs: Sequence[str], held: Sequence[str] | None, records: Sequence[FlightRecord] = ()
) -> tuple[NDArray[np.bool_], tuple[str, ...]]:
    """Return which inputs are held from sample to sample, and the names of those of which only the records say so.

    Held are those named; if none were, commands, and others that the records show to be held.

    Raises:
        EstimationError: a name is not one of the inputs.
    """
    for name in held or ():
        if name not in inputs:
            raise EstimationError(f"held inputs must be among {', '.join(inputs)}, got '{name}'")
    found, recognised = which_held(inputs, [None if held is None else name in held for name in inputs], records)
    return np.array(found, bool), recognised


class Driven(NamedTuple):
    """How the inputs of a structure act: known delays, s, (m,); which are held between samples, (m,), and the names of
    those of which only the records say so."""

    delays_s: FloatArray
    held: NDArray[np.bool_]
    recognised: tuple[str, ...] = ()

    @classmethod
    def of(cls, settings: Fitted, structure: ModelStructure, records: Sequence[FlightRecord]) -> Driven:
        """Return what settings say of the inputs, and records where these do not.

        Raises:
            EstimationError: a name is not one of the inputs.
        """
        delays = named(settings.delays_s, structure.inputs, "a delay")
        return cls(delays, *held_inputs(structure.inputs, settings.held, records))

    def model(self, structure: ModelStructure, settings: Mapping[str, Any], **found: Any) -> ParametricModel:
        """Return the model of a structure whose inputs act so, with what a method found and the settings that it had.

        ``delays_s`` are the known ones unless they were found, too.
        """
        return ParametricModel(
            inputs=structure.inputs,
            outputs=structure.outputs,
            structure=structure,
            settings={**settings, **said_of_hold(self.recognised)},
            held=tuple(self.held.tolist()),
            **{"delays_s": tuple(self.delays_s.tolist()), **found},
        )


def lateness(
    layout: Layout, inputs: Sequence[str], nuisances: Sequence[Nuisances], covariance: FloatArray
) -> dict[str, list[dict[str, float]]]:
    """Return how late the inputs act in each record, s, and its standard errors, of the covariance of all unknowns."""
    names, std = [inputs[j] for j in layout.late], np.sqrt(np.diag(covariance))
    ends = [layout.nuisances(i).stop for i in range(len(nuisances))]
    errors = [std[end - len(names) : end] for end in ends]
    return {
        "lateness_s": [dict(zip(names, n.late_s.tolist(), strict=True)) for n in nuisances],
        "lateness_std_s": [dict(zip(names, e.tolist(), strict=True)) for e in errors],
    }


def delays_found(inputs: Sequence[str], delays_s: FloatArray, found: Mapping[str, Any]) -> tuple[float, ...]:
    """Return the delays (m,) of inputs with how late they are found to act, on average over records."""
    more = [float(np.mean([late.get(name, 0.0) for late in found["lateness_s"]])) for name in inputs]
    return tuple((delays_s + more).tolist())


def check_nuisances(structure: ModelStructure, settings: Simulated) -> None:
    """Check that the inputs and outputs that settings name are a structure's.

    Raises:
        EstimationError: with the name that is not.
    """
    for name in (*settings.input_biases, *settings.late_std_s):
        if name not in structure.inputs:
            raise EstimationError(
                f"an input bias or lateness belongs to an input ({', '.join(structure.inputs)}), got '{name}'"
            )
    for name in (*settings.output_biases, *settings.output_trends):
        if name not in structure.outputs:
            raise EstimationError(
                f"an output bias or trend belongs to an output ({', '.join(structure.outputs)}), got '{name}'"
            )


def stretch(record: FlightRecord, structure: ModelStructure, delays_s: FloatArray, settings: Simulated) -> Stretch:
    """Return the record as the search sees it, initial states where channels say them.

    Raises:
        EstimationError: initial states are "record" and a state is no channel of it.
        ChannelError: the record lacks a channel.
    """
    part = record.select(structure.outputs)
    u = delayed(record.columns(structure.inputs), record.dt_s, delays_s)
    t = record.t_s - record.t_s[0]
    offsets = output_offsets(structure.outputs, settings.output_biases, settings.output_trends, t)
    initial = settings.initial_states
    for state in structure.states:
        if initial == "record" and state not in record and state not in structure.begun:
            raise EstimationError(
                f"initial_states = 'record' needs every state as a channel, but the record lacks '{state}'; "
                "choose 'free'"
            )
    x0 = structure.initial_state(record, measured=initial != "zero")
    return Stretch(u, part.data, np.asarray(part.valid), offsets, x0)


class Likelihood:
    """Residuals, sensitivities and noise covariance of a structure over records.

    Args:
        structure: the equations.
        stretches: the records.
        layout: what is searched for.
        sampling: of the records.
        full: noise covariance with its off-diagonal elements.

    Raises:
        EstimationError: fewer valid samples than unknowns, an output that never moves, or outputs sampled at different
            times with a full covariance.
    """

    def __init__(
        self,
        structure: ModelStructure,
        stretches: Sequence[Stretch],
        layout: Layout,
        sampling: Sampling,
        full: bool = False,
    ) -> None:
        self.structure, self.stretches, self.layout = structure, stretches, layout
        self.sampling, self.full = sampling, full
        self._last: tuple[bytes, list[tuple[FloatArray, Sensitivities]]] | None = None
        self.unknowns = layout.chosen.size + len(stretches) * layout.per_record
        valid = np.vstack([s.valid for s in stretches])
        if full and np.any(valid != valid[:, :1]):
            raise EstimationError("a full noise covariance needs all outputs at the same samples; use 'diagonal'")
        self.counts = valid.sum(axis=0)
        if np.any(self.counts < 2) or valid.sum() <= self.unknowns:
            raise EstimationError(
                f"an estimate of {self.unknowns} unknowns needs more valid samples than that in all, and at least 2 of "
                f"every output; got {int(valid.sum())}; give more data or free less"
            )
        y = np.vstack([s.y for s in stretches])
        mean = np.sum(np.where(valid, y, 0.0), axis=0) / self.counts
        self.size = np.sqrt(np.sum(np.where(valid, y - mean, 0.0) ** 2, axis=0) / self.counts)
        if np.any(self.size == 0.0):
            name = structure.outputs[int(np.argmin(self.size))]
            raise EstimationError(f"output '{name}' never moves in these records; leave it out")
        prior = [p.prior_std for p in structure.parameters if p.free]
        own = [0.0] * (layout.per_record - len(layout.late)) + [1.0 / s for s in layout.late_std_s]
        self.prior_weight = np.array([0.0 if s is None else 1.0 / s for s in prior] + own * len(stretches))

    @classmethod
    def over(
        cls, records: Sequence[FlightRecord], structure: ModelStructure, driven: Driven, settings: Simulated
    ) -> Likelihood:
        """Return that of records driven so, and of what the settings leave to be estimated."""
        late = settings.late_std_s
        layout = Layout(
            np.flatnonzero(structure.free),
            settings.initial_states == "free",
            tuple(structure.inputs.index(name) for name in settings.input_biases),
            len(structure.states) - len(structure.followers),
            len(settings.output_biases) + len(settings.output_trends),
            tuple(structure.inputs.index(name) for name in late),
            tuple(late.values()),
        )
        stretches = [stretch(r, structure, driven.delays_s, settings) for r in records]
        full = isinstance(settings, OutputError) and settings.noise == "full"
        sampling = Sampling(records[0].dt_s, driven.held, settings.substeps)
        return cls(structure, stretches, layout, sampling, full)

    @classmethod
    def of(cls, model: ParametricModel, records: Sequence[FlightRecord]) -> Likelihood:
        """Return that of a model that was identified, over records: its unknowns, initial states free."""
        settings = OutputError(
            output_biases=model.biased,
            output_trends=model.trended,
            input_biases=model.biased_inputs,
            late_std_s=model.settings.get("late_std_s") or {},
            substeps=model.substeps,
        )
        return cls.over(records, model.structure, Driven(np.array(model.delays_s), np.array(model.held)), settings)

    def start(self, values: FloatArray) -> FloatArray:
        """Return the search point of parameters (k,): initial states as the records say, no offsets and biases."""
        layout = self.layout
        rest = np.zeros(layout.per_record - layout.initial)
        nuisances = [np.concatenate([s.x0[: layout.initial], rest]) for s in self.stretches]
        return np.concatenate([values[layout.chosen], *nuisances])

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return the bounds of the search point: those of the parameters, none for the rest."""
        low, high = self.structure.bounds
        free = np.full(self.unknowns - self.layout.chosen.size, np.inf)
        return np.concatenate([low[self.layout.chosen], -free]), np.concatenate([high[self.layout.chosen], free])

    def parameters(self, point: FloatArray, params: FloatArray) -> FloatArray:
        """Return ``params`` (k,) with the free ones taken from the search point."""
        out = params.copy()
        out[self.layout.chosen] = point[: self.layout.chosen.size]
        return out

    def evaluate(self, point: FloatArray, params: FloatArray) -> Iterator[tuple[FloatArray, Sensitivities]]:
        """Yield per record the residuals (N, p), zero where not valid, and their sensitivities.

        The last result is kept if it is small: a search asks for the same point again when the weights change.
        """
        key = point.tobytes() + params.tobytes()
        if self._last is not None and self._last[0] == key:
            return iter(self._last[1])
        found = self._evaluate(point, params)
        width = self.layout.chosen.size + self.layout.per_record
        if sum(s.y.size for s in self.stretches) * width <= _KEPT:
            self._last = key, list(found)
            return iter(self._last[1])
        return found

    def residuals(self, point: FloatArray, params: FloatArray) -> list[FloatArray]:
        """Return the residuals (N, p) of each record, zero where not valid."""
        return [v for v, _ in self.evaluate(point, params)]

    def _evaluate(self, point: FloatArray, params: FloatArray) -> Iterator[tuple[FloatArray, Sensitivities]]:
        layout = self.layout
        own = [layout.split(point, i) for i in range(len(self.stretches))]
        inputs = [self.driven(s.u, n) for s, n in zip(self.stretches, own, strict=True)]
        starts = [layout.begin(n.initial, s.x0) for s, n in zip(self.stretches, own, strict=True)]
        values = self.parameters(point, params)
        chosen = layout.chosen.tolist()
        found = responses(self.structure, values, chosen, inputs, self.sampling, starts, layout.biased_inputs)
        for i, (s, n, r) in enumerate(zip(self.stretches, own, found, strict=True)):
            moved_on = []
            for moved, step in self.acting_later(s.u, n):
                y = respond(self.structure, values, [], moved, self.sampling, starts[i]).y
                moved_on.append((y - r.y)[:, :, None] / step)
            residual = np.where(s.valid, s.y - r.y - s.offsets @ n.offsets, 0.0)
            J = -np.concatenate([r.dparams, r.dx0[:, :, : layout.initial], s.offsets, r.dbias, *moved_on], axis=2)
            J[~s.valid] = 0.0
            yield residual, Sensitivities(J, layout.felt(i))

    def driven(self, u: FloatArray, own: Nuisances) -> FloatArray:
        """Return the inputs (N, m) of a record with its biases, as late as they are there."""
        if not (own.biases.size or own.late_s.size):
            return u
        u = u.copy()
        u[:, list(self.layout.biased_inputs)] += own.biases
        late_s = np.zeros(u.shape[1])
        late_s[list(self.layout.late)] = own.late_s
        return later(u, self.sampling.dt_s, late_s)

    def acting_later(self, u: FloatArray, own: Nuisances) -> Iterator[tuple[FloatArray, float]]:
        """Yield the inputs (N, m) with each input that may be late a little later, and by how much, s."""
        step = _LATE_STEP * self.sampling.dt_s
        for one in np.eye(len(self.layout.late)):
            yield self.driven(u, own._replace(late_s=own.late_s + step * one)), step

    def problem(self, params: FloatArray, R: FloatArray) -> Problem:
        """Return residuals and Jacobian, weighted by the noise covariance R (p, p), with priors, as a function."""
        whiten = np.linalg.inv(np.linalg.cholesky(R))
        f = self.layout.chosen.size
        weight, centre = self.prior_weight[:f], self.structure.values[self.layout.chosen]
        alone = np.arange(self.unknowns + 1) >= f
        alone[-1] = False  # the residuals, last, meet in all records

        def parts(point: FloatArray) -> Iterator[tuple[Iterable[FloatArray], NDArray[np.intp]]]:
            for v, J in self.evaluate(point, params):
                own = believed_alone(J.columns, self.prior_weight, alone, point)
                yield chain(in_blocks(v, J, whiten), own), np.append(J.columns, self.unknowns)
            prior = np.column_stack([np.diag(weight), weight * (point[:f] - centre)])[weight > 0.0]
            yield [prior], np.append(np.arange(f), self.unknowns)

        return reduced(parts, alone)

    def noise(self, residuals: Sequence[FloatArray]) -> FloatArray:
        """Return the noise covariance (p, p) of residuals, floored at rounding."""
        v = np.vstack(residuals)
        R = v.T @ v / np.sqrt(np.outer(self.counts, self.counts))
        if not self.full:
            R = np.diag(np.diag(R))
        return np.asarray(R + np.diag((_EXACT * self.size) ** 2))

    def negative_log(self, cost: float, R: FloatArray) -> float:
        """Return the negative logarithm of the likelihood without constants, ``cost`` = sum v' R^-1 v."""
        if self.full:
            return 0.5 * cost + 0.5 * float(self.counts[0] * np.linalg.slogdet(R)[1])
        return 0.5 * cost + 0.5 * float(self.counts @ np.log(np.diag(R)))

    def names(self) -> list[str]:
        """Return a name for every unknown, for messages."""
        structure, layout = self.structure, self.layout
        out = [structure.parameter_names[i] for i in layout.chosen]
        for i in range(len(self.stretches)):
            of = f" of record {i + 1}" if len(self.stretches) > 1 else ""
            out += [f"initial {s}{of}" for s in structure.states[: layout.initial]]
            out += [f"output offset {j + 1}{of}" for j in range(layout.offsets)]
            out += [f"bias of {structure.inputs[j]}{of}" for j in layout.biased_inputs]
            out += [f"lateness of {structure.inputs[j]}{of}" for j in layout.late]
        return out
