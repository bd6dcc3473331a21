#include "noise.h"
#include "ambkit/real.h"
#include "noise_drawn.h"

void amb_philox(const uint32_t counter[4], const uint32_t key[2], uint32_t random[4])
{
  uint32_t a = counter[0], b = counter[1], c = counter[2], d = counter[3];
  uint32_t k = key[0], l = key[1];
  for (int round = 0; round < AMB_PHILOX_ROUNDS; round++) {
    const uint64_t p = (uint64_t)AMB_PHILOX_M0 * a, q = (uint64_t)AMB_PHILOX_M1 * c;
    a = (uint32_t)(q >> 32) ^ b ^ k;
    b = (uint32_t)q;
    c = (uint32_t)(p >> 32) ^ d ^ l;
    d = (uint32_t)p;
    k += AMB_PHILOX_W0;
    l += AMB_PHILOX_W1;
  }
  random[0] = a;
  random[1] = b;
  random[2] = c;
  random[3] = d;
}

double amb_normal_at(double q)
{
  const double share = 0.5 - (q < 0.0 ? -q : q);
  if ((q <= AMB_NORMAL_CENTRAL) && (q >= -AMB_NORMAL_CENTRAL))
    return amb_normal_central(q);
  const double z = share < AMB_NORMAL_FAR ? amb_normal_far(share) : amb_normal_near(share);
  return q < 0.0 ? -z : z;
}

void amb_noise_normal(amb_noise_key key, uint32_t stream, size_t first, size_t n, double *to)
{
  amb_noise_series(key, stream, first, n, to);
}
