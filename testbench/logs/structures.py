"""Structures of MATLAB as tables: which field holds times and which samples, and the path to each.

A path is written as in MATLAB: ``data.flight.alpha``, ``runs(2).q``, ``d.InputData{1}``. Read are structures of
vectors, structures of structures with values and units (and times: those of a timeseries), structure arrays of scalars
(one structure a sample), matrices
(``y[1]``, ``y[2]``), Simulink's structure with time, and the fields of an iddata object.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from testbench.core.errors import RecordError, nearest
from testbench.core.record import FloatArray
from testbench.logs.mat import CellArray, Opaque, StructArray
from testbench.logs.names import clock_called

_STEP = re.compile(r"\.?([A-Za-z_]\w*)|\((\d+)\)|\{(\d+)\}")
_VALUES = ("data", "values", "value", "samples")
_UNITS = ("units", "unit", "uom")
_FACTS = ("datainfo", "timeinfo", "qualityinfo", "userdata", "events")  # beside the samples of struct(timeseries)
_MOST = 12  # paths that a message lists
_SAVE = "save('flight.mat', '-struct', 's', '-v7')"
_PLAIN = {
    "table": f"s = table2struct({{v}}, 'ToScalar', true); {_SAVE}",
    "timetable": "s = table2struct(timetable2table({v}, 'ConvertRowTimes', false), 'ToScalar', true); "
    f"s.t = seconds({{v}}.Properties.RowTimes - {{v}}.Properties.RowTimes(1)); {_SAVE}",
    "timeseries": f"s = struct('t', {{v}}.Time, 'q', squeeze({{v}}.Data)); {_SAVE} (q: the name of its channel)",
    "iddata": "s = struct('InputData', {v}.InputData, 'OutputData', {v}.OutputData, 'Ts', {v}.Ts); " + _SAVE,
    "datetime": f"s = struct('t', seconds({{v}} - {{v}}(1))); {_SAVE}, with the other columns in s",
    "duration": f"s = struct('t', seconds({{v}})); {_SAVE}, with the other columns in s",
    "Simulink.SimulationData.Dataset": "x = {v}.getElement(1).Values; s = struct('t', x.Time, 'q', squeeze(x.Data)); "
    f"{_SAVE} (q: the name of its channel)",
}


class Series(NamedTuple):
    """Columns found in a structure."""

    root: str  # path of the structure that the names count from, "" for the whole file
    columns: dict[str, FloatArray]  # name -> (n,) samples; all of one length
    units: dict[str, str]  # name -> unit that the structure states
    others: dict[str, FloatArray]  # name -> (k,) samples of vectors of other lengths


class _Leaf(NamedTuple):
    path: str
    values: FloatArray
    unit: str


def follow(content: Mapping[str, Any], path: str, file: object) -> Any:
    """Return what lies at ``path`` in the variables of a file.

    Raises:
        RecordError: nothing lies there; the message lists the paths that exist.
    """
    if path in content:
        return content[path]
    value: Any = content
    place = 0
    while place < len(path):
        step = _STEP.match(path, place)
        number = int(step[2] or step[3] or 1) if step else 0
        if step and step[1] and isinstance(value, Mapping) and step[1] in value:
            value = value[step[1]]
        elif step and step[2 if isinstance(value, StructArray) else 3] and isinstance(value, StructArray | CellArray) \
                and 1 <= number <= len(value.items):  # fmt: skip
            value = value.items[number - 1]
        else:
            known = [p for p, _ in outline(content)]
            hint = nearest(path, known) or (f"; it holds {listed(content)}" if known else "")
            raise RecordError(f"'{file}' must hold the variable '{path}', got none{hint}")
        place = step.end()
    return value


def outline(value: Any, root: str = "") -> Iterator[tuple[str, str]]:
    """Yield the path of all that a structure holds, and what it is in words."""
    dot = f"{root}." if root else ""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from outline(inner, dot + name)
    elif isinstance(value, np.ndarray):
        yield root, " x ".join(map(str, value.shape))
    elif isinstance(value, StructArray):
        fields = ", ".join(value.items[0]) if value.items else "nothing"
        yield root, f"structure array {' x '.join(map(str, value.shape))} of {fields}"
    elif isinstance(value, CellArray):
        yield root, f"cell array {' x '.join(map(str, value.shape))}"
    elif isinstance(value, Opaque):
        yield root, f"object of class {value.kind}"


def candidates(content: Mapping[str, Any]) -> list[str]:
    """Return the paths that may be given as the variable to read: matrices, structures and elements of arrays."""
    paths: dict[str, None] = {}
    for path, what in outline(content):
        parts = path.split(".")
        paths.update({".".join(parts[:i]): None for i in range(1, len(parts) + (" x " in what))})
        if what.startswith(("structure array", "cell array")):
            paths.update({f"{path}(1)" if what.startswith("structure") else f"{path}{{1}}": None})
    return list(paths)


def listed(value: Any, root: str = "") -> str:
    """Return the first paths inside a structure, with what each is."""
    found = [f"{path} ({what})" for path, what in outline(value, root)]
    return ", ".join(found[:_MOST]) + (f" and {len(found) - _MOST} more" if len(found) > _MOST else "")


def series(value: Any, root: str, file: object, units: Mapping[str, str] | None = None) -> Series:
    """Return the columns that a structure holds, or the variables of a whole file.

    Args:
        value: what lies at ``root``.
        root: its path; "" for the whole file, in which a single structure is entered.
        file: for messages.
        units: name -> unit, of names that state none.

    Raises:
        RecordError: it holds no samples, or several groups with times of their own, or what only MATLAB can read.
    """
    while isinstance(value, CellArray) and len(value.items) == 1:
        value, root = value.items[0], f"{root}{{1}}"
    if not root:
        big = [name for name, inner in value.items() if _is_big(inner)]
        if len(big) == 1 and not isinstance(value[big[0]], np.ndarray):
            return series(value[big[0]], big[0], file, _units_in(value))
    _refuse_kind(value, root, file)
    leaves = list(_leaves(value, ""))
    clocks = [leaf for leaf in leaves if clock_called(leaf.path)[0] and min(leaf.values.shape) == 1 < leaf.values.size]
    groups: dict[str, _Leaf] = {}
    for leaf in clocks:
        parent = leaf.path.rpartition(".")[0]
        if not any(np.array_equal(leaf.values.ravel(), other.values.ravel()) for other in groups.values()):
            groups.setdefault(parent, leaf)
    apart = _with_own_times(leaves, clocks) if len(groups) > 1 and "" not in groups else None
    if apart is not None:
        return _together(root, apart)
    if len(groups) > 1 and "" not in groups:
        names = ", ".join(_join(root, parent) for parent in groups)
        raise RecordError(
            f"one group of '{file}' must be chosen, because its structures have times of their own; in a description "
            f"give variable = one of {names}"
        )
    count = max((leaf.values.size for leaf in clocks), default=0) if "" not in groups else groups[""].values.size
    if not clocks:
        wide = [leaf for leaf in leaves if min(leaf.values.shape) > 1]
        count = max((leaf.values.size for leaf in leaves), default=0)
        if wide or count < 2:
            raise RecordError(
                f"which variable of '{file}' holds the samples must be said; in a description give variable = one of "
                f"{', '.join(_join(root, leaf.path) for leaf in wide) or 'those with numbers'}: it holds "
                f"{listed(value, root) or 'no numbers'}"
            )
    found = Series(root, {}, {}, {})
    for leaf in leaves:
        if leaf in clocks and any(leaf is not kept and _same(leaf, kept) for kept in groups.values()):
            continue  # the same times again
        values = leaf.values.T if leaf.values.shape[1] == count != leaf.values.shape[0] else leaf.values
        stated = leaf.unit or (units or {}).get(leaf.path, "")
        if values.shape[0] != count:
            if min(values.shape) == 1 < values.size:
                found.others[leaf.path] = values.ravel()
            continue
        for k, column in enumerate(values.T, start=1):
            name = leaf.path if values.shape[1] == 1 else f"{leaf.path}[{k}]"
            found.columns[name], found.units[name] = column, stated
    return found


def _with_own_times(leaves: Sequence[_Leaf], clocks: Sequence[_Leaf]) -> list[tuple[_Leaf, _Leaf]] | None:
    """Return every signal with its times, if each structure is one signal with times of its own; else None."""
    times = {clock.path.rpartition(".")[0]: clock for clock in clocks}
    signals = [leaf for leaf in leaves if not any(leaf is clock for clock in clocks) and leaf.values.size > 1]
    whole = all(s.path in times and s.values.size == times[s.path].values.size for s in signals)
    return [(s, times[s.path]) for s in signals] if signals and whole else None


def _together(root: str, signals: Sequence[tuple[_Leaf, _Leaf]]) -> Series:
    """Return signals with times of their own: those that share the times of most are columns, others have t_NAME."""
    shared = [sum(_same(clock, other) for _, other in signals) for _, clock in signals]
    main = signals[max(range(len(signals)), key=lambda i: (shared[i], signals[i][1].values.size))][1]
    found = Series(root, {"t": main.values.ravel()}, {"t": main.unit}, {})
    for signal, clock in signals:
        if _same(clock, main):
            found.columns[signal.path], found.units[signal.path] = signal.values.ravel(), signal.unit
        else:
            found.others[signal.path], found.others[f"t_{signal.path}"] = signal.values.ravel(), clock.values.ravel()
            found.units[signal.path] = signal.unit
    return found


def _units_in(value: Mapping[str, Any]) -> dict[str, str]:
    """Return the units that a structure of text called units gives for the fields beside it."""
    units = value.get("units")
    return {k: v for k, v in units.items() if isinstance(v, str)} if isinstance(units, Mapping) else {}


def _same(one: _Leaf, other: _Leaf) -> bool:
    return np.array_equal(one.values.ravel(), other.values.ravel())


def _join(root: str, path: str) -> str:
    return f"{root}.{path}" if root and path else root or path


def _is_big(value: Any) -> bool:
    """Say whether a variable may hold samples: text, single numbers and structures of text do not."""
    if isinstance(value, Mapping):
        return any(map(_is_big, value.values()))
    return not isinstance(value, str) and value is not None and not (isinstance(value, np.ndarray) and value.size < 2)


def _refuse_kind(value: Any, root: str, file: object) -> None:
    if isinstance(value, Opaque):
        how = _PLAIN.get(value.kind, f"s = struct({{v}}); {_SAVE}, with vectors in its fields").format(v=root or "x")
        raise RecordError(
            f"'{root}' in '{file}' must be numbers or a structure, but it is an object of class {value.kind}, which "
            f"only MATLAB can read; convert it there: {how}"
        )
    if isinstance(value, StructArray) and not _of_scalars(value):
        inside = listed(value.items[0], f"{root}(1)") if value.items else "nothing"
        raise RecordError(
            f"'{root}' in '{file}' must be one flight, but it is a structure array of {len(value.items)}, with "
            f'{inside}; in a description give variable = "{root}(1)" to "{root}({len(value.items)})"'
        )
    if isinstance(value, CellArray):
        inside = ", ".join(f"{root}{{{i}}}" for i in range(1, min(len(value.items), 3) + 1))
        raise RecordError(
            f"'{root}' in '{file}' must be one flight, but it is a cell array of {len(value.items)}; in a description "
            f"give variable = one of {inside}{', ...' if len(value.items) > 3 else ''}"
        )
    objects = [(path, what) for path, what in outline(value, root) if what.startswith("object of class")]
    if objects and isinstance(value, Mapping) and not any(True for _ in _leaves(value, "")):
        path, what = objects[0]
        _refuse_kind(Opaque(what.removeprefix("object of class ")), path, file)
    if not isinstance(value, Mapping | StructArray | np.ndarray):
        raise RecordError(f"'{root}' in '{file}' must hold numbers, but it is {'text' if value else 'empty'}")


def _of_scalars(value: StructArray) -> bool:
    """Say whether each structure is one sample: its numbers are single ones."""
    numeric = [v for item in value.items for v in item.values() if isinstance(v, np.ndarray)]
    return len(value.items) > 1 and bool(numeric) and all(v.size <= 1 for v in numeric)


def _leaves(value: Any, path: str) -> Iterator[_Leaf]:
    """Yield all numbers inside a structure, with their paths from it and their units."""
    while isinstance(value, CellArray) and len(value.items) == 1:
        value = value.items[0]
    if isinstance(value, np.ndarray):
        squeezed = np.squeeze(value)
        if value.size and squeezed.ndim <= 2:
            columns: FloatArray = np.atleast_2d(squeezed.T).T
            yield _Leaf(path, columns, "")
    elif isinstance(value, StructArray):
        if _of_scalars(value):
            for name in value.items[0]:
                column = [item.get(name) for item in value.items]
                numbers = [float(v.item()) if isinstance(v, np.ndarray) and v.size else np.nan for v in column]
                if np.isfinite(numbers).any():
                    samples: FloatArray = np.array([numbers], dtype=np.float64)
                    yield _Leaf(_join(path, name), samples.T, "")
    elif isinstance(value, Mapping):
        lower = {name.lower(): name for name in value}
        if {"inputdata", "outputdata"} <= set(lower) or "signals" in lower:
            yield from _leaves_of_a_kind(value, lower, path)
            return
        held = next((lower[name] for name in _VALUES if name in lower), None)
        beside = [n for n in value if n != held and not (n.lower() in (*_UNITS, *_FACTS) or clock_called(n)[0])]
        if held and path and not any(isinstance(value[n], np.ndarray | StructArray | Mapping) for n in beside):
            facts = value.get(lower.get("datainfo", ""))
            said = {**({k.lower(): v for k, v in facts.items()} if isinstance(facts, Mapping) else {}),
                    **{n: value[lower[n]] for n in _UNITS if n in lower}}  # fmt: skip
            unit = next((said[n] for n in _UNITS if isinstance(said.get(n), str)), "")
            yield from (_Leaf(path, leaf.values, unit) for leaf in _leaves(value[held], path))
            rest = {n: v for n, v in value.items() if clock_called(n)[0]}
        else:
            rest = dict(value)
        units = _units_in(value)
        for name, inner in rest.items():
            for leaf in _leaves(inner, _join(path, name)):
                yield leaf if leaf.unit else leaf._replace(unit=units.get(name, ""))


def _leaves_of_a_kind(value: Mapping[str, Any], lower: Mapping[str, str], path: str) -> Iterator[_Leaf]:
    """Yield the numbers of an iddata object's fields, or of Simulink's structure with time."""
    if "signals" in lower:
        signals = value[lower["signals"]]
        for name in lower:
            if clock_called(name)[0]:
                yield from _leaves(value[lower[name]], _join(path, lower[name]))
        for i, signal in enumerate(signals.items if isinstance(signals, StructArray) else (signals,), start=1):
            if isinstance(signal, Mapping):
                label = signal.get("label")
                named = label if isinstance(label, str) and label else f"signals({i})"
                yield from _leaves(signal.get("values"), _join(path, named))
        return
    size = 0
    for side in ("input", "output"):
        names = value.get(lower.get(f"{side}name", ""))
        words = [w for w in names.items if isinstance(w, str)] if isinstance(names, CellArray) else [names]
        units = value.get(lower.get(f"{side}unit", ""))
        stated = units.items if isinstance(units, CellArray) else (units,)
        for leaf in _leaves(value[lower[f"{side}data"]], _join(path, lower[f"{side}data"])):
            size = max(size, leaf.values.shape[0])
            if len(words) == leaf.values.shape[1] and all(isinstance(w, str) and w for w in words):
                for i, (word, column) in enumerate(zip(words, leaf.values.T, strict=True)):
                    unit = stated[i] if i < len(stated) and isinstance(stated[i], str) else ""
                    yield _Leaf(_join(path, str(word)), column[:, None], unit)
            else:
                yield leaf
    step = next(iter(_leaves(value.get(lower.get("ts", "")), "")), None)
    start = next(iter(_leaves(value.get(lower.get("tstart", "")), "")), None)
    if step is not None and step.values.size == 1 and size:
        zero = float(start.values[0, 0]) if start is not None and start.values.size == 1 else 0.0
        times: FloatArray = zero + float(step.values[0, 0]) * np.arange(size, dtype=np.float64)
        yield _Leaf(_join(path, "t"), times[:, None], "s")
