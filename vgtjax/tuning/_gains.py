"""Which parameters of a controller are gains."""

from ..control import AbstractController, DesignModel
from ..parameters import parameter_table
from ..parts import AbstractFlowMap, Converter, Diaphragm, LuGre
from ._parts import parts

BELIEFS = (DesignModel, Converter, Diaphragm, LuGre, AbstractFlowMap)
"""What controllers have of these is their belief about the plant."""


def gain_names(controller: AbstractController) -> list[str]:
    """Parameters of a controller that are gains: not held, and no belief about the plant."""
    own = {prefix for prefix, _ in parts(controller, leave_out=BELIEFS)}
    table = parameter_table(controller)
    return [name for name, row in table.items() if not row.held and name[: name.rfind(".") + 1] in own]


def check(controller: AbstractController) -> None:
    """The checks that each part makes when it is built, which a replaced leaf has passed by."""
    for _, part in parts(controller):
        for kind in type(part).__mro__:
            if "__check_init__" in vars(kind):
                vars(kind)["__check_init__"](part)
