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
    (void)amb_pid_step(&loop->pid, &s->pid, sample->r, direct / loop->plant.K_sen, NULL, &demanded);
  s->u = demanded / loop->k_ui;
  s->sampled = true;
}

/* And the plant on to the next, with this share of the amplifier's range. */
static bool act(const amb_loop *loop, amb_loop_state *s, const amb_loop_sample *sample,
                amb_real share)
{
  s->demanded =
      amb_clamp(loop->k_ui * (s->u + sample->noise_u), share * loop->iu_min, share * loop->iu_max);
  if (loop->plant.parts == NULL) {
    s->acting.iu = s->demanded;
    s->acting.force = amb_plant_force(&loop->plant, s->demanded, s->plant.x);
  } else
    s->acting = amb_plant_from_now(&loop->plant, &s->plant, s->demanded);
  return amb_plant_advance(&loop->plant, &s->plant, loop->T, s->demanded, sample->f_d);
}

/* A magnet whose force is another's, times a factor. Only a plant asks it. */
typedef struct scaled_magnet {
  amb_magnet magnet;
  amb_real scale;
} scaled_magnet;

static amb_real scaled_force(const void *self, amb_real iu, amb_real x)
{
  const scaled_magnet *scaled = (const scaled_magnet *)self;
  return scaled->scale * scaled->magnet.methods->force(scaled->magnet.self, iu, x);
}

static const amb_magnet_methods scaled_methods = {scaled_force, NULL, NULL};

/* What a loop with a scaled magnet points to. */
typedef struct scaled_parts {
  scaled_magnet magnet, coil;
  amb_parts parts;
} scaled_parts;

/* A loop whose magnet can be scaled, and is not yet; it points to `of`. */
static amb_loop scalable(const amb_loop *loop, scaled_parts *of)
{
  amb_loop now = *loop;
  of->magnet = (scaled_magnet){loop->plant.magnet, 1};
  of->coil = (scaled_magnet){loop->plant.coil, 1};
  now.plant.magnet.methods = &scaled_methods;
  now.plant.magnet.self = &of->magnet;
  if (loop->plant.parts != NULL) {
    of->parts = *loop->plant.parts;
    now.plant.parts = &of->parts;
  }
  if (loop->plant.coil.methods != NULL) {
    now.plant.coil.methods = &scaled_methods;
    now.plant.coil.self = &of->coil;
  }
  return now;
}

/* The magnet's constant is `scale` times as great [1]; where it is off, it does not pull. */
static void scale_by(const amb_loop *loop, amb_loop *now, scaled_parts *of, amb_real scale, bool on)
{
  const amb_real pulling = on ? scale : 0;
  of->magnet.scale = pulling;
  of->coil.scale = pulling;
  if (loop->plant.parts != NULL)
    of->parts.k = scale * loop->plant.parts->k;
  now->plant.f_0 = loop->plant.f_0 + (pulling - 1) * loop->f_bias;
}

bool amb_loop_step(const amb_loop *loop, amb_loop_state *state, void *estimator,
                   const amb_loop_sample *sample)
{
  const amb_real y = amb_plant_measure(&loop->plant, state->plant.x_m, sample->noise_y);
  sense(loop, state, estimator, sample, y, y, state->u);
  if (!is_whole(loop))
    return act(loop, state, sample, 1);
  scaled_parts of;
  amb_loop now = scalable(loop, &of);
  scale_by(loop, &now, &of, 1, state->flown.on);
  return act(&now, state, sample, 1);
}

/* The measurement at sample k, as far as it has come: x_m is known up to there. */
static amb_real faulted(const amb_plant *plant, const amb_loop_faults *faults, const amb_real *x_m,
                        const amb_real *noise, size_t k)
{
  const amb_real late = faults->late[k];
  const size_t whole = (late < (amb_real)k) ? (size_t)late : k;
  const amb_real share = (late < (amb_real)k) ? late - (amb_real)whole : 0;
  const size_t at = k - whole;
  const amb_real rise = (plant->parts != NULL) ? plant->parts->rise : 0;
  amb_real y = x_m[at] + amb_noise_share(rise, x_m[at]) * noise[at];
  if (share > 0)
    y += share * (x_m[at - 1] + amb_noise_share(rise, x_m[at - 1]) * noise[at - 1] - y);
  return faults->y_times[k] * amb_plant_measure(plant, y, 0) + faults->y_plus[k];
}

amb_status amb_loop_run(const amb_loop *loop, const amb_loop_input *in, amb_loop_state *state,
                        void *estimator, amb_loop_output *out)
{
  amb_status all = AMB_OK;
  scaled_parts of = {0};
  const bool scaling = in->scale != NULL || is_whole(loop);
  amb_loop now = scaling ? scalable(loop, &of) : *loop;
  amb_loop_state s = *state;
  out->touched = 0;
  amb_real told = s.u;
  for (size_t k = 0; k < in->n; k++) {
    const bool fly = in->fly == NULL || in->fly[k] > 0;
    const amb_loop_sample sample = {in->r[k], in->f_d[k], in->noise_u[k], in->noise_y[k], fly};
    out->x[k] = s.plant.x;
    out->v[k] = s.plant.v;
    out->x_m[k] = s.plant.x_m;
    const amb_loop_faults *faults = in->faults;
    const amb_real direct = amb_plant_measure(&now.plant, s.plant.x_m, in->noise_y[k]);
    const amb_real y =
        faults != NULL ? faulted(&now.plant, faults, out->x_m, in->noise_y, k) : direct;
    const bool both = faults != NULL && !faults->beside;
    sense(&now, &s, estimator, &sample, both ? y : direct, y, told);
    if (scaling)
      scale_by(loop, &now, &of, in->scale != NULL ? in->scale[k] : 1,
               !is_whole(loop) || s.flown.on);
    told = faults != NULL ? faults->u_times[k] * s.u + faults->u_plus[k] : s.u;
    const bool touched = act(&now, &s, &sample, faults != NULL ? faults->current[k] : 1);
    out->touched += touched ? 1U : 0U;
    if (out->at_stop != NULL)
      out->at_stop[k] = touched ? 1U : 0U;
    out->y[k] = s.y;
    out->u[k] = told;
    out->iu[k] = s.acting.iu;
    out->force[k] = s.acting.force;
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
