"""Notebooks as a companion to the thesis: little code between two pictures, and all of them run in order."""

import json
import pathlib

import pytest

NOTEBOOKS = sorted((pathlib.Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))
SCREEN = 40
"""Lines of code that a browser shows at once on a laptop's screen of 1080 pixels."""


@pytest.fixture(params=NOTEBOOKS, ids=lambda path: path.stem)
def cells(request) -> list[dict]:
    """Of one notebook."""
    return json.loads(request.param.read_text())["cells"]


def code_between_pictures(cells: list[dict]) -> list[int]:
    """Lines of code up to every picture, and after the last; blank ones are not counted."""
    lines = [0]
    for cell in cells:
        if cell["cell_type"] == "code":
            lines[-1] += sum(bool(line.strip()) for line in cell["source"])
            if any("image/png" in output.get("data", {}) for output in cell["outputs"]):
                lines.append(0)
    return lines


def test_lines_between_pictures_are_counted():
    code = {"cell_type": "code", "source": ["a\n", "\n", "b"], "outputs": []}
    drawn = {**code, "outputs": [{"data": {"image/png": ""}}]}
    assert code_between_pictures([code, {"cell_type": "markdown", "source": ["c"]}, drawn, code]) == [4, 2]


def test_there_is_at_most_a_screen_of_code_between_two_pictures(cells):
    assert max(code_between_pictures(cells)) <= SCREEN


def test_what_it_shows_is_of_one_run_in_order(cells):
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))


def test_it_says_at_once_that_its_data_are_simulated(cells):
    assert "simulated" in "".join(cells[0]["source"])
