"""The benchmark of structures: its plant beside this package's models, and how its answers are counted."""

import json
import pathlib

import numpy as np
import pytest

import vgtjax
from calibrate.bench import structured_plant
from calibrate.bench.campaigns import FLEETS, record_fleet, record_structure, write_csv
from calibrate.bench.cases import structures
from calibrate.bench.cases.structures import (
    CAMPAIGNS,
    OPEN,
    RIGHT,
    SEEDS,
    WRONG,
    Campaign,
    measure,
    outcomes,
    tabulate,
)
from calibrate.bench.structured_plant import BAR, DECAY, FAR, Gas, Structure
from vgtjax.parts import OPERATING_POINTS, with_sharp_seat
from vgtjax.simulation import FixedStep

GAS = Gas(closing=2.9, opening=1.3, side_speed=4e-4, reversal_distance=5e-5)
PRESSURE = 2e5
"""Pa gauge."""
ANGLES = np.linspace(3.0, 37.0, 35)
"""deg; a table over them misses the exponential by 1 mN where the rod goes, which is 0.1 um."""
FRICTION = {"static_force": 5.0, "viscous_damping": 400.0}
"""N and N s/m: a Stribeck curve that is steep enough for its exponent to show."""
STEP, FINE = 1e-5, 5e-5
"""s, of the plant and of the model."""
INTERVAL = 0.01
"""s"""
SETTLED = 5
"""Samples; the model starts in balance without gas, and settles to the plant's balance by 0.6 um."""
STRUCTURES = (
    Structure("zero-order", 2, "none"),
    Structure("linear", 1, "map"),
    Structure("zero-order", 1, "speed-map"),
)


def model_of(structure: Structure) -> vgtjax.Actuator:
    """The actuator of this package with a structure, its seat as sharp as the plant's."""
    shape = PRESSURE / BAR * (FAR + (1 - FAR) * np.exp(-ANGLES / DECAY))
    tables = {
        "closing": np.tile(GAS.closing * shape, 2),
        "opening": np.tile(-GAS.opening * shape, 2),
        "turbine_pressure": np.array([PRESSURE, 2 * PRESSURE]),
        "crank_angle": ANGLES,
    }
    force: vgtjax.AbstractVaneForce = vgtjax.NoVaneForce()
    if structure.vane_force == "map":
        force = vgtjax.HysteresisMap(**tables, reversal_distance=GAS.reversal_distance)
    if structure.vane_force == "speed-map":
        force = vgtjax.SpeedMap(**tables, side_speed=GAS.side_speed)
    friction = vgtjax.LuGre(stribeck_exponent=structure.stribeck_exponent, **FRICTION)
    return with_sharp_seat(vgtjax.Actuator(vane_force=force, friction=friction))


def a_run(structure: Structure) -> vgtjax.Trace:
    """Up and down, over less than the travel; duty and supply change with every sample."""
    time = np.arange(0, 1.0, INTERVAL)
    pwm = np.interp(time, [0.05, 0.35, 0.5, 0.8], [0, 65, 64, 45])
    inputs = {"pwm": pwm, "p_res": 2e4 + 300 * np.sin(20 * time), "p_trb": np.full(len(time), PRESSURE)}
    return vgtjax.Trace(time, **inputs, duty_hold=structure.duty_hold)


def of_plant(structure: Structure, run: vgtjax.Trace) -> tuple[np.ndarray, np.ndarray]:
    unit = vgtjax.Actuator(friction=vgtjax.LuGre(**FRICTION))
    return structured_plant.simulate(unit, structure, GAS, (run.time, run.pwm, run.p_res), PRESSURE, STEP)


def others(structure: Structure) -> list[Structure]:
    """Those that differ in one thing."""
    hold, exponent, law = structure.duty_hold, structure.stribeck_exponent, structure.vane_force
    return [
        Structure("linear" if hold == "zero-order" else "zero-order", exponent, law),
        Structure(hold, 3 - exponent, law),
        *(Structure(hold, exponent, other) for other in ("none", "map", "speed-map") if other != law),
    ]


@pytest.mark.parametrize("structure", STRUCTURES, ids=str)
def test_the_plant_is_the_model_of_the_same_structure(structure):
    """And of no other: within 0.3 um (0.18 were measured, of which the table of the force takes 0.1), where what
    differs in one thing is at least 1 um away (4.4 were measured, of the exponent)."""
    run = a_run(structure)
    solution = vgtjax.simulate(model_of(structure), run, stepping=FixedStep(FINE))
    x_d, p_act = of_plant(structure, run)
    assert np.max(np.abs(np.asarray(solution.x_d) - x_d)[SETTLED:]) < 0.3e-6
    # The springs' 12 N/mm over the diaphragm's 29 cm2 make 1.2 Pa of 0.3 um; as much again for the orifice's jump.
    assert np.max(np.abs(np.asarray(solution.p_act) - p_act)[SETTLED:]) < 2.5
    for other in others(structure):
        assert np.max(np.abs(of_plant(other, run)[0] - x_d)[SETTLED:]) > 1e-6, other


