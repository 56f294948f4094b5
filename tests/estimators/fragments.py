"""Identified aerodynamics in a bare JSBSim model: what force and moment they give at a state."""

import numpy as np

from testbench.core.constants import FT_M, LBF_N, SLUG_KG


def flown(folder, fragment, at, mass):
    """Aerodynamic force (N) and moment (N m) that JSBSim has in body axes at a state, still air, 500 m up."""
    import jsbsim

    inertia = mass.mass / SLUG_KG
    per_slug_ft2 = SLUG_KG * FT_M**2
    text = f"""<?xml version="1.0"?>
<fdm_config name="identified" version="2.0">
 <fileheader/>
 <metrics><wingarea unit="M2">1.0</wingarea><wingspan unit="M">3.0</wingspan><chord unit="M">0.4</chord>
  <location name="AERORP" unit="M"><x>0</x><y>0</y><z>0</z></location></metrics>
 <mass_balance><ixx unit="SLUG*FT2">{mass.Ixx / per_slug_ft2}</ixx><iyy unit="SLUG*FT2">{mass.Iyy / per_slug_ft2}</iyy>
  <izz unit="SLUG*FT2">{mass.Izz / per_slug_ft2}</izz><ixz unit="SLUG*FT2">{mass.Ixz / per_slug_ft2}</ixz>
  <emptywt unit="LBS">{inertia * 32.17405}</emptywt>
  <location name="CG" unit="M"><x>0</x><y>0</y><z>0</z></location></mass_balance>
 <ground_reactions/><flight_control name="none"/>
 {fragment}
</fdm_config>"""
    (folder / "identified").mkdir(exist_ok=True)
    (folder / "identified" / "identified.xml").write_text(text)
    jsbsim.FGJSBBase().debug_lvl = 0
    fdm = jsbsim.FGFDMExec(str(folder))
    fdm.set_debug_level(0)
    fdm.set_aircraft_path(str(folder))
    assert fdm.load_model("identified")
    for name, value in at.items():
        fdm[name] = value
    assert fdm.run_ic()
    for name in ("elevator", "left-aileron", "rudder"):
        fdm[f"fcs/{name}-pos-rad"] = at.get(f"fcs/{name}-pos-rad", 0.0)
    fdm.get_auxiliary()
    fdm.run_ic()
    force = [fdm[f"forces/fb{axis}-aero-lbs"] * LBF_N for axis in "xyz"]
    return np.array(force), np.array([fdm[f"moments/{axis}-aero-lbsft"] * LBF_N * FT_M for axis in "lmn"])


def state_at(V, alpha, theta, beta=0.0, p=0.0, q=0.0, r=0.0, **surfaces):
    return {
        "ic/h-sl-ft": 500.0 / FT_M,
        "ic/vt-fps": V / FT_M,
        "ic/alpha-rad": alpha,
        "ic/beta-rad": beta,
        "ic/theta-rad": theta,
        "ic/p-rad_sec": p,
        "ic/q-rad_sec": q,
        "ic/r-rad_sec": r,
        **{f"fcs/{name.replace('_', '-')}-pos-rad": value for name, value in surfaces.items()},
    }
