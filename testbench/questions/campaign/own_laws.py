"""Draws by the aircraft's own uncertainty, with the numbers that it states put in their place."""

from __future__ import annotations

from testbench.aircraft import Aircraft
from testbench.aircraft.believed import KEY, stated_deviations
from testbench.core.errors import Faults, ModelError, ScenarioError, nearest
from testbench.questions.campaign.scenario import EVERY, CampaignSpec, Distribution, Normal, Uncertainty


def with_own_laws(spec: CampaignSpec, aircraft: Aircraft) -> CampaignSpec:
    """Return the campaign with a normal law for every coefficient that is drawn by the aircraft's own uncertainty.

    The drawn factor has the mean 1 and the stated relative standard deviation. The coefficients of "coefficient.*"
    stand in the order of aircraft.toml; those that another key varies are left to it.

    Args:
        spec: as in the file.
        aircraft: of its base scenario.

    Raises:
        ScenarioError: the aircraft states no deviations, or not that of a coefficient which is asked for.
    """
    own = [key for key, law in spec.vary.items() if isinstance(law, Uncertainty)]
    if not own:
        return spec
    faults = Faults(spec.file)
    try:
        stated = {
            f"{KEY}{name}": Normal(kind="normal", mean=1.0, std=std)
            for name, std in stated_deviations(aircraft).items()
        }
    except ModelError as error:
        faults.note(f'vary."{own[0]}"', error.message)
        raise ScenarioError(faults) from error
    vary: dict[str, Distribution] = {}
    for key, law in spec.vary.items():
        if key == EVERY:
            vary |= {k: normal for k, normal in stated.items() if k not in spec.vary and k not in spec.grid}
        elif not isinstance(law, Uncertainty):
            vary[key] = law
        elif key in stated:
            vary[key] = stated[key]
        else:
            names = [k.removeprefix(KEY) for k in stated]
            name = key.removeprefix(KEY)
            faults.note(
                f'vary."{key}"',
                f"[uncertainty] of {aircraft.name} must state the deviation of the coefficient, got '{name}'"
                f"{nearest(name, names)}",
            )
    if faults:
        raise ScenarioError(faults)
    return spec.changed(vary=vary)


def own_keys(spec: CampaignSpec, resolved: CampaignSpec) -> tuple[str, ...]:
    """Return the keys that are drawn by the aircraft's own uncertainty.

    Args:
        spec: as in the file.
        resolved: what :func:`with_own_laws` returned for it.
    """
    given = {key for key, law in spec.vary.items() if not isinstance(law, Uncertainty)}
    return tuple(key for key in resolved.vary if key not in given)
