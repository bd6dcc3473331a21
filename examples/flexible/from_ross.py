"""A rotor of ROSS as matrices for ambkit: ``python from_ross.py OUT.npz [ROTOR.toml]``.

Runs where ROSS is installed (``pip install ross-rotordynamics``), not with ambkit. ROTOR.toml is
what ``rotor.save("ROTOR.toml")`` of ROSS writes; without it, ROSS's own example of a rotor on
active magnetic bearings. Bearings are left out: a machine of ambkit has its own.
"""

import sys

import numpy as np
import ross

DIRECTIONS = {"x": "x", "y": "y", "z": "z", "alpha": "th_x", "beta": "th_y", "theta": "th_z"}


def free(rotor: "ross.Rotor") -> "ross.Rotor":
    """Return the rotor without bearings and seals."""
    return ross.Rotor(rotor.shaft_elements, rotor.disk_elements)


def main(out: str, given: str | None = None) -> None:
    """Write M, K, G and D of a rotor, with the names of their rows and their units."""
    rotor = free(ross.Rotor.load(given) if given else ross.rotor_amb_example())
    rows = [name for node in range(len(rotor.nodes_pos)) for name in DIRECTIONS.values()]
    np.savez_compressed(
        out,
        M=rotor.M(0), K=rotor.K(0), G=rotor.G(), D=rotor.C(0),
        node=np.repeat(np.arange(len(rotor.nodes_pos)), len(DIRECTIONS)),
        direction=np.array(rows),
        place=np.array(rotor.nodes_pos, float),
        unit_of_length="m", unit_of_mass="kg",  # and seconds, radians
        source=f"ROSS {ross.__version__}, {given or 'rotor_amb_example()'}",
    )  # fmt: skip
    print(f"{out}: {len(rotor.nodes_pos)} nodes, {rotor.m:.6g} kg")
    frequencies = np.sqrt(np.abs(np.linalg.eigvals(np.linalg.solve(rotor.M(0), rotor.K(0)))))
    bending = np.sort(frequencies)[len(DIRECTIONS) :][:8] / (2 * np.pi)
    print("free modes [Hz], of both planes, the axial and torsional ones among them:", bending)


if __name__ == "__main__":
    main(*sys.argv[1:])
