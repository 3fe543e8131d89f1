"""The command `control` as a user runs it: one PI on three drawn plants, a sine and a step."""

import json
import pathlib

import numpy as np
import pytest
from broken_controller import Broken
from commands import Outcome, assert_refused, read, run_command
from pages import Page
from report_numbers import assert_cards, assert_shown, margin_cells, shown, target_words, um

import vgtjax
from calibrate.control.job import prepare_control
from calibrate.output.files import write_json
from calibrate.population import Actuators
from calibrate.study.references import PrintedReference, SineReference, cycle
from calibrate.study.tables import AnyStudy
from calibrate.tune.designs import DESIGNS
from calibrate.tune.gains_file import gains_json, note_on_plant
from calibrate.tune.job import prepare_tuning
from calibrate.tune.plants import BELIEFS, all_plants, belief_of
from vgtjax.control import SIGNAL_1_PERIOD
from vgtjax.population import spread_population

STUDY = """
name = "a PI on strangers"
[population]
vary = ["diaphragm.stiffness"]
[control]
design = "pi"
plants = 3
duration = 0.5
settled = 0.1
period = 2e-3
turbine_pressure = [0, 1e5]
{more}
[[control.reference]]
kind = "sine"
amplitude = 0.001
rate = 24.0
offset = 0.005
[[control.reference]]
kind = "steps"
name = "up & down"
times = [0.1]
levels = [0.006]
initial = 0.005
rise = 0.05
"""
SWITCHING = """
[control]
design = "backstepping"
belief = "printed"
duration = 0.3
settled = 0.1
turbine_pressure = [0]
gains = {{"observer.injection_rate" = {{value = 0.0}}, "observer.switching_gain" = {{value = 0.5}}}}
{more}
[[control.reference]]
kind = "sine"
amplitude = 0.002
rate = 10.0
offset = 0.005
[parameters]
"diaphragm.preload" = {{value = 58.0}}
"""
GAINS = {"design": "pi", "parameters": {"proportional_gain": {"value": 9000.0}, "tracking_time": {"value": None}}}


def write(folder: pathlib.Path, more: str = "", text: str = STUDY) -> pathlib.Path:
    path = folder / "study.toml"
    path.write_text(text.format(more=more), encoding="utf-8")
    return path


def write_gains(folder: pathlib.Path, **changes: object) -> pathlib.Path:
    (folder / "gains.json").write_text(json.dumps(GAINS | changes), encoding="utf-8")
    return folder / "gains.json"


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> pathlib.Path:
    return tmp_path_factory.mktemp("control")


@pytest.fixture(scope="module")
def outcome(folder) -> Outcome:
    return run_command("control", write(folder), "--out", folder / "out")


@pytest.fixture(scope="module")
def summary(outcome, folder) -> dict:
    assert outcome.status == 0, outcome.err
    return read(folder / "out" / "summary.json")


def test_a_run_writes_its_files(summary, folder):
    names = {path.name for path in (folder / "out").iterdir()}
    assert names == {".study.json", "summary.json", "report.html", "traces"}
    assert len(list((folder / "out" / "traces").iterdir())) == 3 * 2 * 2


def test_every_loop_has_its_row(summary):
    loops = summary["loops"]
    assert len(loops) == 12
    assert {loop["plant"] for loop in loops} == {"sample 0", "sample 1", "sample 2"}
    assert {loop["turbine_pressure"] for loop in loops} == {0.0, 1e5}
    assert all(loop["pressure_rms"] is None and not loop["failed"] for loop in loops)
    assert all(0 < loop["rms"] < loop["peak"] for loop in loops)
    answered = {loop["reference"] for loop in loops if loop["overshoot"] is not None}
    assert answered == {"up & down"}
    assert summary["worst"]["peak"] == max(loop["peak"] for loop in loops)


def test_margins_of_every_plant_are_those_of_its_linear_loop(summary):
    """Three plants, up and down; a PI of this kind bears a factor of ten of its gain."""
    rows = summary["margins"]
    assert [row["rod"] for row in rows] == ["falling", "rising"] * 3
    assert len({row["plant"] for row in rows}) == 3
    for row in rows:
        assert row["stable"]
        # Of any stable loop (Astrom and Murray).
        assert row["gain"] >= row["sensitivity"] / (row["sensitivity"] - 1) * (1 - 1e-3)
        assert row["delay"] * row["crossover"] <= np.radians(row["phase"]) * (1 + 1e-9)


