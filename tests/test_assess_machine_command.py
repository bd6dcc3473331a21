"""``ambkit assess`` of a whole machine."""

import pytest
from machine_cases import injected

from ambkit.workflow.assessing import MEASUREMENT


@pytest.mark.parametrize(("arguments", "said"), [
    (["ufu_rig", "--verbose"], "Each axis with all other loops closed"),
    pytest.param(
        ["ufu_rig", "--filter", "none", "--over-speed", "3000 rpm"], "to 3000 rpm",
        marks=pytest.mark.long,
    ),
    (["ufu_rig", "--filter", "none", "--sweep", "1 um", "--axis", "A1"], "ufu_rig A1"),
])  # fmt: skip
def test_command(call, tmp_path, arguments, said):
    done = call("assess", *arguments, "--plot", "p.png")
    assert done.code == 0, done.err
    assert said in done.out
    assert (tmp_path / "p.png").stat().st_size > 10_000


def test_command_takes_a_machines_log(call):
    _, record = injected(0)
    record.save("log.csv")
    found = call("assess", "log.csv", "--bearing", "ufu_rig", "--filter", "none", "--json").json
    assert found["zone"] == "A"
    assert list(found["models"]) == [MEASUREMENT]


@pytest.mark.parametrize(("arguments", "message"), [
    (["ufu_rig", "--position", "1 m"], "can be held up to its stops"),
    (["ufu_rig", "--filter", "observer"], "takes one axis"),
    (["ufu_rig", "--axis", "A1"], "--axis says how to --sweep"),
    (["ufu_rig", "--stepped-sine"], "--stepped-sine says how to --sweep"),
    (["ufu_rig", "--over-speed", "3000 rpm", "--sweep", "1 um"], "linear loop, without --sweep"),
    (["ufu_rig", "--filter", "linear,ud", "--report", "v.html"], "give one --filter, not 2"),
    (["zittau_axial", "--over-speed", "3000 rpm"], "does not turn: its rotor moves along one axis"),
    (["zittau_axial", "--axis", "A1"], "--axis says how to --sweep"),
])  # fmt: skip
def test_command_refuses(call, arguments, message):
    done = call("assess", *arguments)
    assert done.code == 2
    assert message in " ".join(done.err.split())
