"""One JAX for all tests: double precision, two CPU devices, strict shapes, annotations that are checked."""

import jax
import platformdirs
import pytest
from jaxtyping import install_import_hook

ROOMS = ("parameters", "parts", "plants", "simulation")
with install_import_hook([f"vgtjax.{room}" for room in ROOMS], "typechecker.checked"):
    import vgtjax

vgtjax.configure(cpu_devices=2, cache=platformdirs.user_cache_path("vgtjax") / "tests")
jax.config.update("jax_numpy_rank_promotion", "raise")


@pytest.fixture(scope="session")
def actuator() -> vgtjax.Actuator:
    """The printed actuator."""
    return vgtjax.Actuator()


@pytest.fixture(scope="module", autouse=True)
def _forget_compiled():
    """Hundreds of compiled functions take gigabytes; a module hardly ever uses those of another."""
    yield
    jax.clear_caches()
