"""Identified constants: what our identification recovers from simulated, noisy bench tests of the printed actuator."""

import dataclasses
import functools
from collections.abc import Callable, Sequence

import numpy as np

import vgtjax
from vgtjax.identification import Identified
from vgtjax.identification.flow_areas import identify_flow_areas
from vgtjax.identification.magnetic_force import identify_magnetic_force
from vgtjax.identification.plunger import identify_plunger

from . import experiments, solenoid
from .rows import Found, Near, Row

POSITION_NOISE, PRESSURE_NOISE = 8e-6, 60.0
"""m and Pa; white noise of the sensors of a bench."""
RATE = 1000
"""Samples a second."""
SECONDS = 16.0
"""One length for all tests, so that one compilation serves them."""
SEED = 2012
ASTRAY = 1.2
"""What is looked for starts from this many times its printed value, so that the start is no answer."""
Test = Callable[[vgtjax.AbstractModel, Sequence[vgtjax.Trace]], Identified]


def _staircase(hold: float) -> np.ndarray:
    """A duty in percent that jumps to another level every so many seconds."""
    levels = np.random.default_rng(SEED).uniform(15.0, 100.0, round(SECONDS / hold))
    return np.repeat(levels, round(RATE * hold))


def _ramps(seconds: float) -> np.ndarray:
    """A duty in percent up to 80 and down again, each within so many seconds."""
    rise = np.linspace(0.0, 80.0, round(RATE * seconds))
    return np.tile(np.concatenate([rise, rise[::-1]]), round(SECONDS / seconds / 2))


