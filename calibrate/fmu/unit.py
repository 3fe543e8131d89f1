"""What an FMU is made of, whatever is inside."""

import dataclasses
import pathlib
from collections.abc import Mapping, Sequence

from .primitives import literal
from .variables import Variable

TEMPLATES = pathlib.Path(__file__).parents[1] / "templates" / "fmu"


@dataclasses.dataclass(frozen=True, eq=False)
class Unit:
    """A plant or a controller as an FMU describes it.

    `code` is all of its C but for the GUID, which is a digest of it; `step` in s is that of a usual experiment. What
    `is_sampled` has no derivatives, and is for co-simulation only.
    """

    identifier: str
    says: str
    variables: Sequence[Variable]
    code: str
    step: float
    is_sampled: bool

    @property
    def source(self) -> str:
        """The name of its file."""
        return f"{self.identifier}.c"


def define(
    equations: str,
    sizes: Mapping[str, int],
    held: Sequence[bool],
    variables: Sequence[Variable],
    more: Sequence[str],
    templates: Sequence[str],
) -> str:
    """The C of a unit: its equations, numbers that the templates ask for, and the templates, the common one first.

    **Arguments:**

    - `sizes`: how many variables of each kind there are, by the letters that the common template has for them.
    - `held`: of every input whether it has no derivative.
    - `more`: definitions of one kind of unit.
    """
    starts = [literal(float(each.start or 0.0)) for each in variables]
    definitions = [
        *(f"#define N_{letter} {size}" for letter, size in sizes.items()),
        f"static const int IS_HELD[] = {{{', '.join(str(int(each)) for each in held)}}};",
        f"static const double START[] = {{{', '.join(starts)}}};",
        *more,
    ]
    texts = [(TEMPLATES / name).read_text(encoding="utf-8") for name in ("unit.c", *templates)]
    return "\n".join([equations, *definitions, "", *texts])
