"""A small study of a population: three chunks of eight actuators through one short loop and one short step."""

import pathlib
import shutil

from support import EXAMPLE

STUDY = """name = "small & quick"

[[trace]]
file = "unit_01_*mbar.csv"
unit = "{stem:7}"

[experiments]
turbine_pressure = [0]
loop_seconds = 4
steps = [50]
step_seconds = 0.6

[population]
vary = ["diaphragm.stiffness", "friction.coulomb_force", "converter.magnetic_force"]

[population.parameters]
"chamber.volume" = {distribution = "uniform", lower = 4e-5, upper = 8e-5}

[[population.correlation]]
parameters = ["diaphragm.stiffness", "friction.coulomb_force"]
value = 0.7

[tolerance]
samples = 24
lanes = 8

[tolerance.limits]
"hysteresis_0mbar" = {upper = 33.0}
"steady_error_50" = {lower = -0.2, upper = 0.2}

[sensitivity]
base = 16
lanes = 32
gradient_points = 9
replicates = 20
"""


def write_study(folder: pathlib.Path, text: str = STUDY) -> pathlib.Path:
    """The study and its traces in a folder."""
    for path in sorted((EXAMPLE / "loops").glob("unit_01_*.csv")):
        shutil.copy(path, folder / path.name)
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"


LEAD, PRELOAD = "vane_force.nozzle.lead", "diaphragm.preload"


def nozzle_study(lead: float, turbine_pressure: str, study: str) -> str:
    """A study of a short loop of turbines whose vanes' lead varies by that part, and the preload by a hundredth."""
    return f"""[components]
vane_force = "turbine"
[population]
vary = []
[population.parameters]
"{LEAD}" = {{relative = {lead}}}
"{PRELOAD}" = {{relative = 0.01}}
[experiments]
turbine_pressure = {turbine_pressure}
loop_seconds = 4
steps = []
{study}"""
