/* What a state is, to whoever must find a lost rotor again (ambkit/envelope.h). */
#ifndef AMBKIT_ROLE_H
#define AMBKIT_ROLE_H

typedef enum amb_role {
  AMB_POSITION, /* of the rotor */
  AMB_VELOCITY,
  AMB_SHOWN, /* follows from the positions when all is at rest: what a sensor shows */
  AMB_LOAD,  /* pushes from outside, unknown: disturbance forces */
  AMB_KNOWN, /* follows from the controls, whatever happens to the rotor: currents */
  AMB_NOISE  /* of its own: what has a memory in a sensor's noise */
} amb_role;

#endif
