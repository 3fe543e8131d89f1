"""Which parameters of a controller are gains."""

from ..control import AbstractController, designs_in
from ..parameters import parameter_table


def gain_names(controller: AbstractController) -> list[str]:
    """Parameters of a controller and of the designs inside it that are not held; what it believes of a plant is none.

    A component that is no [`AbstractDesign`][] is what the controller believes.
    """
    own = {prefix for prefix, _ in designs_in(controller)}
    table = parameter_table(controller)
    return [name for name, row in table.items() if not row.held and name[: name.rfind(".") + 1] in own]
