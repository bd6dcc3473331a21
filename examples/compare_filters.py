"""Filters compared over seeds and steps, each in its own loop, against the same noise.

Writes comparison.png into the folder in which it is started.
"""

import numpy as np

import ambkit
from ambkit.show import plots

SEEDS = range(20)
STEPS = (0.1e-3, 0.3e-3, 0.5e-3)  # m

bearing = ambkit.Bearing.preset("zittau_axial")
narrow = ambkit.train(bearing, weights=True)
wide = ambkit.train(
    ambkit.stiffness_map(bearing, displacements=np.linspace(-0.8e-3, 0.8e-3, 5)), weights=True
)
law = ambkit.ClosedLaw(bearing)
filters = {
    "linear": lambda: ambkit.KalmanFilter(bearing),
    "adaptive": lambda: ambkit.AdaptiveKalmanFilter(bearing, narrow),
    "adaptive, wide": lambda: ambkit.AdaptiveKalmanFilter(bearing, wide),
    "closed-law": lambda: ambkit.AdaptiveKalmanFilter(bearing, law),
}

scores = {}
for step in STEPS:
    scenario = ambkit.Scenario(
        reference=ambkit.Step(amplitude=step, time=0.05),
        disturbance=ambkit.Step(amplitude=3.0, time=0.25),
    )
    case = f"{1e3 * step:g} mm"
    scores[case] = ambkit.compare(bearing, scenario, filters, SEEDS)
    for name, score in scores[case].items():
        print(
            f"{case}  {name:>14}: x {1e6 * score.mean('x'):.2f} µm, "
            f"F_St {score.mean('f_d'):.3f} ± {score.spread('f_d'):.3f} N rms"
        )
plots.save_figure(plots.comparison_figure(scores), "comparison.png")
