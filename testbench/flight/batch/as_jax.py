"""An aircraft as functions of JAX."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from testbench.aircraft import Aircraft
from testbench.aircraft.believed import AIRCRAFT_KEYS, varied
from testbench.core.errors import LimitError, MissingPackage, missing
from testbench.core.named import Named, obtain
from testbench.core.record import FloatArray
from testbench.flight.batch.alone import Alone, alone
from testbench.flight.batch.check import judged
from testbench.flight.condition import FlightCondition, TrimmedFlight
from testbench.flight.trim import trim

_AWAY = (0.1, -0.05)  # of what is large for a parameter: two changes, whose effects must be in proportion
_LARGE = {"coefficient": 1.0, "cg_x_m": 1.0, "cg_y_m": 1.0, "cg_z_m": 1.0}
_PERCENT = 100.0
_PROPORTION = 1e-9


@dataclass(frozen=True, eq=False)
class JaxAircraft:
    """An aircraft whose flight is a chain of pure functions.

    Attributes:
        step: (state, inputs) -> state after ``dt_s``, also (state, inputs, parameters).
        outputs: (state) -> channels (outputs,), SI, also (state, parameters).
        begin: (parameters) -> the state at the motion and the commands of the trim. Other parameters have other forces
            there, which ``state`` remembers of the aircraft as it is.
        state: (states,) at the trim, in no unit that is of use elsewhere.
        inputs: (inputs,) at the trim: absolute commands of the controls (rad; 1 for the throttle), then the velocity of
            the air (north, east, down: where it moves to, m/s).
        parameters: (parameters,) as the aircraft is: 1 for a factor, 0 for a change.
        input_names: of ``inputs``, as the table of channels has them.
        output_names: of what ``outputs`` returns, as the table of channels has them.
        parameter_names: as they were given.
        dt_s: frame time, s.
    """

    step: Callable[..., Any]
    outputs: Callable[..., Any]
    begin: Callable[..., Any]
    state: Any
    inputs: Any
    parameters: Any
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    parameter_names: tuple[str, ...]
    dt_s: float


def as_jax(
    aircraft: Named[Aircraft], start: FlightCondition | TrimmedFlight | None = None, parameters: Sequence[str] = ()
) -> JaxAircraft:
    """Return an aircraft as pure functions that ``jax.jit``, ``jax.vmap`` and ``jax.grad`` take.

    They are the program that batches fly by, compared with JSBSim as there. Derivatives are exact; at a limit, a switch
    or the edge of a table they are those of one side. A flight that goes wrong is NaN. There is no ground.

    Args:
        aircraft: what flies.
        start: where ``state`` lies; the design condition if not given.
        parameters: ``coefficient.NAME``, a factor on a coefficient, or ``aircraft.mass_percent`` and its like, a change
            (:func:`testbench.tangents` lists them); the trim stays that of the aircraft as it is.

    Raises:
        MissingPackage: JAX is not installed.
        LimitError: JAX computes with 32 bits, the aircraft is not found equal to JSBSim in a batch, or a parameter is
            none of these, or does not change numbers of the model in proportion.
        TrimError: there is no trim at ``start``.

    Example:
        >>> import testbench as tb
        >>> try:
        ...     import jax
        ... except ImportError:
        ...     found = "pip install '.[jax]'"
        ... else:
        ...     jax.config.update("jax_enable_x64", True)
        ...     plane = tb.as_jax("taurus")
        ...     found = plane.input_names[:2]
        >>> found if isinstance(found, tuple) else ("de_cmd", "da_cmd")
        ('de_cmd', 'da_cmd')
    """
    try:
        import jax
    except ImportError as error:
        raise MissingPackage(missing("an aircraft in JAX needs jax", "jax")) from error
    if not jax.config.read("jax_enable_x64"):
        raise LimitError(
            "JAX must compute with 64 bits, as heights are differences of 6.4e6 m, got 32; "
            'call jax.config.update("jax_enable_x64", True) first'
        )
    from testbench.flight.batch.jaxed import Frames

    names = tuple(parameters)
    at = np.array([_nominal(name) for name in names])
    own = obtain(Aircraft, aircraft)
    plane = _with(own, names, at)
    if not isinstance(start, TrimmedFlight):
        start = trim(plane, start or FlightCondition(plane.design_V_m_s, plane.design_h_m))
    model = alone(plane, start)
    frames = Frames(model, _changed(own, model, names, at), at)
    return JaxAircraft(
        frames.step, frames.outputs, frames.begin, frames.state, jax.numpy.array([x.at_trim for x in model.inputs]),
        jax.numpy.array(at), tuple(x.name for x in model.inputs), tuple(x.name for x in model.outputs), names,
        model.dt_s,
    )  # fmt: skip


def _nominal(name: str) -> float:
    head, _, rest = name.partition(".")
    if (head == "coefficient" and rest) or (head == "aircraft" and rest in AIRCRAFT_KEYS):
        return float(head == "coefficient")
    known = ", ".join(("coefficient.NAME", *(f"aircraft.{key}" for key in AIRCRAFT_KEYS)))
    raise LimitError(f"a parameter must be one of {known}, got '{name}'")


def _with(aircraft: Aircraft, names: Sequence[str], values: FloatArray) -> Aircraft:
    return varied(aircraft, dict(zip(names, values.tolist(), strict=True)), "parameters", "parameters of JAX")


def _changed(aircraft: Aircraft, model: Alone, names: Sequence[str], at: FloatArray) -> dict[int, FloatArray]:
    """Return register -> its slopes (parameters,), found by two changes of each and one of all.

    Raises:
        LimitError: registers do not change in proportion.
    """
    if not names:
        return {}

    def at_rest(values: FloatArray) -> FloatArray:
        found = judged(_with(aircraft, names, values), model.trimmed).model
        if found is None or found.program is not model.program:
            raise LimitError(f"{', '.join(names)} must change numbers of the model only, but change what it computes")
        return found.start

    here = at_rest(at)
    large = np.array([_LARGE.get(n.partition(".")[0], _LARGE.get(n.partition(".")[2], _PERCENT)) for n in names])
    slopes = np.zeros((here.size, len(names)))
    for j in range(len(names)):
        away = _AWAY[0] * large[j]
        slopes[:, j] = (at_rest(at + away * np.eye(len(names))[j]) - here) / away
    together = at_rest(at + _AWAY[1] * large)
    off = np.abs(together - here - slopes @ (_AWAY[1] * large)) > _PROPORTION * (np.abs(here) + np.abs(together))
    if off.any():
        raise LimitError(
            f"{', '.join(names)} must change numbers of the model in proportion, but {int(off.sum())} of them are not; "
            "leave out one that acts on the same numbers as another"
        )
    return {int(row): slopes[row] for row in np.flatnonzero(np.any(slopes != 0.0, axis=1))}
