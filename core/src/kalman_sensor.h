/* Health of a sensor, and the noise of its measurements. */
#ifndef AMBKIT_KALMAN_SENSOR_H
#define AMBKIT_KALMAN_SENSOR_H

#include "ambkit/kalman.h"

/* Whether the square of the quantisation step exceeds this multiple of the noise variance:
 * AMB_COARSE and the following constants. */
AMB_INLINE bool amb_step_coarse(const amb_kalman *kf, int r, amb_real than)
{
  return (kf->set.step[r] * kf->set.step[r]) > (than * kf->set.var_y[r]);
}

/* Square of the smallest recent change, updated with a change of this square; with slow forgetting
 * [m^2]. */
AMB_INLINE amb_real amb_step_least_change(const amb_kalman *kf, int r, amb_real before,
                                          amb_real square)
{
  const amb_real grown = before * (AMB_C(1.0) + AMB_C(2.0) / AMB_MEMORY);
  return amb_at_least(amb_at_most(square, grown), AMB_FINEST * kf->set.var_y[r]);
}

/* Counts repeated measurements, and the probability of so many for a healthy sensor. */
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
  if (!AMB_WITHIN(sensor->chance, AMB_C(1.0))) { /* a bit in memory has flipped */
    sensor->chance = AMB_C(1.0);
  }
  if (sensor->chance > AMB_IMPROBABLE) {
    sensor->chance *= chance;
  }
}

/* Whether a measurement has been repeated too often for a healthy sensor. */
AMB_INLINE bool amb_step_frozen(const amb_kalman *kf, const amb_sensor_state *sensor)
{
  return (kf->set.frozen_limit > 0U) && (sensor->unchanged >= kf->set.frozen_limit) &&
         (sensor->chance <= AMB_IMPROBABLE);
}

/* The measurement y of sensor r if it is a possible position, else 0: bounded for any input. */
AMB_INLINE amb_real amb_step_seen(const amb_kalman *kf, int r, amb_real y)
{
  return AMB_WITHIN(y, kf->far[r]) ? y : AMB_C(0.0);
}

/* AMB_MISSING or AMB_FROZEN, if the measurement y of sensor r carries no information. */
AMB_INLINE amb_status amb_step_useless(const amb_kalman *kf, const amb_kalman_state *state, int r,
                                       amb_real y)
{
  if (!AMB_WITHIN(y, kf->far[r])) {
    return AMB_MISSING;
  }
  return amb_step_frozen(kf, &state->sensor[r]) ? AMB_FROZEN : AMB_OK;
}

/* Variance of the noise of sensor r [m^2] at a mean of the states, without rounding. */
AMB_INLINE amb_real amb_step_noise(const amb_kalman *kf, int r, const amb_real mean[AMB_STATES])
{
  const amb_real rise = kf->set.rise[r];
  if (rise == AMB_C(0.0)) { /* the usual case */
    return kf->set.var_y[r];
  }
  const amb_real share = amb_noise_share(rise, amb_model_shown(&kf->model, r, mean));
  return (kf->set.var_y[r] * share) * share;
}

/* The same for all sensors, at the same prediction. */
AMB_INLINE void amb_step_noises(const amb_kalman *kf, const amb_real mean[AMB_STATES],
                                amb_real noise[AMB_SENSORS])
{
  AMB_EACH_SENSOR(&kf->model)
  {
    noise[r] = amb_step_noise(kf, r, mean);
  }
}

/* Whether the measurement with innovation e continues the last accepted one. A sudden load moves
 * the rotor off its prediction faster than a slow filter follows, but steadily; a faulty reading
 * jumps. */
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

/* Whether an innovation e of variance S is AMB_OUTLIER. Only a limited number in a row are; beyond
 * it the estimate must be wrong, AMB_RESTARTED. */
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

/* Whether recent innovations were larger than expected. */
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

#endif
