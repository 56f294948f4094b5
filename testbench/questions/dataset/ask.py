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

from testbench.core.blas import on_one_thread
from testbench.core.door import checked, require_room
from testbench.core.errors import DatasetError, ScenarioError
from testbench.core.named import Named, obtain
from testbench.core.processes import Ahead, cores, processes
from testbench.core.store import ResultFolder
from testbench.flight.batch.jobs import Simulator
from testbench.page.html import text_page
from testbench.questions.campaign.ask import Progress
from testbench.questions.campaign.load import versions
from testbench.questions.campaign.store import Counts
from testbench.questions.dataset.datasheet import datasheet
from testbench.questions.dataset.draws import aircraft_of
from testbench.questions.dataset.flying import Part, fly_part
from testbench.questions.dataset.layout import Layout, label, layout_of
from testbench.questions.dataset.scenario import DatasetScenario
from testbench.questions.dataset.store import STORE, Store
from testbench.sensors import load_suite

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
                done[number] = {"draws": part.draws, "again": part.again}
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
            most = max(again, key=lambda reason: again[reason])
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
        self.store.finish(sheet, text_page(f"Data set: {self.scenario.name}", sheet), split)


def _again(done: Mapping[int, Any]) -> dict[str, int]:
    """Return why draws were drawn again -> how often, over all parts."""
    total: Counter[str] = Counter()
    for number in sorted(done):
        total.update(done[number]["again"])
    return dict(sorted(total.items()))
