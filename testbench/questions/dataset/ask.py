"""Draw a data set: fly its parts on several processes and write each at its place, until all are there."""

from __future__ import annotations

import hashlib
import json
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from testbench.core.blas import on_one_thread
from testbench.core.channels import channel
from testbench.core.door import checked, require_room
from testbench.core.errors import DatasetError, ScenarioError
from testbench.core.escape import markdown_cell, markdown_table, shell_word
from testbench.core.named import Named, obtain
from testbench.core.paths import SCENARIOS
from testbench.core.processes import Ahead, cores, processes
from testbench.core.store import ResultFolder
from testbench.core.words import without_numbers
from testbench.flight.batch.jobs import Simulator
from testbench.page.html import text_page
from testbench.questions.campaign.ask import Progress
from testbench.questions.campaign.load import versions
from testbench.questions.campaign.store import Counts
from testbench.questions.dataset.draws import aircraft_of
from testbench.questions.dataset.flying import Part, fly_part
from testbench.questions.dataset.layout import Layout, label, layout_of
from testbench.questions.dataset.scenario import SPLITS, DatasetScenario, Level
from testbench.questions.dataset.store import STORE, Store
from testbench.sensors import load_suite

_TASKS = {
    "identification": "Estimate the derivatives and modes of the aircraft (`truth`) from the flights of each draw.",
    "naming": (
        "Name the effect that the a-priori model of the aircraft lacks (`effect`), if any, from the flights of a draw."
    ),
}
_PART_BYTES = 16e6  # of a part: some hundred flights, a second's work
_MOST_PER_PART = 64
_MANY = 20  # attempts, from which it can be said that most fail


@dataclass(frozen=True)
class Drawn:
    """A complete data set.

    Attributes:
        folder: that it lies in.
        layout: of its store.
        again: why draws were drawn again -> how often.
        flown: flights of this session; 0 if all were there.
        elapsed_s: of this session.
    """

    folder: Path
    layout: Layout
    again: Mapping[str, int]
    flown: int
    elapsed_s: float

    @property
    def size_bytes(self) -> int:
        """Bytes of the store."""
        return (self.folder / STORE).stat().st_size


@on_one_thread
def draw_dataset(
    scenario: Named[DatasetScenario],
    folder: Path | str,
    *,
    runs: int | None = None,
    workers: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    simulator: Simulator = "auto",
) -> Drawn:
    """Draw a data set into a folder, or go on with one that was interrupted; the bytes are the same.

    Args:
        scenario: the file of a data set, or what was read from one.
        folder: of the data set alone.
        runs: flights, in place of those of the scenario.
        workers: processes; one per processor core if not given. They change no byte.
        progress: called with each part.
        simulator: "jsbsim" flies one flight after the other.

    Raises:
        ScenarioError: every fault of the file.
        DatasetError: most draws cannot fly, or the folder holds something else.
        DiskError: the disk has no room; BusyError: another process writes there.

    Example:
        >>> import testbench as tb
        >>> drawn = tb.draw_dataset("dataset/identification", "my_set", runs=8, workers=1)
        >>> drawn.layout.flights, sorted(p.name for p in drawn.folder.iterdir())[-1]
        (8, 'truth_test.h5')
    """
    scenario = obtain(DatasetScenario, scenario)
    if runs is not None and runs < 1:
        raise ScenarioError(f"runs >= 1 must hold, got {runs}")
    aircraft_of.cache_clear()  # a folder of the user's own may have changed since the last set
    layout = layout_of(scenario, runs or scenario.flights)
    require_room("a flight of the data set", layout.row_bytes, "shorten its manoeuvres (duration_s)")
    about = _about(scenario, layout, simulator)
    with ResultFolder(folder, resume=True) as place:
        store = Store.open(place, layout, about)
        if store.folder == place.path:
            place.leave()  # all is there
        if store.complete:
            return Drawn(place.path, layout, {}, 0, 0.0)
        return replace(
            _Session(scenario, layout, store, workers or cores(), simulator, progress).fly(), folder=place.path
        )


