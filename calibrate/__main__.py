"""`python -m calibrate COMMAND`, which is the script `vgtjax-calibrate` too."""

import importlib.util
import sys

EXTRA = ("click", "jinja2", "platformdirs", "plotly", "psutil", "pydantic", "rich")
"""What the extra `app` brings; without it only the library is installed."""


def main(**options: str) -> None:
    """Runs the command line, if what it is made of is installed."""
    missing = [name for name in EXTRA if not _installed(name)]
    if missing:
        names = ", ".join(missing)
        remedy = "run pip install '.[app]' in a clone of vgtjax"
        print(f"error: the command line needs {names}; {remedy}", file=sys.stderr)
        sys.exit(2)
    from .command_line import main as command_line

    command_line(**options)


def _installed(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except ImportError:
        return False


if __name__ == "__main__":
    main(prog_name="python -m calibrate")
