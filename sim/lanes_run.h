/* The builds of lanes.c. */
#ifndef AMBKIT_SIM_LANES_RUN_H
#define AMBKIT_SIM_LANES_RUN_H

#include "ambkit/fuzzy.h"
#include "ambkit/kalman_run.h"
#include "many.h"

/* The vectors need GCC or clang, and the loops over any model have no vector text. Other builds
 * compute one run after the other, with the same bits. */
#if defined(__GNUC__) && !defined(AMB_NO_VECTORS) && !defined(AMB_MODEL_LOOPS)
#define AMB_HAS_LANES
#endif

/* One build per instruction set: bytes of a vector, and the suffix of its names. */
#if !defined(AMB_LANES_BYTES)
#define AMB_LANES_BYTES 16
#define AMB_LANES_NAME(name) name##_baseline
#elif AMB_LANES_BYTES == 32
#define AMB_LANES_NAME(name) name##_avx2
#else
#define AMB_LANES_NAME(name) name##_avx512
#endif

/* Contents of a build. */
typedef struct amb_lanes {
  /* As amb_batch_advance and amb_many_advance; the latter is NULL in single precision. */
  void (*run)(amb_batch_run *const runs[], size_t count, size_t n, size_t skip);
  void (*many)(amb_many_run *const runs[], size_t count, size_t n);
  /* As amb_noise_normal and amb_kalman_run, with the same bits; NULL: these. */
  void (*noise)(amb_noise_key key, uint32_t stream, size_t first, size_t n, double *to);
  amb_status (*isolated)(const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES],
                         amb_kalman_state *state, const amb_kalman_input *input,
                         const amb_kalman_history *history);
} amb_lanes;

extern const amb_lanes amb_lanes_baseline, amb_lanes_avx2, amb_lanes_avx512;

/* The build for these instructions; NULL: runs are computed one after the other. */
const amb_lanes *amb_lanes_of(amb_instructions instructions);

/* Parts of this build in files of their own. */
void AMB_LANES_NAME(amb_lanes_many)(amb_many_run *const runs[], size_t count, size_t n);
#if AMB_LANES_BYTES > 16
amb_status AMB_LANES_NAME(amb_kalman_run)(const amb_kalman *kf, const amb_magnet magnet[AMB_FORCES],
                                          amb_kalman_state *state, const amb_kalman_input *input,
                                          const amb_kalman_history *history);

/* The fuzzy network, with its rules side by side. */
extern const amb_magnet_methods AMB_LANES_NAME(amb_fuzzy_magnet);
#endif

#endif
