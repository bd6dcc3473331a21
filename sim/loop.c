#include "loop.h"

static bool is_whole(const amb_loop *loop)
{
  return loop->control != NULL || loop->elsewhere != NULL;
}

/* The whole controller, with one measurement for all of it; `told` of the control signal [V]. */
static void control(const amb_loop *loop, amb_loop_state *s, void *estimator,
                    const amb_loop_sample *sample, amb_real y, amb_real told)
{
  const amb_real measured[AMB_SENSORS] = {y};
  s->sampled = true;
  if (loop->elsewhere != NULL) {
    s->u = loop->elsewhere(loop->where, y, sample->r, sample->fly, &s->flown);
    return;
  }
  s->control.u[0] = told;
  (void)amb_control_step(loop->control, &s->control, estimator, measured, &sample->r, 0,
                         sample->fly, &s->flown);
  s->result = s->flown.estimator;
  s->u = s->control.u[0];
}

/* A sample at which the controller gets the measurement `direct` [m], and the estimator y [m] and
 * that `told` [V] acted before it. The plant is left where it is. */
static void sense(const amb_loop *loop, amb_loop_state *s, void *estimator,
                  const amb_loop_sample *sample, amb_real direct, amb_real y, amb_real told)
{
  s->y = y;
  if (is_whole(loop)) {
    control(loop, s, estimator, sample, y, told);
    return;
  }
  if (loop->estimator != NULL) {
    const amb_real measured[AMB_SENSORS] = {y}, acted[AMB_CONTROLS] = {told};
    if (s->sampled)
      (void)amb_estimator_step(loop->estimator, estimator, measured, acted, &s->result);
    else
      (void)amb_estimator_start(loop->estimator, estimator, measured, &s->result);
  }
  amb_real demanded;
  if (loop->feedback_estimate) {
    const amb_model *model = &loop->estimator->kf->model;
    const amb_real *mean = ((const amb_kalman_state *)estimator)->mean;
    (void)amb_pid_step(&loop->pid, &s->pid, sample->r, mean[amb_first(model, AMB_POSITION)],
                       &mean[amb_first(model, AMB_VELOCITY)], &demanded);
  } else
    (void)amb_pid_step(&loop->pid, &s->pid, sample->r, direct / loop->plant.gain[0], NULL,
                       &demanded);
  s->u = demanded / loop->k_ui;
  s->sampled = true;
}

/* What acts from this sample on, with this share of the amplifier's range and the magnet's force
 * this many times as great. */
static void act(const amb_loop *loop, amb_loop_state *s, const amb_loop_sample *sample,
                amb_real share, amb_acts *acts)
{
  const amb_real speed = loop->plant.sensor->speed;
  s->demanded =
      amb_clamp(loop->k_ui * (s->u + sample->noise_u), share * loop->iu_min, share * loop->iu_max);
  acts->demanded = &s->demanded;
  acts->load = &sample->f_d;
  acts->base = NULL;
  acts->speed = acts->next = speed;
  acts->off = is_whole(loop) && !s->flown.on;
  s->acting = amb_plant_acting(&loop->plant, &s->plant, 0, acts,
                               amb_plant_from_now(&loop->plant, &s->plant, 0, s->demanded));
}

/* The measurement that the sensor gives with this noise [m]. */
static amb_real reading(const amb_plant *plant, amb_real x_m, amb_real noise)
{
  return amb_parts_reading(plant->sensor, x_m, noise);
}

bool amb_loop_step(const amb_loop *loop, amb_loop_state *state, void *estimator,
                   const amb_loop_sample *sample)
{
  const amb_real y = reading(&loop->plant, state->plant.X[2], sample->noise_y);
  amb_acts acts = {.scale = 1};
  sense(loop, state, estimator, sample, y, y, state->u);
  act(loop, state, sample, 1, &acts);
  return amb_plant_advance(&loop->plant, &state->plant, loop->T, &acts);
}

/* The measurement at sample k, as far as it has come: x_m is known up to there. */
static amb_real faulted(const amb_plant *plant, const amb_loop_faults *faults, const amb_real *x_m,
                        const amb_real *noise, size_t k)
{
  const amb_real late = faults->late[k];
  const size_t whole = (late < (amb_real)k) ? (size_t)late : k;
  const amb_real share = (late < (amb_real)k) ? late - (amb_real)whole : 0;
  const size_t at = k - whole;
  const amb_real rise = plant->sensor->rise;
  amb_real y = x_m[at] + amb_noise_share(rise, x_m[at]) * noise[at];
  if (share > 0)
    y += share * (x_m[at - 1] + amb_noise_share(rise, x_m[at - 1]) * noise[at - 1] - y);
  return faults->y_times[k] * reading(plant, y, 0) + faults->y_plus[k];
}

amb_status amb_loop_run(const amb_loop *loop, const amb_loop_input *in, amb_loop_state *state,
                        void *estimator, amb_loop_output *out)
{
  const amb_plant *plant = &loop->plant;
  const amb_loop_faults *faults = in->faults;
  amb_status all = AMB_OK;
  amb_loop_state s = *state;
  out->touched = 0;
  amb_real told = s.u;
  for (size_t k = 0; k < in->n; k++) {
    const bool fly = in->fly == NULL || in->fly[k] > 0;
    const amb_loop_sample sample = {in->r[k], in->f_d[k], in->noise_u[k], in->noise_y[k], fly};
    amb_acts acts = {.scale = in->scale != NULL ? in->scale[k] : 1};
    out->x[k] = s.plant.X[0];
    out->v[k] = s.plant.X[1];
    out->x_m[k] = s.plant.X[2];
    const amb_real direct = reading(plant, s.plant.X[2], in->noise_y[k]);
    const amb_real y = faults != NULL ? faulted(plant, faults, out->x_m, in->noise_y, k) : direct;
    const bool both = faults != NULL && !faults->beside;
    sense(loop, &s, estimator, &sample, both ? y : direct, y, told);
    told = faults != NULL ? faults->u_times[k] * s.u + faults->u_plus[k] : s.u;
    act(loop, &s, &sample, faults != NULL ? faults->current[k] : 1, &acts);
    out->y[k] = s.y;
    out->u[k] = told;
    out->iu[k] = s.acting.iu;
    out->force[k] = s.acting.force + plant->g[0];
    const bool touched = amb_plant_advance(plant, &s.plant, loop->T, &acts);
    out->touched += touched ? 1U : 0U;
    if (out->at_stop != NULL)
      out->at_stop[k] = touched ? 1U : 0U;
    if (out->mode != NULL)
      out->mode[k] = (unsigned char)s.flown.mode;
    if (out->voltage[0] != NULL)
      out->voltage[0][k] = s.acting.voltage[0];
    if (out->voltage[1] != NULL)
      out->voltage[1][k] = s.acting.voltage[1];
    if (loop->estimator != NULL) {
      all |= s.result.status;
      amb_estimator_note(loop->estimator, estimator, &s.result, k, &out->estimate);
    }
  }
  *state = s;
  return all;
}
