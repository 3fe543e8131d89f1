"""A fit of traces as a logger wrote them."""

import asammdf
import numpy as np
from commands import read, run_command


def test_a_fit_of_mdf_files_is_that_of_the_same_csv(fitted, tmp_path):
    for name in ("step_80", "step_50"):
        header, *rows = (fitted.study.parent / f"{name}.csv").read_text().splitlines()
        time, *columns = np.array([[float(cell) for cell in row.split(",")] for row in rows]).T
        names = [cell.rstrip("]").split(" [") for cell in header.split(",")[1:]]
        assert header.startswith("time [s],")
        with asammdf.MDF(version="4.10") as file:
            signals = [
                asammdf.Signal(values, time, name=f"{channel}_raw", unit=unit.split(" ")[0])
                for (channel, unit), values in zip(names, columns, strict=True)
            ]
            file.append(signals)
            file.save(tmp_path / f"{name}.mf4")
    channels = "".join(f'[channels.{channel}]\nname = "{channel}_raw"\nunit = "{unit}"\n' for channel, unit in names)
    study = fitted.study.read_text().replace(".csv", ".mf4") + channels
    (tmp_path / "study.toml").write_text(study)
    outcome = run_command("fit", tmp_path / "study.toml", "--out", tmp_path / "out")
    assert (outcome.status, outcome.err) == (0, "")
    assert (tmp_path / "out" / "report.html").is_file()
    mine, other = (read(out / "parameters.json")["parameters"] for out in (tmp_path / "out", fitted.out))
    assert mine == other  # the same bits in, the same bits out
