"""The command `tune` as a user runs it, on one actuator and a PI."""

import json
import math
import pathlib
import re
from unittest import mock

import numpy as np
import pytest
from commands import assert_refused, read, run_command
from pages import Page
from report_numbers import assert_cards, assert_shown, margin_cells, shown, target_words, um

import calibrate.resumable as resumable
import vgtjax
from calibrate.study.channels import ChannelTable
from calibrate.study.references import PrintedReference, SineReference, TraceReference, build_references
from calibrate.tune.gains_file import load_controller
from calibrate.tune.job import EXAMPLE, prepare_tuning
from calibrate.tune.outcome import Outcome
from vgtjax.control import reference_at
from vgtjax.tuning import Sliding

STUDY = """
name = "a quick PI"
[control]
design = "pi"
duration = 0.5
settled = 0.1
period = 2e-3
{more}
[[control.reference]]
kind = "sine"
amplitude = 0.001
rate = 12.0
offset = 0.005
[control.unseen]
[[control.unseen.reference]]
kind = "sine"
name = "slower"
amplitude = 0.002
rate = 6.0
offset = 0.004
"""


def write(folder: pathlib.Path, more: str = "", text: str = STUDY) -> pathlib.Path:
    path = folder / "study.toml"
    path.write_text(text.format(more=more), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def done(tmp_path_factory) -> pathlib.Path:
    """The folder of a finished run."""
    folder = tmp_path_factory.mktemp("tune")
    outcome = run_command("tune", write(folder), "--out", folder / "out")
    assert outcome.status == 0, outcome.err
    unseen = read(folder / "out" / "summary.json")["cost"]["unseen"]
    assert f"cost of the loops unseen: {unseen['start']:.4g} before, {unseen['tuned']:.4g} after\n" in outcome.out
    return folder / "out"


@pytest.fixture(scope="module")
def summary(done) -> dict:
    return read(done / "summary.json")


def test_a_run_writes_its_three_files_and_no_more(done):
    assert {path.name for path in done.iterdir()} == {".study.json", "gains.json", "summary.json", "report.html"}


@pytest.mark.parametrize(("after", "warned"), [(5.0, False), (7.0, False), (7.5, True), (math.inf, True)])
def test_gains_that_are_worse_along_what_they_were_not_tuned_on_are_said(after, warned):
    unseen = mock.Mock(costs=(7.0, after))
    remarks = Outcome(*[mock.Mock()] * 3, unseen, {}, None, 0.0).remarks
    assert bool(remarks) is warned
    assert all(f"from 7 to {after:g}" in remark for remark in remarks)


@pytest.mark.parametrize(("share", "warned"), [(0.3, True), (0.995, False)])
def test_an_observer_that_does_not_slide_is_said(share, warned):
    found = Sliding("observer.switching_gain", 1.24, share, "printed, sine, 0 mbar", 2.0, 6e3, 27.8)
    outcome = Outcome(*[mock.Mock()] * 3, mock.Mock(costs=(7.0, 5.0)), {}, found, 0.0)
    assert outcome.remarks == [found.sentence] * warned


def test_gains_have_the_form_of_parameters(done):
    gains = read(done / "gains.json")
    assert gains["design"] == "pi"
    assert list(gains["parameters"]) == ["proportional_gain", "integral_gain", "tracking_time"]
    row = gains["parameters"]["proportional_gain"]
    assert set(row) == {
        "value", "unit", "free", "std_error", "interval", "initial", "lower", "upper", "at_bound", "identifiable"
    }  # fmt: skip
    assert row["unit"] == "%/m"
    assert row["initial"] == 6000.0
    assert row["value"] != row["initial"]
    # This duty never saturates, so nothing tells how fast the integral should forget.
    told = {name: found["identifiable"] for name, found in gains["parameters"].items()}
    assert told == {"proportional_gain": True, "integral_gain": True, "tracking_time": False}


def test_gains_are_a_whole_controller(done, summary):
    """With the actuator that it believes in; what a sample of it costs on its target is known."""
    tuned = load_controller(done / "gains.json")
    job = prepare_tuning(done.parent / "study.toml", None)
    values = {name: row["value"] for name, row in read(done / "gains.json")["parameters"].items()}
    expected = vgtjax.replace_parameters(job.true.controller, values)
    assert tuned.period == 2e-3
    for name in vgtjax.parameter_table(expected):
        np.testing.assert_array_equal(
            vgtjax.get_parameter(tuned.controller, name), vgtjax.get_parameter(expected, name)
        )
    assert summary["sample"]["memory"] == 4  # the integral, and the last number of three sensors
    assert summary["sample"]["operations"] > 100
    assert "<h3>On the target</h3>" in (done / "report.html").read_text(encoding="utf-8")


def test_the_summary_is_that_of_closed_loops_with_these_gains(done, summary):
    """Simulated once more from `gains.json`."""
    job = prepare_tuning(done.parent / "study.toml", None)
    values = {name: row["value"] for name, row in read(done / "gains.json")["parameters"].items()}
    controller = vgtjax.replace_parameters(job.true.controller, values)
    coordinates = np.asarray(job.true.transform.to_coordinates(job.true.selection.pack(controller)))
    for name, problem in (("tuned_on_smoothed", job.smooth), ("tuned_on", job.true), ("unseen", job.unseen)):
        found = problem.evaluate(coordinates)
        rows = summary["cases"][name]
        # Gains went through their logarithms.
        np.testing.assert_allclose([row["tuned"]["rms"] for row in rows], found.rms, rtol=1e-6)
        np.testing.assert_allclose([row["tuned"]["cost"] for row in rows], found.costs, rtol=1e-6)
        assert summary["cost"][name]["tuned"] == pytest.approx(problem.combine(found.costs), rel=1e-6)
    assert summary["converged"]
    assert summary["cost"]["tuned_on"]["tuned"] < 0.5 * summary["cost"]["tuned_on"]["start"]
    ratio = summary["cost"]["tuned_on"]["tuned"] / summary["cost"]["tuned_on_smoothed"]["tuned"]
    assert summary["gap"] == pytest.approx(ratio - 1, abs=1e-9)
    assert summary["cases"]["unseen"][0]["reference"] == "slower"


def test_the_same_command_again_does_nothing_and_another_study_is_refused(done):
    study = done.parent / "study.toml"
    again = run_command("tune", study, "--out", done)
    assert again.status == 0
    assert "nothing to do" in again.out
    folder = done.parent / "other"
    folder.mkdir()
    other = run_command("tune", write(folder, "seed = 1"), "--out", done)
    assert other.status == 2
    assert "holds the results of another study" in other.err


def test_a_run_that_was_interrupted_goes_on_where_it_was(done, summary, monkeypatch):
    """Killed after two steps; the rest is what the run in one go did."""
    out, steps = done.parent / "resumed", []
    write_json = resumable.write_json

    def stop(path, content):
        write_json(path, content)
        steps.append(path.name)
        if len(steps) == 2:
            raise RuntimeError("killed")

    monkeypatch.setattr(resumable, "write_json", stop)
    with pytest.raises(RuntimeError, match="killed"):
        run_command("tune", done.parent / "study.toml", "--out", out)
    assert {path.name for path in out.iterdir()} == {".study.json", ".progress.json"}
    monkeypatch.setattr(resumable, "write_json", write_json)
    outcome = run_command("tune", done.parent / "study.toml", "--out", out)
    assert outcome.status == 0
    assert "resuming after step 2" in outcome.out
    np.testing.assert_allclose(read(out / "summary.json")["history"], summary["history"], rtol=1e-6)


def test_progress_that_cannot_be_read_starts_again(done):
    out = done.parent / "broken"
    out.mkdir()
    (out / ".study.json").write_text((done / ".study.json").read_text(encoding="utf-8"), encoding="utf-8")
    (out / ".progress.json").write_text(json.dumps({"seconds": 1.0}), encoding="utf-8")
    outcome = run_command("tune", done.parent / "study.toml", "--out", out)
    assert outcome.status == 0
    assert "so tuning starts again" in outcome.out


def cost_cells(rows):
    """A row for every reference and turbine pressure: the plants' mean cost, middle and worst error."""
    for at in dict.fromkeys((row["reference"], row["turbine_pressure"]) for row in rows):
        mine = [row for row in rows if (row["reference"], row["turbine_pressure"]) == at]
        cells = {"reference": at[0], "turbine, mbar": f"{at[1] / 100:g}", "plants": str(len(mine))}
        for end, number in (("start", ""), ("tuned", " (2)")):
            costs, rms, peak = (np.array([row[end][name] for row in mine]) for name in ("cost", "rms", "peak"))
            cells |= {f"cost{number}": shown(costs.mean(), 4), f"RMS, median{number}": um(np.median(rms))}
            cells |= {f"RMS, worst{number}": um(rms.max()), f"peak{number}": um(peak.max()), f"failed{number}": "0"}
        yield cells


def gain_cells(parameters):
    for name, row in parameters.items():
        numbers = {"start": "initial", "tuned": "value", "lower": "lower", "upper": "upper"}
        cells = {heading: shown(row[key]) for heading, key in numbers.items() if row[key] is not None}
        yield {"gain": name, "unit": row["unit"], **cells}


def test_a_report_shows_the_numbers_of_the_files(done, summary):
    text = (done / "report.html").read_text(encoding="utf-8")
    page, cost = Page(text), summary["cost"]
    tuned_on, unseen = page.tables("reference", "turbine, mbar", "plants")
    assert_shown(tuned_on, cost_cells(summary["cases"]["tuned_on"]))
    assert_shown(unseen, cost_cells(summary["cases"]["unseen"]))
    assert_shown(page.table("gain", "symbol"), gain_cells(read(done / "gains.json")["parameters"]))
    assert_shown(page.table("plant", "rod"), margin_cells(summary))
    cards = {"cost, start": shown(cost["tuned_on"]["start"], 4), "cost, tuned": shown(cost["tuned_on"]["tuned"], 4)}
    cards |= {"cost where not tuned on": shown(cost["unseen"]["tuned"], 4), "steps": str(summary["iterations"])}
    assert_cards(page, cards | {"evaluations": str(summary["evaluations"]), "failed closed loops": "0"})
    ends = [shown(cost[name]["tuned"], 4) for name in ("tuned_on", "tuned_on_smoothed")]
    gap = f"{100 * summary['gap']:+.1f} %"
    assert f"the true ones cost {ends[0]}, the smoothed ones {ends[1]}: a gap of {gap}." in text
    assert target_words(summary) in page.text("p").replace("\n", "")
    assert "<script src" not in text


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        (
            "plants = 0",
            "control.plants: Input should be greater than or equal to 1, but it is 0; correct it",
        ),
        ('fre = ["*"]', "unknown key 'control.fre'; did you mean 'free'?"),
        (
            'free = ["propotional_gain"]',
            "parameter name or pattern 'propotional_gain' matches nothing; did you mean 'proportional_gain'? (see "
            "[control] in the study)",
        ),
        (
            "gains = {proportional_gain = {value = -1.0}}",
            "'proportional_gain' must be finite and not negative, but it is -1; correct it (see [control.gains] in the "
            "study)",
        ),
        (
            "gains = {proportional_gain = {lower = 7000.0}}",
            "'proportional_gain' must be at least 7000, but it is 6000; change one (see [control.gains] in the study)",
        ),
        (
            "derivative_memory = [0.0]",
            "control.derivative_memory: Input should be greater than 0, but it is 0.0; correct it",
        ),
    ],
)
def test_bad_studies_get_one_sentence(more, sentence, tmp_path):
    out = tmp_path / "out"
    assert_refused(run_command("tune", write(tmp_path, more), "--out", out), f"study.toml: {sentence}", out)


