"""Filters compared over seeds and steps, each in its own loop, against the same noise.

Writes comparison.png into the folder in which it is started.
"""

import ambkit
from ambkit.judge.comparison.seeds import comparison_figure

STEPS = ("0.1 mm", "0.3 mm", "0.5 mm")

bearing = ambkit.Bearing.preset("zittau_axial")
narrow = ambkit.train(bearing).expert
wide = ambkit.train(bearing, reach="0.8 mm").expert
law = ambkit.ClosedLaw(bearing)
filters = {
    "linear": ambkit.KalmanFilter(bearing),
    "adaptive": ambkit.AdaptiveKalmanFilter(bearing, narrow),
    "adaptive, wide": ambkit.AdaptiveKalmanFilter(bearing, wide),
    "closed-law": ambkit.AdaptiveKalmanFilter(bearing, law),
}

found = ambkit.compare_steps(bearing, filters, steps=STEPS, disturbance="3 N", seeds=20)
for case, scores in found.scores.items():
    for name, score in scores.items():
        print(
            f"{case}  {name:>14}: x {1e6 * score.mean('x'):.2f} µm, "
            f"F_St {score.mean('f_d'):.3f} ± {score.spread('f_d'):.3f} N rms"
        )
comparison_figure(found.scores).save("comparison.png")
