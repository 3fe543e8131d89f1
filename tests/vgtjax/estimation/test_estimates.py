"""What a calibration says of one entry and of one trace, by name."""

import dataclasses

import numpy as np
import pytest
from known_truth import FREE, bench

import vgtjax
from vgtjax import InputError
from vgtjax.estimation import Estimate, calibrate, plan_task

END = 12210.0
"""N/m; the truth lies beyond."""


@pytest.fixture(scope="module")
def found():
    """A stiffness that ends at its bound, a travel that the traces never reach, and two that they determine."""
    free, traces = [*FREE, "diaphragm.travel"], (bench(0), bench(1).replace(name="again"))
    task = plan_task(vgtjax.Actuator(), traces[:1], traces[1:], free=free, bounds={"diaphragm.stiffness": (1e4, END)})
    return calibrate(task)


def test_every_entry_has_its_numbers_by_its_name(found):
    entries = found.task.selection.entries
    assert list(found) == list(found.estimates) == list(entries)
    for number, entry in enumerate(entries):
        each = found[entry]
        assert each is found.estimates[entry]
        assert each.value == found.values[number]
        np.testing.assert_array_equal(each.std_error, found.std_errors[number])
        np.testing.assert_array_equal(each.interval, found.intervals[number])
        assert (each.at_bound, each.determined) == (found.at_bound[number], found.determined[number])
    assert [each.unit for each in found.estimates.values()] == ["m3", "N", "N/m", "m"]


def test_what_is_not_determined_has_no_interval(found):
    told = {entry: each.determined for entry, each in found.estimates.items()}
    assert told == {e: e in ("diaphragm.preload", "chamber.volume") for e in found}
    assert (found["diaphragm.stiffness"].value, found["diaphragm.stiffness"].at_bound) == (END, True)
    assert not found["diaphragm.travel"].at_bound
    assert np.all(np.isnan(found["diaphragm.travel"].interval))
    low, high = found["chamber.volume"].interval
    assert low < found["chamber.volume"].value < high


def test_an_end_beyond_every_number_leaves_none(found):
    """Of a positive value that is hardly known the upper end overflows."""
    vague = dataclasses.replace(found.uncertainty, covariance=1e6 * np.eye(4), estimable=np.ones(4, bool))
    ends = dataclasses.replace(found, uncertainty=vague)["chamber.volume"].interval
    assert np.all(np.isnan(ends))


def test_a_trace_is_met_by_its_name(found):
    assert found.trace("again") is found.traces[1]
    assert found.trace("again").use == "validate"
    with pytest.raises(InputError, match="trace 'agian' matches nothing; did you mean 'again'"):
        found.trace("agian")


def test_a_name_that_was_not_free_is_refused(found):
    with pytest.raises(InputError, match=r"free entry 'chamber.volum' matches nothing; did you mean 'chamber.volume'"):
        found["chamber.volum"]


def test_what_was_held_has_no_error():
    held = Estimate(1.0, "N")
    assert np.isnan([held.std_error, *held.interval]).all()
    assert not held.at_bound
    assert not held.determined