@pytest.mark.parametrize(
    ("entry", "sentence"),
    [
        (
            'kind = "sine"\nrate = 1.0',
            "the key 'control.reference.amplitude' is missing, which kind = 'sine' needs; add it",
        ),
        (
            'kind = "signal-1"\ntimes = [1.0]',
            "the key 'control.reference.times' belongs to kind = 'steps' or 'ramps', but it is 'signal-1'; remove the "
            "key",
        ),
        (
            'kind = "trace"',
            "the key 'control.reference.file' is missing, which kind = 'trace' needs; add it",
        ),
        ('kind = "ramps"\nlevls = [1.0]', "unknown key 'control.reference.levls'; did you mean 'levels'?"),
        ("rate = 1.0", "the key 'control.reference.kind' is missing; add it"),
        (
            'kind = "signal1"',
            "control.reference.kind must be one of sine, steps, ramps, signal-1, signal-2, trace, but it is 'signal1'; "
            "did you mean 'signal-1'?",
        ),
    ],
)
def test_references_have_the_keys_of_their_kind(entry, sentence, tmp_path):
    (tmp_path / "study.toml").write_text(f"[[control.reference]]\n{entry}\n", encoding="utf-8")
    outcome = run_command("tune", tmp_path / "study.toml", "--out", tmp_path / "out")
    assert_refused(outcome, f"study.toml: {sentence}", tmp_path / "out")


