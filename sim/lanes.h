/* The core's text for several filters side by side: the generated model and the closed law,
 * compiled with vectors in place of numbers (GCC and clang). Lanes never mix. */
#ifndef AMBKIT_SIM_LANES_H
#define AMBKIT_SIM_LANES_H

#include "lanes_run.h"
#include "src/kalman_step.h"
#include <stdint.h>
#if defined(__x86_64__) || defined(__i386__)
#include <immintrin.h>
#endif

#define LANES (AMB_LANES_BYTES / sizeof(amb_real))

typedef amb_real lanes __attribute__((vector_size(AMB_LANES_BYTES)));
#if defined(AMB_FLOAT)
typedef int32_t lanes_mask __attribute__((vector_size(AMB_LANES_BYTES)));
#else
typedef int64_t lanes_mask __attribute__((vector_size(AMB_LANES_BYTES)));
#endif

/* With the names of amb_stiffness. */
typedef struct lanes_stiffness {
  lanes k_i, k_s;
} lanes_stiffness;

/* The closed law, with the names of amb_law. */
typedef struct lanes_law {
  lanes k, s0, i0, ampere, metre;
} lanes_law;

/* The same text again; from here on its functions have lanes' names. */
#define AMB_SIDE_BY_SIDE
#define amb_real lanes
#define amb_stiffness lanes_stiffness
#define amb_model lanes_model
#define amb_model_displacement lanes_model_displacement
#define amb_model_current lanes_model_current
#define amb_model_shown lanes_model_shown
#define amb_model_shown_variance lanes_model_shown_variance
#define amb_model_shown_with lanes_model_shown_with
#define amb_model_equilibrium lanes_model_equilibrium
#define amb_model_predict_mean lanes_model_predict_mean
#define amb_model_predict_covariance lanes_model_predict_covariance
#define amb_model_update lanes_model_update
#define amb_model_variances lanes_model_variances
#define amb_law lanes_law
#define amb_law_force lanes_law_force
#define amb_law_tangent lanes_law_tangent
#define amb_law_regressor lanes_law_regressor
#define amb_law_force_one_sided lanes_law_force_one_sided
#define amb_turn_square lanes_turn_square
#define amb_turn lanes_turn
#undef AMBKIT_GENERATED_AXIAL_H
#undef AMBKIT_GENERATED_CLOSED_LAW_H
#undef AMBKIT_TURN_H
#include "generated/axial.h"
#include "generated/closed_law.h"
#include "src/turn.h"
#undef AMB_SIDE_BY_SIDE
#undef amb_real
#undef amb_stiffness
#undef amb_model
#undef amb_law

AMB_INLINE lanes lanes_all_equal(amb_real a)
{
  const lanes zero = {AMB_C(0.0)};
  return zero + a;
}

/* `a` where the mask is set, else 0. */
AMB_INLINE lanes lanes_where(lanes_mask mask, lanes a)
{
  return (lanes)((lanes_mask)a & mask);
}

AMB_INLINE lanes lanes_choose(lanes_mask mask, lanes a, lanes b)
{
  return (lanes)(((lanes_mask)a & mask) | ((lanes_mask)b & ~mask));
}

/* As amb_clamp. */
AMB_INLINE lanes lanes_clamp(lanes a, lanes low, lanes high)
{
  const lanes above = lanes_choose(a < low, low, a);
  return lanes_choose(above > high, high, above);
}

/* Whether the mask is set in any lane. */
AMB_INLINE bool lanes_any(lanes_mask mask)
{
#if defined(__AVX512F__) && AMB_LANES_BYTES == 64
  return _mm512_test_epi32_mask((__m512i)mask, (__m512i)mask) != 0;
#elif defined(__AVX__) && AMB_LANES_BYTES == 32
  return _mm256_testz_si256((__m256i)mask, (__m256i)mask) == 0;
#elif defined(__SSE2__) && AMB_LANES_BYTES == 16
  return _mm_movemask_epi8((__m128i)mask) != 0;
#else
  bool any = false;
  for (size_t i = 0; i < LANES; i++)
    any = any || (mask[i] != 0);
  return any;
#endif
}

#endif
