"""The command `tolerance` as a user runs it, on a small population."""

import json
import pathlib

import numpy as np
import pytest
from commands import assert_refused, read, run_command
from population_study import STUDY, write_study
from support import EXAMPLE

import vgtjax
from calibrate.population import ChunkStore, prepare_population
from vgtjax.population import run


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> tuple[pathlib.Path, str]:
    """The folder of a finished run, in the folder of its study, and what the terminal said."""
    folder = tmp_path_factory.mktemp("tolerance")
    outcome = run_command("tolerance", write_study(folder), "--out", folder / "out")
    assert outcome.status == 0, outcome.err
    return folder / "out", outcome.out


@pytest.fixture(scope="module")
def done(finished) -> pathlib.Path:
    return finished[0]


@pytest.fixture(scope="module")
def summary(done) -> dict:
    return read(done / "summary.json")


@pytest.fixture(scope="module")
def samples(done) -> dict[str, np.ndarray]:
    return dict(np.load(done / "samples.npz"))


def test_a_run_writes_its_three_files_and_no_more(done):
    assert {path.name for path in done.iterdir()} == {".study.json", "summary.json", "samples.npz", "report.html"}


def test_the_terminal_says_how_outputs_spread_and_how_many_keep_their_limits(finished, summary):
    lines = [line.split() for line in finished[1].splitlines()]
    for name, found in summary["outputs"].items():
        (row,) = [words for words in lines if words[:1] == [name]]
        figures = (found["nominal"], found["mean"], found["deviation"], found["quantiles"]["0.95"])
        assert row[1:6] == [found["unit"], *(f"{figure:.4g}" for figure in figures)]
        assert (row[7:8] == ["%"]) == ("yield" in found)
    assert f"all limits are kept by {100 * summary['yield']['share']:.1f} %" in finished[1]


def test_widths_of_the_units_are_those_of_their_traces(summary, done):
    """Against a reading of our own: mean pressure in bins of position, opening less closing."""
    for name in ("0", "1500", "3000"):
        trace = vgtjax.load_trace(done.parent / f"unit_01_{int(name):04d}mbar.csv")
        top = int(np.argmax(trace.x_d))
        edges = np.linspace(2e-3, 8e-3, 13)

        def mean(part, trace=trace, edges=edges):
            place = np.digitize(trace.x_d[part], edges)
            return np.array([trace.p_act[part][place == number].mean() for number in range(1, 13)])

        width = np.mean(mean(slice(top, None)) - mean(slice(0, top))) / 100
        # Bins are centred where the samples happen to lie: tens of micrometres of 4 Pa/um off.
        assert summary["units"]["unit_01"]["hysteresis_mbar"][name] == pytest.approx(width, abs=0.5)


def test_summary_is_that_of_the_samples(summary, samples):
    names, good = samples["output_names"].tolist(), np.isfinite(samples["outputs"]).all(axis=1)
    assert good.all()
    for name, found in summary["outputs"].items():
        column = samples["outputs"][:, names.index(name)]
        assert found["unit"] == samples["output_units"][names.index(name)]
        assert found["mean"] == pytest.approx(column.mean(), rel=1e-12)
        assert found["quantiles"]["0.95"] == pytest.approx(np.quantile(column, 0.95), rel=1e-12)
    width, error = (samples["outputs"][:, names.index(name)] for name in ("hysteresis_0mbar", "steady_error_50"))
    meets = (width <= 33.0) & (np.abs(error) <= 0.2)
    assert 0 < meets.mean() < 1, "limits that all or none keep show nothing"
    assert summary["yield"]["share"] == meets.mean()
    assert summary["yield"]["low"] < meets.mean() < summary["yield"]["high"]
    assert summary["outputs"]["hysteresis_0mbar"]["yield"]["share"] == np.mean(width <= 33.0)


def test_envelopes_are_quantiles_of_the_curves(summary, samples):
    found = summary["envelopes"]["closing_pressure_0mbar"]
    assert (found["unit"], found["axis_unit"]) == ("mbar", "mm")
    assert found["axis"] == pytest.approx(np.linspace(2, 8, 25), rel=1e-12)
    expected = np.quantile(samples["closing_pressure_0mbar"], 0.95, axis=0)
    assert found["quantiles"]["0.95"] == pytest.approx(expected, rel=1e-12)


