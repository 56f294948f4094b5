"""Read a campaign and check everything that can be checked before anything is flown."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import Any

from testbench import __version__
from testbench.aircraft import Aircraft
from testbench.core.bring import is_brought
from testbench.core.door import read_text, read_toml, sha256
from testbench.core.errors import Refusal, ScenarioError, nearest
from testbench.core.named import obtain
from testbench.core.paths import find_scenario
from testbench.core.schema import parse
from testbench.estimators.brought import is_text, place, whole
from testbench.estimators.identification import estimator_name
from testbench.flight import load_aircraft
from testbench.questions.campaign.draws import (
    change_aircraft,
    change_suites,
    check_target,
    is_scenario_key,
    nominal_inputs,
    own_keys,
    set_keys,
    with_own_laws,
)
from testbench.questions.campaign.scenario import CampaignSpec
from testbench.questions.run.check import check, notes
from testbench.questions.run.scenario import Scenario
from testbench.sensors import SensorSuite, load_suite

_MOST_CELLS_CHECKED = 200
_BROUGHT = ("method", "structure")
"""Keys of an estimator that may name a file of the user's."""


@dataclass(frozen=True, eq=False)
class Campaign:
    """A checked campaign.

    Attributes:
        spec: what its file says.
        content: the base scenario as a table; sensor suites that are files by absolute path.
        base: the same, with every varied key in the middle of its distribution.
        text: the campaign's file, verbatim.
        own: keys that are drawn by the aircraft's own uncertainty; their laws stand in ``spec`` as normal ones.
    """

    spec: CampaignSpec
    content: Mapping[str, Any]
    base: Scenario
    text: str
    own: tuple[str, ...] = ()

    @property
    def cases(self) -> list[str]:
        """Names "SUITE, ESTIMATOR" of what every run finds, in order."""
        return case_names(self.base)

    @property
    def suite_names(self) -> list[str]:
        """Names of the sensor suites of the base scenario."""
        return suite_names(self.base)

    def digest(self) -> str:
        """Return a hash of all that decides the results of run i: draws, scenario, aircraft and suites.

        The number of runs, the rule that stops them and the texts are left out: they may change between sessions.
        """
        spec = self.spec.model_dump(mode="json", include={"seed", "vary", "grid", "truth"})
        aircraft = load_aircraft(self.base.aircraft, self.base.wings)
        suites = [repr(load_suite(name)) for name in self.base.suites]
        parts = [
            spec,
            self.content,
            aircraft.xml,
            repr(aircraft.elastic),
            sorted(aircraft.engine_files.items()),
            suites,
            *(told for _, told in self.files),
        ]
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()

    @property
    def files(self) -> tuple[tuple[str, str], ...]:
        """(Absolute path, SHA-256) of every estimator and structure of the user's own, as workers must have them."""
        entries = self.content["identification"]["estimators"]
        names = [entry[key] for entry in entries for key in _BROUGHT if is_brought(entry.get(key))]
        texts = [entry["structure"] for entry in entries if is_text(entry.get("structure"))]
        return tuple(
            (str(path), sha256(path, "python")) for path in (*(place(name)[0] for name in names), *map(Path, texts))
        )


def versions() -> dict[str, str]:
    """Return the versions that a run's figures may depend on."""
    return {"testbench": __version__} | {name: version(name) for name in ("jsbsim", "numpy", "scipy")}


def load_campaign(path: Path | str) -> Campaign:
    """Read a campaign and check it against its scenario, aircraft and suites, without flying.

    The check covers the laws of the campaign and of the base scenario; every varied key alone, in the middle of its
    distribution or at each of its values; and every point of the grid, with all varied keys in their middle.

    Raises:
        ScenarioError: lists every fault with file, key, law, value and the nearest valid name.
        RecordError: the file or the base scenario cannot be read.

    Example:
        >>> import testbench as tb
        >>> tb.load_campaign("campaign/taurus_scatter").base.aircraft
        'taurus'
    """
    spec = obtain(CampaignSpec, path)
    assert spec.file is not None
    content, origin = _base(spec, spec.file)
    bare, _ = parse(Scenario, content, origin)
    assert bare is not None
    content = _resolved(content, bare, origin)
    full = with_own_laws(spec, load_aircraft(bare.aircraft, bare.wings))
    nominal = Scenario.model_validate(set_keys(content, nominal_inputs(full)))
    text = read_text(spec.file, "scenario")
    return Campaign(full, content, nominal.at(origin), text, own_keys(spec, full))


def campaign_faults(spec: CampaignSpec) -> list[str]:
    """Return every law that a campaign breaks beyond its schema, see :func:`load_campaign`."""
    assert spec.file is not None
    file = spec.file
    content, origin = _base(spec, file)
    bare, faults = parse(Scenario, content, origin)
    if bare is None:
        return faults
    content = _resolved(content, bare, origin)
    found = check(bare.at(origin))
    if not found:
        try:
            spec = with_own_laws(spec, load_aircraft(bare.aircraft, bare.wings))
        except ScenarioError as error:
            return [*faults, *error.faults]
        found = _check_keys(spec, content, bare, file)
    faults += found
    if not found:
        faults += _check_grid(spec, content, file)
    return faults or _check_stop(spec, content, file)


