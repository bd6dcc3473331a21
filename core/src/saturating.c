/* The force law of saturating iron, as a magnet. Written by `python -m models`; do not edit. */
#include "generated/saturating_law.h"
#include "turn.h"

/* F - F(0, 0). */
static amb_real force_of(const void *self, amb_real iu, amb_real x)
{
  const amb_saturating_law *law = (const amb_saturating_law *)self;
  return law->two_sided ? amb_saturating_force(law, iu, x)
                        : amb_saturating_force_one_sided(law, iu, x);
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
