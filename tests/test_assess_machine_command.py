"""``ambkit assess`` of a machine."""

import pytest
from machine_cases import injected

from ambkit.assessment.assess import MEASUREMENT


@pytest.mark.parametrize(("arguments", "said"), [
    (["ufu_rig", "--verbose"], "Each axis with all other loops closed"),
    pytest.param(
        ["speed", "ufu_rig", "--filter", "none", "--fastest", "3000 rpm"], "to 3000 rpm",
        marks=pytest.mark.long,
    ),
    (["sweep", "ufu_rig", "--filter", "none", "--amplitudes", "1 um", "--axis", "A1"],
     "ufu_rig A1"),
])  # fmt: skip
def test_command(call, tmp_path, arguments, said):
    done = call("assess", *arguments, "--plot", "p.png")
    assert done.code == 0, done.err
    assert said in done.out
    assert (tmp_path / "p.png").is_file()


def test_command_takes_a_machines_log(call):
    _, record = injected(0)
    record.save("log.csv")
    found = call(
        "assess", "log", "log.csv", "--machine", "ufu_rig", "--filter", "none", "--json"
    ).json
    assert found["zone"] == "A"
    assert list(found["models"]) == [MEASUREMENT]


@pytest.mark.parametrize(("arguments", "message"), [
    (["ufu_rig", "--position", "1 m"], "can be held up to its stops"),
    (["ufu_rig", "--filter", "observer"], "takes one axis"),
    (["ufu_rig", "--axis", "A1"], "there is no option --axis"),
    (["ufu_rig", "--fliter", "linear"], "did you mean --filter?"),
    (["ufu_rig", "--position", "0", "--position", "0"], "--position is given more than once"),
    (["ufu_rig", "--plot", "nowhere/p.png"], "there is no folder nowhere"),
    (["ufu_rig", "--out", "p.txt"], "--out: p.txt must end with .json or .csv or .tex or .html"),
    (["speed", "ufu_rig", "--filter", "ud", "--filter", "ud"], "--filter is given more than once"),
    (["speed", "zittau_axial"], "does not turn: its rotor moves along one axis"),
    (["sweep", "zittau_axial", "--kind", "chirp"], "invalid choice: 'chirp'"),
])  # fmt: skip
def test_command_refuses(call, arguments, message):
    done = call("assess", *arguments)
    assert done.code == 2
    assert message in " ".join(done.err.split())
