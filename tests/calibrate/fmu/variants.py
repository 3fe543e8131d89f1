"""Every component in a model, and the reduced models."""

from typing import Any

import vgtjax
from calibrate.study.components import CHAMBER, FRICTION, LINE, MAGNETIC_FORCE, VANE_FORCE, StaticMapComponents
from calibrate.study.models import build_model
from calibrate.study.tables import AnyStudy

VARIANTS: dict[str, tuple[str, dict[str, str]]] = {
    **{f"friction-{name}": ("full", {"friction": name}) for name in FRICTION},
    **{f"vane-force-{name}": ("full", {"vane_force": name}) for name in VANE_FORCE if name != "none"},
    **{f"line-{name}": ("full", {"line": name}) for name in LINE if name != "none"},
    **{f"chamber-{name}": ("full", {"chamber": name}) for name in CHAMBER if name != "adiabatic"},
    **{f"magnetic-force-{name}": ("full", {"magnetic_force": name}) for name in MAGNETIC_FORCE if name != "static"},
    "mechanical": ("mechanical", {"vane_force": "polynomial"}),
    "plunger-map": ("plunger-map", {"friction": "dahl"}),
    **{f"static-map-{name}": ("static-map", {"flow_map": name}) for name in StaticMapComponents.flow_maps},
}


def build(name: str) -> Any:
    """The model of that name, its tables not empty."""
    model, components = VARIANTS[name]
    built = build_model(AnyStudy.validate_python({"model": model, "components": components}))
    filled: dict[str, Any] = {}
    for table, row in vgtjax.parameter_table(built).items():
        if table in ("vane_force.closing", "vane_force.opening", "friction.load"):
            filled[table] = [(-1.0 if "opening" in table else 1.0) * (1.0 + 0.3 * i) for i in range(row.size or 1)]
    return vgtjax.replace_parameters(built, filled)
