/* The builds of lanes.c. */
#ifndef AMBKIT_SIM_LANES_RUN_H
#define AMBKIT_SIM_LANES_RUN_H

#include "ambkit/fuzzy.h"
#include "ambkit/kalman_run.h"
#include "many.h"

/* The vectors are GCC's and clang's, and the loops over any model have no text for them. Other
 * compilers, and those that are told to do without, run one after the other: the same bits. */
#if defined(__GNUC__) && !defined(AMB_NO_VECTORS) && !defined(AMB_MODEL_LOOPS)
#define AMB_HAS_LANES
#endif

/* One build for each set of instructions: bytes of a vector, and the ending of its names. */
#if !defined(AMB_LANES_BYTES)
#define AMB_LANES_BYTES 16
#define AMB_LANES_NAME(name) name##_baseline
#elif AMB_LANES_BYTES == 32
#define AMB_LANES_NAME(name) name##_avx2
#else
#define AMB_LANES_NAME(name) name##_avx512
#endif

/* As amb_batch_advance. */
void amb_lanes_run_baseline(amb_batch_run *const runs[], size_t count, size_t n, size_t skip);
void amb_lanes_run_avx2(amb_batch_run *const runs[], size_t count, size_t n, size_t skip);
void amb_lanes_run_avx512(amb_batch_run *const runs[], size_t count, size_t n, size_t skip);

/* As amb_many_advance. */
void amb_lanes_many_baseline(amb_many_run *const runs[], size_t count, size_t n);
void amb_lanes_many_avx2(amb_many_run *const runs[], size_t count, size_t n);
void amb_lanes_many_avx512(amb_many_run *const runs[], size_t count, size_t n);

/* As amb_noise_normal, the same bits. */
void amb_lanes_noise_avx2(amb_noise_key key, uint32_t stream, size_t first, size_t n, double *to);
void amb_lanes_noise_avx512(amb_noise_key key, uint32_t stream, size_t first, size_t n, double *to);

/* As amb_kalman_run. */
amb_status amb_kalman_run_avx2(const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES],
                               amb_kalman_state *state, const amb_kalman_input *input,
                               const amb_kalman_history *history);
amb_status amb_kalman_run_avx512(const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES],
                                 amb_kalman_state *state, const amb_kalman_input *input,
                                 const amb_kalman_history *history);

/* The fuzzy network in the same builds; it computes its rules side by side. */
#if AMB_LANES_BYTES > 16
extern const amb_magnet_methods AMB_LANES_NAME(amb_fuzzy_magnet);
#endif

#endif
