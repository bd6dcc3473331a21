#include "ambkit/envelope.h"
#include "ambkit/root.h"
#include "kalman_step.h"

/* Distance of the nearer edge of a step from the prediction, in standard deviations, beyond which
 * only this edge matters. */
#define FARTHEST AMB_C(6.0)

/* Half step in standard deviations of the innovation, above which the interval carries more
 * information than its rounding variance. */
#define NARROW AMB_C(0.5)

/* Exponent of the probability of a repeat over the dwell time in a very coarse step. A rotor that
 * the disturbance force moves, or whose position is known to a step only, stays in a step of up to
 * five standard deviations for less than three time constants. */
#define LEAVES AMB_C(5.16)

/* Minimum variance of the noise, relative to that at the centre (amb_noise_share). */
#define LEAST_NOISE AMB_C(0.015625)

/* Minimum relative reduction of a variance by a measurement. */
#define LEAST AMB_C(1e-4)

/* Variance of a repeated very coarse measurement, relative to the rounding variance over the dwell
 * time, for a prediction as wide as the step. */
#define REPEATED AMB_C(15.0)

static bool not_negative(amb_real a)
{
  return amb_is_finite(a) && (a >= AMB_C(0.0));
}

static bool not_zero(amb_real a)
{
  return amb_is_finite(a) && ((a > AMB_C(0.0)) || (a < AMB_C(0.0)));
}

static bool good_settings(const amb_model *model, const amb_kalman_settings *s)
{
  bool good = amb_is_positive(s->T) && amb_is_positive(s->gate) && not_negative(s->dwell);
  for (int r = 0; r < amb_sensors(model); r++) {
    good = good && not_zero(s->K_sen[r]) && not_negative(s->lag[r]) &&
           amb_is_positive(s->travel[r]) && amb_is_positive(s->var_y[r]) &&
           amb_is_finite(s->rise[r]) && not_negative(s->step[r]);
  }
  for (int c = 0; c < amb_controls(model); c++) {
    good = good && not_zero(s->k_ui[c]) && amb_is_finite(s->iu_min[c]) &&
           amb_is_finite(s->iu_max[c]) && (s->iu_min[c] < s->iu_max[c]) &&
           not_negative(s->var_u[c]);
  }
  for (int f = 0; f < amb_forces(model); f++) {
    good = good && amb_is_finite(s->f_0[f]) && amb_is_positive(s->x_max[f]);
  }
  for (int k = 0; k < amb_noises(model); k++) {
    good = good && not_negative(s->var_d[k]);
  }
  for (int i = 0; i < amb_states(model); i++) {
    good = good && amb_is_positive(s->cap[i]);
  }
  return good;
}

/* Density of the standard normal distribution. */
static amb_real density(amb_real t)
{
  return AMB_C(0.39894228040143268) * amb_exp_negative(AMB_C(0.5) * (t * t));
}

/* Mills ratio, its tail beyond t >= 0 over its density, with a relative error of 1e-4. */
static amb_real mills(amb_real t)
{
  return (AMB_C(6.59915492) + t * (AMB_C(4.05471361) + t)) /
         (AMB_C(5.26497952) + t * (AMB_C(7.44659211) + t * (AMB_C(4.06105618) + t)));
}