def test_fitted_units_are_the_population(tmp_path):
    """Units of a fit given by --parameters: their geometric mean is the nominal actuator, each is simulated itself."""
    study = tmp_path / "study.toml"
    study.write_text(
        '[components]\nvane_force = "speed-map"\n'
        "[experiments]\nturbine_pressure = [0, 3e5]\nloop_seconds = 4\nsteps = []\n[tolerance]\nsamples = 8\n"
    )
    units = EXAMPLE / "fleet" / "units"
    outcome = run_command("tolerance", study, "--parameters", units, "--out", tmp_path / "out")
    assert outcome.status == 0, outcome.err
    found = read(tmp_path / "out" / "summary.json")
    assert len(found["simulated_units"]) == 20
    stiffness = [
        read(units / name / "parameters.json")["parameters"]["diaphragm.stiffness"]["value"]
        for name in found["simulated_units"]
    ]
    quantity = found["quantities"]["diaphragm.stiffness"]
    # Each weighs by its error as well, which is a thousandth of the spread.
    assert quantity["nominal"] == pytest.approx(np.exp(np.mean(np.log(stiffness))), rel=1e-6)
    # A lognormal's deviation against that of the units: equal to second order in its 4 %.
    assert quantity["deviation"] == pytest.approx(np.std(stiffness, ddof=1), rel=0.01)
    widths = [unit["hysteresis_3000mbar"] for unit in found["simulated_units"].values()]
    plain = [unit["hysteresis_0mbar"] for unit in found["simulated_units"].values()]
    assert np.all(np.array(widths) > np.array(plain) + 5), "gas widens the loop of every unit"
    # What no unit determines is no quantity of the population, and still a value of each unit.
    entry = "friction.coulomb_force"
    for name in list(found["simulated_units"])[:3]:
        fitted = read(units / name / "parameters.json")
        place, matrix = fitted["covariance"]["entries"].index(entry), fitted["covariance"]["matrix"]
        for row in matrix:
            row[place] = None
        matrix[place] = [None] * len(matrix)
        (tmp_path / "units" / name).mkdir(parents=True)
        (tmp_path / "units" / name / "parameters.json").write_text(json.dumps(fitted))
    outcome = run_command("tolerance", study, "--parameters", tmp_path / "units", "--out", tmp_path / "again")
    assert outcome.status == 0, outcome.err
    again = read(tmp_path / "again" / "summary.json")
    assert entry in found["quantities"]
    assert entry not in again["quantities"]
    for name, unit in again["simulated_units"].items():
        alone = {output: value for output, value in found["simulated_units"][name].items() if value is not None}
        # The same simulations beside others, but for rounding.
        assert {output: unit[output] for output in alone} == pytest.approx(alone, rel=1e-9), name


def test_samples_are_those_of_the_stated_distributions(samples):
    quantities = samples["quantities"].tolist()
    assert quantities == [
        "converter.magnetic_force",
        "chamber.volume",
        "diaphragm.stiffness",
        "friction.coulomb_force",
    ]
    assert samples["quantity_units"].tolist() == ["1", "m3", "N/m", "N"]
    values = dict(zip(quantities, samples["values"].T, strict=True))
    assert 4e-5 < values["chamber.volume"].min() < values["chamber.volume"].max() < 8e-5
    # Two dozen quasi-random points: the standard deviation of 2 % is met to a few parts in ten.
    assert values["converter.magnetic_force"].std() == pytest.approx(0.02, rel=0.3)
    assert np.corrcoef(values["diaphragm.stiffness"], values["friction.coulomb_force"])[0, 1] > 0.4


def test_a_row_of_the_file_is_the_simulation_of_its_values(samples, done):
    job = prepare_population(done.parent / "study.toml", None, levels=False)
    model = job.population.factors.unpack(job.population.model, samples["values"][5])
    trace = job.experiments[1].traces[0]
    solution = vgtjax.simulate(model, trace)
    time = samples["axis_step_position_50"]
    expected = np.interp(time, trace.time - 0.1, solution.x_d)
    # The lanes of a batch and a single simulation are compiled apart, so they round apart.
    np.testing.assert_allclose(samples["step_position_50"][5], expected * 1e3, atol=1e-9)


def test_interrupted_run_goes_on_and_ends_the_same(done, tmp_path, monkeypatch):
    study, saved = write_study(tmp_path), []

    def save(self, number, results, original=ChunkStore.save):
        if len(saved) == 2:
            raise OSError(28, "No space left on device", "chunk")
        saved.append(number)
        original(self, number, results)

    with monkeypatch.context() as patched:
        patched.setattr(ChunkStore, "save", save)
        outcome = run_command("tolerance", study, "--out", tmp_path / "out")
    assert outcome.status == 1
    assert outcome.err == "failed: chunk can't be written (No space left on device); make room\n"
    assert not (tmp_path / "out" / "report.html").exists()
    outcome = run_command("tolerance", study, "--out", tmp_path / "out")
    assert outcome.status == 0
    assert "resuming with 2 of 3 chunks done" in outcome.out
    assert_same_samples(tmp_path / "out", done, tolerance=0.0)


