#include "loop.h"
#include <string.h>

/* What the estimator makes of the measurement, knowing the control signal that acted before it. */
static void estimate(const amb_loop *loop, amb_loop_state *s)
{
  if (s->sampled) {
    (void)amb_kalman_step(loop->kf, loop->magnet, &s->kalman, s->y, s->u, &s->result);
  } else {
    s->result.stiffness = amb_kalman_stiffness(loop->kf, loop->magnet, 0, s->kalman.mean[0]);
    s->result.status = amb_kalman_update(loop->kf, &s->kalman, s->y, &s->result);
  }
}

static bool step(const amb_loop *loop, amb_loop_state *s, const amb_loop_sample *sample)
{
  s->y = s->plant.x_m + sample->noise_y;
  if (loop->kf != NULL)
    estimate(loop, s);
  amb_real demanded;
  if (loop->feedback_estimate)
    (void)amb_pid_step(&loop->pid, &s->pid, sample->r, s->kalman.mean[0], &s->kalman.mean[1],
                       &demanded);
  else
    (void)amb_pid_step(&loop->pid, &s->pid, sample->r, s->y / loop->plant.K_sen, NULL, &demanded);
  s->u = demanded / loop->k_ui;
  s->iu = amb_clamp(loop->k_ui * (s->u + sample->noise_u), loop->iu_min, loop->iu_max);
  s->force = amb_plant_force(&loop->plant, s->iu, s->plant.x);
  s->sampled = true;
  return amb_plant_advance(&loop->plant, &s->plant, loop->T, s->iu, sample->f_d);
}

bool amb_loop_step(const amb_loop *loop, amb_loop_state *state, const amb_loop_sample *sample)
{
  return step(loop, state, sample);
}

amb_status amb_loop_run(const amb_loop *loop, const amb_loop_input *in, amb_plant_state *plant,
                        amb_pid_state *pid, amb_kalman_state *kalman, amb_loop_output *out)
{
  amb_status all = AMB_OK;
  amb_loop_state s;
  memset(&s, 0, sizeof s);
  s.plant = *plant;
  s.pid = *pid;
  if (loop->kf != NULL)
    s.kalman = *kalman;
  out->touched = 0;
  for (size_t k = 0; k < in->n; k++) {
    const amb_loop_sample sample = {in->r[k], in->f_d[k], in->noise_u[k], in->noise_y[k]};
    out->x[k] = s.plant.x;
    out->v[k] = s.plant.v;
    out->x_m[k] = s.plant.x_m;
    if (step(loop, &s, &sample))
      out->touched++;
    out->y[k] = s.y;
    out->u[k] = s.u;
    out->iu[k] = s.iu;
    out->force[k] = s.force;
    if (loop->kf != NULL) {
      all |= s.result.status;
      amb_kalman_note(&s.kalman, &s.result, k, &out->estimate);
    }
  }
  *plant = s.plant;
  *pid = s.pid;
  if (loop->kf != NULL)
    *kalman = s.kalman;
  return all;
}
