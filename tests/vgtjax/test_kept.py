"""Programs that are kept on disk: the same bits from another process, and nothing that could have changed since."""

import socket
import subprocess
import sys
import threading

import diffrax
import equinox as eqx
import filelock
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

import vgtjax
from vgtjax import _kept, _naming
from vgtjax._kept import keep_compiled
from vgtjax.simulation._simulate import _simulate


class Both(eqx.Module):
    """What a function may return: arrays, and what is no array."""

    array: Array
    name: str


def linear(matrix, pair, exponent):
    """Calls LAPACK, whose functions another process has yet to find."""
    left, right = pair
    return {"solved": jnp.linalg.solve(matrix, left), "power": right**exponent, "said": "so"}


linear.__module__ = vgtjax.__name__  # as if the library had it: only its sources are known by their contents
MATRIX, PAIR = np.array([[2.0, 1.0], [0.0, 4.0]]), (np.array([1.0, 2.0]), jnp.array(3.0))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(_kept, "FOLDER", tmp_path / "programs")
    return tmp_path / "programs"


def files(folder):
    return sorted(folder.glob("*.program"))


def never(*args):
    raise AssertionError("traced again")


never.__module__, never.__qualname__, never.__name__ = linear.__module__, linear.__qualname__, linear.__name__


def test_another_process_neither_traces_nor_compiles(folder):
    first = keep_compiled(linear)(MATRIX, PAIR, 2)
    (file,) = files(folder)
    found = keep_compiled(never)(MATRIX, PAIR, 2)
    assert found["said"] == "so"
    np.testing.assert_array_equal(found["solved"], first["solved"])
    np.testing.assert_array_equal(found["power"], first["power"])
    np.testing.assert_array_equal(found["solved"], jax.jit(jnp.linalg.solve)(MATRIX, PAIR[0]))
    assert files(folder) == [file]


def test_values_are_no_part_of_a_program_but_shapes_and_settings_are(folder):
    call = keep_compiled(linear)
    call(MATRIX, PAIR, 2)
    assert call(2 * MATRIX, PAIR, 2)["power"] == 9.0
    assert len(files(folder)) == 1
    call(np.eye(3), (np.ones(3), PAIR[1]), 2)
    assert call(MATRIX, PAIR, 3)["power"] == 27.0
    call(MATRIX.astype(np.float32), (PAIR[0].astype(np.float32), PAIR[1]), 2)
    assert len(files(folder)) == 4


def test_other_sources_make_other_programs(folder, monkeypatch):
    keep_compiled(linear)(MATRIX, PAIR, 2)
    monkeypatch.setattr(_naming, "_name_software", lambda: "changed since")
    keep_compiled(linear)(MATRIX, PAIR, 2)
    assert len(files(folder)) == 2


ONE_OF_TWO = """
import sys
import jax, numpy as np, vgtjax
from jax.experimental import multihost_utils
from vgtjax._kept import keep_compiled

where, folder, index = sys.argv[1], sys.argv[2], int(sys.argv[3])
vgtjax.configure(cache=folder)
jax.distributed.initialize(where, 2, index)
load = keep_compiled(vgtjax.LuGre.passivity_margin)
if index == 0:
    load(vgtjax.LuGre())
multihost_utils.sync_global_devices("the first has kept its program")
assert load(vgtjax.LuGre()).is_fully_addressable
"""


def test_a_process_of_a_run_does_not_take_programs_of_another(tmp_path):
    """They are for devices that only that one reaches."""
    with socket.socket() as free:
        free.bind(("localhost", 0))
        where = f"localhost:{free.getsockname()[1]}"
    both = [
        subprocess.Popen(
            [sys.executable, "-c", ONE_OF_TWO, where, str(tmp_path), str(index)], stderr=subprocess.PIPE, text=True
        )
        for index in (0, 1)
    ]
    for process in both:
        _, errors = process.communicate(timeout=120)
        assert process.returncode == 0, errors
    assert len(files(tmp_path / "programs")) == 2


TRACES_ONCE = """
import pathlib, sys, time
import jax.numpy as jnp, numpy as np, vgtjax
from vgtjax._kept import keep_compiled

def slow(x):
    with (folder / "traced").open("a") as file:
        file.write("once")
    time.sleep(2.0)
    return jnp.sum(x**2)

folder = pathlib.Path(sys.argv[1])
slow.__module__ = vgtjax.__name__
vgtjax.configure(cache=folder)
(folder / sys.argv[2]).touch()
while not all((folder / name).exists() for name in "ab"):
    time.sleep(0.01)
assert float(keep_compiled(slow)(np.ones(3))) == 3.0
"""


def test_of_two_processes_at_the_same_time_one_makes_a_program(tmp_path):
    both = [subprocess.Popen([sys.executable, "-c", TRACES_ONCE, str(tmp_path), name]) for name in "ab"]
    assert [process.wait(timeout=120) for process in both] == [0, 0]
    assert (tmp_path / "traced").read_text() == "once"


