#include "ambkit/scaled.h"

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
