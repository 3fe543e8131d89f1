"""What a sample of a controller costs on the machine that it will run on."""

import ctypes
import dataclasses
import re
import time

import numpy as np

from vgtjax import InputError
from vgtjax.control import AbstractController

from ..output.console import console
from ..temporary import temporary_folder
from .compilers import compile_library, own_compiler, own_system
from .entries import values_of
from .law import FIRST, Law

SAMPLES = 20_000
"""So many are timed together: some ten milliseconds."""
VECTOR = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
TIMED = """
__attribute__((visibility("default"))) double vg_time(const double *p, const double *u, int samples) {{
    double x[{memory} + 1], out[{outputs} + {memory}], sum = 0.0;
    vg_start(p, u, x);
    for (int i = 0; i < samples; ++i) {{
        vg_update(p, u, x, out);
        for (int k = 0; k < {memory}; ++k) x[k] = out[{outputs} + k];
        for (int k = 0; k < {outputs}; ++k) sum += out[k];
    }}
    return sum;
}}
"""


@dataclasses.dataclass(frozen=True)
class SampleCost:
    """Cost of one sample in C; `seconds` are of one core of this machine, `None` without a compiler for it.

    `memory` and `parameters` are numbers of 8 bytes that are kept; `operations` are sums, products, comparisons and
    elementary functions, with those of both branches, and of a loop until a condition once.
    """

    operations: int
    memory: int
    parameters: int
    seconds: float | None


def sample_cost(controller: AbstractController, period: float) -> SampleCost:
    """Cost of a sample of a controller.

    **Raises:** `InputError` for a controller that no C is known for.
    """
    law = Law(controller, period)
    text = law.to_c()
    update = text[text.index("vg_update") :]
    return SampleCost(count_operations(update), len(law.memory), len(law.entries), _seconds(law, text))


def cost_on_target(controller: AbstractController, period: float) -> SampleCost | None:
    """What a sample will cost on its target; a controller without C is said to have none."""
    try:
        return sample_cost(controller, period)
    except InputError as error:
        console.print(f"note: the controller cannot be exported: {error}")
        return None


def count_operations(function: str) -> int:
    """Statements that compute something, those in a loop of known length as often as they run."""
    times, count = [1], 0
    for line in map(str.strip, function.splitlines()):
        if line.endswith("{"):
            length = re.search(r"(\w+) = 0; \1 < (\d+)|= (\d+) - 1; ", line)
            times.append(times[-1] * (int(length[2] or length[3]) if length else 1))
        elif line.startswith("}"):
            times.pop()
        elif re.match(r"const (double|int) \w+ = ", line):
            count += times[-1]
    return count


def _seconds(law: Law, text: str) -> float | None:
    system, compiler = own_system(), own_compiler()
    if system is None or compiler is None or system == "win64":
        return None
    sizes = {"memory": len(law.memory), "outputs": len(law.outputs)}
    library = compile_library(text + TIMED.format(**sizes), system, (compiler, "-fPIC"))
    p, u = values_of(law.controller), np.array([FIRST.get(name, 0.0) for name in law.inputs])
    with temporary_folder() as folder:
        path = folder / "law.so"
        path.write_bytes(library)
        call = ctypes.CDLL(str(path)).vg_time
        call.restype, call.argtypes = ctypes.c_double, [VECTOR, VECTOR, ctypes.c_int]
        call(p, u, SAMPLES // 10)
        begin = time.perf_counter()
        call(p, u, SAMPLES)
        return (time.perf_counter() - begin) / SAMPLES
