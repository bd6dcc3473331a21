#include "ambkit/magnet.h"
#include "generated/closed_law.h"
#include "turn.h"

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

/* F - F(0, 0). */
static amb_real law_force(const void *self, amb_real iu, amb_real x)
{
  const amb_law *law = (const amb_law *)self;
  return law->two_sided ? amb_law_force(law, iu, x) : amb_law_force_one_sided(law, iu, x);
}

static amb_stiffness law_tangent(const void *self, amb_real iu, amb_real x)
{
  const amb_law *law = (const amb_law *)self;
  amb_stiffness k;
  amb_law_tangent(law, law->two_sided ? AMB_C(1.0) : AMB_C(0.0), iu, x, &k.k_i, &k.k_s);
  return k;
}

static amb_stiffness law_through_origin(const void *self, amb_real iu, amb_real x)
{
  const amb_law *law = (const amb_law *)self;
  amb_stiffness k = law_tangent(self, iu, x);
  const amb_real square = amb_turn_square(law->ampere, law->metre, iu, x);
  if (square >= AMB_TURN_LEAST) {
    amb_turn(law->ampere, law->metre, law_force(self, iu, x), square, iu, x, &k.k_i, &k.k_s);
    k.k_i = amb_clamp(k.k_i, -AMB_STIFFEST, AMB_STIFFEST);
    k.k_s = amb_clamp(k.k_s, -AMB_STIFFEST, AMB_STIFFEST);
  }
  return k;
}

const amb_magnet_methods amb_law_magnet = {law_force, law_through_origin, law_tangent};
