/* The number type of the core, float or double (ambkit/precision.h). */
#ifndef AMBKIT_REAL_H
#define AMBKIT_REAL_H

#include "ambkit/precision.h"
#include <float.h>
#include <stdbool.h>
#include <stddef.h>

#if defined(AMB_FLOAT) && defined(AMB_DOUBLE)
#error "AMB_FLOAT and AMB_DOUBLE exclude each other"
#endif

#if defined(AMB_FLOAT)
#if FLT_MANT_DIG != 24
#error "float is not IEEE 754 binary32"
#endif
typedef float amb_real;
#define AMB_C(literal) literal##F
#define AMB_REAL_MAX FLT_MAX
#define AMB_REAL_MIN FLT_MIN
#define AMB_REAL_ROOT 1.8446743e19F    /* its square is still finite */
#define AMB_ROOT_EPSILON 3.4526698e-4F /* half of the digits */
#else
#if DBL_MANT_DIG != 53
#error "double is not IEEE 754 binary64; the float build needs no double"
#endif
typedef double amb_real;
#define AMB_C(literal) literal
#define AMB_REAL_MAX DBL_MAX
#define AMB_REAL_MIN DBL_MIN
#define AMB_REAL_ROOT 1.3407807929942596e154 /* its square is still finite */
#define AMB_ROOT_EPSILON 1.4901161193847656e-8
#endif

/* Whether |a| <= most; false for NaN. Comparisons of `a` itself show its bounds to a static
 * analyser, and that it is a number (`a == a`); where a magnitude is one instruction, one
 * comparison suffices. */
#if defined(__GNUC__) && !defined(__FRAMAC__) && defined(AMB_FLOAT)
#define AMB_WITHIN(a, most) (__builtin_fabsf(a) <= (most))
#elif defined(__GNUC__) && !defined(__FRAMAC__)
#define AMB_WITHIN(a, most) (__builtin_fabs(a) <= (most))
#else
#define AMB_WITHIN(a, most) (((a) == (a)) && ((a) >= -(most)) && ((a) <= (most)))
#endif

/* Around declarations, for C++. */
#ifdef __cplusplus
#define AMB_EXTERN_C_BEGIN extern "C" {
#define AMB_EXTERN_C_END }
#else
#define AMB_EXTERN_C_BEGIN
#define AMB_EXTERN_C_END
#endif

/* For the parts of a step, so that its state stays in registers. */
#if defined(__GNUC__)
#define AMB_INLINE __attribute__((always_inline)) static inline
#else
#define AMB_INLINE static inline
#endif

/* False for NaN and for both infinities; no libm. */
static inline bool amb_is_finite(amb_real a)
{
  return (a >= -AMB_REAL_MAX) && (a <= AMB_REAL_MAX);
}

static inline bool amb_is_positive(amb_real a)
{
  return (a > AMB_C(0.0)) && (a <= AMB_REAL_MAX);
}

static inline amb_real amb_magnitude(amb_real a)
{
  return a < AMB_C(0.0) ? -a : a;
}

static inline amb_real amb_clamp(amb_real a, amb_real low, amb_real high)
{
  const amb_real above = a < low ? low : a;
  return above > high ? high : above;
}

/* The larger one; `least` if `a` is NaN. */
static inline amb_real amb_at_least(amb_real a, amb_real least)
{
  return (a > least) ? a : least;
}

/* The smaller one; `most` if `a` is NaN. */
static inline amb_real amb_at_most(amb_real a, amb_real most)
{
  return (a < most) ? a : most;
}

AMB_INLINE void amb_copy(int n, const amb_real from[], amb_real to[])
{
  for (int i = 0; i < n; i++) {
    to[i] = from[i];
  }
}

/* Whether magnitudes are within so many times these; false if one is NaN. */
static inline bool amb_all_within(int n, const amb_real a[], amb_real times, const amb_real most[])
{
  bool within = true;
  for (int i = 0; i < n; i++) {
    within = within && (amb_magnitude(a[i]) <= (times * most[i]));
  }
  return within;
}

AMB_INLINE void amb_clear(int n, amb_real a[])
{
  for (int i = 0; i < n; i++) {
    a[i] = AMB_C(0.0);
  }
}

/* Standard deviation of a sensor's noise at the reading y [m], relative to that at the centre: it
 * changes by `rise` per metre [1/m], within limits, because a straight line becomes negative. */
static inline amb_real amb_noise_share(amb_real rise, amb_real y)
{
  return amb_clamp(AMB_C(1.0) + rise * y, AMB_C(0.125), AMB_C(8.0));
}

#endif
