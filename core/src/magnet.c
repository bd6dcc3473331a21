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
