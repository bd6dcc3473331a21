#include "loop.h"

static size_t axes(const amb_loop *loop)
{
  return (size_t)loop->plant.axes;
}

/* Speed of rotation known to the controllers [rad/s]. */
static amb_real speed_known(const amb_loop_state *s, const amb_loop_sample *sample)
{
  const amb_real own = sample->speed != NULL ? sample->speed[0] : 0;
  return sample->rotation != NULL ? s->speed : own;
}

/* One step of the complete controller with its estimator; `u_known`: control signals known to it
 * [V].
 * */
static void control(const amb_loop *loop, amb_loop_state *s, void *filter,
                    const amb_loop_sample *sample, const amb_real u_known[])
{
  amb_copy(loop->plant.axes, u_known, s->control.u);
  s->status = amb_control_step(loop->control, &s->control, filter, s->y, sample->r,
                               speed_known(s, sample), sample->fly, &s->control_output);
  s->result = s->control_output.estimator;
  amb_copy(loop->plant.axes, s->control.u, s->u);
}

/* Demanded control currents, for the measurements `direct` [m]. */
static void demand(const amb_loop *loop, amb_loop_state *s, const void *filter,
                   const amb_loop_sample *sample, const amb_real direct[], amb_real iu[])
{
  const amb_real *mean = loop->feedback_estimate ? ((const amb_kalman_state *)filter)->mean : NULL;
  if (loop->own.control != NULL)
    loop->own.control(loop->own.controller, direct, sample->r, mean, iu);
  else if (loop->controllers != NULL) {
    s->status |= amb_controllers_step(loop->controllers, s->pid, sample->r,
                                      mean != NULL ? mean : direct, speed_known(s, sample), iu);
  } else if (mean != NULL) {
    const amb_model *model = &loop->estimator->kf->model;
    (void)amb_pid_step(&loop->pid, s->pid, sample->r[0], mean[amb_first(model, AMB_POSITION)],
                       &mean[amb_first(model, AMB_VELOCITY)], iu);
  } else
    (void)amb_pid_step(&loop->pid, s->pid, sample->r[0], direct[0] / loop->plant.gain[0], NULL, iu);
}

/* One sample: the controllers get the measurements `direct` [m], the estimator those of the state
 * and the control signals `u_known` [V] that acted before. The plant is not advanced. */
static void sense(const amb_loop *loop, amb_loop_state *s, void *filter,
                  const amb_loop_sample *sample, const amb_real direct[], const amb_real u_known[])
{
  const amb_real *acted = s->sampled ? u_known : NULL;
  amb_real iu[AMB_CONTROLS];
  s->sampled = true;
  s->status = AMB_OK;
  if (loop->control != NULL) {
    control(loop, s, filter, sample, u_known);
    return;
  }
  if (loop->estimator != NULL)
    s->status = amb_estimator_step(loop->estimator, filter, s->y, acted, &s->result);
  demand(loop, s, filter, sample, direct, iu);
  for (size_t c = 0; c < axes(loop); c++)
    s->u[c] = iu[c] / loop->k_ui[c];
}

/* Advances the plant to the next sample, with these shares of the amplifiers' ranges; NULL: all of
 * them. Controller and filter are notified if the magnets have no current, as by the amplifiers'
 * ready signal.
 */
static bool act(const amb_loop *loop, amb_loop_state *s, void *filter,
                const amb_loop_sample *sample, const amb_real share[])
{
  const amb_plant *plant = &loop->plant;
  const amb_real own = plant->sensor->speed;
  const amb_acts acts = {.demanded = s->demanded,
                         .load = sample->load,
                         .base = sample->base,
                         .speed = sample->speed != NULL ? sample->speed[0] : own,
                         .next = sample->speed != NULL ? sample->speed[1] : own,
                         .scale = sample->scale,
                         .off = sample->off || (loop->control != NULL && !s->control_output.on)};
  if (sample->off && (loop->control != NULL))
    amb_control_deenergise(loop->control, &s->control, filter);
  else if (acts.off && (loop->estimator != NULL))
    amb_deenergise(loop->estimator, filter);
  for (size_t c = 0; c < axes(loop); c++) {
    const amb_real left = share != NULL ? share[c] : 1;
    s->demanded[c] = amb_clamp(loop->k_ui[c] * (s->u[c] + sample->noise_u[c]),
                               left * loop->iu_min[c], left * loop->iu_max[c]);
  }
  if (loop->own.move != NULL) {
    for (int f = 0; f < plant->axes; f++)
      s->acting[f] = (amb_acting){.iu = s->demanded[f]};
    return loop->own.move(loop->own.plant, s->demanded, sample->load, s->plant.X);
  }
  for (int f = 0; f < plant->axes; f++)
    s->acting[f] = amb_plant_acting(plant, &s->plant, f, &acts,
                                    amb_plant_from_now(plant, &s->plant, f, s->demanded[f]));
  return amb_plant_advance(plant, &s->plant, loop->T, &acts);
}

/* Sensor outputs [m]. */
static void read(const amb_plant *plant, const amb_plant_state *state, const amb_real noise[],
                 amb_real y[])
{
  for (int r = 0; r < plant->sensors; r++) {
    const amb_parts *sensor = &plant->sensor[r];
    const amb_real x_m = state->X[plant->shows[r]];
    const bool adds = !(sensor->step > 0) && !(sensor->rise < 0) && !(sensor->rise > 0);
    y[r] = adds ? x_m + noise[r] : amb_parts_reading(sensor, x_m, noise[r]);
  }
}

