/* Stiffness tables over a regular grid, bilinear between the nodes, held at the edge outside. */
#ifndef AMBKIT_TABLE_H
#define AMBKIT_TABLE_H

#include "ambkit/magnet.h"

/* Node (r, c) is at x_min + r dx, iu_min + c diu. Arrays are the caller's, rows of x. */
typedef struct amb_table {
  int rows, columns;    /* nodes in x and in iu, each at least 2 */
  amb_real x_min, dx;   /* [m] */
  amb_real iu_min, diu; /* [A] */
  const amb_real *k_i;  /* rows x columns, [N/A] */
  const amb_real *k_s;  /* rows x columns, [N/m] */
} amb_table;

/* The table's values are the through-origin form; the tangent is theirs by the product rule. */
extern const amb_magnet_methods amb_table_magnet;

#endif
