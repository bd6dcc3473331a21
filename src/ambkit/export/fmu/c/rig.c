#include "rig.h"

/* The magnet of a rig, by its scale: any magnet's force goes with its constant. */
static amb_real scaled_force(const void *self, amb_real iu, amb_real x)
{
  const amb_rig *rig = (const amb_rig *)self;
  return rig->scale * amb_data_rig_magnet.methods->force(amb_data_rig_magnet.self, iu, x);
}

static amb_real no_force(const void *self, amb_real iu, amb_real x)
{
  (void)self;
  (void)iu;
  (void)x;
  return 0;
}

static amb_stiffness scaled(const amb_rig *rig, amb_stiffness k)
{
  k.k_i *= rig->scale;
  k.k_s *= rig->scale;
  return k;
}

static amb_stiffness scaled_through_origin(const void *self, amb_real iu, amb_real x)
{
  const amb_rig *rig = (const amb_rig *)self;
  return scaled(rig, amb_data_rig_magnet.methods->through_origin(amb_data_rig_magnet.self, iu, x));
}

static amb_stiffness scaled_tangent(const void *self, amb_real iu, amb_real x)
{
  const amb_rig *rig = (const amb_rig *)self;
  return scaled(rig, amb_data_rig_magnet.methods->tangent(amb_data_rig_magnet.self, iu, x));
}

static const amb_magnet_methods scaled_magnet = {scaled_force, scaled_through_origin,
                                                 scaled_tangent};
static const amb_magnet_methods no_magnet = {no_force, NULL, NULL};

/* By ratios: those of the exported values are 1, and these stay what they are to the last bit. */
void amb_rig_tune(amb_rig *rig, amb_real mass, amb_real magnet_constant)
{
  *rig = amb_data_rig;
  rig->weight = amb_data_rig.weight * (mass / amb_data_rig.m);
  rig->scale = magnet_constant / amb_data_rig.k;
  rig->bias_force = amb_data_rig.bias_force * rig->scale;
  rig->m = mass;
  rig->coil.k = magnet_constant;
  rig->parts.k = magnet_constant;
}

amb_plant amb_rig_plant(const amb_rig *rig)
{
  const amb_magnet_methods *coil = rig->off ? &no_magnet : &amb_law_magnet;
  const amb_plant plant = {
      .magnet = {rig->off ? &no_magnet : &scaled_magnet, rig},
      .m = rig->m,
      .f_0 = rig->weight + (rig->off ? 0 : rig->bias_force),
      .K_sen = rig->K_sen,
      .T_sen = rig->T_sen,
      .travel = rig->travel,
      .substeps = rig->substeps,
      .parts = rig->with_parts ? &rig->parts : NULL,
      .coil = {rig->coil.s0 > 0 ? coil : NULL, &rig->coil},
  };
  return plant;
}

amb_real amb_rig_current(const amb_rig *rig, amb_real u, amb_real share)
{
  return amb_clamp(rig->k_ui * u, share * rig->iu_min, share * rig->iu_max);
}

amb_plant_state amb_rig_now(const amb_glimpse *between, const amb_plant_state *after)
{
  const amb_plant_state *before = &between->before;
  const amb_real s = between->share, T = between->T, rest = 1 - s;
  amb_plant_state now = *after;
  if (s >= 1)
    return now;
  now.x = rest * rest * ((1 + 2 * s) * before->x + s * T * before->v) +
          s * s * ((3 - 2 * s) * after->x - rest * T * after->v);
  now.v = before->v + s * (after->v - before->v);
  now.x_m = before->x_m + s * (after->x_m - before->x_m);
  return now;
}

amb_real amb_rig_force(const amb_rig *rig, const amb_plant_state *state, amb_real iu)
{
  if (rig->off)
    return 0;
  if (!rig->with_parts)
    return scaled_force(rig, iu, state->x) + rig->bias_force;
  const amb_plant plant = amb_rig_plant(rig);
  return amb_plant_until_now(&plant, state, iu).force - rig->weight;
}
