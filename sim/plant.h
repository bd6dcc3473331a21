/* The nonlinear plant between two samples: rotor, force laws of the magnets, amplifiers, sensors,
 * stops.
 *
 * q'' = g + B F(i, H q) + (A + speed spin) (q, q') + unbalance m'  = (shown(C q) - m) / lag,  i' =
 * rate(i, demanded)
 *
 * X: positions q, velocities, then readings m and, if amplifiers lag, currents; last the states
 * between magnet forces and rotor (parts.h).
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

/* A stop: a ring about two axes, or along one axis if the second is -1. */
typedef struct amb_ring {
  int first, second;     /* axes */
  amb_real travel;       /* clearance [m] */
  const amb_parts *stop; /* its stiffness and damping; a stiffness of 0 is for isolated axes only */
} amb_ring;

typedef struct amb_plant {
  int positions, axes, sensors, states;
  bool own; /* independent axes: axis k moves position k only, and sensor k measures it. `mass`
               replaces H, B, C, A, spin, cosine and sine; the reading is state 2 positions + k */
  const amb_real *mass;   /* [positions], for independent axes [kg] */
  const amb_real *g;      /* [positions]: acceleration by constant forces [m/s^2]; for independent
                             axes the force [N] */
  amb_sparse H;           /* axes x positions: displacements [m] */
  amb_sparse B;           /* positions x axes: accelerations [1/kg] */
  amb_sparse C;           /* sensors x positions: measured positions [m] */
  amb_sparse A;           /* positions x 2 positions: accelerations by motion, at standstill ... */
  const amb_real *spin;   /* ... and the change of each entry per 1 rad/s of rotation */
  const amb_real *cosine; /* [positions]: unbalance, component in phase with its force ... */
  const amb_real *sine;   /* ... and in quadrature; NULL: none */
  const int *base;        /* [3]: positions along x, y, z, or -1; NULL: none */
  const amb_magnet *magnet; /* [axes]: force relative to the bias force */
  const amb_magnet *coil;   /* [axes]: force of one coil of a pair relative to its bias force at 0,
                               for unequal currents; without methods the magnet gets the mean of
                               both control currents */
  int couplings;
  const amb_coupling *coupling; /* replaces the magnets of its two axes */
  const amb_real *bias;         /* [axes]: bias forces [N] */
  const amb_real *farthest;     /* [axes]: maximum displacement seen by the magnet [m] */
  const int *current;         /* [axes]: state of the control current, or -1: equal to the demand */
  const int *second;          /* [axes]: state of the second coil's current, or -1 */
  const int *shows;           /* [sensors]: state of the reading */
  const amb_real *gain, *lag; /* [sensors]: [1], [s] > 0 */
  const amb_parts *amplifier; /* [axes] */
  const amb_parts *sensor;    /* [sensors]: runout, non-linearity, quantisation */
  int rings;
  const amb_ring *ring;
  int delay;           /* dead time from a sample to the change of the demanded currents: integer
                          number of samples, 0 to AMB_DELAY_MOST, ... */
  amb_real delay_rest; /* ... and the remainder [s], 0 to less than the sampling time */
  int substeps;        /* Runge-Kutta steps in a sample, >= 1 */
  bool plain; /* without current states, states between magnet and rotor, dependence on velocities
                 or the angle, and soft stops */
} amb_plant;

typedef struct amb_plant_state {
  amb_real X[AMB_PLANT_STATES];
  amb_real cosine, sine;                                 /* of the angle of rotation */
  amb_real demanded[AMB_DELAY_MOST + 2][AMB_PLANT_AXES]; /* currents, the latest first [A] */
} amb_plant_state;

/* Inputs from one sample to the next. */
typedef struct amb_acts {
  const amb_real *demanded; /* [axes]: control currents [A] */
  const amb_real *load;     /* [axes]: disturbance forces [N] */
  const amb_real *base;     /* [3]: acceleration of the foundation [m/s^2]; NULL: none */
  amb_real speed, next;     /* of rotation, at this and the next sample [rad/s] */
  amb_real scale;           /* factor of the magnet forces, with the bias [1] ... */
  bool off;                 /* ... and whether they have no current, not even the bias */
} amb_acts;

/* Current, force and voltage of an axis at an instant. */
typedef struct amb_acting {
  amb_real iu;         /* control current; of a pair the mean of both [A] */
  amb_real force;      /* of the magnet, relative to its bias force [N] */
  amb_real voltage[2]; /* of each coil [V]; 0 if not modelled */
} amb_acting;

/* Along axis f: displacement from the positions [m], or velocity from their velocities [m/s]. */
static inline amb_real amb_plant_along(const amb_plant *plant, int f, const amb_real positions[])
{
  return plant->own ? positions[f] : amb_sparse_times(&plant->H, plant->H.value, f, positions);
}

/* Advances the plant by the sampling time T [s]: classical Runge-Kutta method of order 4 with fixed
 * substeps, split where the demand changes within a sample, and with smaller steps in contact with
 * a soft stop. At a hard stop the rotor stays, without bouncing, until the force pulls it off.
 * Returns whether a stop was touched. */
bool amb_plant_advance(const amb_plant *plant, amb_plant_state *state, amb_real T,
                       const amb_acts *acts);

/* Rates of the states, each in its unit per second, without hard stops and dead time. */
void amb_plant_rates(const amb_plant *plant, const amb_plant_state *state, const amb_acts *acts,
                     amb_real rates[]);

/* Current, force and voltage at axis f while its control current iu [A] is demanded. */
amb_acting amb_plant_acting(const amb_plant *plant, const amb_plant_state *state, int f,
                            const amb_acts *acts, amb_real iu);

/* The demand that acts at axis f just after a sample with demand iu [A], before amb_plant_advance
 * ... */
amb_real amb_plant_from_now(const amb_plant *plant, const amb_plant_state *state, int f,
                            amb_real iu);

/* ... and just before a sample; iu: demand at the previous one. */
static inline amb_real amb_plant_until_now(const amb_plant *plant, const amb_plant_state *state,
                                           int f, amb_real iu)
{
  return (plant->delay > 0) || (plant->delay_rest > 0) ? state->demanded[plant->delay][f] : iu;
}

/* Equilibrium at the positions q with constant control currents [A], sensors settled. */
void amb_plant_settle(const amb_plant *plant, amb_plant_state *state, const amb_real q[],
                      const amb_real iu[]);

/* Whether this is one plain axis with the closed law of two sides: these can run in lanes. */
bool amb_plant_is_plain_axis(const amb_plant *plant);

#endif
