"""Any axis with friction through a study: mass, friction and constant force of a linear motor."""

import itertools
import pathlib

import numpy as np
import pytest
from commands import NOTHING_ELSE, read, run_command

import vgtjax
from vgtjax.estimation import plan_task, start_calibration
from vgtjax.identification.mechanical._axis import better_start
from vgtjax.identification.mechanical._axis_regression import regress_axis
from vgtjax.identification.mechanical._motion import read_motions

MASS, DAMPING, COULOMB, CONSTANT = 1.8, 14.0, 5.5, -1.2
TRUTH = {
    "diaphragm.mass": MASS,
    "friction.viscous_damping": DAMPING,
    "friction.coulomb_force": COULOMB,
    "diaphragm.preload": CONSTANT,
}
STUDY = """
model = "mechanical"

[components]
friction = "{friction}"

[[trace]]
file = "record_*.csv"

[fit]
free = ["diaphragm.mass", "friction.*", "diaphragm.preload"]
{fixed}

[parameters]
"diaphragm.stiffness" = {{value = 0}}
"diaphragm.travel" = {{value = inf}}
"""


def rate(force: float, velocity: float, way: float) -> float:
    """Acceleration in m/s2 of the axis that slides one way."""
    return (force - CONSTANT - DAMPING * velocity - way * COULOMB) / MASS


def advance(position: float, velocity: float, before: float, after: float, step: float) -> tuple[float, float]:
    """One step of an axis that sticks and slips, written without the product: Runge-Kutta, and rest as a state."""
    middle = 0.5 * (before + after)
    if velocity == 0.0:
        free = middle - CONSTANT
        if abs(free) <= COULOMB:
            return position, 0.0
        way = float(np.sign(free))
    else:
        way = float(np.sign(velocity))
    k1 = rate(before, velocity, way)
    k2 = rate(middle, velocity + 0.5 * step * k1, way)
    k3 = rate(middle, velocity + 0.5 * step * k2, way)
    k4 = rate(after, velocity + step * k3, way)
    new = velocity + step * (k1 + 2 * k2 + 2 * k3 + k4) / 6
    if new * way < 0:  # it comes to rest on the way
        return position + 0.5 * step * velocity**2 / (velocity - new), 0.0
    return position + 0.5 * step * (velocity + new), new


