#include "rig.h"

/* The magnet of a rig, by its scale: any magnet's force goes with its constant. */
static amb_real scaled_force(const void *self, amb_real iu, amb_real x)
{
  const amb_rig *rig = (const amb_rig *)self;
  return rig->scale * amb_data_rig_magnet.methods->force(amb_data_rig_magnet.self, iu, x);
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

amb_plant amb_rig_plant(const amb_rig *rig, amb_rig_room *room)
{
  const amb_axis axis = {
      .magnet = {&scaled_magnet, rig},
      .m = rig->m,
      .f_0 = rig->weight + rig->bias_force,
      .bias = rig->bias_force,
      .K_sen = rig->K_sen,
      .T_sen = rig->T_sen,
      .travel = rig->travel,
      .substeps = rig->substeps,
      .parts = rig->with_parts ? &rig->parts : NULL,
      .coil = {rig->coil.s0 > 0 ? &amb_law_magnet : NULL, &rig->coil},
  };
  room->axis = axis;
  return amb_plant_of_axis(&room->axis, &room->room);
}

amb_acts amb_rig_acts(const amb_rig *rig, const amb_real *demanded, const amb_real *f_d)
{
  const amb_real speed = rig->with_parts ? rig->parts.speed : 0;
  const amb_acts acts = {demanded, f_d, NULL, speed, speed, 1, rig->off};
  return acts;
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
  now.X[0] = rest * rest * ((1 + 2 * s) * before->X[0] + s * T * before->X[1]) +
             s * s * ((3 - 2 * s) * after->X[0] - rest * T * after->X[1]);
  for (int j = 1; j < 3; j++)
    now.X[j] = before->X[j] + s * (after->X[j] - before->X[j]);
  return now;
}

amb_acting amb_rig_acting(const amb_rig *rig, const amb_plant_state *state, amb_real iu)
{
  amb_rig_room room;
  const amb_plant plant = amb_rig_plant(rig, &room);
  const amb_acts acts = amb_rig_acts(rig, &iu, &iu);
  amb_acting acting =
      amb_plant_acting(&plant, state, 0, &acts, amb_plant_until_now(&plant, state, 0, iu));
  acting.force = rig->off ? 0 : acting.force + rig->bias_force;
  return acting;
}
