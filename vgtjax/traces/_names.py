"""Names that are nearly right."""

import difflib
from collections.abc import Iterable


def nearest(name: str, known: Iterable[str], count: int = 1) -> list[str]:
    """The names that resemble one most, whatever their case."""
    folded: dict[str, str] = {}
    for each in known:
        folded.setdefault(each.casefold(), each)
    return [folded[match] for match in difflib.get_close_matches(name.casefold(), folded, n=count, cutoff=0.0)]


def distance_at_most(a: str, b: str, limit: int) -> bool:
    """Whether at most `limit` letters must be inserted, deleted or replaced (Levenshtein)."""
    row = list(range(len(b) + 1))
    for i, letter in enumerate(a, 1):
        previous, row[0] = row[0], i
        for j, other in enumerate(b, 1):
            previous, row[j] = row[j], min(row[j] + 1, row[j - 1] + 1, previous + (letter != other))
    return row[-1] <= limit
