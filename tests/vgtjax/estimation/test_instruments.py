"""Gains of sensors and offsets of inputs as unknowns: found where the traces tell, honest where they do not."""

import numpy as np
import pytest
from known_truth import FREE, NOISE, TRUTH, bench

import vgtjax
from vgtjax import InputError
from vgtjax.assurance import examine
from vgtjax.estimation import Unknown, calibrate, plan_task


def unknown(**choices):
    return Unknown(duty_delay=False, duty_hold=False, noise="white", loss="gaussian", numerics=False, **choices)


def task(trace=None, free=FREE, gains=None, offsets=None, **choices):
    model = vgtjax.Actuator()
    traces = [bench(0) if trace is None else trace]
    return plan_task(model, traces, free=free, unknown=unknown(**choices), gains=gains, offsets=offsets)


def test_a_gain_is_found_with_its_error():
    """A position that shows 2 % too much, beside parameters that a held area lets the traces tell."""
    trace = bench(1)
    found = calibrate(task(trace.replace(x_d=1.02 * trace.x_d), gain=("x_d",)))
    (entry,), ((gain, error),) = zip(*found.instruments.items(), strict=True)
    assert entry == "gain.x_d"
    assert error < 0.005
    assert abs(gain - 1.02) < 4 * error
    truth = {**TRUTH, "gain.x_d": 1.02}
    wanted = np.array([truth[entry] for entry in found.task.selection.entries])
    assert np.all(np.abs(found.values - wanted) < 4 * found.std_errors)
    assert isinstance(found.model, vgtjax.Actuator)  # what was there, without its sensors
    assert "gain.x_d" in str(found)


def test_an_offset_of_an_input_is_found():
    trace = bench(2)
    found = calibrate(task(trace.replace(p_res=trace.p_res + 3000.0), offset=("p_res",)))
    offset, error = found.instruments["offset.p_res"]
    assert abs(offset - 3000.0) < 4 * error < 2000.0


def test_a_gain_beside_the_area_is_a_null_direction_in_words():
    """Positions, forces by the area and masses of gas scale together; a spring, force over position, stays."""
    free = ["diaphragm.area", "diaphragm.mass", "diaphragm.preload", "diaphragm.stiffness", "diaphragm.travel"]
    free += ["friction.*", "chamber.volume", "converter.*stiffness", "converter.*orifice*", "converter.plunger_damping"]
    free += ["converter.plunger_mass", "diaphragm.stop*"]
    known = examine(task(free=free, gain=("x_d",)))
    groups = [group for group in known.null if "gain.x_d" in group]
    assert groups
    assert {"diaphragm.area", "diaphragm.preload", "chamber.volume"} <= set(groups[0])
    assert "diaphragm.stiffness" not in groups[0]
    assert any("gain.x_d" in sentence and "measure one of them" in sentence for sentence in known.sentences)


@pytest.fixture(scope="module")
def mechanical():
    """The rod, driven by a pressure that its sensor shows 150 Pa too high."""
    full = bench(3)
    pressure = full.p_act + 150.0 + 150.0
    return vgtjax.Trace(full.time, p_act=pressure, x_d=full.x_d, name="rod")


def fit_rod(trace, offsets, **choices):
    free = ["diaphragm.stiffness", "diaphragm.preload"]
    values = {name: TRUTH[name] for name in free}
    return calibrate(
        plan_task(
            vgtjax.MechanicalActuator(), [trace], free=free, values=values, offsets=offsets, unknown=unknown(**choices)
        )
    )


def test_an_input_that_counts_as_exact_makes_a_preload_wrong_and_one_that_does_not_does_not(mechanical):
    """150 Pa on an area of 0.0113 m2 are 1.7 N, which a thousand samples would swear to."""
    blind = fit_rod(mechanical, None, input_noise=False)
    number = blind.task.selection.entries.index("diaphragm.preload")
    assert abs(blind.values[number] - TRUTH["diaphragm.preload"]) > 10 * blind.std_errors[number]
    known = fit_rod(mechanical, {"p_act": 150.0}, offset=("p_act",))
    number = known.task.selection.entries.index("diaphragm.preload")
    assert abs(known.values[number] - TRUTH["diaphragm.preload"]) < 3 * known.std_errors[number]
    area = float(vgtjax.MechanicalActuator().diaphragm.area)
    assert known.std_errors[number] == pytest.approx(150.0 * area, rel=0.1)


