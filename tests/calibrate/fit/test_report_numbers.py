"""Every number of a report stands in `summary.json` or `parameters.json`, digit by digit."""

import datetime
import hashlib
import json
import pathlib
import re

import numpy as np
import pytest
from commands import cut_example, entries_of, read, run_command, timeless
from pages import Page
from report_numbers import shown

import calibrate
from calibrate.study.parameter_file import by_entry

TEMPLATES = pathlib.Path(calibrate.__file__).parent / "templates"
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*[A-Za-z])")
MORE = """
"diaphragm.area" = {deviation = 3e-5}
[report]
title = "Calibration of unit A"
id = "2026-17"
customer = "Works <2>"
item = "actuator"
date = 2026-04-01
serial = "A 4711"
author = "N. N."
[[report.sensor]]
channel = "x_d"
serial = "L-9"
calibrated = 2026-03-01
uncertainty = 2e-6
relative_uncertainty = 0.01
"""


@pytest.fixture(scope="module")
def signed(fitted, tmp_path_factory):
    """The small study as one whose report is to be signed: an area with a tolerance, a sensor with a certificate, and a
    profile of every parameter."""
    folder = tmp_path_factory.mktemp("signed")
    for name in ("step_80", "step_50"):
        cut_example(name, 1.2, folder)
    text = fitted.study.read_text().replace("[fit]", '[fit]\nprofiles = "all"')
    (folder / "study.toml").write_text(text + MORE)
    assert run_command("fit", folder / "study.toml", "--out", folder / "out").status == 0
    return folder


