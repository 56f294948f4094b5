# ruff: noqa: E501 (lines of XML are as long as those of the packaged models)
"""The JSBSim model of an aircraft from its geometry, in the form of the packaged ones: servos, thrust, wind axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from testbench.aircraft.adapter import SURFACES
from testbench.aircraft.geometry.coefficients import ROWS, Coefficient
from testbench.aircraft.geometry.masses import Balance
from testbench.aircraft.geometry.propulsion import Thrust
from testbench.aircraft.geometry.read import Plan
from testbench.aircraft.geometry.schema import Motor, Servo
from testbench.aircraft.geometry.shape import Moved
from testbench.aircraft.reactions import COEFFICIENTS, MOTIONS
from testbench.core.constants import DEG_RAD, FT_M, LBF_N
from testbench.core.escape import xml_attribute, xml_text

_TRIMS = {"de": "pitch", "da": "roll", "dr": "yaw"}
"""Control -> what its trim command is called by."""
COMMANDS = {control: f"fcs/{name}-cmd-norm" for control, name in SURFACES.items()}


@dataclass(frozen=True)
class Polar:
    """CD = CD0 + k (CL - CL_least_drag)^2."""

    CD0: float
    k: float
    CL_least_drag: float


def model_xml(
    name: str, note: str, plan: Plan, found: Mapping[str, Coefficient], polar: Polar, thrust: Thrust | None
) -> str:
    """Return the text of NAME.xml.

    Args:
        name: of the model.
        note: what the numbers are.
        plan: title, reference, mass, servos and motor; the structural frame begins at the centre of gravity.
        found: the coefficients.
        polar: of the drag.
        thrust: law of the motor, or None for a glider.
    """
    plane, balance, servos, motor = plan.plane, plan.balance, plan.servos, plan.said.motor
    parts = [
        '<?xml version="1.0"?>',
        f'<fdm_config name={xml_attribute(name)} version="2.0" release="BETA">',
        "  <fileheader>",
        "    <author>flight-testbench</author>",
        "    <version>1</version>",
        f"    <description>{xml_text(plan.title)}</description>",
        f"    <note>{xml_text(note)}</note>",
        "  </fileheader>",
        "",
        "  <metrics>",
        f'    <wingarea unit="M2">{_n(plane.S_m2)}</wingarea>',
        f'    <wingspan unit="M">{_n(plane.b_m)}</wingspan>',
        f'    <chord unit="M">{_n(plane.cbar_m)}</chord>',
        *(
            f'    <location name="{point}" unit="M"> <x>0</x> <y>0</y> <z>0</z> </location>'
            for point in ("AERORP", "EYEPOINT", "VRP")
        ),
        "  </metrics>",
        "",
        "  <!-- The origin of the structural frame (x aft, y right, z up) is the centre of gravity; all moment derivatives",
        "       below are about that point. ixz is minus the integral of x z, as JSBSim takes it. -->",
        "  <mass_balance>",
        *(
            f'    <{axis} unit="KG*M2">{_n(value)}</{axis}>'
            for axis, value in (("ixx", balance.Ixx), ("iyy", balance.Iyy), ("izz", balance.Izz), ("ixz", -balance.Ixz))
        ),
        f'    <emptywt unit="KG">{_n(balance.mass_kg)}</emptywt>',
        '    <location name="CG" unit="M"> <x>0</x> <y>0</y> <z>0</z> </location>',
        "  </mass_balance>",
        "",
        "  <ground_reactions/>",
        "",
        *(_propulsion(motor, balance) if motor is not None else ["  <propulsion/>"]),
        "",
        '  <flight_control name="FCS">',
        *(line for control, servo in servos.items() for line in _constants(control, servo)),
        "",
        *(_SERVO_FUNCTIONS.replace("NAME", SURFACES[control]) for control in servos),
        *(line for control, servo in servos.items() for line in _channel(control, servo)),
        *(_thrust_channel(thrust) if thrust is not None else []),
        "  </flight_control>",
        "",
        "  <aerodynamics>",
    ]
    for force in ("CD", "CY", "CL", "Cl", "Cm", "Cn"):
        parts.append(f'    <axis name="{COEFFICIENTS[force][0]}">')
        for c in found.values():
            if c.name == "CD" and force == "CD":
                parts += _drag(polar, found)
            elif c.name != "CD" and (c.name.split("_")[0].removesuffix("0") == force):
                parts += _coefficient(c, force)
        parts.append("    </axis>")
    return "\n".join([*parts, "  </aerodynamics>", "</fdm_config>", ""])


def _n(value: float) -> str:
    return f"{value + 0.0:.8g}"


def _propulsion(motor: Motor, balance: Balance) -> list[str]:
    at = motor.at_m or balance.cg_m
    x, y, z = (a - c for a, c in zip(at, balance.cg_m, strict=True))
    place = f'<location unit="M"> <x>{_n(x)}</x> <y>{_n(y)}</y> <z>{_n(z)}</z> </location>'
    turned = f'<orient unit="DEG"> <roll>0</roll> <pitch>{_n(-motor.down_deg)}</pitch> <yaw>{_n(motor.right_deg)}</yaw> </orient>'
    return [
        "  <propulsion>",
        '    <engine file="motor">',
        f"      {place}",
        '      <orient unit="DEG"> <roll>0</roll> <pitch>0</pitch> <yaw>0</yaw> </orient>',
        '      <thruster file="direct">',
        f"        {place}",
        f"        {turned}",
        "      </thruster>",
        "    </engine>",
        "  </propulsion>",
    ]


def engine_files(thrust: Thrust) -> dict[str, str]:
    """Return name -> text of the files of Engines/."""
    lbf = thrust.static_N / LBF_N
    motor = (
        '<?xml version="1.0"?>\n'
        f"<!-- Static thrust {thrust.static_N:g} N at full throttle. JSBSim hands the power, in ft lbf/s, to the direct thruster,\n"
        f"     which takes the number as thrust in lbf; {thrust.static_N:g} N = {lbf:.7g} lbf, and power[W] = thrust[lbf] x\n"
        "     745.7/550. -->\n"
        f'<electric_engine name="motor">\n  <power unit="WATTS">{lbf * 745.7 / 550.0:.9g}</power>\n</electric_engine>\n'
    )
    return {"motor.xml": motor, "direct.xml": '<?xml version="1.0"?>\n<direct name="direct"/>\n'}


def _constants(control: Moved, servo: Servo) -> list[str]:
    name = SURFACES[control]
    return [
        f'    <property value="{_n(servo.lag_rad_s)}">fcs/{name}-lag-rad_sec</property>',
        f'    <property value="{_n(servo.rate_limit_deg_s * DEG_RAD)}">fcs/{name}-rate-limit-rad_sec</property>',
        f'    <property value="0">fcs/{name}-command-previous-rad</property>',
    ]


_SERVO_FUNCTIONS = """\
    <!-- Servo coefficients, exact for commands that run linearly from frame to frame:
         x+ = a x + b0 c + b1 c+, a = exp(-lag dt), b1 = 1 - (1 - a)/(lag dt), b0 = 1 - a - b1 -->
    <function name="fcs/NAME-servo-x">
      <description>lag times time step; the floor keeps the quotients below defined while time stands still</description>
      <product> <property>fcs/NAME-lag-rad_sec</property> <max> <property>simulation/dt</property> <value>1e-9</value> </max> </product>
    </function>
    <function name="fcs/NAME-servo-a">
      <exp> <product> <value>-1</value> <property>fcs/NAME-servo-x</property> </product> </exp>
    </function>
    <function name="fcs/NAME-servo-b1">
      <difference> <value>1</value> <quotient> <difference> <value>1</value> <property>fcs/NAME-servo-a</property> </difference> <property>fcs/NAME-servo-x</property> </quotient> </difference>
    </function>
    <function name="fcs/NAME-servo-b0">
      <difference> <value>1</value> <property>fcs/NAME-servo-b1</property> <property>fcs/NAME-servo-a</property> </difference>
    </function>"""

_CHANNEL = """\
    <channel name="NAME">
      <fcs_function name="fcs/NAME-command-rad">
        <description>commanded deflection: full stick is FULL rad</description>
        <function>
          <product>
            <value>FULL</value>
            <sum> <property>fcs/NAME-cmd-norm</property> <property>fcs/TRIM-trim-cmd-norm</property> </sum>
          </product>
        </function>
        <clipto> <min>-FULL</min> <max>FULL</max> </clipto>
      </fcs_function>
      <fcs_function name="fcs/NAME-actuator">
        <description>servo: first-order lag (a, b0, b1 above) with rate limit; no lag while time stands still</description>
        <function>
          <ifthen>
            <gt> <property>simulation/dt</property> <value>0</value> </gt>
            <sum>
              <property>POSITION</property>
              <max>
                <product> <value>-1</value> <property>fcs/NAME-rate-limit-rad_sec</property> <property>simulation/dt</property> </product>
                <min>
                  <product> <property>fcs/NAME-rate-limit-rad_sec</property> <property>simulation/dt</property> </product>
                  <sum>
                    <product> <property>fcs/NAME-servo-b0</property> <property>fcs/NAME-command-previous-rad</property> </product>
                    <product> <property>fcs/NAME-servo-b1</property> <property>fcs/NAME-command-rad</property> </product>
                    <product> <difference> <property>fcs/NAME-servo-a</property> <value>1</value> </difference> <property>POSITION</property> </product>
                  </sum>
                </min>
              </max>
            </sum>
            <property>fcs/NAME-command-rad</property>
          </ifthen>
        </function>
        <output>POSITION</output>
      </fcs_function>
      <fcs_function name="fcs/NAME-memory">
        <function> <sum> <property>fcs/NAME-command-rad</property> <value>0</value> </sum> </function>
        <output>fcs/NAME-command-previous-rad</output>
      </fcs_function>
    </channel>"""


def _channel(control: Moved, servo: Servo) -> list[str]:
    (position,), full = MOTIONS[control], f"{servo.throw_deg * DEG_RAD:.7g}"
    text = _CHANNEL.replace("NAME", SURFACES[control]).replace("POSITION", position).replace("FULL", full)
    return [text.replace("TRIM", _TRIMS[control])]


def _thrust_channel(thrust: Thrust) -> list[str]:
    speed = f"<property>velocities/vt-fps</property> <value>{FT_M / 10.0:.8g}</value>"
    terms = []
    for c, i, j in thrust.terms:
        factors = [f"<value>{_n(c)}</value>", *["<property>fcs/throttle-cmd-norm</property>"] * i, *[speed] * j]
        terms.append(f"            <product> {' '.join(factors)} </product>")
    return [
        '    <channel name="thrust">',
        '      <fcs_function name="fcs/thrust-fraction">',
        "        <description>share of the nominal thrust (Engines/motor.xml) over throttle and airspeed (SOURCES.md)</description>",
        "        <function>",
        "          <sum>",
        *terms,
        "          </sum>",
        "        </function>",
        "        <output>fcs/throttle-pos-norm</output>",
        "      </fcs_function>",
        "    </channel>",
    ]


def _drag(polar: Polar, found: Mapping[str, Coefficient]) -> list[str]:
    offset, slope = (
        found["CL0"].used - polar.CL_least_drag if "CL0" in found else -polar.CL_least_drag,
        found["CL_alpha"].used,
    )
    return [
        '      <function name="aero/coefficient/CD">',
        f"        <description>{ROWS['CD'].words}</description>",
        "        <product>",
        "          <property>aero/qbar-psf</property>",
        "          <property>metrics/Sw-sqft</property>",
        "          <sum>",
        f"            <value>{_six(polar.CD0)}</value>",
        "            <product>",
        f"              <value>{_six(polar.k)}</value>",
        f"              <pow> <sum> <value>{_six(offset)}</value> <product> <value>{_six(slope)}</value> "
        "<property>aero/alpha-rad</property> </product> </sum> <value>2</value> </pow>",
        "            </product>",
        "          </sum>",
        "        </product>",
        "      </function>",
    ]


def _six(value: float) -> str:
    return f"{value:.6g}"


def _coefficient(c: Coefficient, force: str) -> list[str]:
    arm, factors = COEFFICIENTS[force][1], MOTIONS[c.name.split("_")[1]] if "_" in c.name else ()
    properties = ["aero/qbar-psf", "metrics/Sw-sqft", *([arm] if arm else []), *factors]
    return [
        f'      <function name="aero/coefficient/{c.name}">',
        f"        <description>{ROWS[c.name].words}</description>",
        "        <product>",
        *(f"          <property>{p}</property>" for p in properties),
        f"          <value>{_six(c.used)}</value>",
        "        </product>",
        "      </function>",
    ]