def test_an_offset_that_nothing_is_known_of_leaves_the_preload_undetermined(mechanical):
    found = fit_rod(mechanical, None, offset=("p_act",))
    known = dict(zip(found.task.selection.entries, found.uncertainty.estimable.tolist(), strict=True))
    assert known == {"diaphragm.preload": False, "diaphragm.stiffness": True, "offset.p_act": False}


@pytest.mark.parametrize(
    ("choices", "sentence"),
    [
        (
            {"gain": ("f_drive",)},
            r"the gain .* one of x_d, p_act, p_res, p_trb with this model, but it is 'f_drive'; drop it",
        ),
        ({"offset": ("f_drive",)}, r"the offset .* one of p_res, p_trb with this model, but it is 'f_drive'; drop it"),
        (
            {"offset": ("p_trb",)},
            r"a free offset of p_trb needs that column, but the trace has none; drop it, or record it",
        ),
    ],
)
def test_a_sensor_that_can_not_be_free_is_refused(choices, sentence):
    with pytest.raises(InputError, match=sentence):
        task(**choices)


@pytest.mark.parametrize(
    ("stated", "argument", "sentence"),
    [
        ({"gains": {"x_dd": 0.01}}, "gains", "channel of gains 'x_dd' matches nothing; did you mean 'x_d'?"),
        ({"offsets": {"p_rs": 50.0}}, "offsets", "channel of offsets 'p_rs' matches nothing; did you mean 'p_res'?"),
        ({"gains": {"x_d": 0.0}}, None, "what gains has of x_d must be a positive number, but it is 0.0; use its"),
        ({"offsets": {"p_res": -1.0}}, None, "what offsets has of p_res must be a positive number, but it is -1.0;"),
        ({"starts": 0}, None, "starts must be a positive number of places, but it is 0; use 1 for the start values"),
    ],
)
def test_what_is_known_of_sensors_and_starts_is_checked(stated, argument, sentence):
    with pytest.raises(InputError) as caught:
        plan_task(vgtjax.Actuator(), [bench(0)], free=FREE, **stated)
    assert str(caught.value).startswith(sentence)
    assert caught.value.argument == argument


def test_gains_and_start_states_keep_to_their_domains():
    with pytest.raises(InputError, match=r"'gain\.x_d' must be finite and not negative, but it is -1; correct it"):
        vgtjax.plants.Gains(x_d=np.array(-1.0))


def test_the_offset_of_what_is_fitted_is_no_further_unknown():
    assert task(offset=("x_d", "p_act")).selection.entries == task().selection.entries
    assert NOISE.keys() == {"x_d", "p_act"}


def test_a_stated_gain_of_the_drive_is_in_every_error_and_a_stated_offset_too(mechanical):
    """As values move when the sensor is taken for one that shows more: back from a fit of what it would have shown,
    linear to a percent of that, or of its error."""
    free = ["diaphragm.stiffness", "diaphragm.preload"]
    true, sizes = mechanical.replace(p_act=mechanical.p_act - 150.0), {"p_act": 0.01}

    def fit(shown, gains=None, offsets=None):
        values = {name: TRUTH[name] for name in free}
        choices = {"free": free, "values": values, "unknown": unknown(input_noise=False)}
        return calibrate(plan_task(vgtjax.MechanicalActuator(), [shown], gains=gains, offsets=offsets, **choices))

    plain, stated = fit(true), fit(true, sizes, {"p_act": 150.0})
    too_much = true.replace(p_act=true.atmosphere + 1.01 * (true.p_act - true.atmosphere))
    for source, shown in (("gain.p_act", too_much), ("offset.p_act", mechanical)):
        moved, wanted = stated.budget.moved[source], plain.values - fit(shown).values
        assert np.all(np.abs(moved - wanted) < 0.02 * np.hypot(wanted, plain.std_errors))
    np.testing.assert_allclose(stated.std_errors, np.hypot(plain.std_errors, stated.budget.type_b), rtol=1e-3)
    np.testing.assert_allclose(stated.values, plain.values, rtol=1e-6)  # the same search, through a gain of one


def test_an_offset_that_not_every_trace_shows_at_rest_counts(mechanical):
    """Where all begin at rest it is read there, and its certificate says nothing more."""
    moving = mechanical.window(0.25, 0.9)
    for traces, counts in (([mechanical], False), ([moving], True), ([mechanical, moving], True)):
        found = plan_task(
            vgtjax.MechanicalActuator(), traces, free=["diaphragm.preload"], offsets={"p_act": 500.0}, unknown=unknown()
        )
        assert ("offset.p_act" in found.tolerances) == counts
