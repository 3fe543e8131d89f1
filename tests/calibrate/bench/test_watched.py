"""What a watched command is said to be at."""

import sys

import pytest

from calibrate.bench.watched import REST, kind_of


def frame_in(file, function):
    """A frame of a function of a file that is not there, below this one."""
    found = []
    code = compile(f"def {function}(): look()", file, "exec")
    names = {"look": lambda: found.append(sys._getframe())}
    exec(code, names)
    names[function]()
    return found[0]


@pytest.mark.parametrize(
    ("file", "function", "kind"),
    [
        ("vgtjax/_kept.py", "_load", "programs from disk"),
        ("vgtjax/estimation/derivatives/_programs.py", "_evaluate", "simulations and their derivatives"),
        ("vgtjax/estimation/search/_point.py", "of", "linear algebra"),
        ("<frozen importlib._bootstrap>", "_find_and_load", "imports"),
        ("elsewhere.py", "run", REST),
    ],
)
def test_a_stack_is_at_the_first_kind_that_it_has_the_places_of(file, function, kind):
    assert kind_of(frame_in(file, function)) == kind