def assert_same_samples(one: pathlib.Path, other: pathlib.Path, tolerance: float) -> None:
    """The same samples bit for bit, and the same outputs to a part of their size."""
    mine, yours = np.load(one / "samples.npz"), np.load(other / "samples.npz")
    assert mine.files == yours.files
    for name in mine.files:
        if mine[name].dtype.kind != "f" or name == "values":
            np.testing.assert_array_equal(mine[name], yours[name])
        else:
            np.testing.assert_allclose(mine[name], yours[name], rtol=0, atol=tolerance * np.abs(yours[name]).max())


def test_second_run_does_nothing_and_another_study_is_refused(done):
    before = {path.name: path.stat().st_mtime_ns for path in done.iterdir()}
    again = run_command("tolerance", done.parent / "study.toml", "--out", done)
    assert again.status == 0
    assert again.out.startswith("nothing to do: ")
    assert {path.name: path.stat().st_mtime_ns for path in done.iterdir()} == before
    other = done.parent / "other.toml"
    other.write_text(STUDY.replace("samples = 24", "samples = 16"))
    refused = run_command("tolerance", other, "--out", done)
    assert refused.status == 2
    assert "holds the results of another study" in refused.err


def test_chunks_do_not_change_the_numbers(done, tmp_path):
    study = write_study(tmp_path, STUDY.replace("lanes = 8", "lanes = 24"))
    assert run_command("tolerance", study, "--out", tmp_path / "out").status == 0
    assert_same_samples(tmp_path / "out", done, tolerance=1e-9)  # what was promised


def test_bad_samples_are_counted_and_named_and_touch_no_other(done, tmp_path):
    """Chambers that the diaphragm would swallow are not physical, whether or not a rod gets that far."""
    study = write_study(tmp_path, STUDY.replace("lower = 4e-5, upper = 8e-5", "lower = 2.0e-5, upper = 6e-5"))
    assert run_command("tolerance", study, "--out", tmp_path / "out").status == 0
    found, samples = read(tmp_path / "out" / "summary.json"), np.load(tmp_path / "out" / "samples.npz")
    failed = samples["failed"].tolist()
    assert 0 < len(failed) < 24
    assert found["failed"]["count"] == len(failed)
    assert [sample["sample"] for sample in found["failed"]["samples"]] == failed
    volume = samples["values"][:, samples["quantities"].tolist().index("chamber.volume")]
    swept = 2.9224e-3 * 10.13e-3
    assert failed == np.flatnonzero(volume <= swept).tolist()
    assert found["unphysical"] == {"count": len(failed)}
    for sample in found["failed"]["samples"]:
        assert sample["cause"] == "unphysical"
        assert sample["values"]["chamber.volume"] == volume[sample["sample"]]
    good = np.setdiff1d(np.arange(24), failed)
    assert np.isnan(samples["outputs"][failed]).all()
    assert np.isfinite(samples["outputs"][good]).all()
    assert found["outputs"]["hysteresis_0mbar"]["defined"] == len(good)
    report = (tmp_path / "out" / "report.html").read_text()
    assert f'failed simulations<b class="bad">{len(failed)}' in report
    assert f'<td>{failed[0]}</td><td class="text">unphysical</td>' in report
    assert f"{len(failed)} of the failed samples are not physical: as drawn, the diaphragm sweeps more" in report


SMALL_CHAMBERS = STUDY.replace("lower = 4e-5, upper = 8e-5", "lower = 1e-5, upper = 2.961e-5") + (
    '[parameters]\n"chamber.volume" = {value = 2.961e-5}\n'
)
"""Smaller than the 2.9604e-5 m3 that the diaphragm sweeps, but for the nominal one at the end."""


@pytest.mark.parametrize("command", ["tolerance", "sensitivity"])
def test_a_study_whose_every_sample_fails_says_so_each_time(tmp_path, command):
    study = write_study(tmp_path, SMALL_CHAMBERS.replace("steps = [50]", "steps = []"))
    study.write_text(study.read_text().replace('"steady_error_50" = {lower = -0.2, upper = 0.2}', ""))
    sentences = {
        "tolerance": "failed: every sample's simulation failed; narrow the tolerances, or check the nominal values\n",
        "sensitivity": "failed: too many simulations failed for any index; narrow the spreads, or raise base under "
        "[sensitivity]\n",
    }
    for _ in range(2):  # the second time the results are there already
        outcome = run_command(command, study, "--out", tmp_path / "out")
        assert (outcome.status, outcome.err) == (1, sentences[command])
        assert read(tmp_path / "out" / "summary.json")["failed"]["count"] > 0


