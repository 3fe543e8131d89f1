"""A bad study ends a command before it writes anything, in one sentence."""

import re

import pytest
from bad_traces import text
from commands import assert_refused, run_command

TRACE = '[[trace]]\nfile = "bench.csv"\n'
TWO_UNITS = '[[trace]]\nfile = "bench.csv"\nunit = "a"\n[[trace]]\nfile = "bench.csv"\nname = "second"\n'
SENSOR = '[[report.sensor]]\nchannel = "x_d"\nuncertainty = {}\n'


def bad(rule: str, study: str, sentence: str, place: str = ""):
    """`place` is the table of the study that the library's argument at fault stands in."""
    return pytest.param(study, f"{sentence} (see {place} in the study)" if place else sentence, id=rule)


KEYS = [
    bad("at the top", f'naem = "a"\n{TRACE}', "unknown key 'naem'; did you mean 'name'?"),
    bad("a table", f'{TRACE}[component]\nline = "none"\n', "unknown key 'component'; did you mean 'components'?"),
    bad("a list of tables", '[[traces]]\nfile = "bench.csv"\n', "unknown key 'traces'; did you mean 'trace'?"),
    bad(
        "in components", f'{TRACE}[components]\nlien = "none"\n', "unknown key 'components.lien'; did you mean 'line'?"
    ),
    bad("in trace", f"{TRACE}windw = [0, 1]\n", "unknown key 'trace.windw'; did you mean 'window'?"),
    bad("instead of file", '[[trace]]\nfiel = "bench.csv"\n', "unknown key 'trace.fiel'; did you mean 'file'?"),
    bad("in fit", f'{TRACE}[fit]\nfre = ["chamber.*"]\n', "unknown key 'fit.fre'; did you mean 'free'?"),
    bad(
        "in parameters",
        f'{TRACE}[parameters]\n"chamber.volume" = {{vale = 1}}\n',
        "unknown key 'parameters.chamber.volume.vale'; did you mean 'value'?",
    ),
    bad(
        "no quotes",
        f"{TRACE}[parameters]\nchamber.volume = {{value = 6e-5}}\n",
        'a parameter\'s name must be in quotes; write "chamber.volume" = ...',
    ),
    bad(
        "no quotes around the name of a number",
        f"{TRACE}[parameters]\nchamber.volume = 6e-5\n",
        'a parameter\'s name must be in quotes; write "chamber.volume" = ...',
    ),
    bad(
        "no quotes in a population",
        f"{TRACE}[population.parameters]\nchamber.volume = {{relative = 0.02}}\n",
        'a parameter\'s name must be in quotes; write "chamber.volume" = ...',
    ),
    bad(
        "a table that is no parameter",
        f"{TRACE}[fit.unknown]\ngian = {{x_d = 1}}\n",
        "unknown key 'fit.unknown.gian'; did you mean 'gain'?",
    ),
]

