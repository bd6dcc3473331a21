"""The bare step of larger machines: straight line, loops, and a dense loop of the same size.

    uv run --group benchmarks python -m benchmarks.model_step [rounds]

Prediction and update of a Kalman filter, nothing checked, in C, compiled as the library is
(``-O3 -ffp-contract=off``; all but the loops without gcc's vectors of straight-line code). Dense:
the same filter as everybody writes it, matrices of a size known to the compiler, ``A P A' + Q`` in
two triple loops, the second on the upper triangle, sensors one after the other. Everyone in turn,
ratios within a round. Ends with status 1 where a limit is not kept.
"""

from __future__ import annotations

import ctypes
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.export.c import c_literals
from ambkit.export.c.model import loop_model
from ambkit.models import Model, compose, emit, machine_model
from ambkit.models.declaration import Part
from ambkit.models.parts import Amplifier, Delay, Disturbance, MagnetForce, Rotor, Sensor

Array = NDArray[np.float64]

ROOT = Path(__file__).resolve().parent.parent
FLAGS = "-std=c99 -O3 -ffp-contract=off -fno-trapping-math -fPIC -shared"
LIMITS = {"two axes": 0.6, "rigid rotor, gyroscopic": 0.3, "flexible rotor": 0.3}
"""The most that the faster of our two may take of the dense loop's time [1]."""

UNROLLED = 20
"""States up to which a model is tried as straight-line C; beyond, compilers take minutes."""
T = 1e-4


def axes(count: int, modes: int = 0, *, late: bool = False) -> list[Part]:
    """Return a rotor on so many axes, coupled by gyroscopics where there are more than two.

    With modes each sensor and magnet sees all of them; with `late` each axis has an amplifier that
    lags and a delay of a sample.
    """
    q = [f"q{k}" for k in range(count + modes)]
    turning = {(0, 1): 0.01, (1, 0): -0.01, (2, 3): 0.01, (3, 2): -0.01} if count > 2 else {}
    rotor = Rotor(
        {(k, k): 1.0 + 0.1 * k for k in range(count + modes)}, 1e-3, 0.1, tuple(q),
        tuple(f"v{k}" for k in range(count + modes)),
        damping={(k, k): 4.0 for k in range(count, count + modes)},
        gyroscopic=turning,
        stiffness={(k, k): 1e6 * (k - count + 1) for k in range(count, count + modes)},
        speed=1000.0,
    )  # fmt: skip
    parts: list[Part] = [rotor]
    for a in range(count):
        place = {q[a]: 1.0} | {mode: 0.3 / (1 + k) for k, mode in enumerate(q[count:])}
        parts += [
            MagnetForce(10.0, f"f{a}", place),
            Disturbance(10.0, 0.01, f"d{a}", f"f{a}"),
            Sensor(1.0, 2e-4, 1e-3, f"y{a}", f"xm{a}", place),
            Amplifier(1.0, 2000.0 if late else None, f"u{a}", f"i{a}", f"f{a}"),
        ]
        parts += [Delay(T, 1.0, f"u{a}")] if late else []
    return parts


def machines() -> dict[str, Model]:
    """Return the machines of the comparison, small to large."""
    from ambkit.machine.machine import Machine

    return {
        "the paper's axis": machine_model(Machine.preset("zittau_axial")),
        "two axes": compose(axes(2), T, name="two"),
        "rigid rotor, gyroscopic": compose(axes(4), T, name="rigid"),
        "flexible rotor": compose(axes(4, 8, late=True), T, name="flexible"),
    }


STEP = """
#include "ambkit/model.h"
%(data)s
void run(long steps, double *mean, double *cov, const double *growth)
{
  amb_stiffness k[AMB_FORCES];
  amb_real iu[AMB_CONTROLS], k_ui[AMB_CONTROLS], var_u[AMB_CONTROLS], F[AMB_FORCES];
  static amb_real work[AMB_WORK];
  for (int c = 0; c < amb_controls(&model); c++) {
    iu[c] = 0.1;
    k_ui[c] = 1;
    var_u[c] = 1e-4;
  }
  for (long s = 0; s < steps; s++) {
    for (int f = 0; f < amb_forces(&model); f++) {
      k[f].k_i = 10 + 1e-3 * (double)(s %% 7);
      k[f].k_s = 7500 + (double)(s %% 5);
      F[f] = k[f].k_i * amb_model_current(&model, f, mean, iu) +
             k[f].k_s * amb_model_displacement(&model, f, mean);
    }
    amb_model_predict_mean(&model, F, iu, mean);
    amb_model_predict_covariance(&model, k, k_ui, var_u, growth, cov, work);
    for (int r = 0; r < amb_sensors(&model); r++) {
      double e;
      const double S = amb_model_shown_variance(&model, r, cov) + 1e-10;
      amb_model_update(&model, r, 1e-6 * (double)(s %% 3), S, mean, cov, &e);
    }
  }
}
"""

