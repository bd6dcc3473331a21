"""Chapter 1: the linear Kalman filter (paper, section B, eq. 7-21, Fig. 1, 2, 4)."""

from __future__ import annotations

import numpy as np

from ambkit.estimate.errors import whiteness
from ambkit.judge.comparison import rmse
from ambkit.result.report import Axis, Figure, Line, Panel
from ambkit.result.report.blocks import Chapter, Equation, FigureBlock, Remark, TableBlock, Text
from paper.study import POSITION, SEEDS, TIME, Part, Study, mean_row, reached, smaller

# Small step: where the linear filter's model holds, so that it can be judged as a filter.
SMALL_STEP = 0.1e-3


def linear(study: Study) -> Part:
    """Show the filter at a small step, and whether it knows how good it is."""
    run = study.run(study.scenario(SMALL_STEP, 3.0))
    record, estimate = run.record, run.estimate
    assert estimate is not None  # the run had an estimator
    noise = float(np.sqrt(study.bearing.sensor.noise_variance))
    nis, white, error = study.over_seeds(lambda seed: _figures(study, seed))
    band = 1.96 * np.sqrt(2 / len(record.t))  # of the mean of n chi-square values of one degree

    t = record.t
    force = Axis(r"disturbance force $f_d$", "N")
    figure = Figure(
        id="linear_run",
        title="The linear Kalman filter in the loop, step of 0.1 mm and load of 3 N",
        caption=(
            "Top: the estimate follows the true position within the measurement noise. "
            "Middle: the disturbance force is estimated, not measured; it follows the load "
            "within some milliseconds, and the noise is the price of that bandwidth. Bottom: "
            "the innovations; 95 % of them should lie within twice their predicted standard "
            "deviation. In the first milliseconds the filter converges from its initial "
            f"state. {study.one_run}"
        ),
        panels=[
            Panel(TIME, POSITION, [
                Line(t, record["y"], signal="measured"),
                Line(t, record["r"], signal="reference"),
                Line(t, record["x"], signal="truth"),
                Line(t, estimate.x, signal="estimate linear"),
            ]),
            Panel(TIME, force, [
                Line(t, record["f_d"], signal="truth", label=""),
                Line(t, estimate.f_d, signal="estimate linear", label=""),
            ]),
            Panel(TIME, Axis("innovation", "µm", 1e6), [
                Line(t[1:], estimate.innovation[1:], signal="innovation"),
                Line(t[1:], 2 * np.sqrt(estimate.innovation_variance[1:]), signal="bound",
                     label="twice the predicted deviation"),
                Line(t[1:], -2 * np.sqrt(estimate.innovation_variance[1:]), signal="bound",
                     label=""),
            ]),
        ],
    )  # fmt: skip
    model = study.bearing
    noise_table = TableBlock(
        id="noise",
        title="What the filter assumes",
        headers=["quantity", "value", "from"],
        rows=[
            ["measurement noise $R$", "8.3e-5 mm² (9.1 µm rms)", "paper, read as mm²"],
            ["noise on the control signal", "8e-5 V² (8.9 mV rms)", "paper, read as V²"],
            [r"growth of $f_d$", f"{study.noise.disturbance:g} N²/s (0.01 N² a sample)", "chosen"],
            ["sampling time $T$", f"{model.sampling_time * 1e3:g} ms", "chosen"],
            [
                r"sensor lag $T_\mathrm{Sen}$, gain $K_\mathrm{Sen}$",
                f"{model.sensor.lag * 1e3:g} ms, 1",
                "chosen",
            ],
            ["amplifier gain $k_{ui}$", f"{model.amplifier.gain:g} A/V", "chosen"],
            ["controller", "3000 A/m, 20000 A/(m s), 12 A s/m", "chosen"],
        ],
        caption="The paper prints the variances as 8·10⁻⁵ V and 8.3·10⁻⁵ V/mm. Variances have "
        "squared units; with a sensor gain of 1 V/mm the second is 8.3·10⁻⁵ mm².",
    )
    return Part(
        Chapter(
            id="linear",
            title="Linear Kalman filter",
            lead="Four states, one measurement: displacement, velocity, disturbance force, and "
            "the lagged position at the sensor's output.",
            blocks=[
                Text("Two opposite magnets act on the rotor, driven in differential mode (the "
                     "paper's Fig. 2, a sketch): the one towards +x with the current $i_0 + "
                     "i_u$, the other with $i_0 - i_u$. The loop is that of its Fig. 1: the "
                     "controller uses the estimate, and its control signal drives the "
                     "amplifier and the filter. In the filter (Fig. 4, a block diagram) the "
                     "same signal drives a model of the plant, which is corrected by the "
                     "measurement."),
                Text("The rotor obeys (eq. 15, 16), the sensor lags (eq. 19), the force is linear "
                     "(eq. 17), and the disturbance is a random walk:"),
                Equation(r"x(k+1) = x + T v + \frac{T^2}{2m} (F_\mathrm{Magnet} + F_\mathrm{St})",
                         "eq. 15"),
                Equation(r"v(k+1) = v + \frac{T}{m} (F_\mathrm{Magnet} + F_\mathrm{St})", "eq. 16"),
                Equation(r"F_\mathrm{Magnet} = k_i k_{ui} u + k_s x", "eq. 17"),
                Equation(r"x_M(k+1) = K_\mathrm{Sen} (1 - e^{-T/T_\mathrm{Sen}}) x + "
                         r"e^{-T/T_\mathrm{Sen}} x_M", "eq. 19"),
                Text("These four lines are stated once, symbolically; the matrices of eq. 20, "
                     "the covariance step on its upper triangle and the update (eq. 9-13) are "
                     "derived from them and committed as C. Here the weight is part of the "
                     "model; the paper omits it, so that it appears in $F_{\\mathrm{St}}$ "
                     "(see [](#errata))."),
                noise_table,
                FigureBlock(figure),
                Remark("The stated uncertainty is correct",
                       f"Over {SEEDS} seeds, the mean normalised innovation squared is "
                       f"{nis.mean():.3f} ± {nis.std(ddof=1):.3f} (95 % of single runs of a "
                       f"correct model lie within 1 ± {band:.3f}), and "
                       f"{100 * white.mean():.0f} % of the innovations' correlations lie "
                       "within the 95 % bound of a white sequence: at this small step the "
                       "innovations show no error of the model."),
            ],
        ),
        [
            mean_row("linear.nis", "Linear filter, 0.1 mm: mean NIS (consistent at 1)",
                     nis, "",
                     reached(abs(float(nis.mean()) - 1) < 2 * band)),
            mean_row("linear.position",
                     f"Linear filter, 0.1 mm: x (sensor {noise * 1e6:.1f})", 1e6 * error,
                     "µm rms", smaller(error, noise)),
        ],
    )  # fmt: skip


def _figures(study: Study, seed: int) -> tuple[float, float, float]:
    """Mean NIS, share of white lags, and error of the position [m] of one run."""
    run = study.run(study.scenario(SMALL_STEP, 3.0, seed=seed))
    assert run.estimate is not None  # the run had an estimator
    estimate = run.estimate
    return (
        float(estimate.nis[1:].mean()),
        whiteness(estimate.innovation[1:]).share_within,
        rmse(estimate, run.record, "x"),
    )
