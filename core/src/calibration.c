#include "ambkit/calibration.h"

/* Bits of the kinds with a value beyond its limits, 0 if none. */
static uint32_t refused(const amb_calibration_base *base, const amb_real wanted[AMB_PARAMETERS])
{
  uint32_t wrong = 0U;
  for (int n = 0; n < base->parameters; n++) {
    if (!((wanted[n] >= base->low[n]) && (wanted[n] <= base->high[n]))) {
      wrong |= (uint32_t)1U << (uint32_t)base->kind[n];
    }
  }
  return wrong;
}

/* Destination of a value. */
static amb_real *place_of(int kind, int i, amb_kalman_settings *settings, amb_real *mass,
                          amb_calibration_set *set)
{
  amb_real *place = mass;
  if (kind == (int)AMB_VAR_Y) {
    place = &settings->var_y[i];
  } else if (kind == (int)AMB_VAR_U) {
    place = &settings->var_u[i];
  } else if (kind == (int)AMB_VAR_D) {
    place = &settings->var_d[i];
  } else if (kind == (int)AMB_GATE) {
    place = &settings->gate;
  } else if (kind == (int)AMB_STRONG) {
    place = &set->scaled[i].scale;
  } else if (kind == (int)AMB_KP) {
    place = &set->pid[i].kp;
  } else if (kind == (int)AMB_KI) {
    place = &set->pid[i].ki;
  } else if (kind == (int)AMB_KD) {
    place = &set->pid[i].kd;
  } else if (kind == (int)AMB_T_F) {
    place = &set->pid[i].T_f;
  } else if (kind == (int)AMB_T_T) {
    place = &set->pid[i].T_t;
  } else if (kind == (int)AMB_WEIGHT) {
    place = &set->pid[i].weight;
  } else { /* AMB_MASS */
  }
  return place;
}

static bool drives_a_load(const amb_model *model, int noise)
{
  bool drives = false;
  for (int i = 0; i < amb_states(model); i++) {
    const bool load = amb_model_role(model, i) == AMB_LOAD;
    drives = drives || (load && amb_model_drives(model, noise, i));
  }
  return drives;
}

/* Under forces scaled by the mass ratio `heavier` the rotor moves as the exported one: the model is
 * unchanged, and disturbance forces are in units of `heavier`. With unchanged values all constants
 * keep their bits. */
static void weigh(const amb_calibration_base *base, amb_real heavier, amb_kalman_settings *settings,
                  amb_scaled scaled[AMB_FORCES])
{
  const amb_model *model = &base->control->estimator->kf->model;
  for (int f = 0; f < amb_forces(model); f++) {
    const amb_real more = (base->carried[f] * (heavier - AMB_C(1.0))) +
                          (base->bias[f] * (scaled[f].scale - AMB_C(1.0)));
    settings->f_0[f] = (settings->f_0[f] + more) / heavier;
    scaled[f].scale /= heavier;
  }
  for (int k = 0; k < amb_noises(model); k++) {
    settings->var_d[k] /= drives_a_load(model, k) ? (heavier * heavier) : AMB_C(1.0);
  }
}

/* Writes the values into the constants of filter and controllers. */
static amb_status take(const amb_calibration_base *base, const amb_real wanted[AMB_PARAMETERS],
                       amb_calibration_set *set)
{
  const amb_kalman *exported = base->control->estimator->kf;
  const amb_controllers *law = base->control->law;
  amb_kalman_settings settings = exported->set;
  amb_real mass = base->mass;
  for (int f = 0; f < amb_forces(&exported->model); f++) {
    set->scaled[f].of = base->control->estimator->magnet[f];
    set->scaled[f].scale = AMB_C(1.0);
  }
  for (int j = 0; j < law->pids; j++) {
    set->pid[j] = law->pid[j];
  }
  for (int n = 0; n < base->parameters; n++) {
    const int i = (int)base->index[n];
    *place_of((int)base->kind[n], i, &settings, &mass, set) = wanted[n];
  }
  const amb_real heavier = mass / base->mass;
  weigh(base, heavier, &settings, set->scaled);
  set->control = *base->control;
  set->control.excess = heavier - AMB_C(1.0);
  return amb_kalman_init(&set->kf, &exported->model, &settings);
}

/* Connects the parts of a set by their pointers. */
static void tie(const amb_calibration_base *base, amb_calibration_set *set)
{
  for (int f = 0; f < amb_forces(&set->kf.model); f++) {
    set->magnet[f].methods = &amb_scaled_magnet;
    set->magnet[f].self = &set->scaled[f];
  }
  set->estimator = *base->control->estimator;
  set->estimator.kf = &set->kf;
  set->estimator.magnet = set->magnet;
  set->law = *base->control->law;
  set->law.pid = set->pid;
  set->control.estimator = &set->estimator;
  set->control.law = &set->law;
}

uint32_t amb_calibration_sum(const amb_calibration_kept *kept)
{
  uint32_t sum = 0U;
  for (size_t i = 0U; i < (sizeof kept->of.word / sizeof kept->of.word[0]); i++) {
    sum = (31U * sum) + kept->of.word[i];
  }
  return sum;
}

/* Computes a set from values. Returns the bits of the kinds that are invalid. */
static uint32_t work(const amb_calibration_base *base, const amb_real numbers[AMB_PARAMETERS],
                     amb_calibration_kept *kept)
{
  amb_calibration_set *set = &kept->of.set;
  uint32_t wrong = refused(base, numbers);
  if ((wrong == 0U) && (take(base, numbers, set) != AMB_OK)) {
    wrong = UINT32_MAX;
  }
  if (wrong == 0U) {
    tie(base, set);
    amb_copy(AMB_PARAMETERS, numbers, set->numbers);
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
  amb_copy(AMB_PARAMETERS, base->exported, calibration->wanted);
  amb_copy(AMB_PARAMETERS, base->exported, calibration->in_use);
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
    amb_real wanted[AMB_PARAMETERS]; /* a snapshot, because the tool may write meanwhile */
    amb_copy(AMB_PARAMETERS, calibration->wanted, wanted);
    calibration->refused = work(base, wanted, next);
    if (calibration->refused == 0U) {
      fly(calibration, idle);
    }
    calibration->answered = request;
  } else if ((flying != 0U) && (calibration->kept[flying - 1U].sum !=
                                amb_calibration_sum(&calibration->kept[flying - 1U]))) {
    fly(calibration, (work(base, calibration->in_use, next) == 0U) ? idle : 0U);
  } else { /* unchanged */
  }
  if (calibration->flying == 0U) {
    amb_copy(AMB_PARAMETERS, base->exported, calibration->in_use);
    return base->control;
  }
  const amb_calibration_set *set = &calibration->kept[calibration->flying - 1U].of.set;
  amb_copy(AMB_PARAMETERS, set->numbers, calibration->in_use);
  return &set->control;
}

const amb_control *amb_calibration_flown(const amb_calibration_base *base, amb_works_by *works_by)
{
  const amb_control *control = amb_working_by(works_by, base->control);
  if (control != base->control) {
    const void *start = control; /* of the active set */
    const amb_calibration_kept *kept = (const amb_calibration_kept *)start;
    control = (kept->sum == amb_calibration_sum(kept)) ? control : base->control;
  }
  return control;
}
