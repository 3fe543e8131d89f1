"""Bad studies of populations, and bad options: one sentence, exit status 2, nothing written."""

import shutil

import pytest
from commands import assert_refused, run_command
from support import EXAMPLE

from calibrate.processes import join
from vgtjax import InputError

BAD = [
    (
        "name",
        '[population]\nvary = ["x.*"]',
        "parameter name or pattern 'x.*' matches nothing; did you mean 'air.pressure'?",
    ),
    ("key", "[population]\nvarry = []", "unknown key 'population.varry'; did you mean 'vary'?"),
    (
        "output",
        '[tolerance.limits]\n"hysteresis_0" = {upper = 3}',
        "[tolerance.limits] 'hysteresis_0' matches nothing; did you mean 'hysteresis_0mbar'?",
    ),
    (
        "no limit",
        '[tolerance.limits]\n"hysteresis_0mbar" = {}',
        "a limit needs a lower or an upper end, but it has none; write e.g. {upper = 30}",
    ),
    (
        "limit",
        '[tolerance.limits]\n"hysteresis_0mbar" = {lower = 3, upper = 2}',
        "the ends of a limit must rise, but they are 3 and 2; swap them",
    ),
    (
        "spread twice",
        '[population.parameters]\n"diaphragm.mass" = {relative = 0.1, deviation = 2}',
        "the spread of 'diaphragm.mass' must be either relative or a deviation, but it is both; drop one "
        "(see [population.parameters] in the study)",
    ),
    (
        "ends",
        '[population.parameters]\n"diaphragm.mass" = {distribution = "uniform", lower = 2, upper = 1}',
        "the ends of 'diaphragm.mass' must rise and not lie below 0, but they are 2 and 1; correct them or the spread "
        "(see [population.parameters] in the study)",
    ),
    (
        "outside",
        '[population.parameters]\n"diaphragm.mass" = {distribution = "uniform", relative = 1.5}',
        "the ends of 'diaphragm.mass' must rise and not lie below 0, but they are -0.315 and 1.575; correct them "
        "or the spread (see [population.parameters] in the study)",
    ),
    (
        "zero",
        '[population.parameters]\n"diaphragm.damping" = {relative = 0.1}',
        "'diaphragm.damping' is 0, so its spread can't be a part of it; state its deviation "
        "(see [population.parameters] in the study)",
    ),
    (
        "table",
        '[population.parameters]\n"diaphragm.mass" = 3',
        "'population.parameters.diaphragm.mass' must be a table, but it is 3; write e.g. {relative = 0.02}",
    ),
    (
        "sampler",
        '[tolerance]\nsampler = "sobo"',
        "tolerance.sampler must be one of sobol, latin-hypercube, but it is 'sobo'; did you mean 'sobol'?",
    ),
    (
        "duty",
        "[experiments]\nsteps = [120]",
        "steps need one or more different duties above 0 up to 100 %, but they are [120.0]; correct them",
    ),
    (
        "pressures",
        "[experiments]\nturbine_pressure = [3e5, 0]",
        "turbine pressures must be one or more and rise by millibars, but they are [300000.0, 0.0] Pa; sort them",
    ),
    (
        "not varied",
        '[[population.correlation]]\nparameters = ["diaphragm.mass", "air.pressure"]\nvalue = 0.3',
        "'air.pressure' has a correlation but does not vary; vary it too, or did you mean 'diaphragm.preload'? "
        "(see [[population.correlation]] in the study)",
    ),
    (
        "contradiction",
        '[[population.correlation]]\nparameters = ["diaphragm.mass", "chamber.volume", "diaphragm.area"]\nvalue = -0.9',
        "these correlations contradict each other (smallest eigenvalue -0.8, which must not be negative); weaken them",
    ),
    ("model", 'model = "mechanical"', "a population study needs model = 'full', but it is 'mechanical'; change it"),
    (
        "nothing",
        '[population]\nvary = ["diaphragm.damping"]',
        "a population needs a quantity that varies, but vary and fixed leave none; vary one "
        "(see [population] in the study)",
    ),
    (
        "limit without end",
        '[tolerance.limits]\n"hysteresis_0mbar" = {upper = inf}',
        "tolerance.limits.hysteresis_0mbar.upper: Input should be a finite number, but it is inf; correct it",
    ),
    (
        "nominal outside",
        '[population.parameters]\n"diaphragm.stiffness" = {lower = 20000}',
        "the nominal 'diaphragm.stiffness' must lie between the ends of its distribution, but 12000 is outside 20000 "
        "to inf; correct them, or the value (see [population.parameters] in the study)",
    ),
    (
        "fixed and spread",
        '[population]\nfixed = ["diaphragm.mass"]\n[population.parameters]\n"diaphragm.mass" = {relative = 0.1}',
        "'diaphragm.mass' can't be fixed and have a spread; drop one of the two (see [population] in the study)",
    ),
    (
        "correlated twice",
        "".join(
            f'[[population.correlation]]\nparameters = ["diaphragm.mass", "chamber.volume"]\nvalue = {value}\n'
            for value in (0.9, -0.9)
        ),
        "the correlation of 'chamber.volume' and 'diaphragm.mass' is stated twice, and differently; drop one "
        "(see [[population.correlation]] in the study)",
    ),
    (
        "correlated after nothing",
        "".join(
            f'[[population.correlation]]\nparameters = ["diaphragm.mass", "chamber.volume"]\nvalue = {value}\n'
            for value in (0.0, 0.5)
        ),
        "the correlation of 'chamber.volume' and 'diaphragm.mass' is stated twice, and differently; drop one "
        "(see [[population.correlation]] in the study)",
    ),
    (
        "units and spread",
        f'[components]\nvane_force = "speed-map"\n[population]\nrelative = 0.1\nunits = "{EXAMPLE}/fleet/units"',
        "a population of fitted units has their spread, but [population] states relative too; drop that, or give the "
        "parameters of one actuator",
    ),
    (
        "both",
        '[population]\nvary = ["converter.magnetic_force[2]", "converter.magnetic_force"]',
        "'converter.magnetic_force[2]' and the whole 'converter.magnetic_force' can't both vary; name one of them",
    ),
]


