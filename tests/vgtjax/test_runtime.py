"""What `configure` sets, and when it refuses to."""

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

def threads():
    return {{each["num_threads"] for each in threadpoolctl.threadpool_info() if each["user_api"] == "blas"}}

before = threads()
vgtjax.configure()
import {later}
print(before, threads(), sep=";")
"""


def threads_of_blas(first: str, later: str, **settings: str) -> list[str]:
    """Of every BLAS of a process of its own, before it is configured and after; it imports one module before that and
    another one after it."""
    environment = {name: value for name, value in os.environ.items() if name not in _BLAS_THREADS}
    command = [sys.executable, "-c", THREADS.format(first=first, later=later)]
    run = subprocess.run(command, env={**environment, **settings}, capture_output=True, text=True, check=True)
    return run.stdout.strip().split(";")


@pytest.mark.parametrize(("first", "later"), [("scipy.linalg", "math"), ("math", "scipy.linalg")])
def test_blas_has_one_thread_whenever_it_is_loaded(first, later):
    assert threads_of_blas(first, later)[1] == "{1}"


def test_threads_that_a_user_sets_are_kept():
    before, after = threads_of_blas("scipy.linalg", "math", OPENBLAS_NUM_THREADS="2")
    assert after == before  # two, or as many as there are cores


def test_it_is_refused_once_jax_has_started():
    jax.devices()
    with pytest.raises(RuntimeError, match=r"must be called before JAX computes anything; call it first"):
        vgtjax.configure(cpu_devices=3)