def test_a_nominal_actuator_that_fails_is_named_before_anything_is_written(tmp_path):
    study = write_study(tmp_path, STUDY + '[parameters]\n"converter.plunger_mass" = {value = 0}\n')
    outcome = run_command("tolerance", study, "--out", tmp_path / "out")
    sentence = "the nominal actuator's step to 50 % failed: The simulation left the finite numbers: "
    sentence += "check that the parameters are physical, then lower max_step."
    assert (outcome.status, outcome.err) == (1, f"failed: {sentence}\n")
    assert not (tmp_path / "out").exists()


CONTROL = """
[control]
design = "pi"
[[control.reference]]
kind = "sine"
amplitude = 0.001
rate = 12.0
offset = 0.005
"""


@pytest.mark.parametrize("command", ["tolerance", "sensitivity", "tune"])
def test_a_nominal_actuator_that_is_not_physical_is_refused(tmp_path, command):
    study = tmp_path / "study.toml"
    study.write_text('[parameters]\n"diaphragm.travel" = {value = 25e-3}\n' + CONTROL)
    sentence = (
        "study.toml: 'chamber.volume' must be larger than what the diaphragm sweeps, diaphragm.area times "
        "diaphragm.travel (7.306e-05 m3), but it is 6e-05 m3; enlarge it, or correct area or "
        "travel (see [parameters] in the study)"
    )
    assert_refused(run_command(command, study, "--out", tmp_path / "out"), sentence, tmp_path / "out")


def test_latin_hypercube_in_single_precision(done, tmp_path):
    text = STUDY.replace("lanes = 8", 'lanes = 24\nsampler = "latin-hypercube"\nprecision = "single"')
    assert run_command("tolerance", write_study(tmp_path, text), "--out", tmp_path / "out").status == 0
    mine, yours = read(tmp_path / "out" / "summary.json"), read(done / "summary.json")
    volumes = np.load(tmp_path / "out" / "samples.npz")["values"][:, 1]
    assert sorted(np.floor((volumes - 4e-5) / 4e-5 * 24).astype(int)) == list(range(24)), "one sample a stratum"
    for name, unit in (("hysteresis_0mbar", "mbar"), ("response_time_63_50", "ms")):
        nominal = yours["outputs"][name]["nominal"]
        # Single precision: 25 Pa and 2 um were promised; the nominal actuator's width and times move far less.
        assert mine["outputs"][name] == mine["outputs"][name] | {"unit": unit}
        assert mine["outputs"][name]["nominal"] == pytest.approx(nominal, rel=2e-3)


def test_nominal_actuator_comes_from_parameters(done, tmp_path):
    study = write_study(tmp_path, STUDY.replace("samples = 24", "samples = 8"))
    stiff = {"model": "full", "parameters": {"diaphragm.preload": {"value": 60.0}}}
    (tmp_path / "parameters.json").write_text(json.dumps(stiff))
    arguments = ("--parameters", tmp_path / "parameters.json", "--out", tmp_path / "out")
    assert run_command("tolerance", study, *arguments).status == 0
    mine = read(tmp_path / "out" / "summary.json")["outputs"]["start_pressure_0mbar"]["nominal"]
    yours = read(done / "summary.json")["outputs"]["start_pressure_0mbar"]["nominal"]
    area = float(vgtjax.Actuator().diaphragm.area)
    # The preload alone moves the start; rate-dependent friction changes by less than a millibar.
    assert mine - yours == pytest.approx(-(60.0 - 49.46) / area / 100, abs=0.5)


def test_the_library_gives_what_the_command_gives(samples, done):
    """To the bit: the same population, samples and experiments."""
    job = prepare_population(done.parent / "study.toml", None, levels=False)
    results = run(job.population, job.experiments, samples=24, lanes=8)
    factor = {"Pa": 1e-2, "s": 1e3, "m": 1e3}
    names = samples["output_names"].tolist()
    for output in results.outputs:
        column = samples[output.name] if output.axis else samples["outputs"][:, names.index(output.name)]
        np.testing.assert_array_equal(results[output.name] * factor[output.unit], column)
