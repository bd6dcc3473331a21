/* A plant with one axis from its numbers. */
#ifndef PLANT_AXIS_H
#define PLANT_AXIS_H

#include "plant.h"

#define AXIS_PLANT_STATES                                                                          \
  5 /* x, v, what the sensor shows, and two currents; then what is behind                          \
     */

typedef struct amb_axis {
  amb_magnet magnet;
  amb_real m;        /* mass of the rotor [kg] */
  amb_real f_0;      /* weight and bias force [N] */
  amb_real bias;     /* the bias force of the magnet [N] */
  amb_real K_sen;    /* sensor gain [1] */
  amb_real T_sen;    /* sensor lag [s], > 0 */
  amb_real travel;   /* mechanical stop at +-travel [m] */
  amb_real farthest; /* where a soft stop gives way no more [m] */
  int substeps;      /* Runge-Kutta steps in a sample, >= 1 */
  int delay;         /* dead time in samples, and the rest [s] */
  amb_real delay_rest;
  const amb_parts *parts; /* or NULL: none */
  amb_magnet coil;        /* one of a pair, or without methods */
} amb_axis;

/* What its plant points to beside the axis. */
typedef struct amb_axis_room {
  amb_parts parts;
  amb_ring ring;
  amb_real farthest;
} amb_axis_room;

/* The plant, which points to both. */
static amb_plant plant_of_axis(const amb_axis *axis, amb_axis_room *room)
{
  static const int none[1] = {-1}, first[1] = {3}, second[1] = {4}, shows[1] = {2};
  const amb_parts nothing = {0};
  room->parts = axis->parts != NULL ? *axis->parts : nothing;
  const amb_parts *parts = &room->parts;
  const bool soft = parts->stiffness > 0, lags = parts->corner > 0;
  for (int k = 0; k < parts->behind; k++)
    room->parts.behind_at[k] = AXIS_PLANT_STATES + k;
  const amb_ring ring = {0, -1, axis->travel, parts};
  room->ring = ring;
  room->farthest = soft ? axis->farthest : axis->travel;
  const bool shown_as_it_is = (parts->orders == 0) && !(parts->quadratic < 0) &&
                              !(parts->quadratic > 0) && !(parts->cubic < 0) && !(parts->cubic > 0);
  const amb_plant plant = {.positions = 1,
                           .axes = 1,
                           .sensors = 1,
                           .states = AXIS_PLANT_STATES + parts->behind,
                           .own = true,
                           .mass = &axis->m,
                           .g = &axis->f_0,
                           .magnet = &axis->magnet,
                           .coil = &axis->coil,
                           .bias = &axis->bias,
                           .farthest = &room->farthest,
                           .current = lags ? first : none,
                           .second = lags && parts->pair ? second : none,
                           .shows = shows,
                           .gain = &axis->K_sen,
                           .lag = &axis->T_sen,
                           .amplifier = parts,
                           .sensor = parts,
                           .rings = 1,
                           .ring = &room->ring,
                           .delay = axis->delay,
                           .delay_rest = axis->delay_rest,
                           .substeps = axis->substeps,
                           .plain = shown_as_it_is && !soft && !lags && (parts->behind == 0)};
  return plant;
}

#endif
