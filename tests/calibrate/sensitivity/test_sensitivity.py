"""The command `sensitivity` as a user runs it, on a small population."""

import pathlib

import numpy as np
import pytest
from commands import assert_refused, read, run_command
from pages import Page
from population_study import STUDY, write_study
from report_numbers import assert_cards, assert_shown, shown

import vgtjax
from calibrate.population import ChunkStore


@pytest.fixture(scope="module")
def done(tmp_path_factory) -> pathlib.Path:
    """The folder of a finished run, in the folder of its study."""
    folder = tmp_path_factory.mktemp("sensitivity")
    outcome = run_command("sensitivity", write_study(folder), "--out", folder / "out")
    assert outcome.status == 0, outcome.err
    assert (
        "note: sensitivity indices need independent quantities, so the stated correlations are left out" in outcome.out
    )
    index = read(folder / "out" / "summary.json")["outputs"]["hysteresis_0mbar"]["quantities"][0]
    assert f"  hysteresis_0mbar: {index['quantity']} {index['total']['value']:.2f} (" in outcome.out
    return folder / "out"


@pytest.fixture(scope="module")
def summary(done) -> dict:
    return read(done / "summary.json")


def index_of(summary: dict, output: str, quantity: str) -> dict:
    return next(row for row in summary["outputs"][output]["quantities"] if row["quantity"] == quantity)


def test_a_run_writes_its_two_files_and_no_more(done, summary):
    assert {path.name for path in done.iterdir()} == {".study.json", "summary.json", "report.html"}
    assert summary["simulations"] == 16 * (4 + 2)
    assert summary["failed"] == {"count": 0, "samples": []}


def test_what_physics_says_leads(summary):
    """The start of the vanes' motion depends on none of the four as much as on Coulomb friction; the final position of
    an open loop on the magnetic force; the loop's width, in pressure, on friction alone."""
    leading = {name: output["quantities"][0]["quantity"] for name, output in summary["outputs"].items()}
    assert leading["hysteresis_0mbar"] == "friction.coulomb_force"
    assert leading["steady_error_50"] == "converter.magnetic_force"
    assert index_of(summary, "hysteresis_0mbar", "friction.coulomb_force")["total"]["low"] > 0.05


def test_every_index_is_there_with_its_interval_and_they_agree(summary):
    found = index_of(summary, "steady_error_50", "converter.magnetic_force")
    for name in ("src_thesis", "first", "total"):
        index = found[name]
        assert index["low"] <= index["value"] <= index["high"]
    # A nearly linear output: shares by regression and by the gradient are the same, but for the variance that 96 runs
    # happen to have, a part in sqrt(96) of it.
    assert summary["outputs"]["steady_error_50"]["r2"] > 0.98
    assert found["src"]["value"] ** 2 == pytest.approx(found["gradient"], abs=0.1)
    assert found["morris"]["mu_star"]["value"] > 0
    assert found["verdict"] == "all agree"


def test_gradient_shares_are_those_of_central_differences(summary, done):
    """Of the final position, by simulating the nominal actuator with each quantity moved."""
    model = vgtjax.Actuator()
    trace = vgtjax.Trace(
        np.arange(351) * 2e-3, pwm=np.where(np.arange(351) >= 50, 50.0, 0.0)
    )  # the step of the study up to the end of its hold

    def final(name: str, factor: float) -> float:
        value = factor * np.asarray(vgtjax.get_parameter(model, name))
        return float(vgtjax.simulate(vgtjax.replace_parameters(model, {name: value}), trace).x_d[-1])

    deviations = {name: quantity["deviation"] for name, quantity in summary["quantities"].items()}
    slopes = {}
    for name, deviation in deviations.items():
        nominal = 1.0 if name == "converter.magnetic_force" else float(vgtjax.get_parameter(model, name))
        slopes[name] = (final(name, 1 + 1e-4) - final(name, 1 - 1e-4)) / (2e-4 * nominal) * deviation
    whole = sum(slope**2 for slope in slopes.values())
    for name, slope in slopes.items():
        # Central differences of a step of 1e-4 carry 1e-8 of curvature, and kinks some 1e-3.
        share = index_of(summary, "steady_error_50", name)["gradient"]
        assert share == pytest.approx(slope**2 / whole, abs=2e-3)


def test_indices_run_over_time(summary):
    curve = summary["over_time"]["step_position_50"]
    assert len(curve["time"]) == 51
    total = curve["quantities"]["converter.magnetic_force"]["total"]
    assert total[0] is None, "a rod at rest has no spread to share out"
    assert curve["deviation"][0] < 8e-3  # mm, the sensor's noise
    # At the end the curve is the final position, whose indices stand in the table.
    last = index_of(summary, "steady_error_50", "converter.magnetic_force")["total"]["value"]
    assert total[-1] == pytest.approx(last, abs=0.05)


def test_interrupted_run_goes_on_and_ends_the_same(done, summary, tmp_path, monkeypatch):
    study, saved = write_study(tmp_path), []

    def save(self, number, results, original=ChunkStore.save):
        if len(saved) == 2:
            raise OSError(28, "No space left on device", "chunk")
        saved.append(number)
        original(self, number, results)

    with monkeypatch.context() as patched:
        patched.setattr(ChunkStore, "save", save)
        assert run_command("sensitivity", study, "--out", tmp_path / "out").status == 1
    outcome = run_command("sensitivity", study, "--out", tmp_path / "out")
    assert "resuming with 2 of 3 chunks done" in outcome.out
    assert read(tmp_path / "out" / "summary.json")["outputs"] == summary["outputs"]


