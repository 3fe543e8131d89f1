"""Figures of traces whose channels have clocks of their own."""

import dataclasses

import numpy as np
import plotly.graph_objects as go
import pytest

import vgtjax
from calibrate.output.figures import autocorrelation_figure, loop_figure, numbered, trace_figure
from calibrate.output.sections import trace_section
from vgtjax.estimation import Comparison, TraceResult

ATMOSPHERE = 101013.0


@pytest.fixture(scope="module")
def result():
    """Position at 1 kHz, 10 um above the model; pressure at 100 Hz, off by 20 Pa to either side and 50 Pa too high."""
    fast, slow = np.arange(1001) * 1e-3, np.arange(101) * 1e-2
    trace = vgtjax.Trace(
        pwm=vgtjax.Channel([0.0, 0.5], [0.0, 60.0]),
        x_d=vgtjax.Channel(fast, 1e-3 * fast + 1e-5),
        p_act=vgtjax.Channel(slow, ATMOSPHERE - 1e4 * slow + 50.0 + np.where(np.arange(101) % 2, 20.0, -20.0)),
    )
    simulated = {"x_d": 1e-3 * trace.time, "p_act": ATMOSPHERE - 1e4 * trace.time}
    channels = {}
    for name, noise in {"x_d": 8e-6, "p_act": 60.0}.items():
        sampled, rows = trace.sampled(name), trace.rows(name)
        channels[name] = Comparison(sampled.time, sampled.value, simulated[name][rows], noise)
    return TraceResult(trace, "fit", simulated, channels, vgtjax.RESULTS.successful)


def test_numbers_of_a_trace_are_those_of_its_channels_samples(result):
    position, pressure = trace_section(result)["channels"]
    assert position["offset"] == pytest.approx(10.0)  # um
    assert position["rmse"] == pytest.approx(0.0, abs=1e-9)
    assert pressure["offset"] == pytest.approx(50.0, abs=0.5)  # Pa; the sides are 50 and 51 samples
    assert pressure["rmse"] == pytest.approx(20.0, rel=1e-3)
    assert pressure["peak"] == pytest.approx(20.0, rel=0.02)
    assert pressure["correlation"] == pytest.approx(-1.0, abs=0.02)


def test_each_channel_is_drawn_at_its_own_samples(result):
    measured = [line for line in trace_figure(result).data if line.name == "measured"]
    assert [len(line.x) for line in measured] == [1001, 101]
    np.testing.assert_allclose(measured[1].x, np.arange(101) * 1e-2, rtol=1e-6)
    (duty,) = (line for line in trace_figure(result).data if line.name == "duty")
    np.testing.assert_array_equal(duty.y, [0.0, 60.0])
    assert [len(line.y) for line in autocorrelation_figure([result]).data] == [50, 50]


def test_times_that_count_from_1970_are_drawn_as_they_are(result):
    began = 1.7e9
    moved = {name: dataclasses.replace(each, time=began + each.time) for name, each in result.channels.items()}
    measured = [
        line for line in trace_figure(dataclasses.replace(result, channels=moved)).data if line.name == "measured"
    ]
    np.testing.assert_allclose(measured[0].x - began, np.arange(1001) * 1e-3, atol=1e-6)  # doubles count 2e-7 s there


def test_position_over_pressure_is_drawn_in_pairs(result):
    measured, simulated = loop_figure(result).data
    pairs = np.arange(101) * 1e-2
    np.testing.assert_allclose(measured.y, pairs, atol=1e-6)  # mm
    np.testing.assert_allclose(measured.x, -1e2 * pairs, atol=0.21)  # mbar; 20 Pa
    np.testing.assert_allclose(simulated.x, -1e2 * simulated.y, atol=1e-4)


@pytest.mark.parametrize(("count", "step"), [(1, 1), (4, 1), (12, 1), (120, 12)])
def test_an_axis_that_counts_has_whole_numbers(count, step):
    figure = go.Figure()
    numbered(figure, count)
    assert (figure.layout.xaxis.tick0, figure.layout.xaxis.dtick) == (0, step)