DENSE = """
#define N %(n)d
#define M %(m)d
#define P_ %(p)d
#define C_ %(c)d
static const double L[N][N] = %(L)s, b[N][P_] = %(b)s, h[P_][N] = %(h)s, ee[P_][N] = %(e)s;
static const double r_[P_][N] = %(r)s, H[M][N] = %(H)s, B_u[N][C_] = %(B_u)s, d[P_][C_] = %(d)s;
void run(long steps, double *mean, double *cov, const double *growth)
{
  static double P[N][N], A[N][N], AP[N][N], Q[N][N], B[N][C_];
  const double u = 0.1;
  int at = 0;
  for (int i = 0; i < N; i++)
    for (int j = i; j < N; j++, at++) {
      P[i][j] = P[j][i] = cov[at];
      Q[i][j] = Q[j][i] = growth[at];
    }
  for (long s = 0; s < steps; s++) {
    const double k_i = 10 + 1e-3 * (double)(s %% 7), k_s = 7500 + (double)(s %% 5);
    double x[N];
    for (int i = 0; i < N; i++) {
      for (int j = 0; j < N; j++) {
        A[i][j] = L[i][j];
        for (int f = 0; f < P_; f++)
          A[i][j] += b[i][f] * (k_s * h[f][j] + k_i * ee[f][j] + r_[f][j]);
      }
      for (int c = 0; c < C_; c++) {
        B[i][c] = B_u[i][c];
        for (int f = 0; f < P_; f++)
          B[i][c] += b[i][f] * k_i * d[f][c];
      }
      x[i] = 0;
      for (int j = 0; j < N; j++)
        x[i] += A[i][j] * mean[j];
      for (int c = 0; c < C_; c++)
        x[i] += B[i][c] * u;
    }
    for (int i = 0; i < N; i++)
      for (int j = 0; j < N; j++)
        AP[i][j] = 0;
    for (int i = 0; i < N; i++)
      for (int k = 0; k < N; k++)
        for (int j = 0; j < N; j++)
          AP[i][j] += A[i][k] * P[k][j];
    for (int i = 0; i < N; i++)
      for (int j = i; j < N; j++) {
        double sum = Q[i][j];
        for (int k = 0; k < N; k++)
          sum += AP[i][k] * A[j][k];
        for (int c = 0; c < C_; c++)
          sum += B[i][c] * 1e-4 * B[j][c];
        P[i][j] = P[j][i] = sum;
      }
    for (int q = 0; q < M; q++) {
      double PH[N], S = 1e-10, e = 1e-6 * (double)(s %% 3);
      for (int i = 0; i < N; i++) {
        PH[i] = 0;
        for (int j = 0; j < N; j++)
          PH[i] += P[i][j] * H[q][j];
      }
      for (int i = 0; i < N; i++) {
        S += H[q][i] * PH[i];
        e -= H[q][i] * x[i];
      }
      const double inverse = 1 / S;
      for (int i = 0; i < N; i++) {
        x[i] += PH[i] * inverse * e;
        for (int j = 0; j < N; j++)
          P[i][j] -= PH[i] * inverse * PH[j];
      }
    }
    for (int i = 0; i < N; i++)
      mean[i] = x[i];
  }
  at = 0;
  for (int i = 0; i < N; i++)
    for (int j = i; j < N; j++, at++)
      cov[at] = P[i][j];
}
"""


def _matrix(values: Array) -> str:
    rows = ("{" + ", ".join(f"{v!r}" for v in row) + "}" for row in values.tolist())
    return "{" + ", ".join(rows) + "}"


def _loops(model: Model) -> str:
    """The model as constants for ambkit/loops.h."""
    held = loop_model(model)
    listed = (
        f"static const {one['type']} {one['name']}[] = {{{one['text']}}};"
        for one in c_literals.declared(held.arrays, "double")
    )
    numbers = c_literals.struct(held.numbers, "double")
    return "\n".join([*listed, f"static const amb_model model = {numbers};"])