def _about(scenario: DatasetScenario, layout: Layout, simulator: Simulator) -> dict[str, Any]:
    """Return what decides every byte of a data set; files of the user's own by name and hash, not by their place."""
    asked, models = json.loads(scenario.model_dump_json()), {}
    for level, given in zip(scenario.level, asked["level"], strict=True):
        for name in level.aircraft:
            aircraft = aircraft_of(name, level.wings)
            content = [aircraft.xml, repr(aircraft.elastic), sorted(aircraft.engine_files.items())]
            models[f"{label(name)}, {level.wings}"] = _hash(content)
        given["aircraft"] = [label(name) for name in level.aircraft]
    asked["suite"] = label(scenario.suite)
    models[asked["suite"]] = _hash(repr(load_suite(scenario.suite)))
    return {
        "scenario": asked,
        "models": models,
        "layout": json.loads(layout.to_json()),
        "versions": versions(),
        "simulator": simulator,
    }


def _hash(content: object) -> str:
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


@dataclass
class _Session:
    scenario: DatasetScenario
    layout: Layout
    store: Store
    workers: int
    simulator: Simulator
    progress: Callable[[Progress], None] | None

    def fly(self) -> Drawn:
        """Fly every part that is not there yet, and finish."""
        began, size = time.perf_counter(), self._draws_per_part
        parts = [range(k, min(k + size, self.layout.draws)) for k in range(0, self.layout.draws, size)]
        done = self.store.journal()
        due = deque(k for k in range(len(parts)) if k not in done)
        flown = 0
        with processes(min(self.workers, max(1, len(due) - 1))), Ahead() as ahead:
            running: deque[int] = deque()
            while due or running:
                # the first part is flown here: what it loads and compiles, the processes that are forked then know
                while due and flown and len(running) < ahead.most:
                    running.append(due.popleft())
                    ahead.begin(running[-1], partial(self._part, parts[running[-1]]))
                number = running.popleft() if running else due.popleft()
                part = ahead.take(number, partial(self._part, parts[number]))
                first = parts[number][0] * self.layout.per_draw
                self.store.write(number, first, part)
                done[number] = {"draws": part.draws, "failed": part.failed}
                flown += len(part.rows["split"])
                self._tell(done, parts, flown, time.perf_counter() - began)
        again = _again(done)
        self._finish(again)
        return Drawn(self.store.folder, self.layout, again, flown, time.perf_counter() - began)

    @property
    def _draws_per_part(self) -> int:
        return max(1, min(_MOST_PER_PART, int(_PART_BYTES / (self.layout.row_bytes * self.layout.per_draw))))

    def _part(self, numbers: range) -> Part:
        return fly_part(self.scenario, self.layout, numbers.start, numbers.stop, self.simulator)

    def _tell(self, done: Mapping[int, Any], parts: list[range], flown: int, elapsed_s: float) -> None:
        again = _again(done)
        failed, drawn = sum(again.values()), sum(row["draws"] for row in done.values())
        if failed + drawn >= _MANY and failed > drawn:
            often = max(again, key=lambda reason: again[reason])
            most = next(r["why"] for row in done.values() for r in row["failed"] if without_numbers(r["why"]) == often)
            raise DatasetError(
                f"most draws must fly, but {failed} of {failed + drawn} did not; mostly because {most}. Narrow "
                "speed_ratio, scale or vary of the levels"
            )
        if self.progress is not None:
            # whole parts, but for the last one
            have = min(drawn * self.layout.per_draw, self.layout.flights)
            counts = Counts(0, self.layout.flights - have, have)
            self.progress(Progress(counts, flown, elapsed_s, self.workers))

    def _finish(self, again: Mapping[str, int]) -> None:
        import h5py  # type: ignore[import-untyped]

        with h5py.File(checked(self.store.folder / STORE, "record"), "r") as file:
            split, samples = file["split"][:], file["samples"][:]
        labels = self.store.labels()
        sheet = datasheet(self.scenario, self.layout, split, samples, labels, again)
        card = partial(croissant, self.scenario, self.layout)
        self.store.finish(sheet, text_page(f"Data set: {self.scenario.name}", sheet), card, split)


def _again(done: Mapping[int, Any]) -> dict[str, int]:
    """Return why draws were drawn again -> how often, over all parts; numbers in a reason do not make it another."""
    total: Counter[str] = Counter()
    for number in sorted(done):
        total.update(without_numbers(row["why"]) for row in done[number]["failed"])
    return dict(sorted(total.items()))


# --- the data sheet ---------------------------------------------------------------------------------------------------