def campaign_notes(spec: CampaignSpec) -> list[str]:
    """Return what is to be known of the base scenario: the suites and estimators that cannot work together."""
    assert spec.file is not None
    content, origin = _base(spec, spec.file)
    bare, _ = parse(Scenario, content, origin)
    return [] if bare is None else notes(bare.at(origin))


def _base(spec: CampaignSpec, file: Path) -> tuple[dict[str, Any], Path]:
    if spec.scenario is not None:
        return dict(spec.scenario), file
    beside = file.parent / str(spec.base)
    found = beside if beside.is_file() else find_scenario(str(spec.base))
    return read_toml(found), found


def _resolved(content: Mapping[str, Any], bare: Scenario, origin: Path) -> dict[str, Any]:
    """Return the scenario with what users brought by absolute path, as processes elsewhere read it."""
    entries = [dict(entry) for entry in content["identification"]["estimators"]]
    for entry in entries:
        for key in _BROUGHT:
            if is_brought(entry.get(key)) or is_text(entry.get(key)):
                entry[key] = whole(entry[key], origin)
    identification = {**content["identification"], "estimators": entries}
    return {**content, "aircraft": bare.aircraft, "suites": list(bare.suites), "identification": identification}


def _check_keys(spec: CampaignSpec, content: Mapping[str, Any], bare: Scenario, file: Path) -> list[str]:
    """Return the faults of every key that is varied, each with each of its values or the middle alone."""
    aircraft = load_aircraft(bare.aircraft, bare.wings)
    suites = tuple(load_suite(name) for name in bare.suites)
    faults = []
    nominal = nominal_inputs(spec)
    listed = {**spec.grid, **{k: getattr(law, "among", getattr(law, "values", ())) for k, law in spec.vary.items()}}
    for key in (*spec.grid, *spec.vary):
        where = f'{file}, {"grid" if key in spec.grid else "vary"}."{key}"'
        for value in listed[key] or (nominal[key],):
            found = check_target(key, value, aircraft, suites) or _check_scenario_key(key, value, content)
            faults += [f"{where}: {fault}" for fault in found]
            if found:
                break
    return faults


def _check_scenario_key(key: str, value: Any, content: Mapping[str, Any]) -> list[str]:
    if not is_scenario_key(key):
        return []
    try:
        changed = set_keys(content, {key: value})
    except ScenarioError as error:
        return list(error.faults)
    return parse(Scenario, changed, None)[1]


def _check_grid(spec: CampaignSpec, content: Mapping[str, Any], file: Path) -> list[str]:
    """Return the faults of the points of the grid (the first 200), all varied keys in the middle of their laws."""
    nominal = nominal_inputs(spec)
    faults: list[str] = []
    for number, point in enumerate(product(*spec.grid.values())):
        if number >= _MOST_CELLS_CHECKED:
            break
        inputs = nominal | dict(zip(spec.grid, point, strict=True))
        scenario, found = parse(Scenario, set_keys(content, inputs), file)
        if scenario is not None and not found:
            found = check(scenario.at(file))
            found += _attempt(lambda: apply(scenario, inputs), file)  # noqa: B023 - called at once
        faults += [f for f in found if f not in faults]
    return faults


def _attempt(action: Callable[[], Any], file: Path) -> list[str]:
    try:
        action()
    except Refusal as error:
        return [f"{file}: {error}"]
    return []


def apply(scenario: Scenario, inputs: Mapping[str, Any]) -> tuple[Aircraft, tuple[SensorSuite, ...]]:
    """Return the aircraft and the suites of a scenario with the changes among ``inputs``."""
    aircraft = change_aircraft(load_aircraft(scenario.aircraft, scenario.wings), inputs)
    return aircraft, change_suites(tuple(load_suite(name) for name in scenario.suites), inputs)


def _check_stop(spec: CampaignSpec, content: Mapping[str, Any], file: Path) -> list[str]:
    """Return what can be known of the stopping rule's quantity before a run: suite and estimator."""
    if spec.stop is None:
        return []
    cases = case_names(Scenario.model_validate(content))
    case = spec.stop.quantity.split(": ")[0]
    if case in cases and ": " in spec.stop.quantity:
        return []
    return [
        f"{file}, stop.quantity: must be 'SUITE, ESTIMATOR: FIGURE', got '{spec.stop.quantity}'{nearest(case, cases)}"
    ]


def case_names(base: Scenario) -> list[str]:
    """Return the names "SUITE, ESTIMATOR" of what every run of a scenario finds, in order."""
    estimators = [estimator_name(e) for e in base.identification.estimators]
    return [f"{suite}, {e}" for suite in suite_names(base) for e in estimators]


def suite_names(base: Scenario) -> list[str]:
    """Return the names of the sensor suites of a scenario."""
    return [load_suite(name).name for name in base.suites]
