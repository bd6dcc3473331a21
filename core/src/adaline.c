#include "ambkit/adaline.h"
#include "ambkit/exponential.h"
#include "generated/closed_law.h"

void amb_adaline_reset(amb_adaline_state *state, amb_real k)
{
  const amb_adaline_state fresh = {0};
  *state = fresh;
  state->k = k;
}

/* Total force over k. */
static amb_real regressor(const amb_law *law, amb_real iu, amb_real x)
{
  return amb_law_regressor(law, law->two_sided ? AMB_C(1.0) : AMB_C(0.0), iu, x);
}

/* Critically damped low-pass z'' = w^2 (input - z) - 2 w z', exact for an input held over T. */
static void low_pass(amb_real w, amb_real T, amb_real keep, amb_real input, amb_real *z,
                     amb_real *z_dot)
{
  const amb_real off = *z - input, slope = *z_dot, wT = w * T;
  *z = input + keep * ((1 + wT) * off + T * slope);
  *z_dot = keep * ((1 - wT) * slope - w * wT * off);
}

/* Sensor lag: mean over the sample of its response to an input that is held over the sample. */
static amb_real sensed(const amb_adaline *a, amb_real input, amb_real *shown)
{
  const amb_real before = *shown;
  *shown = a->a_sen * before + (1 - a->a_sen) * input;
  return AMB_C(0.5) * (before + *shown);
}

amb_status amb_adaline_step(const amb_adaline *a, amb_adaline_state *s, amb_real y, amb_real u,
                            amb_real f_d)
{
  const amb_real now = y / a->K_sen;
  if (!((now > -a->law.s0) && (now < a->law.s0))) /* outside the air gap, or NaN */
    return AMB_MISSING;
  if (!amb_is_finite(u) || !amb_is_finite(f_d))
    return AMB_BAD_CONTROL;

  const amb_real iu = amb_clamp(a->k_ui * u, a->iu_min, a->iu_max);
  if (!s->started) {
    s->last_y = now;
    s->x = now;
    s->phi = regressor(&a->law, iu, now);
    s->phi_shown = s->phi;
    s->phi_late = s->phi;
    s->load = s->load_shown = f_d;
    s->force = s->k * s->phi;
    s->started = true;
    return AMB_UNEXCITED;
  }

  /* Between the two samples: the mean position, and phi with the sensor's lag. The lag is applied
   * to phi, not to the current: phi is convex in the current, so a fluctuating current has a larger
   * mean force than its mean. */
  const amb_real place = AMB_C(0.5) * (s->last_y + now);
  s->last_y = now;
  const amb_real phi = sensed(a, regressor(&a->law, iu, place), &s->phi_shown);
  const amb_real load = sensed(a, f_d, &s->load_shown);

  const amb_real keep = amb_exp_negative(a->bandwidth * a->T);
  const amb_real v = s->v;
  low_pass(a->bandwidth, a->T, keep, place, &s->x, &s->v);
  low_pass(a->bandwidth, a->T, keep, phi, &s->phi, &s->phi_dot);
  low_pass(a->bandwidth, a->T, keep, load, &s->load, &s->load_dot);

  /* Eq. 24: prediction, error, and the normalised rule for its last weight. The row of v is used:
   * its error is the mean acceleration over the sample, for any state of the low-pass. The row of x
   * weights the start of the sample more, and finds forces too large by bandwidth T / 3. */
  const amb_real input = a->T / a->m;
  const amb_real predicted = v + input * (s->load + a->f_0 + s->force);
  s->force += a->rate_force * (s->v - predicted) / input;
  s->phi_late += a->rate_force * (s->phi - s->phi_late);

  const amb_real own = 2 * a->law.i0 / a->law.s0;
  const amb_real reference = a->law.two_sided ? own * own : AMB_C(0.25) * own * own;
  const amb_real relative = s->phi_late / reference;
  s->excitation += a->rate_k * (relative * relative - s->excitation);
  if (s->excitation < a->least_excitation * a->least_excitation)
    return AMB_UNEXCITED;

  /* Eq. 25. The normalisation uses the larger of this sample's input and the mean one; otherwise a
   * zero crossing of phi would turn a small error into a huge step. */
  const amb_real norm = amb_at_least(relative * relative, s->excitation);
  const amb_real error = s->force - s->k * s->phi_late;
  s->k += a->rate_k * relative * error / (norm * reference);
  return AMB_OK;
}
