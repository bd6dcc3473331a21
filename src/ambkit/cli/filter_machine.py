"""``ambkit filter`` along a record of a whole machine."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ambkit.base.errors import AmbkitError
from ambkit.cli.options import refuse_of_one_axis

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ambkit.data.record import Record
    from ambkit.estimate.noise import FilterNoise
    from ambkit.machine.machine import Machine


def filter_machine(
    machine: Machine,
    log: Record,
    kinds: Sequence[str],
    *,
    synchronous: Sequence[str],
    noise: FilterNoise,
    settling: float,
    smooth: bool,
    out: Path | None,
    json: bool,
    others: Mapping[str, Any],
) -> None:
    """Run estimators along a record of a machine, and print what they say of it."""
    from ambkit.cli import output
    from ambkit.estimate.registry import FILTER_SUFFIX
    from ambkit.judge.adequacy import judge_adequacy
    from ambkit.workflow.filtering_machine import filter_machine as along
    from ambkit.workflow.given import of_machine

    refuse_of_one_axis(machine, others)
    if out is not None and len(kinds) != 1:
        raise AmbkitError(f"--out takes the estimates of one estimator, not of {len(kinds)}")
    with output.progress("filtering"):
        found = along(
            machine, log, kinds, synchronous=synchronous, noise=noise, settling=settling,
            smooth=smooth,
        )  # fmt: skip
    left = len(log) - len(found.record)
    if left:
        output.note(
            f"{left} samples are left out, in which magnets have no current by the record's mode"
        )
    data = found.to_dict()
    data["adequacy"] = {
        kind: output.say_adequacy(
            judge_adequacy(
                of_machine(kind, machine) if kind.endswith(FILTER_SUFFIX) else None, machine,
                nis=data["estimators"][kind]["nis"],
            ), kind,
        )
        for kind in kinds
    }  # fmt: skip
    write = [(out, lambda path: found.estimates[kinds[0]].save(path))]
    output.deliver(data, [_table(data, found.estimates[kinds[0]].units)], write, as_json=json)


def _table(data: dict[str, Any], units: Mapping[str, str]) -> Any:
    from ambkit.cli import harmonics
    from ambkit.cli.output import table, value

    all_of = data["estimators"]

    def several(values: Mapping[str, float], unit: str) -> str:
        return ", ".join(f"{name} {value(each, unit)}" for name, each in values.items())

    told = list(all_of.values())
    rows = [
        ["mean NIS (1: consistent)", *(f"{j['nis']:.3f}" for j in told)],
        ["status", *(", ".join(j["status"]).lower() or "ok" for j in told)],
        ["innovation, std", *(several(j["innovation_std"], "m") for j in told)],
        ["load, mean", *(several(j["disturbance_mean"], "N") for j in told)],
        ["load, std", *(several(j["disturbance_std"], "N") for j in told)],
    ]
    for name in told[0]["rmse"]:
        errors = (value(j["rmse"][name], units[name]) for j in told)
        rows.append([f"error of {name}, rms", *errors])
    turning = [dict(harmonics.rows(j.get("synchronous", {}))) for j in told]
    for what in dict.fromkeys(what for each in turning for what in each):
        rows.append([what, *(each.get(what, "–") for each in turning)])
    title = f"{data['machine']}, {data['samples']} samples"
    return table(title, ["", *all_of], rows)