VALUES = [
    bad(
        "two uncertainties of a sensor",
        f"{TRACE}{SENSOR.format(1e-6)}{SENSOR.format(2e-6)}",
        "[[report.sensor]] must have one uncertainty of x_d, but it has 1e-06 and 2e-06; state the one of the sensor "
        "that these traces are of",
    ),
    bad("name", f"name = 5\n{TRACE}", "name: Input should be a valid string, but it is 5; correct it"),
    bad(
        "model",
        f'model = "ful"\n{TRACE}',
        "model must be one of full, mechanical, plunger-map, static-map, but it is 'ful'; did you mean 'full'?",
    ),
    bad(
        "use",
        f'{TRACE}use = "valdate"\n',
        "trace.use must be one of fit, validate, but it is 'valdate'; did you mean 'validate'?",
    ),
    bad(
        "a text in place of true",
        f'{TRACE}[fit.unknown]\nduty_delay = "true"\n',
        "fit.unknown.duty_delay must be one of evidence, true, false, but it is 'true'; write true without quotes",
    ),
    bad(
        "two of them",
        f'{TRACE}[fit.unknown]\nduty_hold = 1\nnoise = "whit"\n',
        "fit.unknown.duty_hold must be one of evidence, false, but it is '1'; did you mean 'false'?",
    ),
    bad(
        "a window without end",
        f"{TRACE}window = [0]\n",
        "trace.window must have 2 values, but it is [0]; add what is missing",
    ),
    bad(
        "a window of three",
        f"{TRACE}window = [0, 1, 2]\n",
        "trace.window must have 2 values at most, but it is [0, 1, 2]; leave out the others",
    ),
    bad(
        "no such component",
        f'{TRACE}[components]\nfriction = "lugr"\n',
        "components.friction must be one of lugre, lugre-squared, lugre-passive, adaptive-lugre, dahl, karnopp, "
        "coulomb, but it is 'lugr'; did you mean 'lugre'?",
    ),
    bad("no traces", 'name = "a"\n', "a study needs at least one [[trace]], but it has none; add one with its file"),
    bad("an empty trace", "[[trace]]\n", "the key 'trace.file' is missing; add it"),
    bad(
        "one trace",
        '[trace]\nfile = "bench.csv"\n',
        "trace: Input should be a valid list, but it is {'file': 'bench.csv'}; correct it",
    ),
    bad(
        "window runs back",
        f"{TRACE}window = [2, 1]\n",
        "a window must end after it begins, but it is [2.0, 1.0]; swap the two",
    ),
    bad(
        "atmosphere in mbar",
        f"{TRACE}atmosphere = 1013\n",
        "trace.atmosphere: Input should be greater than or equal to 30000, but it is 1013; correct it",
    ),
    bad(
        "atmosphere without end",
        f"{TRACE}atmosphere = inf\n",
        "trace.atmosphere: Input should be less than or equal to 120000, but it is inf; correct it",
    ),
    bad(
        "one free name",
        f'{TRACE}[fit]\nfree = "chamber.volume"\n',
        "fit.free: Input should be a valid list, but it is 'chamber.volume'; correct it",
    ),
    bad(
        "a number in quotes",
        f'{TRACE}[parameters]\n"chamber.volume" = {{value = "6e-5"}}\n',
        "parameters.chamber.volume.value: Input should be a valid number, but it is '6e-5'; correct it",
    ),
    bad(
        "a bare number",
        f'{TRACE}[parameters]\n"chamber.volume" = 6e-5\n',
        "'parameters.chamber.volume' must be a table, but it is 6e-05; write e.g. {value = 6e-05}",
    ),
    bad(
        "a bare name of a channel",
        f'{TRACE}channels = {{p_act = "P"}}\n',
        "'trace.channels.p_act' must be a table, but it is 'P'; write e.g. {name = 'P'}",
    ),
    bad(
        "a bare limit",
        f"{TRACE}[tolerance]\nlimits = {{x = 5}}\n",
        "'tolerance.limits.x' must be a table, but it is 5; write e.g. {lower = 5}",
    ),
    bad("a text for a table", f'fit = "a"\n{TRACE}', "'fit' must be a table, but it is 'a'; give it keys, e.g. free"),
]

MODELS = [
    bad(
        "a table without order",
        f'{TRACE}[components]\nvane_force = "map"\n[parameters]\n"vane_force.crank_angle" = {{value = [4, 3]}}\n',
        "vane_force.crank_angle must be at least two knots that increase, in deg, but it is [4.0, 3.0]; sort them and "
        "remove repeated ones",
        "[parameters]",
    ),
    bad(
        "a table that one entry takes out of order",
        f'{TRACE}[components]\nvane_force = "map"\n[parameters]\n"vane_force.crank_angle[0]" = {{value = 40}}\n',
        "vane_force.crank_angle must be at least two knots that increase, in deg, but it is [40.0, 10.0, 16.0, 22.0, "
        "28.0, 34.0]; sort them and remove repeated ones",
        "[parameters]",
    ),
    bad(
        "a table of another size",
        f'{TRACE}[components]\nvane_force = "map"\n[parameters]\n"vane_force.closing" = {{value = [1, 2]}}\n',
        "'vane_force.closing' needs 12 numbers under value, but it has 2; give a list of 12",
        "[parameters]",
    ),
    bad(
        "a chamber that the diaphragm swallows",
        f'{TRACE}[parameters]\n"chamber.volume" = {{value = 2e-5}}\n',
        "'chamber.volume' must be larger than what the diaphragm sweeps, diaphragm.area times diaphragm.travel "
        "(2.96e-05 m3), but it is 2e-05 m3; enlarge it, or correct area or travel",
        "[parameters]",
    ),
    bad(
        "below its least value",
        f'{TRACE}[components]\nfriction = "lugre-passive"\n[parameters]\n"friction.excess_damping" = {{value = -1}}\n',
        "'friction.excess_damping' must be finite and not negative, but it is -1; correct it",
        "[parameters]",
    ),
]

