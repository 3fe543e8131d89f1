"""Closed loops that are run and judged without tuning: the same runs, by plant, failed ones named."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from broken_controller import Broken

import vgtjax
from vgtjax import control
from vgtjax.control import PI, Constant, Sine, StaticBalance, Steps, close_loop
from vgtjax.tuning import close_loops, cross_cases
from vgtjax.tuning._sliding_margins import _slide

STIFF = {"diaphragm.stiffness": 14_000.0}
SETTLED = 0.1
REFERENCES = {"sine": Sine(0.001, 12.0, 0.004), "step": Steps(jnp.array([0.1]), jnp.array([0.005]), 0.004, 0.05)}


@pytest.fixture(scope="module")
def plants(actuator):
    return {"printed": actuator, "stiff": vgtjax.replace_parameters(actuator, STIFF)}


@pytest.fixture(scope="module")
def cases(plants):
    return cross_cases(plants, REFERENCES, duration=0.4)


@pytest.fixture(scope="module")
def known(plants, cases):
    """Each plant with the static balance that is its own."""
    return close_loops({name: PI.for_plant(plant) for name, plant in plants.items()}, cases, settled=SETTLED)


def test_figures_are_those_of_each_loop(plants, cases, known):
    for i in (1, 2):
        label, scenario = cases.labels[i], jax.tree.map(lambda leaf, i=i: leaf[i], cases.scenarios)
        run = close_loop(plants[label.plant], PI.for_plant(plants[label.plant]), scenario, 0.4)
        assert known.labels[i] == label
        # Batched and alone differ by rounding, which friction amplifies.
        assert known.rms[i] == pytest.approx(float(control.tracking_rms(run, SETTLED)), rel=1e-6)
        assert known.peak[i] == pytest.approx(float(control.tracking_peak(run, SETTLED)), rel=1e-6)
        np.testing.assert_allclose(known.runs.position[i], run.position, atol=1e-9)
        np.testing.assert_allclose(known.runs.duty[i], run.duty, atol=1e-5)


def test_one_controller_may_serve_all_plants(cases, known):
    printed = close_loops(PI(base=StaticBalance()), cases, settled=SETTLED)
    same, other = (known.where(plant=name).rms for name in ("printed", "stiff"))
    np.testing.assert_allclose(same, printed.where(plant="printed").rms, rtol=1e-9)
    # A spring that is 2 N stiffer per millimetre than believed is an error for the proportional part.
    assert np.all(np.abs(other / printed.where(plant="stiff").rms - 1) > 0.05)


def test_steps_are_answered_and_sines_are_not(known):
    counts = {label.reference: len(answers) for label, answers in zip(known.labels, known.answers, strict=True)}
    assert counts == {"sine": 0, "step": 1}


def test_closed_loops_are_found_by_name(known):
    (place,) = [i for i, each in enumerate(known.labels) if (each.plant, each.reference) == ("stiff", "step")]
    found = known.where(plant="stiff", reference="step")
    assert (found.labels, found.answers) == (known.labels[place : place + 1], known.answers[place : place + 1])
    assert (float(found.rms[0]), found.failed.tolist()) == (known.rms[place], [False])
    np.testing.assert_array_equal(found.runs.duty[0], known.runs.duty[place])
    assert len(known.where(turbine_pressure=0.0, variant="")) == 4
    with pytest.raises(vgtjax.InputError, match="has plant 'soft'; plant is one of 'printed', 'stiff'"):
        known.where(plant="soft")


def test_what_a_controller_does_not_observe_is_not_judged(known):
    assert known.runs.observed is None
    assert np.all(np.isnan(known.pressure_rms))


def test_loops_print_themselves(known):
    title, head, *rows = str(known).splitlines()
    assert title == "4 closed loops from 0.1 s on, 0 failed"
    assert head.startswith("closed loop")
    assert rows[0].startswith("printed, sine, 0 mbar")
    assert f"{1e6 * known.rms[0]:.4g}" in rows[0]


def test_runs_that_fail_have_no_figures(cases):
    wild = close_loops(Broken(), cases, settled=SETTLED)
    assert wild.failed.all()
    assert wild.failure.startswith("The simulation left the finite numbers")
    assert np.all(np.isnan(wild.rms))
    assert wild.answers == [[]] * 4


def test_what_cannot_be_closed_is_refused(cases):
    with pytest.raises(vgtjax.InputError, match="every plant needs a controller, but 'stiff' has none; give it one"):
        close_loops({"printed": PI()}, cases, settled=SETTLED)
    with pytest.raises(vgtjax.InputError, match=r"before the end of runs after 0\.4 s, but it is 0\.4 s; correct it"):
        close_loops(PI(), cases, settled=0.4)
    mixed = {"printed": PI(), "stiff": control.PID()}
    with pytest.raises(vgtjax.InputError, match="controllers must be models of one structure, but their components"):
        close_loops(mixed, cases, settled=SETTLED)


def test_a_plant_without_converter_begins_at_its_stop():
    plants = {"static": vgtjax.plants.StaticMapActuator()}
    with pytest.raises(vgtjax.InputError, match="needs a converter, but StaticMapActuator has none"):
        cross_cases(plants, {"middle": Constant(0.005)}, duration=0.1)
    assert cross_cases(plants, {"stop": Constant(0.0)}, duration=0.1).labels[0].plant == "static"


def test_a_rod_without_stops_has_its_margins_about_the_printed_middle():
    endless = vgtjax.replace_parameters(vgtjax.Actuator(), {"diaphragm.travel": np.inf})
    cases = cross_cases({"endless": endless}, {"hold": Constant(4e-3)}, duration=0.1)
    plant, scenario = (jax.tree.map(lambda leaf: leaf[0], each) for each in (cases.plants, cases.scenarios))
    slide = _slide(plant, scenario)
    assert float(slide.start.position) == float(slide.reference.offset) == 0.5 * 10.13e-3
