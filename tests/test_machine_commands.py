"""The commands that take a machine."""

from ambkit import Record


def test_the_commands_take_a_machine(call):
    assert call("simulate", "tum_mlps", "--duration", "0.1 s", "--out", "run.csv").code == 0
    found = call("filter", "run.csv", "--machine", "tum_mlps", "--filter",
                 "extended+unbalance", "--out", "est.csv", "--json").json  # fmt: skip
    assert found["estimators"]["extended+unbalance"]["rmse"]["x"] < 1e-6
    assert "U1_x" in Record.load("est.csv")
    both = call("filter", "run.csv", "--machine", "tum_mlps", "--filter", "linear", "--filter",
                "closed-law", "--disturbance-noise", "auto 40 ms", "--smooth", "--out", "e.csv",
                "--plot", "e.png", "--json").json["estimators"]["linear"]  # fmt: skip
    assert both["smoothed"]["rmse"]["f_d_A1"] < both["rmse"]["f_d_A1"]
    assert both["prediction"]["1"]["La1"] < both["held"]["1"]["La1"]
    assert both["disturbance_noise"].keys() == both["disturbance_mean"].keys()
    assert "linear_smoothed_x" in Record.load("e.csv")
    told = call(
        "simulate", "hindawi_2011", "--disturbance", "5 N", "--duration", "0.1 s", "--json"
    ).json
    assert told["samples_at_the_stop"] == 0
    assert call("simulate", "tum_mlps", "--plot", "orbits.png", "--duration", "0.05 s").code == 0
    for refused, text in (
        (("simulate", "tum_mlps", "--plant", "map.csv"), "is the magnet of one axis"),
        (("simulate", "tum_mlps", "--filter", "observer"), "takes one axis"),
        (("simulate", "zittau_axial", "--filter", "linear+unbalance"), "a mass has runout at most"),
        (("filter", "run.csv", "--machine", "ufu_rig"), "the record has no y_A1"),
    ):
        done = call(*refused)
        assert (done.code, text in done.err) == (2, True), done.err
