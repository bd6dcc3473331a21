/* exp(-t) for t >= 0, without libm: the same bits on x86 and on Cortex-M4, and a loop over it is
 * vectorised (no branch, no call).
 *
 * t = n ln 2 - r with |r| <= ln 2 / 2; adding 1.5 * 2^(mantissa bits) rounds t / ln 2 to n and
 * leaves n in the low bits, from where it is moved into the exponent of 2^-n. exp(r) is a
 * polynomial (models/exponential.py). Relative error below 2 machine epsilons
 * (tests/test_exponential.py); t is held to the range whose result is a normal number, so e^-t
 * never falls below about 2e-308 (1e-38 in float). NaN gives that smallest value. IEEE 754
 * arithmetic, round to nearest.
 */
#ifndef AMBKIT_EXPONENTIAL_H
#define AMBKIT_EXPONENTIAL_H

#include "ambkit/real.h"
#include "generated/exponential.h"
#include <stdint.h>

#if defined(AMB_FLOAT)

/* A number and its bits, which C99 lets us read either way. */
typedef union amb_bits {
  float number;
  uint32_t bits;
} amb_bits;

/*@ requires \is_finite(t) && t >= 0;
  @ assigns \result \from t;
  @ ensures \is_finite(\result) && 0 <= \result <= 1; */
static inline float amb_exp_negative(float t)
{
  const float held = t < 87.0F ? t : 87.0F;
  const float shifted = held * 1.44269504F + 12582912.0F;
  const float n = shifted - 12582912.0F;
  const float r = (n * 0.693359375F - held) + n * -2.12194440e-4F; /* ln 2 in two parts */
  const float p = amb_exp_polynomial(r);
  amb_bits power;
  power.number = shifted;
  power.bits = (UINT32_C(127) - power.bits) << 23;
  return p * power.number;
}

#else

typedef union amb_bits {
  double number;
  uint64_t bits;
} amb_bits;

/*@ requires \is_finite(t) && t >= 0;
  @ assigns \result \from t;
  @ ensures \is_finite(\result) && 0 <= \result <= 1; */
static inline double amb_exp_negative(double t)
{
  const double held = t < 708.0 ? t : 708.0;
  const double shifted = held * 1.4426950408889634 + 6755399441055744.0;
  const double n = shifted - 6755399441055744.0;
  const double r = (n * 0.69314718036912382 - held) + n * 1.9082149292705877e-10;
  const double p = amb_exp_polynomial(r);
  amb_bits power;
  power.number = shifted;
  power.bits = (UINT64_C(1023) - power.bits) << 52;
  return p * power.number;
}

#endif

#endif
