/* Lift-off and landing: when the currents are on, and the position of the rotor between contact and
 * reference. For any number of axes, which move together. */
#ifndef AMBKIT_SEQUENCE_H
#define AMBKIT_SEQUENCE_H

#include "ambkit/real.h"

AMB_EXTERN_C_BEGIN

typedef enum amb_flight_mode {
  AMB_OFF,     /* no currents; the rotor is on its touch-down bearing */
  AMB_WAITING, /* no currents, until the controllers' input is usable */
  AMB_LIFTING, /* rising */
  AMB_FLYING,
  AMB_LANDING, /* landing */
  AMB_TRIPPED  /* no currents, until the command to levitate is withdrawn */
} amb_flight_mode;

typedef struct amb_sequence {
  unsigned int waiting;    /* consecutive usable samples before lift-off */
  unsigned int lost;       /* consecutive unusable samples before a trip */
  unsigned int overloaded; /* consecutive samples at a current limit before a trip */
  amb_real rise;           /* share of the rise per sample [1] ... */
  amb_real descent;        /* ... and of the landing */
} amb_sequence;

typedef struct amb_sequence_state {
  amb_flight_mode mode;
  unsigned int usable; /* consecutive samples ... */
  unsigned int unusable;
  unsigned int limited;
  amb_real share; /* share of the way to the reference [1]: 0 in contact, 1 at the reference */
} amb_sequence_state;

/* Off. */
void amb_sequence_init(amb_sequence_state *state);

/* Levitated, as after lift-off. */
void amb_sequence_levitate(amb_sequence_state *state);

/* Whether there are currents. */
bool amb_sequence_on(const amb_sequence_state *state);

/* One sample: the command to levitate, whether the controllers' input is usable, and whether a
 * current was at its limit in the last sample. Returns the mode. */
amb_flight_mode amb_sequence_step(const amb_sequence *sequence, amb_sequence_state *state, bool fly,
                                  bool usable, bool limited);

/* Without currents until the command to levitate is withdrawn; remains off if it is. */
void amb_sequence_trip(amb_sequence_state *state);

/* The share of the way, with zero velocity at both ends [1]. */
amb_real amb_sequence_way(const amb_sequence_state *state);

AMB_EXTERN_C_END

#endif
