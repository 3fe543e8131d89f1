"""Notebooks run for longer than the optimisation of their programs takes, which tests go without."""

import os


def pytest_runtest_setup() -> None:
    """For the kernel that is about to start."""
    os.environ["JAX_DISABLE_MOST_OPTIMIZATIONS"] = "False"
