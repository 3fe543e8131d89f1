"""What the print of section 3.5 and B.2.1 says, against closed forms."""

import numpy as np
import pytest

from calibrate.reproduction import gas_flow


def test_eigenvalues_are_as_stated_once_a_sign_is_put_right():
    stated = [0.3 - 1, 0.3, 0.3, 0.3 + 1]
    found = np.sort(np.linalg.eigvals(gas_flow._jacobian(as_printed=False)).real)
    np.testing.assert_allclose(found, stated, atol=1e-7)  # a double eigenvalue is known to the root of rounding
    printed = np.sort(np.linalg.eigvals(gas_flow._jacobian(as_printed=True)).real)
    np.testing.assert_allclose(printed, [-0.610, 0.3, 0.405, 1.105], atol=5e-4)


def test_the_engine_that_is_printed_is_no_diesel_engine():
    verdicts = {
        row.id: row.evaluate() for row in gas_flow.ROWS if row.id in ("engine-clearance", "engine-displacement")
    }
    assert verdicts["engine-clearance"].ours == pytest.approx(92.0, abs=0.1)
    assert verdicts["engine-displacement"].ours == pytest.approx(np.pi / 4 * 7.5**2 * 9.1 * 4, rel=1e-6)
    assert {result.verdict for result in verdicts.values()} == {"differs"}
