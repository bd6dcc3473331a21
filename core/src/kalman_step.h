/* The parts of a filter step, inline: a whole record becomes one loop with its state in registers,
 * and an exported filter one function. Callers elsewhere use the same functions through
 * ambkit/kalman.h. */
#ifndef AMBKIT_KALMAN_STEP_H
#define AMBKIT_KALMAN_STEP_H

#include "kalman_prediction.h"
#include "kalman_sensor.h"

/* Output of an update besides the state. */
typedef struct amb_step_innovation {
  amb_real innovation; /* [m]; 0 if the measurement was not used, except for an outlier */
  amb_real variance;   /* of the innovation [m^2] */
} amb_step_innovation;

/* Update with the measurement y [m] of sensor r, of variance noise [m^2]. */
AMB_INLINE amb_status amb_step_update(const amb_kalman *kf, amb_kalman_state *state, int r,
                                      amb_real y, amb_real noise, amb_step_innovation *e)
{
  const amb_model *model = &kf->model;
  amb_sensor_state *sensor = &state->sensor[r];
  amb_real before[AMB_STATES];
  const amb_real shown = amb_model_shown_variance(model, r, state->cov);
  amb_model_variances(model, state->cov, before);
  e->innovation = AMB_C(0.0);
  e->variance = shown + noise;
  /* Repeated here because the proof does not see it elsewhere. */
  if (!AMB_WITHIN(y, kf->far[r])) {
    return AMB_MISSING;
  }
  if (amb_step_frozen(kf, sensor)) {
    return AMB_FROZEN;
  }
  /* At least half of the digits of a variance must remain: after an outage, a sensor much more
   * accurate than the estimate corrects it in several steps. */
  const amb_real least = AMB_ROOT_EPSILON * shown;
  const bool sharp = !(least <= noise);
  const amb_real var_y = (least <= noise) ? noise : least;
  e->variance = shown + var_y;
  if ((shown > AMB_C(0.0)) && (!sharp || amb_is_finite(e->variance))) {
    const amb_real S = shown + var_y;
    const amb_real innovation = y - amb_model_shown(model, r, state->mean);
    const amb_status inconsistent = amb_step_inconsistent(sensor, innovation, S);
    const amb_status outlier = amb_step_outlier(kf, sensor, r, innovation, S);
    if (outlier != AMB_OK) {
      e->innovation = innovation;
      if (outlier == AMB_RESTARTED) {
        amb_kalman_state fresh; /* a copy, as in amb_step_contain */
        fresh = *state;
        amb_envelope_restart(kf, &fresh, r, y);
        *state = fresh;
      }
      return inconsistent | outlier;
    }
    amb_model_update(model, r, y, S, state->mean, state->cov, &e->innovation);
    sensor->residual = y - amb_model_shown(model, r, state->mean);
    if (amb_model_sound(model, state->cov)) {
      return inconsistent;
    }
  }
  /* By rounding, a nearly singular covariance may become indefinite. The filter continues with the
   * variances, without correlations. */
  amb_model_uncorrelated(model, before, state->cov);
  return AMB_BAD_VARIANCE;
}

/* The equivalent of the measurement y [m] of sensor r without quantisation, for noise of this
 * variance [m^2], if the filter can use it; counts repetitions. */
AMB_INLINE amb_rounded amb_step_rounded(const amb_kalman *kf, amb_kalman_state *base, int r,
                                        amb_real y, amb_real noise, bool interval)
{
  amb_sensor_state *sensor = &base->sensor[r];
  amb_rounded as = {AMB_C(0.0), noise + kf->rounding[r], AMB_C(0.0)};
  if (!AMB_WITHIN(y, kf->far[r])) {
    return as;
  }
  const bool again = !((y < sensor->last_y) || (y > sensor->last_y));
  const bool very = amb_step_coarse(kf, r, AMB_VERY_COARSE);
  const bool coarse = very || (interval && amb_step_coarse(kf, r, AMB_COARSE));
  const bool stays = amb_step_coarse(kf, r, AMB_STAYING);
  if (coarse) {
    const amb_real shown = amb_model_shown_variance(&kf->model, r, base->cov);
    const amb_real e = y - amb_model_shown(&kf->model, r, base->mean);
    if (AMB_WITHIN(e, AMB_REAL_ROOT) && (shown > AMB_C(0.0)) && (shown <= AMB_REAL_ROOT)) {
      as = very ? amb_kalman_edge(kf, r, e, y - sensor->last_y, shown, noise)
                : amb_kalman_rounded(kf, r, e, shown, noise);
    }
  }
  if (again) {
    const amb_real least = sensor->least_change;
    if (coarse && !stays) {
      as.chance = amb_kalman_rests(kf, r, least, noise, as.chance);
    } else { /* the variance of an observer does not bound the motion of a rotor at rest */
      const amb_real shown =
          (interval && !stays) ? amb_model_shown_variance(&kf->model, r, base->cov) : AMB_C(0.0);
      as.chance = amb_kalman_repeats(kf, r, least, shown + noise);
    }
  }
  amb_step_watch(kf, sensor, r, y, as.chance);
  return as;
}

/* Update of an estimator kind with the measurement y [m] of sensor r, of variance noise [m^2]; own:
 * data of the kind, of: its state and anything else that it updates. */
typedef amb_status (*amb_step_one)(const amb_kalman *kf, const void *own, void *of, int r,
                                   amb_real y, amb_real noise, amb_step_innovation *e);

