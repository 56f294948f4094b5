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
from testbench.aircraft import Aircraft, load_aircraft
from testbench.campaign.draws import nominal_inputs
from testbench.campaign.targets import change_aircraft, change_suites, check_target, is_scenario_key, set_keys
from testbench.errors import ScenarioError, TestbenchError, nearest
from testbench.flight.preflight import check
from testbench.paths import find_scenario
from testbench.scenario import Scenario, attach_file, estimator_name
from testbench.scenario.campaign import CampaignSpec, attach_campaign_file
from testbench.schema import parse, read_toml
from testbench.sensors import SensorSuite, load_suite

_MOST_CELLS_CHECKED = 200


@dataclass(frozen=True, eq=False)
class Campaign:
    """A checked campaign.

    Attributes:
        spec: what its file says.
        content: the base scenario as a table; sensor suites that are files by absolute path.
        base: the same, with every varied key in the middle of its distribution.
        text: the campaign's file, verbatim.
    """

    spec: CampaignSpec
    content: Mapping[str, Any]
    base: Scenario
    text: str

    @property
    def cases(self) -> list[str]:
        """Names "SUITE, ESTIMATOR" of what every run finds, in order."""
        estimators = [estimator_name(e) for e in self.base.identification.estimators]
        return [f"{suite}, {e}" for suite in self.suite_names for e in estimators]

    @property
    def suite_names(self) -> list[str]:
        """Names of the sensor suites of the base scenario."""
        return [load_suite(name).name for name in self.base.suites]

    def digest(self) -> str:
        """Return a hash of all that decides what run i finds: draws, scenario, aircraft and suites.

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
        ]
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def versions() -> dict[str, str]:
    """Return the versions that a run's figures may depend on."""
    return {"testbench": __version__} | {name: version(name) for name in ("jsbsim", "numpy", "scipy")}


def load_campaign(path: Path | str) -> Campaign:
    """Read a campaign and check it against its scenario, aircraft and suites, without flying.

    Checked are the laws of the campaign and of the base scenario; every key that is varied, alone, in the middle of its
    distribution or at each of its values; and every point of the grid with all varied keys in their middle.

    Raises:
        ScenarioError: lists every fault with file, key, law, value and the nearest valid name.
        RecordError: the file or the base scenario cannot be read.
    """
    file = find_scenario(path)
    spec, faults = parse(CampaignSpec, read_toml(file), file)
    if spec is None:
        raise ScenarioError(faults)
    spec = attach_campaign_file(spec, file)
    content, origin = _base(spec, file)
    bare, found = parse(Scenario, content, origin)
    faults = [*faults, *found]
    if bare is None:
        raise ScenarioError(faults)
    content = _absolute(content, origin)
    found = check(attach_file(bare, origin))
    if not found:
        found = _check_keys(spec, content, bare, file)
    faults += found
    if not found:
        faults += _check_grid(spec, content, file)
    if faults:
        raise ScenarioError(faults)
    nominal = Scenario.model_validate(set_keys(content, nominal_inputs(spec)))
    campaign = Campaign(spec, content, attach_file(nominal, origin), file.read_text(encoding="utf-8"))
    _check_stop(campaign, file)
    return campaign


def _base(spec: CampaignSpec, file: Path) -> tuple[dict[str, Any], Path]:
    if spec.scenario is not None:
        return dict(spec.scenario), file
    beside = file.parent / str(spec.base)
    found = beside if beside.is_file() else find_scenario(str(spec.base))
    return read_toml(found), found


def _absolute(content: Mapping[str, Any], origin: Path) -> dict[str, Any]:
    """Return the scenario with sensor suites that are files by absolute path, as processes elsewhere read them."""
    out = dict(content)
    out["suites"] = [str(Path(s).resolve()) if s.endswith(".toml") else s for s in out["suites"]]
    return out


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
            found = check(attach_file(scenario, file))
            found += _attempt(lambda: apply(scenario, inputs), file)  # noqa: B023 - called at once
        faults += [f for f in found if f not in faults]
    return faults


def _attempt(action: Callable[[], Any], file: Path) -> list[str]:
    try:
        action()
    except TestbenchError as error:
        return [f"{file}: {error}"]
    return []


def apply(scenario: Scenario, inputs: Mapping[str, Any]) -> tuple[Aircraft, tuple[SensorSuite, ...]]:
    """Return the aircraft and the suites of a scenario with the changes among ``inputs``."""
    aircraft = change_aircraft(load_aircraft(scenario.aircraft, scenario.wings), inputs)
    return aircraft, change_suites(tuple(load_suite(name) for name in scenario.suites), inputs)


def _check_stop(campaign: Campaign, file: Path) -> None:
    """Check what can be known of the stopping rule's quantity before a run: suite and estimator."""
    stop = campaign.spec.stop
    if stop is None:
        return
    case = stop.quantity.split(": ")[0]
    if case not in campaign.cases or ": " not in stop.quantity:
        raise ScenarioError(
            [
                f"{file}, stop.quantity: must be 'SUITE, ESTIMATOR: FIGURE', got '{stop.quantity}'"
                + nearest(case, campaign.cases)
            ]
        )
