"""Margins in a line."""

import dataclasses
import math

from calibrate.output.margins import least_margins
from vgtjax.control import Margins

CALM = Margins(gain=3.0, reduction=0.0, phase=60.0, delay=5e-3, sensitivity=1.5, crossover=9.0, radius=0.99)


def test_the_least_of_all_loops_is_said():
    tighter = dataclasses.replace(CALM, gain=2.0, phase=70.0)
    said = least_margins({"one": {"rising": CALM, "falling": tighter}})
    assert said == "least margins: gain 2, phase 60 deg, delay 5 ms"


def test_a_loop_that_is_not_stable_is_counted_and_gets_a_remedy():
    wild = Margins(*[math.nan] * 6, radius=1.1)
    said = least_margins({"one": {"rising": CALM, "falling": wild}})
    assert "gain 3, phase 60 deg" in said
    assert "1 of 2 linearised loops are not stable: tune with a duty that arrives late (duty_delay" in said
