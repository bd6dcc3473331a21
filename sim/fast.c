#include "fast.h"
#include "lanes_run.h"

amb_instructions amb_fastest(void)
{
  amb_instructions best = AMB_SCALAR;
  for (int set = AMB_SCALAR; set <= AMB_AVX512; set++)
    if (amb_batch_has((amb_instructions)set))
      best = (amb_instructions)set;
  return best;
}

amb_status amb_fast_run(amb_instructions instructions, const amb_estimator *estimator, void *state,
                        const amb_kalman_input *in, const amb_kalman_history *history)
{
  (void)instructions;
#if defined(AMB_LANES_X86) && defined(AMB_HAS_LANES)
  if (estimator->methods == &amb_kalman_methods) {
    amb_kalman_state *own = (amb_kalman_state *)state;
    if (instructions == AMB_AVX512)
      return amb_kalman_run_avx512(estimator->kf, estimator->magnet, own, in, history);
    if (instructions == AMB_AVX2)
      return amb_kalman_run_avx2(estimator->kf, estimator->magnet, own, in, history);
  }
#endif
  return amb_estimator_run(estimator, state, in, history);
}
