"""Benchmarks that start other processes, and count what they do."""

import collections

import pytest

import vgtjax
from calibrate.bench.cases.iterations import JACOBIANS, SIMULATIONS, counted
from calibrate.bench.cases.memory import BASES, RANKED, SIZES, STUDY
from calibrate.bench.cases.spreading import counts_to
from calibrate.bench.commands import run_together
from calibrate.bench.served import Served
from calibrate.population import prepare_population
from vgtjax.estimation import Evaluation


@pytest.mark.parametrize(("cores", "counts"), [(1, [1]), (2, [1, 2]), (6, [1, 2, 4, 6]), (8, [1, 2, 4, 8])])
def test_curves_end_at_the_number_of_cores(cores, counts):
    assert counts_to(cores) == counts


def test_a_process_sees_the_devices_that_it_is_given_and_runs_its_workload():
    with Served("forward", 3) as served:
        assert served.devices == 3
        # The first run compiles, which takes a hundred times as long as the run itself.
        assert served() > served() > 0


def test_a_process_that_has_no_such_workload_is_noticed():
    with Served("nothing", 1) as served, pytest.raises(RuntimeError, match="other settings of JAX died"):
        served()


def test_commands_run_together_and_one_that_fails_is_named(tmp_path):
    spent = run_together([["--help"], ["fit", "--help"]], tmp_path, 1)
    assert spent.wall > 0
    assert spent.cpu > 0
    with pytest.raises(RuntimeError, match=r"(?s)fitt ended with status 2: .*No such command"):
        run_together([["--help"], ["fitt"]], tmp_path, 1)


def test_what_a_fit_asks_for_is_counted_and_answered():
    model = vgtjax.Actuator()
    plain, selection = Evaluation(model, []), vgtjax.select(model)
    derived, delayed = Evaluation(model, [], selection=selection), Evaluation(model, [], selection=vgtjax.Selection(()))
    backwards = Evaluation(model, [], selection=selection, cotangent=[])
    questions = [[plain, plain, derived], [delayed, backwards]]

    def computation():
        first = yield questions[0]
        second = yield questions[1]
        return [first, second]

    asked = collections.Counter()
    counting = counted(computation(), asked)
    assert next(counting) is questions[0]
    assert counting.send("first") is questions[1]
    with pytest.raises(StopIteration) as end:
        counting.send("second")
    assert end.value.value == ["first", "second"]
    assert asked == {JACOBIANS: 1, SIMULATIONS: 4}


@pytest.mark.parametrize(("text", "size"), [(STUDY, SIZES[0]), (RANKED, BASES[0])])
def test_studies_of_growing_size_are_read(tmp_path, text, size):
    path = tmp_path / "study.toml"
    path.write_text(text.format(size=size), encoding="utf-8")
    study = prepare_population(path, None, levels=True).study
    assert size in (study.tolerance.samples, study.sensitivity.base)
