/* The pieces of a step, inline: a whole record becomes one loop whose state stays in registers, and
 * an exported filter one function. Elsewhere the functions of ambkit/kalman.h serve, which are
 * these.
 */
#ifndef AMBKIT_KALMAN_STEP_H
#define AMBKIT_KALMAN_STEP_H

#include "ambkit/envelope.h"

/* Room for a prediction. Straight-line models need none, and what a state does not have cannot keep
 * it from living in registers. */
#if defined(AMB_MODEL_LOOPS)
#define AMB_ROOM(state) ((state)->work)
#else
#define AMB_ROOM(state) NULL
#endif

/* Control current of amplifier c [A]; adds what happened to `status`. */
AMB_INLINE amb_real amb_step_current(const amb_kalman *kf, amb_kalman_state *state, int c,
                                     amb_real u, amb_status *status)
{
  const amb_kalman_settings *set = &kf->set;
  const bool near = AMB_WITHIN(u, AMB_REAL_ROOT); /* a number, and one that can be multiplied */
  amb_real iu = near ? (set->k_ui[c] * u) : AMB_C(0.0);
  if (near && (iu >= set->iu_min[c]) && (iu <= set->iu_max[c])) {
    state->last_u[c] = u;
  } else {                             /* not finite, or more than there is */
    if (AMB_WITHIN(u, AMB_REAL_MAX)) { /* finite; proofs follow no call */
      state->last_u[c] = amb_clamp(u, -AMB_REAL_ROOT, AMB_REAL_ROOT);
    } else {
      *status |= AMB_BAD_CONTROL;
    }
    const amb_real asked = set->k_ui[c] * state->last_u[c];
    iu = amb_clamp(asked, set->iu_min[c], set->iu_max[c]);
    if ((iu < asked) || (iu > asked)) {
      *status |= AMB_SATURATED;
    }
  }
  return iu;
}

AMB_INLINE amb_status amb_step_currents(const amb_kalman *kf, amb_kalman_state *state,
                                        const amb_real u[AMB_CONTROLS], amb_real iu[AMB_CONTROLS])
{
  amb_status status = AMB_OK;
  AMB_EACH_CONTROL(&kf->model)
  {
    iu[c] = amb_step_current(kf, state, c, u[c], &status);
  }
  return status;
}

/* Without measurements the estimate runs away, and most magnets have a pole in the air gap: they
 * are asked where the rotor can be, between the stops. i [A], s [m]: means over the sample. */
AMB_INLINE amb_stiffness amb_step_ask(const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES],
                                      int f, amb_real i, amb_real s)
{
  const amb_real x_max = kf->set.x_max[f];
  return magnet[f].methods->through_origin(magnet[f].self, i, amb_clamp(s, -x_max, x_max));
}

/* The same of all magnets. */
AMB_INLINE void amb_step_ask_all(const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES],
                                 const amb_real iu[AMB_CONTROLS], const amb_real mean[AMB_STATES],
                                 amb_stiffness k[AMB_FORCES])
{
  AMB_EACH_FORCE(&kf->model)
  {
    const amb_real s = amb_model_displacement(&kf->model, f, mean);
    k[f] = amb_step_ask(kf, magnet, f, amb_model_current(&kf->model, f, mean, iu), s);
  }
}

/* Force of magnet f [N] and its tangents, asked between the stops and continued along the tangent
 * beyond them. */
AMB_INLINE amb_real amb_step_force(const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES], int f,
                                   amb_real i, amb_real s, amb_stiffness *tangent)
{
  const amb_magnet *m = &magnet[f];
  const amb_real near = amb_clamp(s, -kf->set.x_max[f], kf->set.x_max[f]);
  *tangent = m->methods->tangent(m->self, i, near);
  return m->methods->force(m->self, i, near) + tangent->k_s * (s - near);
}

/* Forces of all magnets [N] and their tangents at a mean of the states. */
AMB_INLINE void amb_step_forces(const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES],
                                const amb_real iu[AMB_CONTROLS], const amb_real mean[AMB_STATES],
                                amb_real F[AMB_FORCES], amb_stiffness k[AMB_FORCES])
{
  AMB_EACH_FORCE(&kf->model)
  {
    const amb_real i = amb_model_current(&kf->model, f, mean, iu);
    F[f] = amb_step_force(kf, magnet, f, i, amb_model_displacement(&kf->model, f, mean), &k[f]);
  }
}

