#include "ambkit/surface.h"
#include "turn.h"

/* Square of the distance from the origin below which the force, a difference of two larger ones,
 * has lost as many digits as the mean slope on the way is inaccurate: (machine epsilon)^(2/3). */
#if defined(AMB_FLOAT)
#define NEAR AMB_C(2.4e-5)
#else
#define NEAR AMB_C(3.7e-11)
#endif

/* Cell of a value on one axis, and the weights of value and slope at both of its ends, for the
 * surface and for its derivative. */
typedef struct weights {
  int node;
  amb_real of[4];    /* value and slope at the lower node, value and slope at the upper node */
  amb_real slope[4]; /* their derivatives */
  amb_real beyond;   /* distance beyond the grid */
} weights;

static weights weigh(amb_real value, amb_real first, amb_real step, amb_real per_step,
                     amb_real last, int nodes)
{
  const amb_real position = (value - first) * per_step;
  const amb_real held = amb_clamp(position, AMB_C(0.0), last);
  weights w;
  w.node = 0; /* NaN: any node, the fraction propagates it */
  if (held >= last) {
    w.node = nodes - 2;
  } else if (held >= AMB_C(0.0)) {
    w.node = (int)held;
  } else {
  }
  const amb_real t = held - (amb_real)w.node;
  const amb_real left = AMB_C(1.0) - t;
  w.of[0] = (AMB_C(1.0) + AMB_C(2.0) * t) * (left * left);
  w.of[1] = step * (t * (left * left));
  w.of[2] = (t * t) * (AMB_C(3.0) - AMB_C(2.0) * t);
  w.of[3] = -step * ((t * t) * left);
  w.slope[0] = -AMB_C(6.0) * (t * left) * per_step;
  w.slope[1] = left * (AMB_C(1.0) - AMB_C(3.0) * t);
  w.slope[2] = AMB_C(6.0) * (t * left) * per_step;
  w.slope[3] = t * (AMB_C(3.0) * t - AMB_C(2.0));
  w.beyond = (position - held) * step;
  return w;
}

/* Sum over the corners of a cell, with the weights along current and displacement. */
static amb_real patch(const amb_force_node *lower, const amb_force_node *upper,
                      const amb_real along[4], const amb_real across[4])
{
  const amb_real f_lower = (along[0] * lower[0].f + along[2] * lower[1].f) +
                           (along[1] * lower[0].f_i + along[3] * lower[1].f_i);
  const amb_real f_upper = (along[0] * upper[0].f + along[2] * upper[1].f) +
                           (along[1] * upper[0].f_i + along[3] * upper[1].f_i);
  const amb_real x_lower = (along[0] * lower[0].f_x + along[2] * lower[1].f_x) +
                           (along[1] * lower[0].f_ix + along[3] * lower[1].f_ix);
  const amb_real x_upper = (along[0] * upper[0].f_x + along[2] * upper[1].f_x) +
                           (along[1] * upper[0].f_ix + along[3] * upper[1].f_ix);
  return (across[0] * f_lower + across[2] * f_upper) + (across[1] * x_lower + across[3] * x_upper);
}

/* Force and tangents, extrapolated outside the grid. */
static amb_stiffness stiffness_at(const amb_surface *s, amb_real iu, amb_real x, amb_real *force)
{
  const weights i = weigh(iu, s->iu_min, s->iu_step, s->per_ampere, s->last_column, s->columns);
  const weights d = weigh(x, s->x_min, s->x_step, s->per_metre, s->last_row, s->rows);
  const amb_force_node *lower = &s->nodes[(d.node * s->columns) + i.node];
  const amb_force_node *upper = &lower[s->columns];
  const amb_real f_i = patch(lower, upper, i.slope, d.of);
  const amb_real f_x = patch(lower, upper, i.of, d.slope);
  amb_stiffness k = {f_i, f_x};
  *force = patch(lower, upper, i.of, d.of) + (f_i * i.beyond + f_x * d.beyond);
  if ((i.beyond != AMB_C(0.0)) || (d.beyond != AMB_C(0.0))) {
    const amb_real f_ix = patch(lower, upper, i.slope, d.slope);
    *force += f_ix * (i.beyond * d.beyond);
    k.k_i += f_ix * d.beyond;
    k.k_s += f_ix * i.beyond;
  }
  return k;
}

static amb_stiffness surface_tangent(const void *self, amb_real iu, amb_real x)
{
  amb_real unused;
  return stiffness_at((const amb_surface *)self, iu, x, &unused);
}

static amb_real surface_force(const void *self, amb_real iu, amb_real x)
{
  const amb_surface *s = (const amb_surface *)self;
  amb_real force;
  if (amb_turn_square(s->ampere, s->metre, iu, x) < NEAR) {
    const amb_stiffness k = stiffness_at(s, AMB_C(0.5) * iu, AMB_C(0.5) * x, &force);
    force = k.k_i * iu + k.k_s * x;
  } else {
    (void)stiffness_at(s, iu, x, &force);
  }
  return force;
}

static amb_stiffness surface_through_origin(const void *self, amb_real iu, amb_real x)
{
  const amb_surface *s = (const amb_surface *)self;
  amb_real force;
  const amb_stiffness k = stiffness_at(s, iu, x, &force);
  if (amb_turn_square(s->ampere, s->metre, iu, x) < NEAR) {
    force = surface_force(self, iu, x);
  }
  return amb_through_origin(s->ampere, s->metre, force, k, iu, x);
}

const amb_magnet_methods amb_surface_magnet = {surface_force, surface_through_origin,
                                               surface_tangent};
