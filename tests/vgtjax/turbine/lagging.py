"""How far flow departs from steady states while its plenum changes slowly: linear algebra on a steady state, no march.

The state is that of steady flow plus one in proportion to the rate: `U(p) - J^-1 dM/dU U' dp/dt`, with what cells hold
`M`, what they lose `R`, and `J = dR/dU`.
"""

import jax
import jax.numpy as jnp

from vgtjax.turbine import Gas, Nozzle
from vgtjax.turbine._blocks import band_of, solve_band
from vgtjax.turbine._riemann import pack
from vgtjax.turbine._steady import _Steady, flow_of

NOZZLE, GAS = Nozzle(), Gas()


@jax.jit
def late_moment(passage, flow, pressure, outlet_pressure):
    """Change of the moment on a vane in N m over the plenum's rate in Pa/s, at a steady flow from Pa absolute and
    900 K."""
    states = pack(flow.density, flow.v_m, flow.v_u * passage.centre_radius, flow.pressure)

    def problem(pressure):
        return _Steady(passage, NOZZLE.inlet(pressure, 900.0), outlet_pressure, GAS)

    here = problem(pressure)
    _, band = band_of(here, states)

    def along(function, at, direction):
        return jax.jvp(function, (at,), (direction,))[1]

    with_pressure = -solve_band(band, along(lambda each: problem(each)(states), pressure, jnp.ones_like(pressure)))
    late = -solve_band(band, along(here.balance.stored, states, with_pressure))
    return along(lambda each: NOZZLE.vane_moment(passage, flow_of(here.balance, each, flow.converged))[0], states, late)
