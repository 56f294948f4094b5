"""Programs as they run: compiled by LLVM once each, and kept on disk where there is a place for it."""

from __future__ import annotations

import ctypes
import hashlib
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from typing import Any, NamedTuple

import llvmlite
import llvmlite.binding as llvm
import numpy as np
import numpy.typing as npt

from testbench.core.files import keep, kept_in, sources
from testbench.core.record import FloatArray
from testbench.flight.batch.emit import RUN, ground, module_of
from testbench.flight.batch.program import Program
from testbench.flight.batch.vector import LANES

SOURCES = sources("flight/batch")
"""Hash of the code of the batch."""
_READY = 256  # programs that are ready to run
_KEPT = 1024  # on disk, 70 MB: a library of effects on a few aircraft has some hundreds
_FLYING: OrderedDict[str, Flying] = OrderedDict()


class Machine:
    """Object code ready to run."""

    def __init__(self, code: bytes) -> None:
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _target())
        self._engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        self._engine.finalize_object()

    def address(self, name: str) -> int:
        """Return where a function begins."""
        return int(self._engine.get_function_address(name))

    def function(self, name: str, *takes: str) -> Callable[..., None]:
        """Return a function of arrays and whole numbers; ``takes`` says which, "ptr" or "i64"."""
        types = (ctypes.c_int64 if of.startswith("i64") else ctypes.c_void_p for of in takes)
        call = ctypes.CFUNCTYPE(None, *types)(self.address(name))
        return lambda *xs, engine=self._engine: call(*map(_passed, xs))  # which lives as long as its functions


def _passed(x: Any) -> int:
    """Return a number, or where an array begins: one number per flight in the last of several axes."""
    if isinstance(x, int):
        return x
    assert x.flags.c_contiguous
    assert x.ndim == 1 or x.shape[-1] == LANES
    address: int = x.__array_interface__["data"][0]  # several times as fast as ctypes
    return address


def aligned(count: int) -> FloatArray:
    """Return new registers (count, LANES) that begin with a line of the cache: what crosses one takes longer."""
    raw = np.empty(count * LANES + 7)
    first = -(_passed(raw) // 8) % 8
    return raw[first : first + count * LANES].reshape(count, LANES)


class Driven(NamedTuple):
    """What is written before each frame: values (frames, inputs, LANES), and the register of each input."""

    values: FloatArray
    registers: npt.NDArray[np.int64]


class Logged(NamedTuple):
    """What a flight leaves: a row every ``stride`` frames."""

    stride: int  # frames per row
    registers: npt.NDArray[np.int64]  # that make a row
    scale: FloatArray  # (logged, LANES) factor of each
    rows: FloatArray  # (rows, logged, LANES) that are filled


class Watched(NamedTuple):
    """Registers that have limits, and these (watched, LANES)."""

    registers: npt.NDArray[np.int64]
    low: FloatArray
    high: FloatArray


class Flying(Machine):
    """A program as it runs: ``before``, ``frame`` (which begins at ``frame_at``) and ``log`` change registers R."""

    def __init__(self, code: bytes) -> None:
        super().__init__(code)
        self.before, self.frame, self.log = (self.function(n, "ptr") for n in ("before", "frame", "logged"))
        self.frame_at, self._run = self.address("frame"), self.function("run", *RUN)

    def run(
        self, R: FloatArray, driven: Driven, logged: Logged, watched: Watched, ended: npt.NDArray[np.bool_]
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], FloatArray]:
        """Fly: inputs, frame, and at times a row, until every flight has left its limits.

        Args:
            R: (registers, LANES).
            driven: by these inputs.
            logged: in these rows.
            watched: against these limits.
            ended: (LANES,) flights that are not looked at: they have ended, or only fill the block.

        Returns:
            For each flight (LANES,) the row at which it left its limits, or -1, which limit it broke, and with what.
        """
        left, broken, value = np.where(ended, 0.0, -1.0), np.zeros(LANES), np.zeros(LANES)
        rows, targets = logged.rows, driven.registers
        assert len(driven.values) >= len(rows) * logged.stride or not targets.size
        self._run(
            R, driven.values, targets, targets.size, logged.stride, logged.registers, logged.registers.size,
            logged.scale, rows, len(rows), watched.registers, watched.registers.size, watched.low, watched.high,
            left, broken, value,
        )  # fmt: skip
        return left.astype(np.int64), broken.astype(np.int64), value


class Ground(Machine):
    """What prepares flights of any program.

    Attributes:
        place: sets the state in registers to height (ft), phi, theta, psi, velocity (3, ft/s) and rates (3, rad/s) of
            an array (10, LANES).
        settle: places so, and evaluates the forces by the frame at an address, a number of times, while time stands
            still.
        weigh: inverts the inertia in registers.
    """

    def __init__(self, code: bytes) -> None:
        super().__init__(code)
        self.place, self.weigh = self.function("place", "ptr", "ptr"), self.function("weigh", "ptr")
        self.settle = self.function("settle", "ptr", "ptr", "ptr", "i64")


def machine_of(program: Program) -> Flying:
    """Return a program as it runs, compiled if it is not on disk."""
    parts = (program.before, program.frame, program.log, program.tables)
    of = hashlib.sha256(b"".join(x.tobytes() for x in parts) + repr([len(x) for x in parts]).encode()).hexdigest()
    if of not in _FLYING:
        _FLYING[of] = Flying(_kept(of, partial(module_of, program)))
        if len(_FLYING) > _READY:
            _FLYING.popitem(last=False)
    _FLYING.move_to_end(of)  # what has not flown for longest gives way
    return _FLYING[of]


@cache
def on_ground() -> Ground:
    """Return what prepares flights."""
    return Ground(_kept("ground", ground))


def _kept(of: str, text: Callable[[], str]) -> bytes:
    """Return the code of what is known by ``of``, from disk if it is there."""
    cpu = llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
    key = hashlib.sha256(repr((of, SOURCES, llvmlite.__version__, llvm.get_process_triple(), cpu)).encode())
    place = kept_in("batch")
    file = None if place is None else place / f"{key.hexdigest()[:32]}.o"
    with suppress(OSError):
        kept = b"" if file is None else file.read_bytes()
        if hashlib.sha256(kept[32:]).digest() == kept[:32]:
            return kept[32:]
    code = object_code(text())
    if file is not None:
        keep(file, hashlib.sha256(code).digest() + code)
        with suppress(OSError):  # another process may remove them at the same time
            for old in sorted(file.parent.glob("*.o"), key=lambda x: x.stat().st_mtime)[:-_KEPT]:
                old.unlink()
    return code


def object_code(text: str) -> bytes:
    """Return what LLVM makes of a module."""
    code: bytes = _target().emit_object(llvm.parse_assembly(text))
    return code


def _target() -> llvm.TargetMachine:
    """Return a new one: that which links object code belongs to it from then on."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    cpu, features = llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
    return llvm.Target.from_default_triple().create_target_machine(cpu=cpu, features=features, opt=2, jit=True)
