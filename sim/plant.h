/* The nonlinear plant between two samples: rotor, force laws of the magnets, amplifiers, sensors,
 * stops.
 *
 *   q'' = g + B F(i, H q) + (A + speed spin) (q, q') + unbalance
 *   m'  = (shown(C q) - m) / lag,  i' = rate(i, demanded)
 *
 * X: positions q, velocities, then readings m and, where amplifiers lag, currents; last what is
 * between a magnet's force and the rotor (parts.h).
 */
#ifndef AMBKIT_SIM_PLANT_H
#define AMBKIT_SIM_PLANT_H

#include "ambkit/closed.h"
#include "ambkit/model.h"
#include "ambkit/sparse.h"
#include "coupling.h"
#include "parts.h"

#define AMB_PLANT_STATES (AMB_STATES + AMB_FORCES + AMB_BEHIND_MOST)
#define AMB_PLANT_AXES AMB_FORCES

/* A stop: a ring about two axes, or along one axis where the second is -1. */
typedef struct amb_ring {
  int first, second;     /* axes */
  amb_real travel;       /* what it leaves [m] */
  const amb_parts *stop; /* its stiffness and damping; a stiffness of 0 is for isolated axes */
} amb_ring;

typedef struct amb_plant {
  int positions, axes, sensors, states;
  bool own; /* axis k moves position k and nothing else, and sensor k sees it: `mass` in place of
             * H, B, C, A, spin, cosine and sine; its reading is state 2 positions + k */
  const amb_real *mass;   /* [positions], where they are their own [kg] */
  const amb_real *g;      /* [positions]: by constant forces [m/s^2]; of their own the force [N] */
  amb_sparse H;           /* axes x positions: displacements [m] */
  amb_sparse B;           /* positions x axes: accelerations [1/kg] */
  amb_sparse C;           /* sensors x positions: what they look at [m] */
  amb_sparse A;           /* positions x 2 positions: accelerations by motion, at rest ... */
  const amb_real *spin;   /* ... and what each entry gains by 1 rad/s of rotation */
  const amb_real *cosine; /* [positions]: unbalance, by its force ahead ... */
  const amb_real *sine;   /* ... and across; NULL: none */
  const int *base;        /* [3]: positions along x, y, z, or -1; NULL: none */
  const amb_magnet *magnet; /* [axes]: force relative to the bias force */
  const amb_magnet *coil;   /* [axes]: pull of one coil of a pair over that of its bias current
                             * at 0, for currents that differ; without methods the magnet gets
                             * the mean of both control currents */
  int couplings;
  const amb_coupling *coupling; /* in place of the magnets of their two axes */
  const amb_real *bias;         /* [axes]: bias forces [N] */
  const amb_real *farthest;     /* [axes]: no magnet finds the rotor farther away [m] */
  const int *current; /* [axes]: state of the control current, or -1: the demanded one at once */
  const int *second;  /* [axes]: state of the other coil's, or -1 */
  const int *shows;   /* [sensors]: state of the reading */
  const amb_real *gain, *lag; /* [sensors]: [1], [s] > 0 */
  const amb_parts *amplifier; /* [axes] */
  const amb_parts *sensor;    /* [sensors]: runout, non-linearity, rounding */
  int rings;
  const amb_ring *ring;
  int delay;           /* dead time from a sample to the change of the demanded currents: whole
                        * samples, 0 to AMB_DELAY_MOST, ... */
  amb_real delay_rest; /* ... and that much of one [s], 0 to less than the sampling time */
  int substeps;        /* Runge-Kutta steps in a sample, >= 1 */
  bool plain; /* no currents of their own, nothing between magnet and rotor, nothing that depends on
               * velocities or on the angle, and no soft stop */
} amb_plant;

typedef struct amb_plant_state {
  amb_real X[AMB_PLANT_STATES];
  amb_real cosine, sine;                                 /* of the angle of rotation */
  amb_real demanded[AMB_DELAY_MOST + 2][AMB_PLANT_AXES]; /* currents, the last one first [A] */
} amb_plant_state;

/* What acts from a sample to the next. */
typedef struct amb_acts {
  const amb_real *demanded; /* [axes]: control currents [A] */
  const amb_real *load;     /* [axes]: disturbance forces [N] */
  const amb_real *base;     /* [3]: acceleration of the foundation [m/s^2]; NULL: it stands still */
  amb_real speed, next;     /* of rotation, here and at the next sample [rad/s] */
  amb_real scale;           /* of the magnets, bias force and all [1] ... */
  bool off;                 /* ... and whether they have no current at all */
} amb_acts;

/* What acts on an axis at a moment. */
typedef struct amb_acting {
  amb_real iu;         /* control current, of a pair the mean of both [A] */
  amb_real force;      /* of the magnet, relative to its bias force [N] */
  amb_real voltage[2]; /* of each coil [V]; 0 where it is not modelled */
} amb_acting;

/* Along axis f: a displacement of the positions [m], or a velocity of their velocities [m/s]. */
static inline amb_real amb_plant_along(const amb_plant *plant, int f, const amb_real positions[])
{
  return plant->own ? positions[f] : amb_sparse_times(&plant->H, plant->H.value, f, positions);
}

/* On by the sampling time T [s]: classical Runge-Kutta of order 4 with fixed substeps, with a dead
 * time in pieces between the moments at which the demand changes, in contact with a soft stop in as
 * many smaller ones as it takes. At a hard stop the rotor stays, without bouncing, until the force
 * pulls it off. Returns whether a stop was touched. */
bool amb_plant_advance(const amb_plant *plant, amb_plant_state *state, amb_real T,
                       const amb_acts *acts);

/* How fast the states change, each in its unit over s: of a rotor that no hard stop holds, and
 * without the dead time. */
void amb_plant_rates(const amb_plant *plant, const amb_plant_state *state, const amb_acts *acts,
                     amb_real rates[]);

/* What acts at axis f while its control current iu [A] is demanded. */
amb_acting amb_plant_acting(const amb_plant *plant, const amb_plant_state *state, int f,
                            const amb_acts *acts, amb_real iu);

/* The demand that acts at axis f just after a sample at which it is iu [A], before
 * amb_plant_advance ... */
amb_real amb_plant_from_now(const amb_plant *plant, const amb_plant_state *state, int f,
                            amb_real iu);

/* ... and just before one, iu demanded at the one before it. */
static inline amb_real amb_plant_until_now(const amb_plant *plant, const amb_plant_state *state,
                                           int f, amb_real iu)
{
  return (plant->delay > 0) || (plant->delay_rest > 0) ? state->demanded[plant->delay][f] : iu;
}

/* At rest at the positions q, where these control currents have long been [A]: the sensors have
 * settled. */
void amb_plant_settle(const amb_plant *plant, amb_plant_state *state, const amb_real q[],
                      const amb_real iu[]);

/* Whether it is one axis with the closed law of two sides, and plain: it may fly in lanes. */
bool amb_plant_is_plain_axis(const amb_plant *plant);

#endif
