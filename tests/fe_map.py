"""A force map as finite elements give it, for several tests: iron that saturates, and fringes."""

from pathlib import Path

import numpy as np
from iron import IDEAL, TWO_SIDED

from ambkit import Machine, magnet_of

CURRENTS, DISPLACEMENTS = np.linspace(-2.5, 2.5, 21), np.linspace(-0.25e-3, 0.25e-3, 15)
LARGEST = 603.0  # Root mean square of the force [N], that of the map of the issue.

_RAW = magnet_of(
    TWO_SIDED.replace(magnet__saturation=1.1, magnet__pole_area="1450 mm^2", rotor__mass=20.0)
)
BEARING: Machine = IDEAL.replace(magnet__pole_area="1450 mm^2", rotor__mass=20.0)
"""What is known of it: the ideal law."""


def fe_force(iu, x):
    """Force [N] of the saturating law, with a fringe that grows with the gap."""
    s0 = TWO_SIDED.magnet.air_gap
    fringe = 1 + 0.03 * np.tanh((np.asarray(x) / s0) * 2) ** 2 + 0.01 * np.cos(np.asarray(iu))
    return np.asarray(_RAW.force(iu, x)) * fringe


def grid():
    """The 315 places: current [A], displacement [m]."""
    iu, x = np.meshgrid(CURRENTS, DISPLACEMENTS)
    return iu.ravel(), x.ravel()


def written(folder: Path) -> Path:
    """Write the map with the names and units of another program, and what they mean."""
    iu, x = grid()
    rows = zip(iu, 1e3 * (TWO_SIDED.magnet.air_gap - x), 1e-3 * fe_force(iu, x), strict=True)
    lines = ["Strom,Spalt,Kraft", *(f"{a:.12g},{b:.12g},{c:.15g}" for a, b, c in rows)]
    (folder / "fe.csv").write_text("\n".join(lines) + "\n")
    (folder / "channels.toml").write_text(
        '[signals.iu]\ncolumn = "Strom"\nunit = "A"\n\n'
        '[signals.x]\ncolumn = "Spalt"\nunit = "mm"\nsign = -1\noffset = "0.78 mm"\n\n'
        '[signals.f_mag]\ncolumn = "Kraft"\nunit = "kN"\n'
    )
    toml = BEARING.to_toml().replace(
        "[magnet]\n", '[magnet]\nforce_map = "fe.csv"\nforce_channels = "channels.toml"\n'
    )
    (folder / "fe.toml").write_text(toml)
    return folder / "fe.toml"
