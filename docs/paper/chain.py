"""Chapter 8: the whole chain in one run: identified, learned, flown, and learned anew in flight."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ambkit.estimate.kalman import AdaptiveKalmanFilter
from ambkit.fuzzy.training import train
from ambkit.identification.online.adaline import Adaline
from ambkit.machine.stiffness import stiffness_map
from ambkit.result.report import Axis, Figure, Item, Line, Panel, Rule, Span
from ambkit.result.report.blocks import Chapter, FigureBlock, Remark, TableBlock, Text
from ambkit.simulation.external_inputs import ExternalInputs
from ambkit.simulation.run import Loop, Run, samples
from ambkit.simulation.scenario import Scenario
from ambkit.simulation.waveforms import Sequence
from paper.study import CONTROLLER, POSITION, SEEDS, TIME, TIME_MS, Part, Study, mean_row, smaller

Array = NDArray[np.float64]

WRONG = 1 / 0.7  # the described magnet constant over the true one
DRIFT = (0.6, 1.8, 0.2)  # from [s], to [s], by how much of itself k grows
STEP, EVERY = 0.3e-3, 0.1  # m, s: up, and down again
LOAD = 3.0  # N
LEARNED_FROM = ((0.0, 0.4), (0.8, 1.1), (1.5, 1.8))  # s: without a load; at the end it is swapped
LOADED = ((0.45, 0.75), (1.15, 1.45), (1.85, 2.15))  # s
END = 2.2  # s
NEAR = 50  # samples after a swap in which a jump would be seen
WAYS = {
    "wrong": ("estimate linear", "k as described, wrong"),
    "learned": ("estimate adaptive", "k identified online"),
    "told": ("estimate closed law", "true k, at the same instants"),
    "afresh": ("estimate wide box", "k learned, filter started afresh"),
}
FORCE = Axis(r"disturbance force $f_d$", "N")


@dataclass(frozen=True)
class Flight:
    """One run in stretches, and the magnet constants that its filters had, over the bearing's."""

    runs: list[Run]  #: The stretches, one after the other.
    k: list[float]  #: What the filter assumed in each.

    def truth(self, name: str) -> Array:
        """A signal of the records, (n,)."""
        return np.concatenate([run.record[name] for run in self.runs])

    def estimate(self, name: str) -> Array:
        """A signal of the estimates, (n,)."""
        return np.concatenate([run.estimate[name] for run in self.runs if run.estimate])

    @property
    def t(self) -> Array:
        """Time [s], (n,)."""
        return np.concatenate([run.record.t for run in self.runs])

    @property
    def assumed(self) -> Array:
        """The magnet constant that the filter assumes, over the bearing's, (n,)."""
        return np.repeat(self.k, [len(run.record) for run in self.runs])

    @property
    def swaps(self) -> list[int]:
        """First samples of the filters that took over."""
        return [int(np.searchsorted(self.t, end - 1e-9)) for _, end in LEARNED_FROM]


