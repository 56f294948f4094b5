"""Designs of inputs: a scenario read, checked, searched, flown and ranked."""

from testbench.designer.build import limits_of, outputs_of, problem_of, with_positions
from testbench.designer.modes import RIGID_MODES, elastic_modes, modes_of, onsets_of
from testbench.designer.read import check, load_design
from testbench.designer.run import DesignResult, Ranked, run_design

__all__ = [
    "RIGID_MODES",
    "DesignResult",
    "Ranked",
    "check",
    "elastic_modes",
    "limits_of",
    "load_design",
    "modes_of",
    "onsets_of",
    "outputs_of",
    "problem_of",
    "run_design",
    "with_positions",
]
