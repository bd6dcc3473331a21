/* The figures of many.h for one run, in double whatever the loop is computed in. */
#ifndef AMBKIT_SIM_MANY_FIGURES_H
#define AMBKIT_SIM_MANY_FIGURES_H

#include "doubles.h"
#include "many.h"

typedef double amb_judged;
typedef bool amb_judged_mask;

AMB_INLINE amb_judged amb_judged_choose(amb_judged_mask mask, amb_judged a, amb_judged b)
{
  return mask ? a : b;
}

AMB_INLINE amb_judged amb_judged_where(amb_judged_mask mask, amb_judged a)
{
  return mask ? a : 0.0;
}

AMB_INLINE amb_judged amb_judged_all(double a)
{
  return a;
}

#include "tally_step.h"

/* Flags with which a measurement was not taken in. */
#define AMB_NOT_USED (AMB_UNUSED | AMB_BAD_VARIANCE)

AMB_INLINE amb_windows amb_windows_of(const amb_many_run *run)
{
  const amb_spans *s = &run->spans;
  amb_windows at = {.first = (double)s->first,
                    .step_from = (double)s->step_from,
                    .step_to = (double)s->step_to,
                    .height = (double)s->height,
                    .load_from = (double)s->load_from,
                    .band = (double)s->band};
  if (s->step_from < s->step_to)
    at.there = (double)run->r[s->step_from];
  else
    at.height = 1.0;
  return at;
}

/* Before the first sample. */
AMB_INLINE amb_tally amb_tally_none(const amb_windows *at)
{
  const amb_tally none = {.outside = at->step_from - 1.0, .late = at->load_from - 1.0};
  return none;
}

/* One sample more of each of these flags. */
static inline void amb_flags_count(amb_many_run *run, unsigned int status)
{
  for (unsigned int flag = 0; (status != 0U) && (flag < AMB_FLAGS); flag++)
    run->flags[flag] += (status >> flag) & 1U;
}

/* After which time it stays inside [s], the last sample outside being `last`. */
static inline double amb_stays(double from, double to, double last, double T)
{
  return (last >= to - 1.0) ? amb_double_infinity() : (last - from + 1.0) * T;
}

static inline void amb_figures_of(amb_many_run *run, size_t n, const amb_tally *t)
{
  const amb_spans *s = &run->spans;
  const amb_windows at = amb_windows_of(run);
  const double unknown = amb_double_nan(), T = (double)run->loop->T,
               counted = (double)(n - s->first);
  double *to = run->figures;
  for (int i = 0; i < 3; i++) {
    const bool known = run->loop->estimator != NULL;
    to[AMB_X_RMS + i] = known ? sqrt(t->squares[i] / counted) : unknown;
    to[AMB_X_PEAK + i] = known ? t->peaks[i] : unknown;
  }
  to[AMB_NIS] = (t->taken > 0.0) ? t->nis / t->taken : unknown;
  to[AMB_CONTROL_RMS] = sqrt(t->control / counted);
  to[AMB_CONTROL_PEAK] = t->control_peak;
  to[AMB_EFFORT] =
      (counted > 1.0) ? (double)run->loop->k_ui[0] * sqrt(t->effort / (counted - 1.0)) : unknown;
  to[AMB_FARTHEST] = t->farthest;
  to[AMB_CURRENT_PEAK] = t->current;
  const bool stepped = s->step_from < s->step_to;
  to[AMB_OVERSHOOT] = stepped ? t->way : unknown;
  to[AMB_SETTLING] = stepped ? amb_stays(at.step_from, at.step_to, t->outside, T) : unknown;
  to[AMB_RECOVERY] = (s->load_from < n) ? amb_stays(at.load_from, (double)n, t->late, T) : unknown;
  to[AMB_LOAD_KEPT] = t->load;
  to[AMB_TOUCHED] = t->touched;
  to[AMB_LANDED] = t->landed;
}

#endif
