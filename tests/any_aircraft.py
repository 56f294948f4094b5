"""Scenarios of every kind for an aircraft that is not packaged, in small: what a user would write on the first day."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path

from commands import command

from testbench.core.paths import SUITES

GUIDE = Path(__file__).resolve().parents[1] / "docs" / "guides" / "aircraft_from_geometry.md"


def geometry_of_the_guide() -> str:
    """Return the plan of a small UAV, with which the guide begins."""
    return re.search(r"```toml\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)[1]


@dataclass(frozen=True)
class Visitor:
    """An aircraft that somebody brings, and how it is flown."""

    name: str
    V_m_s: float
    h_m: float
    step_s: float = 0.5
    amplitude_deg: float = 1.0
    throttle: bool = True
    from_geometry: bool = False

    def made(self, folder: Path) -> Visitor:
        """Return the visitor with its aircraft made in a folder from the guide's geometry, as a user would."""
        plan = folder / f"{self.name}.toml"
        plan.write_text(geometry_of_the_guide(), encoding="utf-8")
        done = command("aircraft", "new", plan, "-o", folder / self.name)
        assert done.returncode == 0, done.stderr
        return replace(self, name=str(folder / self.name))

    def write(self, folder: Path) -> dict[str, Path]:
        """Write one scenario of every kind; return question -> file."""
        out = {}
        if not self.throttle:  # and no sensor of its command
            first, *sensors = (SUITES / "eolo_gap.toml").read_text(encoding="utf-8").split("[[sensor]]")
            kept = "[[sensor]]".join([first, *(x for x in sensors if '"thr_cmd"' not in x)])
            (folder / "suites").mkdir(exist_ok=True)
            (folder / "suites" / "glider.toml").write_text(kept, encoding="utf-8")
        for question, text in self.scenarios().items():
            out[question] = folder / f"{question}_{self.name.rpartition(':')[2].rpartition('/')[2]}.toml"
            out[question].write_text(text, encoding="utf-8")
        return out

    def scenarios(self) -> dict[str, str]:
        """Return question -> text of its scenario."""
        head = f'title = "{self.name}: first day"\naircraft = "{self.name}"\nseed = 1\n'
        condition = f"[condition]\nV_m_s = {self.V_m_s}\nh_m = {self.h_m}\n"
        signal = f'{{ signal = "3211", control = "de", amplitude_deg = {self.amplitude_deg}, step_s = {self.step_s} }}'
        length = 7.0 * self.step_s + 6.0
        flown = (
            f'[[manoeuvre]]\nname = "3-2-1-1"\nuse = "identification"\nduration_s = {length}\ninput = [{signal}]\n'
            f'[[manoeuvre]]\nname = "doublet"\nuse = "validation"\nduration_s = {length}\n'
            f'input = [{{ signal = "doublet", control = "de", amplitude_deg = {self.amplitude_deg}, '
            f"period_s = {2.0 * self.step_s} }}]\n"
        )
        identified = (
            '[identification]\ninputs = ["de"]\noutputs = ["alpha", "q"]\n'
            '[[identification.estimators]]\nmethod = "output_error"\nstructure = "short_period"\n'
        )
        run = f'{head}suites = ["eolo_alpha"]\n{condition}{flown}{identified}'
        compare = (
            f'{head}seeds = 3\nsuites = ["eolo_no_alpha", "eolo_alpha"]\n{condition}{flown}'
            '[identification]\ninputs = ["de"]\nbest_case = true\n[targets]\nmodes = ["short period"]\n'
            'parameters = ["M_alpha", "M_q", "M_de"]\n'
        )
        design = (
            f'{head}suites = ["eolo_alpha"]\ncontrols = ["de"]\nduration_s = 12.0\nstart_s = 1.0\nrealise = 5\n'
            f"{condition}"
            '[targets]\nparameters = { M_alpha = 5.0, M_q = 5.0, M_de = 5.0 }\nmodes = ["short period"]\n'
            f"[limits]\ndeflection_deg = {{ de = {4.0 * self.amplitude_deg} }}\nload_factor = [0.0, 2.0]\n"
            "alpha_deg = [-8.0, 14.0]\nspeed_change_m_s = 10.0\npitch_change_deg = 30.0\n"
        )
        energy = 'kind = "fuel"\ncapacity_kg = 20000.0\nefficiency_percent = 25.0\nsource = "assumed"\n'
        if not self.throttle:
            energy = f'kind = "tow"\nrelease_m = {self.h_m + 500.0}\nlowest_m = 300.0\n'
        plan = (
            f'{head}flown_by = "autopilot"\nspeeds_m_s = [{self.V_m_s}]\nheights_m = [{self.h_m}]\n'
            'suite = "eolo_alpha"\n'
            "[limits]\nload_factor = [0.0, 2.5]\nalpha_deg = [-8.0, 16.0]\nspeed_change_m_s = 15.0\n"
            "height_change_m = 200.0\npitch_change_deg = 35.0\n"
            f"[timing]\nturn_s = 60.0\noverhead_s = 300.0\n[energy]\n{energy}"
            f'[[manoeuvre]]\nname = "elevator 3211"\nduration_s = {length}\nrepeats = 2\ninput = [{signal}]\n'
        )
        vary = '"aircraft.mass_percent" = { kind = "normal", mean = 0.0, std = 2.0 }\n'
        vary += '"coefficient.Cm_alpha" = { kind = "lognormal", median = 1.0, sigma = 0.1 }\n'
        nested = run.replace("[[", "[[scenario.").replace("\n[", "\n[scenario.").replace("[scenario.[", "[[")
        campaign = f'title = "{self.name}: scatter"\nruns = 4\nseed = 1\n[vary]\n{vary}[scenario]\n' + nested.replace(
            "seed = 1\n", "", 1
        )
        suite = "eolo_gap" if self.throttle else "glider"
        hidden = '[hidden]\neffects = [{ effect = "actuator_lag", lag_rad_s = 5.0 }]\n'
        gap = f'{head}suite = "{suite}"\n{condition}{hidden}{flown}'
        return {
            "run": run, "compare": compare, "design": design, "plan": plan, "campaign": campaign, "gap": gap,
        }  # fmt: skip


VISITORS = (
    Visitor("jsbsim:c172p", 43.0, 1000.0, 0.4, 1.5),
    Visitor("jsbsim:f16", 150.0, 3000.0, 0.4, 1.0),
    Visitor("jsbsim:SGS", 29.0, 1000.0, 0.4, 1.5, throttle=False),
    Visitor("jsbsim:B747", 150.0, 3000.0, 1.0, 1.5),
    Visitor("trainer", 14.0, 100.0, 0.2, 1.5, from_geometry=True),
)
