/* Extended Kalman filter of a rotor that may lie on its touch-down bearings: `own` is an
 * amb_contact.
 *
 * A ring about two axes, or a stop along one, has at the depth d = |s| - clearance the force
 *
 *   N = K d^1.5 (1 + 3/2 damping d'),  never a pull    (Hunt & Crossley 1975)
 *
 * Each sample decides between two hypotheses: the rotor is free, or it is in contact, where its
 * mean displacement s over the sample is beyond the clearance. In contact N is held over the sample
 * as the forces of the magnets are, so that the model stays exact between samples. Forces held move
 * the mean displacement by T^2 / (6 mass) and its rate by T / (2 mass) a newton, of the mass that
 * the contact moves: those of the magnets and the disturbance force are in d and d', and N, which
 * yields to itself, is a step of Newton's method from N_0, the force without it. Its tangents k and
 * c by d and d' make w, by the rows h and h' of the states:
 *
 *   give = 1 / (1 + k T^2 / (6 mass) + c T / (2 mass)),  N = give N_0,  w = give (k h + c h')
 *
 * As N is no straight line within the deviation of d,
 * its mean and variance have second-order terms (Gaussian second-order filter, Jazwinski
 * 1970, 9.3), with E, the elastic part of N, and a share of at most 6, where the deviation is four
 * times d:
 *
 *   bent = N'' var(d) / (2 N) = w'Pw / (6 E^2),   N <- (1 + bent) N
 *
 * and A takes u in, what a newton leaves in the states:
 *
 *   A <- A - u w',   P+ = A P A' + growth + (2 bent^2 + scatter^2) N^2 u u'
 *
 * Along a ring the friction of the share mu of N acts against the slip of the rotor's surface, at
 * most what brings that to rest in a sample; u is of both forces.
 *
 * A sample resolves stiffnesses up to 3 mass / T^2; there the tangent goes on straight. Damping is
 * held to mass / T.
 */
#ifndef AMBKIT_CONTACT_H
#define AMBKIT_CONTACT_H

#include "ambkit/estimator.h"

AMB_EXTERN_C_BEGIN

typedef struct amb_contact {
  int rings;                         /* 0 to AMB_FORCES */
  unsigned short first[AMB_FORCES];  /* of a ring: its axis ... */
  unsigned short second[AMB_FORCES]; /* ... and the one across; again the first: a stop along it */
  amb_real clearance[AMB_FORCES];    /* [m], > 0 */
  amb_real stiffness[AMB_FORCES];    /* K [N/m^1.5], > 0 */
  amb_real damping[AMB_FORCES];      /* [s/m], >= 0 */
  amb_real friction[AMB_FORCES];     /* of a ring about two axes [1], >= 0 */
  amb_real surface[AMB_FORCES];      /* velocity of the rotor's surface by its rotation [m/s] */
  amb_real moves[AMB_FORCES];        /* T^2 / (6 mass) [m/N], > 0 */
  amb_real hastens[AMB_FORCES];      /* T / (2 mass) [m/s/N], > 0 */
  amb_real displacement[AMB_FORCES][AMB_STATES]; /* h: of each axis, its mean over the sample ... */
  amb_real velocity[AMB_FORCES][AMB_STATES];     /* ... and h': its rate, by the states */
  amb_real scatter_squared; /* variance of the contact force as a share of N^2 [1], >= 0 */
} amb_contact;

/* Contact forces N along the axes [N] over the sample that begins at a mean of the states, under
 * currents iu [A]; 0 where the rotor is free. F: the other forces there, by so many times those of
 * the magnets [N]. Returns AMB_CONTACT or AMB_OK. */
amb_status amb_contact_forces(const amb_estimator *self, const amb_real mean[AMB_STATES],
                              const amb_real iu[AMB_CONTROLS], amb_real scale,
                              amb_real F[AMB_FORCES], amb_real N[AMB_FORCES]);

extern const amb_estimator_methods amb_contact_methods;

AMB_EXTERN_C_END

#endif