def test_a_record_has_the_turbine_pressure_and_keeps_the_levels_whatever_its_rate(tmp_path):
    """Edges of the levels fall on samples of either record."""
    lively = {}
    for every in (1, 2):
        traces = record_structure(vgtjax.Actuator(), Structure(), (), every, np.random.default_rng(0))
        write_csv(traces[-1], tmp_path / f"{every}.csv")
        lively[every] = vgtjax.load_trace(tmp_path / f"{every}.csv")
        assert lively[every].longest_interval == pytest.approx(1e-3 * every)
        assert np.all(lively[every].p_trb == 0)
    np.testing.assert_array_equal(lively[1].pwm[::2], lively[2].pwm)


def test_the_campaigns_have_every_structure_once():
    made = {each.structure for each in CAMPAIGNS}
    assert len(made) == len(CAMPAIGNS) == 2 * 2 * 3


def said(structure: Structure, *, decided: bool, **wrong) -> dict:
    """What `compare` would write that chose this structure, but for what is `wrong`."""
    chosen = {**structures.truth_of(structure), **wrong}
    return {"chosen": chosen, "decided": dict.fromkeys(chosen, decided), "seconds": 1.0}


def test_what_is_wrong_counts_only_if_it_was_decided():
    made = Structure("linear", 2, "map")
    every = ("duty_hold", "stribeck_exponent", "vane_force", "friction")
    assert outcomes(made, said(made, decided=True)) == dict.fromkeys(every, RIGHT)
    assert outcomes(made, said(made, decided=False, vane_force="none")) == dict.fromkeys(every, OPEN)
    wrong = outcomes(made, said(made, decided=True, stribeck_exponent=1, friction="dahl"))
    assert wrong == {"duty_hold": RIGHT, "stribeck_exponent": WRONG, "vane_force": RIGHT, "friction": WRONG}


def test_the_table_counts_each_question():
    campaigns = [Campaign(Structure("linear", 1, "map"), (3e5,), 2)] * 3
    made = campaigns[0].structure
    answers = [
        said(made, decided=True),
        said(made, decided=True, vane_force="speed-map"),
        said(made, decided=False, duty_hold="zero-order"),
    ]
    section = tabulate(campaigns, answers)
    assert section.rows == [
        ("duty_hold", "2", "1", "0"),
        ("stribeck_exponent", "2", "1", "0"),
        ("vane_force", "1", "1", "1"),
        ("friction", "2", "1", "0"),
    ]
    assert "vane_force speed-map (decided, wrong)" in section.notes[1]


def test_finished_campaigns_are_not_compared_again(tmp_path, monkeypatch):
    made = Structure("zero-order", 2, "none")
    ran = []

    def compare(arguments, cache):
        ran.append(arguments[0])
        out = pathlib.Path(arguments[-1])
        out.mkdir()
        traces = {"table": [], "remains": [], "reasons": {}}
        (out / "summary.json").write_text(json.dumps({**said(made, decided=True), **traces}))
        return 2.0

    monkeypatch.setattr(structures, "run_command", compare)
    monkeypatch.setattr(structures, "CAMPAIGNS", (Campaign(made, (), 2),))
    first, second = (measure(tmp_path / "kept.json") for _ in range(2))
    assert ran == ["compare"] * len(SEEDS)
    assert first.rows == second.rows
    assert [row[1:] for row in first.rows] == [(str(len(SEEDS)), "0", "0")] * 4


def test_a_fleet_with_exhaust_gas_has_loops_of_one_gas_and_of_either_hold():
    held, linear = FLEETS[2:]
    loops = {each.duty_hold: record_fleet(vgtjax.Actuator(), np.random.default_rng(0), each) for each in (held, linear)}
    assert [float(loop.p_trb[0]) for loop in loops["linear"]] == list(OPERATING_POINTS)
    assert [loop.duty_hold for loop in loops["linear"]] == ["zero-order"] * 3  # which the record does not say
    for one, other in zip(loops["zero-order"], loops["linear"], strict=True):
        np.testing.assert_array_equal(one.pwm, other.pwm)
        apart = np.max(np.abs(one.x_d - other.x_d))
        assert 1e-6 < apart < 2e-4  # half a sample of a loop's 0.7 mm/s is 3.5 um, where the rod slips many times that
    closed = [float(np.max(loop.x_d)) for loop in loops["zero-order"]]
    assert np.ptp(closed) < 1e-4  # at 100 % the springs hold against any gas