def chain(study: Study) -> Part:
    """Levitate with the k that ADALINE finds, with a wrong k, and with the true one."""
    shown = {way: _fly(study, way, study.seed) for way in WAYS}
    results = {way: study.over_seeds(partial(_figures, study, way)) for way in WAYS}
    force = {way: figures[0] for way, figures in results.items()}
    off_k = results["learned"][2]
    got_back = 100 * (force["wrong"] - force["learned"]) / (force["wrong"] - force["told"])
    return Part(
        Chapter(
            id="chain",
            title="The whole chain, in one run",
            lead="ADALINE identifies the magnet constant, map and expert are made from it, and the "
            "adaptive filter continues with this expert. Then the constant drifts, and the chain "
            "runs twice more during levitation.",
            blocks=[
                Text(f"The bearing is described with a magnet constant {100 * (WRONG - 1):.0f} "
                     "% too large. The rotor is moved up and down by 0.3 mm, so that the "
                     f"nonlinear force law matters; a load of {LOAD:g} N acts three times, and "
                     f"from {DRIFT[0]:g} to {DRIFT[1]:g} s the true constant grows by "
                     f"{100 * DRIFT[2]:.0f} %. Between the loads ADALINE identifies k from the "
                     "latest record (an unknown load would bias it, see [](#adaline)), and a "
                     "new filter with this k replaces the old one between two samples."),
                Text("**Retraining.** The force, and so every stiffness, is proportional to "
                     "the constant: when it changes, the rules keep centres and widths, and "
                     "their outputs are scaled. Retrained on the map of the first identified "
                     "k, the network gives the same force to within "
                     f"{_trained_off(study, shown['learned'].k[1]):.1g} % of its largest. So a "
                     "controller scales 50 numbers and needs no training."),
                FigureBlock(_figure(study, shown)),
                _table(results),
                Text("**Bumpless transfer.** The new filter starts with mean and covariance of the "
                     "old one; in C it is the same state with other parameters. The estimates do "
                     "not jump, see the last columns of the table. The force error of the wrong "
                     "constant decays within milliseconds, without oscillation. A restarted filter "
                     "would have to estimate velocity and force again, with the controller on it."),
                FigureBlock(_figure_swap(study, shown)),
                Remark("Benefit",
                       r"After the first swap the error of $f_d$ is "
                       f"{force['wrong'].mean():.2f} N rms with the constant as described, "
                       f"{force['learned'].mean():.2f} N with the identified one, and "
                       f"{force['told'].mean():.2f} N with the true one: identification removes "
                       f"{got_back.mean():.0f} % of the cost of the wrong constant. The "
                       "remainder is due to the drift: the error of k at the swaps is "
                       f"{off_k.mean():.1f} % rms."),
            ],
        ),
        [
            mean_row("chain.k", "ADALINE, error of k: at the swaps, rms", off_k, "%"),
            mean_row("chain.wrong", "f_d after the first swap: k as described, "
                     f"{100 * (WRONG - 1):.0f} % too large", force["wrong"], "N rms"),
            mean_row("chain.learned", "f_d after the first swap: k identified online",
                     force["learned"], "N rms", smaller(force["learned"], force["wrong"])),
            mean_row("chain.told", "f_d after the first swap: true k",
                     force["told"], "N rms",
                     smaller(force["told"], force["wrong"])),
            mean_row("chain.jump",
                     "Jump of f_d at a swap: state kept",
                     results["learned"][4] / results["learned"][6], ""),
            mean_row("chain.afresh", "Jump of f_d at a swap: filter restarted",
                     results["afresh"][4] / results["afresh"][6], ""),
        ],
    )  # fmt: skip


def _scenario(study: Study, seed: int) -> tuple[Scenario, ExternalInputs]:
    """Return what happens, with the noise of a seed, and how the magnet drifts."""
    times = np.arange(EVERY / 2, END, EVERY)
    heights = STEP * (np.arange(times.size) % 2 == 0)
    edges = [edge for span in LOADED for edge in span]
    scenario = Scenario(
        duration=END,
        reference=Sequence(times=tuple(times), values=tuple(heights)),
        disturbance=Sequence(times=tuple(edges), values=(LOAD, 0.0) * len(LOADED)),
        controller=CONTROLLER,
        seed=seed,
    )
    start, stop, growth = DRIFT
    t = study.bearing.sampling_time * np.arange(samples(study.bearing, scenario))
    return scenario, ExternalInputs(
        magnet_scale=1 + growth * np.clip((t - start) / (stop - start), 0, 1)
    )


def _filter(study: Study, k: float) -> AdaptiveKalmanFilter:
    """Return the adaptive filter of a magnet constant, given over the bearing's."""
    return AdaptiveKalmanFilter(study.bearing, study.wide_expert.scaled(k), noise=study.noise)


