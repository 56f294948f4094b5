"""The elastic modes of an aircraft as they ring in a vacuum: several tests hold JSBSim and linear models against it."""

from dataclasses import replace

from testbench.aircraft.elastic import ElasticMode, ElasticModel


def uncoupled(elastic: ElasticModel) -> ElasticModel:
    """Return the same modes without any aerodynamic coupling: they ring at their in-vacuo frequency and damping."""
    bare = (ElasticMode(m.name, m.f_hz, m.zeta, m.mass_kg_m2, m.symmetry, shape=m.shape) for m in elastic.modes)
    return replace(elastic, modes=tuple(bare))
