/* Square root of a >= 0, without libm: the same bits on x86 and on Cortex-M4.
 *
 * Newton's iteration for 1 / sqrt(a), which needs no division, from a start that halves and turns
 * the exponent (Lomont 2003); each step doubles the digits. The last one is for the root itself.
 * Relative error below 1.5 machine epsilons for normal numbers, 0 for 0 (tests/c/test_root.c);
 * anything for what is negative or not finite.
 */
#ifndef AMBKIT_ROOT_H
#define AMBKIT_ROOT_H

#include "ambkit/exponential.h"

/*@ requires \is_finite(a) && a >= 0;
  @ assigns \result \from a;
  @ ensures \is_finite(\result) && 0 <= \result <= 1 + a; */
static inline amb_real amb_root(amb_real a)
{
  const amb_real half = AMB_C(0.5) * a;
  amb_bits guess;
  guess.number = a;
#if defined(AMB_FLOAT)
  guess.bits = UINT32_C(0x5F3759DF) - (guess.bits >> 1);
  const int steps = 3;
#else
  guess.bits = UINT64_C(0x5FE6EB50C7B537A9) - (guess.bits >> 1);
  const int steps = 4;
#endif
  amb_real inverse = guess.number;
  for (int i = 0; i < steps; i++) {
    inverse *= AMB_C(1.5) - (half * inverse) * inverse;
  }
  const amb_real root = a * inverse;
  return root + (AMB_C(0.5) * inverse) * (a - root * root);
}

#endif
