"""A recording through a channel map: a filter tuned on its beginning, judged on the rest.

Writes recording.png into the folder in which it is started.
"""

from pathlib import Path

import ambkit
from ambkit.judge.evaluation import evaluate, filter_figure
from ambkit.workflow.tuning import tune_disturbance

TUNED_ON = 1.5  # s

here = Path(__file__).parent
record = ambkit.load(here / "recordings" / "sinus_kalman.csv", here / "shifted_map.toml")
machine = ambkit.preset("inteco_ml").replace(
    name="around 9 mm", magnet__air_gap="11.149 mm", magnet__bias_current="0.8587 A"
)
law = ambkit.ClosedLaw(machine)


def make(process_noise: float) -> ambkit.KalmanFilter:
    """Build the filter with this process noise of the disturbance force [N^2/s]."""
    noise = ambkit.FilterNoise(disturbance=process_noise)
    return ambkit.AdaptiveKalmanFilter(machine, law, noise=noise)


# The process noise of the disturbance force is the one figure that nothing measures.
start = record.between(None, record.t[0] + TUNED_ON)
process_noise = tune_disturbance(machine, start, make).intensity
found = evaluate(make(process_noise), record, settling=TUNED_ON)
for ahead, error in found.prediction.items():
    print(
        f"{ahead:2} samples ahead: {1e6 * error:.2f} µm rms; "
        f"last measurement held {1e6 * found.held[ahead]:.2f}, "
        f"rig's own filter {1e6 * found.logged['x_logged held'][ahead]:.2f}"
    )
print(f"disturbance force {1e3 * found.disturbance_mean:.1f} mN")
filter_figure(record, {"closed-law": found}).save("recording.png")
