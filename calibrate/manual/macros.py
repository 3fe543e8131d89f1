"""What a page of the API may ask for, `{{ api("control") }}`; other tables stand in the pages (`tables.py`)."""

from typing import Any

from calibrate.manual.reference import api


def define_env(env: Any) -> None:
    """Called by the site's builder."""
    env.macro(api, "api")