def test_two_references_of_one_name_are_refused(tmp_path):
    with pytest.raises(vgtjax.InputError, match="two references are called 'signal-1'; give each its own name"):
        build_references([PrintedReference(kind="signal-1")] * 2, tmp_path, {})


def test_a_reference_may_begin_later_and_be_a_trace():
    folder = pathlib.Path(vgtjax.__file__).parents[1] / "calibrate" / "example"
    entries = [
        SineReference(kind="sine", amplitude=0.001, rate=2.0, begin=1.5),
        TraceReference(kind="trace", file="step_80.csv"),
    ]
    signals = build_references(entries, folder, {})
    assert float(reference_at(signals["sine"], 0.25).position) == pytest.approx(0.001 * np.sin(2 * 1.75))
    trace = vgtjax.load_trace(folder / "step_80.csv")
    # A spline through the samples.
    at = reference_at(signals["trace"], trace.time[500] - trace.time[0]).position
    assert float(at) == pytest.approx(trace.x_d[500], abs=1e-9)


def test_a_reference_has_the_channels_of_its_study(tmp_path):
    """Others that the study maps need not be in its file."""
    rows = "\n".join(f"{i / 1000},{i / 1000},900" for i in range(100))
    (tmp_path / "log.csv").write_text(f"t [s],Pos [mm],p_act [mbar]\n{rows}\n", encoding="utf-8")
    names = {"time": "t", "x_d": "Pos", "p_res": "P_Vacuum"}
    channels = {signal: ChannelTable(name=name) for signal, name in names.items()}
    (signal,) = build_references([TraceReference(kind="trace", file="log.csv")], tmp_path, channels).values()
    assert float(reference_at(signal, 0.05).position) == pytest.approx(0.05e-3)


