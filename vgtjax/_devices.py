"""Where arrays live when JAX sees several devices, of one process or of many: lanes spread over all of them."""

from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, PyTree


def _sharding(*axes: str | None) -> NamedSharding:
    return NamedSharding(Mesh(np.asarray(jax.devices()), ("lane",)), PartitionSpec(*axes))


def spread(tree: PyTree[Array]) -> PyTree[Array]:
    """Arrays with their last axis (lanes) spread over all devices, inside or outside of `jit`."""
    return jax.tree.map(lambda leaf: eqx.filter_shard(leaf, _sharding(*[None] * (leaf.ndim - 1), "lane")), tree)


def spread_rows(tree: PyTree[Array]) -> PyTree[Array]:
    """Arrays with their first axis spread over all devices, of one process; its length a multiple of their number."""
    return eqx.filter_shard(tree, _sharding("lane"))


def replicate(tree: Any) -> Any:
    """Arrays of any PyTree whole on every device, so that a compiled function always meets the same layout."""
    return eqx.filter_shard(tree, _sharding())


def share_out(rows: np.ndarray) -> Array:
    """An array that every process has whole, with its first axis spread over the devices of all processes.

    Its length must be a multiple of the number of devices.
    """
    return jax.make_array_from_callback(rows.shape, _sharding("lane"), lambda index: rows[index])


def bring_home(tree: PyTree[Array]) -> PyTree[np.ndarray]:
    """Arrays made from shared-out ones, whole and on the host, in every process."""
    if jax.process_count() > 1:
        return multihost_utils.process_allgather(tree, tiled=True)
    return jax.tree.map(np.asarray, tree)