def test_it_says_what_the_controller_knew(summary, outcome):
    assert summary["belief"] == BELIEFS["population"]
    assert summary["measures"] == ["position", "reservoir pressure"]
    assert 0 < summary["seconds_per_sample"] < 0.1
    # A PI remembers its integral alone; the rest of it is gains and what it believes.
    assert summary["sample"]["memory"] == 4  # the integral, and the last number of three sensors
    assert summary["sample"]["operations"] > 100
    assert "pi knows the middle of the population; it measures position, reservoir pressure" in outcome.out
    assert "note: turbine pressure acts on nothing" in outcome.out


def test_what_observes_nothing_has_nothing_to_slide(summary):
    assert summary["sliding"] is None


def test_it_warns_of_an_observer_that_does_not_slide(tmp_path):
    """Behind a fallback, which has no part in the names of gains; one sentence in terminal, summary and report."""
    path = write(tmp_path, "fallback = 'static-balance'", SWITCHING)
    outcome = run_command("control", path, "--out", tmp_path / "out")
    assert outcome.status == 0, outcome.err
    summary = read(tmp_path / "out" / "summary.json")
    found, sentence = summary["sliding"], summary["sliding"]["sentence"]
    assert (found["name"], found["gain"], found["slides"]) == ("observer.switching_gain", 0.5, False)
    assert 0 < found["share"] < 0.99
    assert found["case"] == "nominal, sine, 0 mbar"
    assert sentence.startswith("the observer does not slide: observer.switching_gain is 0.5 m/s2")
    assert summary["notes"][-1] == sentence
    assert f"warning: {sentence}" in outcome.out.replace("\n", " ")
    assert "the observer does not slide" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8").lower()


def test_it_says_which_gains_ran(summary, folder):
    controller = prepare_control(folder / "study.toml", None, None).controllers["sample 0"]
    names = ("proportional_gain", "integral_gain", "tracking_time")
    assert summary["gains"] == {name: float(getattr(controller, name)) for name in names}


def test_traces_are_what_figures_were_made_of(summary, folder):
    for number, loop in enumerate(summary["loops"], 1):
        (path,) = (folder / "out" / "traces").glob(f"{number:03d}_*")
        time, duty, _, position, reference = np.loadtxt(path, delimiter=",", skiprows=1).T
        error = (reference - position)[time >= 0.1]
        # Nine digits of millimetres.
        assert np.sqrt(np.mean(error**2)) == pytest.approx(loop["rms"], rel=1e-5)
        assert np.sqrt(np.mean(duty[time >= 0.1] ** 2)) == pytest.approx(loop["effort"], rel=1e-5)
    assert path.name == "012_sample_2_up_down_1000mbar.csv"


def error_cells(loops):
    """A row for every reference and turbine pressure: the middle and the worst of its plants."""
    for at in dict.fromkeys((loop["reference"], loop["turbine_pressure"]) for loop in loops):
        mine = [loop for loop in loops if (loop["reference"], loop["turbine_pressure"]) == at]
        rms, peak, effort, chatter = (
            np.array([loop[name] for loop in mine]) for name in ("rms", "peak", "effort", "chatter")
        )
        answered = [loop for loop in mine if loop["overshoot"] is not None]
        settling = max((loop["settling_time"] or np.inf for loop in answered), default=None)
        yield {
            "reference": at[0],
            "turbine, mbar": f"{at[1] / 100:g}",
            "plants": str(len(mine)),
            "RMS, median": um(np.median(rms)),
            "RMS, worst": um(rms.max()),
            "peak": um(peak.max()),
            "effort, %": shown(np.median(effort), 4),
            "chatter, %": shown(np.median(chatter), 3),
            "settling, ms": "" if settling is None else shown(1e3 * settling, 4).replace("inf", "never"),
            "overshoot, um": um(max((loop["overshoot"] for loop in answered), default=None)),
            "failed": "0",
        }


def test_a_report_shows_the_numbers_of_the_summary(summary, folder):
    text = (folder / "out" / "report.html").read_text(encoding="utf-8")
    page, worst = Page(text), summary["worst"]
    assert_shown(page.table("reference", "turbine, mbar"), error_cells(summary["loops"]))
    assert_shown(page.table("gain", "symbol"), ({"gain": n, "value": shown(v)} for n, v in summary["gains"].items()))
    assert_shown(page.table("plant", "rod"), margin_cells(summary))
    cards = {"RMS error, worst": f"{um(worst['rms'])} um", "peak error, worst": f"{um(worst['peak'])} um"}
    cards |= {"closed loops": "12", "failed": "0"}
    took = f"{shown(1e6 * summary['seconds_per_sample'], 3)} us"
    assert_cards(page, cards | {"time a sample takes": took, "seconds": shown(summary["wall_seconds"], 3)})
    assert target_words(summary) in page.text("p").replace("\n", "")
    for part in ("What the controller knew", BELIEFS["population"], "up &amp; down, 0 mbar"):
        assert part in text
    assert "<script src" not in text


