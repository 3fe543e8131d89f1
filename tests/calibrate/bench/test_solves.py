"""Solves of a controller that optimises: those that did not converge are counted and said."""

from calibrate.bench.solves import Solves


def test_solves_that_did_not_converge_are_counted():
    solves = Solves()
    ended = {"Solve_Succeeded": True, "Maximum_Iterations_Exceeded": False, "Solved_To_Acceptable_Level": True}
    for status, success in [*ended.items(), ("Infeasible_Problem_Detected", False)] * 300:
        solves.note({"return_status": status, "success": success, "iter_count": 3})
    assert solves.endings["Maximum_Iterations_Exceeded"] == 300
    assert solves.take() == "600 of 1,200 solves did not converge"
    assert solves.take() == "0 of 0 solves did not converge"
