#include "loop.h"

/* Estimator at sample k: what it makes of y, knowing the control signal that acted before. */
static void estimate(const amb_loop *loop, amb_kalman_state *kalman, amb_kalman_result *result,
                     size_t k, const amb_loop_output *out)
{
  if (k == 0) {
    result->stiffness = amb_kalman_stiffness(loop->kf, loop->magnet, 0, kalman->mean[0]);
    result->status = amb_kalman_update(loop->kf, kalman, out->y[0], result);
  } else {
    (void)amb_kalman_step(loop->kf, loop->magnet, kalman, out->y[k], out->u[k - 1], result);
  }
  amb_kalman_note(kalman, result, k, &out->estimate);
}

amb_status amb_loop_run(const amb_loop *loop, const amb_loop_input *in, amb_plant_state *plant,
                        amb_pid_state *pid, amb_kalman_state *kalman, amb_loop_output *out)
{
  amb_status all = AMB_OK;
  amb_kalman_result result = {0, 0, {0, 0}, AMB_OK};
  out->touched = 0;
  for (size_t k = 0; k < in->n; k++) {
    out->x[k] = plant->x;
    out->v[k] = plant->v;
    out->x_m[k] = plant->x_m;
    out->y[k] = plant->x_m + in->noise_y[k];
    if (loop->kf != NULL) {
      estimate(loop, kalman, &result, k, out);
      all |= result.status;
    }
    amb_real demanded;
    if (loop->feedback_estimate)
      (void)amb_pid_step(&loop->pid, pid, in->r[k], kalman->mean[0], &kalman->mean[1], &demanded);
    else
      (void)amb_pid_step(&loop->pid, pid, in->r[k], out->y[k] / loop->plant.K_sen, NULL, &demanded);
    out->u[k] = demanded / loop->k_ui;
    out->iu[k] = amb_clamp(loop->k_ui * (out->u[k] + in->noise_u[k]), loop->iu_min, loop->iu_max);
    out->force[k] = amb_plant_force(&loop->plant, out->iu[k], plant->x);
    if (amb_plant_advance(&loop->plant, plant, loop->T, out->iu[k], in->f_d[k]))
      out->touched++;
  }
  return all;
}
