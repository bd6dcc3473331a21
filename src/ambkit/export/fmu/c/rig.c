#include "rig.h"
#include "model.h"

void amb_rig_tune(amb_rig *rig, const double value[])
{
  for (int f = 0; f < amb_data_rig.axes; f++)
    rig->k[f] = value[FIRST_magnet_constant + f];
  rig->m = amb_data_rig.mass < 0 ? 0 : value[amb_data_rig.mass];
  rig->off = false;
}

/* By ratios: at the exported values these are 1, and the constants keep their bits. */
amb_plant amb_rig_plant(const amb_rig *rig, amb_rig_room *room)
{
  const amb_rig_data *data = &amb_data_rig;
  amb_real more[AMB_PLANT_AXES];
  for (int f = 0; f < data->axes; f++) {
    const amb_real scale = rig->k[f] / data->k[f];
    const amb_magnet none = {NULL, NULL};
    const amb_scaled magnet = {data->magnet[f], scale}, coil = {data->coil[f], scale};
    room->of_magnet[f] = magnet;
    room->of_coil[f] = coil;
    const amb_magnet of_magnet = {&amb_scaled_magnet, &room->of_magnet[f]};
    const amb_magnet of_coil = {&amb_scaled_magnet, &room->of_coil[f]};
    room->magnet[f] = of_magnet;
    room->coil[f] = data->coil[f].methods != NULL ? of_coil : none;
    room->bias[f] = data->bias[f] * scale;
    more[f] = room->bias[f] - data->bias[f];
    room->amplifier[f] = data->plant->amplifier[f];
    room->amplifier[f].k = rig->k[f];
  }
  amb_plant plant = *data->plant;
  if (plant.own) {
    plant.mass = &rig->m;
    room->g[0] = data->weight * (rig->m / data->plant->mass[0]) + room->bias[0];
  }
  for (int k = 0; !plant.own && (k < plant.positions); k++) {
    room->g[k] = plant.g[k];
    for (int e = plant.B.start[k]; e < plant.B.start[k + 1]; e++)
      room->g[k] += plant.B.value[e] * more[plant.B.column[e]];
  }
  plant.g = room->g;
  plant.bias = room->bias;
  plant.magnet = room->magnet;
  plant.coil = room->coil;
  plant.amplifier = room->amplifier;
  return plant;
}

void amb_rig_settle(const amb_plant *plant, amb_plant_state *state, const double value[],
                    const amb_real current[], amb_real place[])
{
  amb_real q[AMB_PLANT_STATES];
  for (int f = 0; f < plant->axes; f++) {
    const amb_real travel = amb_data_rig.travel[f];
    place[f] = amb_clamp(value[FIRST_start_position + f], -travel, travel);
  }
  for (int k = 0; k < plant->positions; k++) {
    q[k] = plant->own ? place[k] : amb_data_rig.q[k];
    for (int f = 0; !plant->own && (f < plant->axes); f++)
      q[k] += amb_data_rig.q_by_place[k * plant->axes + f] * (place[f] - amb_data_rig.place[f]);
  }
  amb_plant_settle(plant, state, q, current);
}

amb_outside amb_rig_outside(const amb_plant *plant, const double value[])
{
  amb_outside outside = {{0}, {0}, {0}};
  const int speed = amb_data_rig.speed;
  for (int f = 0; f < plant->axes; f++)
    outside.load[f] = value[FIRST_f_d + f];
  outside.speed[0] = outside.speed[1] = speed < 0 ? plant->sensor->speed : value[speed];
  for (int k = 0; k < 3; k++)
    outside.base[k] = amb_data_rig.base[k] < 0 ? 0 : value[amb_data_rig.base[k]];
  return outside;
}

amb_acts amb_rig_acts(const amb_rig *rig, const amb_real demanded[], const amb_outside *outside)
{
  const amb_acts acts = {.demanded = demanded,
                         .load = outside->load,
                         .base = outside->base,
                         .speed = outside->speed[0],
                         .next = outside->speed[1],
                         .scale = 1,
                         .off = rig->off};
  return acts;
}

amb_real amb_rig_current(int f, amb_real u, amb_real share)
{
  const amb_rig_data *data = &amb_data_rig;
  return amb_clamp(data->k_ui[f] * u, share * data->iu_min[f], share * data->iu_max[f]);
}

amb_plant_state amb_rig_now(const amb_plant *plant, const amb_glimpse *between,
                            const amb_plant_state *after)
{
  const amb_real *before = between->before.X, *then = after->X;
  const amb_real s = between->share, T = amb_data_rig.T, rest = 1 - s;
  const int q = plant->positions;
  amb_plant_state now = *after;
  if (s >= 1)
    return now;
  for (int k = 0; k < q; k++) {
    now.X[k] = rest * rest * ((1 + 2 * s) * before[k] + s * T * before[q + k]) +
               s * s * ((3 - 2 * s) * then[k] - rest * T * then[q + k]);
    now.X[q + k] = before[q + k] + s * (then[q + k] - before[q + k]);
  }
  for (int r = 0; r < plant->sensors; r++) {
    const int j = plant->shows[r];
    now.X[j] = before[j] + s * (then[j] - before[j]);
  }
  return now;
}

void amb_rig_show(const amb_rig *rig, const amb_plant *plant, const amb_plant_state *now,
                  const amb_real demanded[], double value[])
{
  const amb_outside none = {{0}, {0}, {0}};
  const amb_acts acts = amb_rig_acts(rig, demanded, &none);
  for (int j = 0; j < 2 * plant->positions; j++)
    value[FIRST_q + j] = now->X[j];
  for (int r = 0; r < plant->sensors; r++)
    value[FIRST_x_m + r] = now->X[plant->shows[r]];
  for (int f = 0; f < plant->axes; f++) {
    const amb_acting acting =
        amb_plant_acting(plant, now, f, &acts, amb_plant_until_now(plant, now, f, demanded[f]));
    value[FIRST_iu + f] = acting.iu;
    value[FIRST_f_mag + f] = rig->off ? 0 : acting.force + plant->bias[f];
    if (amb_data_rig.s >= 0) {
      value[amb_data_rig.s + f] = 0;
      for (int e = plant->H.start[f]; e < plant->H.start[f + 1]; e++)
        value[amb_data_rig.s + f] += plant->H.value[e] * now->X[plant->H.column[e]];
    }
  }
}
