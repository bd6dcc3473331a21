/* The figures of many.h for one run, always in double. */
#ifndef AMBKIT_SIM_MANY_FIGURES_H
#define AMBKIT_SIM_MANY_FIGURES_H

#include "many.h"
#include "noise_block.h"

#define AMB_TALLY(name) amb_##name
#define amb_judged double
#define amb_judged_mask bool
#define amb_judged_choose(mask, a, b) ((mask) ? (a) : (b))
#define amb_judged_where(mask, a) ((mask) ? (a) : 0.0)
#define amb_judged_all(a) (a)
#include "tally_step.h"
#undef AMB_TALLY
#undef amb_judged
#undef amb_judged_mask
#undef amb_judged_choose
#undef amb_judged_where
#undef amb_judged_all

/* Flags of measurements that were not used. */
#define AMB_NOT_USED (AMB_UNUSED | AMB_BAD_VARIANCE)

/* Before the first sample. */
AMB_INLINE amb_tally amb_tally_none(const amb_windows *at)
{
  const amb_tally none = {.outside = at->step_from - 1.0, .late = at->load_from - 1.0};
  return none;
}

/* Adds one sample for each of these flags. */
static inline void amb_flags_count(amb_many_run *run, unsigned int status)
{
  for (unsigned int flag = 0; (status != 0U) && (flag < AMB_FLAGS); flag++)
    run->flags[flag] += (status >> flag) & 1U;
}

static const amb_double_bits infinite = {.bits = UINT64_C(0x7FF0000000000000)};
static const amb_double_bits no_number = {.bits = UINT64_C(0x7FF8000000000000)};

/* Settling time [s], for the last sample `last` outside the band. */
static inline double amb_stays(double from, double to, double last, double T)
{
  return (last >= to - 1.0) ? infinite.number : (last - from + 1.0) * T;
}

/* With several axes the worst counts: NaN does not hide another value, except for figures of axes
 * with a step. */
static inline void amb_figures_worst(double figures[], const double of[])
{
  for (int i = 0; i < AMB_FIGURES; i++) {
    const double other = ((i == AMB_OVERSHOOT) || (i == AMB_SETTLING)) ? figures[i] : of[i];
    if ((of[i] > figures[i]) || !((other < 0.0) || (other >= 0.0)))
      figures[i] = of[i];
  }
}

/* Of axis f, combined with those of the axes before it. */
static inline void amb_figures_of(amb_many_run *run, int f, const amb_tally *t)
{
  const amb_windows *at = &run->windows[f];
  const double unknown = no_number.number, T = (double)run->loop->T, all = (double)run->in.n;
  const double counted = all - at->first;
  double own[AMB_FIGURES], *to = (f == 0) ? run->figures : own;
  for (int i = 0; i < 3; i++) {
    const bool known = (run->loop->estimator != NULL) && (run->along[i].start != NULL);
    to[AMB_X_RMS + i] = known ? sqrt(t->squares[i] / counted) : unknown;
    to[AMB_X_PEAK + i] = known ? t->peaks[i] : unknown;
  }
  to[AMB_NIS] = (t->taken > 0.0) ? t->nis / t->taken : unknown;
  to[AMB_CONTROL_RMS] = sqrt(t->control / counted);
  to[AMB_CONTROL_PEAK] = t->control_peak;
  to[AMB_EFFORT] =
      (counted > 1.0) ? (double)run->loop->k_ui[f] * sqrt(t->effort / (counted - 1.0)) : unknown;
  to[AMB_FARTHEST] = t->farthest;
  to[AMB_CURRENT_PEAK] = t->current;
  const bool stepped = at->step_from < at->step_to;
  to[AMB_OVERSHOOT] = stepped ? t->way : unknown;
  to[AMB_SETTLING] = stepped ? amb_stays(at->step_from, at->step_to, t->outside, T) : unknown;
  to[AMB_RECOVERY] = (at->load_from < all) ? amb_stays(at->load_from, all, t->late, T) : unknown;
  to[AMB_LOAD_KEPT] = t->load;
  to[AMB_TOUCHED] = t->touched;
  to[AMB_LANDED] = t->landed;
  to[AMB_ORBIT_PEAK] = t->orbit;
  to[AMB_ORBIT_SHARE] = t->orbit / at->travel;
  if (f > 0)
    amb_figures_worst(run->figures, own);
}

#endif
