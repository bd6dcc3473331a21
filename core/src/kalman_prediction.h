/* Prediction of the Kalman filter: control currents, magnet forces, mean and covariance. */
#ifndef AMBKIT_KALMAN_PREDICTION_H
#define AMBKIT_KALMAN_PREDICTION_H

#include "ambkit/envelope.h"

/* Workspace of a prediction. Straight-line models need none, and a state without one can stay in
 * registers. */
#if defined(AMB_MODEL_LOOPS)
#define AMB_ROOM(state) ((state)->work)
#else
#define AMB_ROOM(state) NULL
#endif

/* Control current of amplifier c [A]; adds its flags to `status`. */
AMB_INLINE amb_real amb_step_current(const amb_kalman *kf, amb_kalman_state *state, int c,
                                     amb_real u, amb_status *status)
{
  const amb_kalman_settings *set = &kf->set;
  const bool near = AMB_WITHIN(u, AMB_REAL_ROOT); /* finite, and safe to multiply */
  amb_real iu = near ? (set->k_ui[c] * u) : AMB_C(0.0);
  if (near && (iu >= set->iu_min[c]) && (iu <= set->iu_max[c])) {
    state->last_u[c] = u;
  } else {                             /* not finite, or beyond the limits */
    if (AMB_WITHIN(u, AMB_REAL_MAX)) { /* finite; the proof does not follow a call */
      state->last_u[c] = amb_clamp(u, -AMB_REAL_ROOT, AMB_REAL_ROOT);
    } else {
      *status |= AMB_BAD_CONTROL;
    }
    const amb_real demanded = set->k_ui[c] * state->last_u[c];
    iu = amb_clamp(demanded, set->iu_min[c], set->iu_max[c]);
    if ((iu < demanded) || (iu > demanded)) {
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

/* Stiffnesses at magnet f. Without measurements the estimate diverges, and most force laws have a
 * pole in the air gap, so the displacement is limited to the stops. i [A], s [m]: means over the
 * sample. */
AMB_INLINE amb_stiffness amb_step_stiffness(const amb_kalman *kf,
                                            const amb_magnet magnet[AMB_FORCES], int f, amb_real i,
                                            amb_real s)
{
  const amb_real x_max = kf->set.x_max[f];
  return magnet[f].methods->through_origin(magnet[f].self, i, amb_clamp(s, -x_max, x_max));
}

/* The same for all magnets. */
AMB_INLINE void amb_step_stiffnesses(const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES],
                                     const amb_real iu[AMB_CONTROLS],
                                     const amb_real mean[AMB_STATES], amb_stiffness k[AMB_FORCES])
{
  AMB_EACH_FORCE(&kf->model)
  {
    const amb_real s = amb_model_displacement(&kf->model, f, mean);
    k[f] = amb_step_stiffness(kf, magnet, f, amb_model_current(&kf->model, f, mean, iu), s);
  }
}

/* Force of magnet f [N] and its tangents, evaluated between the stops and extrapolated linearly
 * beyond. */
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

/* Stiffnesses of sample k, from arrays over all samples. */
AMB_INLINE void amb_step_given(const amb_kalman *kf, const amb_real *k_i, const amb_real *k_s,
                               size_t k, amb_stiffness stiffness[AMB_FORCES])
{
  const size_t p = (size_t)amb_forces(&kf->model);
  for (size_t f = 0; f < p; f++) {
    stiffness[f].k_i = k_i[k * p + f];
    stiffness[f].k_s = k_s[k * p + f];
  }
}

/* Prediction with the total forces F [N], known ones included; k propagates the covariance. The
 * plant is unstable, so without measurements mean and covariance grow: call amb_step_contain
 * afterwards. */
AMB_INLINE amb_status amb_step_predict_with(const amb_kalman *kf, amb_kalman_state *state,
                                            const amb_real F[AMB_FORCES],
                                            const amb_stiffness k[AMB_FORCES],
                                            const amb_real iu[AMB_CONTROLS])
{
  const amb_kalman_settings *s = &kf->set;
  AMB_EACH_FORCE(&kf->model)
  {
    if (!AMB_WITHIN(F[f], AMB_REAL_ROOT)) { /* not finite, or too large to be squared */
      return AMB_BAD_PARAMETER;
    }
  }
  amb_model_predict_mean(&kf->model, F, iu, state->mean);
  amb_model_predict_covariance(&kf->model, k, s->k_ui, s->var_u, kf->growth, state->cov,
                               AMB_ROOM(state));
  return AMB_OK;
}

/* Force of the linear law (eq. 17) at magnet f, with the known forces [N]. */
AMB_INLINE amb_real amb_step_linear(const amb_kalman *kf, amb_stiffness k, int f,
                                    const amb_real iu[AMB_CONTROLS],
                                    const amb_real mean[AMB_STATES])
{
  const amb_real i = amb_model_current(&kf->model, f, mean, iu);
  const amb_real s = amb_model_displacement(&kf->model, f, mean);
  return k.k_i * i + k.k_s * s + kf->set.f_0[f];
}

/* Prediction with the forces of the linear law. */
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

/* Mean after one sample, by the linear law and without noise. */
AMB_INLINE void amb_step_advance(const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES],
                                 amb_real scale, const amb_real iu[AMB_CONTROLS],
                                 amb_real mean[AMB_STATES])
{
  amb_real F[AMB_FORCES];
  AMB_EACH_FORCE(&kf->model)
  {
    const amb_real i = amb_model_current(&kf->model, f, mean, iu);
    const amb_real s = amb_model_displacement(&kf->model, f, mean);
    const amb_stiffness k = amb_step_stiffness(kf, magnet, f, i, s);
    F[f] = scale * (k.k_i * i + k.k_s * s) + kf->set.f_0[f];
  }
  amb_model_predict_mean(&kf->model, F, iu, mean);
}

/* Linear transition of a column of states, with control currents iu [A] and known forces [N]; NULL:
 * none. */
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

/* Whether the standard deviation of any position exceeds the clearance. */
AMB_INLINE bool amb_step_is_lost(const amb_kalman *kf, const amb_kalman_state *state)
{
  return !amb_model_known(&kf->model, state->cov, kf->widest);
}

/* To be called after each prediction. It works on a copy, so that the state itself stays in
 * registers. */
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

#endif