def test_what_another_process_makes_is_left_to_it_by_who_compiles_ahead(folder):
    call = keep_compiled(linear)
    call(MATRIX, PAIR, 2)
    (file,) = files(folder)
    file.unlink()
    again = keep_compiled(linear)
    with filelock.FileLock(file.with_suffix(".lock")):  # as another process has it
        again.prepare(MATRIX, PAIR, 2)
    assert not files(folder)
    assert again(MATRIX, PAIR, 2)["said"] == "so"
    assert files(folder) == [file]


def test_what_cannot_be_foreseen_is_left_to_who_asks_for_it(folder):
    def jobs():
        yield (MATRIX, PAIR, 2)
        raise ValueError("nothing is known of the next one")

    call, before = keep_compiled(linear), set(threading.enumerate())
    with _kept.preparing(jobs(), lambda job: call.prepare(*job)):
        for thread in set(threading.enumerate()) - before:
            thread.join()  # one that ends with an exception is a warning, and so an error
    assert len(files(folder)) == 1


def test_where_nothing_can_be_kept_a_program_is_made_all_the_same(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setattr(_kept, "FOLDER", tmp_path / "file" / "programs")
    assert keep_compiled(linear)(MATRIX, PAIR, 2)["said"] == "so"


def test_a_spoilt_file_is_made_anew(folder):
    first = keep_compiled(linear)(MATRIX, PAIR, 2)
    (file,) = files(folder)
    for spoilt in (b"", file.read_bytes()[: file.stat().st_size // 2], b"\x80\x04nonsense"):
        file.write_bytes(spoilt)
        np.testing.assert_array_equal(keep_compiled(linear)(MATRIX, PAIR, 2)["solved"], first["solved"])


def test_a_program_that_was_made_before_can_be_kept_again(folder):
    """Two processes may make the same one at the same time, and the second finds in JAX's cache what the first left
    there: kept like that it was loaded without an error, and could not be called."""
    assert jax.config.jax_compilation_cache_dir

    def bent(x):
        return jnp.sin(x) * jnp.cumsum(x)

    bent.__module__, bent.__qualname__ = linear.__module__, "bent"
    x = np.linspace(0.0, 1.0, 1000)
    first = keep_compiled(bent)(x)
    files(folder)[0].unlink()
    for _ in range(2):
        np.testing.assert_array_equal(keep_compiled(bent)(x), first)


def test_what_a_user_wrote_is_not_kept(folder):
    def own(x):
        return x + 1

    class Own(vgtjax.LuGre):
        """A friction law whose code may change from one run to the next."""

    assert keep_compiled(own)(np.ones(2)).tolist() == [2.0, 2.0]
    force = keep_compiled(vgtjax.LuGre.passivity_margin)
    assert force(Own()) == force(vgtjax.LuGre())
    assert len(files(folder)) == 1  # of the library's own law


def test_what_calls_python_is_not_kept(folder):
    def shout(x):
        return jax.pure_callback(lambda x: np.asarray(x) + 1, jax.ShapeDtypeStruct((), x.dtype), x)

    shout.__module__, shout.__qualname__ = linear.__module__, "shout"
    assert keep_compiled(shout)(np.array(1.0)) == 2.0
    assert not files(folder)


def test_inside_of_jit_and_without_a_folder_it_is_a_function_like_others(folder, monkeypatch):
    call = keep_compiled(linear)
    inside = jax.jit(lambda matrix: call(matrix, PAIR, 2)["solved"])(MATRIX)
    monkeypatch.setattr(_kept, "FOLDER", None)
    np.testing.assert_allclose(call(MATRIX, PAIR, 2)["solved"], inside, rtol=1e-15)  # rounding of another program
    assert not folder.exists()


def test_results_that_are_modules_come_back_whole(folder):
    def both(x, name):
        return Both(2 * x, name)

    both.__module__, both.__qualname__ = linear.__module__, "both"
    for _ in range(2):
        found = keep_compiled(both)(np.ones(3), "twice")
        assert (found.name, found.array.tolist()) == ("twice", [2.0, 2.0, 2.0])
    assert len(files(folder)) == 1


def test_a_simulation_is_kept_with_how_it_ended(folder, actuator):
    """Through a model, a drive, steps and an enumeration; to the bit."""
    time = np.linspace(0.0, 0.02, 21)
    trace = vgtjax.Trace(time=time, pwm=np.full(21, 40.0), p_res=np.full(21, 20e3))
    plan = vgtjax.FixedStep().plan(actuator, trace)
    args = (actuator, trace.drive(), trace.start(), time, plan, diffrax.ForwardMode())
    first, again = (keep_compiled(_simulate.__wrapped__)(*args) for _ in range(2))
    assert len(files(folder)) == 1
    assert again.result == first.result == vgtjax.RESULTS.successful
    np.testing.assert_array_equal(again.x_d, first.x_d)


def test_nothing_is_kept_by_a_process_whose_sources_have_changed(folder, monkeypatch):
    """It runs what they were: kept under the name of what they are, that would be served to others."""
    monkeypatch.setattr(_naming, "_IMPORTED", 0.0)
    _naming._name_software.cache_clear()
    try:
        np.testing.assert_allclose(keep_compiled(linear)(MATRIX, PAIR, 2)["power"], [9.0])
        assert files(folder) == []
    finally:
        _naming._name_software.cache_clear()
