"""The report carries all it shows, and what is needed to repeat it."""

import importlib.metadata
import re

import pytest
from commands import entries_of, read, run_command
from pages import Page


@pytest.fixture(scope="module")
def page(fitted):
    return Page((fitted.out / "report.html").read_text(encoding="utf-8"))


def test_nothing_is_loaded_from_elsewhere(page):
    assert [reference for reference in page.references if not reference.startswith("#")] == []
    assert not {"link", "iframe", "img", "object", "embed", "base"} & set(page.tags)
    assert not re.search(r"@import|url\(", page.text("style"))


def test_the_plots_and_their_library_are_inside(page):
    assert "plotly.js v" in page.text("script")
    # A trace each: signals, loop. The laws: magnet, areas, Phi, friction. Slices, correlations, autocorrelation,
    # convergence.
    assert page.text("script").count("drawFigure(") == 2 * 2 + 4 + 4


def test_the_study_is_inside_word_by_word(page, fitted):
    assert page.text("pre").startswith(fitted.study.read_text())
    assert page.text("h1") == "small & quick"
    assert "Data: simulated <here>." in page.text("p").splitlines()


@pytest.mark.parametrize("package", ["vgtjax", "jax", "jaxlib", "equinox", "diffrax", "optimistix", "lineax", "numpy"])
def test_versions_are_inside_and_in_the_summary(page, package, fitted):
    version = importlib.metadata.version(package)
    assert f"{package} {version}" in page.text("p")
    assert read(fitted.out / "summary.json")["software"][package] == version


def test_the_fingerprint_is_that_of_the_summary(page, fitted):
    assert read(fitted.out / "summary.json")["study_sha256"][:16] in page.text("code")


def test_every_parameter_has_its_row(page, fitted):
    shown = page.text("code").splitlines()
    for name, fields in read(fitted.out / "parameters.json")["parameters"].items():
        size = len(fields["value"]) if isinstance(fields["value"], list) else None
        for entry in [name] if size is None else [f"{name}[{i}]" for i in range(size)]:
            assert entry in shown


def test_the_parameters_shown_are_those_of_the_file(page, fitted):
    shown = {row["name"]: row for row in page.table("name", "symbol")}
    entries = entries_of(read(fitted.out / "parameters.json")["parameters"])
    assert set(shown) == set(entries)
    for entry, fields in entries.items():
        row = shown[entry]
        # As many digits as the report has.
        assert float(row["value"]) == pytest.approx(fields["value"], rel=5.1e-6), entry
        assert float(row["start"]) == pytest.approx(fields["initial"], rel=5.1e-5), entry
        assert row["unit"] == fields["unit"]
        assert ("held" in row["remark"]) != fields["free"]
        if fields["std_error"] is None:
            assert row["standard error"] == ""
        else:
            assert float(row["standard error"]) == pytest.approx(fields["std_error"], rel=5.1e-2), entry
        if fields["free"]:
            change = 100 * (fields["value"] / fields["initial"] - 1) * (1 if fields["initial"] > 0 else -1)
            assert float(row["change"].removesuffix(" %")) == pytest.approx(change, abs=0.051), entry
    moved = [row for row in shown.values() if row["change"]]
    assert len(moved) == 4
    assert any(abs(float(row["change"].removesuffix(" %"))) > 1 for row in moved), "the fit moved something"


def test_the_traces_shown_are_those_of_the_summary(page, fitted):
    rows = page.table("trace", "use", "signal")
    traces = read(fitted.out / "summary.json")["traces"]
    expected = [(name, channel) for name, found in traces.items() for channel in found["rmse"]]
    assert len(rows) == len(expected) == 4
    for row, (name, channel) in zip(rows, expected, strict=True):
        unit, scale = {"x_d": ("um", 1e6), "p_act": ("Pa", 1.0)}[channel]
        assert (row["trace"] or name, row["signal"], row["unit"]) == (name, channel, unit)
        for column, key, digits in (("RMSE", "rmse", 4), ("sensor noise", "noise", 3), ("offset", "offset", 4)):
            value = scale * traces[name][key][channel]
            assert float(row[column]) == pytest.approx(value, rel=0.51 * 10 ** (1 - digits)), (name, channel, column)


def test_how_the_fit_ended_is_that_of_the_summary(page, fitted):
    summary = read(fitted.out / "summary.json")
    sentence, *figures = page.text("b").splitlines()
    assert sentence == f"{summary['sentence'][0].upper()}{summary['sentence'][1:]}."
    assert float(figures[1]) == pytest.approx(summary["chi2_per_degree_of_freedom"], rel=5.1e-4)
    assert int(figures[2]) == summary["iterations"] > 0
    said = {row["statistic"]: row["value"] for row in page.table("statistic", "value")}
    counts = [summary[name] for name in ("iterations", "rejected_steps", "failed_simulations")]
    assert said["steps, rejected, failed simulations"] == ", ".join(map(str, counts))
    first, last = map(float, said["start and final chi²/N"].split(", "))
    assert last == pytest.approx(2 * summary["cost"], rel=5.1e-5)
    assert first > last


def test_what_errors_take_for_exact_is_said(page, fitted):
    """This study says nothing of held values and of sensors."""
    (said,) = [sentence for sentence in read(fitted.out / "summary.json")["found"] if "for exact" in sentence]
    assert "diaphragm.area" in said
    assert "the gains of the sensors of x_d and p_act" in said
    assert f"{said[0].upper()}{said[1:]}." in page.text("li").splitlines()


def test_assumed_values_are_marked(page):
    assert "held, assumed" in page.text("td")


def test_both_uses_are_told_apart(page):
    assert {"fit", "validate"} <= set(page.text("td").splitlines())
    assert "converged" in page.text("b").splitlines()


@pytest.mark.parametrize(
    "line", ['channel = "pwm"', 'channel = "x_d"\nrelative_uncertainty = -0.1', "uncertainty = 1e-6"]
)
def test_a_sensor_that_can_not_be_is_refused(small, line):
    small.write_text(small.read_text() + f"\n[[report.sensor]]\n{line}\n")
    outcome = run_command("fit", small, "--out", small.parent / "out")
    assert outcome.status == 2
    assert outcome.err.startswith("error: study.toml: ")
    assert outcome.err.count("\n") == 1
