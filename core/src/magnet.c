#include "ambkit/magnet.h"

static amb_real constant_force(const void *self, amb_real iu, amb_real x)
{
  const amb_stiffness *k = (const amb_stiffness *)self;
  return k->k_i * iu + k->k_s * x;
}

static amb_stiffness constant_stiffness(const void *self, amb_real iu, amb_real x)
{
  (void)iu;
  (void)x;
  return *(const amb_stiffness *)self;
}

const amb_magnet_methods amb_constant_magnet = {constant_force, constant_stiffness,
                                                constant_stiffness};

/* Paper, eq. 1 and 25: what multiplies k. */
amb_real amb_law_regressor(const amb_law *law, amb_real iu, amb_real x)
{
  const amb_real own = (law->i0 + iu) / (law->s0 - x);
  const amb_real other = (law->i0 - iu) / (law->s0 + x);
  return own * own - (law->two_sided ? (other * other) : AMB_C(0.0));
}

/* F - F(0, 0) as a product, a^2 - b^2 = (a + b)(a - b): no cancellation near the origin. */
static amb_real law_force(const void *self, amb_real iu, amb_real x)
{
  const amb_law *law = (const amb_law *)self;
  const amb_real i0 = law->i0;
  const amb_real s0 = law->s0;
  const amb_real shift = i0 * x + iu * s0;
  if (law->two_sided) {
    const amb_real gaps = (s0 - x) * (s0 + x);
    return AMB_C(4.0) * law->k * (i0 * s0 + iu * x) * shift / (gaps * gaps);
  }
  const amb_real own = (i0 + iu) / (s0 - x);
  return law->k * (own + i0 / s0) * shift / ((s0 - x) * s0);
}

static amb_stiffness law_tangent(const void *self, amb_real iu, amb_real x)
{
  const amb_law *law = (const amb_law *)self;
  const amb_real own = AMB_C(1.0) / (law->s0 - x); /* of this magnet's gap */
  const amb_real other = AMB_C(1.0) / (law->s0 + x);
  const amb_real a = (law->i0 + iu) * own;
  const amb_real b = (law->i0 - iu) * other;
  const amb_real there = law->two_sided ? AMB_C(1.0) : AMB_C(0.0);
  amb_stiffness k;
  k.k_i = AMB_C(2.0) * law->k * (a * own + there * b * other);
  k.k_s = AMB_C(2.0) * law->k * (a * a * own + there * b * b * other);
  return k;
}

/* The limit of the paper's least squares (eq. 28-31) for small steps: F itself along the ray
 * through the origin, the tangent across it. With p = (iu / ampere, x / metre):
 * k . p = F and k . p' = grad F . p', where p' is p turned by 90 degrees. */
static amb_stiffness law_through_origin(const void *self, amb_real iu, amb_real x)
{
  const amb_law *law = (const amb_law *)self;
  amb_stiffness k = law_tangent(self, iu, x);
  const amb_real p = iu / law->ampere;
  const amb_real q = x / law->metre;
  const amb_real square = p * p + q * q;
  if (square >= AMB_REAL_MIN) { /* closer, it is the tangent to all digits */
    const amb_real g_p = k.k_i * law->ampere;
    const amb_real g_q = k.k_s * law->metre;
    const amb_real along = law_force(self, iu, x) / square;
    const amb_real across = (g_q * p - g_p * q) / square;
    k.k_i = (along * p - across * q) / law->ampere;
    k.k_s = (along * q + across * p) / law->metre;
  }
  return k;
}

const amb_magnet_methods amb_law_magnet = {law_force, law_through_origin, law_tangent};
