#include "ambkit/saturating.h"
#include "generated/saturating_law.h"
#include "turn.h"

/* F - F(0, 0). */
static amb_real saturating_force(const void *self, amb_real iu, amb_real x)
{
  const amb_saturating_law *law = (const amb_saturating_law *)self;
  return law->two_sided ? amb_saturating_force(law, iu, x)
                        : amb_saturating_force_one_sided(law, iu, x);
}

static amb_stiffness saturating_tangent(const void *self, amb_real iu, amb_real x)
{
  const amb_saturating_law *law = (const amb_saturating_law *)self;
  amb_stiffness k;
  amb_saturating_tangent(law, law->two_sided ? AMB_C(1.0) : AMB_C(0.0), iu, x, &k.k_i, &k.k_s);
  return k;
}

static amb_stiffness saturating_through_origin(const void *self, amb_real iu, amb_real x)
{
  const amb_saturating_law *law = (const amb_saturating_law *)self;
  amb_stiffness k = saturating_tangent(self, iu, x);
  const amb_real square = amb_turn_square(law->ampere, law->metre, iu, x);
  if (square >= AMB_TURN_LEAST) {
    amb_turn(law->ampere, law->metre, saturating_force(self, iu, x), square, iu, x, &k.k_i, &k.k_s);
    k.k_i = amb_clamp(k.k_i, -AMB_STIFFEST, AMB_STIFFEST);
    k.k_s = amb_clamp(k.k_s, -AMB_STIFFEST, AMB_STIFFEST);
  }
  return k;
}

const amb_magnet_methods amb_saturating_magnet = {saturating_force, saturating_through_origin,
                                                  saturating_tangent};
