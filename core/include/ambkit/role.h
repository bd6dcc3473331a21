/* Role of a state, for the recovery of a lost estimate (ambkit/envelope.h). */
#ifndef AMBKIT_ROLE_H
#define AMBKIT_ROLE_H

typedef enum amb_role {
  AMB_POSITION, /* of the rotor */
  AMB_VELOCITY,
  AMB_SHOWN, /* determined by the positions in equilibrium: a reading */
  AMB_LOAD,  /* external and unknown: disturbance forces */
  AMB_KNOWN, /* determined by the controls, independent of the rotor: currents */
  AMB_NOISE  /* coloured sensor noise */
} amb_role;

#endif
