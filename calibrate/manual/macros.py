"""What a page may ask for: `{{ options("fit") }}` and the like."""

from typing import Any

from calibrate.manual import equations, reference

MACROS = {
    "api": reference.api,
    "channels": reference.channels,
    "designs": reference.designs,
    "equations": equations.index,
    "keys": reference.keys,
    "options": reference.options,
    "other_errata": equations.other_errata,
    "parameters": reference.parameters,
    "words": reference.words,
}


def define_env(env: Any) -> None:
    """Called by the site's builder."""
    for name, macro in MACROS.items():
        env.macro(macro, name)