class Built:
    """One of the three, compiled; `run` goes on from where it was."""

    def __init__(self, folder: Path, name: str, text: str, model: Model, *options: str) -> None:
        source, library = folder / f"{name}.c", folder / f"{name}.so"
        source.write_text(text, encoding="utf-8")
        loops = [ROOT / "core/src" / name for name in ("loops.c", "covariance_loops.c")]
        also = loops if "-DAMB_MODEL_LOOPS" in options else []
        includes = [f"-I{folder}", f"-I{ROOT / 'core/include'}", f"-I{ROOT / 'core'}"]
        flags = [*FLAGS.split(), *([] if also else ["-fno-tree-slp-vectorize"])]  # CMakeLists.txt
        command = ["gcc", *flags, "-DAMB_DOUBLE", *options, *includes, str(source)]
        subprocess.run([*command, *map(str, also), "-o", str(library)], check=True)
        self._run: Any = ctypes.CDLL(str(library)).run
        n = len(model.states)
        upper = np.triu_indices(n)
        sizes = np.array([state.size for state in model.states])
        self.mean = np.zeros(n)
        self.cov = np.ascontiguousarray(np.diag((0.01 * sizes) ** 2)[upper])
        variances = np.array([noise.size**2 for noise in model.noises])
        self.growth = np.ascontiguousarray(np.tensordot(variances, model.N, 1)[upper])

    def run(self, steps: int) -> float:
        """Take some steps; return the time of one [ns]."""
        pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (self.mean, self.cov, self.growth)]
        start = time.thread_time_ns()
        self._run(ctypes.c_long(steps), *pointers)
        return (time.thread_time_ns() - start) / steps


def built(model: Model, folder: Path) -> dict[str, Built]:
    """Compile the three for a machine."""
    names = emit.Names(model)
    (folder / "generated").mkdir()
    (folder / "generated" / "model.h").write_text(emit.header(names, model.name), encoding="utf-8")
    straight = f"static const amb_model model = {emit.initialiser(names, model)};"
    dense = {name: _matrix(getattr(model, name)) for name in ("L", "b", "h", "e", "r", "B_u", "d")}
    sizes = {"n": len(model.states), "m": len(model.measurements), "p": len(model.forces),
             "c": len(model.controls), "H": _matrix(model.c)}  # fmt: skip
    ways = {
        "loops": Built(folder, "loops", STEP % {"data": _loops(model)}, model, "-DAMB_MODEL_LOOPS"),
        "dense": Built(folder, "dense", DENSE % (dense | sizes), model),
    }
    if len(model.states) <= UNROLLED:
        ways["straight line"] = Built(folder, "straight", STEP % {"data": straight}, model)
    return ways


def measured(model: Model, rounds: int) -> dict[str, list[float]]:
    """Return times of a step [ns], all in turn, round by round."""
    with tempfile.TemporaryDirectory() as name:
        ways = built(model, Path(name))
        steps = max(200, 1_000_000 // len(model.states) ** 3)
        times: dict[str, list[float]] = {way: [] for way in ways}
        for _ in range(rounds):
            for way, one in ways.items():
                times[way].append(one.run(steps))
        ours, dense = ways["loops"], ways["dense"]
        if (straight := ways.get("straight line")) is not None:  # the same sums, to the last bit
            np.testing.assert_array_equal(straight.cov, ours.cov)
            np.testing.assert_array_equal(straight.mean, ours.mean)
        np.testing.assert_allclose(ours.cov, dense.cov, rtol=1e-6, atol=1e-9 * ours.cov.max())
    return times


def main(rounds: int = 21) -> int:
    """Measure, print, and judge by the limits."""
    kept = True
    print("| machine | states, forces, sensors | straight line | loops | dense | faster / dense |")
    print("| --- | --- | --: | --: | --: | --: |")
    for name, model in machines().items():
        times = measured(model, rounds)
        size = f"{len(model.states)}, {len(model.forces)}, {len(model.measurements)}"
        typical = {way: median(item) for way, item in times.items()}
        best = min((way for way in typical if way != "dense"), key=typical.__getitem__)
        ratio = median(a / b for a, b in zip(times[best], times["dense"], strict=True))
        kept = kept and ratio <= LIMITS.get(name, np.inf)
        shown = " | ".join(
            f"{typical[way]:,.0f} ns" if way in typical else ""
            for way in ("straight line", "loops", "dense")
        )
        print(f"| {name} | {size} | {shown} | {ratio:.0%} |", flush=True)
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
