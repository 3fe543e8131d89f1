"""Where arrays live when JAX sees several devices: lanes spread over all, everything else on each."""

from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, PyTree


def _sharding(*axes: str | None) -> NamedSharding:
    return NamedSharding(Mesh(np.asarray(jax.devices()), ("lane",)), PartitionSpec(*axes))


def spread(tree: PyTree[Array]) -> PyTree[Array]:
    """Arrays with their last axis (lanes) spread over all devices, inside or outside of `jit`."""
    return jax.tree.map(lambda leaf: eqx.filter_shard(leaf, _sharding(*[None] * (leaf.ndim - 1), "lane")), tree)


def replicate(tree: Any) -> Any:
    """Arrays of any PyTree whole on every device, so that a compiled function always meets the same layout."""
    return eqx.filter_shard(tree, _sharding())
