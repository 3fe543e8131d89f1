"""The linear least-squares solver against an SVD, from easy to hard."""

import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import pytest

from vgtjax.estimation import SeminormalEquations


def tall(condition, rows=2000, columns=12):
    rng = np.random.default_rng(0)
    left, _ = np.linalg.qr(rng.normal(size=(rows, columns)))
    right, _ = np.linalg.qr(rng.normal(size=(columns, columns)))
    return left @ np.diag(np.geomspace(1, 1 / condition, columns)) @ right, rng.normal(size=rows)


def solve(matrix, vector):
    operator = lx.MatrixLinearOperator(jnp.asarray(matrix))
    return lx.linear_solve(operator, jnp.asarray(vector), SeminormalEquations()).value


@pytest.mark.parametrize("condition", [1e1, 1e4, 1e6])
def test_it_is_as_accurate_as_an_svd(condition):
    """Compared in the fitted values, which is what a step of a fit acts by.

    The Gram matrix loses `eps condition^2`, and one refinement squares that loss; `eps condition` is anyone's.
    """
    matrix, vector = tall(condition)
    exact = np.linalg.lstsq(matrix, vector)[0]
    error = np.linalg.norm(matrix @ (solve(matrix, vector) - exact)) / np.linalg.norm(matrix @ exact)
    eps = np.finfo(float).eps
    assert error < 10 * max(eps * condition, (eps * condition**2) ** 2)


def test_units_of_the_columns_do_not_matter():
    matrix, vector = tall(1e2)
    units = np.geomspace(1e-8, 1e8, matrix.shape[1])
    np.testing.assert_allclose(solve(matrix * units, vector) * units, solve(matrix, vector), rtol=1e-9)


def test_a_column_of_zeros_stays_where_it_is():
    matrix, vector = tall(1e2)
    matrix[:, 3] = 0.0
    found = solve(matrix, vector)
    assert found[3] == 0.0
    assert np.all(np.isfinite(found))


def test_it_refuses_to_be_transposed():
    with pytest.raises(TypeError, match="solves tall systems only"):
        SeminormalEquations().transpose(SeminormalEquations().init(lx.MatrixLinearOperator(jnp.eye(3)), {}), {})


def test_it_takes_the_structured_vector_of_a_damped_step():
    matrix, vector = tall(1e2)
    damping = 0.1 * np.eye(matrix.shape[1])
    operator = lx.FunctionLinearOperator(
        lambda x: (matrix @ x, damping @ x), jax.ShapeDtypeStruct((matrix.shape[1],), jnp.float64)
    )
    found = lx.linear_solve(operator, (jnp.asarray(vector), jnp.zeros(len(damping))), SeminormalEquations()).value
    expected = np.linalg.lstsq(np.vstack([matrix, damping]), np.append(vector, np.zeros(len(damping))))[0]
    np.testing.assert_allclose(found, expected, rtol=1e-9)
