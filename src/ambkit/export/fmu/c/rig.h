/* Magnet, rotor, amplifier and sensor as plain data, which can be tuned. */
#ifndef AMBKIT_FMU_RIG_H
#define AMBKIT_FMU_RIG_H

#include "sim/plant.h"

typedef struct amb_rig {
  amb_real k;            /* constant of the magnet [N m^2/A^2] */
  amb_real scale;        /* of its force: the constant over that of the export [1] */
  amb_real T;            /* sampling time [s] */
  amb_real m;            /* mass of the rotor [kg] */
  amb_real weight;       /* [N] */
  amb_real bias_force;   /* of the magnet at rest in the centre [N] */
  amb_real K_sen, T_sen; /* sensor gain [1] and lag [s] */
  amb_real travel;       /* mechanical stop at +-travel [m] */
  int substeps;          /* Runge-Kutta steps in a sample */
  amb_real k_ui;         /* amplifier gain [A/V] */
  amb_real iu_min;       /* limits of the control current [A] */
  amb_real iu_max;
  bool off;        /* no currents, not even that of the bias: the magnet does not pull */
  bool with_parts; /* else the next is idle */
  amb_parts parts;
  amb_law coil; /* one coil of a pair that each pull by their own current; else all is 0 */
} amb_rig;

/* Written by the export: the rig, and its magnet. */
extern const amb_rig amb_data_rig;
extern const amb_magnet amb_data_rig_magnet;

/* Another mass [kg], and with it another weight; another magnet constant [N m^2/A^2], and with it
 * another bias force. */
void amb_rig_tune(amb_rig *rig, amb_real mass, amb_real magnet_constant);

/* The plant of a rig, which points to both. */
typedef struct amb_rig_room {
  amb_axis axis;
  amb_axis_room room;
} amb_rig_room;

amb_plant amb_rig_plant(const amb_rig *rig, amb_rig_room *room);

/* What acts with the control current demanded [A] and the disturbance f_d [N]; it points to them.
 */
amb_acts amb_rig_acts(const amb_rig *rig, const amb_real *demanded, const amb_real *f_d);

/* Control current [A] that the amplifier makes of a control signal [V], with this share of its
 * range [1]. */
amb_real amb_rig_current(const amb_rig *rig, amb_real u, amb_real share);

/* A look between two samples: the plant goes on from one to the next. */
typedef struct amb_glimpse {
  amb_plant_state before; /* at the sample before */
  amb_real T;             /* from there to the one that the plant's state is at [s] */
  amb_real share;         /* how much of that has passed [1]; 1: the plant's state is that of now */
} amb_glimpse;

/* The plant's state then: the cubic through places and velocities, and straight lines. */
amb_plant_state amb_rig_now(const amb_glimpse *between, const amb_plant_state *after);

/* What acts just before a sample, iu demanded at the one before it; the whole force of the magnet.
 */
amb_acting amb_rig_acting(const amb_rig *rig, const amb_plant_state *state, amb_real iu);

#endif
