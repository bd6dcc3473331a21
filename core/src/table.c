#include "ambkit/table.h"

/* Where a value lies on one axis: the node below, and the fraction of the cell in 0..1. */
typedef struct place {
  int node;
  amb_real fraction;
  amb_real slope; /* d fraction / d value; 0 where the value is held at the edge */
} place;

static place locate(amb_real value, amb_real first, amb_real step, int nodes)
{
  const amb_real cells = (amb_real)(nodes - 1);
  const amb_real raw = (value - first) / step;
  const amb_real position = amb_clamp(raw, AMB_C(0.0), cells);
  place p;
  p.node = position >= 1 ? (int)position : 0; /* NaN: any node, the fraction carries it on */
  p.node = p.node > nodes - 2 ? nodes - 2 : p.node;
  p.fraction = position - (amb_real)p.node;
  p.slope = (raw >= 0) && (raw <= cells) ? 1 / step : AMB_C(0.0);
  return p;
}

typedef struct surface {
  amb_real value, d_iu, d_x;
} surface;

static surface bilinear(const amb_real *z, int columns, place row, place column)
{
  const amb_real *lower = z + row.node * columns + column.node;
  const amb_real *upper = lower + columns;
  const amb_real low = lower[0] + column.fraction * (lower[1] - lower[0]);
  const amb_real high = upper[0] + column.fraction * (upper[1] - upper[0]);
  const amb_real across =
      (lower[1] - lower[0]) + row.fraction * ((upper[1] - upper[0]) - (lower[1] - lower[0]));
  surface s;
  s.value = low + row.fraction * (high - low);
  s.d_iu = across * column.slope;
  s.d_x = (high - low) * row.slope;
  return s;
}

static void both(const void *self, amb_real iu, amb_real x, surface *k_i, surface *k_s)
{
  const amb_table *t = (const amb_table *)self;
  const place row = locate(x, t->x_min, t->dx, t->rows);
  const place column = locate(iu, t->iu_min, t->diu, t->columns);
  *k_i = bilinear(t->k_i, t->columns, row, column);
  *k_s = bilinear(t->k_s, t->columns, row, column);
}

static amb_stiffness table_through_origin(const void *self, amb_real iu, amb_real x)
{
  surface k_i, k_s;
  both(self, iu, x, &k_i, &k_s);
  const amb_stiffness k = {k_i.value, k_s.value};
  return k;
}

static amb_stiffness table_tangent(const void *self, amb_real iu, amb_real x)
{
  surface k_i, k_s;
  both(self, iu, x, &k_i, &k_s);
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