/* Stiffnesses from arrays of all samples, at sample k. */
AMB_INLINE void amb_step_given(const amb_kalman *kf, const amb_real *k_i, const amb_real *k_s,
                               size_t k, amb_stiffness stiffness[AMB_FORCES])
{
  const size_t p = (size_t)amb_forces(&kf->model);
  for (size_t f = 0; f < p; f++) {
    stiffness[f].k_i = k_i[k * p + f];
    stiffness[f].k_s = k_s[k * p + f];
  }
}

/* Prediction with the forces F [N] that the magnets and what else is known exert; k carries the
 * covariance. The plant is unstable: without measurements mean and covariance grow, and what they
 * have become is contained afterwards. */
AMB_INLINE amb_status amb_step_predict_with(const amb_kalman *kf, amb_kalman_state *state,
                                            const amb_real F[AMB_FORCES],
                                            const amb_stiffness k[AMB_FORCES],
                                            const amb_real iu[AMB_CONTROLS])
{
  const amb_kalman_settings *s = &kf->set;
  AMB_EACH_FORCE(&kf->model)
  {
    if (!AMB_WITHIN(F[f], AMB_REAL_ROOT)) { /* as good as not finite */
      return AMB_BAD_PARAMETER;
    }
  }
  amb_model_predict_mean(&kf->model, F, iu, state->mean);
  amb_model_predict_covariance(&kf->model, k, s->k_ui, s->var_u, kf->growth, state->cov,
                               AMB_ROOM(state));
  return AMB_OK;
}

/* Force of the linear law (eq. 17) at magnet f and what else is known [N]. */
AMB_INLINE amb_real amb_step_linear(const amb_kalman *kf, amb_stiffness k, int f,
                                    const amb_real iu[AMB_CONTROLS],
                                    const amb_real mean[AMB_STATES])
{
  const amb_real i = amb_model_current(&kf->model, f, mean, iu);
  const amb_real s = amb_model_displacement(&kf->model, f, mean);
  return k.k_i * i + k.k_s * s + kf->set.f_0[f];
}

/* The prediction with the forces of the linear law. */
AMB_INLINE amb_status amb_step_predict(const amb_kalman *kf, amb_kalman_state *state,
                                       const amb_stiffness k[AMB_FORCES],
                                       const amb_real iu[AMB_CONTROLS])
{
  amb_real F[AMB_FORCES];
  AMB_EACH_FORCE(&kf->model)
  {
    F[f] = amb_step_linear(kf, k[f], f, iu, state->mean);
  }
  return amb_step_predict_with(kf, state, F, k, iu);
}

/* The mean alone one sample on, by the linear law and without noise. */
AMB_INLINE void amb_step_advance(const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES],
                                 amb_real scale, const amb_real iu[AMB_CONTROLS],
                                 amb_real mean[AMB_STATES])
{
  amb_real F[AMB_FORCES];
  AMB_EACH_FORCE(&kf->model)
  {
    const amb_real i = amb_model_current(&kf->model, f, mean, iu);
    const amb_real s = amb_model_displacement(&kf->model, f, mean);
    const amb_stiffness k = amb_step_ask(kf, magnet, f, i, s);
    F[f] = scale * (k.k_i * i + k.k_s * s) + kf->set.f_0[f];
  }
  amb_model_predict_mean(&kf->model, F, iu, mean);
}

/* What the linear transition makes of a column: of states, or of controls iu [A] alone, with what
 * is known besides of the forces [N]; NULL: nothing. */
AMB_INLINE void amb_step_carry(const amb_model *model, const amb_stiffness k[AMB_FORCES],
                               const amb_real known[AMB_FORCES], const amb_real iu[AMB_CONTROLS],
                               amb_real column[AMB_STATES])
{
  amb_real F[AMB_FORCES];
  for (int f = 0; f < amb_forces(model); f++) {
    const amb_real i = amb_model_current(model, f, column, iu);
    F[f] = k[f].k_i * i + k[f].k_s * amb_model_displacement(model, f, column);
    F[f] += (known != NULL) ? known[f] : AMB_C(0.0);
  }
  amb_model_predict_mean(model, F, iu, column);
}

