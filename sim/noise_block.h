/* Noise of several samples at once, in loops that compilers vectorise; many.h defines it. Inline,
 * so that each instruction set has its own version. */
#ifndef AMBKIT_SIM_NOISE_BLOCK_H
#define AMBKIT_SIM_NOISE_BLOCK_H

#include "many.h"

/* The C library's correctly rounded root, a single instruction on most processors. Declared here as
 * C99 (7.1.4) permits, because math.h brings extensions of compilers. */
double sqrt(double a);

/* A number and its bits. */
typedef union amb_double_bits {
  double number;
  uint64_t bits;
} amb_double_bits;

#define AMB_PHILOX_ROUNDS 10
#define AMB_PHILOX_M0 UINT32_C(0xD2511F53)
#define AMB_PHILOX_M1 UINT32_C(0xCD9E8D57)
#define AMB_PHILOX_W0 UINT32_C(0x9E3779B9)
#define AMB_PHILOX_W1 UINT32_C(0xBB67AE85)

#define AMB_NORMAL_CENTRAL 0.425              /* of q = p - 1/2, either sign */
#define AMB_NORMAL_FAR 1.3887943864964021e-11 /* exp(-25) */

/* Natural logarithm of a normal number a > 0, to about one machine epsilon: a = 2^e m with m
 * between the roots of 1/2 and 2, and log m = 2 artanh(s), s = (m - 1)/(m + 1), by its series. */
AMB_INLINE double amb_noise_log(double a)
{
  amb_double_bits of;
  of.number = a;
  const uint64_t root_half = UINT64_C(0x3FE6A09E667F3BCD);
  const uint64_t moved = of.bits + (UINT64_C(0x3FF0000000000000) - root_half);
  const double e = (double)(int)(moved >> 52) - 1023.0;
  of.bits = (moved & UINT64_C(0x000FFFFFFFFFFFFF)) + root_half;
  const double s = (of.number - 1.0) / (of.number + 1.0), z = s * s;
  double tail = 1.0 / 23.0;
  for (int i = 21; i > 1; i -= 2)
    tail = tail * z + 1.0 / (double)i;
  const double twice = 2.0 * s;
  return e * 0.69314718036912382 + ((twice * z * tail + e * 1.9082149292705877e-10) + twice);
}

/* Polynomial of degree 7, coefficients from the highest on. */
AMB_INLINE double amb_polynomial(double r, double a, double b, double c, double d, double e,
                                 double f, double g, double h)
{
  return (((((((a * r + b) * r + c) * r + d) * r + e) * r + f) * r + g) * r + h);
}

/* AS 241, routine PPND16: |q| <= 0.425 ... */
AMB_INLINE double amb_normal_central(double q)
{
  const double r = 0.180625 - q * q;
  const double above =
      amb_polynomial(r, 2.5090809287301226727e3, 3.3430575583588128105e4, 6.7265770927008700853e4,
                     4.5921953931549871457e4, 1.3731693765509461125e4, 1.9715909503065514427e3,
                     1.3314166789178437745e2, 3.3871328727963666080e0);
  const double below =
      amb_polynomial(r, 5.2264952788528545610e3, 2.8729085735721942674e4, 3.9307895800092710610e4,
                     2.1213794301586595867e4, 5.3941960214247511077e3, 6.8718700749205790830e2,
                     4.2313330701600911252e1, 1.0);
  return q * above / below;
}

/* ... and the tails, with a probability of `share`: for r, the root of -log(share), up to 5, which
 * excludes 3 in 10^11 ... */
AMB_INLINE double amb_normal_near(double share)
{
  const double r = sqrt(-amb_noise_log(share)) - 1.6;
  const double above =
      amb_polynomial(r, 7.74545014278341407640e-4, 2.27238449892691845833e-2,
                     2.41780725177450611770e-1, 1.27045825245236838258e0, 3.64784832476320460504e0,
                     5.76949722146069140550e0, 4.63033784615654529590e0, 1.42343711074968357734e0);
  const double below = amb_polynomial(r, 1.05075007164441684324e-9, 5.47593808499534494600e-4,
                                      1.51986665636164571966e-2, 1.48103976427480074590e-1,
                                      6.89767334985100004550e-1, 1.67638483018380384940e0,
                                      2.05319162663775882187e0, 1.0);
  return above / below;
}