def _fly(study: Study, way: str, seed: int) -> Flight:
    """Fly one of the `WAYS`."""
    machine = study.bearing
    scenario, external_inputs = _scenario(study, seed)
    assert external_inputs.magnet_scale is not None  # it drifts
    known = machine.magnet.magnet_constant
    loop = Loop(machine, scenario, estimator=_filter(study, WRONG), external_inputs=external_inputs)
    runs: list[Run] = []
    k = [WRONG]
    for start, end in LEARNED_FROM:
        if start > 0:  # what came before is not learned from: the load was on
            runs.append(loop.run(start))
            k.append(k[-1])
        runs.append(loop.run(end))
        if way == "wrong":
            now = WRONG
        elif way == "told":
            now = float(external_inputs.magnet_scale[round(end / machine.sampling_time)])
        else:
            now = Adaline(machine, start=k[-1] * known).run(runs[-1].record).magnet_constant / known
        new = _filter(study, now)
        if way == "afresh":
            y = runs[-1].record["y"][-1]
            new.reset([y / machine.sensor.gain, 0.0, 0.0, y])
        else:
            assert loop.estimator is not None  # it was given
            new.transfer_from(loop.estimator)
        loop.estimator = new
        k.append(now)
    return Flight([*runs, loop.run()], k)