amb_rounded amb_kalman_rounded(const amb_kalman *kf, int r, amb_real e, amb_real shown,
                               amb_real noise)
{
  const amb_real step = kf->set.step[r];
  const amb_real S = shown + noise;
  const amb_real s = amb_root(S);
  const amb_real middle = amb_magnitude(e) / s;
  const amb_real half = (AMB_C(0.5) * step) / s;
  const amb_real near = middle - half; /* edges of the step, in standard deviations */
  const amb_real far = middle + half;
  amb_rounded as = {AMB_C(0.0), noise + (step * step) / AMB_C(12.0), AMB_C(0.0)};
  if (!(near < FARTHEST)) {
    if (half > NARROW) { /* only the nearer edge matters */
      as.moved = (e < AMB_C(0.0)) ? (AMB_C(0.5) * step) : (AMB_C(-0.5) * step);
      as.noise = noise;
    }
    return as;
  }
  const amb_real d_near = density(near);
  const amb_real d_far = density(far);
  const amb_real tail = d_far * mills(far);
  as.chance = (near > AMB_C(0.0)) ? (d_near * mills(near) - tail)
                                  : (AMB_C(1.0) - d_near * mills(-near) - tail);
  if (half < NARROW) {
    as.chance = amb_exp_negative(LEAVES / amb_at_least(kf->set.dwell, AMB_C(1.0)));
    return as;
  }
  const amb_real shift = (d_near - d_far) / as.chance;
  const amb_real less =
      amb_clamp(shift * shift - (near * d_near - far * d_far) / as.chance, LEAST, AMB_C(1.0));
  as.moved = ((e < AMB_C(0.0)) ? -s : s) * (shift / less) - e;
  as.noise = noise + S * ((AMB_C(1.0) - less) / less);
  return as;
}

amb_rounded amb_kalman_edge(const amb_kalman *kf, int r, amb_real e, amb_real change,
                            amb_real shown, amb_real noise)
{
  const amb_real step = kf->set.step[r];
  const amb_real size = amb_magnitude(change);
  const amb_real least = (step * step) / AMB_C(12.0);
  amb_rounded as = {AMB_C(0.0), noise + least, AMB_C(0.0)};
  if ((AMB_C(0.5) * step < size) && (size < AMB_C(1.5) * step)) {
    const amb_real to = (change < AMB_C(0.0)) ? AMB_C(-1.0) : AMB_C(1.0);
    const amb_real beyond = amb_clamp(AMB_C(0.5) * step - to * e, AMB_C(0.0), step);
    as.moved = to * (AMB_C(0.5) * (beyond - step));
    as.noise = noise + (beyond * beyond) / AMB_C(12.0);
  } else if ((size <= AMB_C(0.5) * step) && (amb_magnitude(e) <= AMB_C(0.5) * step)) {
    const amb_real narrow = least / amb_at_least(shown, LEAST * least);
    as.noise += (REPEATED * kf->rounding[r]) * (narrow * narrow);
  } else { /* no information beyond the step itself */
  }
  return as;
}

amb_real amb_kalman_repeats(const amb_kalman *kf, int r, amb_real least_change, amb_real S)
{
  const amb_real step = kf->set.step[r];
  const amb_real var_y = kf->set.var_y[r];
  /* With more sensors than magnets, the other sensors can hold the rotor at rest within a step of
   * this one. */
  const bool spare = (step > AMB_C(0.0)) && (amb_sensors(&kf->model) > amb_forces(&kf->model));
  const amb_real leaves =
      spare ? AMB_C(0.0) : (AMB_C(1.0) / amb_at_least(kf->set.dwell, AMB_C(1.0)));
  const amb_real stays = AMB_C(1.0) - leaves;
  const amb_real square = amb_at_least(least_change, step * step);
  const amb_real variance = amb_at_least(S, LEAST_NOISE * var_y);
  const bool fine = (square / AMB_COARSE) <= variance;
  const bool known = (square >= AMB_C(0.0)) && (square <= (AMB_VERY_COARSE * var_y));
  if (!known || (!fine && !(step > AMB_C(0.0)))) {
    return stays;
  }
  const amb_real wide = (AMB_C(0.15915494309189535) * square) / variance; /* 1 / (2 pi) */
  const amb_real within = amb_root(AMB_C(1.0) - amb_exp_negative(wide));
  /* In a coarse step both the rotor and the noise must have left the measurement within it. */
  return fine ? amb_at_most(within, stays) : (within * stays);
}

amb_real amb_kalman_rests(const amb_kalman *kf, int r, amb_real least_change, amb_real noise,
                          amb_real chance)
{
  const amb_real repeats = amb_kalman_repeats(kf, r, least_change, noise);
  const amb_real leaves = amb_exp_negative(LEAVES / amb_at_least(kf->set.dwell, AMB_C(1.0)));
  return amb_at_least(chance, amb_at_most(repeats, leaves));
}