def test_a_run_interrupted_among_its_gradients_goes_on_there(summary, tmp_path, monkeypatch):
    study, saved = write_study(tmp_path), []

    def save(self, number, matrix, original=ChunkStore.save_slopes):
        if saved:
            raise OSError(28, "No space left on device", "slopes")
        saved.append(number)
        original(self, number, matrix)

    with monkeypatch.context() as patched:
        patched.setattr(ChunkStore, "save_slopes", save)
        assert run_command("sensitivity", study, "--out", tmp_path / "out").status == 1
    outcome = run_command("sensitivity", study, "--out", tmp_path / "out")
    assert "resuming with 1 of" in outcome.out
    assert "parts of the gradients done" in outcome.out
    assert read(tmp_path / "out" / "summary.json")["outputs"] == summary["outputs"]
    assert not (tmp_path / "out" / ".chunks").exists()


def test_outputs_that_are_read_a_few_at_a_time_have_the_same_indices(summary, tmp_path, monkeypatch):
    rows, few, read_at_once = summary["simulations"], 5, []

    def columns(self, names, *span, original=ChunkStore.columns):
        read_at_once.append(len(names))
        return original(self, names, *span)

    monkeypatch.setattr("calibrate.sensitivity.analysis.BLOCK", few * rows + 1)
    monkeypatch.setattr(ChunkStore, "columns", columns)
    assert run_command("sensitivity", write_study(tmp_path), "--out", tmp_path / "out").status == 0
    assert len(read_at_once) > 1
    assert max(read_at_once) == few
    for name, output in read(tmp_path / "out" / "summary.json")["outputs"].items():
        for quantity in output["quantities"]:
            known = index_of(summary, name, quantity["quantity"])
            for kind in ("src_thesis", "first", "total"):
                # Sums of a matrix product may be added up in another order where it is less wide.
                assert quantity[kind] == pytest.approx(known[kind], rel=1e-9, abs=1e-12)


def index_cells(output):
    """All rows of an output; those that matter by no index are left out of the report but for three."""

    def interval(index):
        ends = "" if index["value"] is None else f" {index['low']:.2f}…{index['high']:.2f}"
        return shown(index["value"], 3) + ends

    for row in output["quantities"]:
        yield {
            "quantity": row["quantity"],
            "verdict": row["verdict"],
            "SRC (4.1)": interval(row["src_thesis"]),
            "SRC": interval(row["src"]),
            "first order": interval(row["first"]),
            "total": interval(row["total"]),
            "gradient": shown(row["gradient"], 3),
            "DGSM": shown(row["derivative_based"], 3),
            f"μ*, {output['unit']}": shown(row["morris"]["mu_star"]["value"], 3),
            f"σ, {output['unit']}": shown(row["morris"]["sigma"], 3),  # noqa: RUF001 - a sigma
        }


def test_the_report_shows_the_numbers_of_the_summary(done, summary):
    page = Page((done / "report.html").read_text(encoding="utf-8"))
    tables, lengths = page.tables("quantity", "verdict"), []
    assert set(summary["outputs"]) <= set(page.texts["h3"])
    for rows, output in zip(tables, summary["outputs"].values(), strict=True):
        known = {cells["quantity"]: cells for cells in index_cells(output)}
        assert_shown(rows, (known[row["quantity"]] for row in rows))
        matters = {row["quantity"] for row in output["quantities"] if (row["total"]["value"] or 0) > 0.05}
        assert matters <= {row["quantity"] for row in rows}
        lengths.append(len(rows))
    assert max(lengths) == len(summary["quantities"])
    leading = [
        {"quantity": row["quantity"], "outputs": str(len(row["outputs"])), "which": ", ".join(row["outputs"])}
        for row in summary["leading"]
    ]
    assert_shown(page.table("quantity", "outputs"), leading)
    varied = [
        {"quantity": name, **{key: shown(row[key], 3 if key == "deviation" else 5) for key in ("nominal", "deviation")}}
        for name, row in summary["quantities"].items()
    ]
    assert_shown(page.table("quantity", "unit"), varied)
    counts = {name: str(len(summary[name])) for name in ("quantities", "outputs")}
    assert_cards(page, counts | {"simulations": str(summary["simulations"]), "failed": "0"})
    described = page.text("p")
    for output in summary["outputs"].values():
        deviation, r2 = shown(output["deviation"], 3), shown(output["r2"], 3)
        points = f"{output['base_points_used']} base points."
        said = f"standard deviation {deviation} {output['unit']}; R² of the linear model {r2}; {points}"
        assert f"{output['meaning']}; {said}" in described


def test_too_few_base_points_are_refused(tmp_path):
    (tmp_path / "study.toml").write_text(STUDY.replace("base = 16", "base = 8").replace('file = "unit', 'file = "*'))
    outcome = run_command("sensitivity", tmp_path / "study.toml", "--out", tmp_path / "out")
    sentence = "study.toml: sensitivity.base: Input should be greater than or equal to 16, but it is 8; correct it"
    assert_refused(outcome, sentence, tmp_path / "out")
