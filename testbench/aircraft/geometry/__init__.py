"""A complete aircraft from a plan of it: plan form, sections, masses, motor and servos become a JSBSim model.

    geometry.toml or plane.avl -> Plane (shape.py) -> both methods' coefficients (aerodynamics.py)
                               -> what is used, and how well it is known (coefficients.py) -> a folder (write.py)

Places are those of JSBSim's structural frame and of AVL: x aft, y along the right wing, z up, from any origin.
"""

from testbench.core.lazily import lazily

__getattr__ = lazily(__name__, read_plan="read", Plan="read", model_from_plan="build", Made="build")
