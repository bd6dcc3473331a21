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

static amb_real scaled_force(const void *self, amb_real iu, amb_real x)
{
  const amb_scaled *scaled = (const amb_scaled *)self;
  return scaled->scale * scaled->of.methods->force(scaled->of.self, iu, x);
}

static amb_stiffness scaled_by(const amb_scaled *scaled, amb_stiffness k)
{
  const amb_stiffness by = {scaled->scale * k.k_i, scaled->scale * k.k_s};
  return by;
}

static amb_stiffness scaled_through_origin(const void *self, amb_real iu, amb_real x)
{
  const amb_scaled *scaled = (const amb_scaled *)self;
  return scaled_by(scaled, scaled->of.methods->through_origin(scaled->of.self, iu, x));
}

static amb_stiffness scaled_tangent(const void *self, amb_real iu, amb_real x)
{
  const amb_scaled *scaled = (const amb_scaled *)self;
  return scaled_by(scaled, scaled->of.methods->tangent(scaled->of.self, iu, x));
}

const amb_magnet_methods amb_scaled_magnet = {scaled_force, scaled_through_origin, scaled_tangent};