@functools.cache
def bench_tests() -> tuple[vgtjax.Trace, ...]:
    """Bench tests of the printed actuator as sensors see them: quick and slow stairs, slow and quick ramps."""
    duties = (_staircase(0.5), _staircase(2.0), _ramps(8.0), _ramps(2.0))
    # A fifth of a second without duty says that the actuator starts at rest.
    return tuple(_measure(np.concatenate([np.zeros(RATE // 5), duty]), number) for number, duty in enumerate(duties))


def _measure(pwm: np.ndarray, number: int) -> vgtjax.Trace:
    time = np.arange(len(pwm)) / RATE
    reservoir = np.full_like(time, experiments.ASSUMED_RESERVOIR)
    trace = vgtjax.Trace(time=time, pwm=pwm, p_res=reservoir, name=f"test {number}")
    solution = vgtjax.simulate(experiments.actuator(), trace)
    noise = np.random.default_rng(SEED + number).normal(size=(2, len(time)))
    return dataclasses.replace(
        trace,
        p_act=np.asarray(solution.p_act) + PRESSURE_NOISE * noise[0],
        x_d=np.asarray(solution.x_d) + POSITION_NOISE * noise[1],
    )


@dataclasses.dataclass(frozen=True)
class Identification:
    """One of our identifications, the parameters that it looks for, and the friction of the actuator under test."""

    test: Test
    names: tuple[str, ...]

    @functools.cached_property
    def found(self) -> Identified:
        """What it finds when the model has all other parameters as printed."""
        model = experiments.actuator()
        astray = {name: ASTRAY * vgtjax.get_parameter(model, name) for name in self.names}
        return self.test(vgtjax.replace_parameters(model, astray), bench_tests())


@dataclasses.dataclass(frozen=True)
class Constant:
    """A printed constant: its row, how the thesis writes it, and where it stands among our parameters.

    `share` is how far off it counts as recovered, as a share of the printed value. The thesis states no uncertainty.
    """

    id: str
    label: str
    printed: str
    where: str
    name: str
    scale: float = 1.0
    unit: str = ""
    index: int = 0
    share: float = 0.05

    def row(self, section: str, identification: Identification, note: str = "") -> Row:
        """The row that compares what `identification` recovers with what was put in."""
        value = self.scale * float(np.ravel(vgtjax.get_parameter(experiments.actuator(), self.name))[self.index])
        return Row(
            id=f"identified-{self.id}",
            section=section,
            quantity=f"{self.label}, identified",
            where=self.where,
            printed=self.printed,
            unit=self.unit,
            rule=Near(value, self.share * value),
            ours=lambda: self._recovered(identification.found),
            reason="Recovered from simulated, noisy tests of the printed actuator, standard error {error}." + note,
            slow=True,
        )

    def _recovered(self, found: Identified) -> Found:
        value, error = (
            self.scale * float(np.ravel(part[self.name])[self.index]) for part in (found.values, found.std_errors)
        )
        return Found(value, {"error": f"{error:.2g} {self.unit}".strip()})


MAGNET = Identification(identify_magnetic_force, ("converter.magnetic_force",))
AREAS = Identification(
    identify_flow_areas,
    (
        "converter.reservoir_orifice_slope",
        "converter.reservoir_orifice_saturation",
        "converter.atmosphere_orifice",
        "chamber.volume",
    ),
)
PLUNGER = Identification(
    identify_plunger,
    ("converter.membrane_stiffness", "converter.return_spring_stiffness", "converter.plunger_damping"),
)


def _force_ratio() -> Found:
    """Identified magnetic force over that of (B.1) at 20, 50 and 80 % duty."""
    duty = np.array([20.0, 50.0, 80.0])
    values = np.polynomial.Polynomial(MAGNET.found.values["converter.magnetic_force"])(duty)
    return Found(tuple(float(ratio) for ratio in values / solenoid.magnetic_force(duty)))


_LAWS = (
    Constant(
        "reservoir-slope",
        "slope of the reservoir's area",
        "0.360e-3 m",
        "(B.2)",
        "converter.reservoir_orifice_slope",
        1e3,
        "mm",
    ),
    Constant(
        "reservoir-saturation",
        "lift of its saturation",
        "2.5e-3 m",
        "(B.2)",
        "converter.reservoir_orifice_saturation",
        1e3,
        "mm",
    ),
    Constant(
        "atmosphere-0",
        "constant of the atmosphere's area",
        "2.299e-8 m2",
        "(B.3)",
        "converter.atmosphere_orifice",
        1e6,
        "mm2",
        0,
    ),
    Constant(
        "atmosphere-1", "its linear coefficient", "1.68e-4 m", "(B.3)", "converter.atmosphere_orifice", 1e3, "mm", 1
    ),
    Constant("atmosphere-2", "its quadratic coefficient", "0.342", "(B.3)", "converter.atmosphere_orifice", 1.0, "", 2),
)
_PLUNGER = (
    Constant("k_mem", "k_mem", "2000 N/m", "Table B.1", "converter.membrane_stiffness", 1.0, "N/m", share=0.15),
    Constant("k_s1", "k_s1", "2400 N/m", "Table B.1", "converter.return_spring_stiffness", 1.0, "N/m", share=0.15),
    Constant("b_p", "b_p", "22 N s/m", "Table B.1", "converter.plunger_damping", 1.0, "N s/m", share=0.15),
)
_UNSEEN_PLUNGER = (
    " Nobody measures the plunger: only its given mass tells these from steeper areas, hence a tolerance of 15 %."
)

ROWS = (
    Row(
        slow=True,
        id="identified-magnetic-force",
        section="2.2.1.1 Magnetic force identification",
        quantity="magnetic force, identified over printed, at 20, 50 and 80 % duty",
        where="(2.8), (2.9), (B.1), Figure 2.8",
        printed="1",
        unit="",
        rule=Near(1.0, 0.01),
        ours=_force_ratio,
        reason="From closed equilibria of simulated, noisy tests of the printed actuator, as (2.8) says.",
    ),
    *(
        constant.row("2.2.1.2 Identification of the plunger's parameters", PLUNGER, _UNSEEN_PLUNGER)
        for constant in _PLUNGER
    ),
    *(constant.row("2.2.2.1 Effective flow area", AREAS) for constant in _LAWS),
    Constant("V_0", "V_0", "60e-6 m3", "Table B.2", "chamber.volume", 1e6, "cm3").row(
        "2.2.3 Pneumatic actuator: chamber", AREAS
    ),
)
