"""The pictures of README and manual, drawn from the model: `python -m calibrate.manual.pictures out/example`.

The argument is the folder of the README's main job, whose parameters the first picture shows. All data are simulated.
"""

import pathlib
import sys
from typing import Any

import jax
import jax.numpy as jnp
import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

import vgtjax
from calibrate.study.models import build_model, start_model
from calibrate.study.read import load_study
from calibrate.study.start_file import load_values
from vgtjax.experiments import SlowLoop
from vgtjax.parts import Contact, Vanes

from .contributing import ROOT

IMAGES = ROOT / "docs" / "images"
EXAMPLE = ROOT / "calibrate" / "example"
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "svg.hashsalt": "vgtjax",
    "lines.linewidth": 1.2,
}
FINE = 2e-4
"""s; a tenth of the bristles' fastest answer."""


def fitted(study: pathlib.Path, results: pathlib.Path) -> vgtjax.AbstractModel:
    """The model of a study with the parameters of a file."""
    stated = load_study(study)
    model = build_model(stated)
    return start_model(model, stated, load_values(results, None, stated, model))[0]


def example(model: vgtjax.AbstractModel) -> Figure:
    """A step of the example that ships: samples of the simulated sensors, and the fitted model."""
    trace = vgtjax.load_trace(EXAMPLE / "step_80.csv").window(0.15, 0.75)
    solution = vgtjax.simulate(model, trace)
    sensor, time = trace.channels["x_d"], np.asarray(solution.time)
    left = sensor.value - np.asarray(solution.x_d)
    figure, (position, residual) = plt.subplots(1, 2, figsize=(8.0, 2.6))
    position.plot(
        sensor.time[::15], 1e3 * sensor.value[::15], "o", color="0.6", markersize=3, label="sensor (simulated)"
    )
    position.plot(time, 1e3 * np.asarray(solution.x_d), label="fitted model")
    position.set(xlabel="time, s", ylabel="position, mm")
    position.legend()
    residual.plot(time, 1e6 * (left - left.mean()), ".", color="0.6", markersize=2)
    residual.set(xlabel="time, s", ylabel="what is left, um")
    return figure


def converter() -> Figure:
    """Flow function [2.15], magnetic force [B.1] and orifices [B.2, B.3] with the printed parameters."""
    actuator, duty = vgtjax.Actuator(), jnp.linspace(0.0, 100.0, 201)
    ratio, lift = jnp.linspace(0.0, 1.0, 401), jnp.linspace(-3e-3, 1.5e-3, 451)
    figure, (flow, force, area) = plt.subplots(1, 3, figsize=(9.0, 2.6))
    flow.plot(ratio, vgtjax.flow_function(actuator.air, ratio))
    flow.set(xlabel="pressure ratio", ylabel="flow function")
    force.plot(duty, actuator.converter.magnetic_force.steady_pull(duty, jnp.zeros_like(duty)))
    force.set(xlabel="duty, %", ylabel="magnetic force, N")
    area.plot(1e3 * lift, 1e6 * actuator.converter.orifice_area(lift))
    area.set(xlabel="plunger, mm", ylabel="open orifice, mm2")
    return figure


def friction() -> Figure:
    """Friction force over a slow back and forth of 0.4 mm, LuGre [3.6] and Dahl [3.2] with the printed parameters."""
    time = np.arange(0.0, 5.0, FINE)
    position, velocity = -2e-4 * np.cos(0.8 * np.pi * time), 2e-4 * 0.8 * np.pi * np.sin(0.8 * np.pi * time)
    figure, axis = plt.subplots(figsize=(4.5, 2.8))
    for name, law in (("LuGre", vgtjax.LuGre()), ("Dahl", vgtjax.Dahl())):
        axis.plot(1e6 * position, _force(law, velocity), label=name)
    axis.set(xlabel="position, um", ylabel="friction, N")
    axis.legend()
    return figure


def loops(model: vgtjax.AbstractModel) -> Figure:
    """Slow loops of one of the twenty simulated turbochargers at three turbine pressures [section 4.2]."""
    experiment = SlowLoop(seconds=10.0)
    figure, axis = plt.subplots(figsize=(4.5, 2.8))
    for trace in experiment.traces:
        solution = vgtjax.simulate(model, trace)
        gauge = 1e-2 * (np.asarray(solution.p_act) - trace.atmosphere)
        axis.plot(1e3 * np.asarray(solution.x_d), gauge, label=f"{trace.name[5:-4].lstrip('0') or 0} mbar")
    axis.set(xlabel="position, mm", ylabel="chamber pressure, mbar gauge")
    axis.legend()
    return figure


def _force(law: vgtjax.AbstractFriction, velocity: np.ndarray) -> np.ndarray:
    """Friction in N along a motion, the bristles by Euler's steps of `FINE` seconds."""
    vanes = Vanes(opening=jnp.asarray(0.0), turbine_pressure=jnp.asarray(0.0))

    def step(state: Any, v: Any) -> Any:
        force, rate = law(Contact(velocity=v, mass=jnp.asarray(0.63), vanes=vanes), state, jnp.asarray(0.0))
        return jax.tree.map(lambda z, dz: z + FINE * dz, state, rate), force

    return np.asarray(jax.lax.scan(step, law.initial_state(), jnp.asarray(velocity))[1])


def save(name: str, figure: Figure, folder: pathlib.Path) -> None:
    """A picture as SVG, the same bytes each time."""
    folder.mkdir(parents=True, exist_ok=True)
    figure.tight_layout()
    figure.savefig(folder / f"{name}.svg", metadata={"Date": None})
    plt.close(figure)


def main(results: pathlib.Path, folder: pathlib.Path = IMAGES) -> None:
    """Draws all of them."""
    matplotlib.use("Agg")
    fleet, file = EXAMPLE / "fleet", "parameters.json"
    with plt.rc_context(STYLE):
        save("example", example(fitted(EXAMPLE / "study.toml", results / file)), folder)
        save("converter", converter(), folder)
        save("friction", friction(), folder)
        save("loops", loops(fitted(fleet / "study.toml", fleet / "units" / "unit_01" / file)), folder)


if __name__ == "__main__":
    vgtjax.configure()
    main(pathlib.Path(sys.argv[1]))
