/* The plant as plain data with tunable parameters. */
#ifndef AMBKIT_FMU_RIG_H
#define AMBKIT_FMU_RIG_H

#include "ambkit/scaled.h"
#include "sim/plant.h"

/* Constants. */
typedef struct amb_rig_data {
  const amb_plant *plant; /* without magnets and coils, which are below */
  amb_real weight;        /* of the rotor of an isolated axis [N] */
  int axes;
  amb_real T;               /* sampling time [s] */
  bool with_parts;          /* advances from sample to sample, not by any step */
  const amb_magnet *magnet; /* [axes] */
  const amb_magnet *coil;   /* [axes]: one of a pair, or without methods */
  const amb_real *bias;     /* [axes]: bias forces [N] */
  const amb_real *k;        /* [axes]: constants of the magnets [N m^2/A^2] */
  const amb_real *travel;   /* [axes]: clearances [m] */
  const amb_real *k_ui;     /* [axes]: amplifier gains [A/V] */
  const amb_real *iu_min;   /* [axes]: limits of the control currents [A] */
  const amb_real *iu_max;
  const amb_real *q;          /* [positions]: initial [m] ... */
  const amb_real *place;      /* ... for these displacements along the axes [m], ... */
  const amb_real *q_by_place; /* ... and their change per metre along each axis, row by row */
  int mass;    /* index of the rotor's mass among the values [kg]; -1: of a machine */
  int speed;   /* index of the speed of rotation; -1: the axis's own is used */
  int s;       /* index of the displacements along the axes; -1: positions are those */
  int base[3]; /* indices of the accelerations of the foundation; -1: none */
} amb_rig_data;

extern const amb_rig_data amb_data_rig; /* written by the export */

/* Tunable values, and the switch. */
typedef struct amb_rig {
  amb_real k[AMB_PLANT_AXES]; /* constants of the magnets [N m^2/A^2] */
  amb_real m;                 /* mass of the axis's rotor [kg] */
  bool off;                   /* no currents, not even the bias: no magnet forces */
} amb_rig;

/* With the mass [kg] of an axis and the magnet constants among the values, on which weight and bias
 * forces depend. */
void amb_rig_tune(amb_rig *rig, const double value[]);

/* Data that the plant of a rig points to. */
typedef struct amb_rig_room {
  amb_scaled of_magnet[AMB_PLANT_AXES], of_coil[AMB_PLANT_AXES];
  amb_magnet magnet[AMB_PLANT_AXES], coil[AMB_PLANT_AXES];
  amb_real bias[AMB_PLANT_AXES];
  amb_real g[AMB_PLANT_STATES];
  amb_parts amplifier[AMB_PLANT_AXES];
} amb_rig_room;

amb_plant amb_rig_plant(const amb_rig *rig, amb_rig_room *room);

/* In equilibrium as the parameters among the values state, with these control currents [A]; returns
 * the displacements along the axes [m]. */
void amb_rig_settle(const amb_plant *plant, amb_plant_state *state, const double value[],
                    const amb_real current[], amb_real place[]);

/* Disturbance forces, speed of rotation and motion of the foundation among the values. */
typedef struct amb_outside {
  amb_real load[AMB_PLANT_AXES]; /* [N] */
  amb_real speed[2];             /* at this and the next sample [rad/s] */
  amb_real base[3];              /* [m/s^2] */
} amb_outside;

amb_outside amb_rig_outside(const amb_plant *plant, const double value[]);

/* The plant's inputs for the demanded control currents [A]; it points to them. */
amb_acts amb_rig_acts(const amb_rig *rig, const amb_real demanded[], const amb_outside *outside);

/* Control current [A] of the amplifier of axis f for a control signal [V], with this share of its
 * range [1]. */
amb_real amb_rig_current(int f, amb_real u, amb_real share);

/* State between two samples of the plant. */
typedef struct amb_glimpse {
  amb_plant_state before; /* at the previous sample */
  amb_real share; /* fraction of the sample that has passed [1]; 1: the plant's present state */
} amb_glimpse;

/* Interpolated state of the plant: cubic in positions with their velocities, otherwise linear. */
amb_plant_state amb_rig_now(const amb_plant *plant, const amb_glimpse *between,
                            const amb_plant_state *after);

/* Write states, currents and total magnet forces just before a sample, for the currents demanded at
 * the previous one [A]. */
void amb_rig_show(const amb_rig *rig, const amb_plant *plant, const amb_plant_state *now,
                  const amb_real demanded[], double value[]);

#endif
