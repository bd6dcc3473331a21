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

/* Which of the numbers are beyond their limits, or none. */
static uint32_t refused(const amb_calibration_base *base, const amb_real wanted[AMB_PARAMETERS])
{
  uint32_t wrong = 0U;
  for (int n = 0; n < (int)AMB_PARAMETERS; n++) {
    if (!((wanted[n] >= base->low[n]) && (wanted[n] <= base->high[n]))) {
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

static void copy(const amb_real from[AMB_PARAMETERS], amb_real to[AMB_PARAMETERS])
{
  for (int n = 0; n < (int)AMB_PARAMETERS; n++) {
    to[n] = from[n];
  }
}

uint32_t amb_calibration_sum(const amb_calibration_kept *kept)
{
  uint32_t sum = 0U;
  for (size_t i = 0U; i < (sizeof kept->of.word / sizeof kept->of.word[0]); i++) {
    sum = (31U * sum) + kept->of.word[i];
  }
  return sum;
}

/* Work a set out of numbers. Returns which of them cannot be. */
static uint32_t work(const amb_calibration_base *base, const amb_real numbers[AMB_PARAMETERS],
                     amb_calibration_kept *kept)
{
  amb_calibration_set *set = &kept->of.set;
  uint32_t wrong = refused(base, numbers);
  if ((wrong == 0U) && (filter(base, numbers, &set->kf) != AMB_OK)) {
    wrong = UINT32_MAX;
  }
  if (wrong == 0U) {
    controller(base, numbers, set);
    tie(base, numbers[AMB_STRONG], set);
    copy(numbers, set->numbers);
    kept->sum = amb_calibration_sum(kept);
  }
  return wrong;
}

static void fly(amb_calibration *calibration, uint32_t set)
{
  calibration->flying = set;
  calibration->copy[0] = set;
  calibration->copy[1] = set;
}

void amb_calibration_init(const amb_calibration_base *base, amb_calibration *calibration)
{
  copy(base->exported, calibration->wanted);
  copy(base->exported, calibration->in_use);
  calibration->request = 0U;
  calibration->answered = 0U;
  calibration->refused = 0U;
  fly(calibration, 0U);
}

const amb_control *amb_calibration_update(const amb_calibration_base *base,
                                          amb_calibration *calibration)
{
  const bool agree = calibration->flying == calibration->copy[0];
  const uint32_t kept = agree ? calibration->flying : calibration->copy[1];
  const uint32_t flying = (kept <= 2U) ? kept : 0U; /* more than one bit has flipped */
  const uint32_t idle = (flying == 1U) ? 2U : 1U;
  amb_calibration_kept *next = &calibration->kept[idle - 1U];
  fly(calibration, flying);
  if (calibration->request != calibration->answered) {
    const uint32_t request = calibration->request;
    amb_real wanted[AMB_PARAMETERS]; /* as they are now, whatever is written meanwhile */
    copy(calibration->wanted, wanted);
    calibration->refused = work(base, wanted, next);
    if (calibration->refused == 0U) {
      fly(calibration, idle);
    }
    calibration->answered = request;
  } else if ((flying != 0U) && (calibration->kept[flying - 1U].sum !=
                                amb_calibration_sum(&calibration->kept[flying - 1U]))) {
    fly(calibration, (work(base, calibration->in_use, next) == 0U) ? idle : 0U);
  } else { /* all is as it was */
  }
  if (calibration->flying == 0U) {
    copy(base->exported, calibration->in_use);
    return base->control;
  }
  const amb_calibration_set *set = &calibration->kept[calibration->flying - 1U].of.set;
  copy(set->numbers, calibration->in_use);
  return &set->control;
}

const amb_control *amb_calibration_flown(const amb_calibration_base *base, amb_works_by *works_by)
{
  const amb_control *control = amb_working_by(works_by, base->control);
  if (control != base->control) {
    const void *start = control; /* of what was kept */
    const amb_calibration_kept *kept = (const amb_calibration_kept *)start;
    control = (kept->sum == amb_calibration_sum(kept)) ? control : base->control;
  }
  return control;
}

#else
/* The matrices of any model are given, and what they were made from is not known here. */
typedef int amb_calibration_is_of_the_built_in_model;
#endif
