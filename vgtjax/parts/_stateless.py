"""Parts that remember nothing."""

from typing import Any

import equinox as eqx
from jaxtyping import Array


class Stateless(eqx.Module):
    """What a part without a state answers, whatever it is asked with; stands before the base class of its kind."""

    def initial_state(self, *args: Any, **kwargs: Any) -> None:
        """Nothing to remember."""

    def relaxation(self, *args: Any, **kwargs: Any) -> None:
        """No state, no rate."""

    def signals(self, *args: Any, **kwargs: Any) -> dict[str, Array]:
        """Nothing to show."""
        return {}

    def typical_state(self, *args: Any, **kwargs: Any) -> None:
        """No state, no size."""
