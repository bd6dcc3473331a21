#include "ambkit/calibration.h"

#if !defined(AMB_MODEL_LOOPS)

static amb_real scaled_force(const void *self, amb_real iu, amb_real x)
{
  const amb_scaled *scaled = (const amb_scaled *)self;
  return scaled->scale * scaled->of.methods->force(scaled->of.self, iu, x);
}

static amb_stiffness scaled_by(const amb_scaled *scaled, amb_stiffness k)
{
  const amb_stiffness by = {scaled->scale * k.k_i, scaled->scale * k.k_s};
  return by;
}

static amb_stiffness scaled_through_origin(const void *self, amb_real iu, amb_real x)
{
  const amb_scaled *scaled = (const amb_scaled *)self;
  return scaled_by(scaled, scaled->of.methods->through_origin(scaled->of.self, iu, x));
}

static amb_stiffness scaled_tangent(const void *self, amb_real iu, amb_real x)
{
  const amb_scaled *scaled = (const amb_scaled *)self;
  return scaled_by(scaled, scaled->of.methods->tangent(scaled->of.self, iu, x));
}

static bool must_be_above_zero(int parameter)
{
  return (parameter == (int)AMB_VAR_Y) || (parameter == (int)AMB_GATE) ||
         (parameter == (int)AMB_MASS) || (parameter == (int)AMB_STRONG);
}

/* Which of the numbers cannot be, each by itself. */
static uint32_t refused(const amb_real wanted[AMB_PARAMETERS])
{
  uint32_t wrong = 0U;
  for (int n = 0; n < (int)AMB_PARAMETERS; n++) {
    const bool least = must_be_above_zero(n) ? (wanted[n] > AMB_C(0.0)) : (wanted[n] >= AMB_C(0.0));
    if (!least || !amb_is_finite(wanted[n])) {
      wrong |= (uint32_t)1U << (uint32_t)n;
    }
  }
  return wrong;
}

/* Work the numbers into the filter's constants. What is as it was exported is so to the last bit.
 */
static amb_status filter(const amb_calibration_base *base, const amb_real wanted[AMB_PARAMETERS],
                         amb_kalman *kf)
{
  const amb_kalman *exported = base->control->estimator->kf;
  const amb_real heavier = wanted[AMB_MASS] / base->exported[AMB_MASS];
  amb_kalman_settings set = exported->set;
  amb_model model;
  amb_model_init(&model, set.T, wanted[AMB_MASS], set.K_sen[0], set.lag[0]);
  if (base->as_printed) {
    amb_model_as_printed(&model);
  }
  set.var_y[0] = wanted[AMB_VAR_Y];
  set.var_u[0] = wanted[AMB_VAR_U];
  set.var_d[0] = wanted[AMB_VAR_D];
  set.gate = wanted[AMB_GATE];
  set.f_0[0] +=
      (base->carried * (heavier - AMB_C(1.0))) + (base->bias * (wanted[AMB_STRONG] - AMB_C(1.0)));
  for (int i = 0; i < amb_states(&model); i++) {
    if (amb_model_role(&model, i) == AMB_LOAD) {
      set.cap[i] *= heavier;
    }
  }
  return amb_kalman_init(kf, &model, &set);
}

static void controller(const amb_calibration_base *base, const amb_real wanted[AMB_PARAMETERS],
                       amb_calibration_set *set)
{
  const amb_controllers *exported = base->control->law;
  set->pid = exported->pid[0];
  set->pid.kp = wanted[AMB_KP];
  set->pid.ki = wanted[AMB_KI];
  set->pid.kd = wanted[AMB_KD];
  set->pid.T_f = wanted[AMB_T_F];
  set->pid.T_t = wanted[AMB_T_T];
  set->pid.weight = wanted[AMB_WEIGHT];
  set->law = *exported;
  set->law.pid = &set->pid;
}

/* A set whose parts point to each other. */
static void tie(const amb_calibration_base *base, amb_real strong, amb_calibration_set *set)
{
  static const amb_magnet_methods scaled_magnet = {scaled_force, scaled_through_origin,
                                                   scaled_tangent};
  const amb_estimator *exported = base->control->estimator;
  set->scaled.of = exported->magnet[0];
  set->scaled.scale = strong;
  set->magnet.methods = &scaled_magnet;
  set->magnet.self = &set->scaled;
  set->estimator = *exported;
  set->estimator.kf = &set->kf;
  set->estimator.magnet = &set->magnet;
  set->control = *base->control;
  set->control.estimator = &set->estimator;
  set->control.law = &set->law;
}

void amb_calibration_init(const amb_calibration_base *base, amb_calibration *calibration)
{
  for (int n = 0; n < (int)AMB_PARAMETERS; n++) {
    calibration->wanted[n] = base->exported[n];
    calibration->in_use[n] = base->exported[n];
  }
  calibration->request = 0U;
  calibration->answered = 0U;
  calibration->refused = 0U;
  calibration->flying = 0U;
}

const amb_control *amb_calibration_update(const amb_calibration_base *base,
                                          amb_calibration *calibration)
{
  if (calibration->request != calibration->answered) {
    const uint32_t request = calibration->request;
    const uint32_t idle = (calibration->flying == 1U) ? 2U : 1U;
    amb_calibration_set *set = &calibration->set[idle - 1U];
    amb_real wanted[AMB_PARAMETERS]; /* as they are now, whatever is written meanwhile */
    for (int n = 0; n < (int)AMB_PARAMETERS; n++) {
      wanted[n] = calibration->wanted[n];
    }
    uint32_t wrong = refused(wanted);
    if ((wrong == 0U) && (filter(base, wanted, &set->kf) != AMB_OK)) {
      wrong = UINT32_MAX;
    }
    if (wrong == 0U) {
      controller(base, wanted, set);
      tie(base, wanted[AMB_STRONG], set);
      for (int n = 0; n < (int)AMB_PARAMETERS; n++) {
        calibration->in_use[n] = wanted[n];
      }
      calibration->flying = idle;
    }
    calibration->refused = wrong;
    calibration->answered = request;
  }
  return (calibration->flying == 0U) ? base->control
                                     : &calibration->set[calibration->flying - 1U].control;
}

#else
/* The matrices of any model are given, and what they were made from is not known here. */
typedef int amb_calibration_is_of_the_built_in_model;
#endif