def _figures(study: Study, way: str, seed: int) -> list[float]:
    """Return figures of a run."""
    # Errors of force [N] and position [µm], of k at the swaps [%]; largest change in a sample of
    # position error [µm] and of force [N] just after a swap, and the same elsewhere; stops touched.
    flight = _fly(study, way, seed)
    first = flight.swaps[0]
    error = flight.estimate("x") - flight.truth("x")
    force = flight.estimate("f_d") - flight.truth("f_d")
    _, external_inputs = _scenario(study, seed)
    assert external_inputs.magnet_scale is not None  # it drifts
    off = [flight.assumed[i] / external_inputs.magnet_scale[i] - 1 for i in flight.swaps]
    changes = []
    for series in (1e6 * error, flight.estimate("f_d")):
        change = np.abs(np.diff(series, prepend=series[0]))
        near = [change[i : i + NEAR].max() for i in flight.swaps]
        settled = change[first + NEAR :]
        whole = settled[: settled.size // NEAR * NEAR].reshape(-1, NEAR).max(axis=1)
        changes.append((float(np.mean(near)), float(np.median(whole))))
    (near_x, else_x), (near_f, else_f) = changes
    return [
        float(np.sqrt(np.mean(force[first:] ** 2))),
        1e6 * float(np.sqrt(np.mean(error[first:] ** 2))),
        100 * float(np.sqrt(np.mean(np.square(off)))),
        near_x,
        near_f,
        else_x,
        else_f,
        float(sum(run.record.meta["stop_touched"] for run in flight.runs)),
    ]


def _trained_off(study: Study, k: float) -> float:
    """Largest force between a network trained anew for k and the one multiplied [% of largest]."""
    magnet_constant = k * study.bearing.magnet.magnet_constant
    machine = study.bearing.replace(magnet__magnet_constant=magnet_constant)
    low, high = study.wide_expert.displacement_range
    stiff = stiffness_map(machine, displacements=np.linspace(low, high, 5))
    anew, scaled = train(stiff, weights=True), study.wide_expert.scaled(k)
    iu, x = np.meshgrid(np.linspace(*scaled.current_range, 61), np.linspace(low, high, 61))
    force = scaled.force(iu.ravel(), x.ravel())
    off = np.abs(np.asarray(anew.force(iu.ravel(), x.ravel())) - force).max()
    return 100 * float(off / np.abs(force).max())


def _table(results: dict[str, Array]) -> TableBlock:
    def entry(values: Array, digits: int) -> str:
        return f"{values.mean():.{digits}f} ± {values.std(ddof=1):.{digits}f}"

    return TableBlock(
        id="chain_table",
        title="After the first swap: errors, and the largest change in a sample",
        headers=["filter", r"$f_d$ [N rms]", "x [µm rms]", "k at the swaps [%]",
                 "after a swap: x [µm]", r"$f_d$ [N]", "elsewhere: x [µm]",
                 r"$f_d$ [N]", "stops touched"],
        rows=[
            [WAYS[way][1], entry(e[0], 3), entry(e[1], 2), entry(e[2], 1), entry(e[3], 1),
             entry(e[4], 2), entry(e[5], 1), entry(e[6], 2), f"{e[7].sum():.0f}"]
            for way, e in results.items()
        ],
        caption=f"Mean and standard deviation over {SEEDS} seeds. Changes: the largest from one "
        "sample to the next within 5 ms after a swap, and in 5 ms elsewhere (median); for the "
        "position, of its error, as the rotor moves.",
    )  # fmt: skip


def _figure(study: Study, shown: dict[str, Flight]) -> Figure:
    _, external_inputs = _scenario(study, study.seed)
    learned = shown["learned"]
    t = learned.t
    assert external_inputs.magnet_scale is not None  # it drifts
    known = 1e6 * study.bearing.magnet.magnet_constant

    def lines(values: dict[str, Array]) -> list[Item]:
        return [Line(shown[way].t, value, signal=WAYS[way][0], label=WAYS[way][1])
                for way, value in values.items()]  # fmt: skip

    swaps: list[Item] = [Rule(t[i], axis="x", signal="bound", label="") for i in learned.swaps]
    spans: list[Item] = [Span(*span, signal="identified", label="") for span in LEARNED_FROM]
    return Figure(
        id="chain_run",
        title="Identification, training and bumpless transfer while the magnet drifts",
        source="the paper's Fig. 1 and 5 to 9 combined",
        caption="Shaded: records from which ADALINE identifies k; at the dashed line the "
                "filter with the new k replaces the old one. Top: the rotor with the updated "
                "filter in the loop. Middle: the magnet constant of each filter, and the true "
                "one. Bottom: the disturbance force; with a wrong constant the filter "
                "estimates a force of some newtons that does not exist (the true constant "
                f"gives nearly the same estimate as the identified one). {study.one_run}",
        panels=[
            Panel(TIME, POSITION, [
                Line(t, learned.truth("r"), signal="reference"),
                Line(t, learned.truth("x"), signal="truth"), *spans, *swaps]),
            Panel(TIME, Axis("magnet constant", "N mm²/A²"), [
                Line(t, known * external_inputs.magnet_scale, signal="truth", label=""),
                *lines({way: known * shown[way].assumed for way in ("wrong", "learned", "told")}),
                *spans]),
            Panel(TIME, FORCE, [
                *lines({way: shown[way].estimate("f_d") for way in ("wrong", "learned")}),
                Line(t, learned.truth("f_d"), signal="truth", label=""), *spans, *swaps]),
        ],
    )  # fmt: skip


def _figure_swap(study: Study, shown: dict[str, Flight]) -> Figure:
    at = shown["learned"].swaps[0]
    near = slice(at - 100, at + 250)

    def lines(of: str) -> list[Item]:
        items: list[Item] = []
        for way in ("learned", "afresh"):
            flight = shown[way]
            off = flight.estimate("x") - flight.truth("x")
            values = off if of == "x" else flight.estimate("f_d")
            signal, label = WAYS[way]
            items.append(Line(flight.t[near], values[near], signal=signal, label=label))
        return items

    learned = shown["learned"]
    t = learned.t
    off = 1e6 * np.abs(learned.estimate("x") - learned.truth("x"))[at : at + 2 * NEAR].max()
    swap = Rule(float(t[at]), axis="x", signal="bound", text="swap", label="")
    return Figure(
        id="chain_swap",
        title="Detail of the first swap: bumpless transfer, and restart",
        caption="Until the swap both are the same run. With bumpless transfer the estimates "
                "continue, and the spurious force due to the wrong constant decays; meanwhile "
                f"the position error is up to {off:.0f} µm, as that force does not fit the new "
                "constant. A restarted filter oscillates until velocity and force have "
                f"converged. {study.one_run}",
        panels=[
            Panel(TIME_MS, Axis("error of position", "µm", 1e6), [*lines("x"), swap]),
            Panel(TIME_MS, FORCE, [
                *lines("f_d"), swap,
                Line(t[near], learned.truth("f_d")[near], signal="truth")]),
        ],
    )  # fmt: skip
