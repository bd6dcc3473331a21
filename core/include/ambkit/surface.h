/* A measured or computed force as a smooth surface over a regular grid.
 *
 * Bicubic between the nodes (Hermite): force and tangents are continuous, the derivatives of the
 * tangents are not. Outside the grid it is extrapolated linearly in current and displacement, with
 * the slopes at the edge.
 */
#ifndef AMBKIT_SURFACE_H
#define AMBKIT_SURFACE_H

#include "ambkit/magnet.h"

AMB_EXTERN_C_BEGIN

/* At a node. */
typedef struct amb_force_node {
  amb_real f;    /* force minus that at the origin [N] */
  amb_real f_i;  /* dF/diu [N/A] */
  amb_real f_x;  /* dF/dx [N/m] */
  amb_real f_ix; /* d2F/diu dx [N/(A m)] */
} amb_force_node;

/* Node (r, c) is at x = x_min + r x_step, iu = iu_min + c iu_step; one of them is the origin. */
typedef struct amb_surface {
  int rows;             /* nodes in x, at least 2 */
  int columns;          /* nodes in iu, at least 2; rows * columns at most 32767 */
  amb_real last_row;    /* rows - 1 */
  amb_real last_column; /* columns - 1 */
  amb_real x_min;       /* [m] */
  amb_real x_step;
  amb_real per_metre; /* 1 / x_step */
  amb_real iu_min;    /* [A] */
  amb_real iu_step;
  amb_real per_ampere;         /* 1 / iu_step */
  amb_real ampere;             /* as in amb_law */
  amb_real metre;              /* as in amb_law */
  const amb_force_node *nodes; /* rows x columns, rows of x; the caller's */
} amb_surface;

extern const amb_magnet_methods amb_surface_magnet;

AMB_EXTERN_C_END

#endif
