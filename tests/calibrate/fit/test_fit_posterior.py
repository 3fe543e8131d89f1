"""A fit that draws from its posterior: what it writes, and that it goes on where it was ended."""

import sys

import numpy as np
import pytest
from commands import read, run_command

from calibrate.fit.posterior import LEAST
from vgtjax.assurance import CHAINS

DRAWS = LEAST * CHAINS
WARM_UP = 6
"""Draws of each chain, a fifth of the usual: the first guess of the step size is a good one."""


@pytest.fixture(scope="module")
def drawn(fitted, tmp_path_factory):
    """The small study with some draws, ended after its first ones and run again."""
    folder = tmp_path_factory.mktemp("posterior")
    for path in fitted.study.parent.glob("*.csv"):
        (folder / path.name).write_bytes(path.read_bytes())
    study = fitted.study.read_text().replace("[fit]", f"[fit]\nposterior = {DRAWS}\nprofiles = 'none'")
    (folder / "study.toml").write_text(study)
    with pytest.MonkeyPatch.context() as patch:
        for module in ("vgtjax.assurance._posterior", "calibrate.fit.posterior"):
            patch.setattr(f"{module}.WARM_UP", WARM_UP)
        with patch.context() as ended:
            ended.setattr("calibrate.fit.posterior._save", ended_after(5))
            first = run_command("fit", folder / "study.toml", "--out", folder / "out")
        assert "Aborted" in first.err
        return run_command("fit", folder / "study.toml", "--out", folder / "out"), folder / "out"


def ended_after(count):
    """What saves draws, until somebody presses Ctrl+C."""
    from calibrate.fit.posterior import _save

    def save(path, arrays):
        _save(path, arrays)
        if arrays["places"].shape[1] == count:
            raise KeyboardInterrupt

    return save


def test_it_goes_on_with_the_draws_that_are_there(drawn):
    outcome, _ = drawn
    assert outcome.status == 0, outcome.err
    assert f"resuming with 5 draws of each of {CHAINS} chains" in outcome.out


def test_all_draws_and_what_they_say_are_written(fitted, drawn):
    _, out = drawn
    summary, parameters = read(out / "summary.json"), read(out / "parameters.json")["parameters"]
    posterior = summary["posterior"]
    assert (posterior["chains"], posterior["draws"]) == (CHAINS, DRAWS)
    with np.load(out / "posterior.npz") as content:
        entries, draws = content["entries"].tolist(), content["draws"]
        assert content["places"].shape[1] == WARM_UP + LEAST
    assert draws.shape == (CHAINS, LEAST, len(entries))
    for number, entry in enumerate(entries):
        row = posterior["parameters"][entry]
        assert row["median"] == pytest.approx(np.median(draws[..., number]), rel=1e-12)
        assert row["interval"] == pytest.approx(np.quantile(draws[..., number], [0.025, 0.975]).tolist(), rel=1e-12)
        name, _, place = entry.partition("[")
        fields = {
            key: value[int(place[:-1])] if place else value
            for key, value in parameters[name].items()
            if key in ("value", "std_error")
        }
        # Sixteen draws of a standard normal deviate are within this but for one time in ten thousand.
        assert np.all(np.abs(draws[..., number] - fields["value"]) < 5 * fields["std_error"])
    report = (out / "report.html").read_text()
    assert "The posterior" in report
    assert posterior["verdict"] in report or posterior["verdict"][1:] in report
    assert read(fitted.out / "summary.json").get("posterior") is None


def test_without_the_package_nothing_is_begun(small, monkeypatch):
    monkeypatch.setitem(sys.modules, "blackjax", None)
    small.write_text(small.read_text().replace("[fit]", "[fit]\nposterior = 100"))
    outcome = run_command("fit", small, "--out", small.parent / "out")
    assert outcome.status == 2
    assert outcome.err == (
        f"error: {small.name}: draws from a posterior need the package blackjax, which is not installed; run "
        "pip install '.[posterior]' in a clone of vgtjax (see [fit] in the study)\n"
    )
    assert not (small.parent / "out").exists()
