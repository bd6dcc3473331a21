/* What a state is, to whoever must find a lost rotor again (ambkit/envelope.h). */
#ifndef AMBKIT_ROLE_H
#define AMBKIT_ROLE_H

typedef enum amb_role {
  AMB_POSITION, /* of the rotor */
  AMB_VELOCITY,
  AMB_SHOWN, /* follows from the positions when all is at rest: what a sensor shows */
  AMB_LOAD,  /* acts from outside, unknown: disturbance forces, noise with a memory */
  AMB_KNOWN  /* follows from the controls, whatever happens to the rotor: currents */
} amb_role;

#endif
