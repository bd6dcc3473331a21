/* Figures of a closed loop, sample by sample. No include guard: the text is compiled for numbers
 * (many_figures.h) and for lanes (lanes_many.c), which define amb_judged, its masks and selection,
 * and how AMB_TALLY names the results. */

/* Sums, extremes, and the last samples outside the bands. */
typedef struct AMB_TALLY(tally) {
  amb_judged squares[3], peaks[3]; /* errors of x, v, f_d */
  amb_judged nis, taken;
  amb_judged control, control_peak, effort, last_u;
  amb_judged farthest, current, orbit;
  amb_judged way, outside; /* overshoot, relative to the step; last sample outside the settling band
                            */
  amb_judged late;         /* last sample outside the band after the load */
  amb_judged load, touched, landed;
} AMB_TALLY(tally);

/* One sample. */
typedef struct AMB_TALLY(seen) {
  amb_judged k, r, f_d, x, v, u, iu;
  amb_judged orbit, load;  /* radius of the orbit there; sum of all loads */
  amb_judged mean[3];      /* estimates of x, v, f_d */
  amb_judged nis, taken;   /* sum over the measurements used, and their number */
  amb_judged_mask touched; /* contact with a stop, from this sample to the next */
} AMB_TALLY(seen);

AMB_INLINE amb_judged AMB_TALLY(judged_magnitude)(amb_judged a)
{
  return amb_judged_choose(a < 0.0, -a, a);
}

AMB_INLINE amb_judged AMB_TALLY(judged_most)(amb_judged so_far, amb_judged a)
{
  return amb_judged_choose(a > so_far, a, so_far);
}

AMB_INLINE void AMB_TALLY(tally_estimate)(const AMB_TALLY(windows) * at, AMB_TALLY(tally) * t,
                                          const AMB_TALLY(seen) * seen)
{
  const amb_judged_mask counts = seen->k >= at->first;
  const amb_judged error[3] = {seen->mean[0] - seen->x, seen->mean[1] - seen->v,
                               seen->mean[2] - seen->f_d};
  for (int i = 0; i < 3; i++) {
    t->squares[i] += amb_judged_where(counts, error[i] * error[i]);
    const amb_judged most =
        AMB_TALLY(judged_most)(t->peaks[i], AMB_TALLY(judged_magnitude)(error[i]));
    t->peaks[i] = amb_judged_choose(counts, most, t->peaks[i]);
  }
  t->nis += amb_judged_where(counts, seen->nis);
  t->taken += amb_judged_where(counts, seen->taken);
}

AMB_INLINE void AMB_TALLY(tally_loop)(const AMB_TALLY(windows) * at, AMB_TALLY(tally) * t,
                                      const AMB_TALLY(seen) * seen)
{
  const amb_judged one = amb_judged_all(1.0);
  const amb_judged_mask counts = seen->k >= at->first;
  const amb_judged off = seen->r - seen->x, away = AMB_TALLY(judged_magnitude)(off);
  t->control += amb_judged_where(counts, off * off);
  t->control_peak =
      amb_judged_choose(counts, AMB_TALLY(judged_most)(t->control_peak, away), t->control_peak);
  const amb_judged change = seen->u - t->last_u;
  t->effort += amb_judged_where(seen->k > at->first, change * change);
  t->last_u = seen->u;
  t->orbit = amb_judged_choose(counts, AMB_TALLY(judged_most)(t->orbit, seen->orbit), t->orbit);
  t->farthest = AMB_TALLY(judged_most)(t->farthest, AMB_TALLY(judged_magnitude)(seen->x));
  t->current = AMB_TALLY(judged_most)(t->current, AMB_TALLY(judged_magnitude)(seen->iu));
  const amb_judged_mask late = (seen->k >= at->load_from) & (away > at->band);
  t->late = amb_judged_choose(late, seen->k, t->late);
  t->touched += amb_judged_where(seen->touched, one);
  t->landed = amb_judged_where(seen->touched, one);
  const amb_judged borne = AMB_TALLY(judged_most)(t->load, seen->load);
  t->load = amb_judged_choose(t->touched > 0.0, t->load, borne);
}

/* Only if the sample may be within the window of the step, to avoid the division. */
AMB_INLINE void AMB_TALLY(tally_response)(const AMB_TALLY(windows) * at, AMB_TALLY(tally) * t,
                                          const AMB_TALLY(seen) * seen)
{
  const amb_judged_mask within = (seen->k >= at->step_from) & (seen->k < at->step_to);
  const amb_judged way = (seen->x - at->there) / at->height; /* -1 before, 0 at the reference */
  t->way = amb_judged_choose(within, AMB_TALLY(judged_most)(t->way, way), t->way);
  const amb_judged_mask out = within & (AMB_TALLY(judged_magnitude)(way) > 0.05);
  t->outside = amb_judged_choose(out, seen->k, t->outside);
}