/* ... and beyond. */
AMB_INLINE double amb_normal_far(double share)
{
  const double r = sqrt(-amb_noise_log(share)) - 5.0;
  const double above = amb_polynomial(r, 2.01033439929228813265e-7, 2.71155556874348757815e-5,
                                      1.24266094738807843860e-3, 2.65321895265761230930e-2,
                                      2.96560571828504891230e-1, 1.78482653991729133580e0,
                                      5.46378491116411436990e0, 6.65790464350110377720e0);
  const double below = amb_polynomial(r, 2.04426310338993978564e-15, 1.42151175831644588870e-7,
                                      1.84631831751005468180e-5, 7.86869131145613259100e-4,
                                      1.48753612908506148525e-2, 1.36929880922735805310e-1,
                                      5.99832206555887937690e-1, 1.0);
  return above / below;
}

/* Philox: ten rounds turn a counter of four words and a key of two into four random words; for
 * several counters, word by word. */
AMB_INLINE void amb_philox_rounds(size_t count, uint32_t k, uint32_t l, uint32_t a[], uint32_t b[],
                                  uint32_t c[], uint32_t d[])
{
  for (int round = 0; round < AMB_PHILOX_ROUNDS; round++) {
    for (size_t i = 0; i < count; i++) {
      const uint64_t p = (uint64_t)AMB_PHILOX_M0 * a[i], q = (uint64_t)AMB_PHILOX_M1 * c[i];
      a[i] = (uint32_t)(q >> 32) ^ b[i] ^ k;
      b[i] = (uint32_t)q;
      c[i] = (uint32_t)(p >> 32) ^ d[i] ^ l;
      d[i] = (uint32_t)p;
    }
    k += AMB_PHILOX_W0;
    l += AMB_PHILOX_W1;
  }
}

/* AMB_NOISE_DRAWN variates from sample `first` on, a multiple of that number. */
AMB_INLINE void amb_noise_block(amb_noise_key key, uint32_t stream, size_t first, double *to)
{
  enum { PAIRS = AMB_NOISE_BLOCK / 2 };
  uint32_t a[PAIRS], b[PAIRS], c[PAIRS], d[PAIRS];
  for (size_t i = 0; i < PAIRS; i++) {
    a[i] = (uint32_t)(first / 2 + i);
    b[i] = stream;
    c[i] = (uint32_t)key.run;
    d[i] = (uint32_t)(key.run >> 32);
  }
  amb_philox_rounds(PAIRS, (uint32_t)key.seed, (uint32_t)(key.seed >> 32), a, b, c, d);
  double q[AMB_NOISE_BLOCK];
  for (size_t i = 0; i < PAIRS; i++) {
    amb_double_bits first_word, second_word; /* 52 bits of the four words, as 1 to 2 */
    first_word.bits = (((uint64_t)b[i] << 20) ^ (a[i] >> 12)) | UINT64_C(0x3FF0000000000000);
    second_word.bits = (((uint64_t)d[i] << 20) ^ (c[i] >> 12)) | UINT64_C(0x3FF0000000000000);
    q[2 * i] = (first_word.number - 1.5) + 1.1102230246251565e-16; /* never 1/2, never 0 */
    q[2 * i + 1] = (second_word.number - 1.5) + 1.1102230246251565e-16;
  }
  for (size_t i = 0; i < AMB_NOISE_BLOCK; i++)
    to[i] = amb_normal_central(q[i]);
  /* The tails are gathered, so that they are vectorised as well. */
  size_t at[AMB_NOISE_BLOCK], others = 0;
  double share[AMB_NOISE_BLOCK], z[AMB_NOISE_BLOCK];
  for (size_t i = 0; i < AMB_NOISE_BLOCK; i++) {
    const double away = q[i] < 0.0 ? -q[i] : q[i];
    at[others] = i;
    share[others] = 0.5 - away;
    others += away > AMB_NORMAL_CENTRAL ? 1U : 0U;
  }
  for (size_t j = 0; j < others; j++)
    z[j] = amb_normal_near(share[j]);
  for (size_t j = 0; j < others; j++) {
    const double away = share[j] < AMB_NORMAL_FAR ? amb_normal_far(share[j]) : z[j];
    to[at[j]] = q[at[j]] < 0.0 ? -away : away;
  }
}

/* Standard normal variates of samples `first` to `first + n`, n values in `to`. */
AMB_INLINE void amb_noise_normal(amb_noise_key key, uint32_t stream, size_t first, size_t n,
                                 double *to)
{
  double normal[AMB_NOISE_BLOCK];
  for (size_t at = first - first % AMB_NOISE_BLOCK; at < first + n; at += AMB_NOISE_BLOCK) {
    amb_noise_block(key, stream, at, normal);
    for (size_t i = 0; i < AMB_NOISE_BLOCK; i++)
      if ((at + i >= first) && (at + i < first + n))
        to[at + i - first] = normal[i];
  }
}

#endif
