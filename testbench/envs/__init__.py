"""Gymnasium environments: ``testbench/ExcitationDesign-v0`` and one per aircraft, continuous and discrete.

    import gymnasium
    import testbench.envs

    testbench.envs.register()
    env = gymnasium.make("testbench/ExcitationDesign-v0", task="taurus")
    envs = gymnasium.make_vec("testbench/ExcitationDesign-v0", num_envs=64, task="taurus", dynamics="jsbsim")

Needs the extra ``envs`` (``rl`` to train agents, too). Nothing is registered, and gymnasium is not imported, before
:func:`register` is called.
"""

from __future__ import annotations

from testbench.core.errors import MissingPackage, missing

ENTRY_POINT = "testbench.envs.excitation:ExcitationDesign"
VECTOR_ENTRY_POINT = "testbench.envs.vector:make"
DEFAULT = "testbench/ExcitationDesign-v0"
AIRCRAFT = ("eolo", "taurus", "b1")
ACTIONS = ("continuous", "discrete")

NEEDS_GYMNASIUM = ("environments need gymnasium", "envs")

__all__ = ["ACTIONS", "AIRCRAFT", "DEFAULT", "environment_names", "register"]


def environment_names() -> dict[str, dict[str, str]]:
    """Return id -> its arguments, e.g. "testbench/ExcitationDesign-taurus-discrete-v0"."""
    out: dict[str, dict[str, str]] = {DEFAULT: {}}
    for aircraft in AIRCRAFT:
        for actions in ACTIONS:
            name = f"testbench/ExcitationDesign-{aircraft}-{actions}-v0"
            out[name] = {"task": aircraft, "actions": actions}
    return out


def register() -> tuple[str, ...]:
    """Register the environments with Gymnasium and return their ids; doing so twice does no harm.

    Raises:
        MissingPackage: Gymnasium is not installed; an ImportError too.
    """
    try:
        import gymnasium
    except ImportError as error:
        raise MissingPackage(missing(*NEEDS_GYMNASIUM)) from error

    names = environment_names()
    for name, arguments in names.items():
        if name not in gymnasium.registry:
            gymnasium.register(name, ENTRY_POINT, vector_entry_point=VECTOR_ENTRY_POINT, kwargs=arguments)
    return tuple(names)
