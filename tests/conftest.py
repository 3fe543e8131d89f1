"""One JAX for all tests: double precision, two devices, strict shapes, checked annotations, a compilation cache.

Half of the tests' time is compilation. What runs in their own process is compiled without LLVM's optimisations, which
saves a quarter of that; notebooks, and commands in a process of their own, are compiled as users have it.
"""

import os

import jax
import platformdirs
import pytest
from jaxtyping import install_import_hook

with install_import_hook("vgtjax", "typechecker.checked"):
    import vgtjax

CACHES = platformdirs.user_cache_path("vgtjax")
USERS_FLAGS = os.environ.get("XLA_FLAGS", "")
os.environ["XLA_FLAGS"] = f"{USERS_FLAGS} --xla_backend_optimization_level=0".strip()
vgtjax.configure(cpu_devices=2, cache=CACHES / "tests_unoptimised")
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.block_until_ready(jax.jit(lambda: 0.0)())  # flags are read now, and not again
# For the kernels of the notebooks. A cache of its own: JAX tells programs apart by the flags in the environment.
os.environ["XLA_FLAGS"] = USERS_FLAGS
os.environ["JAX_COMPILATION_CACHE_DIR"] = str(CACHES / "tests")
os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
os.environ["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"

FIRST = (
    "robust_tuning.ipynb",
    "test_reproduction.py",
    "test_identify.py",
    "test_pneumatic_gradients.py",
    "test_tuning.py",
    "chapter_5.ipynb",
    "test_estimation.py",
    "chapter_4.ipynb",
    "test_gradients.py",
    "test_fit.py",
    "test_scale.py",
    "test_vane_force.py",
    "test_evaluate.py",
    "test_line.py",
    "test_identify_mechanical.py",
    "chapters_2_and_3.ipynb",
    "first_steps.ipynb",
)
"""Files of 20 s and more, the longest first: a process that began one of them last would let the others wait."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long files first; the order is else as it was, which xdist keeps by `--no-loadscope-reorder`."""
    order = {name: place for place, name in enumerate(FIRST)}
    items.sort(key=lambda item: order.get(item.path.name, len(order)))


@pytest.fixture(scope="session")
def actuator() -> vgtjax.Actuator:
    """The printed actuator."""
    return vgtjax.Actuator()


@pytest.fixture(scope="module", autouse=True)
def _forget_compiled():
    """Hundreds of compiled functions take gigabytes; a module hardly ever uses those of another."""
    yield
    jax.clear_caches()
