"""Filters compared over seeds and steps, each in its own loop, against the same noise.

Writes comparison.png into the folder in which it is started.
"""

import ambkit
from ambkit.judge.comparison.seeds import comparison_figure

STEPS = ("0.1 mm", "0.3 mm", "0.5 mm")

machine = ambkit.preset("zittau_axial")
narrow = ambkit.train(machine).expert
wide = ambkit.train(machine, reach="0.8 mm").expert
law = ambkit.ClosedLaw(machine)
filters = {
    "linear": ambkit.KalmanFilter(machine),
    "adaptive": ambkit.AdaptiveKalmanFilter(machine, narrow),
    "adaptive, wide": ambkit.AdaptiveKalmanFilter(machine, wide),
    "closed-law": ambkit.AdaptiveKalmanFilter(machine, law),
}

found = ambkit.compare_steps(machine, filters, steps=STEPS, disturbance="3 N", seeds=20)
for case, scores in found.scores.items():
    for name, score in scores.items():
        print(
            f"{case}  {name:>14}: x {1e6 * score.mean('x'):.2f} µm, "
            f"f_d {score.mean('f_d'):.3f} ± {score.spread('f_d'):.3f} N rms"
        )
comparison_figure(found.scores).save("comparison.png")