def test_a_reference_may_be_in_our_own_form_beside_traces_of_a_logger(tmp_path):
    rows = "\n".join(f"{i / 1000},{i / 1e6}" for i in range(100))
    (tmp_path / "own.csv").write_text(f"time [s],x_d [m]\n{rows}\n", encoding="utf-8")
    channels = {"time": ChannelTable(name="t"), "x_d": ChannelTable(name="Pos", scale=0.9, time="clock")}
    (signal,) = build_references([TraceReference(kind="trace", file="own.csv")], tmp_path, channels).values()
    assert float(reference_at(signal, 0.05).position) == pytest.approx(0.05e-3)


def test_another_content_of_a_reference_is_another_study(tmp_path):
    source = pathlib.Path(vgtjax.__file__).parents[1] / "calibrate" / "example" / "step_80.csv"
    lines = source.read_text(encoding="utf-8").splitlines()
    text = '[control]\ndesign = "pi"\nduration = 0.2\nsettled = 0.1\n'
    text += '[[control.reference]]\nkind = "trace"\nfile = "r.csv"\n'
    (tmp_path / "study.toml").write_text(text, encoding="utf-8")
    prints = []
    for count in (1001, 1002):
        (tmp_path / "r.csv").write_text("\n".join(lines[:count]) + "\n", encoding="utf-8")
        prints.append(prepare_tuning(tmp_path / "study.toml", None).fingerprint)
    assert prints[0] != prints[1]


def test_a_design_needs_the_friction_that_it_observes(tmp_path):
    text = '[components]\nfriction = "coulomb"\n[control]\ndesign = "backstepping"\n'
    path = tmp_path / "study.toml"
    path.write_text(text, encoding="utf-8")
    outcome = run_command("tune", path, "--out", tmp_path / "out")
    sentence = (
        "study.toml: a plant must have LuGre friction, whose bristles the design observes, but it has Coulomb; use "
        "LuGre, or a PI"
    )
    assert_refused(outcome, sentence, tmp_path / "out")


def test_drawn_plants_that_are_not_physical_are_left_out(tmp_path):
    """Chambers from half of what the diaphragm sweeps on, and then only smaller ones but for the nominal one."""
    path = tmp_path / "study.toml"

    def write_spread(upper):
        path.write_text(
            STUDY.format(more="")
            + f'[parameters]\n"chamber.volume" = {{value = {upper}}}\n[population]\nvary = ["chamber.volume"]\n'
            + f'[population.parameters]\n"chamber.volume" = {{lower = 1.5e-5, upper = {upper}, '
            'distribution = "uniform"}\n',
            encoding="utf-8",
        )

    write_spread(4.5e-5)
    job = prepare_tuning(path, None)
    (note,) = [note for note in job.notes if "swallows" in note]
    lost, total = (int(number) for number in re.findall(r"in (\d+) of (\d+) drawn plants", note)[0])
    assert 0 < lost < total
    assert len({label.plant for label in (*job.true.cases.labels, *job.unseen.cases.labels)}) == total - lost
    write_spread(2.961e-5)
    sentence = (
        "study.toml: gains need a plant that is physical, but in 20 of 20 drawn plants the diaphragm swallows the "
        "chamber; narrow the spreads under [population]"
    )
    assert_refused(run_command("tune", path, "--out", tmp_path / "out"), sentence, tmp_path / "out")


def test_the_example_tunes_on_some_units_and_tries_others():
    job = prepare_tuning(EXAMPLE, None)
    tuned_on, tried_on = ({label.plant for label in p.cases.labels} for p in (job.true, job.unseen))
    assert tuned_on
    assert tried_on
    assert not tuned_on & tried_on
    seen = {label.reference for label in job.true.cases.labels}
    assert not seen & {label.reference for label in job.unseen.cases.labels}
