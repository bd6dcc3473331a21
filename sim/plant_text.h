/* The plant over one substep, one text for every pattern. No include guard: it is compiled for
 * numbers (plant.c: unrolled for an isolated axis, and in loops) and for lanes (lanes_many.c),
 * which define amb_real, amb_substep_constants, amb_stage, amb_driven and amb_reachable. With a
 * constant pattern the loops are unrolled and unused parts removed.
 *
 * X: positions, velocities, then first-order states (readings, currents). Stage 0 is at the start
 * of a substep, 1 in its middle, 2 at its end.
 */

/* One step of the classical method of order 4 (Kutta 1901), with constant accelerations g.
 *
 * The velocity stages are eliminated (Nystroem 1925), and the effect of g is exact: this shortens
 * the chain of dependent operations, which determines the time. Terms that depend on velocities
 * need these stages; a plain plant has none.
 */
AMB_INLINE void amb_substep(const amb_pattern *p, const amb_substep_constants *of, amb_real X[])
{
  const amb_real h = of->h, half = of->half, sixth = of->sixth;
  const int q = p->positions, n = p->states;
  amb_real X2[AMB_PLANT_STATES], X3[AMB_PLANT_STATES], X4[AMB_PLANT_STATES];
  amb_real d1[AMB_PLANT_STATES], d2[AMB_PLANT_STATES], d3[AMB_PLANT_STATES], d4[AMB_PLANT_STATES];
  amb_real F1[AMB_PLANT_AXES], F2[AMB_PLANT_AXES], F3[AMB_PLANT_AXES], F4[AMB_PLANT_AXES];
  amb_real coasting[AMB_PLANT_STATES]; /* position at the end without magnet forces */

  amb_stage(p, of, X, 0, F1, d1);
  for (int k = 0; k < q; k++) {
    const amb_real g = of->g[k], v = X[q + k], halfway = X[k] + half * v;
    coasting[k] = X[k] + h * v + h * half * g;
    X2[k] = amb_reachable(p, of, halfway, k);
    X3[k] = amb_driven(p, of, halfway + half * half * g, half * half, F1, k);
    if (!p->plain) {
      X3[k] += half * half * d1[q + k];
      X2[q + k] = amb_driven(p, of, v + half * (g + d1[q + k]), half, F1, k);
    }
    X3[k] = amb_reachable(p, of, X3[k], k);
  }
  for (int j = 2 * q; j < n; j++)
    X2[j] = X[j] + half * d1[j];

  amb_stage(p, of, X2, 1, F2, d2);
  for (int k = 0; k < q; k++) {
    X4[k] = amb_driven(p, of, coasting[k], h * half, F2, k);
    if (!p->plain) {
      X4[k] += h * half * d2[q + k];
      X3[q + k] = amb_driven(p, of, X[q + k] + half * (of->g[k] + d2[q + k]), half, F2, k);
    }
    X4[k] = amb_reachable(p, of, X4[k], k);
  }
  for (int j = 2 * q; j < n; j++)
    X3[j] = X[j] + half * d2[j];

  amb_stage(p, of, X3, 1, F3, d3);
  for (int k = 0; k < q; k++)
    if (!p->plain)
      X4[q + k] = amb_driven(p, of, X[q + k] + h * (of->g[k] + d3[q + k]), h, F3, k);
  for (int j = 2 * q; j < n; j++)
    X4[j] = X[j] + h * d3[j];

  amb_stage(p, of, X4, 2, F4, d4);
  for (int f = 0; f < p->axes; f++) {
    F4[f] = F1[f] + 2 * (F2[f] + F3[f]) + F4[f];
    F3[f] = F1[f] + F2[f] + F3[f];
  }
  for (int k = 0; k < q; k++) {
    X[k] = amb_driven(p, of, coasting[k], h * sixth, F3, k);
    X[q + k] = amb_driven(p, of, X[q + k] + h * of->g[k], sixth, F4, k);
    if (!p->plain) {
      const amb_real *w1 = &d1[q], *w2 = &d2[q], *w3 = &d3[q], *w4 = &d4[q];
      X[k] += h * sixth * (w1[k] + w2[k] + w3[k]);
      X[q + k] += sixth * (w1[k] + 2 * (w2[k] + w3[k]) + w4[k]);
    }
  }
  for (int j = 2 * q; j < n; j++)
    X[j] = X[j] + sixth * (d1[j] + 2 * (d2[j] + d3[j]) + d4[j]);
}
