/* exp(r) for |r| <= ln 2 / 2. Written by `python -m models`; do not edit. */
#ifndef AMBKIT_GENERATED_EXPONENTIAL_H
#define AMBKIT_GENERATED_EXPONENTIAL_H

#include "ambkit/real.h"

static inline amb_real amb_exp_polynomial(amb_real r1)
{
#if defined(AMB_FLOAT)
  const amb_real p1_0 = 1.00000000F + r1 * 1.00000004F;
  const amb_real p1_1 = 5.00000005e-1F + r1 * 1.66664154e-1F;
  const amb_real p1_2 = 4.16663528e-2F + r1 * 8.37513477e-3F;
  const amb_real p1_3 = 1.39411189e-3F;
  const amb_real r2 = r1 * r1;
  const amb_real p2_0 = p1_0 + r2 * p1_1;
  const amb_real p2_1 = p1_2 + r2 * p1_3;
  const amb_real r4 = r2 * r2;
  return p2_0 + r4 * p2_1;
#else
  const amb_real p1_0 = 1.0000000000000000 + r1 * 1.0000000000000000;
  const amb_real p1_1 = 5.0000000000000184e-1 + r1 * 1.6666666666666681e-1;
  const amb_real p1_2 = 4.1666666666487953e-2 + r1 * 8.3333333333195896e-3;
  const amb_real p1_3 = 1.3888888952352863e-3 + r1 * 1.9841269890076403e-4;
  const amb_real p1_4 = 2.4801485441561313e-5 + r1 * 2.7557240887229869e-6;
  const amb_real p1_5 = 2.7632654722527792e-7 + r1 * 2.5110049204818660e-8;
  const amb_real r2 = r1 * r1;
  const amb_real p2_0 = p1_0 + r2 * p1_1;
  const amb_real p2_1 = p1_2 + r2 * p1_3;
  const amb_real p2_2 = p1_4 + r2 * p1_5;
  const amb_real r4 = r2 * r2;
  const amb_real p4_0 = p2_0 + r4 * p2_1;
  const amb_real p4_1 = p2_2;
  const amb_real r8 = r4 * r4;
  return p4_0 + r8 * p4_1;
#endif
}

#endif
