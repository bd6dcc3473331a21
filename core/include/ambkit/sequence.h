/* Lift-off and landing: when the currents are on, and how far the rotor is on its way from where it
 * lies to its reference. Of any number of axes: they go together. */
#ifndef AMBKIT_SEQUENCE_H
#define AMBKIT_SEQUENCE_H

#include "ambkit/real.h"

AMB_EXTERN_C_BEGIN

typedef enum amb_flight_mode {
  AMB_OFF,     /* no currents; the rotor lies in its touch-down bearing */
  AMB_WAITING, /* no currents yet, until what feeds the controllers can be used */
  AMB_LIFTING, /* on the way up */
  AMB_FLYING,
  AMB_LANDING, /* on the way down */
  AMB_TRIPPED  /* no currents, until it is told not to fly */
} amb_flight_mode;

typedef struct amb_sequence {
  unsigned int waiting;    /* samples in a row that can be used, until it lifts */
  unsigned int lost;       /* samples in a row that cannot be used, beyond which it trips */
  unsigned int overloaded; /* samples in a row with a current at its limit, beyond which it trips */
  amb_real rise;           /* of the way up, the share of a sample [1] ... */
  amb_real descent;        /* ... and of the way down */
} amb_sequence;

typedef struct amb_sequence_state {
  amb_flight_mode mode;
  unsigned int usable; /* samples in a row ... */
  unsigned int unusable;
  unsigned int limited;
  amb_real share; /* of the way to the reference [1]: 0 where it lies, 1 there */
} amb_sequence_state;

/* Off. */
void amb_sequence_init(amb_sequence_state *state);

/* In flight, as if it had lifted. */
void amb_sequence_levitate(amb_sequence_state *state);

/* Whether there are currents. */
bool amb_sequence_on(const amb_sequence_state *state);

/* One sample: whether it is to fly, whether what feeds the controllers can be used, and whether a
 * current was at its limit in the last sample. Returns the mode. */
amb_flight_mode amb_sequence_step(const amb_sequence *sequence, amb_sequence_state *state, bool fly,
                                  bool usable, bool limited);

/* The share of the way, without a jump of the velocity at its ends [1]. */
amb_real amb_sequence_way(const amb_sequence_state *state);

AMB_EXTERN_C_END

#endif
