"""Make the CSV files of this folder from the rig's logs: ``python convert.py SOURCE [OUT]``.

SOURCE is a folder with the logs as the rig's public repository has them (see README.md).
"""

import argparse
from pathlib import Path

import numpy as np

import ambkit
from ambkit.data.channel_map import ChannelMap
from ambkit.data.record import Record
from ambkit.identification.forces.lift_off import find_lift_off, save_points

HERE = Path(__file__).parent
LOOP = (2.0, 6.0)  # [s]: the ball has been caught, and goes from its lowest point to its highest
REST = (0.0, 10.0)  # [s]
DECIMALS = {"t": 6, "u": 6, "i": 6, "iu_logged": 6}  # of s, V, A; all else to 1e-9 m or m/s
LOGS = {
    "sinus_no_filter.csv": ("sinusoidal_slow_linear-LQR_tracking-no_filter.mat", ("r", "y", "u")),
    "sinus_kalman.csv": (
        "sinusoidal_slow_linear-LQR_tracking-KF.mat",
        ("r", "y", "u", "x_logged", "v_logged", "iu_logged"),
    ),
}


def convert(source: Path, out: Path) -> None:
    """Write all files of this folder that come from the rig."""
    points_map = ChannelMap.load(HERE / "lift_off.toml")
    files = sorted((source / "force").glob("*.mat"))
    points = [find_lift_off(ambkit.load(file, points_map), int(file.stem)) for file in files]
    save_points(out / "lift_off_points.csv", points)

    rest = ambkit.load(source / "noises.mat", points_map).between(*REST)
    rounded(rest).save(out / "rest.csv")

    loop_map = ChannelMap.load(HERE / "closed_loop.toml")
    for name, (log, signals) in LOGS.items():
        record = ambkit.load(source / "closed_loop" / log, loop_map).between(*LOOP)
        rounded(record.select(*signals)).save(out / name)


def rounded(record: Record) -> Record:
    """Round far below the resolution of the sensors (1.4 um, 2.5 mA), for a smaller file."""
    signals = {name: np.round(record[name], DECIMALS.get(name, 9)) for name in record}
    return Record(np.round(record.t, DECIMALS["t"]), signals, record.units, record.meta)


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("source", type=Path)
    arguments.add_argument("out", type=Path, nargs="?", default=HERE)
    given = arguments.parse_args()
    convert(given.source, given.out)