NAMES = [
    bad(
        "free",
        f'{TRACE}[fit]\nfree = ["diaphragm.stifness"]\n',
        "parameter name or pattern 'diaphragm.stifness' matches nothing; did you mean 'diaphragm.stiffness'?",
        "[fit]",
    ),
    bad(
        "fixed",
        f'{TRACE}[fit]\nfixed = ["chamber.volum"]\n',
        "parameter name or pattern 'chamber.volum' matches nothing; did you mean 'chamber.volume'?",
        "[fit]",
    ),
    bad(
        "parameters",
        f'{TRACE}[parameters]\n"air.presure" = {{value = 1e5}}\n',
        "parameter name or pattern 'air.presure' matches nothing; did you mean 'air.pressure'?",
        "[parameters]",
    ),
    bad(
        "another model's",
        f'model = "mechanical"\n{TRACE}[fit]\nfree = ["diaphragm.volume"]\n',
        "parameter name or pattern 'diaphragm.volume' matches nothing; did you mean 'diaphragm.travel'?",
        "[fit]",
    ),
    bad(
        "a pattern for values",
        f'{TRACE}[parameters]\n"air.*" = {{value = 1e5}}\n',
        "start values and bounds have names, not patterns, but there is 'air.*'; write one line per parameter",
        "[parameters]",
    ),
    bad(
        "nothing free",
        f'{TRACE}[fit]\nfree = ["air.*"]\nfixed = ["air.*"]\n',
        "a fit needs at least one free parameter, but free and fixed leave none; free one",
        "[fit]",
    ),
]

START_VALUES = [
    bad(
        "below its bound",
        f'{TRACE}[parameters]\n"chamber.volume" = {{value = 5e-5, lower = 6e-5}}\n',
        "'chamber.volume' must be at least 6e-05, but it is 5e-05; change one",
        "[parameters]",
    ),
    bad(
        "printed value above its bound",
        f'{TRACE}[parameters]\n"chamber.volume" = {{upper = 5e-5}}\n',
        "'chamber.volume' must be at most 5e-05, but it is 6e-05; change one",
        "[parameters]",
    ),
    bad(
        "held and outside",
        f'{TRACE}[parameters]\n"diaphragm.area" = {{value = 1.0, lower = 2.0, upper = 3.0}}\n',
        "'diaphragm.area' must be at least 2, but it is 1; change one",
        "[parameters]",
    ),
    bad(
        "zero where only positive values have a logarithm",
        f'{TRACE}[parameters]\n"diaphragm.mass" = {{value = 0}}\n',
        "the start value of 'diaphragm.mass' must be positive to be fitted, but it is 0; change it, or hold it with "
        "fixed",
        "[parameters]",
    ),
    bad(
        "bounds that fall",
        f'{TRACE}[parameters]\n"chamber.volume" = {{lower = 2, upper = 1}}\n',
        "the bounds of 'chamber.volume' must rise, but they are 2 and 1; correct them",
        "[parameters]",
    ),
    bad(
        "a bound that leaves nothing",
        f'{TRACE}[parameters]\n"chamber.volume" = {{lower = -inf, upper = -inf}}\n',
        "the upper bound of 'chamber.volume' must leave it values, but it is -inf; leave it out",
        "[parameters]",
    ),
    bad(
        "negative",
        f'{TRACE}[parameters]\n"diaphragm.mass" = {{value = -1}}\n',
        "'diaphragm.mass' must be finite and not negative, but it is -1; correct it",
        "[parameters]",
    ),
    bad(
        "not a number",
        f'{TRACE}[parameters]\n"diaphragm.preload" = {{value = nan}}\n',
        "'diaphragm.preload' must be finite, but it is nan; correct it",
        "[parameters]",
    ),
    bad(
        "too few numbers",
        f'{TRACE}[parameters]\n"converter.magnetic_force" = {{value = [1, 2, 3]}}\n',
        "'converter.magnetic_force' needs 5 numbers under value, but it has 3; give a list of 5",
        "[parameters]",
    ),
    bad(
        "one bound for a vector",
        f'{TRACE}[parameters]\n"converter.magnetic_force" = {{lower = 0}}\n',
        "'converter.magnetic_force' needs 5 numbers under lower, but it has 1; give a list of 5",
        "[parameters]",
    ),
    bad(
        "a list for a number",
        f'{TRACE}[parameters]\n"diaphragm.mass" = {{value = [0.6]}}\n',
        "'diaphragm.mass' needs one number under value, but it has a list; give one number",
        "[parameters]",
    ),
]

