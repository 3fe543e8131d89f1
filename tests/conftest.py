"""One JAX for all tests: double precision, two devices, strict shapes, checked annotations, one compilation cache."""

import gc
import os
import time

# Processes are as many as cores, and the second thread of a small product only waits. What pytest starts inherits it.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import jax
import platformdirs
import pytest
from jaxtyping import install_import_hook

with install_import_hook("vgtjax", "typechecker.checked"):
    import vgtjax

    for name in dir(vgtjax):  # rooms that are imported when first asked for, too
        getattr(vgtjax, name)

# Steps are compiled one by one, not two side by side: a third of the time for a march and its derivatives, and the same
# arithmetic but for rounding. What is measured of speed is not measured here.
vgtjax.simulation._stepping.UNROLL = 1

# Both cores test already: a program that is compiled in parts, on all of them, takes a tenth more of them.
os.environ["XLA_FLAGS"] = f"--xla_cpu_parallel_codegen_split_count=1 {os.environ.get('XLA_FLAGS', '')}".strip()
# Of what is optimised (`support.optimised`, notebooks): LLVM's first level, as of programs that are kept on disk.
os.environ["XLA_FLAGS"] = f"--xla_backend_optimization_level=1 {os.environ.get('XLA_FLAGS', '')}".strip()

CACHE = platformdirs.user_cache_path("vgtjax") / "tests"
vgtjax.configure(cpu_devices=2, cache=CACHE)
vgtjax._kept.FOLDER = None  # tests replace what programs are made of
jax.config.update("jax_numpy_rank_promotion", "raise")
# Most programs here run for milliseconds and compile for seconds, half of them for optimisation; `support.optimised` is
# for those that run.
jax.config.update("jax_disable_most_optimizations", True)
# The kernels of the notebooks find there what others of them have compiled.
os.environ["JAX_COMPILATION_CACHE_DIR"] = str(CACHE)
os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
os.environ["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"

FIRST = (
    "test_reproduction.py",
    "test_identify.py",
    "test_nozzle_loops.py",
    "test_turbine.py",
    "robust_tuning.ipynb",
    "test_edges.py",
    "test_pneumatic_gradients.py",
    "test_march.py",
    "test_processes.py",
    "test_operating_range.py",
    "test_fit_limits.py",
    "chapter_4.ipynb",
    "test_units.py",
    "test_information.py",
    "test_axis.py",
    "test_layout.py",
    "test_structures.py",
    "test_fit_posterior.py",
    "test_compare_turbine.py",
    "test_tuning.py",
    "test_evidence.py",
    "test_gradients.py",
    "chapter_5.ipynb",
    "test_starts.py",
    "test_control.py",
    "test_stage_gradients.py",
    "section_3_5.ipynb",
    "test_manual_commands.py",
    "test_flow_command.py",
    "test_scale.py",
    "test_equations.py",
    "test_tune.py",
    "test_whole_range.py",
    "test_estimation.py",
    "test_posterior.py",
    "test_simulate.py",
)
"""Files of 30 s and more, the longest first: a process that began one of them last would let the others wait."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long files first; the order is else as it was, which xdist keeps by `--no-loadscope-reorder`."""
    order = {name: place for place, name in enumerate(FIRST)}
    items.sort(key=lambda item: order.get(item.path.name, len(order)))


def pytest_collection_finish() -> None:
    """What is there before the first test stays, and garbage collections pass it by: a twentieth of all time."""
    gc.collect()
    gc.freeze()


def pytest_runtest_setup() -> None:
    """Commands in processes of their own go without optimisation as well; of notebooks see their own conftest."""
    os.environ["JAX_DISABLE_MOST_OPTIMIZATIONS"] = "True"


@pytest.fixture(scope="session")
def actuator() -> vgtjax.Actuator:
    """The printed actuator."""
    return vgtjax.Actuator()


FORGET_AFTER = 45.0
"""Seconds of work by a process, in which it compiles about a gigabyte."""
forgotten = [0.0]


@pytest.fixture(scope="module", autouse=True)
def _forget_compiled():
    """What is compiled takes gigabytes in the end; but the next module needs some of it as well."""
    yield
    if time.process_time() - forgotten[-1] > FORGET_AFTER:
        jax.clear_caches()
        forgotten.append(time.process_time())
