"""How many processes memory has room for."""

import psutil
import pytest

from calibrate import memory, workers
from calibrate.memory import available_memory

GB = 2**30
MACHINE = psutil.virtual_memory()._replace(available=8 * GB)


@pytest.fixture(autouse=True)
def _a_machine(monkeypatch):
    monkeypatch.setattr(memory.psutil, "virtual_memory", lambda: MACHINE)


def left(tmp_path, line, folder, files):
    """What is left to a process of which `line` says in which group it is, whose files are in `folder`."""
    (tmp_path / "cgroup").write_text(f"12:pids:/elsewhere\n{line}\n")
    place = tmp_path / "mounted" / folder
    place.mkdir(parents=True)
    for name, text in files.items():
        (place / name).write_text(f"{text}\n")
    return available_memory(tmp_path / "cgroup", tmp_path / "mounted")


def version_2(limit, used, reclaimable):
    return {"memory.max": limit, "memory.current": used, "memory.stat": f"anon 1\ninactive_file {reclaimable}"}


def version_1(limit, used, reclaimable):
    return {
        "memory.limit_in_bytes": limit,
        "memory.usage_in_bytes": used,
        "memory.stat": f"inactive_file 7\ntotal_inactive_file {reclaimable}",
    }


@pytest.mark.parametrize("folder", ["a/b", "a", ""])
def test_a_container_allows_less_than_the_machine(tmp_path, folder):
    """The limit of the group itself, of one around it, or of what the container takes for the root; files that were
    read, but are not in use, are given back."""
    assert left(tmp_path, "0::/a/b", folder, version_2(4 * GB, 3 * GB, GB)) == 2 * GB


def test_groups_of_version_1(tmp_path):
    assert left(tmp_path, "4:memory:/a", "memory/a", version_1(4 * GB, 3 * GB, GB)) == 2 * GB


@pytest.mark.parametrize("limit", ["max", str(2**63 - 4096)])
def test_a_group_without_limit_leaves_what_the_machine_has(tmp_path, limit):
    files = version_2(limit, 3 * GB, 0)
    assert left(tmp_path, "0::/a", "a", files) == 8 * GB


def test_more_than_the_limit_leaves_nothing(tmp_path):
    assert left(tmp_path, "0::/a", "a", version_2(GB, 2 * GB, 0)) == 0


def test_a_system_without_groups(tmp_path):
    assert available_memory(tmp_path / "none", tmp_path / "none") == 8 * GB


@pytest.mark.parametrize(
    ("units", "cores", "room", "processes"),
    [(20, 2, 8 * GB, 2), (3, 16, 8 * GB, 3), (20, 16, 8 * GB, 4), (20, 16, GB, 1)],
)
def test_processes_are_as_many_as_units_cores_and_memory_allow(monkeypatch, capsys, units, cores, room, processes):
    monkeypatch.setattr(workers, "available_memory", lambda: room)
    assert workers._processes(units, cores) == processes
    said = capsys.readouterr().out
    assert ("processes run at a time, as each may need 2 GiB of memory" in said) == (processes < min(units, cores))
