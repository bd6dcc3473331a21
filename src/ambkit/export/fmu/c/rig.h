/* The plant as plain data, which can be tuned. */
#ifndef AMBKIT_FMU_RIG_H
#define AMBKIT_FMU_RIG_H

#include "ambkit/scaled.h"
#include "sim/plant.h"

/* What does not change. */
typedef struct amb_rig_data {
  const amb_plant *plant; /* but for magnets and coils, which come below */
  amb_real weight;        /* of the rotor of an isolated axis [N] */
  int axes;
  amb_real T;               /* sampling time [s] */
  bool with_parts;          /* goes on from sample to sample, not by any step */
  const amb_magnet *magnet; /* [axes] */
  const amb_magnet *coil;   /* [axes]: one of a pair, or without methods */
  const amb_real *bias;     /* [axes]: bias forces [N] */
  const amb_real *k;        /* [axes]: constants of the magnets [N m^2/A^2] */
  const amb_real *travel;   /* [axes]: what the stops leave [m] */
  const amb_real *k_ui;     /* [axes]: amplifier gains [A/V] */
  const amb_real *iu_min;   /* [axes]: limits of the control currents [A] */
  const amb_real *iu_max;
  const amb_real *q;          /* [positions]: at the start [m] ... */
  const amb_real *place;      /* ... with these places along the axes [m], ... */
  const amb_real *q_by_place; /* ... and what each metre more along an axis adds, row by row */
  int mass;    /* where among the values the mass of the rotor is [kg]; -1: of a machine */
  int speed;   /* where the speed of rotation is; -1: the axis's own holds */
  int s;       /* where the displacements along the axes are; -1: positions are those */
  int base[3]; /* where the accelerations of the foundation are; -1: none */
} amb_rig_data;

extern const amb_rig_data amb_data_rig; /* written by the export */

/* What can be tuned, and whether it is on. */
typedef struct amb_rig {
  amb_real k[AMB_PLANT_AXES]; /* constants of the magnets [N m^2/A^2] */
  amb_real m;                 /* mass of the axis's rotor [kg] */
  bool off;                   /* no currents, not even those of the bias: the magnets do not pull */
} amb_rig;

/* With the mass [kg], of an axis, and the magnet constants among the values: with them go weight
 * and bias forces. */
void amb_rig_tune(amb_rig *rig, const double value[]);

/* What the plant of a rig points to. */
typedef struct amb_rig_room {
  amb_scaled of_magnet[AMB_PLANT_AXES], of_coil[AMB_PLANT_AXES];
  amb_magnet magnet[AMB_PLANT_AXES], coil[AMB_PLANT_AXES];
  amb_real bias[AMB_PLANT_AXES];
  amb_real g[AMB_PLANT_STATES];
  amb_parts amplifier[AMB_PLANT_AXES];
} amb_rig_room;

amb_plant amb_rig_plant(const amb_rig *rig, amb_rig_room *room);

/* At rest where the parameters among the values say, with these control currents [A]; the places
 * along the axes [m] are returned. */
void amb_rig_settle(const amb_plant *plant, amb_plant_state *state, const double value[],
                    const amb_real current[], amb_real place[]);

/* Disturbance forces, speed of rotation and what the foundation does, as the values have them. */
typedef struct amb_outside {
  amb_real load[AMB_PLANT_AXES]; /* [N] */
  amb_real speed[2];             /* here and at the next sample [rad/s] */
  amb_real base[3];              /* [m/s^2] */
} amb_outside;

amb_outside amb_rig_outside(const amb_plant *plant, const double value[]);

/* What acts with the control currents demanded [A]; it points to them. */
amb_acts amb_rig_acts(const amb_rig *rig, const amb_real demanded[], const amb_outside *outside);

/* Control current [A] that the amplifier of axis f makes of a control signal [V], with this share
 * of its range [1]. */
amb_real amb_rig_current(int f, amb_real u, amb_real share);

/* A look between two samples: the plant goes on from one to the next. */
typedef struct amb_glimpse {
  amb_plant_state before; /* at the sample before */
  amb_real share; /* how much of the way has passed [1]; 1: the plant's state is that of now */
} amb_glimpse;

/* The plant's state then: the cubic through places and velocities, and straight lines. */
amb_plant_state amb_rig_now(const amb_plant *plant, const amb_glimpse *between,
                            const amb_plant_state *after);

/* Write states, currents and whole forces of the magnets just before a sample, these currents
 * demanded at the one before it [A]. */
void amb_rig_show(const amb_rig *rig, const amb_plant *plant, const amb_plant_state *now,
                  const amb_real demanded[], double value[]);

#endif
