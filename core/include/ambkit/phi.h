/* phi_k(z) = sum over n of (-z)^n / (n+k)!, z >= 0: response of a first-order lag to an input that
 * rises with the (k-1)th power of time; phi_0 = exp(-z), phi_{k+1} = (1/k! - phi_k) / z. The
 * recursion cancels for small z, where the series is used; from 1 on it loses less than two bits
 * per step. */
#ifndef AMBKIT_PHI_H
#define AMBKIT_PHI_H

#include "ambkit/exponential.h"

#define AMB_PHI_TERMS 18 /* 1 / 20! is below the rounding of a double, relative to 1 / 2! */

/* phi_k by its series, from the last term to the first; `first` is 1 / k!. */
static inline amb_real amb_phi_series(int k, amb_real first, amb_real z)
{
  amb_real sum = AMB_C(1.0);
  for (int n = AMB_PHI_TERMS; n > 0; n--) {
    const int place = n + k;
    sum = AMB_C(1.0) - (z * sum) / (amb_real)place;
  }
  return first * sum;
}

static inline amb_real amb_phi1(amb_real z)
{
  return (z < AMB_C(1.0)) ? amb_phi_series(1, AMB_C(1.0), z)
                          : ((AMB_C(1.0) - amb_exp_negative(z)) / z);
}

static inline amb_real amb_phi2(amb_real z)
{
  return (z < AMB_C(1.0)) ? amb_phi_series(2, AMB_C(0.5), z) : ((AMB_C(1.0) - amb_phi1(z)) / z);
}

static inline amb_real amb_phi3(amb_real z)
{
  return (z < AMB_C(1.0)) ? amb_phi_series(3, AMB_C(1.0) / AMB_C(6.0), z)
                          : ((AMB_C(0.5) - amb_phi2(z)) / z);
}

#endif
