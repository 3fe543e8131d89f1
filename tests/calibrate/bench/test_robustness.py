"""Random actuators that can exist are simulated at default steps, whatever was drawn."""

import numpy as np

import vgtjax
from calibrate.bench.cases.robustness import draw, physical, runner, varied
from vgtjax.simulation import FixedStep

SPREAD = 0.3
DRAWS = 4096
SIMULATED = 200
SEED = 78


def test_actuators_whose_stop_gives_more_than_the_chamber_has_stay_finite():
    """Full duty and release press the rod into both stops; of thousands those with the least room are simulated."""
    nominal, factors = vgtjax.Actuator(), varied(vgtjax.Actuator())
    rows = physical(nominal, factors, draw(nominal, factors, SPREAD, DRAWS, SEED))
    area, travel, volume, stiffness = (
        rows[:, factors.entries.index(name)]
        for name in ("diaphragm.area", "diaphragm.travel", "chamber.volume", "diaphragm.stop_stiffness")
    )
    room = 1 - area * travel / volume
    assert np.all(room > 0)
    give = float(nominal.air.pressure) * area / stiffness
    assert np.sum(volume < area * (travel + give)) > 10  # none of these is left out
    duty = np.repeat([0.0, 100.0, 0.0], [50, 700, 150])
    trace = vgtjax.Trace(np.arange(len(duty)) * 1e-3, pwm=duty)
    plan = FixedStep().plan_intervals(nominal, trace.longest_interval)
    position, good = map(np.asarray, runner(nominal, factors, trace, plan)(rows[np.argsort(room)[:SIMULATED]]))
    assert np.all(good)
    assert np.all(np.isfinite(position))