/* Whether a position is known no better than the travel, or not at all. */
AMB_INLINE bool amb_step_is_lost(const amb_kalman *kf, const amb_kalman_state *state)
{
  return !amb_model_known(&kf->model, state->cov, kf->widest);
}

/* After each prediction. The call has a copy, so that the state itself stays in registers. */
AMB_INLINE amb_status amb_step_contain(const amb_kalman *kf, amb_kalman_state *state)
{
  if (!amb_step_is_lost(kf, state)) {
    return AMB_OK;
  }
  amb_kalman_state held;
  held = *state;
  const amb_status status = amb_envelope_hold(kf, &held);
  *state = held;
  return status;
}

/* Whether the square of a step is more than so many times the variance of the noise: AMB_COARSE and
 * what follows it. */
AMB_INLINE bool amb_step_coarse(const amb_kalman *kf, int r, amb_real than)
{
  return (kf->set.step[r] * kf->set.step[r]) > (than * kf->set.var_y[r]);
}

/* Square of the smallest change of late, after one of this square; forgets slowly [m^2]. */
AMB_INLINE amb_real amb_step_least_change(const amb_kalman *kf, int r, amb_real before,
                                          amb_real square)
{
  const amb_real grown = before * (AMB_C(1.0) + AMB_C(2.0) / AMB_MEMORY);
  return amb_at_least(amb_at_most(square, grown), AMB_FINEST * kf->set.var_y[r]);
}

/* Counts equal measurements, and how probable they are of a sensor that shows the rotor. */
AMB_INLINE void amb_step_watch(const amb_kalman *kf, amb_sensor_state *sensor, int r, amb_real y,
                               amb_real chance)
{
  if ((y < sensor->last_y) || (y > sensor->last_y)) {
    const amb_real change = y - sensor->last_y;
    sensor->least_change = amb_step_least_change(kf, r, sensor->least_change, change * change);
    sensor->last_y = y;
    sensor->unchanged = 0U;
    sensor->chance = AMB_C(1.0);
    return;
  }
  if (sensor->unchanged < kf->set.frozen_limit) {
    sensor->unchanged++;
  }
  if (!AMB_WITHIN(sensor->chance, AMB_C(1.0))) { /* a bit has flipped */
    sensor->chance = AMB_C(1.0);
  }
  if (sensor->chance > AMB_IMPROBABLE) {
    sensor->chance *= chance;
  }
}

/* Whether so many equal measurements are too many in a row. */
AMB_INLINE bool amb_step_frozen(const amb_kalman *kf, const amb_sensor_state *sensor)
{
  return (kf->set.frozen_limit > 0U) && (sensor->unchanged >= kf->set.frozen_limit) &&
         (sensor->chance <= AMB_IMPROBABLE);
}

/* The measurement y of sensor r where it can be the rotor, else 0: within bounds whatever it is.
 */
AMB_INLINE amb_real amb_step_seen(const amb_kalman *kf, int r, amb_real y)
{
  return AMB_WITHIN(y, kf->far[r]) ? y : AMB_C(0.0);
}

/* AMB_MISSING or AMB_FROZEN, where the measurement y of sensor r says nothing. */
AMB_INLINE amb_status amb_step_useless(const amb_kalman *kf, const amb_kalman_state *state, int r,
                                       amb_real y)
{
  if (!AMB_WITHIN(y, kf->far[r])) {
    return AMB_MISSING;
  }
  return amb_step_frozen(kf, &state->sensor[r]) ? AMB_FROZEN : AMB_OK;
}

/* Variance of the noise of sensor r [m^2] where a mean of the states has the rotor, before it is
 * rounded. */
AMB_INLINE amb_real amb_step_noise(const amb_kalman *kf, int r, const amb_real mean[AMB_STATES])
{
  const amb_real rise = kf->set.rise[r];
  if (rise == AMB_C(0.0)) { /* nearly every sensor */
    return kf->set.var_y[r];
  }
  const amb_real share = amb_noise_share(rise, amb_model_shown(&kf->model, r, mean));
  return (kf->set.var_y[r] * share) * share;
}

/* The same for all sensors, which all measure the rotor of one prediction. */
AMB_INLINE void amb_step_noises(const amb_kalman *kf, const amb_real mean[AMB_STATES],
                                amb_real noise[AMB_SENSORS])
{
  AMB_EACH_SENSOR(&kf->model)
  {
    noise[r] = amb_step_noise(kf, r, mean);
  }
}

