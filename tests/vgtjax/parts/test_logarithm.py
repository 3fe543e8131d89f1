"""The logarithm of pressure ratios beside NumPy's, and its derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from vgtjax.parts._logarithm import log_of_ratio


def test_it_is_numpys_to_rounding_where_flow_is_not_choked():
    ratios = np.linspace(4 / 9, 1, 10_001)
    # Sums of terms below 0.5, each rounded to half of 1.1e-16.
    np.testing.assert_allclose(log_of_ratio(ratios), np.log(ratios), rtol=0, atol=4e-16)


def test_it_falls_off_slowly_below():
    ratios = np.linspace(0.35, 4 / 9, 1001)
    np.testing.assert_allclose(log_of_ratio(ratios), np.log(ratios), rtol=0, atol=3e-13)  # as its docstring says


@pytest.mark.parametrize("ratio", [0.45, 0.7, 0.9999])
def test_derivatives_are_those_of_a_logarithm(ratio):
    assert jax.grad(log_of_ratio)(ratio) == pytest.approx(1 / ratio, rel=1e-15)
    assert jax.jvp(jax.grad(log_of_ratio), (ratio,), (1.0,))[1] == pytest.approx(-1 / ratio**2, rel=1e-15)
    # Finite differences tell no more.
    check_grads(
        log_of_ratio, (jnp.asarray(ratio),), order=2, modes=("fwd", "rev"), rtol=1e-6
    )  # finite differences tell no more


def test_single_precision_stays_and_what_is_no_number_is_seen():
    assert log_of_ratio(jnp.float32(0.7)).dtype == jnp.float32
    assert np.isnan(log_of_ratio(jnp.nan))