def test_the_same_command_again_does_nothing(outcome, folder):
    again = run_command("control", folder / "study.toml", "--out", folder / "out")
    assert (again.status, "nothing to do" in again.out) == (0, True)


def test_other_gains_are_another_run(outcome, folder, tmp_path):
    other = run_command("control", folder / "study.toml", "--gains", write_gains(tmp_path), "--out", folder / "out")
    assert other.status == 2
    assert "holds the results of another study" in other.err


def test_gains_of_a_file_go_before_those_of_the_study(tmp_path):
    path = write(tmp_path, "gains = {proportional_gain = {value = 7000.0}, integral_gain = {value = 1000.0}}")
    gains = write_gains(tmp_path)
    for given in (gains, tmp_path):  # the file, or the folder of `tune`
        controller = prepare_control(path, None, given).controllers["sample 0"]
        assert float(controller.proportional_gain) == 9000.0
        assert float(controller.integral_gain) == 1000.0
        assert float(controller.tracking_time) == np.inf


def test_gains_for_another_actuator_are_named(tmp_path):
    """`tune` writes what its controller believes in: a note where that differs from what is believed here."""
    path = write(tmp_path)
    job = prepare_control(path, None, None)
    for change, notes in (({}, []), ({"diaphragm.stiffness": 11500.0}, ["diaphragm.stiffness"])):
        believed = vgtjax.replace_parameters(job.controllers["sample 0"].base, change)
        content = gains_json(job.study, list(job.gains), believed)
        (tmp_path / "gains.json").write_text(json.dumps(content), encoding="utf-8")
        found = [note for note in prepare_control(path, None, tmp_path).notes if "another actuator" in note]
        assert len(found) == len(notes)
        assert all(name in note for name, note in zip(notes, found, strict=True))


def test_a_value_without_an_end_is_no_other_one(tmp_path):
    """JSON has no infinity."""
    study = prepare_control(write(tmp_path), None, None).study
    endless = vgtjax.replace_parameters(vgtjax.Actuator(), {"diaphragm.travel": np.inf})
    write_json(tmp_path / "gains.json", gains_json(study, [], endless))
    assert note_on_plant(tmp_path, study, endless) is None
    assert "diaphragm.travel" in str(note_on_plant(tmp_path, study, vgtjax.Actuator()))


@pytest.mark.parametrize(
    ("belief", "stiffnesses"), [("printed", {12000.0}), ("population", {12500.0}), ("plant", None)]
)
def test_the_study_says_what_the_controller_knows(belief, stiffnesses, tmp_path):
    path = write(tmp_path, f'belief = "{belief}"', STUDY + '[parameters]\n"diaphragm.stiffness" = {{value = 12500.0}}')
    job = prepare_control(path, None, None)
    believed = {name: float(controller.base.diaphragm.stiffness) for name, controller in job.controllers.items()}
    if stiffnesses is None:
        cases = job.groups[0]
        plants = {label.plant: cases.plants.diaphragm.stiffness[i] for i, label in enumerate(cases.labels)}
        assert believed == pytest.approx(plants)
        assert len(set(believed.values())) == 3
    else:
        assert set(believed.values()) == stiffnesses
    assert job.belief == BELIEFS[belief]


def test_one_actuator_is_known_exactly_unless_the_study_says_otherwise(tmp_path):
    text = STUDY.replace("[population]\nvary", "[fit]\nfree")
    job = prepare_control(write(tmp_path, "", text), None, None)
    assert (job.belief, list(job.controllers)) == (BELIEFS["plant"], ["nominal"])


def test_a_tuned_controller_has_one_belief(tmp_path):
    path = write(tmp_path, 'belief = "plant"')
    with pytest.raises(vgtjax.InputError, match=r"must have one belief, but control\.belief is 'plant'; use"):
        prepare_tuning(path, None)
    printed = prepare_tuning(write(tmp_path, 'belief = "printed"'), None)
    assert float(printed.true.controller.base.diaphragm.stiffness) == 12000.0