/* Whether the measurement of innovation e goes on from the last one that was taken in. A load that
 * sets in drives the rotor off its prediction faster than a quiet filter follows, but step by step;
 * what is no rotor jumps. */
AMB_INLINE bool amb_step_goes_on(const amb_kalman *kf, const amb_sensor_state *sensor, int r,
                                 amb_real e)
{
  const amb_real since = kf->set.T * ((amb_real)sensor->outliers + AMB_C(1.0));
  const amb_real pushed = AMB_SUDDEN * kf->set.K_sen[r] * since * since;
  const amb_real jump = e - sensor->residual;
  const amb_real var_y = kf->set.var_y[r] + kf->rounding[r];
  const amb_real most = AMB_C(2.0) * kf->gate_squared * var_y + pushed * pushed;
  return AMB_WITHIN(jump, AMB_REAL_ROOT) && ((jump * jump) <= most);
}

/* Whether an innovation e of variance S is AMB_OUTLIER. Only so many in a row are: the others say
 * that it is the estimate which is wrong, AMB_RESTARTED. */
AMB_INLINE amb_status amb_step_outlier(const amb_kalman *kf, amb_sensor_state *sensor, int r,
                                       amb_real e, amb_real S)
{
  if (!((e * e) > (kf->gate_squared * S)) || amb_step_goes_on(kf, sensor, r, e)) {
    sensor->outliers = 0U;
    return AMB_OK;
  }
  if (sensor->outliers < kf->set.outlier_limit) {
    sensor->outliers++;
    return AMB_OUTLIER;
  }
  return (kf->set.outlier_limit > 0U) ? AMB_RESTARTED : AMB_OK;
}

/* Whether innovations have been larger than expected for a while. */
AMB_INLINE amb_status amb_step_inconsistent(amb_sensor_state *sensor, amb_real e, amb_real S)
{
  const amb_real before = AMB_WITHIN(sensor->surprise, AMB_C(1.0)) ? sensor->surprise : AMB_C(0.0);
  amb_real share = before * (AMB_C(1.0) - AMB_C(1.0) / AMB_MEMORY);
  if ((e * e) > (AMB_C(4.0) * S)) {
    share += AMB_C(1.0) / AMB_MEMORY;
  }
  sensor->surprise = share;
  return (share > AMB_INCONSISTENT_SHARE) ? AMB_INCONSISTENT : AMB_OK;
}

/* What an update leaves behind besides the state. */
typedef struct amb_step_surprise {
  amb_real innovation; /* [m]; 0 where the measurement was not used, but told of an outlier */
  amb_real variance;   /* of the innovation [m^2] */
} amb_step_surprise;

/* Take in the measurement y [m] of sensor r, of variance noise [m^2]. */
AMB_INLINE amb_status amb_step_update(const amb_kalman *kf, amb_kalman_state *state, int r,
                                      amb_real y, amb_real noise, amb_step_surprise *e)
{
  const amb_model *model = &kf->model;
  amb_sensor_state *sensor = &state->sensor[r];
  amb_real before[AMB_STATES];
  const amb_real shown = amb_model_shown_variance(model, r, state->cov);
  amb_model_variances(model, state->cov, before);
  e->innovation = AMB_C(0.0);
  e->variance = shown + noise;
  /* In sight of what follows, or the proof does not see it. */
  if (!AMB_WITHIN(y, kf->far[r])) {
    return AMB_MISSING;
  }
  if (amb_step_frozen(kf, sensor)) {
    return AMB_FROZEN;
  }
  /* Of a variance at least half the digits must be left: after an outage, a sensor much sharper
   * than the estimate is believed step by step. */
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
  /* What rounding makes of a nearly singular covariance may have no root. Its variances have: the
   * filter goes on from these, and learns the correlations anew. */
  amb_model_uncorrelated(model, before, state->cov);
  return AMB_BAD_VARIANCE;
}

