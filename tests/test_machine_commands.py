"""The commands that take a machine."""

from __future__ import annotations

from typing import Any

from ambkit import Record


def test_the_commands_take_a_machine(call: Any) -> None:
    assert call("simulate", "tum_mlps", "--duration", "0.1 s", "--out", "run.csv").code == 0
    found = call("filter", "run.csv", "--bearing", "tum_mlps", "--estimator", "extended",
                 "--synchronous", "unbalance", "--out", "est.csv", "--json").json  # fmt: skip
    assert found["estimators"]["extended"]["rmse"]["x"] < 1e-6
    assert "U1_x" in Record.load("est.csv")
    both = call("filter", "run.csv", "--bearing", "tum_mlps", "--estimator", "linear,closed-law",
                "--tune", "40 ms", "--smooth", "--out", "e.csv", "--plot", "e.png",
                "--json").json["estimators"]["linear"]  # fmt: skip
    assert both["smoothed"]["rmse"]["f_d_A1"] < both["rmse"]["f_d_A1"]
    assert both["prediction"]["1"]["La1"] < both["held"]["1"]["La1"]
    assert both["disturbance_noise"].keys() == both["disturbance_mean"].keys()
    assert "linear_smoothed_x" in Record.load("e.csv")
    told = call("simulate", "hindawi_2011", "--load", "5 N", "--duration", "0.1 s", "--json").json
    assert told["samples_at_the_stop"] == 0
    assert call("simulate", "tum_mlps", "--plot", "orbits.png", "--duration", "0.05 s").code == 0
    for refused, text in (
        (("simulate", "tum_mlps", "--force-map", "map.csv"), "is of one axis"),
        (("simulate", "tum_mlps", "--estimator", "observer"), "takes one axis"),
        (("simulate", "zittau_axial", "--synchronous", "runout"), "is a mass"),
        (("filter", "run.csv", "--bearing", "ufu_rig"), "the record has no y_A1"),
    ):
        done = call(*refused)
        assert (done.code, text in done.err) == (2, True), done.err
