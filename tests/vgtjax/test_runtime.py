"""What `configure` sets, in processes of their own."""

import os
import subprocess
import sys

import jax
import pytest

import vgtjax
from vgtjax._runtime import _BLAS_THREADS

THREADS = """
import {first}
import threadpoolctl
import vgtjax
vgtjax.configure()
import {later}
print({{each["num_threads"] for each in threadpoolctl.threadpool_info() if each["user_api"] == "blas"}})
"""


def threads_of_blas(first: str, later: str, **settings: str) -> str:
    """Of every BLAS of a process that imports one module before and another after it is configured."""
    environment = {name: value for name, value in os.environ.items() if name not in _BLAS_THREADS}
    code = THREADS.format(first=first, later=later)
    command = [sys.executable, "-c", code]
    run = subprocess.run(command, env={**environment, **settings}, capture_output=True, text=True, check=True)
    return run.stdout.strip()


@pytest.mark.parametrize(("first", "later"), [("scipy.linalg", "math"), ("math", "scipy.linalg")])
def test_blas_has_one_thread_whenever_it_is_loaded(first, later):
    assert threads_of_blas(first, later) == "{1}"


def test_threads_that_a_user_sets_are_kept():
    assert threads_of_blas("scipy.linalg", "math", OPENBLAS_NUM_THREADS="2") == "{2}"


def test_it_is_refused_once_jax_has_started():
    jax.devices()
    with pytest.raises(RuntimeError, match=r"must be called before JAX computes anything; call it first"):
        vgtjax.configure(cpu_devices=3)