@pytest.mark.parametrize(("text", "sentence"), [pytest.param(*case[1:], id=case[0]) for case in BAD])
def test_bad_studies_are_refused_in_one_sentence(tmp_path, text, sentence):
    (tmp_path / "study.toml").write_text(text + "\n")
    outcome = run_command("tolerance", tmp_path / "study.toml", "--out", tmp_path / "out")
    assert_refused(outcome, f"study.toml: {sentence}", tmp_path / "out")


def test_units_that_do_not_differ_are_refused(tmp_path):
    for name in "abc":
        (tmp_path / "units" / name).mkdir(parents=True)
        shutil.copy(EXAMPLE / "fleet/units/unit_01/parameters.json", tmp_path / "units" / name)
    text = '[components]\nvane_force = "speed-map"\n[population]\nunits = "units"\n'
    (tmp_path / "study.toml").write_text(text)
    sentence = (
        "a population needs a quantity that its units determine and that spreads between them, but there is none; give "
        "other units, or tolerances (see [population] in the study)"
    )
    outcome = run_command("tolerance", tmp_path / "study.toml", "--out", tmp_path / "out")
    assert_refused(outcome, f"study.toml: {sentence}", tmp_path / "out")


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (
            ["--coordinator", "localhost:1"],
            "--coordinator, --processes and --process belong together, but some are missing; give all three",
        ),
        (
            ["--coordinator", "localhost:1", "--processes", "2", "--process", "2"],
            "--process must count from 0 to 1, but it is 2; correct it",
        ),
        (
            ["--coordinator", "localhost", "--processes", "2", "--process", "0"],
            "--coordinator must be HOST:PORT, but it is 'localhost'; write e.g. localhost:12345",
        ),
        (
            ["--coordinator", "localhost:1", "--processes", "0", "--process", "0"],
            "--processes must be one or more, but it is 0; correct it",
        ),
    ],
)
def test_bad_process_options_are_refused(options, sentence):
    values = dict(zip(options[::2], options[1::2], strict=True))
    count, index = (None if values.get(name) is None else int(values[name]) for name in ("--processes", "--process"))
    with pytest.raises(InputError) as raised:
        join(values["--coordinator"], count, index)
    assert str(raised.value) == sentence
