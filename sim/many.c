#include "many.h"
#include "lanes_run.h"
#include "many_figures.h"
#include <string.h>

/* Available in lanes: a plain axis with the closed law of two sides, a PID, and an estimator kind
 * with lanes. */
unsigned int amb_many_group(const amb_many_run *run)
{
  const amb_loop *loop = run->loop;
  const amb_plant *plant = &loop->plant;
  const amb_parts *sensor = plant->sensor;
  if (!amb_plant_is_plain_axis(plant) || (sensor->step > 0) || (sensor->rise < 0) ||
      (sensor->rise > 0) || (loop->control != NULL) || (loop->controllers != NULL) ||
      (loop->own.control != NULL) || (loop->own.move != NULL) || (loop->pid.sections > 0) ||
      (run->in.scale != NULL) || (run->in.on != NULL) || (run->in.faults != NULL))
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

static void draw(const double *noise, const amb_many_run *run, const double std[], uint32_t stream,
                 size_t columns, amb_real *to)
{
  const size_t n = run->in.n;
  double normal[AMB_NOISE_BLOCK];
  for (size_t i = 0; i < n * columns; i++)
    to[i] = (noise != NULL) ? (amb_real)noise[i] : AMB_C(0.0);
  for (size_t c = 0; (noise == NULL) && (c < columns); c++)
    for (size_t first = 0; (std[c] > 0) && (first < n); first += AMB_NOISE_BLOCK) {
      const size_t count = (n - first < AMB_NOISE_BLOCK) ? n - first : AMB_NOISE_BLOCK;
      amb_many_noise(run->key, AMB_NOISE_STREAMS * (uint32_t)c + stream, first, count, normal);
      for (size_t i = 0; i < count; i++)
        to[(first + i) * columns + c] = (amb_real)(std[c] * normal[i]);
    }
}

/* Sample k of a plant: motion along the axes. */
static void see(const amb_many_run *run, size_t k, const amb_loop_output *all, amb_seen seen[])
{
  const amb_plant *plant = &run->loop->plant;
  const size_t at = k * (size_t)plant->axes;
  amb_real X[AMB_PLANT_STATES];
  double loads = 0;
  for (int j = 0; j < 2 * plant->positions; j++)
    X[j] = all->X[j][k];
  for (int f = 0; f < plant->axes; f++) {
    amb_seen *axis = &seen[f];
    axis->k = (double)k;
    axis->r = (double)run->in.r[at + (size_t)f];
    axis->f_d = (double)run->in.load[at + (size_t)f];
    axis->x = (double)amb_plant_along(plant, f, X);
    axis->v = (double)amb_plant_along(plant, f, X + plant->positions);
    axis->u = (double)all->u[at + (size_t)f];
    axis->iu = (double)all->iu[at + (size_t)f];
    axis->touched = all->at_stop[k] != 0;
    loads += axis->f_d * axis->f_d;
  }
  for (int f = 0; f < plant->axes; f++)
    seen[f].load = sqrt(loads);
  for (int i = 0; i < plant->rings; i++) {
    amb_seen *first = &seen[plant->ring[i].first];
    amb_seen *second = (plant->ring[i].second < 0) ? first : &seen[plant->ring[i].second];
    const double across = (second == first) ? 0.0 : second->x;
    first->orbit = second->orbit = sqrt(first->x * first->x + across * across);
  }
}

/* The estimates of sample k. */
static void see_estimate(const amb_many_run *run, size_t k, const amb_kalman_history *history,
                         amb_seen seen[])
{
  const amb_model *model = &run->loop->estimator->kf->model;
  const size_t states = (size_t)amb_states(model), m = (size_t)amb_sensors(model);
  seen[0].nis = seen[0].taken = 0.0;
  for (size_t r = k * m; r < (k + 1) * m; r++) {
    const double e = (double)history->innovation[r], S = (double)history->variance[r];
    if (((history->health[r] & AMB_NOT_USED) == 0U) && (S > 0.0)) {
      seen[0].nis += e * e / S;
      seen[0].taken += 1.0;
    }
  }
  for (int f = 0; f < run->loop->plant.axes; f++) {
    seen[f].nis = seen[0].nis;
    seen[f].taken = seen[0].taken;
    for (int i = 0; i < 3; i++)
      if (run->along[i].start != NULL)
        seen[f].mean[i] = (double)amb_sparse_times(&run->along[i], run->along[i].value, f,
                                                   history->mean + k * states);
  }
}

static void judge(amb_many_run *run, const amb_loop_output *all)
{
  const int axes = run->loop->plant.axes;
  amb_tally tally[AMB_PLANT_AXES];
  amb_seen seen[AMB_PLANT_AXES] = {{0}};
  for (int f = 0; f < axes; f++)
    tally[f] = amb_tally_none(&run->windows[f]);
  for (size_t k = 0; k < run->in.n; k++) {
    see(run, k, all, seen);
    if (run->loop->estimator != NULL) {
      see_estimate(run, k, &all->estimate, seen);
      amb_flags_count(run, all->estimate.status[k]);
    }
    for (int f = 0; f < axes; f++) {
      const amb_windows *at = &run->windows[f];
      amb_tally_estimate(at, &tally[f], &seen[f]);
      amb_tally_loop(at, &tally[f], &seen[f]);
      if ((seen[f].k >= at->step_from) && (seen[f].k < at->step_to))
        amb_tally_response(at, &tally[f], &seen[f]);
    }
  }
  for (int f = 0; f < axes; f++)
    amb_figures_of(run, f, &tally[f]);
}

void amb_many_one(amb_many_run *run, amb_real *noise_u, amb_real *noise_y, unsigned char *touched,
                  amb_loop_output *to)
{
  const amb_plant *plant = &run->loop->plant;
  draw(run->noise_u, run, run->std_u, AMB_NOISE_CONTROL, (size_t)plant->axes, noise_u);
  draw(run->noise_y, run, run->std_y, AMB_NOISE_SENSOR, (size_t)plant->sensors, noise_y);
  amb_loop_input in = run->in;
  in.noise_u = noise_u;
  in.noise_y = noise_y;
  memset(run->flags, 0, sizeof run->flags);
  to->at_stop = touched;
  (void)amb_loop_run(run->loop, &in, &run->state, run->estimator, to);
  judge(run, to);
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
