"""Compiled programs kept on disk, so that another process neither traces nor compiles them again.

JAX's own cache saves the compilation only; of a march and its derivatives, tracing and lowering take as long as that.
"""

import contextlib
import dataclasses
import functools
import hashlib
import os
import pathlib
import pickle
import re
import tempfile
import threading
import uuid
from collections.abc import Callable, Generator, Hashable, Iterable, Sequence
from concurrent.futures import Future
from typing import Any, Generic, ParamSpec, TypeVar

import equinox as eqx
import filelock
import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental import serialize_executable

from ._naming import Unnamed, is_optimised, name_call

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")

FOLDER: pathlib.Path | None = None
"""Where programs are kept, set by [`configure`][]; without it a function is compiled as `equinox.filter_jit` does."""

_FINDING = threading.Lock()
"""Fits that go on side by side want the same programs at the same time: who comes first makes it."""
_FIRST_LEVEL: dict[str, str | bool] = {"xla_backend_optimization_level": "1"}
"""XLA has made vectors of lanes already: what LLVM's further levels do to a march and its derivatives takes a tenth of
a first fit on a CPU and gains nothing. Populations would take 2 to 5 % longer; their programs are not kept."""
_NO_LEVEL: dict[str, str | bool] = {"xla_backend_optimization_level": "0"}
"""Of what runs once a fit: traces of a bench take a tenth of a second longer so, and compilation over a second less."""
_KNOWN_CALLS = ("lapack", "Sharding", "SPMD")
"""Calls to the outside that mean the same in another process, unlike those to functions of Python."""


@dataclasses.dataclass(frozen=True)
class _Hole:
    """Where an array belongs in what a program returns."""

    place: int


@dataclasses.dataclass(frozen=True)
class _Program:
    """A program from arrays to arrays, and what its output is but for them."""

    run: Callable[..., list[jax.Array]]
    output: Any

    def __call__(self, arrays: list[Any]) -> Any:
        found = self.run(*arrays)
        return jax.tree.map(lambda leaf: found[leaf.place] if isinstance(leaf, _Hole) else leaf, self.output)


class Kept(Generic[P, R]):
    """A compiled function whose programs are kept on disk, see [`keep_compiled`][]."""

    def __init__(self, function: Callable[P, R], options: dict[str, str | bool]) -> None:
        functools.update_wrapper(self, function)
        self._options = options
        self._function: Callable[..., Any] = function
        self._compiled: Callable[..., R] = eqx.filter_jit(function)
        self._programs: dict[Hashable, Future[_Program | None]] = {}

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """The function's value: the same bits, whether its program was kept or not, or rounded otherwise by one that is
        compiled for once."""
        leaves, structure = jax.tree.flatten(args)
        if FOLDER is None or kwargs or any(isinstance(leaf, jax.core.Tracer) for leaf in leaves):
            return self._compiled(*args, **kwargs)
        program = self._program(FOLDER, args, _key(leaves, structure))
        return self._compiled(*args) if program is None else program([leaf for leaf in leaves if eqx.is_array(leaf)])

    def prepare(self, *args: P.args, **kwargs: P.kwargs) -> None:
        """Finds or makes the program for such arguments, which another thread may want meanwhile; runs nothing.

        What another process is making is left to that one.
        """
        if FOLDER is not None and not kwargs:
            with contextlib.suppress(filelock.Timeout):
                self._find_once(FOLDER, args, _key(*jax.tree.flatten(args)), patient=False)

    def _program(self, folder: pathlib.Path, args: tuple[Any, ...], key: Hashable) -> _Program | None:
        """The program for such arguments, made once; none if it can't be named."""
        while True:
            # A thread that compiles ahead may have left this one to another process, for which it does not wait.
            with contextlib.suppress(filelock.Timeout):
                return self._find_once(folder, args, key, patient=True)

    def _find_once(
        self, folder: pathlib.Path, args: tuple[Any, ...], key: Hashable, *, patient: bool
    ) -> _Program | None:
        with _FINDING:
            known = self._programs.get(key)
            program = self._programs.setdefault(key, Future())
        if known is None:
            try:
                program.set_result(self._find(folder, args, patient))
            except BaseException as error:
                del self._programs[key]  # whoever comes next tries again
                program.set_exception(error)
        return program.result()

    def _find(self, folder: pathlib.Path, args: tuple[Any, ...], patient: bool) -> _Program | None:
        """The program for such arguments: the one that was kept, or else a new one; none if it can't be named.

        **Raises:** `filelock.Timeout` when another process is making it, for which this one is not `patient`.
        """
        try:
            name = hashlib.sha256(name_call(self._function, args).encode()).hexdigest()
        except Unnamed:
            return None
        file = folder / f"{self._function.__name__}_{name}.program"
        found = _load(file)
        if found is None:
            with _making(file, patient):
                found = _load(file) or self._make(file, args)
        return found

    def _make(self, file: pathlib.Path, args: tuple[Any, ...]) -> _Program:
        arrays, rest = eqx.partition(args, eqx.is_array)
        leaves, structure = jax.tree.flatten(arrays)
        output: list[Any] = []

        def flat(*leaves: Any) -> list[jax.Array]:
            found = self._function(*eqx.combine(jax.tree.unflatten(structure, leaves), rest))
            values, others = eqx.partition(found, eqx.is_array)
            values, shape = jax.tree.flatten(values)
            holes = jax.tree.unflatten(shape, [_Hole(place) for place in range(len(values))])
            output[:] = [eqx.combine(holes, others)]
            return values

        # What comes from JAX's cache can't be serialised again: it is saved and loaded without an error, but can't be
        # called. With a name that no other process has it is not found there, not even where two make it at once.
        flat.__name__ = flat.__qualname__ = f"{self._function.__name__}_{uuid.uuid4().hex}"
        lowered = jax.jit(flat).lower(*leaves)
        compiled, calls = _compile(lowered, self._options), set(re.findall(r"custom_call @(\w+)", lowered.as_text()))
        if all(call.startswith(_KNOWN_CALLS) for call in calls):
            _save(file, compiled, (output[0], len(leaves), any(call.startswith("lapack") for call in calls)))
        return _Program(compiled, output[0])