TRACES = [
    bad(
        "a window beside the trace",
        f"{TRACE}window = [1, 2]\n",
        "bench: the window [1, 2] s must keep at least two samples of a trace that runs from 0 to 0.011 s; widen it",
    ),
    bad(
        "the same name twice",
        TRACE + TRACE,
        "the trace name 'bench' occurs twice (bench.csv and bench.csv); give one of them another name",
    ),
    bad(
        "with and without unit",
        TWO_UNITS,
        "either all traces have a unit or none has, but 'second' has none while others do; add unit to it",
    ),
    bad(
        "a unit that is a path",
        f'{TRACE}unit = "../a"\n',
        "the trace unit '../a' can't be a file name; use letters and digits",
    ),
    bad(
        "a unit with the name of a file of results",
        f'{TRACE}unit = "report.html"\n',
        "the unit 'report.html' has the name of a file of results; give it another one",
    ),
    bad("an empty name", f'{TRACE}name = ""\n', "the trace name '' can't be a file name; use letters and digits"),
    bad(
        "other braces",
        f'{TRACE}unit = "{{stm:7}}"\n',
        "only {stem} and e.g. {stem:7} may be in braces, but there is '{stm:7}'; correct it",
    ),
    bad("no trace to fit", f'{TRACE}use = "validate"\n', "a fit needs at least one trace with use = 'fit'; mark one"),
    bad(
        "no trace of a unit to fit",
        f'{TRACE}unit = "a"\nuse = "validate"\n',
        "a fit needs at least one trace of unit 'a' with use = 'fit'; mark one",
    ),
]


@pytest.mark.parametrize(("study", "sentence"), [*KEYS, *VALUES])
def test_the_study_says_something_that_is_no_study(folder, fit, study, sentence):
    (folder / "study.toml").write_text(study)
    assert_refused(fit(), f"study.toml: {sentence}", folder / "out")


@pytest.mark.parametrize(("study", "sentence"), [*MODELS, *NAMES, *START_VALUES, *TRACES])
def test_the_study_asks_for_what_does_not_exist(folder, fit, study, sentence):
    (folder / "study.toml").write_text(study)
    assert_refused(fit(), f"study.toml: {sentence}", folder / "out")


@pytest.mark.parametrize(("file", "nearest"), [("bnech.csv", "bench.csv"), ("other_*.csv", "bench.csv")])
def test_a_trace_file_that_is_not_there(folder, fit, file, nearest):
    (folder / "study.toml").write_text(f'[[trace]]\nfile = "{file}"\n')
    sentence = f"study.toml: trace file '{file}' matches nothing in {folder}; did you mean '{nearest}'?"
    assert_refused(fit(), sentence, folder / "out")


def test_a_glob_that_makes_a_name_twice(folder, fit):
    (folder / "other.csv").write_text(text())
    (folder / "study.toml").write_text('[[trace]]\nfile = "*.csv"\nname = "same"\n')
    sentence = "study.toml: the trace name 'same' occurs twice (bench.csv and other.csv); give one of them another name"
    assert_refused(fit(), sentence, folder / "out")


@pytest.mark.parametrize(
    ("content", "place"),
    [(b"name = \n", "line 1"), (b'name = "a"\nname = "b"\n', "line 2"), (b"name = '\xff'\n", "position 8")],
)
def test_broken_toml(folder, fit, content, place):
    (folder / "study.toml").write_bytes(content)
    outcome = fit()
    # What is wrong is said in Python's words, which change with its version.
    assert re.fullmatch(rf"error: study\.toml: this is not valid TOML \(.*{place}.*\); repair the file\n", outcome.err)
    assert_refused(outcome, outcome.err.removeprefix("error: ").rstrip(), folder / "out")


@pytest.mark.parametrize(("name", "reason"), [("no.toml", "No such file or directory"), (".", "Is a directory")])
def test_a_study_that_is_no_file(folder, name, reason):
    outcome = run_command("fit", folder / name, "--out", folder / "out")
    assert_refused(outcome, f"{folder / name}: the study can't be read ({reason}); check its path", folder / "out")