def datasheet(
    scenario: DatasetScenario,
    layout: Layout,
    split: Any,
    samples: Any,
    labels: Mapping[str, Any],
    again: Mapping[str, int],
) -> str:
    """Return the datasheet as Markdown.

    Args:
        scenario: that it was drawn by.
        layout: of the store.
        split: (flights,) codes.
        samples: (flights,) of each record.
        labels: all labels, those of the test split too; only counts of them are told.
        again: why draws were drawn again -> how often.
    """
    counts = {name: int(np.sum(split == i)) for i, name in enumerate(SPLITS)}
    seconds = float(np.sum(samples)) / layout.rate_hz
    file = scenario.file.name if scenario.file else "scenario.toml"
    packaged = scenario.file is not None and scenario.file.is_relative_to(SCENARIOS)
    file = file.removesuffix(".toml") if packaged else file
    parts = [
        f"# {markdown_cell(scenario.title)}\n",
        f"{scenario.question}\n" if scenario.question else "",
        "## Contents\n",
        f"{layout.flights} simulated flights of {layout.draws} draws, {seconds / 3600.0:.3g} h in all. "
        f"{_TASKS[layout.task]}\n",
        _table(("split", "flights", "draws"), [(n, c, -(-c // layout.per_draw)) for n, c in counts.items()]),
        "The labels of the test split are NaN or -2 in `flights.h5`; they lie in `truth_test.h5`. Whoever knows "
        "scenario and seed can draw them again: a contest takes a `--seed` of its own and keeps `truth_test.h5` and "
        "`dataset.json` back.\n",
        f"One flight takes {layout.row_bytes} bytes, of which the readings are "
        f"{layout.samples * len(layout.channels) * 4}: {layout.samples} samples at {layout.rate_hz:g} Hz of "
        f"{len(layout.channels)} channels of 4 bytes. Nothing is compressed.\n",
        "## Method\n",
        _how(scenario),
        _flown_again_words(again),
        "The flights of a draw share aircraft, condition and hidden effects, and lie in one split: the SHA-256 of what "
        "was drawn decides which. A larger data set of the same seed begins with the same draws.\n",
        "## Channels\n",
        _channels(scenario),
        "## Variables\n",
        _table(
            ("variable", "dimensions", "type", "unit", "what it is"),
            [(f"`{v.name}`", ", ".join(v.dims), v.dtype[1:], v.unit, v.words + ("; a label" if v.label else ""))
             for v in layout.variables],
        ),
        "Codes are places in the attribute `names` of their variable.\n",
        "## True figures\n",
        _table(("figure", "unit"), list(zip(layout.figures, (u or "1" for u in layout.figure_units), strict=True))),
        _effects(layout),
        "## Limits\n",
        "The flights are simulated. Aircraft, sensors and air are those of the testbench's models; no number here "
        "gives their difference from your aircraft. Draws that could not fly are left out, so that conditions near "
        "the limits of an aircraft are rarer than the laws above say.\n",
        "## Licence, version, command\n",
        f"Licence: {markdown_cell(scenario.licence)}. The seed stands in `dataset.json`, as the whole scenario does. "
        f"Versions: {', '.join(f'{k} {v}' for k, v in versions().items())}.\n",
        f"```sh\ntestbench dataset {shell_word(file)} --runs {layout.flights} --out FOLDER\n```\n",
        "`testbench dataset check FOLDER`, or `sha256sum -c checksums.sha256` in it, checks the files.\n",
        "```python\nimport testbench as tb\n\nflights = tb.open_dataset(\"FOLDER\")\n```\n",
    ]  # fmt: skip
    return "\n".join(p for p in parts if p)


_CROISSANT: Mapping[str, Any] = {
    "@language": "en", "@vocab": "https://schema.org/", "sc": "https://schema.org/", "dct": "http://purl.org/dc/terms/",
    "cr": "http://mlcommons.org/croissant/", "rai": "http://mlcommons.org/croissant/RAI/",
    "conformsTo": "dct:conformsTo",
    **{n: {"@id": f"cr:{n}", "@type": "@json"} for n in ("data", "examples")},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    **{n: f"cr:{n}" for n in (
        "citeAs", "column", "equivalentProperty", "extract", "field", "fileProperty", "fileObject", "fileSet", "format",
        "includes", "isLiveDataset", "jsonPath", "key", "md5", "parentField", "path", "recordSet", "references",
        "regex", "repeated", "replace", "samplingRate", "separator", "source", "subField", "transform",
    )},
}  # fmt: skip
"""The context of every card of that format: its readers warn of another."""


def croissant(scenario: DatasetScenario, layout: Layout, sha256: str) -> str:
    """Return what catalogues of data sets read, as JSON-LD (MLCommons Croissant 1.0).

    Its record sets name no format that HDF5 is, so that variables stand as schema.org has them.

    Args:
        scenario: that it was drawn by.
        layout: of the store.
        sha256: of the store.
    """
    measured = [
        {"@type": "PropertyValue", "name": v.name, "description": v.words} | ({"unitText": v.unit} if v.unit else {})
        for v in layout.variables
    ]
    what = f"{layout.flights} simulated flights of {layout.draws} draws. {_TASKS[layout.task]}"
    store = {
        "@type": "cr:FileObject", "@id": STORE, "name": STORE, "contentUrl": STORE,
        "contentSize": f"{layout.row_bytes * layout.flights} B", "encodingFormat": "application/x-hdf5",
        "sha256": sha256,
    }  # fmt: skip
    card = {
        "@context": _CROISSANT, "@type": "sc:Dataset", "name": scenario.title,
        "description": f"{scenario.question} {what}".strip(), "conformsTo": "http://mlcommons.org/croissant/1.0",
        "license": scenario.licence, "version": versions()["testbench"], "variableMeasured": measured,
        "distribution": [store],
    }  # fmt: skip
    return json.dumps(card, indent=1, ensure_ascii=False) + "\n"


def _channels(scenario: DatasetScenario) -> str:
    """Return the channels with what their sensors are believed to be, before levels and hidden effects."""
    sensed = load_suite(scenario.suite)
    rows = [
        (
            s.channel,
            channel(s.channel).unit,
            *(f"{x:.3g}" for x in (s.noise_std, s.bias, s.lag_s, s.delay_s, s.quantum)),
        )
        for s in sensed.sensors
    ]
    heads = ("channel", "unit", "noise std", "bias", "lag, s", "delay, s", "quantum")
    return _table(heads, rows)


def _how(scenario: DatasetScenario) -> str:
    inputs = [
        (m.name, ", ".join(s.signal + " on " + s.control for s in m.input), m.duration_s) for m in scenario.manoeuvre
    ]
    return "\n".join(
        [
            _table(("level", "share", "how"), [(x.name, x.share, _words(x)) for x in scenario.level]),
            _table(("manoeuvre", "inputs", "duration, s"), inputs),
        ]
    )


def _words(level: Level) -> str:
    def between(pair: tuple[float, float], unit: str = "") -> str:
        low, high = pair
        return f"{low:g}{unit}" if low == high else f"{low:g} to {high:g}{unit}"

    out = [
        f"{' or '.join(label(x) for x in level.aircraft)}, {level.wings} wings",
        f"{between(level.speed_ratio)} of the design airspeed at {between(level.h_m, ' m')}",
        f"inputs times {between(level.scale)}",
        f"sensor errors times {level.noise:g}",
    ]
    if level.turbulence_rms_m_s[1] > 0.0:
        out.append(f"turbulence of {between(level.turbulence_rms_m_s, ' m/s')} rms")
    for key, law in level.vary.items():
        values = ", ".join(f"{k} {v}" for k, v in law.model_dump().items() if k != "kind" and v not in ((), None))
        out.append(f"`{key}` {law.kind} ({values})")
    if level.hidden:
        out.append(f"hidden: {', '.join(level.hidden)}")
    return "; ".join(out)


def _flown_again_words(again: Mapping[str, int]) -> str:
    if not again:
        return "Every draw flew at its first attempt.\n"
    reasons = _table(("times", "drawn again because"), [(n, why) for why, n in again.items()])
    return f"Attempts that could not fly: {sum(again.values())}. They were drawn again.\n\n{reasons}"


def _effects(layout: Layout) -> str:
    if not layout.effects:
        return ""
    rows = [(k, p, r.replace("|", "or")) for k, p, r in zip(layout.effects, layout.parts, layout.right, strict=True)]
    return "## Hidden effects\n\n" + _table(("effect", "part", "right names"), rows)


def _table(heads: tuple[str, ...], rows: list[tuple[Any, ...]]) -> str:
    return "\n".join(markdown_table(heads, rows)) + "\n"