def test_fitted_units_come_in_their_order():
    """All of them, or as many as the study asks for."""
    plant = vgtjax.Actuator()
    fitted = {f"unit_{i}": plant for i in range(4)}
    actuators = Actuators({}, plant, spread_population(plant), fitted, ())
    whole, some = (AnyStudy.validate_python({"control": table}) for table in ({}, {"plants": 2}))
    assert list(all_plants(whole, actuators)[0]) == list(fitted)
    assert list(all_plants(some, actuators)[0]) == ["unit_0", "unit_1"]
    assert belief_of(whole, actuators) == "population"


def test_runs_last_a_period_after_they_have_settled(tmp_path):
    assert cycle(PrintedReference(kind="signal-1")) == SIGNAL_1_PERIOD
    assert cycle(PrintedReference(kind="signal-2")) == 0.0
    assert cycle(SineReference(kind="sine", amplitude=1e-3, rate=0.5)) == pytest.approx(4 * np.pi)
    slow = STUDY.replace("rate = 24.0", "rate = 8.0")
    durations = [cases.duration for cases in prepare_control(write(tmp_path, "", slow), None, None).groups]
    assert durations == pytest.approx([2 * np.pi / 8.0 + 0.1, 0.5])


@pytest.mark.parametrize(
    ("change", "cause", "remedy"),
    [
        (
            ("rate = 24.0", "rate = 1e-7"),
            "a period of the reference 'sine' of rate 1e-07 rad/s makes it 6.28319e+07 s",
            "follow a faster one",
        ),
        (("duration = 0.5", "duration = 1e9"), "duration under [control] makes it 1e+09 s", "shorten it"),
    ],
)
def test_runs_that_no_memory_holds_are_refused(change, cause, remedy, tmp_path):
    path = write(tmp_path, "", STUDY.replace(*change))
    sentence = (
        f"study.toml: a run must have 4,000,000 samples at most, but {cause} long, with a sample every 0.002 s; "
        f"{remedy}, or lengthen period"
    )
    assert_refused(run_command("control", path, "--out", tmp_path / "out"), sentence, tmp_path / "out")


def test_settled_may_stand_among_the_costs(tmp_path):
    moved = STUDY.replace("settled = 0.1\n", "cost = {{settled = 0.1}}\n")
    assert prepare_control(write(tmp_path, "", moved), None, None).study.control.settled == 0.1
    sentence = "study.toml: settled must stand once, but it is under [control] and [control.cost]; drop one"
    outcome = run_command("control", write(tmp_path, "cost = {settled = 0.1}"), "--out", tmp_path / "out")
    assert_refused(outcome, sentence, tmp_path / "out")


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"design": "pid"},
            "gains.json: these are gains of the design 'pid', but the study's is 'pi'; give gains of the same design",
        ),
        (
            {"parameters": 1},
            "gains.json: these are no gains of a controller; give a gains.json that 'tune' wrote",
        ),
        (
            {"parameters": {"proportionl_gain": 1.0}},
            "gains.json: gain 'proportionl_gain' matches nothing; did you mean 'proportional_gain'?",
        ),
        (
            {"parameters": {"integral_gain": {"value": "much"}}},
            "gains.json: the gain 'integral_gain' must be a number, but it is 'much'; correct it",
        ),
        (
            {"parameters": {"tracking_time": {"valu": 3.0}}},
            "gains.json: the gain 'tracking_time' has no value; add it",
        ),
        (
            {"parameters": {"integral_gain": -1.0}},
            "gains.json: 'integral_gain' must be finite and not negative, but it is -1; correct it",
        ),
    ],
)
def test_bad_gains_get_one_sentence(changes, sentence, tmp_path):
    arguments = ("--gains", write_gains(tmp_path, **changes), "--out", tmp_path / "out")
    assert_refused(run_command("control", write(tmp_path), *arguments), sentence, tmp_path / "out")


def test_loops_that_fail_are_named_and_the_rest_is_kept(tmp_path, monkeypatch):
    monkeypatch.setitem(DESIGNS, "pi", Broken)
    outcome = run_command("control", write(tmp_path), "--out", tmp_path / "out")
    assert outcome.status == 1
    sentence = "12 closed loops fail, the first of them 'sample 0, sine, 0 mbar'; lower its gains. The simulation left"
    assert sentence in outcome.err
    assert {loop["rms"] for loop in read(tmp_path / "out" / "summary.json")["loops"]} == {None}
    assert (tmp_path / "out" / "report.html").exists()