bool amb_loop_step(const amb_loop *loop, amb_loop_state *state, void *filter,
                   const amb_loop_sample *sample)
{
  amb_real u_known[AMB_CONTROLS];
  amb_copy(loop->plant.axes, state->u, u_known);
  read(&loop->plant, &state->plant, sample->noise_y, state->y);
  sense(loop, state, filter, sample, state->y, u_known);
  return act(loop, state, filter, sample, NULL);
}

/* Measurement of sensor r at sample k with its delay; earlier outputs are known from x_m. */
static amb_real faulted(const amb_plant *plant, const amb_loop_faults *faults, const amb_real *x_m,
                        const amb_real *noise, size_t k, int r)
{
  const amb_parts *sensor = &plant->sensor[r];
  const size_t m = (size_t)plant->sensors, here = k * m + (size_t)r;
  const amb_real late = faults->late[here], rise = sensor->rise;
  const size_t samples = (late < (amb_real)k) ? (size_t)late : k;
  const amb_real share = (late < (amb_real)k) ? late - (amb_real)samples : 0;
  const size_t at = k - samples, then = here - samples * m;
  amb_real y = x_m[at] + amb_noise_share(rise, x_m[at]) * noise[then];
  if (share > 0)
    y += share * (x_m[at - 1] + amb_noise_share(rise, x_m[at - 1]) * noise[then - m] - y);
  return faults->y_times[here] * amb_parts_reading(sensor, y, 0) + faults->y_plus[here];
}

static amb_loop_sample sample_of(const amb_loop *loop, const amb_loop_input *in, size_t k)
{
  const size_t p = axes(loop), m = (size_t)loop->plant.sensors;
  const amb_loop_sample sample = {
      .r = in->r + k * p,
      .load = in->load + k * p,
      .noise_u = in->noise_u + k * p,
      .noise_y = in->noise_y + k * m,
      .base = in->base != NULL ? in->base + 3 * k : NULL,
      .speed = in->speed != NULL ? in->speed + k : NULL,
      .rotation = in->rotation != NULL ? in->rotation + AMB_ROTATION_FIELDS * k : NULL,
      .scale = in->scale != NULL ? in->scale[k] : 1,
      .off = in->on != NULL && !(in->on[k] > 0),
      .fly = in->fly == NULL || in->fly[k] > 0};
  return sample;
}

/* Writes the results of a sample, except the plant's states before its advance. */
static void note(const amb_loop *loop, const amb_loop_state *s, const void *filter,
                 const amb_real u_known[], size_t k, amb_loop_output *out)
{
  const size_t p = axes(loop), m = (size_t)loop->plant.sensors;
  for (size_t c = 0; c < p; c++) {
    out->iu[k * p + c] = s->acting[c].iu;
    out->force[k * p + c] = s->acting[c].force;
    out->u[k * p + c] = u_known[c];
  }
  for (size_t r = 0; r < m; r++)
    out->y[k * m + r] = s->y[r];
  for (int i = 0; i < 2; i++)
    if (out->voltage[i] != NULL)
      out->voltage[i][k] = s->acting[0].voltage[i];
  if (out->mode != NULL)
    out->mode[k] = (unsigned char)s->control_output.mode;
  if (out->usable != NULL)
    out->usable[k] = s->control_output.usable;
  if (out->status != NULL)
    out->status[k] = (unsigned short)s->status;
  if (loop->estimator != NULL)
    amb_estimator_note(loop->estimator, filter, &s->result, k, &out->estimate);
}

amb_status amb_loop_run(const amb_loop *loop, const amb_loop_input *in, amb_loop_state *state,
                        void *filter, amb_loop_output *out)
{
  const amb_plant *plant = &loop->plant;
  const amb_loop_faults *faults = in->faults;
  amb_status all = AMB_OK;
  amb_real u_known[AMB_CONTROLS], direct[AMB_SENSORS];
  amb_loop_state s = *state;
  amb_copy(plant->axes, s.u, u_known);
  for (size_t k = 0; k < in->n; k++) {
    const amb_loop_sample sample = sample_of(loop, in, k);
    for (int j = 0; j < out->columns; j++)
      out->X[j][k] = s.plant.X[j];
    s.speed = (sample.rotation != NULL) ? sample.rotation[AMB_ROTATION_FIELDS - 1] : 0;
    if ((k > 0) && (loop->turn_by != NULL) && (sample.rotation != NULL))
      s.speed = loop->turn_by(loop->model, filter, sample.rotation);
    else if ((k > 0) && (loop->turn != NULL))
      loop->turn(loop->model, in->speed[k - 1], in->speed[k]);
    read(plant, &s.plant, sample.noise_y, direct);
    amb_copy(plant->sensors, direct, s.y);
    for (int r = 0; (faults != NULL) && (r < plant->sensors); r++) {
      s.y[r] = faulted(plant, faults, out->X[plant->shows[r]], in->noise_y, k, r);
      direct[r] = faults->beside ? direct[r] : s.y[r];
    }
    sense(loop, &s, filter, &sample, direct, u_known);
    if ((sample.rotation != NULL) && (s.speed * sample.rotation[AMB_ROTATION_FIELDS - 1] < 0)) {
      s.status |= AMB_MIRRORED;
      s.result.status |= AMB_MIRRORED;
    }
    for (size_t c = 0, at = k * axes(loop); c < axes(loop); c++, at++)
      u_known[c] = faults != NULL ? faults->u_times[at] * s.u[c] + faults->u_plus[at] : s.u[c];
    out->at_stop[k] =
        act(loop, &s, filter, &sample, faults != NULL ? faults->current + k * axes(loop) : NULL);
    note(loop, &s, filter, u_known, k, out);
    all |= loop->estimator != NULL ? s.result.status : (amb_status)AMB_OK;
  }
  *state = s;
  return all;
}
