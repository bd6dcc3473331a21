#include "many.h"
#include "lanes_run.h"
#include "many_figures.h"
#include <string.h>

/* In lanes: a plain axis on the closed law of two sides, a PID and an estimator that has
 * lanes. */
unsigned int amb_many_group(const amb_many_run *run)
{
  const amb_loop *loop = run->loop;
  const amb_plant *plant = &loop->plant;
  const amb_parts *sensor = plant->sensor;
  if (!amb_plant_is_plain_axis(plant) || (sensor->step > 0) || (sensor->rise < 0) ||
      (sensor->rise > 0) || (loop->control != NULL) || (loop->controllers != NULL) ||
      (loop->pid.sections > 0) || (run->in.scale != NULL) || (run->in.faults != NULL))
    return 0U;
  if ((plant->substeps < 1) || (plant->substeps > 1000) || (loop->estimator == NULL) ||
      (sizeof(amb_real) < sizeof(double)))
    return 0U;
  const unsigned int filter = amb_batch_group(loop->estimator);
  if (filter == 0U)
    return 0U;
  return 1U + (loop->feedback_estimate ? 1U : 0U) + 2U * (unsigned int)plant->substeps +
         2048U * filter;
}

static void draw(const double *given, const amb_many_run *run, double std, uint32_t stream,
                 size_t n, amb_real *to)
{
  double drawn[AMB_NOISE_DRAWN];
  for (size_t first = 0; first < n; first += AMB_NOISE_DRAWN) {
    const size_t count = (n - first < AMB_NOISE_DRAWN) ? n - first : AMB_NOISE_DRAWN;
    if ((given == NULL) && (std > 0))
      amb_many_noise(run->key, stream, first, count, drawn);
    for (size_t i = 0; i < count; i++)
      to[first + i] =
          (amb_real)((given != NULL) ? given[first + i] : ((std > 0) ? std * drawn[i] : 0.0));
  }
}

static void judge(amb_many_run *run, size_t n, const unsigned char *touched,
                  const amb_loop_output *all)
{
  const amb_estimator *estimator = run->loop->estimator;
  amb_tally t = amb_tally_none(&run->windows);
  const amb_model *model = (estimator != NULL) ? &estimator->kf->model : NULL;
  const size_t states = (model != NULL) ? (size_t)amb_states(model) : 0;
  const int place[3] = {(model != NULL) ? amb_first(model, AMB_POSITION) : 0,
                        (model != NULL) ? amb_first(model, AMB_VELOCITY) : 0,
                        (model != NULL) ? amb_first(model, AMB_LOAD) : 0};
  for (size_t k = 0; k < n; k++) {
    amb_seen seen = {.k = (double)k,
                     .r = (double)run->in.r[k],
                     .f_d = (double)run->in.load[k],
                     .x = (double)all->X[0][k],
                     .v = (double)all->X[1][k],
                     .u = (double)all->u[k],
                     .iu = (double)all->iu[k],
                     .touched = touched[k] != 0};
    if (estimator != NULL) {
      const unsigned int status = all->estimate.status[k];
      for (int i = 0; i < 3; i++)
        seen.mean[i] = (double)all->estimate.mean[k * states + (size_t)place[i]];
      seen.innovation = (double)all->estimate.innovation[k];
      seen.variance = (double)all->estimate.variance[k];
      seen.used = (status & AMB_NOT_USED) == 0U;
      amb_tally_estimate(&run->windows, &t, &seen);
      amb_flags_count(run, status);
    }
    amb_tally_loop(&run->windows, &t, &seen);
    if ((seen.k >= run->windows.step_from) && (seen.k < run->windows.step_to))
      amb_tally_response(&run->windows, &t, &seen);
  }
  amb_figures_of(run, n, &t);
}

void amb_many_alone(amb_many_run *run, amb_real *noise_u, amb_real *noise_y, unsigned char *touched,
                    amb_loop_output *to)
{
  const size_t n = run->in.n;
  draw(run->noise_u, run, run->std_u, AMB_NOISE_CONTROL, n, noise_u);
  draw(run->noise_y, run, run->std_y, AMB_NOISE_SENSOR, n, noise_y);
  amb_loop_input in = run->in;
  in.noise_u = noise_u;
  in.noise_y = noise_y;
  memset(run->flags, 0, sizeof run->flags);
  to->at_stop = touched;
  (void)amb_loop_run(run->loop, &in, &run->state, run->estimator, to);
  judge(run, n, touched, to);
}

void amb_many_advance(amb_instructions instructions, amb_many_run *const runs[], size_t count,
                      size_t n)
{
  for (size_t i = 0; i < count; i++)
    memset(runs[i]->flags, 0, sizeof runs[i]->flags);
  amb_lanes_of(instructions)->many(runs, count, n);
}

void amb_many_noise(amb_noise_key key, uint32_t stream, size_t first, size_t n, double *to)
{
  const amb_lanes *lanes = amb_lanes_of(amb_batch_fastest());
  if (lanes != NULL)
    lanes->noise(key, stream, first, n, to);
  else
    amb_noise_normal(key, stream, first, n, to);
}

void amb_philox(const uint32_t counter[4], const uint32_t key[2], uint32_t random[4])
{
  memcpy(random, counter, 4 * sizeof *random);
  amb_philox_rounds(1, key[0], key[1], &random[0], &random[1], &random[2], &random[3]);
}
