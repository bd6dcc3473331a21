/* What simulation needs of doubles beyond C's operators, without math.h, which brings extensions of
 * compilers along. Whatever the core computes in, these are doubles.
 */
#ifndef AMBKIT_SIM_DOUBLES_H
#define AMBKIT_SIM_DOUBLES_H

#include <stdint.h>

/* The C library's, rounded correctly: one instruction where there is one. A program may declare it
 * itself (C99, 7.1.4). */
double sqrt(double a);

/* A number and its bits. */
typedef union amb_double_bits {
  double number;
  uint64_t bits;
} amb_double_bits;

static inline double amb_double_of(uint64_t bits)
{
  amb_double_bits of;
  of.bits = bits;
  return of.number;
}

static inline double amb_double_infinity(void)
{
  return amb_double_of(UINT64_C(0x7FF0000000000000));
}

static inline double amb_double_nan(void)
{
  return amb_double_of(UINT64_C(0x7FF8000000000000));
}

#endif
