"""What computed a result: Python, the processor and the packages that its numbers depend on."""

import importlib.metadata
import platform

PACKAGES = ("vgtjax", "jax", "jaxlib", "equinox", "diffrax", "optimistix", "lineax", "numpy")


def software() -> dict[str, str]:
    """Versions by name, that of Python first; `machine` is the kind of processor."""
    versions = {name: importlib.metadata.version(name) for name in PACKAGES}
    return {"python": platform.python_version(), "machine": platform.machine(), **versions}
