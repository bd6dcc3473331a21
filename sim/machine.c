#include "ambkit/model.h"

#if defined(AMB_MODEL_LOOPS)

#include "machine.h"

/* What is kept of the controllers from sample to sample. */
typedef struct amb_machine_flown {
  amb_pid_state pid[AMB_CONTROLS];
  amb_control_state control;
  amb_kalman_result result;
  amb_status status;
  bool usable;
  bool off; /* whether the controller has the magnets without current */
  amb_flight_mode mode;
} amb_machine_flown;

static void begin(const amb_machine_loop *loop, const amb_machine_input *in,
                  const amb_real integral[], void *estimator, amb_machine_flown *s)
{
  s->result.status = AMB_OK;
  s->usable = true;
  s->off = false;
  s->mode = AMB_FLYING;
  for (int c = 0; c < loop->controllers.pids; c++)
    amb_pid_reset(&s->pid[c], integral[c]);
  if ((loop->control != NULL) && (in->hover != NULL))
    amb_control_hover(loop->control, &s->control, in->hover, integral);
  else if (loop->control != NULL)
    amb_control_init(loop->control, &s->control, estimator);
}

/* Estimator and controllers at sample k: readings y, control signals that acted before (`acted`)
 * and that act from here on, u [V]. */
static void control(const amb_machine_loop *loop, const amb_machine_input *in, size_t k,
                    amb_machine_flown *s, void *estimator, const amb_real y[],
                    const amb_real acted[], amb_real u[])
{
  const size_t p = (size_t)loop->plant.axes;
  const amb_real *r = in->r + k * p;
  if ((k > 0) && (loop->turn != NULL))
    loop->turn(loop->model, in->speed[k - 1], in->speed[k]);
  if (loop->control != NULL) {
    amb_control_output now;
    const bool fly = (in->fly == NULL) || (in->fly[k] > 0);
    s->status =
        amb_control_step(loop->control, &s->control, estimator, y, r, in->speed[k], fly, &now);
    s->result = now.estimator;
    s->usable = now.usable;
    s->off = !now.on;
    s->mode = now.mode;
    for (size_t c = 0; c < p; c++)
      u[c] = s->control.u[c];
    return;
  }
  if ((loop->estimator != NULL) && (k == 0))
    (void)amb_estimator_start(loop->estimator, estimator, y, &s->result);
  else if (loop->estimator != NULL)
    (void)amb_estimator_step(loop->estimator, estimator, y, acted, &s->result);
  const amb_real *seen = loop->feedback_estimate ? ((const amb_kalman_state *)estimator)->mean : y;
  s->status =
      s->result.status | amb_controllers_step(&loop->controllers, s->pid, r, seen, in->speed[k], u);
  for (size_t c = 0; c < p; c++)
    u[c] /= loop->k_ui[c];
}

void amb_machine_run(const amb_machine_loop *loop, const amb_machine_input *in,
                     amb_plant_state *state, const amb_real integral[], void *estimator,
                     amb_machine_output *out)
{
  const amb_plant *plant = &loop->plant;
  const size_t n = (size_t)plant->states, p = (size_t)plant->axes;
  const size_t m = (size_t)plant->sensors;
  const amb_controllers *controllers = &loop->controllers;
  amb_machine_flown flown;
  begin(loop, in, integral, estimator, &flown);
  out->touched = 0;
  out->first = in->n;
  for (size_t k = 0; k < in->n; k++) {
    amb_real demanded[AMB_CONTROLS];
    amb_real *y = out->y + k * m, *u = out->u + k * p;
    for (size_t i = 0; i < n; i++)
      out->X[k * n + i] = state->X[i];
    for (size_t r = 0; r < m; r++)
      y[r] =
          amb_parts_reading(&plant->sensor[r], state->X[plant->shows[r]], in->noise_y[k * m + r]);
    control(loop, in, k, &flown, estimator, y, k > 0 ? u - p : NULL, u);
    if (loop->estimator != NULL)
      amb_estimator_note(loop->estimator, estimator, &flown.result, k, &out->estimate);
    out->status[k] = (unsigned short)flown.status;
    if (out->mode != NULL) {
      out->mode[k] = (unsigned char)flown.mode;
      out->usable[k] = flown.usable;
    }
    const amb_acts acts = {.demanded = demanded,
                           .load = in->load + k * p,
                           .base = in->base + 3 * k,
                           .speed = in->speed[k],
                           .next = in->speed[k + 1],
                           .scale = 1,
                           .off = flown.off || (k >= in->off)};
    for (size_t c = 0; c < p; c++) {
      demanded[c] = amb_clamp(loop->k_ui[c] * (u[c] + in->noise_u[k * p + c]),
                              controllers->iu_min[c], controllers->iu_max[c]);
      const amb_real now = amb_plant_from_now(plant, state, (int)c, demanded[c]);
      const amb_acting acting = amb_plant_acting(plant, state, (int)c, &acts, now);
      out->iu[k * p + c] = acting.iu;
      out->force[k * p + c] = acting.force;
    }
    if (amb_plant_advance(plant, state, loop->T, &acts)) {
      out->touched++;
      out->first = k < out->first ? k : out->first;
    }
  }
}

#endif
