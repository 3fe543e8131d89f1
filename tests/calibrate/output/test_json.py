"""JSON that a command writes: always valid, whatever came out."""

import json

import jax.numpy as jnp
import numpy as np
from commands import read

from calibrate.output.files import write_json


def test_what_is_not_finite_becomes_null_wherever_it_stands(tmp_path):
    """As in the summary of a fit that got lost, which ended in a traceback before."""
    content = {
        "nan": float("nan"),
        "rows": [(1.5, np.inf), {"of NumPy": np.float64("nan"), "count": np.int64(3)}],
        "arrays": [np.array([[1.0, np.nan]]), jnp.asarray([2.0, -jnp.inf]), jnp.asarray(4.0)],
        "said": "nothing is NaN",
        "flags": [True, np.True_, None],
        "nothing": [],
    }
    write_json(tmp_path / "content.json", content)
    found = read(tmp_path / "content.json")
    assert found == {
        "nan": None,
        "rows": [[1.5, None], {"of NumPy": None, "count": 3}],
        "arrays": [[[1.0, None]], [2.0, None], 4.0],
        "said": "nothing is NaN",
        "flags": [True, True, None],
        "nothing": [],
    }
    text = (tmp_path / "content.json").read_text(encoding="utf-8")
    assert text == json.dumps(found, indent=2) + "\n"
