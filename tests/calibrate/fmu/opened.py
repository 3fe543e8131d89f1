"""FMUs as other tools open them."""

import pathlib

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave

import vgtjax
from calibrate.fmu import compilers


def own_only() -> dict[str, tuple[str, ...]]:
    """Other systems take another compiler minutes."""
    system = compilers.own_system()
    return {system: compilers.compilers()[system]}


class Unit:
    """An instance of an FMU for co-simulation, its variables by name."""

    def __init__(self, path: pathlib.Path, folder: pathlib.Path, **values: float):
        self.description = fmpy.read_model_description(str(path))
        unpacked = fmpy.extract(str(path), unzipdir=str(folder))
        self.places = {each.name: each.valueReference for each in self.description.modelVariables}
        identifier = self.description.coSimulation.modelIdentifier
        self.slave = FMU2Slave(guid=self.description.guid, unzipDirectory=unpacked, modelIdentifier=identifier)
        self.slave.instantiate()
        self.slave.setupExperiment()
        self.slave.enterInitializationMode()
        for name, value in values.items():
            self[name] = value

    def __setitem__(self, name: str, value: float) -> None:
        setter = self.slave.setBoolean if isinstance(value, bool) else self.slave.setReal
        setter([self.places[name]], [value])

    def __getitem__(self, name: str) -> float:
        return self.slave.getReal([self.places[name]])[0]

    def ramp(self, name: str, start: float, rate: float) -> None:
        self[name] = start
        self.slave.setRealInputDerivatives([self.places[name]], [1], [rate])

    def run(self, trace: vgtjax.Trace, outputs: tuple[str, ...]) -> np.ndarray:
        """Along the intervals of a trace, one communication step each."""
        drive, found = trace.drive(), []
        for i in range(len(trace.time)):
            self["pwm"] = drive.pwm[i]
            self.ramp("p_res", drive.reservoir.start[i], drive.reservoir.rate[i])
            self.ramp("p_trb", drive.turbine.start[i], drive.turbine.rate[i])
            if i == 0:
                self.slave.exitInitializationMode()
            found.append([self[name] for name in outputs])
            if i < len(trace.time) - 1:
                self.slave.doStep(trace.time[i], drive.duration[i])
        return np.array(found).T
