"""What a file is to those who look for signals in it: channels by name, each read when it is asked for."""

import abc
import contextlib
import dataclasses
import importlib
import logging
import pathlib
import re
import types
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar

import numpy as np

from ..._errors import InputError


@dataclasses.dataclass(frozen=True)
class Entry:
    """A channel as its file lists it.

    `unit` as the file says it, or `None`; `group` is what tells channels of one name apart. Where the file itself
    knows when a channel was sampled, it is `timed`; else its times are an entry of their own. `key` is for the reader.
    `usual_unit` is meant by all custom where neither the file nor the user says one.
    """

    name: str
    unit: str | None = None
    group: str = ""
    timed: bool = False
    key: Any = None
    usual_unit: str | None = None

    @property
    def label(self) -> str:
        """The name without a unit in brackets."""
        return self._parts[0]

    @property
    def stated_unit(self) -> str | None:
        """The unit in the brackets of a name, or else what the file says beside it."""
        return self.unit if self._parts[1] is None else self._parts[1]

    @property
    def _parts(self) -> tuple[str, str | None]:
        match = re.fullmatch(r"([^\[\]]*?)\s*(?:\[(.*)\])?", self.name)
        return (self.name, None) if match is None else (match[1].strip(), match[2])


@dataclasses.dataclass(frozen=True)
class Record:
    """The samples of a channel, as its file has them.

    `time` of a timed entry is in s, or dates, and `None` otherwise. `valid` says which samples the file stands behind,
    all by default. `rows` says which times of its clock have a sample, all by default.
    """

    value: np.ndarray
    time: np.ndarray | None = None
    valid: np.ndarray | None = None
    rows: np.ndarray | None = None


class Recording(abc.ABC):
    """An open file: what it lists, and the samples of what is asked for."""

    noun: ClassVar[str] = "channel"
    """What the file calls a signal."""
    item: ClassVar[str] = "sample"
    """What it calls one time of it."""
    is_text: ClassVar[bool] = False
    """Whether its names are a header that can be edited."""
    path: pathlib.Path
    entries: Sequence[Entry]

    @abc.abstractmethod
    def read(self, entry: Entry) -> Record:
        """The samples of one of its entries.

        **Raises:** `InputError` where they can't be read.
        """

    def close(self) -> None:  # noqa: B027  # most readers hold nothing open
        """Lets go of the file."""

    def place(self, channel: Entry | str | None = None, sample: int | None = None) -> str:
        """Where something stands, for a sentence; samples count from 1 there."""
        parts = [self.path.name]
        if isinstance(channel, Entry):
            parts.append(f"{self.noun} {channel.label}" + (f" of group {channel.group}" if channel.group else ""))
        elif channel is not None:
            parts.append(f"{self.noun} {channel}")
        if sample is not None:
            parts.append(f"{self.item} {sample + 1}")
        return ", ".join(parts)

    def fail(self, what: str, remedy: str, channel: Entry | str | None = None, sample: int | None = None) -> InputError:
        """The one sentence for what is wrong there."""
        return InputError(f"{self.place(channel, sample)}: {what}; {remedy}")


def load_package(path: pathlib.Path, package: str, extra: str) -> types.ModuleType:
    """A package that only files of this kind need.

    **Raises:** `InputError` with the command that installs it.
    """
    try:
        return importlib.import_module(package)
    except ImportError as error:
        name = package.split(".")[0]
        raise InputError(
            f"{path.name}: this file is read by the package {name}, which is not installed; run pip install "
            f"'.[{extra}]' in a clone of vgtjax"
        ) from error


@contextlib.contextmanager
def reading(path: pathlib.Path, kind: str) -> Iterator[None]:
    """Turns whatever a package raises about a broken file into one sentence, and what it logs into nothing.

    Parsers raise nearly anything on such a file (struct, index and type errors, their own), which is always its fault.
    Some also log it, by handlers of their own that print.
    """
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        why = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(
            f"{path.name}: this {kind} file can't be read ({why[:120]}); it is broken or incomplete, export the trace "
            "again"
        ) from error
    finally:
        logging.disable(before)


def read_start(path: pathlib.Path, count: int) -> bytes:
    """The first bytes of a file.

    **Raises:** `InputError` when it can't be read or is empty.
    """
    try:
        with path.open("rb") as file:
            start = file.read(count)
    except OSError as error:
        raise InputError(f"{path.name}: can't be read ({error.strerror}); check the path of the file") from error
    if not start:
        raise InputError(f"{path.name}: the file is empty; export the trace again")
    return start


def require_start(path: pathlib.Path, starts: Sequence[bytes], kind: str) -> None:
    """Refuses a file that is something else than its suffix says.

    **Raises:** `InputError`.
    """
    start = read_start(path, max(map(len, starts)))
    if not start.startswith(tuple(starts)):
        raise InputError(
            f"{path.name}: this is no {kind} file, although its name ends like one; export the trace again, or give "
            "the file the suffix of what it is"
        )
