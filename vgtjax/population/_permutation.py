"""Pseudo-random numbers and permutations that are functions of an index, so that any part of them can be had alone."""

import math

import numpy as np
from jaxtyping import UInt64

ROUNDS = 16
"""Half rounds of the Feistel network. Four are enough for large sizes (Luby and Rackoff, 1988); with twelve, some
permutations of five or six elements are still clearly more frequent than others."""
_GOLDEN = 0x9E3779B97F4A7C15

Words = UInt64[np.ndarray, "..."]


def random_keys(seed: int, count: int, columns: int) -> UInt64[np.ndarray, "count columns"]:
    """Independent keys for every column."""
    return np.random.SeedSequence(seed).generate_state(count * columns, np.uint64).reshape(count, columns)


def random_words(index: Words, key: Words) -> Words:
    """The `index`-th numbers of the streams that start at `key` (SplitMix64: Steele, Lea and Flood, 2014)."""
    words = index * np.uint64(_GOLDEN) + key  # all arithmetic is meant modulo 2^64
    words = (words ^ (words >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    words = (words ^ (words >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return words ^ (words >> np.uint64(31))


def permute(
    index: UInt64[np.ndarray, " points"], size: int, keys: UInt64[np.ndarray, "rounds columns"]
) -> UInt64[np.ndarray, "points columns"]:
    """Where one keyed permutation of `0 .. size - 1` a column sends each index, by a generalised Feistel network (Black
    and Rogaway, 2002)."""
    values = _encipher(np.broadcast_to(index[:, None], (len(index), keys.shape[1])), size, keys[:, None, :])
    while True:
        rows, columns = np.nonzero(values >= size)
        if not len(rows):
            return values
        values[rows, columns] = _encipher(values[rows, columns], size, keys[:, columns])


def _encipher(values: Words, size: int, keys: Words) -> Words:
    """A bijection of the rectangle: either coordinate is moved round by an amount that depends on the other."""
    width = math.isqrt(size - 1) + 1
    height = -(-size // width)
    sides = [np.uint64(width), np.uint64(height)]
    left, right = np.divmod(values, sides[1])
    for key in keys:
        # The two halves change places, and so do the lengths of their sides.
        left, right = right, (left + random_words(right, key) % sides[0]) % sides[0]
        sides.reverse()
    return left * sides[1] + right
