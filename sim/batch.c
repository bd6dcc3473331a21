#include "batch.h"
#include "ambkit/closed.h"
#include "ambkit/low_pass.h"
#include "ambkit/observer.h"
#include "lanes_run.h"
#include <string.h>

const amb_lanes *amb_lanes_of(amb_instructions instructions)
{
  static const amb_lanes *const builds[AMB_AVX512 + 1] = {
      NULL,
#if defined(AMB_HAS_LANES)
      &amb_lanes_baseline,
#if defined(AMB_LANES_X86)
      &amb_lanes_avx2,
      &amb_lanes_avx512,
#endif
#endif
  };
  return builds[instructions];
}

bool amb_batch_has(amb_instructions instructions)
{
#if defined(AMB_LANES_X86) && defined(AMB_HAS_LANES)
  if (instructions == AMB_AVX512)
    return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
           __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw");
  if (instructions == AMB_AVX2)
    return __builtin_cpu_supports("avx2") != 0;
#endif
  return (instructions == AMB_SCALAR) || (amb_lanes_of(instructions) != NULL);
}

amb_instructions amb_batch_fastest(void)
{
  amb_instructions best = AMB_SCALAR;
  for (int set = AMB_SCALAR; set <= AMB_AVX512; set++)
    if (amb_batch_has((amb_instructions)set))
      best = (amb_instructions)set;
  return best;
}

size_t amb_batch_lanes(amb_instructions instructions)
{
  static const size_t bytes[] = {sizeof(amb_real), 16, 32, 64};
  return bytes[instructions] / sizeof(amb_real);
}

unsigned int amb_batch_group(const amb_estimator *e)
{
  static const amb_estimator_methods *const kinds[] = {
      /* in the order of lanes_step.h */
      &amb_kalman_methods, &amb_extended_methods, &amb_observer_methods, &amb_low_pass_methods};
  const size_t most = (amb_lanes_of(AMB_BASELINE) != NULL) ? sizeof kinds / sizeof kinds[0] : 0;
  unsigned int magnet = 2U;
  if (e->magnet->methods == &amb_constant_magnet)
    magnet = 0U;
  else if ((e->magnet->methods == &amb_law_magnet) && ((const amb_law *)e->magnet->self)->two_sided)
    magnet = 1U;
  for (unsigned int kind = 0; kind < most; kind++)
    if (e->methods == kinds[kind])
      return 1U + 3U * kind + magnet;
  return 0U;
}

/* One run by ambkit/estimator.h. */
static void run_one(amb_batch_run *run, size_t samples, size_t skip)
{
  const amb_model *model = &run->estimator->kf->model;
  const size_t n = (size_t)amb_states(model), m = (size_t)amb_sensors(model);
  const size_t controls = (size_t)amb_controls(model);
  const amb_kalman_state *state = (const amb_kalman_state *)run->state;
  amb_real sum[AMB_BATCH_JUDGED] = {AMB_C(0.0), AMB_C(0.0), AMB_C(0.0)};
  for (size_t k = 0; k < samples; k++) {
    const amb_real *u = (k > 0) ? run->u + (k - 1) * controls : NULL;
    amb_kalman_result r;
    run->all |= amb_estimator_step(run->estimator, run->state, run->y + k * m, u, &r);
    if (run->mean != NULL)
      memcpy(run->mean + n * k, state->mean, n * sizeof *state->mean);
    if (run->innovation != NULL)
      memcpy(run->innovation + m * k, r.innovation, m * sizeof *r.innovation);
    if (run->variance != NULL)
      memcpy(run->variance + m * k, r.variance, m * sizeof *r.variance);
    if (run->status != NULL)
      run->status[k] = (unsigned short)r.status;
    if (run->truth != NULL) {
      for (size_t j = 0; (k >= skip) && (j < AMB_BATCH_JUDGED); j++) {
        const amb_real d = state->mean[j] - run->truth[AMB_BATCH_JUDGED * k + j];
        sum[j] += d * d;
      }
      for (size_t j = 0; j < AMB_BATCH_JUDGED; j++)
        if ((k + 1 == samples) || ((k + 1) % AMB_BATCH_BLOCK == 0)) {
          run->squares[j] += (double)sum[j];
          sum[j] = AMB_C(0.0);
        }
    }
  }
}

void amb_batch_advance(amb_instructions instructions, amb_batch_run *const runs[], size_t count,
                       size_t n, size_t skip)
{
  for (size_t i = 0; i < count; i++) {
    memset(runs[i]->squares, 0, sizeof runs[i]->squares);
    runs[i]->all = AMB_OK;
  }
  if (count == 0)
    return;
  const amb_lanes *lanes = amb_lanes_of(instructions);
  if ((lanes != NULL) && (amb_batch_group(runs[0]->estimator) != 0U)) {
    lanes->run(runs, count, n, skip);
    return;
  }
  for (size_t i = 0; i < count; i++)
    run_one(runs[i], n, skip);
}

amb_status amb_batch_one(amb_instructions instructions, const amb_estimator *estimator, void *state,
                         const amb_kalman_input *in, const amb_kalman_history *history)
{
  const amb_lanes *lanes = amb_lanes_of(instructions);
  if ((estimator->methods == &amb_kalman_methods) && (lanes != NULL) && (lanes->isolated != NULL))
    return lanes->isolated(estimator->kf, estimator->magnet, (amb_kalman_state *)state, in,
                           history);
  return amb_estimator_run(estimator, state, in, history);
}