amb_status amb_kalman_init(amb_kalman *kf, const amb_model *model, const amb_kalman_settings *s)
{
  if (!good_settings(model, s)) {
    return AMB_BAD_PARAMETER;
  }
  kf->set = *s;
  kf->model = *model;
  for (int r = 0; r < amb_sensors(model); r++) {
    kf->far[r] = amb_magnitude(AMB_FAR * s->travel[r] * s->K_sen[r]);
    kf->rounding[r] = (s->step[r] * s->step[r]) / AMB_C(12.0);
    if (amb_step_coarse(kf, r, AMB_VERY_COARSE)) {
      kf->rounding[r] *= amb_at_least(s->dwell, AMB_C(1.0));
    }
  }
  kf->gate_squared = s->gate * s->gate;
  for (int i = 0; i < amb_states(model); i++) {
    kf->widest[i] = s->cap[i] * s->cap[i];
  }
  int entry = 0;
  for (int i = 0; i < amb_states(model); i++) {
    for (int j = i; j < amb_states(model); j++) {
      kf->most[entry] = (AMB_BOUNDLESS * s->cap[i]) * (AMB_BOUNDLESS * s->cap[j]);
      entry++;
    }
  }
  amb_model_growth(model, s->var_d, kf->growth);
  return AMB_OK;
}

/* Limited to the physical maximum, and from below to the precision of the number type. */
static amb_real variance_at_start(amb_real std, amb_real cap)
{
  const amb_real least = (AMB_ROOT_EPSILON * AMB_ROOT_EPSILON) * cap;
  const amb_real taken = amb_clamp(std, least, cap);
  return taken * taken;
}

amb_status amb_kalman_reset(const amb_kalman *kf, amb_kalman_state *state,
                            const amb_real mean[AMB_STATES], const amb_real std[AMB_STATES])
{
  const int n = amb_states(&kf->model);
  for (int i = 0; i < n; i++) {
    if (!amb_is_finite(mean[i]) || ((std != NULL) && !amb_is_positive(std[i]))) {
      return AMB_BAD_PARAMETER;
    }
  }
  const bool near = amb_envelope_within(kf, AMB_ASTRAY, mean);
  amb_envelope_open(kf, state->cov);
  int entry = 0;
  for (int i = 0; i < n; i++) {
    state->mean[i] = near ? mean[i] : AMB_C(0.0);
    for (int j = i; j < n; j++) {
      if (near && (std != NULL)) {
        state->cov[entry] = (i == j) ? variance_at_start(std[i], kf->set.cap[i]) : AMB_C(0.0);
      }
      entry++;
    }
  }
  amb_clear(amb_controls(&kf->model), state->last_u);
  for (int r = 0; r < amb_sensors(&kf->model); r++) {
    /* Impossible as a measurement, so the first one does not count as a change. */
    const amb_sensor_state well = {AMB_C(2.0) * kf->far[r], AMB_C(0.0), AMB_C(0.0), AMB_C(1.0),
                                   kf->far[r] * kf->far[r], 0U,         0U};
    state->sensor[r] = well;
  }
  return AMB_OK;
}

void amb_kalman_stiffness(const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES],
                          const amb_real iu[AMB_CONTROLS], const amb_real mean[AMB_STATES],
                          amb_stiffness k[AMB_FORCES])
{
  amb_step_stiffnesses(kf, magnet, iu, mean, k);
}

amb_status amb_kalman_predict(const amb_kalman *kf, amb_kalman_state *state,
                              const amb_stiffness k[AMB_FORCES], const amb_real iu[AMB_CONTROLS])
{
  const amb_status status = amb_step_predict(kf, state, k, iu);
  return status | amb_step_contain(kf, state);
}

amb_status amb_kalman_update(const amb_kalman *kf, amb_kalman_state *state,
                             const amb_real y[AMB_SENSORS], amb_kalman_result *result)
{
  return amb_step_update_all(kf, state, y, result);
}
