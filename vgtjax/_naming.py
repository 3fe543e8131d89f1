"""Names of calls that mean the same in every process: what is called, with what, and by which software."""

import dataclasses
import enum
import functools
import hashlib
import importlib.metadata
import os
import pathlib
import platform
import time
import types
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np

_VERSIONED = ("vgtjax", "jax", "jaxlib", "equinox", "diffrax", "lineax", "optimistix", "numpy")
"""Packages whose version, or sources, are part of every name: there a class is known by what it is called."""
_SETTINGS = ("jax_enable_x64", "jax_debug_nans", "jax_default_matmul_precision")
"""What else decides what a function is compiled to."""
_IMPORTED = time.time()
"""When the sources were read that run here, or were soon."""


class Unnamed(Exception):
    """Something that no text can tell from others in another process, for instance an object of a user's own class,
    whose code may have changed since."""


def name_call(function: Callable[..., Any], args: tuple[Any, ...]) -> str:
    """What is called with what; arrays by shape, precision and devices only.

    **Raises:** `Unnamed`.
    """
    return f"{_name_software()}|{_name(function)}|{_name_tree(args)}"


def _name_tree(value: Any) -> str:
    """A PyTree of modules and containers, whose arrays are not looked into."""
    if eqx.is_array(value):
        return f"{value.dtype}{value.shape}{_name_placing(value)}"
    if isinstance(value, eqx.Module):
        fields = (
            f"{field.name}={(_name if field.metadata.get('static') else _name_tree)(getattr(value, field.name, None))}"
            for field in dataclasses.fields(value)
        )
        return f"{_name(type(value))}({','.join(fields)})"
    if type(value) in (tuple, list):
        return f"{type(value).__name__}({','.join(map(_name_tree, value))})"
    if type(value) is dict:
        return f"dict({','.join(f'{_name(key)}:{_name_tree(each)}' for key, each in value.items())})"
    return _name(value)


def _name(value: Any) -> str:
    """What is not traced: it is all in the name."""
    if value is None or type(value) in (bool, int, float, str, bytes):
        return repr(value)
    if isinstance(value, type | types.FunctionType):
        return _name_definition(value)
    if isinstance(value, enum.Enum):
        return f"{_name(type(value))}.{value.name}"
    if isinstance(value, np.dtype):
        return str(value)
    if isinstance(value, functools.partial):
        return f"partial({_name(value.func)},{_name(value.args)},{_name(value.keywords)})"
    if type(value) in (tuple, list):
        return f"{type(value).__name__}({','.join(map(_name, value))})"
    if type(value) is dict:
        return f"dict({','.join(f'{_name(key)}:{_name(each)}' for key, each in value.items())})"
    if dataclasses.is_dataclass(value):
        fields = (f"{field.name}={_name(getattr(value, field.name))}" for field in dataclasses.fields(value))
        return f"{_name(type(value))}({','.join(fields)})"
    raise Unnamed(repr(value))


def _name_definition(value: Any) -> str:
    """A class or a function of a versioned package, or of Python itself."""
    package = value.__module__.split(".")[0]
    if package not in (*_VERSIONED, "builtins") or "<" in value.__qualname__:
        raise Unnamed(f"{value.__module__}.{value.__qualname__}")
    return f"{value.__module__}.{value.__qualname__}"


def _name_placing(array: Any) -> str:
    """How an array is spread over devices; nothing where it is whole on the first."""
    sharding = getattr(array, "sharding", None)
    if sharding is None or isinstance(sharding, jax.sharding.SingleDeviceSharding):
        return ""
    if not isinstance(sharding, jax.sharding.NamedSharding):
        raise Unnamed(repr(sharding))
    return f"@{dict(sharding.mesh.shape)}{sharding.spec}"


def is_optimised() -> bool:
    """Whether JAX has programs optimised, unless `jax_disable_most_optimizations` is set."""
    return not jax.config.values["jax_disable_most_optimizations"]


@functools.cache
def _name_software() -> str:
    """This library's sources, the packages below it, JAX's settings, the machine, and which process of a run it is.

    **Raises:** `Unnamed` where a source has changed since this library was imported, as what runs is another one.
    """
    sources = hashlib.sha256()
    root = pathlib.Path(__file__).parent
    for file in sorted(root.rglob("*.py")):
        if file.stat().st_mtime > _IMPORTED:
            raise Unnamed(f"{file} has changed since it was imported")
        sources.update(str(file.relative_to(root)).encode() + b"\0" + file.read_bytes() + b"\0")
    versions = [f"{package} {importlib.metadata.version(package)}" for package in _VERSIONED if package != "vgtjax"]
    devices = [f"{device.platform} {device.device_kind}" for device in jax.devices()]
    settings = [os.environ.get("XLA_FLAGS", ""), *(str(getattr(jax.config, name)) for name in _SETTINGS)]
    settings.append(str(is_optimised()))
    # A program runs on the devices that it was made for, which another process of the same run can't reach.
    process = f"process {jax.process_index()} of {jax.process_count()}"
    versions += [*devices, *settings, process, platform.platform(), _name_processor()]
    return "|".join([sources.hexdigest(), *versions])


def _name_processor() -> str:
    """What instructions there are: a program made for others would end the process."""
    try:
        lines = pathlib.Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:  # not Linux
        return f"{platform.machine()} {platform.processor()}"
    return "".join(sorted({line for line in lines if line.startswith(("flags", "Features", "model name"))}))
