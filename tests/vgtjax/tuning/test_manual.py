"""The manual's page on control: a controller of the user's own, and its gains tuned for the user's actuator."""

import dataclasses

import pytest
from python_blocks import python_block

import vgtjax
from vgtjax.tuning import conditions, gain_names


@pytest.fixture(scope="module")
def scope():
    names = {}
    for block in (python_block("docs/control.md", "class Follower"), python_block("docs/control.md", "tuned =")):
        exec(block, names)
    return names


def test_a_controller_of_ones_own_has_gains_and_conditions(scope):
    follower = scope["Follower"]
    assert gain_names(follower()) == ["gain"]
    assert {name: float(value) for name, value in conditions(follower()).items()} == {"gain below its limit": 0.75}
    with pytest.raises(vgtjax.InputError, match=r"gain must be below 8000 %/m, .* but it is 9000\.0; lower it"):
        follower(gain=9000.0)


def test_gains_are_tuned_for_ones_own_actuator(scope):
    controller, tuned = scope["controller"], scope["tuned"]
    assert float(controller.balance.diaphragm.mass) == 0.8
    now, progress = tuned
    assert progress.cost < 0.6 * progress.history[0]
    # The limit's last part in a thousand is kept free.
    assert 2000.0 < float(now.gain) <= 8000.0 * (1 - 1e-3) * (1 + 1e-9)
    assert tuned.problem.objective.combine(tuned.start_costs.costs) == pytest.approx(progress.history[0])
    assert tuned.problem.objective.combine(tuned.costs.costs) == pytest.approx(progress.cost)


def test_a_tuning_prints_its_gains_and_costs(scope):
    tuned = scope["tuned"]
    summary, heads, row = str(tuned).splitlines()
    before, after = (f"{tuned.progress.history[end]:.4g}" for end in (0, -1))
    assert summary.startswith(f"Tuning of Follower on 1 closed loops: cost {before} before, {after} after")
    assert heads.split() == ["gain", "unit", "start", "tuned"]
    assert row.split() == ["gain", "%/m", "2000", f"{float(tuned.controller.gain):.4g}"]
    (gain,) = tuned.gains
    assert (gain.moves_errors, gain.at_bound) == (True, False)
    said = [dataclasses.replace(gain, moves_errors=moves, at_bound=True) for moves in (True, False)]
    assert [line for line in str(dataclasses.replace(tuned, gains=tuple(said))).splitlines() if "%/m" not in line][
        2:
    ] == [
        "gain ended at its bound",
        "gain moves no error of these loops, and could be anything",
    ]
    page = tuned._repr_html_()
    assert summary in page
    assert "<tr><td>gain</td><td>%/m</td><td>2000</td>" in page
