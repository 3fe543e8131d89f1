"""The Python blocks of README and manual, each with the test that runs it."""

from markdown_pages import ROOT

from calibrate.manual.markdown import blocks

PAGES, CONTROL = "calibrate/manual/test_pages.py", "vgtjax/tuning/test_manual.py"
RUN_BY = {
    ("README.md", "vgtjax.fit"): "test_readme.py::test_a_campaign_is_calibrated",
    ("README.md", "spread_population"): "test_readme.py::test_a_series_is_studied",
    ("README.md", "tune("): "test_readme.py::test_a_controller_is_tuned",
    (
        "docs/control.md",
        "class Follower",
    ): f"{CONTROL}::test_a_controller_of_ones_own_has_gains_and_conditions",
    ("docs/control.md", "tuned ="): f"{CONTROL}::test_gains_are_tuned_for_ones_own_actuator",
    ("docs/extending.md", "class Drag"): f"{PAGES}::test_a_friction_law_of_ones_own_takes_part",
    ("docs/extending.md", "NPZRecording"): f"{PAGES}::test_a_file_format_of_ones_own_is_read",
    ("docs/extending.md", "vgtjax.Trace("): f"{PAGES}::test_a_trace_is_made_of_arrays",
    ("docs/python.md", "vgtjax.jacobian"): f"{PAGES}::test_a_first_simulation_runs",
    ("docs/python.md", "close_loops"): f"{PAGES}::test_closed_loops_run",
    ("docs/tutorials/study.md", "spread_population"): f"{PAGES}::test_a_series_runs",
}
"""By page, and what stands in this block of it alone."""


def python_block(page: str, name: str) -> str:
    """The block of a page that has a name in it, if a test is said to run it."""
    assert (page, name) in RUN_BY, f"{page}: say in RUN_BY which test runs the block with {name}"
    (text,) = (text for text in blocks(ROOT / page, "python") if name in text)
    return text