/* The measurement y [m] of sensor r as one that is not rounded, of a noise of this variance [m^2],
 * where the filter has use for that; counts how often it has come again. */
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
    } else { /* What an observer says of its variance is no bound of what a rotor at rest does. */
      const amb_real shown =
          (interval && !stays) ? amb_model_shown_variance(&kf->model, r, base->cov) : AMB_C(0.0);
      as.chance = amb_kalman_repeats(kf, r, least, shown + noise);
    }
  }
  amb_step_watch(kf, sensor, r, y, as.chance);
  return as;
}

/* How a kind takes in the measurement y [m] of sensor r, of variance noise [m^2]; own: what only
 * this kind has; of: its state, and whatever else it is to leave its mark on. */
typedef amb_status (*amb_step_one)(const amb_kalman *kf, const void *own, void *of, int r,
                                   amb_real y, amb_real noise, amb_step_surprise *e);

/* The measurements of all sensors, one after the other; base: of the kind's state. Writes all of
 * the result but its stiffnesses and its status, which it returns. */
AMB_INLINE amb_status amb_step_each(amb_step_one take_in, const amb_kalman *kf, const void *own,
                                    void *of, amb_kalman_state *base, bool interval,
                                    const amb_real y[AMB_SENSORS], amb_kalman_result *result)
{
  amb_status all = AMB_OK;
  amb_real noise[AMB_SENSORS];
  amb_step_noises(kf, base->mean, noise);
  AMB_EACH_SENSOR(&kf->model)
  {
    amb_step_surprise e;
    const amb_rounded as = amb_step_rounded(kf, base, r, y[r], noise[r], interval);
    const amb_status status = take_in(kf, own, of, r, y[r] + as.moved, as.noise, &e);
    const bool told = (status & (AMB_MISSING | AMB_FROZEN)) == AMB_OK;
    result->innovation[r] = told ? (e.innovation - as.moved) : e.innovation;
    result->variance[r] = e.variance - (as.noise - (noise[r] + kf->rounding[r]));
    result->health[r] = status;
    all |= status;
  }
  return all;
}

/* What the filters do whose state is an amb_kalman_state. */
AMB_INLINE amb_status amb_step_plain(const amb_kalman *kf, const void *own, void *of, int r,
                                     amb_real y, amb_real noise, amb_step_surprise *e)
{
  (void)own;
  return amb_step_update(kf, (amb_kalman_state *)of, r, y, noise, e);
}

AMB_INLINE amb_status amb_step_update_all(const amb_kalman *kf, amb_kalman_state *state,
                                          const amb_real y[AMB_SENSORS], amb_kalman_result *result)
{
  return amb_step_each(amb_step_plain, kf, NULL, state, state, true, y, result);
}

/* Whether parameters can be learned from what the sensors said of a sample: some were taken in, and
 * nothing began afresh. */
AMB_INLINE bool amb_step_tells(const amb_model *model, const amb_kalman_result *result)
{
  bool told = false;
  amb_status all = AMB_OK;
  for (int r = 0; r < amb_sensors(model); r++) {
    told = told || ((result->health[r] & AMB_UNTOLD) == AMB_OK);
    all |= result->health[r];
  }
  return told && ((all & (AMB_RESTARTED | AMB_BAD_VARIANCE)) == AMB_OK);
}

/* Prediction with the control currents iu [A] that acted, then measurements y [m]; adds to
 * `status`, and returns it. The state's own copy stays in registers. Each way out writes for
 * itself: so the usual one moves nothing about for the others. */
AMB_INLINE amb_status amb_step_with(const amb_kalman *kf, const amb_stiffness k[AMB_FORCES],
                                    const amb_real iu[AMB_CONTROLS], amb_kalman_state *state,
                                    const amb_real y[AMB_SENSORS], amb_status status,
                                    amb_kalman_result *result)
{
  AMB_EACH_FORCE(&kf->model)
  {
    result->stiffness[f] = k[f];
  }
#if defined(AMB_MODEL_LOOPS) /* no registers for so many */
  const amb_status held = amb_kalman_predict(kf, state, k, iu);
  result->status = status | held | amb_kalman_update(kf, state, y, result);
  return result->status;
#else
  amb_kalman_state s;
  s = *state;
  s.last_u[0] = state->last_u[0]; /* named, or compilers copy the whole through memory */
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

/* A step whose input the caller vouches for: y are measurements, u finite and within the
 * amplifiers' limits. Nothing is checked, and where the other step finds nothing to say this one
 * leaves the same mean and covariance, to the last bit. */
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
