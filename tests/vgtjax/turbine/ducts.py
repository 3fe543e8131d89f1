"""Ducts, a plenum and a compiled solution that several tests of flow share."""

import jax
import jax.numpy as jnp
import numpy as np

from vgtjax.turbine import Inlet, Passage, steady

CELLS = 64
solve = jax.jit(steady)
"""Every number is an argument, those that are plain numbers too: one program for all passages of as many cells."""


def duct(radius=(0.05, 0.05), area=(1e-3, 1e-3), length=0.5, friction=0.0, heat=0.0, cells=CELLS) -> Passage:
    """Without blades; radius and area go evenly from the first to the second value."""
    share, still = np.linspace(0, 1, cells + 1), np.zeros(cells)
    along = [ends[0] + (ends[1] - ends[0]) * share for ends in (radius, area)]
    return Passage(length * share, *along, still.astype(int), still, still + 1, still, still + friction, still + heat)


def plenum(pressure=2e5, temperature=900.0, tangent=0.0) -> Inlet:
    """Gas at the inlet of the reference cases."""
    return Inlet(*map(jnp.asarray, (pressure, temperature, tangent)))