/* Update with all sensors in sequence; base: part of the kind's state. Writes the result except
 * stiffnesses and status; returns the status. */
AMB_INLINE amb_status amb_step_each(amb_step_one take_in, const amb_kalman *kf, const void *own,
                                    void *of, amb_kalman_state *base, bool interval,
                                    const amb_real y[AMB_SENSORS], amb_kalman_result *result)
{
  amb_status all = AMB_OK;
  amb_real noise[AMB_SENSORS];
  amb_step_noises(kf, base->mean, noise);
  AMB_EACH_SENSOR(&kf->model)
  {
    amb_step_innovation e;
    const amb_rounded as = amb_step_rounded(kf, base, r, y[r], noise[r], interval);
    const amb_status status = take_in(kf, own, of, r, y[r] + as.moved, as.noise, &e);
    const bool measured = (status & (AMB_MISSING | AMB_FROZEN)) == AMB_OK;
    result->innovation[r] = measured ? (e.innovation - as.moved) : e.innovation;
    result->variance[r] = e.variance - (as.noise - (noise[r] + kf->rounding[r]));
    result->health[r] = status;
    all |= status;
  }
  return all;
}

/* Update of the filters whose state is an amb_kalman_state. */
AMB_INLINE amb_status amb_step_plain(const amb_kalman *kf, const void *own, void *of, int r,
                                     amb_real y, amb_real noise, amb_step_innovation *e)
{
  (void)own;
  return amb_step_update(kf, (amb_kalman_state *)of, r, y, noise, e);
}

AMB_INLINE amb_status amb_step_update_all(const amb_kalman *kf, amb_kalman_state *state,
                                          const amb_real y[AMB_SENSORS], amb_kalman_result *result)
{
  return amb_step_each(amb_step_plain, kf, NULL, state, state, true, y, result);
}

/* Whether a sample is informative for parameters: a measurement was used, and nothing was
 * restarted. */
AMB_INLINE bool amb_step_informative(const amb_model *model, const amb_kalman_result *result)
{
  bool measured = false;
  amb_status all = AMB_OK;
  for (int r = 0; r < amb_sensors(model); r++) {
    measured = measured || ((result->health[r] & AMB_UNINFORMATIVE) == AMB_OK);
    all |= result->health[r];
  }
  return measured && ((all & (AMB_RESTARTED | AMB_BAD_VARIANCE)) == AMB_OK);
}

/* Prediction with the control currents iu [A] that acted, then update with the measurements y [m];
 * adds to `status` and returns it. A local copy of the state stays in registers. Each exit writes
 * its own results, which keeps the usual path free of moves. */
AMB_INLINE amb_status amb_step_with(const amb_kalman *kf, const amb_stiffness k[AMB_FORCES],
                                    const amb_real iu[AMB_CONTROLS], amb_kalman_state *state,
                                    const amb_real y[AMB_SENSORS], amb_status status,
                                    amb_kalman_result *result)
{
  AMB_EACH_FORCE(&kf->model)
  {
    result->stiffness[f] = k[f];
  }
#if defined(AMB_MODEL_LOOPS) /* too many states for registers */
  const amb_status held = amb_kalman_predict(kf, state, k, iu);
  result->status = status | held | amb_kalman_update(kf, state, y, result);
  return result->status;
#else
  amb_kalman_state s;
  s = *state;
  s.last_u[0] = state->last_u[0]; /* named, or compilers copy the complete struct through memory */
  const amb_status predicted = amb_step_predict(kf, &s, k, iu);
  if ((predicted != AMB_OK) || amb_step_is_lost(kf, &s)) {
    *state = s;
    const amb_status held = predicted | amb_step_contain(kf, state);
    result->status = status | held | amb_kalman_update(kf, state, y, result);
    return result->status;
  }
  const amb_status all = status | amb_step_update_all(kf, &s, y, result);
  *state = s;
  result->status = all;
  return all;
#endif
}

/* A step without checks, for valid input: y are measurements, u is finite and within the
 * amplifiers' limits. Where the checked step raises no flag, mean and covariance have the same
 * bits. */
AMB_INLINE void amb_step_trusted(const amb_kalman *kf, const amb_stiffness k[AMB_FORCES],
                                 amb_kalman_state *state, const amb_real y[AMB_SENSORS],
                                 const amb_real iu[AMB_CONTROLS])
{
  const amb_kalman_settings *set = &kf->set;
  amb_real F[AMB_FORCES];
  amb_real noise[AMB_SENSORS];
  amb_real innovation;
  AMB_EACH_FORCE(&kf->model)
  {
    F[f] = amb_step_linear(kf, k[f], f, iu, state->mean);
  }
  amb_model_predict_mean(&kf->model, F, iu, state->mean);
  amb_step_noises(kf, state->mean, noise);
  amb_model_predict_covariance(&kf->model, k, set->k_ui, set->var_u, kf->growth, state->cov,
                               AMB_ROOM(state));
  AMB_EACH_SENSOR(&kf->model)
  {
    amb_rounded as = {AMB_C(0.0), noise[r] + kf->rounding[r], AMB_C(0.0)};
    if (amb_step_coarse(kf, r, AMB_COARSE)) {
      as = amb_step_rounded(kf, state, r, y[r], noise[r], true);
    }
    const amb_real S = amb_model_shown_variance(&kf->model, r, state->cov) + as.noise;
    const amb_real near = y[r] + as.moved;
    amb_model_update(&kf->model, r, near, S, state->mean, state->cov, &innovation);
  }
}

#endif