def record(seed: int, seconds: float, rest: float = 0.2) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time in s, force in N and noisy position in m: a controller follows reversing sines, steps and rests."""
    random = np.random.default_rng(seed)
    time = np.arange(0, seconds, 1e-3)
    sines = sum(
        a * np.sin(2 * np.pi * f * time + random.uniform(0, 6)) for f, a in ((0.21, 0.14), (0.9, 0.05), (2.7, 0.01))
    )
    wanted = (sines - sines[0]) * np.minimum(time / 2, 1)
    wanted = np.where(np.sin(2 * np.pi * time / 7) > 0.7, 0.1, wanted)
    force, position = np.zeros_like(time), np.zeros_like(time)
    x, v, substeps = 0.0, 0.0, 4
    for i in range(len(time) - 1):
        position[i] = x
        # The force of the next sample follows from this one: between samples it is linear, as traces are read.
        force[i + 1] = np.clip(700 * (wanted[i] - x) - 45 * v, -40, 40) if time[i] > rest else 0.0
        grid = np.linspace(force[i], force[i + 1], substeps + 1).tolist()
        for before, after in itertools.pairwise(grid):
            x, v = advance(x, v, before, after, 1e-3 / substeps)
    position[-1] = x
    return time, force, position + random.normal(0, 8e-6, len(time))


def write(path: pathlib.Path, columns: tuple[np.ndarray, ...]) -> None:
    header = "time [s],f_drive [N],x_d [m]"
    np.savetxt(path, np.stack(columns, axis=1), fmt="%.9g", delimiter=",", header=header, comments="")


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    """Two records of 25 s at 1 kHz, from which the axis moves to either side of where it began."""
    folder = tmp_path_factory.mktemp("records")
    for number in (1, 2):
        columns = record(number, 25.0)
        assert np.min(columns[2]) < -0.05
        assert np.max(columns[2]) > 0.05
        write(folder / f"record_{number}.csv", columns)
    return folder


def fit(
    folder: pathlib.Path,
    records: pathlib.Path,
    friction: str,
    fixed: str = "",
    seconds: float = 25.0,
    command: str = "fit",
    more: str = "",
):
    """Runs a study of the first seconds of the records, with `more` in it; the outcome, `parameters.json` and
    `summary.json`."""
    for source in sorted(records.glob("*.csv")):
        lines = source.read_text().splitlines()[: round(seconds * 1000) + 1]
        (folder / source.name).write_text("\n".join(lines) + "\n")
    (folder / "study.toml").write_text(STUDY.format(friction=friction, fixed=fixed) + more)
    out = folder / "out"
    outcome = run_command(command, folder / "study.toml", "--out", out)
    return outcome, read(out / "parameters.json")["parameters"], read(out / "summary.json")


def assert_recovered(found, share: float) -> None:
    for name, value in TRUTH.items():
        # The constant force is told as well as friction, beside which it acts.
        size = COULOMB if name == "diaphragm.preload" else value
        assert found[name]["value"] == pytest.approx(value, abs=share * size), name


def test_a_linear_motor_is_told_from_the_printed_actuator(tmp_path, records):
    """The start is a third of the mass, fifteen times the damping, and a constant force forty times too large."""
    outcome, found, summary = fit(tmp_path, records, "coulomb")
    assert (outcome.status, outcome.err) == (0, "")
    assert summary["converged"] is True
    assert_recovered(found, 0.005)
    assert found["diaphragm.mass"]["initial"] == 0.63  # what the study starts from, wherever the search begins
    assert found["diaphragm.preload"]["initial"] == 49.46
    assert "note: the search begins at what a regression of force and position tells" in outcome.out
    for trace in summary["traces"].values():
        assert trace["rmse"]["x_d"] < 1e-3


def test_identify_has_a_test_for_it(tmp_path, records):
    outcome, found, summary = fit(tmp_path, records, "coulomb", seconds=8.0, command="identify")
    assert (outcome.status, outcome.err) == (0, "")
    assert [section["name"] for section in summary["sections"]] == ["axis"]
    assert_recovered(found, 0.02)
    assert found["diaphragm.stiffness"]["value"] == 0.0
    assert "diaphragm.mass" in summary["identified"]


@pytest.mark.parametrize(
    ("friction", "fixed"), [("dahl", ""), ("lugre", 'fixed = ["friction.static_force", "friction.stribeck_velocity"]')]
)
def test_with_bristles_as_well(tmp_path, records, friction, fixed):
    outcome, found, summary = fit(tmp_path, records, friction, fixed, seconds=8.0, more=NOTHING_ELSE)
    assert outcome.status == 0, outcome.err
    assert summary["converged"] is True
    assert_recovered(found, 0.03)


# -- where the search begins -------------------------------------------------------------------------------------------


def plan(records, seconds=4.0, bounds=None, **values):
    """A fit of the first seconds of both records."""
    model = vgtjax.MechanicalActuator(friction=vgtjax.Coulomb())
    traces = [vgtjax.load_trace(path, travel=np.inf, needs=("f_drive",)) for path in sorted(records.glob("*.csv"))]
    rigid = {"diaphragm.stiffness": 0.0, "diaphragm.travel": np.inf}
    return plan_task(
        model,
        [trace.window(0.0, seconds) for trace in traces],
        free=["diaphragm.mass", "friction.*", "diaphragm.preload"],
        values=rigid | values,
        bounds=bounds,
        channels=("x_d",),
    )


def begun(task):
    """Where the search begins, in the units of the table."""
    begin = better_start(task)
    assert begin is not None
    transform = start_calibration(task).transform
    return dict(
        zip(task.selection.entries, np.asarray(transform.to_physical(np.asarray(begin.coordinates))), strict=True)
    )


def test_the_regression_alone_is_near(records):
    found = begun(plan(records))
    for name, value in TRUTH.items():
        assert found[name] == pytest.approx(value, abs=0.02 * (COULOMB if name == "diaphragm.preload" else value))


def test_what_is_held_counts_with_its_value(records):
    task = plan(records, **{"diaphragm.preload": CONSTANT, "friction.viscous_damping": DAMPING})
    free = ["diaphragm.mass", "friction.coulomb_force"]
    found = regress_axis(task.model, read_motions(task.model, task.fit), free)
    assert set(found) == set(free)
    assert found["diaphragm.mass"] == pytest.approx(MASS, rel=0.02)
    assert found["friction.coulomb_force"] == pytest.approx(COULOMB, rel=0.02)


def test_what_a_regression_can_not_tell_begins_at_its_start_value(records):
    task = plan(records, **TRUTH)
    assert regress_axis(task.model, read_motions(task.model, task.fit), ["diaphragm.travel"]) == {}


def test_bounds_hold_from_the_beginning(records):
    found = begun(plan(records, bounds={"diaphragm.mass": (0.1, 1.5)}))
    assert found["diaphragm.mass"] == pytest.approx(1.5)


def test_a_good_start_is_kept(records):
    assert better_start(plan(records, **TRUTH)) is None


def test_an_actuator_begins_at_its_start_values():
    time = np.arange(0, 0.5, 1e-3)
    trace = vgtjax.Trace(
        time=time, pwm=np.full_like(time, 50.0), p_act=np.full_like(time, 9e4), x_d=np.zeros_like(time)
    )
    for model in (vgtjax.Actuator(), vgtjax.MechanicalActuator()):
        assert better_start(plan_task(model, [trace], free=["diaphragm.mass"])) is None


def test_a_record_that_begins_in_motion_is_pointed_out(tmp_path, records):
    """A simulation begins at rest, whatever the record does."""
    for source in sorted(records.glob("*.csv")):
        lines = source.read_text().splitlines()
        position = np.array([float(line.split(",")[2]) for line in lines[1:6000]])
        fastest = 100 + int(np.argmax(np.abs(position[200:] - position[:-200])))
        (tmp_path / source.name).write_text("\n".join([lines[0], *lines[fastest : fastest + 4001]]) + "\n")
    (tmp_path / "study.toml").write_text(STUDY.format(friction="coulomb", fixed="") + NOTHING_ELSE)
    outcome = run_command("fit", tmp_path / "study.toml", "--out", tmp_path / "out")
    said = " ".join(outcome.out.split())
    assert "note: record_1: it begins at 0." in said
    assert "m/s, but a simulation begins at rest; a window from " in said