@pytest.fixture(scope="module")
def page(signed):
    return Page((signed / "out/report.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def summary(signed):
    return read(signed / "out/summary.json")


@pytest.fixture(scope="module")
def entries(signed):
    return entries_of(read(signed / "out/parameters.json")["parameters"])


# -- tables ------------------------------------------------------------------------------------------------------------


def parameters(summary, entries):
    for name, row in entries.items():
        interval = row["interval"] and " to ".join(shown(end, 5) for end in row["interval"])
        free, moved = row["free"], summary["corrections"]["moved"].get(name)
        yield {
            "name": name,
            "start": shown(row["initial"], 5),
            "value": shown(row["value"], 6),
            "standard error": shown(row["std_error"], 2),
            "95 % interval": interval or "",
            "change": f"{100 * (row['value'] - row['initial']) / abs(row['initial']):+.1f} %" if free else "",
            "moved": f"{moved:+.1f}" if free else "",
        }


def met(summary, _):
    for trace, row in summary["traces"].items():
        for place, channel in enumerate(row["rmse"]):
            scale = {"x_d": 1e6, "p_act": 1.0}[channel]
            yield {
                "trace": "" if place else trace,
                "signal": channel,
                "RMSE": shown(scale * row["rmse"][channel], 4),
                "sensor noise": shown(scale * row["noise"][channel], 3),
                "peak": shown(scale * row["peak"][channel], 4),
                "offset": shown(scale * row["offset"][channel], 4),
                "largest error by parameters": shown(scale * row["largest_error"][channel], 2),
                "lag-1 correlation": f"{row['correlation_of_neighbours'][channel]:.3f}",
            }


def budget(summary, _):
    for name, row in summary["budget"].items():
        yield {
            "value of": name,
            "A: noise": shown(row["type_a"]["noise"], 2),
            "A: scatter": shown(row["type_a"]["scatter_of_corrections"], 2),
            **{f"B: {source}": shown(part, 2) for source, part in row["type_b"].items()},
            "combined": shown(row["combined"], 2),
            "noise by windows": shown(row["noise_by_windows"], 2),
        }


def decisions(summary, _):
    for row in summary["decisions"]:
        numbers = {"found": row["found"], "from": row["lower"], "to": row["upper"]}
        texts = {"decision on": row["what"], "rule": row["rule"], "verdict": row["verdict"]}
        yield {**texts, **{name: shown(value, 4) for name, value in numbers.items()}}


def statistics(summary, _):
    chi2 = 2 * summary["cost"] * summary["measurements"]
    gain = shown(summary["chi2_gain_of_a_further_linear_step"], 3)
    ends = (2 * summary["cost_at_start"], 2 * summary["cost"])
    counts = ("iterations", "rejected_steps", "failed_simulations")
    for name, value in {
        "optimiser": "Levenberg-Marquardt (optimistix) with exact segment-parallel Jacobians, QR",
        "gradient certificate": summary["certificate"]["sentence"],
        "steps, rejected, failed simulations": ", ".join(str(summary[each]) for each in counts),
        "integration": "stabilised Heun, steps of at most 0.5 ms aligned with the samples",
        "chi² that a full linear step would still gain": f"{gain} of {shown(chi2, 6)}",
        "start and final chi²/N": ", ".join(shown(each, 5) for each in ends),
    }.items():
        yield {"statistic": name, "value": value}


def profiles(summary, _):
    for name, row in summary["profiles"].items():
        below, above = ("open" if end is None else f"{end:+.2f}" for end in row["ends"])
        yield {"parameter": name, "verdict": row["verdict"], "95 % below, standard errors": below, "above": above}


def hashes(summary, _):
    for name, row in summary["traces"].items():
        yield {"trace": name, "SHA-256 of its file": row["sha256"]}


def sensors(summary, _):
    for row in summary["report"]["sensor"]:
        gain = row["relative_uncertainty"]
        yield {
            "sensor": row["channel"],
            "serial": row["serial"],
            "calibrated": row["calibrated"],
            "of the offset, SI": shown(row["uncertainty"], 3),
            "of the gain, %": shown(100 * gain, 3),
        }


def expected(summary, _):
    for name, error in summary["expected_relative_error_at_start"].items():
        yield {"expected of": name, "relative error, %": "" if error is None else shown(100 * error, 2)}


TABLES = {
    ("name", "symbol"): parameters,
    ("trace", "use"): met,
    ("value of", "A: noise"): budget,
    ("decision on", "found"): decisions,
    ("statistic", "value"): statistics,
    ("parameter", "verdict"): profiles,
    ("trace", "SHA-256 of its file"): hashes,
    ("sensor", "serial"): sensors,
    ("expected of", "relative error, %"): expected,
}
"""What each table shows of the files, by the beginning of its heading."""


@pytest.mark.parametrize("heading", TABLES, ids=lambda heading: heading[0])
def test_a_table_shows_the_files_digit_by_digit(page, summary, entries, heading):
    rows, expected = page.table(*heading), list(TABLES[heading](summary, entries))
    assert len(rows) == len(expected) > 0
    for row, wanted in zip(rows, expected, strict=True):
        assert {name: row[name] for name in wanted} == wanted


def test_no_other_table_has_numbers(page):
    """What the report says of itself beside them is the study's own `[report]`."""
    starts = [row for before, row in zip([[], *page.rows], page.rows, strict=False) if not before and row]
    unknown = [row for row in starts if tuple(row[:2]) not in TABLES]
    assert unknown == [["id", "2026-17"]]


def test_all_other_numbers_stand_in_the_files_or_in_the_template(signed, page, summary):
    """Words, sentences and cards: what a fit says in words, its summary says with the same words."""
    static = "\n".join(re.sub(r"\{[{%#].*?[}%#]\}", " ", each.read_text()) for each in TEMPLATES.glob("*.jinja"))
    words = json.dumps(
        {key: summary[key] for key in ("found", "verdict", "certificate", "report", "decisions", "software")}
    )
    words += json.dumps([summary["sentence"], *summary["check"]["sentences"]])
    windows = [shown(value, 2) for value in summary["noise_by_windows"].values()]
    counts = [*windows, summary["iterations"], len(summary["slices"]), *summary["evaluations"].values()]
    cards = [shown(summary["chi2_per_degree_of_freedom"], 4), shown(summary["wall_seconds"], 3), *map(str, counts)]
    known = {*NUMBER.findall(static), *NUMBER.findall(words), *cards}
    texts = [text for tag in ("p", "b", "span", "li", "div", "h1", "h2", "h3") for text in page.texts.get(tag, [])]
    texts = [re.sub(r"\[[\d., -]+\]", "", text) for text in texts]  # numbers of equations
    said = [text for text in texts if "Calibration of the full model" not in text]
    assert [(token, text) for text in said for token in NUMBER.findall(text) if token not in known] == []


def test_a_report_can_be_made_again_but_for_date_and_time(fitted, small):
    """Two fits of one study, at different times."""
    assert str(datetime.date.today().year) in (fitted.out / "report.html").read_text()
    assert run_command("fit", small, "--out", small.parent / "out").status == 0
    assert timeless(fitted.out / "report.html") == timeless(small.parent / "out/report.html")


# -- the budget --------------------------------------------------------------------------------------------------------


def test_the_parts_of_the_budget_add_up_to_the_standard_errors(summary, entries):
    free = {name for name, row in entries.items() if row["free"]}
    assert set(summary["budget"]) == free
    for name, row in summary["budget"].items():
        assert set(row["type_b"]) == {"gain of x_d", "diaphragm.area"}
        parts = [*row["type_a"].values(), *row["type_b"].values()]
        assert row["combined"] == pytest.approx(np.linalg.norm(parts), rel=1e-12)
        assert row["combined"] == pytest.approx(entries[name]["std_error"], rel=1e-9)


def test_an_area_and_a_gain_move_a_stiffness_by_their_own_part(summary, entries):
    """A larger area is a stiffer spring by as much; a position that reads too large, a softer one."""
    stiffness, area = (entries[name]["value"] for name in ("diaphragm.stiffness", "diaphragm.area"))
    parts = summary["budget"]["diaphragm.stiffness"]["type_b"]
    # Other free values take a part of it: offset, preload and the magnet.
    assert parts["diaphragm.area"] / stiffness == pytest.approx(3e-5 / area, rel=0.5)
    assert parts["gain of x_d"] / stiffness == pytest.approx(-0.01, rel=0.5)


def test_a_limit_is_kept_beyond_doubt_or_not_decided(summary):
    (row,) = [row for row in summary["decisions"] if row["what"] == "diaphragm.stiffness"]
    assert (row["lower"], row["upper"], row["verdict"]) == (8000, 16000, "within")
    assert "guarded acceptance" in row["rule"]
    # All but four values are held at those of another actuator: what that leaves is no noise of a sensor.
    (row,) = [row for row in summary["decisions"] if row["verdict"] == "exceeded"]
    assert row["what"].startswith("worst trace: ")
    assert row["found"] > 2 * row["upper"]  # a trace that is met stays below `upper`
    assert {row["verdict"] for row in summary["decisions"]} == {"within", "kept", "exceeded"}


# -- whose it is -------------------------------------------------------------------------------------------------------


def test_a_report_to_be_signed_says_whose_it_is_and_counts_its_sensors(fitted, signed, summary):
    """A position that is 1 % off makes a stiffness 1 % wrong, which a thousand samples don't know."""
    text = (signed / "out/report.html").read_text()
    for said in (
        "<h1>Calibration of unit A</h1>",
        "2026-17",
        "Works &lt;2&gt;",
        "A 4711",
        "N. N.",
        "L-9",
        "2026-03-01",
    ):
        assert said in text
    for name in ("step_80", "step_50"):
        assert summary["traces"][name]["sha256"] == hashlib.sha256((signed / f"{name}.csv").read_bytes()).hexdigest()
    before, after = (
        by_entry({"k": read(out / "parameters.json")["parameters"]["diaphragm.stiffness"]["std_error"]})["k"]
        for out in (fitted.out, signed / "out")
    )
    parts = summary["budget"]["diaphragm.stiffness"]["type_b"]
    assert np.sqrt(after**2 - before**2) == pytest.approx(np.linalg.norm(list(parts.values())), rel=1e-6)
