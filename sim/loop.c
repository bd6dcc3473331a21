#include "loop.h"

/* What the estimator makes of the measurement, knowing the control signal that acted before it. */
static void estimate(const amb_loop *loop, amb_loop_state *s, void *estimator)
{
  if (s->sampled)
    (void)amb_estimator_step(loop->estimator, estimator, s->y, s->u, &s->result);
  else
    (void)amb_estimator_start(loop->estimator, estimator, s->y, &s->result);
}

static bool step(const amb_loop *loop, amb_loop_state *s, void *estimator,
                 const amb_loop_sample *sample)
{
  s->y = s->plant.x_m + sample->noise_y;
  if (loop->estimator != NULL)
    estimate(loop, s, estimator);
  amb_real demanded;
  if (loop->feedback_estimate) {
    const amb_real *mean = ((const amb_kalman_state *)estimator)->mean;
    (void)amb_pid_step(&loop->pid, &s->pid, sample->r, mean[0], &mean[1], &demanded);
  } else
    (void)amb_pid_step(&loop->pid, &s->pid, sample->r, s->y / loop->plant.K_sen, NULL, &demanded);
  s->u = demanded / loop->k_ui;
  s->iu = amb_clamp(loop->k_ui * (s->u + sample->noise_u), loop->iu_min, loop->iu_max);
  s->force = amb_plant_force(&loop->plant, s->iu, s->plant.x);
  s->sampled = true;
  return amb_plant_advance(&loop->plant, &s->plant, loop->T, s->iu, sample->f_d);
}

bool amb_loop_step(const amb_loop *loop, amb_loop_state *state, void *estimator,
                   const amb_loop_sample *sample)
{
  return step(loop, state, estimator, sample);
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

amb_status amb_loop_run(const amb_loop *loop, const amb_loop_input *in, amb_loop_state *state,
                        void *estimator, amb_loop_output *out)
{
  static const amb_magnet_methods scaled_methods = {scaled_force, NULL, NULL};
  amb_status all = AMB_OK;
  amb_loop now = *loop;
  scaled_magnet scaled = {loop->plant.magnet, 1};
  if (in->scale != NULL) {
    now.plant.magnet.methods = &scaled_methods;
    now.plant.magnet.self = &scaled;
  }
  amb_loop_state s = *state;
  out->touched = 0;
  for (size_t k = 0; k < in->n; k++) {
    const amb_loop_sample sample = {in->r[k], in->f_d[k], in->noise_u[k], in->noise_y[k]};
    if (in->scale != NULL) {
      scaled.scale = in->scale[k];
      now.plant.f_0 = loop->plant.f_0 + (scaled.scale - 1) * in->f_bias;
    }
    out->x[k] = s.plant.x;
    out->v[k] = s.plant.v;
    out->x_m[k] = s.plant.x_m;
    if (step(&now, &s, estimator, &sample))
      out->touched++;
    out->y[k] = s.y;
    out->u[k] = s.u;
    out->iu[k] = s.iu;
    out->force[k] = s.force;
    if (loop->estimator != NULL) {
      all |= s.result.status;
      amb_estimator_note(loop->estimator, estimator, &s.result, k, &out->estimate);
    }
  }
  *state = s;
  return all;
}
