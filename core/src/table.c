#include "ambkit/table.h"

/* Cell of a value on one axis: the lower node, and the fraction in 0..1. */
typedef struct place {
  int node;
  amb_real fraction;
  amb_real slope; /* d fraction / d value; 0 outside the grid */
} place;

static place locate(amb_real value, amb_real first, amb_real per_step, amb_real last, int nodes)
{
  const amb_real position = (value - first) * per_step;
  place p;
  if ((position >= AMB_C(0.0)) && (position < last)) {
    p.node = (int)position;
    p.fraction = position - (amb_real)p.node;
    p.slope = per_step;
  } else { /* at or beyond an edge; NaN: any node, the fraction propagates it */
    p.node = (position >= last) ? (nodes - 2) : 0;
    p.fraction = amb_clamp(position, AMB_C(0.0), AMB_C(1.0));
    p.slope = ((position >= last) && (position <= last)) ? per_step : AMB_C(0.0);
  }
  return p;
}

/* The nodes around a point. */
typedef struct corners {
  place row;
  place column;
  const amb_stiffness *lower; /* two adjacent nodes of a row ... */
  const amb_stiffness *upper; /* ... and those of the next row */
} corners;

static corners find(const amb_table *t, amb_real iu, amb_real x)
{
  corners c;
  c.row = locate(x, t->x_min, t->per_metre, t->last_row, t->rows);
  c.column = locate(iu, t->iu_min, t->per_ampere, t->last_column, t->columns);
  c.lower = &t->nodes[(c.row.node * t->columns) + c.column.node];
  c.upper = &c.lower[t->columns];
  return c;
}

/* A value and its derivatives with respect to iu and x, from the values at the corners. */
typedef struct surface {
  amb_real value;
  amb_real d_iu;
  amb_real d_x;
} surface;

static surface bilinear(const corners *c, amb_real low_left, amb_real low_right, amb_real high_left,
                        amb_real high_right)
{
  const amb_real low_step = low_right - low_left;
  const amb_real high_step = high_right - high_left;
  const amb_real low = low_left + c->column.fraction * low_step;
  const amb_real high = high_left + c->column.fraction * high_step;
  const amb_real across = low_step + c->row.fraction * (high_step - low_step);
  surface s;
  s.value = low + c->row.fraction * (high - low);
  s.d_iu = across * c->column.slope;
  s.d_x = (high - low) * c->row.slope;
  return s;
}

static surface k_i_of(const corners *c)
{
  return bilinear(c, c->lower[0].k_i, c->lower[1].k_i, c->upper[0].k_i, c->upper[1].k_i);
}

static surface k_s_of(const corners *c)
{
  return bilinear(c, c->lower[0].k_s, c->lower[1].k_s, c->upper[0].k_s, c->upper[1].k_s);
}

static amb_stiffness table_through_origin(const void *self, amb_real iu, amb_real x)
{
  const corners c = find((const amb_table *)self, iu, x);
  const amb_stiffness k = {k_i_of(&c).value, k_s_of(&c).value};
  return k;
}

static amb_stiffness table_tangent(const void *self, amb_real iu, amb_real x)
{
  const corners c = find((const amb_table *)self, iu, x);
  const surface k_i = k_i_of(&c);
  const surface k_s = k_s_of(&c);
  const amb_stiffness k = {k_i.value + k_i.d_iu * iu + k_s.d_iu * x,
                           k_s.value + k_i.d_x * iu + k_s.d_x * x};
  return k;
}

static amb_real table_force(const void *self, amb_real iu, amb_real x)
{
  const amb_stiffness k = table_through_origin(self, iu, x);
  return k.k_i * iu + k.k_s * x;
}

const amb_magnet_methods amb_table_magnet = {table_force, table_through_origin, table_tangent};
