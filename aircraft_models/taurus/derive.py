"""Derive the thrust law of the Taurus-like aircraft from its motor and propeller.

    python aircraft_models/taurus/derive.py            # print it
    python aircraft_models/taurus/derive.py --write    # write it into taurus.xml

Motor power and the coefficients of the propeller (APC 12x6E) are those of the Ultra Stick 25e (OpenFlightSim, MIT
licence); the order of the polynomials' coefficients there, highest power first, is inferred from a static CT of 0.0604.
At every throttle and airspeed the propeller turns as fast as the motor's power drives it, CP(J) rho n^3 D^5 =
P(throttle): the motor settles within some 0.1 s, and its speed is no state of the model. The law in the XML is a
least-squares fit.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

FOLDER = Path(__file__).resolve().parent
DIAMETER_M = 0.3048
DENSITY_KG_M3 = 1.2133  # standard atmosphere at 100 m
CT = (-0.4314, 1.08, -0.896, 0.1089, 0.0604)
CP = (0.5054, -0.5304, 0.0412, 0.01664, 0.0223)
POWER_W = (174.46, 70.135, -4.39)
NOMINAL_N = 14.0  # Engines/motor.xml: the thrust that a throttle position of 1 stands for
HIGHEST_J = 0.8  # beyond it the polynomials are not those of a propeller
TERMS = ((1, 0), (2, 0), (0, 1), (1, 1), (0, 2), (1, 2))  # powers of throttle and of V / (10 m/s)
THROTTLE, V_M_S = np.linspace(0.08, 1.0, 24), np.linspace(6.0, 22.0, 17)  # range of the fit


def thrust(throttle: float, V_m_s: float) -> float:
    """Return the thrust in N of motor and propeller in equilibrium."""

    def surplus(n: float) -> float:
        """Return the power that ``n`` revolutions per second take beyond the motor's, W."""
        J = min(V_m_s / (n * DIAMETER_M), HIGHEST_J)
        return float(np.polyval(CP, J) * DENSITY_KG_M3 * n**3 * DIAMETER_M**5 - np.polyval(POWER_W, throttle))

    n = brentq(surplus, 5.0, 400.0)
    J = min(V_m_s / (n * DIAMETER_M), HIGHEST_J)
    return float(np.polyval(CT, J) * DENSITY_KG_M3 * n**2 * DIAMETER_M**4)


def fit() -> tuple[list[float], float]:
    """Return the coefficients of TERMS in N, and the root-mean-square error of the fit, N."""
    t, v = np.meshgrid(THROTTLE, V_M_S / 10.0, indexing="ij")
    exact = np.array([[thrust(a, b) for b in V_M_S] for a in THROTTLE])
    columns = np.column_stack([(t**i * v**j).ravel() for i, j in TERMS])
    coefficients = np.linalg.lstsq(columns, exact.ravel(), rcond=None)[0]
    return [float(f"{c:.5g}") for c in coefficients], float(
        np.sqrt(np.mean((columns @ coefficients - exact.ravel()) ** 2))
    )


def law() -> str:
    """Return the <function> of taurus.xml: share of the nominal thrust over throttle and airspeed."""
    terms = []
    for c, (i, j) in zip(fit()[0], TERMS, strict=True):
        factors = [f"<value>{c / NOMINAL_N:.8g}</value>"]
        factors += ["<property>fcs/throttle-cmd-norm</property>"] * i
        factors += ["<property>velocities/vt-fps</property> <value>0.03048</value>"] * j
        terms.append(f"            <product> {' '.join(factors)} </product>")
    return "<function>\n          <sum>\n" + "\n".join(terms) + "\n          </sum>\n        </function>"


def amended_xml() -> str:
    """Return the text of taurus.xml with the derived law in place."""
    xml = (FOLDER / "taurus.xml").read_text(encoding="utf-8")
    pattern = (
        r'(<fcs_function name="fcs/thrust-fraction">\s*<description>)[^<]*(</description>\s*)<function>.*?</function>'
    )
    text = "share of the nominal thrust (Engines/motor.xml), fitted to motor and propeller by derive.py"
    return re.sub(pattern, lambda m: m[1] + text + m[2] + law(), xml, count=1, flags=re.DOTALL)


if __name__ == "__main__":
    coefficients, error = fit()
    print(f"thrust, N, of powers of throttle and V / (10 m/s): {dict(zip(TERMS, coefficients, strict=True))}")
    print(f"root-mean-square error of the fit from 6 to 22 m/s: {error:.3f} N; static thrust {thrust(1.0, 0.0):.1f} N")
    if "--write" in sys.argv[1:]:
        (FOLDER / "taurus.xml").write_text(amended_xml(), encoding="utf-8")
