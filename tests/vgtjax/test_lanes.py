"""Rows of one compiled function: chunks, filling up and devices change nothing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from vgtjax import _lanes as lanes_of

ROWS = {"x": np.linspace(0.1, 2.0, 7), "y": np.arange(21.0).reshape(7, 3)}


@jax.jit
def work(rows):
    return {"root": jax.vmap(lambda x, y: jnp.sqrt(x) * jnp.sin(y).sum())(rows["x"], rows["y"]), "y": rows["y"]}


@pytest.mark.parametrize("lanes", [1, 2, 3, 6, 8, 100])
def test_any_number_of_lanes_gives_the_same_bits(lanes):
    sizes, asked = set(), []

    def rows(places):
        asked.extend(places.tolist())
        return jax.tree.map(lambda leaf: leaf[places], ROWS)

    def run(chunk):
        sizes.add(len(chunk["x"]))
        assert len(chunk["x"].sharding.device_set) == jax.device_count(), "every device has its share"
        return work(chunk)

    found = lanes_of.map_rows(run, rows, 7, lanes)
    whole = lanes_of.map_rows(work, lambda places: jax.tree.map(lambda leaf: leaf[places], ROWS), 7, 8)
    for name, each in found.items():
        assert isinstance(each, np.ndarray)
        np.testing.assert_array_equal(each, whole[name])
    np.testing.assert_array_equal(found["y"], ROWS["y"])
    filled = lanes + lanes % 2  # the tests have two devices
    assert sizes == {filled}, "compiled once"
    assert asked[:7] == list(range(7))
    assert set(asked[7:]) <= {6}, "filled up by the last row"


@pytest.mark.parametrize(("lanes", "devices", "together"), [(7, 2, 2), (8, 2, 4), (1, 2, 3), (9, 1, 4)])
def test_chunks_are_cut_and_joined_again(lanes, devices, together):
    chunks, leaf = lanes_of.Chunks(lanes, devices, together), jnp.arange(3.0 * lanes).reshape(3, lanes)
    cut = chunks.cut(leaf)
    assert cut.shape == (chunks.count, 3, devices * together)
    np.testing.assert_array_equal(chunks.join(cut), leaf)
    # Lanes stay on their device, in their order: the first of them has the first of what is spread.
    share = chunks.count * together
    np.testing.assert_array_equal(cut[:, 0, :together].ravel()[: min(lanes, share)], leaf[0, :share])
    assert set(np.unique(cut)) == set(np.unique(leaf))
