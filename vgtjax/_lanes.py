"""Lanes: rows of one compiled function side by side, in chunks, on all devices of one process or of many.

How lanes are cut, filled up, spread and put together again stands here and nowhere else. A row is computed by itself,
so neither chunks nor devices nor processes change its bits.
"""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Int, PyTree

from ._types import Tree

Places = Int[np.ndarray, " lanes"]


def _sharding(*axes: str | None) -> NamedSharding:
    return NamedSharding(Mesh(np.asarray(jax.devices()), ("lane",)), PartitionSpec(*axes))


def spread(tree: PyTree[Array]) -> PyTree[Array]:
    """Arrays with their last axis (lanes) spread over all devices, inside or outside of `jit`."""
    return jax.tree.map(lambda leaf: eqx.filter_shard(leaf, _sharding(*[None] * (leaf.ndim - 1), "lane")), tree)


def replicate(tree: Tree) -> Tree:
    """Arrays of any PyTree whole on every device, so that a compiled function always meets the same layout."""
    return eqx.filter_shard(tree, _sharding())


def fill_devices(lanes: int) -> int:
    """`lanes`, rounded up to a multiple of the devices, which all have the same number."""
    return lanes + -lanes % jax.device_count()


@dataclasses.dataclass(frozen=True)
class Chunks:
    """Lanes inside of a compiled function, of arrays whose last axis they are, in chunks of `together` a device."""

    lanes: int
    devices: int
    together: int

    @property
    def count(self) -> int:
        """How many chunks there are."""
        return -(-self.lanes // self.width)

    @property
    def width(self) -> int:
        """Lanes of a chunk on all devices."""
        return self.devices * self.together

    def cut(self, array: Array) -> Array:
        """The array with a leading axis of chunks; the last lane fills up what is short. A device keeps the lanes that
        `spread` gives it."""
        short = self.count * self.width - self.lanes
        padded = jnp.pad(array, [(0, 0)] * (array.ndim - 1) + [(0, short)], mode="edge")
        apart = jnp.moveaxis(padded.reshape(*array.shape[:-1], self.devices, self.count, self.together), -2, 0)
        return apart.reshape(self.count, *array.shape[:-1], self.width)

    def join(self, array: Array) -> Array:
        """The inverse of `cut`."""
        apart = jnp.moveaxis(array.reshape(*array.shape[:-1], self.devices, self.together), 0, -2)
        return apart.reshape(*array.shape[1:-1], -1)[..., : self.lanes]


def map_rows(
    function: Callable[[PyTree[Array]], PyTree[Array]], rows: Callable[[Places], PyTree], count: int, lanes: int
) -> PyTree[np.ndarray]:
    """`function` of `count` rows, `lanes` of them at a time, whole and on the host.

    Rows are asked for as they are computed, so that only a chunk of them is in memory. The last chunk is filled up by
    repeating the last row: the function is compiled for one number of lanes, and a row that is there already can't
    fail where the others don't.

    **Arguments:**

    - `function`: compiled; every array in and out of it has a leading axis of lanes.
    - `rows`: PyTree of the rows at some places. With several processes every one makes all rows, and computes its own.
    - `lanes`: rounded up to a multiple of the devices.
    """
    lanes, chunks = fill_devices(lanes), []
    for begin in range(0, count, lanes):
        places = np.minimum(np.arange(begin, begin + lanes), count - 1)
        found = _bring_home(function(share_out(rows(places))))
        chunks.append(jax.tree.map(lambda leaf, left=count - begin: leaf[:left], found))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *chunks)


def share_out(rows: PyTree) -> PyTree[Array | np.ndarray]:
    """Arrays that every process has whole, with their first axis spread over the devices of all processes.

    A single device takes them as they are when a compiled function is called: to put each there first takes longer.
    """
    if jax.device_count() == 1:
        return rows
    sharding = _sharding("lane")
    if jax.process_count() == 1:
        return jax.device_put(rows, sharding)
    return jax.tree.map(lambda leaf: jax.make_array_from_callback(leaf.shape, sharding, lambda at: leaf[at]), rows)


def _bring_home(tree: PyTree[Array]) -> PyTree[np.ndarray]:
    """Arrays made from shared-out ones, whole and on the host, in every process."""
    if jax.process_count() > 1:
        return multihost_utils.process_allgather(tree, tiled=True)
    return jax.tree.map(np.asarray, tree)
