"""How much memory is left, of the machine or of the container that this process runs in."""

import contextlib
import pathlib
from collections.abc import Iterator
from typing import NamedTuple

import psutil


class _Group(NamedTuple):
    """Where Linux keeps a control group's limit and use of memory, in bytes, and what part of the use it gives back."""

    root: str
    limit: str
    used: str
    reclaimable: str


_GROUPS = {
    "": _Group("", "memory.max", "memory.current", "inactive_file"),
    "memory": _Group("memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
}
"""By the controllers that `/proc/self/cgroup` names: version 2, and version 1."""


def available_memory(
    membership: pathlib.Path = pathlib.Path("/proc/self/cgroup"),
    mounted: pathlib.Path = pathlib.Path("/sys/fs/cgroup"),
) -> int:
    """Bytes that programs may still take without anything being swapped out or ended for want of memory.

    **Arguments:** `membership`: the control groups of this process; `mounted`: where all of them are. Neither is there
    but on Linux.
    """
    return min([psutil.virtual_memory().available, *_left_by_groups(membership, mounted)])


def _left_by_groups(membership: pathlib.Path, mounted: pathlib.Path) -> Iterator[int]:
    """Bytes left by each limited group around this process."""
    if not membership.exists():
        return
    for line in membership.read_text().splitlines():
        _, controllers, path = line.split(":", 2)
        if controllers in _GROUPS:
            group = _GROUPS[controllers]
            inside = mounted / group.root / path.strip("/")
            # A container often sees its own group as the root, whatever its path says.
            for folder in (inside, *(each for each in inside.parents if each.is_relative_to(mounted / group.root))):
                if (folder / group.limit).exists():
                    yield from _left_by(folder, group)


def _left_by(folder: pathlib.Path, group: _Group) -> Iterator[int]:
    """Nothing of a group that can't be read, or has no limit."""
    with contextlib.suppress(OSError, ValueError):
        limit = int((folder / group.limit).read_text())  # or "max"
        statistics = dict(line.split() for line in (folder / "memory.stat").read_text().splitlines())
        used = int((folder / group.used).read_text()) - int(statistics.get(group.reclaimable, 0))
        yield max(0, limit - used)
