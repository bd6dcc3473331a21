/* Stiffness tables over a regular grid, bilinear between the nodes, constant outside. */
#ifndef AMBKIT_TABLE_H
#define AMBKIT_TABLE_H

#include "ambkit/magnet.h"

AMB_EXTERN_C_BEGIN

/* Node (r, c) is at x = x_min + r / per_metre, iu = iu_min + c / per_ampere. Reciprocal steps,
 * because a division takes a controller as long as fourteen multiplications. */
typedef struct amb_table {
  int rows;                   /* nodes in x, at least 2 */
  int columns;                /* nodes in iu, at least 2; rows * columns at most 32767 */
  amb_real last_row;          /* rows - 1 */
  amb_real last_column;       /* columns - 1 */
  amb_real x_min;             /* [m] */
  amb_real per_metre;         /* [1/m] */
  amb_real iu_min;            /* [A] */
  amb_real per_ampere;        /* [1/A] */
  const amb_stiffness *nodes; /* rows x columns, rows of x; the caller's */
} amb_table;

/* The table contains the through-origin form; the tangent follows by the product rule. */
extern const amb_magnet_methods amb_table_magnet;

AMB_EXTERN_C_END

#endif
