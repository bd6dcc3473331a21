/* The force law of saturating iron, as a magnet. Written by `python -m models`; do not edit. */
#include "ambkit/saturating.h"
#include "ambkit/root.h"
#include "turn.h"

/* F - F(0, 0) as a product, a^2 - b^2 = (a + b)(a - b), from differences of gap and current, so
 * that nothing cancels. `there` is 1, or 0 where b is of the origin. */
AMB_INLINE amb_real amb_saturating_force(const amb_saturating_law *law, amb_real there, amb_real iu,
                                         amb_real x)
{
  const amb_real g1 = law->s0 - x;
  const amb_real i1 = law->i0 + iu;
  const amb_real w1 = law->knee * i1;
  const amb_real m1 = g1 + law->iron - w1;
  const amb_real r1 = amb_root(m1 * m1 + AMB_C(4.0) * law->iron * w1);
  const amb_real h1 = (g1 + law->iron + w1 + r1) / AMB_C(2.0);
  const amb_real g2 = law->s0 + there * x;
  const amb_real i2 = law->i0 - there * iu;
  const amb_real w2 = law->knee * i2;
  const amb_real m2 = g2 + law->iron - w2;
  const amb_real r2 = amb_root(m2 * m2 + AMB_C(4.0) * law->iron * w2);
  const amb_real h2 = (g2 + law->iron + w2 + r2) / AMB_C(2.0);
  const amb_real dg = -(AMB_C(1.0) + there) * x;
  const amb_real di = (AMB_C(1.0) + there) * iu;
  const amb_real dw = law->knee * di;
  const amb_real dm = (dg - dw) * (m1 + m2) + AMB_C(4.0) * law->iron * dw;
  const amb_real dh = (dg + dw + dm / (r1 + r2)) / AMB_C(2.0);
  const amb_real a = i1 / h1;
  const amb_real b = i2 / h2;
  return law->k * (a + b) * (di * h2 - i2 * dh) / (h1 * h2);
}

/* dF/diu and dF/dx; `there` is 1, or 0 where there is no magnet on the other side. */
AMB_INLINE void amb_saturating_tangent(const amb_saturating_law *law, amb_real there, amb_real iu,
                                       amb_real x, amb_real *k_i, amb_real *k_s)
{
  const amb_real g1 = law->s0 - x;
  const amb_real i1 = law->i0 + iu;
  const amb_real w1 = law->knee * i1;
  const amb_real m1 = g1 + law->iron - w1;
  const amb_real r1 = amb_root(m1 * m1 + AMB_C(4.0) * law->iron * w1);
  const amb_real h1 = (g1 + law->iron + w1 + r1) / AMB_C(2.0);
  const amb_real g2 = law->s0 + x;
  const amb_real i2 = law->i0 - iu;
  const amb_real w2 = law->knee * i2;
  const amb_real m2 = g2 + law->iron - w2;
  const amb_real r2 = amb_root(m2 * m2 + AMB_C(4.0) * law->iron * w2);
  const amb_real h2 = (g2 + law->iron + w2 + r2) / AMB_C(2.0);
  const amb_real a = i1 / h1;
  const amb_real b = i2 / h2;
  const amb_real own = a * (h1 - w1) / (h1 * r1);
  const amb_real other = b * (h2 - w2) / (h2 * r2);
  *k_i = AMB_C(2.0) * law->k * (own + there * other);
  *k_s = AMB_C(2.0) * law->k * (a * own + there * b * other);
}

/* F - F(0, 0). */
static amb_real force_of(const void *self, amb_real iu, amb_real x)
{
  const amb_saturating_law *law = (const amb_saturating_law *)self;
  return law->two_sided ? amb_saturating_force(law, AMB_C(1.0), iu, x)
                        : amb_saturating_force(law, AMB_C(0.0), iu, x);
}

static amb_stiffness tangent(const void *self, amb_real iu, amb_real x)
{
  const amb_saturating_law *law = (const amb_saturating_law *)self;
  amb_stiffness k;
  amb_saturating_tangent(law, law->two_sided ? AMB_C(1.0) : AMB_C(0.0), iu, x, &k.k_i, &k.k_s);
  return k;
}

static amb_stiffness through_origin(const void *self, amb_real iu, amb_real x)
{
  const amb_saturating_law *law = (const amb_saturating_law *)self;
  return amb_through_origin(law->ampere, law->metre, force_of(self, iu, x), tangent(self, iu, x),
                            iu, x);
}

const amb_magnet_methods amb_saturating_magnet = {force_of, through_origin, tangent};
