#include "plant.h"

amb_real amb_plant_force(const amb_plant *plant, amb_real iu, amb_real x)
{
  return plant->magnet.methods->force(plant->magnet.self, iu, x) + plant->f_0;
}

static amb_plant_state slope(const amb_plant *plant, const amb_plant_state *s, amb_real iu,
                             amb_real f_d)
{
  const amb_real x = amb_clamp(s->x, -plant->travel, plant->travel);
  amb_plant_state d;
  d.x = s->v;
  d.v = (amb_plant_force(plant, iu, x) + f_d) / plant->m;
  d.x_m = (plant->K_sen * s->x - s->x_m) / plant->T_sen;
  return d;
}

static amb_plant_state moved(const amb_plant_state *s, const amb_plant_state *d, amb_real h)
{
  const amb_plant_state to = {s->x + h * d->x, s->v + h * d->v, s->x_m + h * d->x_m};
  return to;
}

bool amb_plant_advance(const amb_plant *plant, amb_plant_state *state, amb_real T, amb_real iu,
                       amb_real f_d)
{
  const amb_real h = T / (amb_real)plant->substeps, half = h / 2;
  bool touched = false;
  amb_plant_state s = *state;
  for (int i = 0; i < plant->substeps; i++) {
    const amb_plant_state k1 = slope(plant, &s, iu, f_d);
    const amb_plant_state s2 = moved(&s, &k1, half);
    const amb_plant_state k2 = slope(plant, &s2, iu, f_d);
    const amb_plant_state s3 = moved(&s, &k2, half);
    const amb_plant_state k3 = slope(plant, &s3, iu, f_d);
    const amb_plant_state s4 = moved(&s, &k3, h);
    const amb_plant_state k4 = slope(plant, &s4, iu, f_d);
    s.x += h / 6 * (k1.x + 2 * (k2.x + k3.x) + k4.x);
    s.v += h / 6 * (k1.v + 2 * (k2.v + k3.v) + k4.v);
    s.x_m += h / 6 * (k1.x_m + 2 * (k2.x_m + k3.x_m) + k4.x_m);
    if ((s.x >= plant->travel) || (s.x <= -plant->travel)) {
      s.x = amb_clamp(s.x, -plant->travel, plant->travel);
      s.v = s.x > 0 ? (s.v < 0 ? s.v : 0) : (s.v > 0 ? s.v : 0);
      touched = true;
    }
  }
  *state = s;
  return touched;
}