def _compile(lowered: jax.stages.Lowered, options: dict[str, str | bool]) -> jax.stages.Compiled:
    """On a CPU with such options of its compiler; other devices, and who wants no optimisation, as they are set."""
    return lowered.compile(options if jax.default_backend() == "cpu" and is_optimised() else None)


def _key(leaves: Sequence[Any], structure: Any) -> Hashable:
    """What arguments of one program have alike: everything but the values of arrays."""
    return (structure, *(_placed(leaf) if eqx.is_array(leaf) else leaf for leaf in leaves))


def _placed(array: Any) -> Hashable:
    return (array.shape, array.dtype, getattr(array, "sharding", None))


def keep_compiled(function: Callable[P, R]) -> Kept[P, R]:
    """`equinox.filter_jit`, whose programs are kept on disk once [`configure`][] was given a cache.

    What is made of a user's own classes is compiled in each process, since their code may have changed.
    """
    return Kept(function, _FIRST_LEVEL)


def keep_compiled_for_once(function: Callable[P, R]) -> Kept[P, R]:
    """`keep_compiled` of what runs so rarely that optimisation takes longer than it gains."""
    return Kept(function, _NO_LEVEL)


@contextlib.contextmanager
def preparing(jobs: Iterable[T], prepare: Callable[[T], None]) -> Generator[None]:
    """Compiles for one job after the other in a thread of its own, as long as the block runs; there jobs that come from
    a generator are made, too."""
    ended = threading.Event()

    def work() -> None:
        # What fails here fails again where it is asked, and is reported there.
        with contextlib.suppress(Exception):
            for job in jobs:
                if ended.is_set():
                    return
                with contextlib.suppress(Exception):
                    prepare(job)

    if jobs and FOLDER is not None:
        threading.Thread(target=work, name="compiling ahead").start()
    try:
        yield
    finally:
        ended.set()


@contextlib.contextmanager
def _making(file: pathlib.Path, patient: bool) -> Generator[None]:
    """While this process makes a program, others wait for it, or leave it to this one; not where nothing can be kept.

    A process that dies leaves no lock behind: it is the system's.
    """
    lock = filelock.FileLock(file.with_suffix(".lock"))
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        lock.acquire(blocking=patient)
    except filelock.Timeout:
        raise
    except (OSError, NotImplementedError):
        pass  # where no lock can be, several make the same program
    try:
        yield
    finally:
        lock.release()


def _save(file: pathlib.Path, compiled: jax.stages.Compiled, about: tuple[Any, int, bool]) -> None:
    """Writes a program, whole or not at all; one that can't be written is compiled anew next time.

    **Arguments:** `about`: its output, the number of its inputs, and whether it calls LAPACK.
    """
    devices = {device.id for sharding in compiled.output_shardings for device in sharding.device_set}
    try:
        payload, _, _ = serialize_executable.serialize(compiled)
        data = pickle.dumps((payload, devices, about))
    except (ValueError, NotImplementedError, TypeError, AttributeError, pickle.PicklingError):
        return  # not every platform serialises, nor every output
    with contextlib.suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=file.parent, delete=False) as part:
            part.write(data)
        os.replace(part.name, file)


def _load(file: pathlib.Path) -> _Program | None:
    """A program that was kept; none if there is none, or one that is spoilt."""
    try:
        payload, ids, (output, count, lapack) = pickle.loads(file.read_bytes())
        if lapack:
            _find_lapack()
        inputs = jax.tree.structure((tuple(range(count)), {}))
        outputs = jax.tree.structure([leaf for leaf in jax.tree.leaves(output) if isinstance(leaf, _Hole)])
        devices = [device for device in jax.devices() if device.id in ids]
        run = serialize_executable.deserialize_and_load(payload, inputs, outputs, execution_devices=devices)
        return _Program(run, output)
    except Exception:  # whatever a broken file raises, in Python or in XLA: it is made anew
        return None


@functools.cache
def _find_lapack() -> None:
    """JAX looks for LAPACK's functions when it lowers the first program that calls one; without that a program that was
    kept would jump to nowhere."""
    jax.jit(jnp.linalg.cholesky).lower(np.eye(1))
